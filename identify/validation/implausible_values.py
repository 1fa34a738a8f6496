"""Values of the base model that no car has: a channel is not as it is stated.

A travel with the other sign makes springs and dampers negative, an inertial unit turned round makes moments of inertia
negative, and without wheel loads the model may fit as well as before: nothing but the values shows it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lacet.identify.car.car_tree import CHASSIS
from lacet.identify.effects.base import Parameter
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import Estimate

_POSITIVE = re.compile(r"(XX|YY|ZZ|M)\d+")
"""Names of moments of inertia about a body's own axes, and of masses."""
_OF_BODY = frozenset(f"{kind}{CHASSIS}" for kind in ("XX", "YY", "ZZ", "M"))
"""Those of the car's body. The small ones of wheels and carriers are negative as well where the model lacks something.
"""


@dataclass(frozen=True)
class ImplausibleValue:
    """An estimate whose 95 % interval, tolerances of the sensors included, is outside what is plausible on any car.

    Attributes
    ----------
    name, unit : of the parameter.
    value, half : its estimate, and half of that interval [`unit`].
    low, high : the plausible range of what it stands for, alone or as the head of a group [`unit`].
    """

    name: str
    unit: str
    value: float
    half: float
    low: float
    high: float


def implausible_values(fitted: Fit, found: Sequence[Estimate]) -> list[ImplausibleValue]:
    """Implausible estimates of the base model; `found` : the estimates of this fit.

    What is beyond the base model a ranking judges.
    """
    base, parameters = fitted.base, fitted.model.parameters
    heads = {parameters[int(i)].name: k for k, i in enumerate(base.independent)}
    own = {q.name for effect in fitted.model.effects if effect.base for q in effect.parameters}
    out: list[ImplausibleValue] = []
    for e in found:
        if not e.identifiable or e.name not in own or e.name not in heads:
            continue
        k = heads[e.name]
        members = [(1.0, parameters[int(base.independent[k])])]
        members += [(float(f), parameters[int(i)]) for f, i in zip(base.relations[k], base.dependent, strict=True) if f]
        low, high = (sum(ends) for ends in zip(*(_range(*member) for member in members), strict=True))
        if _POSITIVE.fullmatch(e.name) and e.name not in _OF_BODY:
            continue
        if e.value + e.half_sheet < low or e.value - e.half_sheet > high:
            out.append(ImplausibleValue(e.name, e.unit, e.value, e.half_sheet, low, high))
    return out


def _range(factor: float, parameter: Parameter) -> tuple[float, float]:
    """Plausible range of a factor times a parameter."""
    low = 0.0 if _POSITIVE.fullmatch(parameter.name) else parameter.low
    ends = factor * low, factor * parameter.high
    return min(ends), max(ends)
