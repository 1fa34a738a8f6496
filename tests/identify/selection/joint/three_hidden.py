"""A car that is exactly its model and three effects more: a bar, an asymmetric damper and a bump stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.signals.reconstruct import Recording
from tests.identify import cars
from tests.identify.exact_car import KNOWN, MODEL, exact, theta

KEYS = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear", "bump_stop.front", "bump_stop.rear",
    "spring_cubic.front", "spring_cubic.rear", "damper_asymmetry.front", "damper_knee.front", "damper_knee.rear",
    "tyre_damping.rear", "sensor_gain.hub.fl", "sensor_gain.hub.rr",
)  # fmt: skip
STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.0065, "n": 1.6})
HIDDEN = [(KNOWN["anti_roll_bar.front"], 6000.0), (KNOWN["damper_asymmetry.front"], -300.0)]
LAWS = [effect for effect, _ in HIDDEN]


def with_all(hidden: Sequence[tuple[Effect, float]]) -> Recording:
    """The exact drive of a car that is the model and these effects, with their sizes."""
    laws, sizes = zip(*hidden, strict=True)
    return cars.fulfil(exact(), (*MODEL.effects, *laws), np.append(theta(), sizes))
