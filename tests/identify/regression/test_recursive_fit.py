"""Recursive fit: sums of what was seen, extended second by second, against a fit of the same seconds."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression import recursive_fit
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.finished_pieces import ScoreSums
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.recursive_fit import ChangedRunError, GrownFit, RecursiveFit
from lacet.identify.regression.seconds_needed import seconds_needed
from lacet.identify.regression.sums.linear_fit import FitOptions, solve_linear
from lacet.identify.regression.sums.prepared_runs import PreparedRuns
from lacet.identify.regression.uncertainty import hac
from lacet.identify.regression.wls import Fit, fit, fit_of
from lacet.identify.validation.equation_scores import column_totals, floor_by_row, row_levels
from lacet.identify.validation.score import compare
from tests.identify.cars import piece, reference_car

VEHICLE, RIG = reference_car()
MODEL = Model.of(base_model(VEHICLE, "contact"))


@cache
def prepared(seconds: float, name: str = "rough") -> PreparedRun:
    return PreparedRun.of(piece(name, 0.0, seconds), VEHICLE, RIG)


def half(fitted: Fit | GrownFit) -> Array:
    """Half intervals with the sensor sheet, of the parameters kept."""
    return 1.96 * np.sqrt(np.diag(fitted.covariance + fitted.covariance_sheet))[fitted.place]


def apart(one: Fit | GrownFit, other: Fit | GrownFit) -> float:
    """Largest difference of two fits' values and half intervals, in half intervals."""
    kept = other.place
    values = np.abs(one.theta[kept] - other.theta[kept]) / half(other)
    return float(max(values.max(), np.abs(half(one) / half(other) - 1.0).max()))


@pytest.fixture(scope="module")
def begun() -> Fit:
    return fit(MODEL, [prepared(9.0)])


def test_on_the_seconds_of_the_fit_it_gives_the_fit(begun: Fit):
    """Pieces that are finished once and merged, with the filters' margins: values, intervals and errors by row."""
    again = RecursiveFit(begun).extended(begun.runs[0])
    assert apart(again, begun) < 1e-6
    floor = floor_by_row(begun)
    expected = compare(begun, begun.runs[0]).scores
    for found, totals in ((begun, column_totals(begun)), (again, again.totals)):
        levels = row_levels(found.equations.runs[0], totals, found.solution, floor)
        assert {row: level.ratio for row, level in levels.items()} == pytest.approx(
            {row: score.ratio for row, score in expected.items()}, rel=1e-6
        )


def test_extended_second_by_second_it_is_the_fit_of_all_seconds_at_the_same_values(begun: Fit):
    going = RecursiveFit(begun)
    for seconds in (11.5, 16.0):
        run = prepared(seconds)
        found = going.extended(run)
        grown = sum(found.equations.runs[0].counts.values()) / sum(begun.equations.runs[0].counts.values())
        moments = NoiseMoments(grown * begun.moments.slopes, grown * begun.moments.constants)
        assert begun.assembly.at is not None
        at_once = solve_linear(
            MODEL, PreparedRuns(MODEL, (run,)), begun.options, moments, near=begun.assembly.at.values
        )
        assert apart(found, fit_of(MODEL, begun.options, at_once)) < 1e-6
    assert going.first_needed > 1.0


def test_scores_added_piece_by_piece_have_the_covariance_of_all():
    scores = np.random.default_rng(3).standard_normal((400, 4)).cumsum(axis=0)
    sums = ScoreSums(4)
    for start, end in ((0, 7), (7, 140), (140, 390)):
        sums.add(scores[start:end])
    np.testing.assert_allclose(sums.covariance(scores[390:], 400), hac(scores), rtol=1e-9)


