"""One number, one meaning: a row's error ÷ floor over runs is pooled error ÷ pooled floor; the worst run is another."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.validation.score import pooled_ratio, row_errors, row_ratios, worst_row

LONG = {"rms": 20.0, "floor": 10.0, "ratio": 2.0, "samples": 300}
SHORT = {"rms": 60.0, "floor": 2.0, "ratio": 30.0, "samples": 100}
RUNS = {
    "long": {"suspension.fl": LONG, "tyre.fl": {**LONG, "rms": 10.0, "ratio": 1.0}},
    "short": {"suspension.fl": SHORT},
}


def test_a_row_is_pooled_over_the_samples_of_all_runs():
    error = row_errors(RUNS)["suspension.fl"]
    rng = np.random.default_rng(0)
    series = [one["rms"] * np.resize([1.0, -1.0], one["samples"]) for one in (LONG, SHORT)]
    noise = [one["floor"] * np.resize([1.0, -1.0], one["samples"]) for one in (LONG, SHORT)]
    both = [float(np.sqrt(np.mean(rng.permutation(np.concatenate(part)) ** 2))) for part in (series, noise)]
    assert (error.rms, error.floor) == pytest.approx(both)
    assert error.ratio == pytest.approx(both[0] / both[1])
    assert (error.worst_run, error.worst) == ("short", 30.0)
    assert row_ratios(RUNS)["suspension.fl"] == error.ratio


def test_the_model_is_the_mean_square_of_its_rows():
    rows = row_ratios(RUNS)
    assert pooled_ratio(RUNS) == pytest.approx(np.sqrt((rows["suspension.fl"] ** 2 + 1.0) / 2.0))
    assert worst_row(RUNS) == ("short: suspension.fl", 30.0)
    assert np.isnan(pooled_ratio({}))


def test_scores_without_their_samples_count_alike():
    old = {
        run: {row: {k: v for k, v in s.items() if k != "samples"} for row, s in rows.items()}
        for run, rows in RUNS.items()
    }
    assert row_errors(old)["suspension.fl"].rms == pytest.approx(np.sqrt((20.0**2 + 60.0**2) / 2.0))
