"""A car that is exactly its model and three effects more: a bar, an asymmetric damper and a bump stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from lacet.identify.effects.base import Effect
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.signals.reconstruct import Recording
from tests.identify.exact_car import KNOWN, exact_with_laws

KEYS = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear", "bump_stop.front", "bump_stop.rear",
    "spring_cubic.front", "spring_cubic.rear", "damper_asymmetry.front", "damper_knee.front", "damper_knee.rear",
    "tyre_damping.rear", "sensor_gain.hub.fl", "sensor_gain.hub.rr",
)  # fmt: skip
STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.0065, "n": 1.6})
HIDDEN = [(KNOWN["anti_roll_bar.front"], 6000.0), (KNOWN["damper_asymmetry.front"], -300.0)]
LAWS = [effect for effect, _ in HIDDEN]
WithFault = Callable[..., tuple[Fit, Joint]]
"""Keys of a sensor fault and of others → a fit with the fault beside what was found, and the others tested on it."""


def with_all(hidden: Sequence[tuple[Effect, float]]) -> Recording:
    """The exact drive of a car that is the model and these effects, with their sizes."""
    return exact_with_laws(hidden)
