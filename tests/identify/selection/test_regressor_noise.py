"""Noise in the columns themselves, on a car that is exactly its model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import SensorResponses
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.columns.candidate_columns import CandidateColumns
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import RegressorNoise, RunNoise
from lacet.identify.selection.columns.weighted_columns import Weighting, columns_of
from lacet.identify.selection.partial_regression import PartialRegression, at_gain
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import FaultWithoutTolerance
from lacet.identify.validation.noise_floor import NoiseFloor, RunDraws, floor_of
from tests.identify.exact_car import KNOWN, MODEL, RIG, SECONDS, driven, exact, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES


def test_without_noise_nothing_is_shifted(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    """A hundredth of the noise shifts sums by its square."""
    rig = replace(RIG, sensors=tuple(replace(s, noise={k: 0.01 * v for k, v in s.noise.items()}) for s in RIG.sensors))
    quiet = fit(MODEL, [PreparedRun(replace(fitted.runs[0].recording, rig=rig))], FitOptions(unbias=False))
    sums = CandidateColumns.of(Linearisation.of(quiet, floor), CANDIDATES, 0, 1.0).sums
    calm = RegressorNoise.of(quiet, sums.layout, floor.sigma)
    assert calm.labels == space.noise.labels
    for row, total in by_row(space.noise, space.sums).items():
        assert total.shape == 2 * (space.layout.width,)
        small, large = (np.diag(a)[:-1] for a in (by_row(calm, sums)[row], total))
        assert np.any(large > 0.0)
        assert np.all(np.abs(small) <= 1e-2 * np.abs(large) + 1e-9), row


def test_columns_of_a_draw_that_were_kept_are_those_of_the_draw_made_anew(
    space: ScoreTests, fitted: Fit, floor: NoiseFloor
):
    """A ranking leaves them behind for the next one: physics with the run, sensor faults and sheet with the piece."""
    (piece,) = fitted.assembly.pieces_of(0)
    anew = replace(piece, prepared=piece.prepared.uncached(), responses=SensorResponses())
    assert space.noise.labels
    assert piece.responses.of_draws
    for kept, fresh in zip(piece.noisy([2003, 0, 0]), anew.noisy([2003, 0, 0]), strict=True):
        assert kept.responses.faults
        assert not fresh.responses.faults
        found, expected = (dict(columns_of(fitted, space.layout, piece, floor.sigma, one)) for one in (kept, fresh))
        assert found.keys() == expected.keys()
        for row, (columns, active) in expected.items():
            np.testing.assert_array_equal(found[row][1], active)
            np.testing.assert_allclose(found[row][0], columns, rtol=1e-10, atol=1e-10, err_msg=row)


def test_combinations_of_the_columns_hold_the_combined_noise() -> None:
    """Most are one column, some are two with weights, one is none; a row without noise keeps none."""
    rng = np.random.default_rng(3)
    part = rng.standard_normal((4, 9))
    total = np.zeros((6, 6))
    total[np.ix_([0, 2, 3, 5], [0, 2, 3, 5])] = part @ part.T
    first, second = Row.parse("suspension.fl"), Row.parse("tyre.rr")
    totals = {first: total, second: np.zeros((6, 6))}
    noise = RegressorNoise(tuple("abcdef"), (RunNoise.of_totals(totals),), {first: 1.0, second: 1.0})
    weights = np.eye(6)[[0, 1, 2, 3, 4, 4, 1, 5]]
    weights[5], weights[6] = [0.0, 0.0, 0.3, 0.7, 0.0, 0.0], 0.0
    (moved,) = noise.at(tuple("abcdefgh"), weights).runs
    found = {row: np.zeros((8, 8)) for row in totals}
    for row, one in moved.rows.items():
        found[row][np.ix_(one.places, one.places)] = one.products
    np.testing.assert_allclose(found[first], weights @ total @ weights.T, rtol=1e-10, atol=1e-12)
    assert not np.any(found[second])


def test_zeros_are_eliminated_as_if_their_columns_stood_first(space: ScoreTests):
    """From products of zeros and columns together; and of combinations of the columns at the same regression."""
    sums, w = space.sums, space.layout.width
    weighting, gain = sums.weighting, sums.over_runs.zero_gains[0]
    (run,) = space.noise.runs
    rng, priors = np.random.default_rng(7), run.priors / weighting.prior_stiffening
    z = len(priors)
    scales = {row: float(rng.uniform(0.5, 2.0)) for row in run.rows}
    whole = np.zeros((z + w, z + w))
    for row, one in run.rows.items():
        whole[np.ix_(z + one.places, z + one.places)] += scales[row] * one.products
        whole[np.ix_(np.arange(z), z + one.places)] += scales[row] * priors[:, None] * one.across
    whole[z:, :z] = whole[:z, z:].T
    # Columns of the model as they are, and the residual without the zeros that were found.
    p, plain = space.layout.model, gain.copy()
    plain[:, :p] = gain[:, :p] @ np.linalg.inv(sums.turn)
    plain[:, -1] -= run.values / priors
    less = np.concatenate([-plain, np.eye(w)])
    expected = less.T @ whole @ less
    small = 1e-8 * float(np.max(expected))
    np.testing.assert_allclose(run.eliminated(weighting, gain, scales), expected, rtol=1e-8, atol=small)
    weights = rng.standard_normal((5, w)) * (rng.random((5, w)) < 0.1)
    moved = run.at_zeros(weighting, gain).at(weights)
    np.testing.assert_allclose(_of_width(moved, 5, scales), weights @ expected @ weights.T, rtol=1e-8, atol=small)
    restored = RegressorNoise.from_arrays(replace(space.noise, runs=(moved,)).arrays()).runs[0]
    np.testing.assert_array_equal(_of_width(restored, 5, scales), _of_width(moved, 5, scales))


def _of_width(run: RunNoise, width: int, scales: Mapping[Row, float]) -> Array:
    """(w, w) products of a run's columns, whose regression on the zeros is known."""
    layout = Layout.of(width - 1, (), ())
    return run.eliminated(Weighting(layout, np.eye(width - 1), 1.0), np.zeros((0, width)), scales)


