"""The scale of a fit without wheel loads in words: what determines it, and how strongly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from lacet.identify.properties.known_scale import KnownScale


def scale_result(scale: KnownScale | None) -> dict[str, Any] | None:
    """The scale as plain data (``docs/json.md``, ``identify``)."""
    if scale is None:
        return None
    disturbed = scale.disturbed if math.isfinite(scale.disturbed) else None
    return {"known": list(scale.known), "disturbed": disturbed, "weak": scale.weak, "says": _says(scale)}


def weak_scale(result: Mapping[str, Any]) -> str:
    """What a fit's result says of a scale that is hardly known; an empty string where it is known well."""
    scale = result.get("known_scale")
    return str(scale["says"]) if scale and scale["weak"] else ""


def weak_because(scale: KnownScale) -> str:
    """Why a scale is weak."""
    known = " and ".join(scale.known)
    if not scale.related:
        return f"these runs do not relate any spring or damper to {known}"
    return f"noise and what else is assumed may be {_part(scale)} of what {known} does in these runs"


def _part(scale: KnownScale) -> str:
    return f"{100.0 * min(1.0, scale.disturbed):.2g} %"


def _says(scale: KnownScale) -> str:
    known = " and ".join(scale.known)
    if not scale.weak:
        return f"{known} sets the scale of all values; noise and what else is assumed make about {_part(scale)} of it"
    others = "" if "sprung_mass" in scale.known else ", or give sprung_mass"
    return (
        f"the scale of all values, sizes of effects included, is hardly known: {weak_because(scale)}. "
        "All may be too small by one common factor; their ratios do not depend on it. Add a run that moves the car "
        f"more, as on a rough road{others}"
    )
