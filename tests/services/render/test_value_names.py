"""Names of values: what the value of an added effect is the sum of."""

from __future__ import annotations

import pytest

from lacet.services.render.value_names import summed


@pytest.mark.parametrize(
    ("name", "effect", "group", "shown"),
    [
        ("aero_lift.rear.l", "aero_lift.rear", "aero_lift.rear.l + aero_lift.front.l", True),
        ("aero_lift.rear.l", "aero_lift.rear", "aero_lift.rear.l", False),
        ("ZZ6", "body.6", "ZZ6 + 2 MX9", False),
    ],
    ids=["a sum over places", "alone", "a base parameter"],
)
def test_a_value_of_an_added_effect_that_is_a_sum_is_shown_as_one(name: str, effect: str, group: str, shown: bool):
    found = {"name": name, "effect": effect, "group": group}
    assert summed(found, {"aero_lift.rear": {}}) == (group if shown else "")
