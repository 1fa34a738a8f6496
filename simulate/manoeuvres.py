"""Manoeuvres: the driver's inputs and the road of a simulated run."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

from lacet.daq.errors import UsageError, nearest
from lacet.simulate.cars import Car
from lacet.simulate.road import FLAT, Road, kerb_road, rough_road

KMH = 1.0 / 3.6


def ramp(t: float, length: float) -> float:
    """0 before 0, 1 after `length`, smooth between."""
    if t <= 0.0:
        return 0.0
    return 1.0 if t >= length else 0.5 - 0.5 * math.cos(math.pi * t / length)


@dataclass(frozen=True)
class Manoeuvre:
    """Straight ahead at constant speed on a flat road; base of all manoeuvres.

    `speed` [m/s] at the start and, in most manoeuvres, held; `duration` [s]; `gain` of the speed control [N·m per m/s];
    `torque_limit` of the drive [N·m]; `torque_lag` time constant of the drive torque [s].
    """

    name: ClassVar[str] = "straight"
    straight: ClassVar[bool] = True
    brakes: ClassVar[str] = "off"

    speed: float = 90.0 * KMH
    duration: float = 20.0
    gain: float = 1500.0
    torque_limit: float = 1500.0
    torque_lag: float = 0.2

    def steer(self, t: float) -> float:
        """Demanded steering angle about the kingpin [rad], left positive, without the driver's lane keeping."""
        return 0.0

    def target(self, t: float) -> float:
        """Set speed [m/s]."""
        return self.speed

    def drive(self, t: float, v: float) -> float:
        """Demanded torque on the driven axle [N·m]."""
        return max(-self.torque_limit, min(self.torque_limit, self.gain * (self.target(t) - v)))

    def brake(self, t: float, v: float) -> float:
        """Demanded deceleration by the brakes [m/s²]."""
        return 0.0

    @property
    def uneven(self) -> tuple[float, float]:
        """Brake torque of the left wheel less that of the right one ÷ their sum, front and rear."""
        return 0.0, 0.0

    def road(self, car: Car, seed: int, settle: float) -> Road:
        """The road, long enough for the run."""
        return FLAT


@dataclass(frozen=True)
class OnAnyRoad(Manoeuvre):
    """Base of manoeuvres on any road; `grade` : ISO 8608 class of the road (A, B or C), empty for a flat one.

    As on every road here the tracks vary along x alone: a car at an angle to the x axis meets the same waves stretched
    by 1/cos of the angle.
    """

    grade: str = ""

    def road(self, car: Car, seed: int, settle: float) -> Road:
        if not self.grade:
            return FLAT
        reach = self.speed * (self.duration + settle) * 1.05 + 60.0
        track = 0.5 * (car.front.track + car.rear.track)
        return rough_road(self.grade, -reach, 2.0 * reach, seed, track, car.tyre.contact_length)


@dataclass(frozen=True)
class Steering(OnAnyRoad):
    """Base of manoeuvres with steering."""

    straight: ClassVar[bool] = False


@dataclass(frozen=True)
class Sinus(Steering):
    """Sinus steering at constant speed: `amplitude` [rad] at the kingpin, `frequency` [Hz]."""

    name: ClassVar[str] = "sinus"
    amplitude: float = 0.025
    frequency: float = 0.5

    def steer(self, t: float) -> float:
        return self.amplitude * ramp(t, 1.0) * math.sin(2.0 * math.pi * self.frequency * t)


@dataclass(frozen=True)
class Sweep(Steering):
    """Chirp steering, frequency rising exponentially from `low` to `high` [Hz]."""

    name: ClassVar[str] = "sweep"
    amplitude: float = 0.015
    low: float = 0.2
    high: float = 3.0
    duration: float = 30.0

    def steer(self, t: float) -> float:
        if t <= 0.0:
            return 0.0
        rate = math.log(self.high / self.low) / self.duration
        phase = 2.0 * math.pi * self.low * math.expm1(rate * t) / rate
        return self.amplitude * ramp(t, 1.0) * math.sin(phase)


@dataclass(frozen=True)
class Spiral(Steering):
    """Steering that grows at constant speed, to `amplitude` [rad] at the end (negative: to the right)."""

    name: ClassVar[str] = "spiral"
    amplitude: float = 0.06
    speed: float = 60.0 * KMH
    duration: float = 30.0

    def steer(self, t: float) -> float:
        return self.amplitude * max(0.0, t) / self.duration


