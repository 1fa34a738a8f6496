"""Payload or fuel that differs from run to run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Implausible, Parameter, PhysicalEffect
from lacet.identify.multibody.rigid_body import PARAMETERS, wrench_regressor
from lacet.identify.multibody.vectors import Array

_ON_THE_CAR = {"x": (-5.0, 1.5), "y": (-1.2, 1.2), "z": (-0.6, 2.0)}
"""Where a payload can be, from the body origin [m]: within the outline of a van, roof rack and tow ball included."""
_ROWS = ("chassis.fx", "chassis.fy", "chassis.fz", "chassis.mx", "chassis.my", "chassis.mz")


class Payload(PhysicalEffect):
    """A point mass on the body in one run and in no other: passengers, luggage, fuel used.

    Mass and first moments about the body origin are added to the chassis of the other runs, and the moments of inertia
    that these have to first order of the distance from a place `x` along the car, the middle between the axles where it
    is not searched.
    """

    name = "payload"
    about = "payload or fuel different in one run"
    signature = "chassis rows of one run follow its accelerations, the vertical force by a constant weight"
    shown_by = "runs with and without the payload; braking or steering shows where it sits"
    source = "Newton's law; Khalil and Dombre (2002), chapter 9"
    rows = ("chassis",)
    grids: ClassVar = {"x": (-3.0, -1.5, 0.0)}
    grid_units: ClassVar = {"x": "m"}
    bounds: ClassVar = {"x": _ON_THE_CAR["x"]}

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """None: a payload belongs to a run (`for_runs`)."""
        return ()

    @classmethod
    def for_runs(cls, runs: Sequence[str]) -> Sequence[Self]:
        """Each run, where there are two at least: against one run alone a payload is the chassis."""
        return [cls(run) for run in dict.fromkeys(runs)] if len(set(runs)) > 1 else ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass and first moments beyond those of the other runs."""
        return (
            self.named("m", "kg", -1500.0, 1500.0),
            self.named("mx", "kg·m", -4000.0, 4000.0),
            self.named("my", "kg·m", -1000.0, 1000.0),
            self.named("mz", "kg·m", -1500.0, 1500.0),
        )

    def implausible(self, values: Sequence[float] | Array, half: Sequence[float] | Array) -> Implausible | None:
        """What no payload has: a parameter outside its range, or a position that is not on the car.

        A first moment is the mass times its position: without a mass there is none.
        """
        mass, most = values[0], abs(values[0]) + half[0]
        for (axis, (low, high)), moment, slack in zip(_ON_THE_CAR.items(), values[1:], half[1:], strict=True):
            side = 0.0 if abs(mass) < half[0] else math.copysign(1.0, moment * mass)  # 0: the sign of the mass is open
            nearest = max(0.0, abs(moment) - slack)
            if nearest > most * max(high if side >= 0.0 else 0.0, -low if side <= 0.0 else 0.0):
                ends = (nearest / most, math.inf) if moment * mass > 0.0 else (-math.inf, -nearest / most)
                return Implausible(self.named(axis, "m", low, high), *ends)
        return super().implausible(values, half)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The columns of the chassis' mass and first moments, with their moments of inertia, in the one run."""
        if motion.name != self.where:
            return {}
        body = motion.body
        table = wrench_regressor(body.omega, body.omega_dot, body.accel)
        of = dict(zip(PARAMETERS, np.moveaxis(table, 1, 0), strict=True))
        x = self.shape.get("x", middle(motion))
        pitch_and_yaw = of["YY"] + of["ZZ"]  # m x² is 2 x₀ m x − x₀² m nearby, and −m x y is −x₀ m y
        columns = np.stack([
            of["M"] - x**2 * pitch_and_yaw, of["MX"] + 2.0 * x * pitch_and_yaw, of["MY"] - x * of["XY"],
            of["MZ"] - x * of["XZ"],
        ], axis=1)  # fmt: skip
        return {row: columns[k] for k, row in enumerate(_ROWS)}


def middle(motion: Motion) -> float:
    """Middle between the axles from the body origin, along the car [m]."""
    return float(np.mean([(corner.centre - corner.shift)[0, 0] for corner in motion.corners.values()]))
