"""Values of the base model that no car has: a channel is not as it is stated.

A travel with the other sign makes springs and dampers negative, an inertial unit turned round makes moments of inertia
negative, and without wheel loads the model may fit as well as before: nothing but the values shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lacet.identify.car.car_tree import AXLE, CHASSIS
from lacet.identify.effects.base import Parameter
from lacet.identify.multibody.rigid_body import NEVER_NEGATIVE
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import Estimate

_OF_BODY = frozenset(f"{kind}{CHASSIS}" for kind in NEVER_NEGATIVE)
"""Mass and moments of inertia of the car's body. The small ones of wheels and carriers are negative as well where the
model lacks something."""


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
    of_beams = _first_moments_of_beams(fitted)
    own = {q.name for effect in fitted.model.effects if effect.base for q in effect.parameters}
    out: list[ImplausibleValue] = []
    for e in found:
        if not e.identifiable or e.name not in own or e.name not in heads or e.name in of_beams:
            continue
        k = heads[e.name]
        members = [(1.0, parameters[int(base.independent[k])])]
        members += [(float(f), parameters[int(i)]) for f, i in zip(base.relations[k], base.dependent, strict=True) if f]
        low, high = (sum(ends) for ends in zip(*(_range(*member) for member in members), strict=True))
        if _is_never_negative(e.name) and e.name not in _OF_BODY:
            continue
        if e.value + e.half_sheet < low or e.value - e.half_sheet > high:
            out.append(ImplausibleValue(e.name, e.unit, e.value, e.half_sheet, low, high))
    return out


def _first_moments_of_beams(fitted: Fit) -> set[str]:
    """First moments of the carriers of axles whose wheels move together: half of a beam reaches far inboard of its
    wheel, and how far no range says that holds for other carriers."""
    corners = fitted.runs[0].recording.vehicle.corners.items()
    return {f"{kind}{AXLE[name]}" for name, corner in corners if corner.follows_other for kind in ("MX", "MY", "MZ")}


def _is_never_negative(name: str) -> bool:
    """Whether a parameter is a mass or a moment of inertia of a body."""
    return name.rstrip("0123456789") in NEVER_NEGATIVE


def _range(factor: float, parameter: Parameter) -> tuple[float, float]:
    """Plausible range of a factor times a parameter."""
    low = 0.0 if _is_never_negative(parameter.name) else parameter.low
    ends = factor * low, factor * parameter.high
    return min(ends), max(ends)
