"""Channels that are slower than their table: empty cells between samples are no lost samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal, signal_of
from lacet.daq.vehicle import Vehicle
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_level import measured_noise
from lacet.identify.signals.own_rate import at_own_rate, sample_rate
from lacet.identify.signals.reconstruct import bring_together
from tests.support.tables import CAR, piece

RIG = Rig.load(CAR / "rig.toml")
VEHICLE = Vehicle.load(CAR / "vehicle.toml")
SLOW = {"laser": 2, "camera": 5}
"""Start of a channel's name → rows of the table for each of its samples."""


def series(n: int = 1000) -> Signal:
    """A laser at 250 Hz."""
    return signal_of(
        "laser.fl.hub", np.arange(n, dtype=np.float64) / 250.0, np.random.default_rng(1).normal(size=(n, 1))
    )


def emptied(signal: Signal, filled: np.ndarray) -> Signal:
    """The signal with a value at some samples only."""
    values = np.where(filled[:, None], signal.values, np.nan)
    return signal_of("laser.fl.hub", signal.t, values)


def slower(run: Run, own_stamps: bool) -> Run:
    """The run with slower lasers and cameras: with stamps of their own, or empty cells."""
    signals = dict(run.signals)
    for name, s in run.signals.items():
        every = SLOW.get(name.split(".")[0], 1)
        filled = np.arange(len(s.t)) % every == 0
        if own_stamps:
            signals[name] = Signal(s.t[filled], s.values[filled], s.flags[filled])
        elif every > 1:
            signals[name] = signal_of(name, s.t, np.where(filled[:, None], s.values, np.nan))
    return replace(run, signals=signals)


@pytest.mark.parametrize("every", [2.0, 2.5, 5.0])
def test_cells_that_are_empty_in_turn_are_no_samples(every: float) -> None:
    whole = series()
    filled = np.zeros(1000, bool)
    filled[np.floor(np.arange(0, 999, every)).astype(int)] = True
    found = at_own_rate(emptied(whole, filled))
    np.testing.assert_array_equal(found.t, whole.t[filled])
    assert found.usable.all()
    assert sample_rate(found) == pytest.approx(250.0 / every, rel=0.01)


def test_the_fastest_channel_of_a_table_with_the_stamps_of_all_keeps_its_losses() -> None:
    """Rows at which a slower instrument alone was sampled are none of its own; 20 lost samples are."""
    own, other = np.arange(0, 2000, 2), np.arange(0, 2000, 5)
    stamps = np.union1d(own, other)
    values = np.where(np.isin(stamps, own), 1.0, np.nan)
    found = at_own_rate(signal_of("laser.fl.hub", stamps / 1000.0, values[:, None]))
    np.testing.assert_allclose(found.t, own / 1000.0)
    values[np.flatnonzero(np.isin(stamps, own))[50:70]] = np.nan
    found = at_own_rate(signal_of("laser.fl.hub", stamps / 1000.0, values[:, None]))
    np.testing.assert_allclose(found.t, np.delete(own, np.s_[50:70]) / 1000.0)


def test_a_slower_channel_keeps_its_losses_and_flags() -> None:
    whole = series()
    filled = np.arange(1000) % 2 == 0
    filled[300:400] = False
    signal = emptied(whole, filled)
    signal.flags[600] = Flag.STUCK
    found = at_own_rate(signal)
    assert np.max(np.diff(found.t)) == pytest.approx(0.408)
    assert np.count_nonzero(~found.usable) == 1
    assert sample_rate(found) == pytest.approx(125.0, rel=0.01)


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6])
def test_cells_that_are_empty_by_chance_are_lost_samples(part: float) -> None:
    filled = np.random.default_rng(2).random(1000) >= part
    filled[[0, -1]] = True
    signal = emptied(series(), filled)
    assert at_own_rate(signal) is signal
    # Beside what is as long as a pause, and not interpolated.
    assert sample_rate(signal) == pytest.approx(250.0 * np.mean(filled), rel=0.01 + 0.2 * part)


def test_the_rate_of_a_whole_signal_is_that_of_its_stamps() -> None:
    signal = series()
    assert at_own_rate(signal) is signal
    assert sample_rate(signal) == 999 / float(np.ptp(signal.t))


def test_a_pause_makes_no_channel_slower() -> None:
    filled = np.ones(1000, bool)
    filled[200:700] = False
    assert sample_rate(emptied(series(), filled)) == pytest.approx(250.0, rel=0.01)
    whole = series()
    without_rows = Signal(whole.t[filled], whole.values[filled], whole.flags[filled])
    assert sample_rate(without_rows) == pytest.approx(250.0, rel=0.01)


def test_a_table_with_empty_cells_is_as_channels_at_their_own_rates() -> None:
    apart, table = (bring_together(slower(piece(), own), VEHICLE, RIG, Filters()) for own in (True, False))
    assert table.rates == pytest.approx(dict(apart.rates), rel=1e-6)
    assert table.rates["laser.fl.hub"] == pytest.approx(0.5 * table.rates["wheel.fl.force"], rel=0.01)
    for name, values in apart.signals.value.items():
        np.testing.assert_allclose(table.signals.value[name], values)
        assert table.usable[name].all()


def test_the_noise_of_a_slower_channel_is_measured_at_its_own_rate() -> None:
    """So that its sheet is right with and without empty cells."""
    found = [
        {one.family: one.sigma for one in measured_noise([slower(piece(), own)], RIG) if one.sigma is not None}
        for own in (True, False)
    ]
    assert found[1]["laser.hub"] == pytest.approx(found[0]["laser.hub"])