def test_finished_pieces_leave_sums_of_one_size(begun: Fit, monkeypatch: pytest.MonkeyPatch):
    """Without the samples of any finished piece the intervals hardly differ, and the values not at all."""
    runs, exact = [prepared(16.0), prepared(24.0)], RecursiveFit(begun)
    wanted = [exact.extended(run) for run in runs]
    monkeypatch.setattr(recursive_fit, "EXACT", 0.0)
    going, sizes = RecursiveFit(begun), list[int]()
    for run, same in zip(runs, wanted, strict=True):
        found = going.extended(run)
        np.testing.assert_allclose(found.theta, same.theta, rtol=1e-9, atol=1e-12)
        assert 0.0 < apart(found, same) < 0.1
        sizes.append(len(pickle.dumps(going)))
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


def test_a_fit_from_scratch_of_the_same_seconds_is_within_two_hundredths_of_the_intervals():
    """What differs is where the residual was linearised, a quarter before; without draws of simulated noise."""
    options = FitOptions(unbias=False)
    found = RecursiveFit(fit(MODEL, [prepared(12.8)], options)).extended(prepared(16.0))
    assert apart(found, fit(MODEL, [prepared(16.0)], options)) < 0.02


def test_the_last_seconds_alone_are_enough(begun: Fit):
    """A part of the run on its grid gives what the whole gives; one that begins too late is refused."""
    whole = prepared(16.0)
    going, other = RecursiveFit(begun), RecursiveFit(begun)
    rate = whole.recording.filters.rate
    first = int(going.first_needed * rate)
    part = PreparedRun(whole.recording.at(slice(first, None)))
    assert apart(going.extended(part, first), other.extended(whole)) < 1e-6
    with pytest.raises(ChangedRunError):
        RecursiveFit(begun).extended(PreparedRun(whole.recording.at(slice(800, None))), 800)


def test_a_run_that_changed_is_refused(begun: Fit):
    recording = prepared(10.0).recording
    signals = {name: a for name, a in recording.signals.value.items() if name != "camera.fl.steer"}
    with pytest.raises(ChangedRunError):
        RecursiveFit(begun).extended(PreparedRun(replace(recording, signals=replace(recording.signals, value=signals))))


def test_the_seconds_needed_are_those_after_which_it_is_enough():
    """Predicted from 8 s for the static loads, whose intervals noise makes, against the fit of 16 s of the same."""
    options = FitOptions(unbias=False)
    early, late = (fit(MODEL, [prepared(seconds, "sine")], options) for seconds in (8.0, 16.0))
    for corner in ("fl", "fr", "rl", "rr"):
        place = MODEL.names.index(f"offset.{corner}.f0")
        reached = float(seconds_needed(late, 0.02, 16.0).half[place])
        found = seconds_needed(early, reached, 8.0)
        assert found.half[place] == pytest.approx(half(early)[list(early.place).index(place)] / early.theta[place])
        assert 8.0 + found.seconds[place] == pytest.approx(16.0, rel=0.35)
        # What stays: the sensor sheet's gains and latencies, and zeros, whose priors no samples improve beyond.
        sheet = 1.96 * np.sqrt(early.covariance_sheet[place, place]) / early.theta[place]
        assert 1.03 * sheet < found.least[place] < reached
        assert seconds_needed(early, 1.01 * found.half[place], 8.0).seconds[place] == 0.0
        assert np.isinf(seconds_needed(early, 0.99 * found.least[place], 8.0).seconds[place])


def test_a_direction_that_is_mostly_noise_stays_unknown():
    """Where the columns are mostly noise, the interval is the prior's, and no time makes it narrower."""
    fitted = fit(MODEL, [prepared(16.0, "sine")])
    found = seconds_needed(fitted, 0.02, 16.0)
    plain = seconds_needed(replace(fitted, moments=NoiseMoments.zero(len(fitted.place))), 0.02, 16.0)
    kept = fitted.place
    assert np.all(found.least[kept] >= plain.least[kept] * (1.0 - 1e-9))
    assert np.any(found.least[kept] > 2.0 * plain.least[kept])
