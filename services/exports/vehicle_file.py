"""The vehicle file of an identified car: its geometry as it was, and what was identified as a-priori values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from lacet.daq.vehicle import Vehicle
from lacet.services.render.intervals import half_width


def vehicle_text(vehicle: Vehicle, result: Mapping[str, Any], title: str) -> str:
    """The text of a vehicle file that loads again, with the identified values in ``[apriori]``.

    A-priori values that were there and are not identified remain. So do those of the whole vehicle where the loads are
    ``hub`` loads: what is identified then lacks rims and tyres.
    """
    found = {p["name"]: (p, "" if p["group"] == p["name"] else f" ({p['group']})") for p in result["parameters"]}
    if result["wheel_reference"] != "hub":
        found |= {d["name"]: (d, "") for d in result.get("whole_vehicle") or () if d["identifiable"]}
    document = tomlkit.parse(vehicle.text)
    known = tomlkit.table()
    for name, old in vehicle.apriori.items():
        if name not in found:
            known[name] = _entry(value=old.value, unit=old.unit, source=old.source)
    for name, (one, group) in found.items():
        with_sheet, noise_only = half_width(one["half95_sheet"]), half_width(one["half95"])
        note = f"95 % interval with the sensor sheet ± {with_sheet}, noise only ± {noise_only}"
        known[name] = _entry(value=one["value"], unit=one["unit"], source=title + group, note=note)
    document["apriori"] = known
    return tomlkit.dumps(document)


def _entry(**fields: str | float) -> InlineTable:
    entry = tomlkit.inline_table()
    entry.update(fields)
    return entry
