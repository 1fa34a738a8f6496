"""Changes of shape constants as parameters: what is not known of a constant that was searched widens the intervals.

With ∂(W θ)/∂c as column of the change of a constant c, the covariance of [θ, c] is that of nonlinear least squares.
Source: G. A. F. Seber and C. J. Wild, Nonlinear Regression, Wiley, 1989, section 2.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array

_STEP = 0.02
"""Change of a constant for its derivative: part of its value, or of a tenth of its range where that is more. Small
enough for the derivative of a smooth law, and far above what rounding leaves."""


@dataclass(frozen=True)
class ConstantChange(PhysicalEffect):
    """What a change of one shape constant of an effect does at the effect's present size; its parameter is the change.

    Attributes
    ----------
    effect : the effect, with its constants.
    constant : name of the constant.
    values : (k,) present values of the effect's parameters.
    """

    name: ClassVar = "constant_change"

    effect: PhysicalEffect = field(kw_only=True)
    constant: str = field(kw_only=True)
    values: tuple[float, ...] = field(kw_only=True)

    @cached_property
    def key(self) -> str:
        """``family.where.constant``."""
        return f"{self.effect.key}.{self.constant}"

    @cached_property
    def constants(self) -> tuple[tuple[str, float], ...]:
        """The constants and the present values of the effect."""
        return (
            *self.effect.constants,
            *((q.name, v) for q, v in zip(self.effect.parameters, self.values, strict=True)),
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The change, at most the constant's whole range."""
        low, high = self.effect.bounds_of(self.constant)
        return (Parameter(self.key, self.effect.grid_units.get(self.constant, ""), low - high, high - low),)

    @property
    def conditional(self) -> bool:
        """As the effect's columns."""
        return self.effect.conditional

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[ConstantChange]:
        """None: it is made from an effect of a model."""
        return ()

    def columns(self, motion: Motion) -> dict[str, Array]:
        """Derivative of the effect's force by the constant, by central differences; one-sided at a bound."""
        low, high = self.effect.bounds_of(self.constant)
        at = self.effect.shape[self.constant]
        step = _STEP * max(abs(at), 0.1 * (high - low))
        less, more = max(low, at - step), min(high, at + step)
        before, after = (
            replace(self.effect, shape={**self.effect.shape, self.constant: value}).force(motion, np.array(self.values))
            for value in (less, more)
        )
        return {row: ((after[row] - before[row]) / (more - less))[None] for row in after}


def constant_changes(sizes: Sequence[tuple[PhysicalEffect, Array]]) -> list[ConstantChange]:
    """The changes of all shape constants that have a range, of effects with the values of their parameters."""
    return [
        ConstantChange(effect.where, effect=effect, constant=constant, values=tuple(map(float, own)))
        for effect, own in sizes
        for constant in effect.shape
        if constant in effect.grids and np.ptp(effect.bounds_of(constant)) > 0.0
    ]
