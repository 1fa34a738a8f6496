"""Wheel forces of runs without dynamometers: runs read for them, results as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.errors import UsageError
from lacet.daq.formats.open_run import open_log
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.rig import Rig
from lacet.identify.wheel_loads.measured_forces import ComparedForces, ForceError
from lacet.identify.wheel_loads.outputs import EstimatedForces
from lacet.services.workspace.loading import CheckedRun, checked_run
from lacet.services.workspace.study import Study


def read_run(study: Study, path: Path, rig: Path | None = None, channel_map: Path | None = None) -> CheckedRun:
    """A run of the study's car, prepared with its filters, and its doubtful channels; wheel loads are not needed.

    `rig` : of the run, where its instruments are not the study's. Raises UsageError when there is no such file.
    """
    if not path.exists():
        raise UsageError(f"{path}: no such run")
    run = open_log(path, None if channel_map is None else ChannelMap.load(channel_map))
    sensors = study.rig if rig is None else Rig.load(rig)
    # Loads are at the study's point, whatever a log without any says.
    run = replace(run, wheel_reference=study.rig.wheel_reference)
    return checked_run(run, study.vehicle, sensors, study.filters)


def forces_result(estimated: EstimatedForces, found: Mapping[str, ForceError]) -> dict[str, Any]:
    """Forces of a run as plain data, without their time histories; `found` : errors where it has dynamometers."""
    return {
        "run": estimated.run,
        "wheel_reference": estimated.reference,
        "cutoff": estimated.cutoff,
        "instants": int(estimated.t.size),
        "rows": list(estimated.rows),
        "forces": {
            name: {
                "unit": force.unit,
                "determined": float(np.mean(force.determined)) if force.determined.size else 0.0,
                "mean": _mean(force.value),
                "half95": _mean(force.half95),
                "sources": dict(force.parts),
                "row": force.row,
                "floor": force.floor,
                "error": error_result(found[name]) if name in found else None,
            }
            for name, force in estimated.forces.items()
        },
        "constants": [asdict(one) for one in estimated.constants if one.kind != "parameters"],
    }


def error_result(error: ForceError) -> dict[str, float]:
    """An error against dynamometers as plain data."""
    return {name: getattr(error, name) for name in ("offset", "rms", "floors", "zero", "inside")}


def compared_result(parts: Sequence[ComparedForces]) -> dict[str, Any]:
    """Run → force → error against its dynamometers and half of its band."""
    return {
        part.estimated.run: {
            name: {**error_result(error), "half95": _mean(part.estimated[name].half95)}
            for name, error in part.errors.items()
        }
        for part in parts
    }


def _mean(values: np.ndarray[Any, np.dtype[np.float64]]) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else None
