"""Wheel forces of runs without dynamometers, as tables and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lacet.identify.wheel_loads.measured_forces import ComparedForces, ForceError
from lacet.identify.wheel_loads.outputs import EstimatedForces
from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.tables import table

_SHORT = {"gains and latencies": "gains", "lack of fit": "lack", "channels not measured": "channels"}


def forces_table(estimated: EstimatedForces, errors: Mapping[str, ForceError]) -> str:
    """Each force with its band, where the band comes from, and its error where dynamometers measured it."""
    sources = list(dict.fromkeys(source for force in estimated.forces.values() for source in force.parts))
    head = ["force", "mean [N]", "± 95 %", *(f"{_SHORT.get(s, s)} [1 σ]" for s in sources)]
    head += ["error", "÷ floor", "in band"] if errors else []
    lines: list[list[str]] = []
    for name, force in estimated.forces.items():
        if not np.any(force.determined):
            lines.append([name, "not determined", *[""] * (len(head) - 2)])
            continue
        mean, half = float(np.nanmean(force.value)), float(np.nanmean(force.half95))
        line = [name, to_interval(mean, half), half_width(half)]
        line += [half_width(force.parts.get(source, 0.0)) for source in sources]
        lines.append([*line, *_error(errors.get(name))] if errors else line)
    return table(head, lines)


def _error(error: ForceError | None) -> list[str]:
    if error is None:
        return ["", "", ""]
    return [f"{error.rms:.3g}", f"{error.floors:.2f}", f"{100.0 * error.inside:.0f} %"]


def not_determined(estimated: EstimatedForces) -> str:
    """Why longitudinal forces are not given by axle, and what would separate them; empty where they are."""
    if any(np.any(estimated[f"axle.{axle}.force_estimated.x"].determined) for axle in ("front", "rear")):
        return ""
    return (
        "Longitudinal forces by axle need the torques on the wheels of one axle: brakes declared off in a car with a "
        "free axle, or brake.pressure, or shaft and brake torques."
    )


def compared_table(parts: Sequence[ComparedForces]) -> str:
    """Error ÷ floor of each estimated force, and the part of the time in its band, run by run."""
    names = list(dict.fromkeys(name for part in parts for name in part.errors))
    lines = [
        [
            name,
            *(f"{e.floors:.2f}  {100.0 * e.inside:3.0f} %" if (e := part.errors.get(name)) else "" for part in parts),
        ]
        for name in names
    ]
    return table(["force", *(part.estimated.run for part in parts)], lines)