def test_noise_is_what_the_same_draws_do_sample_by_sample(space: ScoreTests, fitted: Fit, floor: NoiseFloor):
    """Products of each candidate with the residual, everything else taken out, with the draws and without them."""
    sums, layout = space.sums, space.layout
    places = [t.place.start for t in layout.trials]
    combined = np.zeros((layout.width, len(places) + 1))
    combined[places, range(len(places))] = 1.0
    combined[layout.right, -1] = 1.0
    combined = space.regression.coefficients(combined)
    nuisance = sums.over_runs.zero_gains[0] @ combined
    combined[: layout.model] = sums.turn @ combined[: layout.model]
    (piece,) = fitted.assembly.pieces_of(0)
    zeros = {
        row: block[:, : len(nuisance)] * fitted.zeros[0][1] / sums.weighting.prior_stiffening
        for row, block in piece.blocks.items()
    }

    def products(noisy: PreparedRun | None) -> dict[str, Array]:
        out = {}
        for row, (columns, active) in columns_of(
            fitted, layout, piece, floor.sigma, noisy and replace(piece, prepared=noisy, responses=SensorResponses())
        ):
            columns[:, -1] -= columns[:, : layout.model] @ fitted.solution
            series = columns @ combined[active] - zeros[row] / floor.sigma[row] @ nuisance
            out[row] = series[:, :-1].T @ series[:, -1]
        return out

    before = products(None)
    found = {row: np.zeros(len(places)) for row in before}
    for draw in range(SELECTION.noise_pairs):
        for noisy in piece.prepared.noisy([2003, 0, draw], loads=True):
            for row, after in products(noisy).items():
                found[row] += (after - before[row]) / (2 * SELECTION.noise_pairs)
    size = np.sqrt(np.diag(space.regression.reduced_noisy)[places])
    for row, total in by_row(space.noise, sums).items():
        left = at_gain(total, space.regression.nuisance, space.regression.gain)
        np.testing.assert_allclose(left[places, -1] / size, found[row] / size, rtol=1e-4, atol=1e-5, err_msg=row)


