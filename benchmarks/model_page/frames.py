"""The frames on the car, drawn to scale from a vehicle file and a rig file."""

from __future__ import annotations

from math import cos, sin

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from benchmarks.model_page.style import BODY, FORCE, LINE, MOTION, NOTE, arrow, canvas
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle

LENGTH = 0.42
"""Of an axis [m]."""


NAMES = (
    (BODY, "body: from the middle of the front"), ("none", "wheel centres at design height"),
    (FORCE, "carrier: one at each wheel; it steers"), ("none", "and cambers, but does not spin"),
    (MOTION, "sensors, as they are mounted"),
)  # fmt: skip
"""Colour → frame; a second line has no colour."""


def draw(vehicle: Vehicle, rig: Rig) -> Figure:
    """Side view and top view, to scale [m], and one wheel from behind."""
    figure, axes = canvas(11.5, 6.9)
    axes.set_aspect("equal")
    _side(axes, vehicle, rig, 0.0)
    _top(axes, vehicle, rig, -2.1)
    _wheel(axes, 2.45, -0.28)
    for i, (colour, text) in enumerate(NAMES):
        axes.plot([1.45, 1.65], [-1.85 - 0.25 * i] * 2, color=colour, lw=2.5)
        axes.text(1.75, -1.85 - 0.25 * i, text, fontsize=9, va="center")
    axes.set_xlim(-4.1, 3.9)
    axes.set_ylim(-3.1, 1.6)
    return figure


def _side(axes: Axes, vehicle: Vehicle, rig: Rig, y0: float) -> None:
    """Seen from the right: x to the right, z up."""
    axes.text(-4.0, y0 + 1.45, "From the right", fontsize=10, weight="bold")
    axes.add_patch(FancyBboxPatch((-3.55, y0 - 0.02), 4.3, 0.5, boxstyle="round,pad=0.12", fc="#eef2f7", ec=NOTE))
    axes.add_patch(FancyBboxPatch((-2.75, y0 + 0.6), 2.2, 0.3, boxstyle="round,pad=0.12", fc="#f6f8fa", ec=NOTE))
    ground = 0.0
    for corner in ("fr", "rr"):
        x, _, z = vehicle.corners[corner].position
        one = vehicle.corners[corner]
        axes.add_patch(Circle((x, y0 + z), one.tyre_radius, fc="white", ec=LINE, lw=1.6))
        ground = z - one.height
    axes.plot([-4.0, 1.2], [y0 + ground] * 2, color=LINE, lw=1.2)
    rear = vehicle.corners["rr"].position
    _axes(axes, (rear[0], y0 + rear[2]), "x", "z", FORCE, "")
    _axes(axes, (0.0, y0), "x", "z", BODY, "")
    _instrument(axes, rig, "imu.accel", y0, 2)
    _instrument(axes, rig, "correvit.speed", y0, 2)
    lasers = rig.sensor_of("laser.fl.ground")
    if lasers is not None and lasers.from_wheel_centre is not None:
        for corner in ("fr", "rr"):
            one = vehicle.corners[corner]
            top = one.position[2] + lasers.from_wheel_centre[2]
            at = one.position[0] + lasers.from_wheel_centre[0]
            arrow(axes, (at, y0 + top), (at, y0 + one.position[2] - one.height), MOTION)
            axes.plot([at], [y0 + top], "s", ms=6, color=MOTION)
            axes.text(at - 0.08, y0 + top, "lasers", ha="right", va="center", fontsize=9, color=MOTION)


