"""Candidates and a law of no catalogue, for the car that is exactly its model."""

from __future__ import annotations

from lacet.identify.effects.language.compiled import effect_class
from lacet.identify.effects.language.parser import read_line
from tests.identify.exact_car import KNOWN, VEHICLE

CANDIDATES = [
    KNOWN[key]
    for key in (
        "coulomb.front", "spring_quadratic.front", "spring_cubic.front", "damper_stroke.front",
        "damper_asymmetry.front", "damper_hysteresis.front", "damper_digressive.front", "anti_roll_bar.front",
        "damper_mount.front",
        "tyre_damping.rear", "sensor_gain.hub.fl",
    )
]  # fmt: skip
DRAWS = 39
LAW = "travel**2*tanh(rate/v0), v0 = 0.03 m/s"
HIDDEN = effect_class(read_line(f"hidden = suspension: p * {LAW}")).variants(VEHICLE, "hub")[0]
SIZE = 60000.0
"""Of the hidden law [N/m²]: some 30 N RMS where 6 N are noise."""
