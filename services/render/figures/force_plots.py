"""Pictures of wheel forces estimated without dynamometers, with their bands, and what dynamometers measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.identify.wheel_loads.measured_forces import ForceError
from lacet.identify.wheel_loads.outputs import EstimatedForces
from lacet.services.render.figures.panels import HELD, MEASURED, MODEL, Axis, Band, Line, Mark, Panel, Panels
from lacet.services.render.figures.png import charts_png
from lacet.services.render.figures.study_plots import WIDTH
from lacet.services.render.intervals import half_width


def forces_picture(estimated: EstimatedForces, errors: Mapping[str, ForceError]) -> bytes:
    """The forces of a run as PNG."""
    return charts_png(forces_charts(estimated, errors))


def forces_charts(estimated: EstimatedForces, errors: Mapping[str, ForceError]) -> Panels:
    """Each force that is determined, with its 95 % band, and the measured one where there is any."""
    panels: list[Panel] = []
    for name, force in estimated.forces.items():
        known = force.determined
        if not np.any(known):
            continue
        t, value, half = estimated.t[known], force.value[known], force.half95[known]
        marks: list[Mark] = [Band(t, value - half, value + half, HELD, "95 %")]
        title = f"{name} [N]   ± {half_width(float(np.mean(half)))} N"
        if error := errors.get(name):
            marks.append(Line(t, error.measured[known], MEASURED, "measured", width=1.6))
            title += f", error {error.floors:.2f} × floor, {100.0 * error.inside:.0f} % in the band"
        marks.append(Line(t, value, MODEL, "without dynamometers", width=1.1))
        panels.append(Panel(title, marks, Axis("time [s]"), tight=True))
    return Panels(f"{estimated.run}: wheel forces without dynamometers", panels, 2, (WIDTH / 2.0, 200.0))
