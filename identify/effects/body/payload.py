"""Payload or fuel that differs from run to run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.rigid_body import PARAMETERS, wrench_regressor
from lacet.identify.multibody.vectors import Array

_NAMES = ("M", "MX", "MY", "MZ")
_ROWS = ("chassis.fx", "chassis.fy", "chassis.fz", "chassis.mx", "chassis.my", "chassis.mz")


class Payload(PhysicalEffect):
    """A point mass on the body in one run and in no other: passengers, luggage, fuel used.

    The chassis is what it is on the other runs; the mass and its first moments about the body origin are added (its
    inertia about itself is not). Springs and tyres need nothing: travel and loads are measured.
    """

    name = "payload"
    about = "payload or fuel different in one run"
    signature = "chassis rows of one run follow its accelerations, the vertical force by a constant weight"
    shown_by = "runs with and without the payload; braking or steering shows where it sits"
    source = "Newton's law; Khalil and Dombre (2002), chapter 9"
    rows = ("chassis",)

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

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The columns of the chassis' mass and first moments, in the one run."""
        if motion.name != self.where:
            return {}
        body = motion.body
        table = wrench_regressor(body.omega, body.omega_dot, body.accel)
        places = [PARAMETERS.index(name) for name in _NAMES]
        return {row: table[k, places] for k, row in enumerate(_ROWS)}
