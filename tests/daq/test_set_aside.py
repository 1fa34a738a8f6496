"""Arrays on disk are those that were put there."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from lacet.daq.set_aside import DiskSpace, JoinedOnDisk
from lacet.identify.multibody.vectors import Array

RNG = np.random.default_rng(4)
FIRST = {"a": RNG.standard_normal((3, 5)), "none": np.zeros((0, 4)), "one": np.array(2.5)}
SECOND = {"a": RNG.standard_normal((3, 2)).T.copy().T, "b": RNG.standard_normal((2, 4))[:, ::2]}


def test_arrays_are_read_as_they_were_put():
    space = DiskSpace()
    stored = [space.put(FIRST), space.put(SECOND)]
    for found, given in zip(stored, (FIRST, SECOND), strict=True):
        assert list(found) == list(given)
        for key, array in given.items():
            assert found[key].shape == array.shape
            np.testing.assert_array_equal(found[key], array)


def test_a_stretch_is_read_alone():
    series = RNG.standard_normal(20)
    stored = DiskSpace().put_each([("first", np.zeros(3)), ("series", series)])
    np.testing.assert_array_equal(stored.stretch("series", 4, 11), series[4:11])
    assert stored.stretch("series", 20, 20).size == 0


def test_parts_are_joined_and_one_that_lacks_an_array_has_no_samples_of_it():
    space = DiskSpace()
    joined = JoinedOnDisk([space.put(FIRST), space.put(SECOND)])
    np.testing.assert_array_equal(joined["a"], np.concatenate([FIRST["a"], SECOND["a"]], axis=1))
    np.testing.assert_array_equal(joined["b"], SECOND["b"])
    assert list(joined) == ["a", "none", "one", "b"]
    with pytest.raises(KeyError):
        joined["c"]


def test_a_copy_has_a_file_of_its_own():
    space = DiskSpace()
    stored = space.put(SECOND)
    copy = pickle.loads(pickle.dumps(stored))
    other: dict[str, Array] = {"c": np.ones(3)}
    copy.space.put(other)
    space.put({"d": np.zeros(9)})
    for found in (stored, copy):
        np.testing.assert_array_equal(found["b"], SECOND["b"])
    assert pickle.loads(pickle.dumps(DiskSpace())).put(other)["c"].sum() == 3.0
