"""Longitudinal forces that lift the body: errors of the bench table's half-wheelbase slope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from daq.vehicle import Vehicle
from identify.effect import AXLES, Effect, Parameter
from identify.motion import Motion
from identify.vectors import Array


class AntiDive(Effect):
    """The wheel centres of an axle move forward by p s more than the bench table says (anti-dive, anti-squat).

    The longitudinal force then does work on the travel that the suspension row lacks, F_x p, and acts at a wheel centre
    that is p s farther forward: moments about y and z. Brakes and engines that react on the carrier or the body work
    through the table's pitch slope; its error, where only a steady part of it is seen, looks alike while braking.
    """

    name = "anti_dive"
    about = "longitudinal force transferred to the suspension (error of the table's half-wheelbase slope)"
    signature = "suspension rows of an axle follow the longitudinal force, the same left and right"
    shown_by = "braking and accelerating"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 7 (anti-squat and anti-pitch)"
    rows = ("suspension", "chassis.my", "chassis.mz")

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Both axles."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the slope of the half wheelbase p: m forward per m of compression."""
        return (self.named("p", "-", -0.5, 0.5),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−F_x in the suspensions, −Δr × F in the chassis."""
        out: dict[str, Array] = {}
        moment = np.zeros((2, motion.t.size))
        for c in self.corners():
            corner = motion.corners[c]
            out[f"suspension.{c}"] = -corner.force[0][None]
            moment += corner.travel * np.stack([corner.force[2], -corner.force[1]])
        return out | {"chassis.my": moment[:1], "chassis.mz": moment[1:]}
