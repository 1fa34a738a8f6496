"""Bench tables that are off in proportion: what the axle's tables say of one joint, all of it times 1 + p.

An error of the bench's own scale, which multiplies curves and products of both travels. A slope that is off by the same
at every travel is an effect of its own: ``jacking``, ``anti_dive``, ``camber_change``, ``toe_change``,
``pitch_change``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.channels import other_corner
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array, cross, dot, turn, unit


class BenchTable(PhysicalEffect):
    """The tables of an axle's wheels of one joint are p of themselves off."""

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle with bench tables."""
        first = {axle: vehicle.corners[corner] for axle, (corner, _) in AXLES.items()}
        return [cls(axle) for axle, corner in first.items() if corner.joints is not None or corner.table is not None]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the car's joint is beyond the table's, ÷ that."""
        return (self.named("p", "-", -1.0, 1.0),)

    @abstractmethod
    def work(self, corner: CornerMotion, dp: Array, dphi: Array) -> Array:
        """(N,) work of a wheel's load on its joint's part of these slopes (3, N) by a travel [N]."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−F·Δ∂p/∂s − M·Δ∂φ/∂s, in the rows of both travels that move a wheel."""
        out: dict[str, Array] = {}
        for c in self.corners():
            own, other = motion.corners[c], motion.corners[other_corner(c)]
            work = self.work(own, own.dp_ds, own.dphi_ds)
            if other.other_dp_ds is not None and other.other_dphi_ds is not None:
                work = work + self.work(other, other.other_dp_ds, other.other_dphi_ds)
            out[f"suspension.{c}"] = -work[None]
        return out


class _PlaceTable(BenchTable):
    """Wheel centres move along `direction` by p more of what the tables say, and their loads act there."""

    @abstractmethod
    def direction(self) -> Array:
        """(3, 1) unit vector, body axes."""

    def work(self, corner: CornerMotion, dp: Array, dphi: Array) -> Array:
        """Of the force along the direction."""
        along = self.direction()
        return np.sum(along * corner.force, axis=0) * np.sum(along * dp, axis=0)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The same, and −Δr × F in the chassis."""
        moment = np.zeros((3, motion.t.size))
        for c in self.corners():
            corner, along = motion.corners[c], self.direction()
            moment -= cross(along * np.sum(along * corner.shift, axis=0), corner.force)
        chassis = {f"chassis.m{axis}": moment[k][None] for k, axis in enumerate("xyz")}
        return super().columns(motion) | {row: column for row, column in chassis.items() if row in self.rows}


class HalfTrackTable(_PlaceTable):
    """The wheel centres of an axle move sideways by p more of what the tables say."""

    name = "half_track_table"
    about = "bench tables of the half track that are off in proportion"
    signature = "suspension rows of an axle follow side force × the table's slope"
    shown_by = "cornering: fast steering, lift-off in a turn"
    source = "Milliken and Milliken (1995), Race Car Vehicle Dynamics, chapter 17; Reimpell et al. (2001), section 3.4"
    rows = ("suspension", "chassis.mx", "chassis.mz")
    looks_like = ("jacking",)

    def direction(self) -> Array:
        """To the left."""
        return unit(1)


class HalfWheelbaseTable(_PlaceTable):
    """The wheel centres of an axle move along the car by p more of what the tables say."""

    name = "half_wheelbase_table"
    about = "bench tables of the half wheelbase that are off in proportion"
    signature = "suspension rows of an axle follow longitudinal force × the table's slope"
    shown_by = "braking and accelerating"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 7 (anti-squat and anti-pitch)"
    rows = ("suspension", "chassis.my", "chassis.mz")
    looks_like = ("anti_dive",)

    def direction(self) -> Array:
        """Forward."""
        return unit(0)


class _TurnTable(BenchTable):
    """The wheels of an axle turn about an axis by p more of what the tables say; the angles themselves are measured.

    The moment about the spin axis is left out: a bearing passes none, and what brake or engine pass is in the row.
    """

    rows = ("suspension",)

    @abstractmethod
    def part(self, corner: CornerMotion, dphi: Array) -> Array:
        """(3, N) the part of a rotation per travel that is of this joint."""

    def work(self, corner: CornerMotion, dp: Array, dphi: Array) -> Array:
        """Of the moment without its part about the spin axis."""
        moment = corner.moment - corner.spin_axis * dot(corner.moment, corner.spin_axis)
        return dot(moment, self.part(corner, dphi))


class CamberTable(_TurnTable):
    """The camber of an axle's wheels changes with both travels by p more of what the tables say."""

    name = "camber_table"
    about = "bench tables of the camber that are off in proportion"
    signature = "suspension rows of an axle follow the moment about the x axis × the table's slope"
    shown_by = "cornering: fast steering, lift-off in a turn"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.5; Dixon (2009), chapter 7"
    looks_like = ("camber_change",)

    def part(self, corner: CornerMotion, dphi: Array) -> Array:
        """About the wheel's x axis, which toe and pitch do not turn about."""
        axis = turn(2, corner.steer, unit(0))
        return axis * dot(axis, dphi)


class ToeTable(_TurnTable):
    """The toe of an axle's wheels changes with both travels by p more of what the tables say."""

    name = "toe_table"
    about = "bench tables of the toe that are off in proportion"
    signature = "suspension rows of an axle follow the self-aligning moment × the table's slope"
    shown_by = "cornering, braking: large moments about the vertical axis"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.6; Dixon (2009), chapter 6"
    looks_like = ("toe_change",)

    def part(self, corner: CornerMotion, dphi: Array) -> Array:
        """About z: what remains without camber and pitch, the latter about the spin axis."""
        level = turn(2, corner.steer, unit(1))
        pitch = dot(level, dphi) / dot(level, corner.spin_axis)
        return unit(2) * (dphi[2] - pitch * corner.spin_axis[2])
