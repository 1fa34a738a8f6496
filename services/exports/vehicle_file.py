"""The vehicle file of an identified car: its geometry as it was, and what was identified as a-priori values."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.vehicle import Vehicle
from lacet.services.render.intervals import half_width


def vehicle_text(vehicle: Vehicle, result: Mapping[str, Any], title: str) -> str:
    """The text of a vehicle file that loads again, with the identified values in ``[apriori]``.

    A-priori values that were there and are not identified remain. So do those of the whole vehicle where the loads are
    ``hub`` loads: what is identified then lacks rims and tyres.

    Raises UsageError when the vehicle's own text has a-priori values in another form than a table.
    """
    found = {p["name"]: (p, "" if p["group"] == p["name"] else f" ({p['group']})") for p in result["parameters"]}
    if result["wheel_reference"] != "hub":
        found |= {d["name"]: (d, "") for d in result.get("whole_vehicle") or () if d["identifiable"]}
    lines = [_without_apriori(vehicle.text).rstrip(), "", "[apriori]"]
    for name, old in vehicle.apriori.items():
        if name not in found:
            lines.append(_entry(name, value=old.value, unit=old.unit, source=old.source))
    for name, (one, group) in found.items():
        note = f"95 % interval ± {half_width(one['half95'])}, with the sensor sheet ± {half_width(one['half95_sheet'])}"
        lines.append(_entry(name, value=one["value"], unit=one["unit"], source=title + group, note=note))
    text = "\n".join(lines) + "\n"
    again = Vehicle.parse(text, "exported vehicle")
    if again.numbers != vehicle.numbers or set(again.apriori) != set(found) | set(vehicle.apriori):
        raise UsageError(
            f"the vehicle file of {vehicle.name} has a-priori values that cannot be replaced: write them as a table "
            "[apriori] of its own (docs/vehicle.md)"
        )
    return text


def _entry(key: str, **fields: Any) -> str:
    inside = ", ".join(f"{name} = {json.dumps(value, ensure_ascii=False)}" for name, value in fields.items())
    return f"{json.dumps(key)} = {{ {inside} }}"


def _without_apriori(text: str) -> str:
    kept, inside = list[str](), False
    for line in text.splitlines():
        if header := re.match(r"\s*\[\s*([^\]]+?)\s*\]\s*(#.*)?$", line):
            inside = header.group(1).strip("\"'") == "apriori"
        if not inside:
            kept.append(line)
    return "\n".join(kept)
