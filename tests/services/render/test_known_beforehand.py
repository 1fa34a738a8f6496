"""What the vehicle file knows, beside what the runs show."""

from __future__ import annotations

from typing import Any

from lacet.daq.toml_reader import Quantity
from lacet.services.render.known_beforehand import beforehand_table

KNOWN = {
    "mass": Quantity(1500.0, "kg", "scales"),
    "spring.fl.k": Quantity(24000.0, "N/m", "drawing"),
    "spring.rr.k": Quantity(20000.0, "N/m", "drawing"),
}


def result(reference: str) -> dict[str, Any]:
    """A fit that shows one of the springs, and the mass."""
    one = {"unit": "N/m", "half95": 30.0, "half95_sheet": 240.0}
    mass = {"name": "mass", "value": 1530.0, "unit": "kg", "half95": 2.0, "half95_sheet": 6.0, "identifiable": True}
    parameters = [{"name": "spring.fl.k", "value": 25200.0, **one}]
    return {"wheel_reference": reference, "parameters": parameters, "whole_vehicle": [mass]}


def test_a_value_of_the_file_stands_beside_the_one_found() -> None:
    found = beforehand_table(KNOWN, result("contact"))
    assert found is not None
    assert found.rows == [
        ["mass", "scales", "1500.0", "1530.0", "± 6.0", "kg", "+2.0"],
        ["spring.fl.k", "drawing", "24000", "25200", "± 240", "N/m", "+5.0"],
    ]
    assert not found.note


def test_from_hub_loads_the_whole_vehicle_lacks_its_wheels() -> None:
    found = beforehand_table(KNOWN, result("hub"))
    assert found is not None
    assert found.rows[0] == ["mass", "scales", "1500.0", "1530.0", "± 6.0", "kg", "-"]
    assert found.rows[1][-1] == "+5.0"
    assert found.note == "  mass: a priori with wheels, found inboard of the dynamometers"


def test_where_nothing_is_known_there_is_no_table() -> None:
    assert beforehand_table({}, result("contact")) is None
    assert beforehand_table({"cog.x": KNOWN["mass"]}, result("hub")) is None
