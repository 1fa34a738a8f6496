"""Values that no car has, in words and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lacet.identify.validation.implausible_values import ImplausibleValue
from lacet.services.render.intervals import with_interval

_SHOWN = 4
"""Values that a sentence names."""


def implausible_result(found: Sequence[ImplausibleValue]) -> list[dict[str, Any]]:
    """The values as plain data (``docs/json.md``, ``identify``)."""
    return [
        {
            "name": one.name, "value": one.value, "unit": one.unit, "half95_sheet": one.half, "low": one.low,
            "high": one.high,
        }
        for one in found
    ]  # fmt: skip


def implausible_text(result: Mapping[str, Any]) -> str:
    """What to do about the values of a fit's result that no car has; an empty string where there are none."""
    found = result.get("implausible", [])
    if not found:
        return ""
    named = ", ".join(
        f"{one['name']} ({with_interval(one['value'], one['half95_sheet'])} {one['unit']})" for one in found[:_SHOWN]
    )
    more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    verb = "has a value" if len(found) == 1 else "have values"
    return (
        f"{named}{more} {verb} that no car has: a channel there may have the other sign, another unit or another place "
        "than stated (lacet info --rows: what each row is computed from), or an instrument a clock of its own "
        "(lacet check --only latency). Look at these before what the model lacks"
    )