def test_the_corrected_score_of_a_noisy_sensor_is_nearer_nothing(fitted: Fit, floor: NoiseFloor):
    """The scale of a laser whose noise is three times the sheet's: over eight runs that lack nothing."""
    tried = [KNOWN["sensor_gain.hub.fl"]]
    raw, corrected, noise = [], [], None
    free, sound_free = [], []
    for seed in range(8):
        space = ScoreTests.of(Linearisation.of(fit_of(driven(exact(), 20 + seed, 2.0), fitted), floor), tried, 0, noise)
        noise, place = space.noise, space.layout.trials[0].place.start
        without = PartialRegression(space.sums, space.regression.nuisance, space.regression.prior)
        size = np.sqrt(space.regression.reduced_noisy[place, place])
        raw.append(without.reduced[place, space.layout.right] / np.sqrt(without.reduced[place, place]))
        corrected.append(space.regression.reduced[place, space.layout.right] / size)
        whole = slice(place, place + 1)
        assert space.regression.scores(whole, space.null)[0] == pytest.approx(corrected[-1] ** 2)
        without_tolerance = space.without_tolerance[place]
        plain = FaultWithoutTolerance(without, place, without_tolerance.own)
        sound_free.append(
            without_tolerance.value
            * without_tolerance.energy
            / np.sqrt(without_tolerance.energy + without_tolerance.noise)
        )
        free.append(plain.value * np.sqrt(plain.energy))
        assert (
            without_tolerance.drop < without_tolerance.value**2 * without_tolerance.energy
        )  # what the correction may be wrong by is not counted
        sound = space.regression.reduced[place, place]
        assert space.regression.values(whole)[0][0] == pytest.approx(corrected[-1] * size / sound)
    spread = np.std(raw) / np.sqrt(len(raw))
    assert np.mean(raw) > 3.0 * spread
    assert abs(np.mean(corrected)) < 0.5 * np.mean(raw)
    assert abs(np.mean(corrected)) < 3.0 * spread
    # The same where its own tolerance excuses none of it.
    assert np.mean(free) > 3.0 * np.std(free) / np.sqrt(len(free))
    assert abs(np.mean(sound_free)) < 0.5 * np.mean(free)


def test_of_long_data_all_is_drawn_with_fewer_pairs(fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch):
    """One pair of draws for each run of three instead of two: other draws, and no run is left out."""
    runs = [PreparedRun(replace(driven(exact(), seed).recording, run=f"run{seed}")) for seed in (0, 31, 32)]
    three = fit(MODEL, runs, FitOptions(unbias=False))
    sums = CandidateColumns.of(Linearisation.of(three, floor_of(three, 3)), CANDIDATES[:4], 0, 1.0).sums
    own = sums.layout
    counted = list[int]()
    RegressorNoise.of(three, own, floor.sigma, progress=lambda step: counted.append(step.total))
    monkeypatch.setattr(
        "lacet.identify.selection.columns.regressor_noise.SELECTION", replace(SELECTION, noise_seconds=2.9 * SECONDS)
    )
    few = RegressorNoise.of(three, own, floor.sigma, progress=lambda step: counted.append(step.total))
    assert (counted[0], counted[-1]) == (3 * SELECTION.noise_pairs, 3)
    each = [RegressorNoise.of_run(three, own, floor.sigma, run, 1) for run in range(3)]
    for row, total in by_row(few, sums).items():
        parts = [by_row(one, sums)[row] for one in each]
        np.testing.assert_allclose(total, np.sum(parts, axis=0), rtol=1e-12, atol=1e-9, err_msg=row)


