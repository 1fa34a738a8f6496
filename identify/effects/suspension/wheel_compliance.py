"""Compliance that the bench tables lack: wheel centres and carriers that give under the loads of the tyres."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from lacet.daq.channels import other_corner
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect, sum_by_row
from lacet.identify.effects.suspension.pitched_carrier import pitched_loads
from lacet.identify.multibody.vectors import Array, cross, dot, unit

_MICRO = 1e-6
"""Of the units µm/N and µrad/N: a column per m/N would be a million times as large as others, which rounding hides."""
_FIRM = 0.1
"""Part of a tyre's mean deflection below which its stiffness is not read from load ÷ deflection [-]."""


class _WheelCompliance(PhysicalEffect):
    """Wheel centres of an axle shift by c (F + o F') along a direction, F and F' the forces along it on both tyres.

    o is 0 for wheels by themselves, 1 for an axle that shifts as a whole. The moment of the force at the other place
    enters the chassis rows, and the tyre deflects by what the shift moves the wheel towards the road, at the stiffness
    that load ÷ deflection says. Of axles with bench tables: without them the wheels' paths are unknown by more.
    """

    grids: ClassVar = {"other": (0.0, 1.0)}
    grid_units: ClassVar = {"other": ""}

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle with bench tables."""
        first = {axle: vehicle.corners[corner] for axle, (corner, _) in AXLES.items()}
        return [cls(axle) for axle, corner in first.items() if corner.joints is not None or corner.table is not None]

    @abstractmethod
    def direction(self) -> Array:
        """(3, 1) unit vector, body axes."""

    def along(self, motion: Motion, c: str) -> Array:
        """(N,) force along the direction that shifts a wheel [N]."""
        own, other = (np.sum(self.direction() * motion.corners[k].force, axis=0) for k in (c, other_corner(c)))
        return own + self.shape.get("other", 0.0) * other

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−Δr × F in the chassis, −kt Δr·e in the tyres, for Δr = F along the direction."""
        out: dict[str, Array] = {}
        for c in self.corners():
            corner = motion.corners[c]
            shift = _MICRO * self.direction() * self.along(motion, c)
            _add(out, "chassis.m", -cross(shift, corner.force))
            out[f"tyre.{c}"] = -(_stiffness(corner) * dot(shift, corner.normal))[None]
        return {row: column for row, column in out.items() if row in self.rows or row.partition(".")[0] in self.rows}


def _add(out: dict[str, Array], rows: str, vector: Array) -> None:
    """Add a vector (3, N) to the columns of three chassis rows, ``chassis.f`` or ``chassis.m``."""
    for axis, column in zip("xyz", vector, strict=True):
        out[rows + axis] = out.get(rows + axis, np.zeros((1, column.size))) + column


def _stiffness(corner: CornerMotion) -> Array:
    """(N,) load ÷ deflection of a tyre [N/m], 0 where it hardly deflects."""
    firm = corner.deflection > _FIRM * np.mean(corner.deflection)
    return np.where(firm, dot(corner.force, corner.normal) / np.where(firm, corner.deflection, 1.0), 0.0)


class LateralCompliance(_WheelCompliance):
    """The wheel centres of an axle shift sideways under side force more than the bench's compliance says."""

    name = "lateral_compliance"
    about = "wheel centres that shift sideways under side force more than the bench tables say"
    signature = "tyre rows of an axle follow side force × roll, chassis.mx side force × load"
    shown_by = "cornering with roll: fast steering, spiral"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.6 (elastokinematics); Blundell and Harty (2015)"
    rows = ("tyre", "chassis.mx", "chassis.mz")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Shift c per force."""
        return (self.named("c", "µm/N", -5.0, 5.0, "positive"),)

    def direction(self) -> Array:
        """To the left."""
        return unit(1)


class LongitudinalCompliance(_WheelCompliance):
    """The wheel centres of an axle shift along the car, and their carriers pitch, more than the compliance says.

    A carrier that pitches by ψ = p F_x about the wheel's axis n turns the load that is measured in its axes: by ψ n × F
    and ψ n × M, which all rows then lack.
    """

    name = "longitudinal_compliance"
    about = "wheels that shift along the car and carriers that pitch under longitudinal force more than the tables say"
    signature = "chassis.fx and .fz and suspension rows of an axle follow longitudinal force × load"
    shown_by = "accelerating and lift-off, braking, kerbs"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.6 (elastokinematics); Blundell and Harty (2015)"
    rows = ("tyre", "suspension", "chassis")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Shift c and pitch p (nose down) per force forwards."""
        return (self.named("c", "µm/N", -5.0, 5.0, "positive"), self.named("p", "µrad/N", -30.0, 30.0))

    def direction(self) -> Array:
        """Forwards."""
        return unit(0)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """Of the shift as above, without work on the travel; of the pitch −F_x times what it turns the loads by."""
        shift = super().columns(motion)
        turns = (pitched_loads(motion, c, _MICRO * self.along(motion, c)) for c in self.corners())
        pitch = sum_by_row(turns)
        zero = np.zeros((1, motion.t.size))
        rows = dict.fromkeys([*shift, *pitch])
        return {row: np.concatenate([shift.get(row, zero), pitch.get(row, zero)]) for row in rows}
