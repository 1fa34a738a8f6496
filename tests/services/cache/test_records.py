"""Values become records and are the same again; nothing but lacet's data classes is made of a record."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from lacet.identify.car.rows import ROWS, Row
from lacet.identify.validation.prediction_uncertainty import Knowledge, OpenParameters
from lacet.identify.validation.score import RowScore
from lacet.identify.validation.whiteness import Colour
from lacet.services.cache.records import Record, RecordError, from_record, to_record

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary()
    | st.sampled_from(ROWS) | st.sampled_from(Colour)
    | npst.arrays(st.sampled_from([np.float64, np.float32, np.int64, np.bool_]), npst.array_shapes(min_dims=0)),
    lambda inner: st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(st.text() | st.integers(), inner),
    max_leaves=12,
)  # fmt: skip


def again(value: object) -> Any:
    """A value through JSON and back."""
    record = to_record(value)
    return from_record(Record(json.loads(json.dumps(record.tree)), record.arrays))


def same(a: Any, b: Any) -> bool:
    """Whether two values are of the same types and equal, NaN included."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


@given(PLAIN)
def test_any_value_is_the_same_again(value: object) -> None:
    assert same(again(value), value)


def test_data_classes_rows_and_sets() -> None:
    why = OpenParameters(("k",), ("r",))
    score = RowScore(Row.parse("spin.fl"), "N·m", 1.0, 2.0, 3.0, 4.0, 0.25, Colour.TOO_SHORT, 0.5, 0.5, 2.0, why=why)
    assert again({Row.parse("spin.fl"): score}) == {Row.parse("spin.fl"): score}
    assert type(next(iter(again({Row.parse("spin.fl"): 1})))) is Row
    assert again(frozenset({"a", "b"})) == {"a", "b"}
    known = again(Knowledge(("k",), ("r",), np.eye(1)))
    assert known.names == ("k",)
    np.testing.assert_array_equal(known.covariance, np.eye(1))


class Stranger:
    """No class of lacet."""


@pytest.mark.parametrize("value", [Stranger(), object(), np.array([object()]), len, {1: Stranger()}])
def test_what_is_not_understood_is_refused(value: object) -> None:
    with pytest.raises(RecordError):
        to_record(value)


@pytest.mark.parametrize(
    "tree",
    [
        {"$": "data", "class": "os:system", "fields": {}},
        {"$": "data", "class": "lacet.services.cache.store:Store", "fields": {"study": "x"}},
        {"$": "data", "class": "lacet.services.cache.store:os", "fields": {}},
        {"$": "data", "class": "lacet.identify.validation.score:RowScore.__init__", "fields": {}},
        {"$": "data", "class": "lacet.identify.validation.score:RowScore", "fields": {"gone": 1}},
        {"$": "data", "class": "lacet.gone:Gone", "fields": {}},
        {"$": "enum", "class": "lacet.identify.validation.score:RowScore", "name": "x"},
        {"$": "array", "place": 3},
        {"$": "row", "text": "no row"},
        {"$": "code"},
        {"no": "kind"},
    ],
)
def test_a_strange_record_is_refused(tree: Any) -> None:
    with pytest.raises(RecordError):
        from_record(Record(tree, []))
