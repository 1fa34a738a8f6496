"""A row of the equations is a value: it equals its text, knows its parts and unit, and refuses what is no row."""

from __future__ import annotations

import json
import pickle

import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.identify.car.rows import (
    BODY_ROWS,
    CHASSIS_ROWS,
    CORNER_ROWS,
    ROWS,
    SPIN_ROWS,
    SUSPENSION_ROWS,
    TYRE_ROWS,
    Row,
)


def test_every_row_has_its_parts():
    """A kind and a place make the text; a corner where there is one; moments in N·m."""
    assert len(set(ROWS)) == len(ROWS) == 25
    for row in ROWS:
        assert isinstance(row, Row)
        assert row == f"{row.kind}.{row.place}"
        assert (row.corner is None) == (row in (*CHASSIS_ROWS, *BODY_ROWS))
    for kind, rows in (
        ("suspension", SUSPENSION_ROWS),
        ("tyre", TYRE_ROWS),
        ("spin", SPIN_ROWS),
        ("corner", CORNER_ROWS),
    ):
        assert [(row.kind, row.corner) for row in rows] == [(kind, corner) for corner in CORNERS]
    assert {row.kind for row in CHASSIS_ROWS} == {"chassis"}
    assert {row.kind for row in BODY_ROWS} == {"body"}
    moments = {"chassis.mx", "chassis.my", "chassis.mz", "spin.fl", "spin.fr", "spin.rl", "spin.rr"}
    moments |= {"body.roll", "body.pitch"}
    assert {row: row.unit for row in ROWS} == {row: "N·m" if row in moments else "N" for row in ROWS}


@pytest.mark.parametrize("row", ROWS)
def test_a_row_is_its_text(row: Row):
    """As a key of dictionaries, in JSON, in order, printed, and after pickling."""
    text = f"{row.kind}.{row.place}"
    assert {text: 1}[row] == {row: 1}[text] == 1
    assert (hash(row), str(row), f"{row:>14}", repr(row)) == (hash(text), text, f"{text:>14}", repr(text))
    assert json.dumps({row: row}) == json.dumps({text: text})
    back = pickle.loads(pickle.dumps(row))
    assert isinstance(back, Row)
    assert (back, back.unit) == (row, row.unit)
    assert sorted(ROWS) == sorted(map(str, ROWS))


@pytest.mark.parametrize("name", ["kind", "place", "corner", "unit", "about"])
def test_a_row_cannot_be_changed(name: str):
    with pytest.raises(AttributeError):
        setattr(ROWS[0], name, "fy")


def test_a_text_becomes_its_row():
    for row in ROWS:
        assert Row.parse(str(row)) is row
        assert Row.parse(row) is row


@pytest.mark.parametrize(
    ("text", "nearest"),
    [("suspensoin.fl", "suspension.fl"), ("chasis.fx", "chassis.fx"), ("tire.rr", "tyre.rr"), ("spin_fl", "spin.fl")],
)
def test_what_is_no_row_is_refused_with_the_nearest(text: str, nearest: str):
    with pytest.raises(UsageError, match=rf"no row '{text}'.*{nearest}"):
        Row.parse(text)


@pytest.mark.parametrize("text", ["", "suspension", "suspension.", "chassis.fl", "tyre.fx", "wheel.fl", "spin.fl.fl"])
def test_parts_alone_are_no_row(text: str):
    with pytest.raises(UsageError, match="no row"):
        Row.parse(text)
