"""Library of manoeuvres for planning: standard manoeuvres at several speeds and amplitudes, within limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY as G
from lacet.simulate import MANOEUVRES, Car, Manoeuvre, make_manoeuvre

KMH = 1.0 / 3.6
LOCK = 0.45
"""Largest steering angle about the kingpin [rad]."""


@dataclass(frozen=True)
class Limits:
    """Limits of what may be driven.

    `speed` [m/s], `lateral` and `braking` acceleration [m/s²], `duration` [s], `bump` height [m], `road` : the worst
    class of road available (A, B or C).
    """

    speed: float = 100.0 * KMH
    lateral: float = 0.5 * G
    braking: float = 0.5 * G
    duration: float = 30.0
    bump: float = 0.025
    road: str = "B"


@dataclass(frozen=True)
class Plan:
    """One manoeuvre of the library.

    `words` : speed and amplitude; `lateral` : lateral acceleration aimed at [m/s²] where the amplitude is a steering
    angle, which is reduced when the simulation exceeds the limit; the acceleration reached is printed.
    """

    manoeuvre: Manoeuvre
    words: str
    lateral: float | None = None

    @property
    def label(self) -> str:
        """Manoeuvre, speed and amplitude in words."""
        return self.label_at(self.lateral or 0.0)

    def label_at(self, lateral: float) -> str:
        """The label with the lateral acceleration reached [m/s²]."""
        return f"{self.manoeuvre.name} {self.words}" + (f", lateral {lateral:.1f} m/s²" if self.lateral else "")

    def made(self, **settings: Any) -> Plan:
        """The plan with some settings of the manoeuvre changed."""
        return dataclasses.replace(self, manoeuvre=dataclasses.replace(self.manoeuvre, **settings))


def kinds(only: Sequence[str] = (), without: Sequence[str] = ()) -> list[str]:
    """Names of the manoeuvres asked for. Raises UsageError for an unknown one, or when all are excluded."""
    for name in (*only, *without):
        if name not in MANOEUVRES:
            raise UsageError(
                f"no manoeuvre is called '{name}'{nearest(name, MANOEUVRES) or '.'} Known: {', '.join(MANOEUVRES)}"
            )
    chosen = [name for name in MANOEUVRES if (not only or name in only) and name not in without]
    if not chosen:
        raise UsageError("no manoeuvre remains to choose from: --only and --without exclude all")
    return chosen


def library(car: Car, limits: Limits, names: Sequence[str], duration: float) -> list[Plan]:
    """Manoeuvres of these names within the limits, each `duration` [s] long."""
    out = [plan.made(duration=duration) for name in names for plan in _VARIANTS[name](car, limits)]
    return list({plan.label: plan for plan in out}.values())


def steering(car: Car, lateral: float, speed: float) -> float:
    """Kingpin angle of the front wheels [rad] for a lateral acceleration [m/s²] in steady cornering, up to the lock."""
    understeer = (1.0 / car.front.cornering - 1.0 / car.rear.cornering) / car.gravity
    return min(LOCK, lateral * (car.wheelbase / speed**2 + max(understeer, 0.0)))


def _speeds(limits: Limits, *wanted: float) -> list[float]:
    """Speeds [km/h] within the limit, as m/s, without duplicates."""
    return list(dict.fromkeys(min(speed * KMH, limits.speed) for speed in wanted))


def _kmh(speed: float) -> str:
    return f"{speed / KMH:.0f} km/h"


def _straight(car: Car, limits: Limits) -> Iterator[Plan]:
    for speed in _speeds(limits, 90.0):
        yield Plan(make_manoeuvre("straight", speed=speed), f"at {_kmh(speed)}")


def _sinus(car: Car, limits: Limits) -> Iterator[Plan]:
    for speed in _speeds(limits, 50.0, 90.0):
        for lateral in (0.5 * limits.lateral, limits.lateral):
            made = make_manoeuvre("sinus", speed=speed, amplitude=steering(car, lateral, speed))
            yield Plan(made, f"at {_kmh(speed)}, 0.5 Hz", lateral)


def _sweep(car: Car, limits: Limits) -> Iterator[Plan]:
    for speed in _speeds(limits, 80.0):
        for lateral in (0.4 * limits.lateral, 0.8 * limits.lateral):
            made = make_manoeuvre("sweep", speed=speed, amplitude=steering(car, lateral, speed))
            yield Plan(made, f"at {_kmh(speed)}, 0.2 to 3 Hz", lateral)


def _spiral(car: Car, limits: Limits) -> Iterator[Plan]:
    for speed in _speeds(limits, 60.0):
        for sign, side in ((1.0, "left"), (-1.0, "right")):
            made = make_manoeuvre("spiral", speed=speed, amplitude=sign * steering(car, limits.lateral, speed))
            yield Plan(made, f"to the {side} at {_kmh(speed)}", limits.lateral)


def _liftoff(car: Car, limits: Limits) -> Iterator[Plan]:
    force = car.total.mass * car.front.radius
    for speed in _speeds(limits, 60.0, 100.0):
        made = make_manoeuvre("liftoff", speed=speed, drive_torque=2.0 * force, overrun_torque=-0.8 * force)
        yield Plan(made, f"at {_kmh(speed)}, 2 s at 2 m/s² then 3 s off, again and again")


def _braking(car: Car, limits: Limits) -> Iterator[Plan]:
    limit = 3.0 * car.total.mass * car.front.radius
    for speed in _speeds(limits, 60.0, 100.0):
        for brake in (0.5 * limits.braking, limits.braking):
            made = make_manoeuvre("braking", speed=speed, deceleration=brake, torque_limit=limit)
            yield Plan(made, f"from {_kmh(speed)} at {brake:.1f} m/s², 1.5 s every 5 s")


def _rough(car: Car, limits: Limits) -> Iterator[Plan]:
    for grade in "ABC"[: "ABC".index(limits.road) + 1][-2:]:
        for speed in _speeds(limits, 50.0, 80.0):
            yield Plan(
                make_manoeuvre("rough", speed=speed, grade=grade, road_seed=1), f"class {grade} at {_kmh(speed)}"
            )


def _kerb(car: Car, limits: Limits) -> Iterator[Plan]:
    for side, words in (("alternate", "left and right in turn"), ("both", "both sides at once")):
        for speed, length in zip(_speeds(limits, 20.0, 40.0), (1.0, 2.0), strict=False):
            spacing = 8.0 * speed * 0.3  # a bump every 2.4 s
            made = make_manoeuvre("kerb", speed=speed, height=limits.bump, length=length, spacing=spacing, side=side)
            words_ = (
                f"at {_kmh(speed)}, bumps {1e3 * limits.bump:.0f} mm high, {length:g} m long, every {spacing:.0f} m"
            )
            yield Plan(made, f"{words_}, {words}")


_VARIANTS = {
    "straight": _straight, "sinus": _sinus, "sweep": _sweep, "spiral": _spiral, "liftoff": _liftoff,
    "braking": _braking, "rough": _rough, "kerb": _kerb,
}  # fmt: skip


def check(limits: Limits) -> None:
    """Check of the limits. Raises UsageError for one that leaves nothing to drive."""
    for name, value, least, unit in (
        ("--max-speed", limits.speed / KMH, 15.0, "km/h"),
        ("--max-lateral", limits.lateral / G, 0.05, "g"),
        ("--max-braking", limits.braking / G, 0.05, "g"),
        ("--max-duration", limits.duration, 5.0, "s"),
        ("--max-bump", 1e3 * limits.bump, 1.0, "mm"),
    ):
        if not (math.isfinite(value) and value >= least):
            raise UsageError(f"{name} {value:g}: at least {least:g} {unit}")
