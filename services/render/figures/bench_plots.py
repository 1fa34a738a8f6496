"""Pictures of bench tables: toe, camber and wheel-centre path of every test of a kinematics and compliance bench."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lacet.services.render.figures.panels import ERROR, FAULT, HELD, MEASURED, Axis, Line, Mark, Panel, Panels
from lacet.services.render.figures.png import charts_png
from lacet.services.render.figures.study_plots import WIDTH

Columns = Mapping[str, NDArray[np.float64]]

DRIVES = {
    "bump": ("travel.fl", "travel [mm]"),
    "roll": ("travel.fl", "travel of the left wheel [mm]"),
    "single-left": ("travel.fl", "travel of the left wheel [mm]"),
    "single-right": ("travel.fr", "travel of the right wheel [mm]"),
    "steer": ("rack", "rack [mm]"),
    "lateral": ("fy.fl", "force to the left [N]"),
    "lateral-opposed": ("fy.fl", "force outwards [N]"),
    "longitudinal": ("fx.fl", "force forwards [N]"),
    "longitudinal-opposed": ("fx.fl", "force on the left wheel [N]"),
    "traction": ("traction.fl", "force forwards on the wheel centre [N]"),
    "traction-opposed": ("traction.fl", "force on the left wheel centre [N]"),
    "aligning": ("mz.fl", "moment to the left [N·m]"),
    "aligning-opposed": ("mz.fl", "moment on the left wheel [N·m]"),
}
"""What is moved or loaded in each test: its column, and the label of its axis. A grid is not drawn."""
WHEELS = {"fl": MEASURED, "fr": FAULT, "rl": ERROR, "rr": HELD}
"""Colour of each wheel."""


def bench_picture(car: str, tables: Mapping[str, Columns]) -> bytes:
    """The tables of a bench by test, each column an array, as PNG."""
    return charts_png(bench_charts(car, tables))


def bench_charts(car: str, tables: Mapping[str, Columns]) -> Panels:
    """Of each test: toe and camber as changes, and the wheel centre's shift ahead and outwards."""
    panels: list[Panel] = []
    for name, (drive, label) in DRIVES.items():
        if name not in tables:
            continue
        columns = tables[name]
        middle = np.abs(columns["travel.fl"]) < 1e-9 if name == "steer" else np.ones(len(columns["rack"]), bool)
        x = columns[drive][middle]
        zero = int(np.argmin(np.abs(x)))
        for column, what in (
            ("toe", "toe-in [°]"),
            ("camber", "camber [°]"),
            ("x", "ahead [mm]"),
            ("y", "outwards [mm]"),
        ):
            marks: list[Mark] = []
            for wheel, colour in WHEELS.items():
                y = columns[f"{column}.{wheel}"][middle]
                marks.append(Line(x, y - y[zero], colour, wheel, dashed=wheel[1] == "r", width=1.2))
            panels.append(Panel(f"{name}: {what}", marks, Axis(label), tight=True))
    return Panels(f"{car} on the bench: changes from the middle of each test", panels, 4, (WIDTH / 3.2, 150.0))