def test_noise_is_taken_out_of_every_fold_by_its_share(space: ScoreTests):
    """Parts of the sums without noise are those of all without noise; a column's own stays in what it is judged by."""
    found = space.regression
    inside = [found.inside(fold) for fold in range(SELECTION.folds)]
    np.testing.assert_allclose(np.sum(inside, axis=0), found.total + _at_other_zeros(space), atol=1e-6)
    some, others = np.array([0, 3]), np.array([1, 3, 4])
    np.testing.assert_array_equal(found.inside(2, some, others), inside[2][np.ix_(some, others)])
    for trial in space.layout.trials:
        k = trial.place
        plain, noise = 0.0, found.noise[k, k]
        for train, test in found.folds:
            beta = np.linalg.solve(train[k, k] + 0.8 * noise, train[k, -1])
            plain += 2.0 * beta @ test[k, -1] - beta @ (test[k, k] + 0.2 * noise) @ beta
        assert found.fall(k) == pytest.approx(float(plain), rel=1e-9), trial.effect.key


def test_noise_weighted_otherwise_is_what_would_be_drawn(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    """Noise kept for one floor, used beside another: rows a tenth louder or quieter."""
    factors = dict(zip(floor.sigma, np.resize([1.1, 1.0 / 1.1], len(floor.sigma)), strict=True))
    other = NoiseFloor.of(
        [RunDraws.of({row: factors[row] * draws for row, draws in part.series.items()}) for part in floor.draws]
    )
    own = ScoreTests.of(Linearisation.of(fitted, other), CANDIDATES, 0, space.noise)
    assert own.noise is space.noise
    drawn = RegressorNoise.of(fitted, own.layout, other.sigma)
    quiet = dict.fromkeys(other.sigma, 1.0)
    kept, right = (np.diag(noise.products(own.sums, quiet, other.sigma)) for noise in (space.noise, drawn))
    large = right > 1e-4 * np.diag(own.sums.total)
    assert np.count_nonzero(large) > 9
    np.testing.assert_allclose(kept[large], right[large], rtol=0.05)


def test_noise_of_what_was_tried_is_taken_out_where_it_is_tried_together(space: ScoreTests):
    """A shape of the grid beside others is what it was alone: value, σ and all."""
    tried = [one for one in space.best_tests.values() if not one.trial.fault]
    inside, trials = space.beside([one.trial.effect for one in tried])
    noisy = 0
    for one, trial in zip(tried, trials, strict=True):
        noisy += space.regression.noisy_part(one.trial.place) > 1e-3
        for found, gain_test in zip(inside.values(trial.place), (one.values, one.spread), strict=True):
            np.testing.assert_allclose(found, gain_test, rtol=1e-6, err_msg=one.key)
    assert noisy


def by_row(noise: RegressorNoise, sums: CrossProducts) -> dict[Row, Array]:
    """Row → (w, w) products of the noise on it, for the columns of `sums`."""
    return {row: noise.products(sums, {row: 1.0}, noise.sigma) for row in noise.sigma}


def _at_other_zeros(space: ScoreTests) -> Array:
    """What the zeros found outside of each fold add to the sums inside."""
    return space.sums.over_runs.test.sum(axis=0) - space.sums.total


@pytest.mark.parametrize(
    ("sound", "noise", "share"),
    [
        (np.diag([1.0, 4.0]), np.diag([1.0, 1.0]), 0.5),
        (np.diag([1.0, 4.0]), np.diag([-0.3, 12.0]), 0.75),
        (np.diag([1.0, 4.0]), np.diag([-0.3, -0.2]), 0.0),
        (np.ones((2, 2)), np.eye(2), 1.0),
    ],
)
def test_the_noise_of_columns_themselves_is_a_share_of_their_energy(sound: Array, noise: Array, share: float) -> None:
    """In the worst direction, in any units. Drawn noise may be less than nothing; beside nothing sound all is noise."""
    units = np.diag([1.0, 1e6])
    reduced, own = units @ sound @ units, units @ noise @ units
    known = SimpleNamespace(reduced=reduced, column_noise=own, reduced_noisy=reduced + np.diag(np.diag(reduced)))
    found = PartialRegression.own_noisy_part(cast(PartialRegression, known), slice(0, 2))
    assert found == pytest.approx(share)
