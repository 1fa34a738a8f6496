"""Ridge regressions in cross-validation, against the same regressions by solving each on the other folds' samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from lacet.identify.multibody.vectors import Array
from lacet.identify.validation.cross_validation import FOLDS, RIDGE, FoldSums, Stretch, best, missed

RNG = np.random.default_rng(2)
COLUMNS = RNG.standard_normal((120, 7))
TARGETS = np.column_stack([
    COLUMNS[:, :3] @ [1.0, -2.0, 0.5] + 0.3 * RNG.standard_normal(120),
    RNG.standard_normal(120),
    COLUMNS[:, 6] + 0.01 * RNG.standard_normal(120),
])  # fmt: skip
BLOCKS = np.repeat(np.arange(12), 10)


def _stretches() -> Iterator[Stretch]:
    """Stretches that end within blocks."""
    for start, stop in ((0, 37), (37, 41), (41, 120)):
        yield Stretch(COLUMNS[start:stop], TARGETS[start:stop], BLOCKS[start:stop])


def _solved(columns: Array, ridge: float, target: int) -> Array:
    """(12,) squares missed of each block by a regression on the other folds."""
    out = np.zeros(12)
    for fold in range(FOLDS):
        test = fold == BLOCKS % FOLDS
        A, b = columns[~test], TARGETS[~test, target]
        x = np.linalg.solve(A.T @ A + ridge * len(A) * np.eye(A.shape[1]), A.T @ b)
        np.add.at(out, BLOCKS[test], (TARGETS[test, target] - columns[test] @ x) ** 2)
    return out


def test_a_prediction_is_made_from_the_other_folds():
    found = FoldSums.of(_stretches()).ridges(np.arange(7))
    assert found.squares.shape == (1 + len(RIDGE), 3)
    assert found.squares[0] == pytest.approx(np.sum(TARGETS**2, axis=0))
    for k, ridge in enumerate(RIDGE):
        assert found.squares[1 + k] == pytest.approx([_solved(COLUMNS, ridge, j).sum() for j in range(3)])


def test_some_columns_can_weigh_less_than_others():
    weights = np.array([1.0, 1.0, 0.1])
    found = FoldSums.of(_stretches()).ridges(np.array([0, 2, 6]), weights)
    assert found.squares[-1, 0] == pytest.approx(_solved(COLUMNS[:, [0, 2, 6]] * weights, RIDGE[-1], 0).sum())


def test_each_target_has_the_candidate_that_misses_least_of_it():
    sums = FoldSums.of(_stretches())
    few, all_ = sums.ridges(np.arange(3)), sums.ridges(np.arange(7))
    squares, coefficients = best([few, all_])
    assert squares == pytest.approx(np.minimum(few.squares.min(axis=0), all_.squares.min(axis=0)))
    # The first follows three columns, the second none, the third the last alone.
    assert np.all(coefficients[:, 3:, 0] == 0.0)
    assert np.all(coefficients[:, :, 1] == 0.0)
    assert coefficients[:, 6, 2] == pytest.approx(1.0, abs=0.05)
    whole, left = missed(_stretches(), [coefficients], 12)
    assert whole.sum(axis=0) == pytest.approx(np.sum(TARGETS**2, axis=0))
    assert left.sum(axis=0) == pytest.approx(squares)
    place = int(np.argmin(few.squares[1:, 0]))
    assert left[:, 0] == pytest.approx(_solved(COLUMNS[:, :3], RIDGE[place], 0))


def test_sums_need_samples():
    with pytest.raises(ValueError, match="no samples"):
        FoldSums.of([])
