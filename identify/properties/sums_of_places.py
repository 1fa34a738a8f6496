"""Sums over places: a law that acts at several places of the car, of which runs determine only the sum of its sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.effects.base import Effect, PhysicalEffect
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import WIDE
from lacet.identify.validation.prediction_uncertainty import Knowledge

_MUCH = 2.0
"""Interval of a member ÷ that of the sum from which the runs know the sum better than the split [ratio]. Source: a
choice, not tuned; on smooth runs without wheel loads it is 5 to 20 for anti-roll bars, on a rough road below 1."""


@dataclass(frozen=True)
class SumOfPlaces:
    """Sum of the one parameter of a law over the places at which a model has it.

    Attributes
    ----------
    keys : keys of the effects, one a place; `parameter` the last name of their parameter, in `unit`.
    value, half : the sum, and half of its 95 % interval with the sensor sheet.
    widest : half of the widest 95 % interval, with sheet, of the members' own values.
    inseparable : whether the runs show that there is a sum, and leave open how it is split among the places; at the
        shape constants of the fit, which the members have in common.
    """

    keys: tuple[str, ...]
    parameter: str
    unit: str
    value: float
    half: float
    widest: float
    inseparable: bool

    @property
    def name(self) -> str:
        """``family.sum.parameter``."""
        return f"{self.keys[0].partition('.')[0]}.sum.{self.parameter}"

    @property
    def members(self) -> tuple[str, ...]:
        """Names of the parameters that are summed."""
        return tuple(f"{key}.{self.parameter}" for key in self.keys)

    @property
    def determined(self) -> bool:
        """Whether the sum is known to a quarter (`WIDE`), as derived values are."""
        return self.half <= WIDE * abs(self.value)


def same_law_elsewhere(one: Effect, other: Effect) -> bool:
    """Whether two effects are one law of one parameter, with the same constants, at places that do not overlap."""
    mine, theirs = set(one.corners()) - {""}, set(other.corners()) - {""}
    return (
        one.name == other.name and one.as_physics is not None and not (one.base or other.base)
        and len(one.parameters) == 1 and one.constants == other.constants
        and len(mine) == len(theirs) > 0 and not mine & theirs
    )  # fmt: skip


def sums_of_places(fitted: Fit, knowledge: Knowledge) -> list[SumOfPlaces]:
    """The sum of every law beyond the base model that a fit has at several places, with what is known of it."""
    names, size = list(knowledge.names), len(knowledge.names)
    searched, sheet = fitted.covariances_searched
    at_constants = knowledge.covariance + fitted.covariance_sheet[:size, :size]
    covariance = knowledge.covariance + (searched - fitted.covariance + sheet)[:size, :size]
    out: list[SumOfPlaces] = []
    for members in _groups(fitted.model.physics):
        at = [names.index(one.parameters[0].name) for one in members]
        parameter, value = members[0].parameters[0], float(np.sum(fitted.theta[at]))
        half, widest = _halves(at_constants[np.ix_(at, at)])
        inseparable = widest > max(WIDE * abs(value), _MUCH * half) and half < abs(value)
        out.append(
            SumOfPlaces(
                tuple(one.key for one in members), parameter.name.rsplit(".", 1)[-1], parameter.unit, value,
                *_halves(covariance[np.ix_(at, at)]), inseparable,
            )
        )  # fmt: skip
    return out


def _halves(covariance: Array) -> tuple[float, float]:
    """Halves of the 95 % interval of a sum, and of the widest of its terms."""
    total, widest = max(0.0, float(np.sum(covariance))), float(np.max(np.diag(covariance)))
    return TWO_SIDED_95 * float(np.sqrt(total)), TWO_SIDED_95 * float(np.sqrt(widest))


def _groups(effects: Sequence[PhysicalEffect]) -> list[list[PhysicalEffect]]:
    """Effects of one law, each at another place; those that stand alone are left out."""
    out: list[list[PhysicalEffect]] = []
    for one in effects:
        own = next((group for group in out if all(same_law_elsewhere(other, one) for other in group)), None)
        if own is None:
            out.append([one])
        else:
            own.append(one)
    return [group for group in out if len(group) > 1]
