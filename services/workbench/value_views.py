"""View of the car in numbers: derived values by place, and the parameters of a version against those of another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.daq.formats.result import plain
from lacet.services.render.effect_text import effect_label
from lacet.services.render.terms import TERMS
from lacet.services.render.units import TRAVEL, TRAVEL_RATE, unit_text
from lacet.services.render.value_names import derived_name, parameter_name, summed
from lacet.services.workspace.study import Study

_PLACES = (*CORNERS, "front", "rear")


def values_payload(study: Study, number: int | None, against: int | None) -> dict[str, Any]:
    """Derived values and parameters of a version; `against` : another one, whose values stand beside."""
    version = study.version(number)
    result = version.result
    other = study.version(against).result if against is not None else {}
    others = {kind: _by_name(other.get(kind)) for kind in ("derived", "parameters")}
    apriori = study.vehicle.apriori
    return plain(
        {
            "version": version.number,
            "against": against,
            "derived": [
                {**_derived(d), **beside(d, others["derived"].get(d["name"]))} for d in result.get("derived", [])
            ],
            "parameters": [
                {
                    **_named(p),
                    "sum": summed(p, version.effects),
                    "apriori": apriori[p["name"]].value if p["name"] in apriori else None,
                    **beside(p, others["parameters"].get(p["name"])),
                }
                for p in result["parameters"]
            ],
            "gone": [_named(p) for p in _gone(other, result)],
            "dampers": _dampers(result.get("damper_curves", {})),
        }
    )


def _derived(found: Mapping[str, Any]) -> dict[str, Any]:
    label, symbol = derived_name(found["name"])
    place = found["name"].rpartition(".")[2]
    return {
        "name": found["name"], "kind": found["name"].removesuffix(f".{place}"), "label": label, "symbol": symbol,
        "place": place if place in _PLACES else "car", "value": found["value"], "unit": unit_text(found["unit"]),
        "half95": found["half95"], "half95_sheet": found.get("half95_sheet"), "determined": found["identifiable"],
        "none": found["identifiable"] and found["value"] == 0.0, "why": found["why"], "term": _term(found["name"]),
    }  # fmt: skip


def _term(name: str) -> str | None:
    """The term that explains a derived value; None where there is none."""
    return next((part for part in (name, name.rpartition(".")[0]) if part in TERMS), None)


def _named(found: Mapping[str, Any]) -> dict[str, Any]:
    label, symbol = parameter_name(found["name"], found["effect"])
    return {
        "name": found["name"], "label": label, "symbol": symbol, "effect": effect_label(found["effect"]),
        "value": found["value"], "unit": unit_text(found["unit"]), "half95": found["half95"],
        "half95_sheet": found["half95_sheet"], "group": found["group"] if found["group"] != found["name"] else "",
    }  # fmt: skip


def beside(found: Mapping[str, Any], other: Mapping[str, Any] | None) -> dict[str, Any]:
    """The value of another version, its `change` since [%], and whether the two differ by more than noise explains.

    What the sensor sheet leaves open moves both versions alike: their difference is judged without it.
    """
    if other is None or not found.get("identifiable", True) or not other.get("identifiable", True):
        return {"other": None, "differs": None, "change": None}
    moved = found["value"] - other["value"]
    noise = math.hypot(found["half95"], other["half95"])
    return {
        "other": {"value": other["value"], "half95": other["half95"], "half95_sheet": other.get("half95_sheet")},
        "differs": abs(moved) > noise,
        "change": 100.0 * moved / abs(other["value"]) if other["value"] else None,
    }


def _by_name(found: Any) -> dict[str, Mapping[str, Any]]:
    return {one["name"]: one for one in found or []}


def _gone(other: Mapping[str, Any], result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Parameters that only the other version has."""
    here = _by_name(result["parameters"])
    return [p for p in other.get("parameters", []) if p["name"] not in here]


def _dampers(curves: Mapping[str, Any]) -> dict[str, Any]:
    """Damper curves in the units engineers read."""
    (travel, travel_unit), (rate, rate_unit) = TRAVEL, TRAVEL_RATE
    return {
        corner: {
            "travel": travel * c["travel"], "travel_unit": travel_unit, "rate": [rate * v for v in c["rate"]],
            "rate_unit": rate_unit, "force": c["force"],
            "low": [f - h for f, h in zip(c["force"], c["half95"], strict=True)],
            "high": [f + h for f, h in zip(c["force"], c["half95"], strict=True)],
        }
        for corner, c in curves.items()
    }  # fmt: skip
