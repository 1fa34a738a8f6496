"""The four kinds of rows, each a body cut free: what is measured on it, and what the model says."""

from __future__ import annotations

from math import cos, radians, sin, tan

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from benchmarks.model_page.style import BODY, FORCE, LINE, MOTION, NOTE, arrow, canvas


def draw() -> Figure:
    """Chassis, suspension, tyre and spin rows, beside each other."""
    figure, axes = canvas(11.5, 7.2)
    axes.set_aspect("equal")
    _chassis(axes, 0.0, 0.0)
    _suspension(axes, 6.2, 0.0)
    _tyre(axes, 0.0, -4.3)
    _spin(axes, 6.2, -4.3)
    axes.set_xlim(-0.2, 11.6)
    axes.set_ylim(-5.55, 2.75)
    return figure


def _head(axes: Axes, x: float, y: float, title: str, *lines: str) -> None:
    axes.text(x, y + 2.45, title, fontsize=10, weight="bold", family="monospace")
    for i, line in enumerate(lines):
        axes.text(x, y + 2.12 - 0.3 * i, line, fontsize=9)


def _wheel(axes: Axes, x: float, y: float, radius: float = 0.45) -> None:
    axes.add_patch(Circle((x, y), radius, fc="white", ec=LINE, lw=1.6))


def _spring(axes: Axes, x: float, low: float, high: float) -> None:
    n = 8
    xs = [x, x, *(x + (0.1 if i % 2 else -0.1) for i in range(n)), x, x]
    step = (high - low) / (n + 3)
    axes.plot(xs, [low + step * i for i in range(n + 4)], color=LINE, lw=1.2)


def _damper(axes: Axes, x: float, low: float, high: float) -> None:
    middle = (low + high) / 2
    axes.plot([x, x], [low, middle - 0.02], color=LINE, lw=1.2)
    cup = [middle + 0.16, middle - 0.12, middle - 0.12, middle + 0.16]
    axes.plot([x - 0.12, x - 0.12, x + 0.12, x + 0.12], cup, color=LINE, lw=1.2)
    axes.plot([x - 0.09, x + 0.09], [middle, middle], color=LINE, lw=1.2)
    axes.plot([x, x], [middle, high], color=LINE, lw=1.2)


def _chassis(axes: Axes, x: float, y: float) -> None:
    _head(
        axes, x, y, "chassis.fx … chassis.mz", "The whole car: ΣF and Σ(M + p × F) of the wheels",
        "= inertia of all bodies, about the body origin",
    )  # fmt: skip
    axes.add_patch(FancyBboxPatch((x + 0.5, y + 0.35), 3.9, 0.55, boxstyle="round,pad=0.1", fc="#eef2f7", ec=LINE))
    for at in (x + 1.0, x + 3.8):
        _wheel(axes, at, y + 0.05)
        arrow(axes, (at, y - 0.95), (at, y - 0.02), FORCE, "F, M", offset=(0.32, -0.75))
    arrow(axes, (x + 2.4, y + 0.62), (x + 3.2, y + 0.62), MOTION, "a, ω, ω̇", offset=(0.45, 0.0))
    axes.plot([x + 2.4], [y + 0.62], "s", ms=7, color=MOTION)
    axes.plot([x + 3.8], [y + 0.05], "o", ms=4, color=BODY)
    axes.text(x + 3.75, y + 0.13, "origin", fontsize=8, color=BODY, ha="center")


def _suspension(axes: Axes, x: float, y: float) -> None:
    _head(
        axes, x, y, "suspension.{c}", "A corner along its travel s: F·∂p/∂s + M·∂φ/∂s (+ half-shaft)",
        "= inertia along s + k s + c ṡ + static load",
    )  # fmt: skip
    axes.add_patch(Rectangle((x + 0.4, y + 1.25), 2.4, 0.18, fc="#eef2f7", ec=LINE))
    axes.text(x + 2.9, y + 1.33, "body", fontsize=9, va="center")
    _spring(axes, x + 1.05, y + 0.2, y + 1.25)
    _damper(axes, x + 1.6, y + 0.2, y + 1.25)
    axes.add_patch(Rectangle((x + 0.8, y + 0.05), 1.1, 0.15, fc="#eef2f7", ec=LINE))
    _wheel(axes, x + 2.15, y + 0.1, 0.42)
    arrow(axes, (x + 2.15, y - 0.95), (x + 2.15, y + 0.05), FORCE, "F, M", offset=(0.4, -0.8))
    arrow(axes, (x + 0.45, y + 0.15), (x + 0.45, y + 0.95), MOTION, "s", offset=(-0.12, 0.0))
    note = "p, φ: place and rotation of the\ncarrier in the body; slopes from\nthe bench table"
    axes.text(x + 2.9, y + 0.45, note, fontsize=8, color=NOTE, va="center")


def _tyre(axes: Axes, x: float, y: float) -> None:
    _head(
        axes, x, y, "tyre.{c}", "A tyre along the road's normal e: F·e = kt δ",
        "with hub loads − m_out a·e: rim and tyre are outside",
    )  # fmt: skip
    _wheel(axes, x + 1.6, y + 0.35, 0.85)
    axes.add_patch(Circle((x + 1.6, y + 0.35), 0.42, fc="#eef2f7", ec=LINE))
    axes.plot([x + 0.3, x + 3.2], [y - 0.36, y - 0.36], color=LINE, lw=1.4)
    _spring(axes, x + 1.6, y - 0.36, y + 0.2)
    arrow(axes, (x + 1.6, y - 1.15), (x + 1.6, y - 0.38), FORCE, "F·e", offset=(0.35, -0.5))
    arrow(axes, (x + 2.75, y + 0.35), (x + 2.75, y - 0.35), MOTION)
    axes.plot([x + 1.6, x + 2.9], [y + 0.35, y + 0.35], color=MOTION, lw=0.8, ls=":")
    axes.text(
        x + 2.9, y, "h: ground laser − hub laser,\nalong the road's normal", fontsize=8, color=MOTION, va="center"
    )


def _spin(axes: Axes, x: float, y: float) -> None:
    _head(
        axes, x, y, "spin.{c}", "A wheel about its axis n: n·M + T_shaft − T_brake = I ω̇",
        "where these torques are measured, or known to be zero",
    )  # fmt: skip
    centre = (x + 1.6, y + 0.25)
    _wheel(axes, *centre, 0.85)
    _turn(axes, centre, 0.55, 130, 50, MOTION, "ω̇", (0.0, -0.25))
    _turn(axes, centre, 1.0, 95, 35, FORCE, "T_shaft", (0.45, 0.25))
    _turn(axes, centre, 1.0, 215, 155, FORCE, "n·M", (-0.35, 0.0))
    _turn(axes, centre, 1.0, 275, 335, FORCE, "T_brake", (0.5, -0.15))


def _turn(
    axes: Axes, centre: tuple[float, float], radius: float, start: float, stop: float, colour: str, text: str,
    offset: tuple[float, float],
) -> None:  # fmt: skip
    """An arc with an arrow head from `start` to `stop` [°], its name beside the middle."""

    def at(angle: float) -> tuple[float, float]:
        return centre[0] + radius * cos(radians(angle)), centre[1] + radius * sin(radians(angle))

    bend = tan(radians(start - stop) / 4)
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", at(stop), at(start), arrowprops={**style, "connectionstyle": f"arc3,rad={-bend:.4f}"})
    x, y = at((start + stop) / 2)
    axes.text(x + offset[0], y + offset[1], text, color=colour, fontsize=9, ha="center", va="center")
