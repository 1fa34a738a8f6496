"""Storage form of a study's runs: their channels on the grid, from which all else is computed quickly."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.sources.completion import completed
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.for_equations import with_travel_as_laser
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.services.workspace.loading import Loaded

LONGEST = 1800.0
"""Runs that are longer than this together are read anew [s]: kept, half an hour takes 150 MB."""
_MADE = ("signals", "smoothers", "vehicle", "rig", "sources", "laws", "tables")
"""Fields of a recording that are made again: of its channels, and of the study's files."""


def is_short(loaded: Loaded) -> bool:
    """Whether runs are short enough to be kept."""
    return sum(run.recording.t.size / run.recording.filters.rate for run in loaded.prepared) <= LONGEST


def runs_record(loaded: Loaded) -> dict[str, Any]:
    """Runs that were read and checked, and what was said of them, in storable form."""
    return {
        "warnings": loaded.warnings, "sheet": loaded.sheet, "notes": loaded.notes,
        "recordings": [_record(run.recording) for run in loaded.prepared],
    }  # fmt: skip


def restored_runs(kept: Mapping[str, Any], rig: Rig, vehicle: Vehicle) -> Loaded:
    """The runs from their stored form, to the last bit; `rig` and `vehicle` as the study's files have them."""
    prepared = tuple(PreparedRun(_restored(one, rig, vehicle)) for one in kept["recordings"])
    rig = _with_travels(rig, kept["recordings"][0]["channels"])
    return Loaded(vehicle, rig, prepared, kept["warnings"], sheet=kept["sheet"], notes=kept["notes"])


def _record(recording: Recording) -> dict[str, Any]:
    """A recording's channels, the noise of its sensors where it was measured, and motion that was filtered away."""
    return {
        "fields": {one.name: getattr(recording, one.name) for one in fields(recording) if one.name not in _MADE},
        "value": {name: a for name, a in recording.signals.value.items() if name not in recording.sources},
        "completed": bool(recording.sources or recording.tables),
        "noise": [sensor.noise for sensor in recording.rig.sensors],
        "channels": [name for sensor in recording.rig.sensors for name in sensor.channels],
        "beyond": max((one.beyond for one in recording.smoothers.values()), default=None),
    }


def _restored(kept: Mapping[str, Any], rig: Rig, vehicle: Vehicle) -> Recording:
    filters, noise, beyond = kept["fields"]["filters"], kept["noise"], kept["beyond"]
    signals = Signals.differentiated(kept["value"], filters.rate)
    rig = _with_noise(_with_travels(rig, kept["channels"]), noise)
    whole = Recording(**kept["fields"], signals=signals, vehicle=vehicle, rig=rig)
    whole = whole if beyond is None else whole.smoothed(beyond)
    return completed(whole) if kept["completed"] else whole


def _with_travels(rig: Rig, channels: Collection[str]) -> Rig:
    """The rig with its sensors of travel as those of hub lasers where a recording's `channels` of the rig are these."""
    travels = {f"suspension.{c}.travel": f"laser.{c}.hub" for c in CORNERS}
    return with_travel_as_laser(rig, {travel: hub for travel, hub in travels.items() if travel not in channels})


def _with_noise(rig: Rig, noise: Sequence[Mapping[str, float]]) -> Rig:
    """The rig, with the noise of its sensors that was measured where it is another than the sheet's."""
    if [sensor.noise for sensor in rig.sensors] == noise:
        return rig
    return replace(rig, sensors=tuple(replace(s, noise=one) for s, one in zip(rig.sensors, noise, strict=True)))
