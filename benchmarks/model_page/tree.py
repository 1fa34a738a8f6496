"""The car's tree of 42 bodies, drawn from the tree that the equations are formed with."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.model_page.style import BODY, LINE, NOTE, canvas
from lacet.daq.vehicle import Vehicle
from lacet.identify.properties.structural_identifiability import TreeJoint, car_tree

COLUMN = 3.3
"""Width of a branch."""
ROW = 0.62
"""Height of a joint."""
TITLES = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}
FORCES = {"damper clearance": "spring, damper, static load", "tyre deflection": "tyre stiffness"}
"""Joint → force of the base model on it."""


def draw(vehicle: Vehicle) -> Figure:
    """A node a joint: number, name, motion, body. The posture stands above, each corner is a column below."""
    joints = car_tree(vehicle)
    places = _places(joints)
    figure, axes = canvas(12.4, 9.2)
    for joint in joints:
        x, y = places[joint.number]
        x0, y0 = places[joint.antecedent]
        if joint.antecedent == 6:
            y1 = places[6][1] - 0.75 * ROW
            axes.plot([x0, x0, x, x], [y0, y1, y1, y], color=LINE, lw=1.2, zorder=1)
        elif x == x0:
            axes.plot([x0, x], [y0, y], color=LINE, lw=1.2, zorder=1)
        else:  # past the wheel: the tyre hangs on the carrier
            axes.plot([x0, x0 - 0.33, x0 - 0.33, x], [y0, y0, y, y], color=LINE, lw=1.2, zorder=1)
        face, ink = (BODY, "white") if joint.body else ("white", LINE)
        marker = "s" if joint.kind == "slides" else "o"
        axes.plot([x], [y], marker, ms=17, mfc=face, mec=LINE, mew=1.2, zorder=2)
        axes.text(x, y, str(joint.number), ha="center", va="center", fontsize=8, color=ink, zorder=3)
        note = joint.body or FORCES.get(joint.name, "")
        shift = 0.11 if note else 0.0
        axes.text(x + 0.25, y + shift, f"{joint.name}, {joint.kind} {joint.axis}", va="center", fontsize=9)
        if note:
            axes.text(x + 0.25, y - 0.13, note, va="center", fontsize=8, color=BODY if joint.body else NOTE)
    for corner in TITLES:
        x, y = places[next(joint.number for joint in joints if joint.corner == corner)]
        axes.text(x + 0.25, y + 0.4, TITLES[corner], fontsize=10, weight="bold")
    x, y = places[0]
    axes.plot([x - 0.3, x + 0.3], [y, y], color=LINE, lw=2)
    axes.text(x + 0.45, y, "ground", va="center", fontsize=9)
    _legend(axes, -5.1, places[1][1])
    axes.set_xlim(-5.6, 8.0)
    axes.set_ylim(min(y for _, y in places.values()) - 0.4, 0.4)
    return figure


def _places(joints: Sequence[TreeJoint]) -> dict[int, tuple[float, float]]:
    """Number of a joint (0: the ground) → where its node is."""
    corners = list(dict.fromkeys(joint.corner for joint in joints if joint.corner))
    out = {0: (0.0, 0.0)}
    depth = dict.fromkeys(corners, 0)
    for joint in joints:
        if not joint.corner:
            out[joint.number] = (0.0, -ROW * joint.number)
            continue
        column = ("fl", "fr", "rl", "rr").index(joint.corner)
        depth[joint.corner] += 1
        beside = joint.name == "tyre deflection"
        x = -5.1 + COLUMN * column + (0.25 if beside else 0.0)
        out[joint.number] = (x, -ROW * (7.6 + depth[joint.corner]))
    return out


def _legend(axes: Axes, x: float, y: float) -> None:
    kinds = (
        ("s", "white", "slides along an axis"), ("o", "white", "turns about an axis"),
        ("o", BODY, "carries a body with mass"),
    )  # fmt: skip
    for i, (marker, face, text) in enumerate(kinds):
        axes.plot([x], [y - ROW * i], marker, ms=13, mfc=face, mec=LINE, mew=1.2)
        axes.text(x + 0.25, y - ROW * i, text, va="center", fontsize=9)
    axes.text(
        x, y - ROW * 3, "x forward, y left, z up when every joint is at zero", va="center", fontsize=9, color=NOTE
    )
