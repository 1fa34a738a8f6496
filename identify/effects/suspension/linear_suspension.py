"""Springs, dampers and static offsets of the suspensions: the paper's table 2."""

from __future__ import annotations

from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class _PerCorner(SuspensionForce):
    """A suspension force each corner has its own parameter for."""

    base = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """One variant for each corner."""
        return [cls(corner) for corner in vehicle.corners]


class Spring(_PerCorner):
    """A linear spring: F = k s."""

    name = "spring"
    about = "linear suspension spring (wheel rate)"
    signature = "suspension row follows travel"
    shown_by = "any run with heave, pitch or roll"
    source = "paper, table 2"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Wheel rate k."""
        return (self.named("k", "N/m", 0.0, 2e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """s."""
        return travel


class Damper(_PerCorner):
    """A linear damper: F = c ṡ."""

    name = "damper"
    about = "linear suspension damper (wheel rate)"
    signature = "suspension row follows travel rate"
    shown_by = "rough road, fast steering"
    source = "paper, table 2"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping rate c."""
        return (self.named("c", "N·s/m", 0.0, 2e4, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """ṡ."""
        return rate


class Offset(_PerCorner):
    """The static load carried at design height."""

    name = "offset"
    about = "static suspension load at design height"
    signature = "suspension row is off by a constant"
    shown_by = "any run"
    source = "paper, table 2"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Static load F0."""
        return (self.named("f0", "N", 0.0, 5e4, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """1."""
        return np.ones_like(travel)
