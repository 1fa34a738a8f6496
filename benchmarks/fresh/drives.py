"""The runs of a trial: four used and one held out, with amplitudes, speeds and roads drawn anew."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lacet.simulate import Car, Manoeuvre
from lacet.simulate.manoeuvres import KMH, Braking, Kerb, LiftOff, Rough, Sinus, Spiral, Sweep
from lacet.simulate.road import Road

DURATION = (12.0, 16.0)
"""Duration of a run [s]."""


@dataclass(frozen=True)
class ScaledRough(Rough):
    """A rough road of heights `scale` times those of its class."""

    scale: float = 1.0

    def road(self, car: Car, seed: int, settle: float) -> Road:
        return scaled(super().road(car, seed, settle), self.scale)


@dataclass(frozen=True)
class RoughSinus(Sinus):
    """Sinus steering on a rough road of heights `scale` times those of its class."""

    name: ClassVar[str] = "rough-sinus"
    grade: str = "B"
    scale: float = 1.0

    def road(self, car: Car, seed: int, settle: float) -> Road:
        return scaled(super().road(car, seed, settle), self.scale)


def scaled(road: Road, scale: float) -> Road:
    """A road of heights so many times another's."""
    return replace(road, left=scale * road.left, right=scale * road.right)


def steering_for(car: Car, speed: float, lateral: float) -> float:
    """Kingpin angle [rad] of a steady turn with this lateral acceleration [m/s²], by the one-track model."""
    understeer = (1.0 / car.front.cornering - 1.0 / car.rear.cornering) / car.gravity
    return lateral * (car.wheelbase / speed**2 + understeer)


def drawn_drives(car: Car, rng: np.random.Generator) -> tuple[dict[str, Manoeuvre], dict[str, Manoeuvre]]:
    """Runs used and held out, by name."""

    def between(low: float, high: float) -> float:
        return float(f"{rng.uniform(low, high):.5g}")

    def lasting() -> float:
        return between(*DURATION)

    def speed(low: float, high: float) -> float:
        return between(low, high) * KMH

    def sinus() -> Manoeuvre:
        v = speed(70, 105)
        amplitude, frequency, scale = steering_for(car, v, between(3.5, 5.5)), between(0.35, 0.7), between(0.2, 0.6)
        if rng.random() < 0.5:
            return Sinus(v, lasting(), amplitude=amplitude, frequency=frequency)
        return RoughSinus(v, lasting(), amplitude=amplitude, frequency=frequency, scale=scale)

    def sweep() -> Manoeuvre:
        v = speed(70, 100)
        amplitude = steering_for(car, v, between(2.0, 3.5))
        return Sweep(v, lasting(), amplitude=amplitude, low=between(0.15, 0.3), high=between(2.0, 3.5))

    def spiral() -> Manoeuvre:
        v = speed(55, 80)
        side = 1.0 if rng.random() < 0.5 else -1.0
        return Spiral(v, lasting(), amplitude=side * steering_for(car, v, between(4.5, 6.0)))

    def liftoff() -> Manoeuvre:
        return LiftOff(
            speed(75, 110), lasting(), drive_torque=between(900, 1300), overrun_torque=-between(350, 550),
            drive_time=between(1.7, 2.4), overrun_time=between(2.0, 3.2),
        )  # fmt: skip

    def braking() -> Manoeuvre:
        return Braking(
            speed(85, 115), lasting(), deceleration=between(3.0, 5.0), brake_time=between(1.2, 1.8),
            period=between(4.2, 5.5),
        )  # fmt: skip

    def rough() -> Manoeuvre:
        return ScaledRough(speed(50, 90), lasting(), scale=between(0.7, 1.8))

    def kerb() -> Manoeuvre:
        return Kerb(
            speed(30, 50), lasting(), height=between(0.015, 0.03), length=between(1.5, 2.5), spacing=between(15, 25)
        )

    used = [sinus(), braking(), rough()]
    others = [sweep, spiral, liftoff, kerb]
    order = rng.permutation(len(others))
    used.append(others[int(order[0])]())
    held = others[int(order[1])]()
    return {one.name: one for one in used}, {held.name: held}