def _top(axes: Axes, vehicle: Vehicle, rig: Rig, y0: float) -> None:
    """Seen from above: x to the right, y up (to the car's left)."""
    axes.text(-4.0, y0 + 1.05, "From above", fontsize=10, weight="bold")
    axes.add_patch(FancyBboxPatch((-3.55, y0 - 0.7), 4.3, 1.4, boxstyle="round,pad=0.12", fc="#eef2f7", ec=NOTE))
    for name, corner in vehicle.corners.items():
        x, y, _ = corner.position
        place, length = (x - corner.tyre_radius, y0 + y - 0.1), 2 * corner.tyre_radius
        axes.add_patch(Rectangle(place, length, 0.2, fc="white", ec=LINE, lw=1.6))
        _axes(axes, (x, y0 + y), "x", "y", FORCE, "", short=name in ("rl", "rr"))
        axes.text(x - 0.36, y0 + y, name, fontsize=9, ha="right", va="center", weight="bold")
    _axes(axes, (0.0, y0), "x", "y", BODY, "")
    _instrument(axes, rig, "imu.accel", y0, 1)
    _instrument(axes, rig, "correvit.speed", y0, 1)


def _instrument(axes: Axes, rig: Rig, channel: str, y0: float, other: int) -> None:
    """A sensor with one place: its axes where it is mounted; `other` is the coordinate drawn upwards."""
    sensor = rig.sensor_of(channel)
    if sensor is None:
        return
    place = next(iter(sensor.position.values()))
    at = (place[0], y0 + place[other])
    axes.plot(*at, "s", ms=8, color=MOTION)
    _axes(axes, at, "x", "zyz"[other], MOTION, sensor.name, short=True)


def _axes(
    axes: Axes, at: tuple[float, float], right: str, up: str, colour: str, name: str, short: bool = False
) -> None:
    """Two axes of a frame."""
    length = LENGTH * (0.7 if short else 1.0)
    arrow(axes, at, (at[0] + length, at[1]), colour, right, offset=(0.07, 0.0))
    arrow(axes, at, (at[0], at[1] + length), colour, up, offset=(0.0, 0.08))
    if name:
        axes.text(at[0], at[1] - 0.09, name, fontsize=9, color=colour, ha="center", va="top")


def _wheel(axes: Axes, x0: float, y0: float) -> None:
    """A left wheel seen from behind on a road that leans: spin axis n, road normal e, deflection."""
    axes.text(x0 - 0.95, y0 + 1.73, "A left wheel from behind", fontsize=10, weight="bold")
    lean, bank, radius, width = -0.10, 0.09, 0.62, 0.34
    n = (-cos(lean), -sin(lean))  # to the left of the car: to the left of the picture
    up = (-sin(lean), cos(lean))
    e = (-sin(bank), cos(bank))
    road = (cos(bank), sin(bank))
    ring = [(a * width / 2, b * radius) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    xs, ys = ([at + a * n[i] + b * up[i] for a, b in ring] for i, at in enumerate((x0, y0)))
    axes.plot(xs, ys, color=LINE, lw=1.6)
    foot = (x0 - 0.55 * e[0], y0 - 0.55 * e[1])
    left, right = ([foot[i] + s * road[i] for i in (0, 1)] for s in (-0.95, 0.85))
    axes.plot([left[0], right[0]], [left[1], right[1]], color=LINE, lw=1.2)
    end = (x0 + 0.6 * n[0], y0 + 0.6 * n[1])
    arrow(axes, (x0, y0), end, FORCE, "n: spin axis, carrier y", offset=(-0.08, 0.14))
    arrow(axes, (x0, y0), (x0 + 0.9 * up[0], y0 + 0.9 * up[1]), FORCE, "carrier z", offset=(0.1, 0.08), ha="left")
    base = (foot[0] + 0.55 * road[0], foot[1] + 0.55 * road[1])
    tip = (base[0] + 0.6 * e[0], base[1] + 0.6 * e[1])
    arrow(axes, base, tip, BODY, "e: the road's normal", offset=(-0.1, 0.1), ha="left")
    both = {"arrowstyle": "<->", "color": NOTE, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x0, y0), foot, arrowprops=both)
    axes.text(x0 + 0.09, y0 - 0.3, "h", fontsize=9, color=NOTE)
    axes.text(x0 - 0.95, y0 - 0.95, "tyre deflection", fontsize=9)
    axes.text(x0 - 0.95, y0 - 1.15, "δ = R0 − h / √(1 − (n·e)²)", fontsize=9)
