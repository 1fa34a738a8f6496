"""Formulae for a cause that is not in the catalogue: one-line laws of the measured states that the residual follows.

They are tested exactly as candidates are: nuisance parameters removed, gains cross-validated, p from the same simulated
runs. Such a law describes the residual and does not explain it; the engineer writes the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

_SIGN = "tanh(rate/v0)"
_BAND = ", v0 = 0.01 0.03 0.1 m/s"
SUSPENSION = (
    "p * travel**2", "p * travel**3", "p * travel*abs(travel)", "p * abs(travel)", "p * rate*abs(rate)",
    "p * rate**3", "p * abs(rate)", f"p * {_SIGN}{_BAND}", "p * travel*rate", "p * travel**2*rate",
    f"p * travel**2*{_SIGN}{_BAND}", f"p * abs(travel)*{_SIGN}{_BAND}", "p * accel", "p * accel*abs(travel)",
    "p * (travel - travel_other)", "p * (rate - rate_other)", "p * (travel - travel_other)**3",
    f"p * load*{_SIGN}{_BAND}", "p * fx", "p * fy", "p * ax", "p * ay", "p * ay**2", "p * abs(ay)", "p * ay*travel",
    "p * steer", "p * steer**2", "p * speed*travel", "p * speed*rate", "p * speed**2", "p * yaw_rate*speed",
    "p * roll_accel", "p * pitch_accel",
)  # fmt: skip
TYRE = (
    "p * deflection**2", "p * deflection**3", "p * deflection_rate", "p * deflection_rate*abs(deflection_rate)",
    "p * deflection*deflection_rate", "p * camber", "p * camber**2", "p * camber*deflection", "p * speed*deflection",
    "p * spin**2", "p * fy", "p * abs(fy)", "p * fx", "p * fy**2", "p * ay", "p * ax",
)  # fmt: skip
SPIN = ("p * spin", "p * spin**2", "p * load", "p * load*speed", "p * abs(fy)", "p * fx", "p * deflection_rate")
CHASSIS = (
    "p * speed*abs(speed)", "p * vy*speed", "p * vy*abs(vy)", "p * yaw_rate*speed", "p * ax", "p * ay", "p * az",
    "p * ax*abs(ax)", "p * ay*abs(ay)", "p * roll_rate", "p * pitch_rate", "p * yaw_rate", "p * roll_accel",
    "p * pitch_accel", "p * yaw_accel", "p * roll_rate*yaw_rate", "p * ax*ay",
)  # fmt: skip


@dataclass(frozen=True)
class Formula:
    """Simple law of the measured states that part of the residual follows.

    Attributes
    ----------
    text : the law as text for `lacet effect`.
    place : place of the variant that fits best.
    rows : rows it acts on.
    gain, gain_rms, p : as of a `Candidate`.
    """

    text: str
    place: str
    rows: tuple[Row, ...]
    gain: float
    gain_rms: float
    p: float


def propose(linearisation: Linearisation, failing: Sequence[Row], seed: int) -> list[Formula]:
    """Laws that the residual of the `failing` rows follows, largest gain first, one for each set of rows."""
    runs = linearisation.runs
    laws_by_name: dict[str, tuple[str, str]] = {}
    effects: list[Effect] = []
    for kind, laws in _places(failing):
        for number, law in enumerate(laws, start=1):
            name = f"own_{kind.replace('.', '_')}_{number}"
            laws_by_name[name] = kind, law.removesuffix(_BAND)
            effects += one_line_effects(f"{name} = {kind}: {law}", runs.vehicle, runs.wheel_reference)
    if not effects:
        return []
    space = ScoreTests.of(linearisation, effects, seed)
    found = [
        c
        for c in space.family_wise(space.try_all())
        if c.tested and c.p <= SELECTION.level(space.draws) and c.gain >= SELECTION.least_gain
    ]
    out: list[Formula] = []
    for c in sorted(found, key=lambda c: -c.total_gain):
        name, _, place = c.key.partition(".")
        kind, law = laws_by_name[name]
        constants = "".join(f", {constant} = {value:g} m/s" for constant, value in c.shape.items())
        text = f"{kind}{'.' if place else ''}{place}: {law}{constants}"
        if len(out) < SELECTION.most_laws and not any(one.rows == c.rows for one in out):
            out.append(Formula(text, place, c.rows, c.gain, c.gain_rms, c.p))
    return out


def _places(failing: Sequence[Row]) -> list[tuple[str, tuple[str, ...]]]:
    kinds = dict.fromkeys(row if row.kind == "chassis" else row.kind for row in failing)
    laws = {"suspension": SUSPENSION, "tyre": TYRE, "spin": SPIN}
    return [(kind, laws.get(kind, CHASSIS)) for kind in kinds]
