"""What a picture shows of a dense series: no peak is lost, and no more is kept than can be seen."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.services.render.figures.envelope import MOST_A_COLUMN, block_extremes, envelope_places, thinned

COLUMNS = 200


def columns_of(x: np.ndarray) -> np.ndarray:
    """The column of each sample, found another way: by its edges."""
    return np.clip(np.searchsorted(np.linspace(x[0], x[-1], COLUMNS + 1), x, "right") - 1, 0, COLUMNS - 1)


@pytest.mark.parametrize("seed", range(5))
def test_every_column_keeps_its_extremes(seed: int):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.5, 1.5, 20_000))
    y = rng.standard_normal(x.size).cumsum()
    y[rng.integers(x.size, size=20)] += 500.0  # single peaks
    kept = envelope_places(x, y, COLUMNS)
    assert kept.size <= 4 * COLUMNS + 2
    assert np.all(np.diff(kept) > 0)
    column = columns_of(x)
    for number in range(COLUMNS):
        own, seen = y[column == number], y[kept][column[kept] == number]
        assert (seen.min(), seen.max()) == (own.min(), own.max())


def test_a_series_that_is_not_dense_is_kept_whole():
    x = np.arange(MOST_A_COLUMN * COLUMNS, dtype=float)
    np.testing.assert_array_equal(envelope_places(x, np.sin(x), COLUMNS), np.arange(x.size))


def test_a_hole_remains_one():
    x = np.arange(20_000.0)
    y = np.sin(x)
    y[5_000:7_000] = np.nan
    kept = envelope_places(x, y, COLUMNS)
    assert np.isnan(y[kept][(kept >= 5_000) & (kept < 7_000)]).all()
    assert np.isfinite(y[kept][(kept < 5_000) | (kept >= 7_000)]).all()
    single = np.where(x == 10_050, np.nan, np.sin(x))
    around = single[envelope_places(x, single, COLUMNS)]
    assert np.count_nonzero(np.isnan(around)) == 1


@pytest.mark.parametrize("size", [1, 31, 32, 33, 1000])
def test_extremes_of_blocks_are_those_of_their_samples(size: int):
    values = np.random.default_rng(size).standard_normal(size).astype(np.float32)
    values[values > 2.0] = np.nan
    values[320:352] = np.nan
    lowest, highest = block_extremes(values, 32)
    blocks = [values[k : k + 32] for k in range(0, size, 32)]
    finite = [b[np.isfinite(b)] for b in blocks]
    np.testing.assert_array_equal(lowest, [b.min() if b.size else np.nan for b in finite])
    np.testing.assert_array_equal(highest, [b.max() if b.size else np.nan for b in finite])


def test_of_a_cloud_each_lonely_dot_is_kept():
    rng = np.random.default_rng(1)
    x, y = np.append(rng.uniform(0, 100, 30_000), 900.0), np.append(rng.uniform(0, 100, 30_000), 900.0)
    kept = thinned(x, y, 1.0, 800)
    assert kept.size <= 800
    assert x.size - 1 in kept
    corners = [(x[kept] - a) ** 2 + (y[kept] - b) ** 2 for a in (0.0, 100.0) for b in (0.0, 100.0)]
    assert max(float(d.min()) for d in corners) < 10.0**2
