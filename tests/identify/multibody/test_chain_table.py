"""Tables from a user's hand: what is refused, in words that say where."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.chain_base_parameters import base_parameters
from lacet.identify.multibody.chain_notes import ValuesUnused

ROWS: list[dict[str, Any]] = [{"j": 1}, {"j": 2, "ant": 1, "alpha": "pi/2"}, {"j": 3, "ant": 2, "d": "L"}]
Q = np.full((2, 3), 0.1)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"thetha": 1.0}, "row 2: there is no key 'thetha'; did you mean 'theta'"),
        ({"Alpha": 1.0}, "row 2: there is no key 'Alpha'; did you mean 'alpha'"),
        ({"D": 1.0}, "row 2: there is no key 'D'; did you mean 'd'"),
        ({"d": None}, "row 2: d must be a number or an expression, found None"),
        ({"d": [1.0]}, "row 2: d must be a number or an expression"),
        ({"d": float("nan")}, "row 2: d is nan"),
        ({"absent": 3}, "row 2: absent is 'all' or a list"),
    ],
)
def test_what_is_wrong_with_a_row(wrong: dict[str, Any], says: str) -> None:
    """The row, the key and what was found."""
    with pytest.raises(ValueError, match=says):
        Chain.from_table([ROWS[0], {**ROWS[1], **wrong}, ROWS[2]])


def test_columns_of_the_users_own_are_left_alone() -> None:
    """Only what looks like a slip is refused."""
    own = {"name": "link", "mu": 1, "id": 7, "mass": 2.0, "comment": "x", "joint": "elbow", "type": "R"}
    assert Chain.from_table([{**row, **own} for row in ROWS]).n == 3


def test_rows_values_and_parameters_that_are_no_numbers() -> None:
    """Each is named; a value without use is noted."""
    with pytest.raises(ValueError, match="row 1: a mapping"):
        Chain.from_table([1, 2])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="L must be a number, found 'x'"):
        Chain.from_table(ROWS, values={"L": "x"})  # type: ignore[dict-item]
    arm = Chain.from_table(ROWS, values={"L": 0.4, "Q": 1.0})
    assert arm.notes == (ValuesUnused(("Q",)),)
    with pytest.raises(ValueError, match="parameter M3 must be a number, found None"):
        arm.inverse_dynamics(Q, Q, Q, {"M3": None})  # type: ignore[dict-item]


def test_relations_name_their_angles_and_lengths() -> None:
    """Any fraction of π by its name, a length under a root as a length, and a relation within one body."""
    wrist = Chain.from_table(
        [{"j": 1}, {"j": 2, "ant": 1, "alpha": "-pi/2"}, {"j": 3, "ant": 2, "alpha": "pi/2", "d": "A", "r": "R"},
         {"j": 4, "ant": 3, "alpha": "pi/2", "d": "A"},
         {"j": 5, "ant": 4, "alpha": "-pi/2", "d": "-A", "r": "R + sqrt(A**2)/2"}],
        values={"A": 0.0825, "R": 0.316},
    )  # fmt: skip
    assert "MX4 - A*M5" in base_parameters(wrist).table()
    assert "0.08" not in base_parameters(wrist).table().rsplit("with", 1)[0]
    slide = base_parameters(Chain.from_table(
        [{"j": 1}, {"j": 2, "ant": 1, "sigma": 1, "alpha": "-pi/2", "theta": "pi/5"}]
    ))  # fmt: skip
    assert "MX2 - tan(pi/5)*MY2" in slide.table()
    tilted = base_parameters(Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, "alpha": "pi/7"}]))
    assert "sin(pi/7)**2*YY2" in tilted.table()
