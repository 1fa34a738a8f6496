"""Arrays on disk are those that were put there."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from lacet.daq.run import ChosenSignals, Run, Signal
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


def test_signals_on_disk_are_those_of_the_run(monkeypatch: pytest.MonkeyPatch):
    """A run whose values take more than may be held; and one that stays in memory, where the disk is full."""
    t = np.arange(5.0)
    signals = {
        "car.speed": Signal(t, RNG.standard_normal((5, 1)), np.array([0, 1, 0, 0, 2], np.uint8)),
        "imu.rate": Signal(t, RNG.standard_normal((5, 3)), np.zeros(5, np.uint8)),
    }
    run = Run("a", signals)
    assert run.on_disk() is run
    monkeypatch.setattr("lacet.daq.run.HELD", 100)
    stored = run.on_disk()
    assert list(stored.signals) == list(signals)
    for name, signal in signals.items():
        found = stored.signals[name]
        for one, other in ((found.t, signal.t), (found.values, signal.values), (found.flags, signal.flags)):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
    assert "imu.accel" not in stored.signals
    assert (stored.duration, stored.missing) == (run.duration, run.missing)

    def full(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("lacet.daq.set_aside.write_at", full)
    assert run.on_disk() is run


def test_chosen_signals_are_read_when_they_are_asked_for():
    class Unread(dict):
        def __getitem__(self, name: str) -> Signal:
            raise AssertionError(f"{name} was read")

    signal = Signal(np.zeros(1), np.zeros((1, 1)), np.zeros(1, np.uint8))
    chosen = ChosenSignals(Unread(a=signal, b=signal), ["a"], {"c": signal})
    assert list(chosen) == ["a", "c"]
    assert ("b" in chosen, len(chosen)) == (False, 2)
    assert chosen["c"] is signal
    with pytest.raises(KeyError):
        _ = chosen["b"]
    with pytest.raises(AssertionError, match="a was read"):
        _ = chosen["a"]


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
