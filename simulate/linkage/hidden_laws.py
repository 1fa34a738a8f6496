"""Hidden effects of a second car: where its parts, tyres and the air let laws of the first car act.

Laws of springs and stops act along a corner's spring, laws of dampers along its damper, between the ends of these (of a
damper beside its mount), with s the compression from the design position: that of the part, not of the wheel. What
lacet finds at the wheel is then this law by the part's motion ratio r, which changes with the travel: of size r² in a
linear law, with a gap 1/r as wide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.simulate.hidden import Hidden, SuspensionLaw, suspension_law

ALONG_SPRINGS = (
    "spring_quadratic", "spring_cubic", "bump_stop", "bump_stop_quadratic", "rebound_stop", "helper_spring",
)  # fmt: skip
ALONG_DAMPERS = (
    "coulomb", "damper_asymmetry", "damper_digressive", "damper_knee", "friction_of_load", "damper_stroke",
    "damper_groove",
)  # fmt: skip
OF_TYRES = ("tyre_progression", "tyre_damping", "rolling_resistance", "camber_thrust")
OF_AIR = ("aero_drag", "aero_lift", "aero_side")
POSSIBLE = (*ALONG_SPRINGS, *ALONG_DAMPERS, *OF_TYRES, *OF_AIR)
"""Kinds of mechanical effects that a second car can hide."""


def part_of(effect: Hidden, corner: str) -> str:
    """The spring or damper of a corner that a suspension law acts along."""
    return f"{'spring' if effect.effect in ALONG_SPRINGS else 'damper'}_{corner}"


def laws_of(hidden: Sequence[Hidden], car: str) -> Mapping[str, Sequence[SuspensionLaw]]:
    """Part → laws along it. Raises UsageError for an effect that the second `car` cannot hide; sensor faults pass."""
    out: dict[str, list[SuspensionLaw]] = {}
    for effect in hidden:
        if effect.of_sensor:
            continue
        if effect.effect not in POSSIBLE:
            raise UsageError(
                f"{effect.name}: the car '{car}' cannot hide it, as its wheels hang on linkages; it can hide "
                f"{', '.join(POSSIBLE)} and sensor faults"
            )
        law = suspension_law(effect)
        for corner in CORNERS:
            if law is not None and effect.at(corner):
                out.setdefault(part_of(effect, corner), []).append(law)
    return out
