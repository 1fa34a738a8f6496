"""What was known of a car before the runs, beside what these show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.daq.toml_reader import Quantity
from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.tables import Table


def beforehand_table(apriori: Mapping[str, Quantity], result: Mapping[str, Any]) -> Table | None:
    """Values of the vehicle file's ``[apriori]`` beside those of a fit; None where the fit has none of them.

    From hub loads the fit has the vehicle without what is outboard of the dynamometers: the difference is not that of
    the car, and is left open.
    """
    hub = result["wheel_reference"] == "hub"
    whole = {w["name"]: w for w in result["whole_vehicle"] or ()}
    found = {p["name"]: p for p in result["parameters"]} | {name: w for name, w in whole.items() if w["identifiable"]}
    rows = [
        [
            name, known.source, to_interval(known.value, found[name]["half95_sheet"]),
            to_interval(found[name]["value"], found[name]["half95_sheet"]),
            f"± {half_width(found[name]['half95_sheet'])}", known.unit,
            "-" if (hub and name in whole) or not known.value
            else f"{100.0 * (found[name]['value'] / known.value - 1.0):+.1f}",
        ]
        for name, known in apriori.items()
        if name in found
    ]  # fmt: skip
    beside = [name for name in apriori if hub and name in whole and name in found]
    note = f"  {', '.join(beside)}: a priori with wheels, found inboard of the dynamometers" if beside else ""
    head = ["known beforehand", "from", "a priori", "found", "95 % with sheet", "unit", "off %"]
    return Table(head, rows, text_columns=2, note=note) if rows else None
