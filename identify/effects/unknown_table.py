"""What the bench table of an axle would say that has none: terms of the motion of its wheels, beside their slopes.

By a wheel's own travel s and that of the axle's other one, s', a joint is p s + ½ r s² + q s'. The slopes p are effects
of the catalogue (``jacking``, ``anti_dive``, ``camber_change``, ``toe_change``, ``pitch_change``); r and q are columns
beside these and no candidates: a car whose wheels are found to move needs a bench table, and not one term more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Self, TypeAlias

from lacet.daq.channels import other_corner
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect, sum_by_row
from lacet.identify.effects.suspension.centre_slopes import AntiDive, CentreSlope, Jacking
from lacet.identify.effects.suspension.pitch_change import PitchChange
from lacet.identify.effects.suspension.wheel_turn import CamberChange, ToeChange, WheelTurn
from lacet.identify.multibody.vectors import Array

TableSlope: TypeAlias = CentreSlope | WheelTurn | PitchChange
SLOPES: tuple[type[TableSlope], ...] = (Jacking, AntiDive, CamberChange, ToeChange, PitchChange)
REACH = 0.1
"""Travel in which a slope may change by its whole plausible range [m]. Source: a choice; suspensions have twice that
from stop to stop, and the half-track slope of wishbones changes by 0.4 in it."""


_PER_TRAVEL = {"-": "1/m", "rad/m": "rad/m²", "kg·m": "kg"}
"""Unit of a slope's parameter → that of its change per travel."""


class By(StrEnum):
    """What a term of a joint follows."""

    RISE = "rise"
    """Half the square of the wheel's own travel."""
    OTHER = "other"
    """The travel of the axle's other wheel."""


@dataclass(frozen=True)
class TableTerm(PhysicalEffect):
    """A term of a table that an axle lacks: of the joint of `slope`, by what it follows."""

    slope: TableSlope = field(kw_only=True)
    by: By = field(kw_only=True)

    name = "unknown_table"
    about = "a term of the bench table that the vehicle file lacks"
    signature = "suspension rows of an axle follow its wheels' loads × a travel"
    shown_by = "cornering, braking, rough road"
    source = "Milliken and Milliken (1995), Race Car Vehicle Dynamics, chapter 17"

    @cached_property
    def key(self) -> str:
        """Of the slope, and what it follows."""
        return f"{self.slope.name}_{self.by}.{self.where}"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """None: they are no candidates."""
        return []

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """r, by half the square of the travel, or q, by the other wheel's: m or rad per m², or per m."""
        named = [replace(one, name=f"{self.key}.{one.name.rpartition('.')[2]}") for one in self.slope.parameters]
        if self.by is By.OTHER:
            return tuple(named)
        return tuple(
            replace(one, unit=_PER_TRAVEL[one.unit], low=one.low / REACH, high=one.high / REACH) for one in named
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """Those of the slope, with what this term follows in the place of the travel."""
        return sum_by_row(self._of_corner(motion, c) for c in self.corners())

    def _of_corner(self, motion: Motion, corner: str) -> dict[str, Array]:
        if self.by is By.RISE:
            s, rate, accel = motion.corners[corner].travelled
            return self.slope.moved(motion, corner, corner, s, (0.5 * s**2, s * rate, rate**2 + s * accel))
        other = other_corner(corner)
        return self.slope.moved(motion, corner, other, 1.0, motion.corners[other].travelled)


def table_terms(axle: str) -> list[PhysicalEffect]:
    """The slopes and terms of the table of an axle."""
    slopes = [cls(axle) for cls in SLOPES]
    return [*slopes, *(TableTerm(axle, slope=slope, by=by) for slope in slopes for by in By)]
