"""Shape constants that were searched: what is not known of them is in the intervals of the laws' sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.shape_uncertainty import constant_changes
from lacet.identify.regression.wls import Fit, FitOptions, fit, with_constant_changes
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.parameter_estimates import estimates
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, exact_with_laws, fit_of

STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.0065, "n": 1.6})
SIZE = 60000.0
NEAR = replace(STOP, shape={"gap": 0.0062, "n": 1.63})
"""As a search may find it."""
NAME = "bump_stop.rear.k"


@pytest.fixture(scope="module")
def record() -> Recording:
    """The exact drive of a car with the stop."""
    return exact_with_laws([(STOP, SIZE)])


@pytest.fixture(scope="module")
def fitted(record: Recording) -> Fit:
    return fit(MODEL + NEAR, [driven(record, 0)], FitOptions(unbias=False))


def test_a_constant_that_is_off_is_found_to_be_changed(fitted: Fit):
    """To first order: without noise of the record the change brings it back to the true one."""
    wider = with_constant_changes(fitted)
    for constant, true in STOP.shape.items():
        place = wider.model.names.index(f"{STOP.key}.{constant}")
        sigma = float(np.sqrt(wider.covariance[place, place] + wider.covariance_sheet[place, place]))
        found = NEAR.shape[constant] + wider.theta[place]
        assert abs(found - true) < 3.0 * sigma + 0.3 * abs(NEAR.shape[constant] - true)


def test_the_interval_of_a_size_counts_that_constants_were_searched(fitted: Fit, record: Recording):
    """The standard error of the size, its constants being known, is many times too small for what other noise gives."""
    searched, sheet = fitted.covariances_searched
    at = fitted.model.names.index(NAME)
    other = fitted.model.names.index("spring.fl.k")
    assert searched[at, at] > 4.0 * fitted.covariance[at, at]
    assert sheet[at, at] > 1.5 * fitted.covariance_sheet[at, at]
    assert searched[other, other] == pytest.approx(fitted.covariance[other, other], rel=0.05)
    (size,) = (one for one in estimates(fitted) if one.name == NAME)
    assert size.half == pytest.approx(1.96 * float(np.sqrt(searched[at, at])))
    assert size.half_sheet == pytest.approx(1.96 * float(np.sqrt(searched[at, at] + sheet[at, at])))

    stored, found, told = fitted.stored, list[float](), list[float]()
    for seed in range(1, 17):
        one = fit(fitted.model, [driven(record, seed)], FitOptions(unbias=False), stored=stored)
        wider = with_constant_changes(one)
        place = wider.model.names.index(NAME)
        found.append(float(wider.theta[place]))
        told.append(float(np.sqrt(wider.covariance[place, place])))
    # Of sixteen draws the standard deviation is within these of the true one in 99 of 100.
    assert 0.5 < float(np.std(found, ddof=1)) / float(np.mean(told)) < 1.5


def test_without_constants_nothing_is_added():
    plain = fit_of(driven(exact(), 0))
    assert with_constant_changes(plain) is plain
    assert plain.covariances_searched[0] is plain.covariance
    given = replace(STOP, shape={**STOP.shape, "height": 1.0})
    assert [one.constant for one in constant_changes([(given.as_physics, np.ones(1))])] == ["gap", "n"]


def test_at_a_bound_the_derivative_is_one_sided(record: Recording):
    """A stop with n = 1, the least that there is: the force of a slightly progressive one less its own."""
    motion, linear = driven(record, 0).motion, replace(STOP, shape={"gap": 0.0065, "n": 1.0})
    change = next(one for one in constant_changes([(linear, np.array([SIZE]))]) if one.constant == "n")
    found = change.columns(motion)["suspension.rl"][0]
    more = replace(linear, shape={"gap": 0.0065, "n": 1.001})
    expected = SIZE * (more.columns(motion)["suspension.rl"] - linear.columns(motion)["suspension.rl"])[0] / 0.001
    assert np.max(np.abs(found - expected)) < 0.1 * np.max(np.abs(expected))


def test_a_run_keeps_the_changes_of_different_sizes_and_constants_apart(record: Recording):
    """Columns are stored on a run by key and constants; of two fits to it, each has changes of its own."""
    run = driven(record, 0)
    first, larger, farther = (
        run.columns(constant_changes([(effect, np.array([size]))])[0])
        for effect, size in ((STOP, SIZE), (STOP, 2.0 * SIZE), (NEAR, SIZE))
    )
    for row, columns in first.items():
        np.testing.assert_allclose(larger[row], 2.0 * columns, atol=1e-9 * np.max(np.abs(columns)))
        assert not np.allclose(farther[row], columns)
