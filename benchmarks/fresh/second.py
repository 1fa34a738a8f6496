"""Trials on the second car, whose wheels hang on linkages: a drive is driven with nothing, one law and two hidden.

The car is always the same, with right tables of its bench in the vehicle file; rig, runs, roads, noise and instruments'
errors are drawn for each drive, what is hidden for each trial.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np

from benchmarks.fresh.laws import LAWS, Part, drawn_parts
from benchmarks.fresh.making import ATTEMPTS, DRAWS, Drive, Trial, Unsized, sized, stream
from benchmarks.fresh.sizing import Array, Suspension
from lacet.daq.channels import CORNERS
from lacet.simulate import CarMotion, Manoeuvre, SimulationFailed
from lacet.simulate.linkage import SecondCar
from lacet.simulate.linkage.hidden_laws import POSSIBLE
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.truth import design_values

CAR = "second"
CLASSES = ("none", "single", "pair")
"""Of the trials of a drive, in turn."""
MECHANISM = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "axle_damping.rear", "damper_mount.front", "damper_mount.rear",
    "spring_quadratic.front", "spring_quadratic.rear", "spring_cubic.rear", "damper_stroke.front", "damper_stroke.rear",
)  # fmt: skip
"""What the mechanism has beyond the model's class, as the catalogue names it (``docs/benchmarks/second-car.md``)."""
SECOND_LAWS = tuple(
    replace(law, values=law.values if law.group in ("drag", "lift", "tyre damping", "tyre progression") else {})
    for law in LAWS
    if law.kind in POSSIBLE and not any(key.partition(".")[0] in law.families for key in MECHANISM)
)
"""Laws that can be hidden and are none of the mechanism's. Parameters of those along springs and dampers have no true
value at the wheel, as motion ratios change with the travel."""


def class_of(number: int) -> str:
    """Class of a trial."""
    return CLASSES[number % len(CLASSES)]


@cache
def suspensions() -> dict[str, Suspension]:
    """By the mechanism at its design height."""
    car = SecondCar.named(CAR)
    values = design_values(Mechanism(car))
    dampers = {damper.name: damper.damping for damper in car.linkage.dampers}

    def of_mechanism(s: Array, rate: Array, i: int) -> Array:
        return np.column_stack([s[:, i ^ 1], rate[:, i ^ 1], s[:, i] ** 2, s[:, i] ** 3, s[:, i] * rate[:, i]])

    out: dict[str, Suspension] = {}
    for i, corner in enumerate(CORNERS):
        spring, damper = (float(values.motion_ratio[f"{part}_{corner}"][i]) for part in ("spring", "damper"))
        damping = dampers[f"damper_{corner}"] * damper**2
        out[corner] = Suspension(float(values.wheel_rate[i, i]), damping, spring, damper, of_mechanism)
    return out


class SecondDrive(Drive):
    """The second car's runs; what has nothing hidden in the car is driven once."""

    def __init__(self, name: str, number: int, attempt: int):
        self.measured = ()
        self.suspensions = suspensions()
        self._still: dict[str, CarMotion] = {}
        rng = stream(name, number, CAR, "drive", attempt)
        self._draw(SecondCar.named(CAR), rng)
        self._roads = [int(seed) for seed in rng.integers(1, 2**31, len(self.used) + len(self.held))]

    def motions(self, runs: Mapping[str, Manoeuvre], parts: Sequence[Part]) -> dict[str, CarMotion]:
        if any(not part.hidden.of_sensor for part in parts):
            return super().motions(runs, parts)
        missing = {run: one for run, one in runs.items() if run not in self._still}
        self._still |= super().motions(missing, ())
        return {run: self._still[run] for run in runs}


@lru_cache(maxsize=1)
def drive_of(name: str, number: int, attempt: int) -> SecondDrive:
    """A drive, kept until another is asked for: its trials follow one another."""
    return SecondDrive(name, number, attempt)


class SecondTrial(Trial):
    """A trial on the second car."""

    @property
    def kind(self) -> str:
        """Its class."""
        return class_of(self.number)


def make(name: str, number: int) -> SecondTrial:
    """The trial of a number of a set: always the same one. Raises RuntimeError when no draw is possible."""
    for attempt in range(ATTEMPTS):
        drive = drive_of(name, number // len(CLASSES), attempt)
        for draw in range(DRAWS):
            rng = stream(name, number, CAR, "effects", attempt, draw)
            usual = bool(rng.random() < 0.5)
            parts = drawn_parts(class_of(number), rng, drive.tolerance, SECOND_LAWS)
            try:
                now, found, motions = sized(drive, parts, usual)
                held = drive.motions(drive.held, now)
            except (Unsized, SimulationFailed):
                continue
            return SecondTrial(
                name, number, attempt, drive.car, drive.rig, drive.used, drive.held, drive.measured, tuple(now),
                tuple(found), usual, {**motions, **held},
            )  # fmt: skip
    raise RuntimeError(f"trial {number} of {name}: no effects in {ATTEMPTS * DRAWS} draws")