@dataclass(frozen=True)
class LiftOff(OnAnyRoad):
    """Straight ahead with periodic drive and sudden lift-off without braking.

    `drive_torque` and `overrun_torque` on the driven axle [N·m]; `drive_time`, `overrun_time` of each phase [s].
    """

    name: ClassVar[str] = "liftoff"
    drive_torque: float = 1100.0
    overrun_torque: float = -450.0
    drive_time: float = 2.0
    overrun_time: float = 3.0
    torque_lag: float = 0.06

    def drive(self, t: float, v: float) -> float:
        if t < 1.0:
            return super().drive(t, v)
        phase = (t - 1.0) % (self.drive_time + self.overrun_time)
        return self.drive_torque if phase < self.drive_time else self.overrun_torque


@dataclass(frozen=True)
class Braking(OnAnyRoad):
    """Straight-line braking: `deceleration` [m/s²] for `brake_time`, then back to speed within the `period` [s].

    `uneven_front`, `uneven_rear` : brake torque of the left wheel less that of the right one ÷ their sum.
    """

    name: ClassVar[str] = "braking"
    brakes: ClassVar[str] = "used"
    deceleration: float = 4.0
    brake_time: float = 1.5
    period: float = 5.0
    speed: float = 100.0 * KMH
    uneven_front: float = 0.0
    uneven_rear: float = 0.0

    @property
    def uneven(self) -> tuple[float, float]:
        """As the fields say."""
        return self.uneven_front, self.uneven_rear

    def _braking(self, t: float) -> bool:
        return t >= 1.0 and (t - 1.0) % self.period < self.brake_time

    def drive(self, t: float, v: float) -> float:
        return 0.0 if self._braking(t) else super().drive(t, v)

    def brake(self, t: float, v: float) -> float:
        if not self._braking(t) or v < 5.0:
            return 0.0
        phase = (t - 1.0) % self.period
        return self.deceleration * ramp(phase, 0.2) * ramp(self.brake_time - phase, 0.2)


@dataclass(frozen=True)
class Rough(Manoeuvre):
    """Straight ahead on a random road of ISO 8608 class `grade`; `road_seed` None: the run's seed."""

    name: ClassVar[str] = "rough"
    speed: float = 70.0 * KMH
    grade: str = "B"
    road_seed: int | None = None

    def road(self, car: Car, seed: int, settle: float) -> Road:
        length = self.speed * (self.duration + settle) * 1.05 + 60.0
        chosen = seed if self.road_seed is None else self.road_seed
        track = 0.5 * (car.front.track + car.rear.track)
        return rough_road(self.grade, 2.0, length, chosen, track, car.tyre.contact_length)


@dataclass(frozen=True)
class Kerb(Manoeuvre):
    """Straight ahead over smooth bumps on one side or alternating, which separate heave, pitch and roll."""

    name: ClassVar[str] = "kerb"
    speed: float = 40.0 * KMH
    height: float = 0.025
    length: float = 2.0
    spacing: float = 20.0
    side: str = "alternate"

    def road(self, car: Car, seed: int, settle: float) -> Road:
        length = self.speed * (self.duration + settle) * 1.05 + 30.0
        return kerb_road(2.0, length, self.height, self.length, self.spacing, self.side, car.tyre.contact_length)


MANOEUVRES: dict[str, type[Manoeuvre]] = {
    kind.name: kind for kind in (Manoeuvre, Sinus, Sweep, Spiral, LiftOff, Braking, Rough, Kerb)
}
"""Every manoeuvre by name."""


def make_manoeuvre(name: str, **settings: Any) -> Manoeuvre:
    """A manoeuvre by name with some of its fields set. Raises UsageError for an unknown name or field."""
    if name not in MANOEUVRES:
        raise UsageError(
            f"no manoeuvre is called '{name}'{nearest(name, MANOEUVRES) or '.'} Known: {', '.join(sorted(MANOEUVRES))}"
        )
    kind = MANOEUVRES[name]
    known = [field.name for field in dataclasses.fields(kind)]
    for key in settings:
        if key not in known:
            raise UsageError(
                f"manoeuvre '{name}' has no '{key}'{nearest(key, known) or '.'} It has: {', '.join(known)}"
            )
    return kind(**settings)
