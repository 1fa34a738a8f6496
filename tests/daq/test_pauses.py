"""Pauses of a channel, whole or piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.pauses import LEAST, Stamps, alike, pauses
from lacet.services.render.pauses import pause_lines

T = 0.005 * np.arange(2000)


def without(*spans: tuple[float, float]) -> np.ndarray:
    """Stamps without those within these spans."""
    return T[~np.any([(a < T) & (b > T) for a, b in spans], axis=0)]


@pytest.mark.parametrize("cuts", [[1000], [1], [400, 401, 402, 700], [100, 200, 300], [*range(1, 300)]])
def test_pauses_are_found_whole_and_piece_by_piece(cuts: list[int]) -> None:
    t = without((1.0, 3.0), (5.0, 5.1))
    found = pauses(t)
    np.testing.assert_allclose(found, [(1.0, 3.0), (5.0, 5.1)])
    stamps = Stamps()
    for piece in np.split(t, cuts):
        stamps.add(piece)
    assert stamps.found == found


@pytest.mark.parametrize(("t", "many"), [
    (without((1.0, 1.0 + 0.7 * LEAST)), 0),  # interpolated
    (0.1 * np.arange(50), 0),  # a slow channel
    (np.r_[0.1 * np.arange(10), 1.3, 1.4], 1),
    (np.r_[0.1 * np.arange(10), 1.15, 1.25], 0),  # two of its samples are lost
    (np.zeros(0), 0), (np.zeros(1), 0),
])  # fmt: skip
def test_a_pause_is_long_beside_the_usual_period(t: np.ndarray, many: int) -> None:
    assert len(pauses(t)) == many


def test_channels_that_pause_together_are_told_once() -> None:
    spans = {"car.speed": [(1.0, 3.0)], "imu.rate": [(1.005, 3.0)], "gnss.speed": [(2.0, 3.0)], "imu.accel": []}
    assert list(alike(spans).values()) == [["car.speed", "imu.rate"], ["gnss.speed"]]
    assert pause_lines(spans) == [
        "no samples of car.speed, imu.rate from 1.00 to 3.00 s", "no samples of gnss.speed from 2.00 to 3.00 s",
    ]  # fmt: skip
    many = [(float(k), k + 0.5 + 0.01 * k) for k in range(5)]
    (line,) = pause_lines(dict.fromkeys("abcde", many))
    assert line.startswith("no samples of a, b, c and 2 more from 2.00 to 2.52 s, ")
    assert line.endswith(", and 2 shorter times")
