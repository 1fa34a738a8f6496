"""Samples that came together, with one stamp: each is kept, and spread over the time since the one before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.shared_stamps import one_by_one, spread

T0 = 1_700_000_000 * 10**9
MS = 10**6


@pytest.mark.parametrize(("every", "period"), [(16, 10), (16, 1), (30, 10), (7, 10)])
def test_samples_that_came_together_are_spread_within_the_read_they_came_in(every: int, period: int):
    true = T0 + np.arange(500) * period * MS
    came = -(-true // (every * MS)) * (every * MS)
    stamps, moved = spread(came, 10.0 * MS)
    assert (np.diff(stamps) > 0).all()
    assert moved == len(came) - len(np.unique(came))
    assert (stamps <= came).all()
    assert np.abs(stamps - true).max() <= max(every, period) * MS


def test_behind_a_pause_they_lie_as_far_apart_as_usual():
    came = T0 + np.array([0, 0, 20, 20, 40, 40, 5000, 5000, 5000, 5020, 5020]) * MS
    stamps, moved = spread(came, 3.0 * MS)
    np.testing.assert_array_equal((stamps - T0) // MS, [-10, 0, 10, 20, 30, 40, 4980, 4990, 5000, 5010, 5020])
    assert moved == 6


def test_stamps_of_their_own_and_earlier_ones_are_as_they_were():
    own = T0 + np.array([0, 10, 20, 15, 30]) * MS
    assert spread(own, 10.0 * MS)[0] is own
    back = T0 + np.array([0, 10, 20, 15, 15, 30]) * MS
    np.testing.assert_array_equal(spread(back, 10.0 * MS)[0], back)
    np.testing.assert_array_equal(spread(np.full(3, T0), 10.0 * MS)[0], T0 + np.array([-20, -10, 0]) * MS)


def test_stamps_made_one_by_one_do_not_depend_on_where_they_are_cut():
    came = T0 + np.array([0, 0, 0, 1, 1, 5, 9, 9])
    whole = one_by_one(came)
    assert (np.diff(whole) > 0).all()
    assert (whole >= came).all()
    for cut in range(1, len(came)):
        first = one_by_one(came[:cut])
        np.testing.assert_array_equal(np.append(first, one_by_one(came[cut:], int(first[-1]))), whole)


def test_a_bus_log_of_an_adapter_that_stamps_a_transfer_is_imported_whole(tmp_path: Path):
    (tmp_path / "my.dbc").write_text('VERSION ""\nBO_ 256 A: 2 X\n SG_ Yaw : 0|16@1- (0.01,0) [0|0] "deg/s" X\n')
    true = np.arange(1600) * 0.01
    stamps = 1.7e9 + np.ceil(true / 0.016 - 1e-9) * 0.016
    lines = [f"({t:.6f}) can0 100#{k.to_bytes(2, 'little').hex()}\n" for k, t in enumerate(stamps)]
    (tmp_path / "a.log").write_text("".join(lines))
    map_ = ChannelMap.parse(
        'format = "lacet-map 1"\n[read]\ndbc = "my.dbc"\n[channels]\n"car.yaw_rate" = "Yaw"', "m", tmp_path
    )
    run = mapped_run([tmp_path / "a.log"], map_)
    signal = run.signals["car.yaw_rate"]
    np.testing.assert_allclose(np.rad2deg(signal.values[:, 0]), np.arange(1600) * 0.01)
    assert not any("does not increase" in line for line in run.problems)
