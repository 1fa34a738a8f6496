"""What the ranking takes for chance and structure: on a car that is exactly its model, with simulated noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.lack_of_fit import excess_is_coloured
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.verdicts import says
from tests.identify.exact_car import driven, exact, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS


def test_the_best_of_every_simulated_run_has_a_rank_of_its_own(space: ScoreTests, found: list[Candidate]):
    """Put in the place of the measured run, D simulated ones have least p of 2/(D + 1), 3/(D + 1) … 1: uniform."""
    least = []
    for draw in range(DRAWS):
        drops = [replace(c, drop=float(space.best_tests[c.key].null[draw])) for c in found]
        least.append(min(c.p for c in space.family_wise(drops)))
    np.testing.assert_allclose(np.sort(least), np.arange(2, DRAWS + 2) / (DRAWS + 1))


def test_p_falls_with_the_drop_and_is_never_zero(space: ScoreTests, found: list[Candidate]):
    levels = [0.0, *np.geomspace(0.01, 1e6, 30)]
    p = np.array([[c.p for c in space.family_wise([replace(c, drop=level) for c in found])] for level in levels])
    assert np.all(np.diff(p, axis=0) <= 0.0)
    assert np.all(p[0] == 1.0)
    assert np.all(p[-1] == pytest.approx(1.0 / (DRAWS + 1)))


def test_nothing_is_missing_from_a_car_that_is_its_model(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    found = diagnose(fitted, floor, CANDIDATES, noise=space.noise)
    assert found.verdict == "nothing missing", says(found)
    assert all(ratio < 1.3 for ratio in found.noise_ratio.values()), found.noise_ratio
    assert not found.formulas
    assert not excess_is_coloured(space.residual_beside([]))


def test_noise_twice_as_loud_as_the_sheet_is_no_effect(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    loud = fit_of(driven(exact(), 2, loud=2.0), fitted)
    found = diagnose(loud, floor, CANDIDATES, noise=space.noise)
    assert found.verdict == "nothing missing", says(found)
    assert np.mean(list(found.noise_ratio.values())) == pytest.approx(2.0, abs=0.15)
    assert all(1.5 < ratio < 2.5 for ratio in found.noise_ratio.values()), found.noise_ratio
    assert set(found.failing) == set(floor.sigma)
    assert min(c.p for c in found.candidates) > SELECTION.significance
    noisy = ScoreTests.of(Linearisation.of(loud, floor), CANDIDATES, 0, space.noise)
    assert not excess_is_coloured(noisy.residual_beside([]))
    growth = [
        np.mean(noisy.best_tests[c.key].null) / np.mean(space.best_tests[c.key].null)
        for c in space.try_all()
        if c.tested
    ]
    assert 3.0 < np.median(growth) < 5.0  # simulated runs are as loud
    assert "noisier than their sheet" in says(found)


def test_a_hidden_sine_force_is_structure(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    record = driven(exact(), 3).recording
    values = dict(record.signals.value)
    force = values["wheel.fl.force"].copy()
    force[2] += 60.0 * np.sin(2 * np.pi * 1.7 * record.t)
    values["wheel.fl.force"] = force
    spoilt = fit_of(PreparedRun(record.with_signals(replace(record.signals, value=values))), fitted)
    left = ScoreTests.of(Linearisation.of(spoilt, floor), CANDIDATES, 0, space.noise).residual_beside([])
    assert "suspension.fl" in left.above
    assert excess_is_coloured(left)
    assert left.chance(left.above) == 1.0 / (1 + DRAWS)


def test_rows_together_are_compared_with_the_same_rows_of_simulated_runs(space: ScoreTests):
    """A simulated run has its own rank; and weak excesses add up, as those of simulated runs do not."""
    left = space.residual_beside([])
    rows = list(left.ratios)
    together = np.sum(list(left.null.values()), axis=0)
    for rank, draw in enumerate(np.argsort(-together), start=1):
        own = replace(left, squares={row: float(left.null[row][draw]) for row in rows})
        assert own.chance(rows) == pytest.approx((1 + rank) / (1 + DRAWS))
    assert left.excess(rows) == pytest.approx(sum(left.excess([row]) for row in rows))
    spread = {row: float(np.std(left.null[row])) for row in rows}
    weak = replace(left, squares={row: 1.2 * spread[row] for row in rows})
    gain_test = np.median([weak.chance([row]) for row in rows])
    assert gain_test > 0.05
    assert weak.chance(rows) < 0.5 * gain_test
