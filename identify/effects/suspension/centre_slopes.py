"""Wheel centres that move with the travel otherwise than the bench table says: forces that lift the body."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Course, Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect, sum_by_row
from lacet.identify.multibody.vectors import Array, cross


class CentreSlope(PhysicalEffect):
    """Wheel centres of an axle move by p s along `direction` more than the table says.

    The force along it then does work on the travel that the suspension row lacks, and acts at another place than the
    table's, which the lasers do not see: its moment enters the chassis rows. The inertia of the axle itself, a tenth of
    the force, is neglected.
    """

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @abstractmethod
    def direction(self, corner: str) -> Array:
        """(3, 1) unit vector, body axes."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the table's slope p: m along the direction per m of compression."""
        return (self.named("p", "-", -0.5, 0.5),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−F·direction in the suspensions, −Δr × F in the chassis."""
        return sum_by_row(self.moved(motion, c, c, 1.0, motion.corners[c].travelled) for c in self.corners())

    def moved(self, motion: Motion, corner: str, by: str, slope: Array | float, shift: Course) -> dict[str, Array]:
        """Columns of one wheel that moves along the direction by `shift`, `slope` of it by the travel of `by`."""
        along, force = self.direction(corner), motion.corners[corner].force
        moment = -shift[0] * cross(along * np.ones_like(shift[0]), force)
        chassis = {f"chassis.m{axis}": moment[k][None] for k, axis in enumerate("xyz")}
        work = slope * np.sum(along * force, axis=0)
        return {f"suspension.{by}": -work[None]} | {row: one for row, one in chassis.items() if row in self.rows}


class AntiDive(CentreSlope):
    """The wheel centres of an axle move forward by p s more than the bench table says (anti-dive, anti-squat).

    Brakes and engines that react on the carrier or the body work through the table's pitch slope; its error, where only
    a steady part of it is seen, looks alike while braking.
    """

    name = "anti_dive"
    about = "longitudinal force transferred to the suspension (error of the table's half-wheelbase slope)"
    signature = "suspension rows of an axle follow the longitudinal force, the same left and right"
    shown_by = "braking and accelerating"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 7 (anti-squat and anti-pitch)"
    rows = ("suspension", "chassis.my", "chassis.mz")
    looks_like = ("half_wheelbase_table", "pitch_change")

    def direction(self, corner: str) -> Array:
        """Forward."""
        return np.array([[1.0], [0.0], [0.0]])


class Jacking(CentreSlope):
    """The wheel centres of an axle move outward by p s more than the bench table says.

    A contact force at the radius R below the wheel centre has the moment R F about x, so that a camber slope error of
    p/R looks the same in the suspension rows.
    """

    name = "jacking"
    about = "lateral force transferred to the suspension (error of the table's half-track slope)"
    signature = "suspension rows of an axle follow the lateral force, outward on both sides"
    shown_by = "cornering: fast steering, lift-off in a turn"
    source = "Milliken and Milliken (1995), Race Car Vehicle Dynamics, chapter 17; Reimpell et al. (2001), section 3.4"
    rows = ("suspension", "chassis.mx", "chassis.mz")
    looks_like = ("camber_change", "half_track_table")

    def direction(self, corner: str) -> Array:
        """Outward."""
        return np.array([[0.0], [1.0 if corner.endswith("l") else -1.0], [0.0]])
