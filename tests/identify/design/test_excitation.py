"""What a run would tell: identities, and prediction against fits that were made."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.errors import UsageError
from lacet.identify.design.run_information import (
    Information,
    RunInformation,
    fit_information,
    half_widths,
    predicted,
    residual_excess,
    run_information,
    with_constants,
)
from lacet.identify.design.run_ranking import chosen, quantities, rank
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from tests.identify.cars import reference_car
from tests.support.tables import piece

VEHICLE, RIG = reference_car()


@cache
def drive(name: str, start: float = 5.0, stop: float = 12.0) -> PreparedRun:
    return PreparedRun.of(piece(name, start, stop), VEHICLE, RIG)


@cache
def fitted(*names: str) -> Fit:
    """The base model with both bars, which this car has."""
    from lacet.identify.effects.catalogue import catalogue

    bars = [e for key, e in catalogue(VEHICLE, "hub").items() if key.startswith("anti_roll_bar")]
    reference = drive("sine").recording.reference
    return fit(Model.of([*base_model(VEHICLE, reference), *bars]), [drive(name) for name in names])


@cache
def told(name: str) -> RunInformation:
    return run_information(drive(name), fitted("sine"), residual_excess(fitted("sine")))


def random_run(seed: int, p: int = 5, z: int = 3, n: int = 40) -> RunInformation:
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(n, p + z)) * 10.0 ** rng.uniform(-2, 2, p + z)
    C = rng.normal(size=(n, n)) / np.sqrt(n)
    return RunInformation(
        W.T @ W, W.T @ C @ C.T @ W, np.zeros((p, p)), 10.0 ** rng.uniform(-2, 1, z), W[:, :p], 8.5, 1.5
    )


@given(st.integers(0, 10**6), st.floats(2.0, 300.0))
@settings(max_examples=40, deadline=None)
def test_eliminating_the_zeros_leaves_the_covariance_of_the_parameters_as_it_was(seed: int, duration: float):
    run = random_run(seed)
    share, p = (duration - run.edges) / run.seconds, 5
    known = np.diag([*np.zeros(p), *run.prior**-2.0])
    whole = np.linalg.inv(share * run.normal + known)
    robust = (whole @ (share * run.scores + known) @ whole)[:p, :p]
    info = run.lasting(duration)
    A = np.linalg.inv(info.normal)
    for got, expected in ((A, whole[:p, :p]), (A @ info.scores @ A, robust)):
        size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.max(np.abs(got - expected) / size) < 1e-6


def test_a_run_no_longer_than_the_filters_tells_nothing():
    info = random_run(1).lasting(1.0)
    assert np.max(np.abs(info.normal)) == 0.0
    assert np.max(np.abs(info.scores)) == 0.0


def test_the_information_of_a_fit_gives_its_own_covariances_back():
    one = fitted("sine")
    back = predicted(one, fit_information(one))
    assert back.base.independent.tolist() == one.base.independent.tolist()
    for got, expected in ((back.covariance, one.covariance), (back.covariance_iid, one.covariance_iid)):
        size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.max(np.abs(got - expected)[size > 0] / size[size > 0]) < 1e-8


def test_a_size_is_no_better_known_than_its_constants_are():
    """A stop as stiff as this, of which gap and exponent are to be found on the same run."""
    from lacet.identify.effects.catalogue import catalogue

    one, name = fitted("sine"), "bump_stop.front.k"
    stop = replace(catalogue(VEHICLE, "hub")["bump_stop.front"], shape={"gap": 0.004, "n": 1.5})
    with_stop = fit(Model.of([*one.model.effects, stop]), one.runs)
    theta = np.where([n == name for n in with_stop.model.names], 2e5, with_stop.theta)
    wider, now = with_constants(replace(with_stop, theta=theta))
    place = wider.model.names.index(name)
    there, known = quantities(predicted(wider, now), VEHICLE), quantities(with_stop, VEHICLE)
    assert there[name].half > 2.0 * known[name].half
    for key in ("spring.rl.k", "damper.rl.c", "damper.rr.c"):  # which depend on no constant
        assert there[key].half == pytest.approx(known[key].half, rel=0.2), key
    noise = run_information(drive("sine"), wider, draws=1).noise
    changes = [wider.model.names.index(f"bump_stop.front.{constant}") for constant in ("gap", "n")]
    assert not noise[changes].any()
    assert noise[place, place] > 0.0
    gap, exponent = there["bump_stop.front.gap"], there["bump_stop.front.n"]
    assert (gap.value, gap.unit, exponent.value, exponent.unit) == (0.004, "m", 1.5, "")


def test_nothing_told_leaves_what_is_plausible():
    one = predicted(fitted("sine"), Information.none(fitted("sine").model))
    assert one.base.rank == 0
    assert half_widths(one) == pytest.approx([1.96 * q.prior for q in one.model.parameters])


def test_more_information_never_widens():
    now, run = fit_information(fitted("sine")), told("liftoff")
    before = predicted(fitted("sine"), now)
    kept = before.base.independent
    last = np.diag(before.covariance_iid)[kept]
    for duration in (5.0, 10.0, 30.0):
        then = np.diag(predicted(before, now + run.lasting(duration)).covariance_iid)[kept]
        assert np.all(then <= last * (1.0 + 1e-9))
        last = then
    assert np.min(last / np.diag(before.covariance_iid)[kept]) < 0.2


def test_intervals_are_as_the_fit_with_the_run_finds_them():
    one, both = fitted("sine"), fitted("sine", "liftoff")
    guess = half_widths(predicted(one, fit_information(one) + told("liftoff").lasting()))
    found, before = half_widths(both), half_widths(one)
    moved = found < 0.9 * before
    ratio = guess[moved] / found[moved]
    assert np.count_nonzero(moved) > 15
    assert np.exp(np.abs(np.mean(np.log(ratio)))) < 1.15
    assert np.mean((ratio > 0.7) & (ratio < 1.4)) > 0.9, dict(zip(np.flatnonzero(moved), ratio, strict=True))


def test_twice_the_time_is_as_two_runs_where_zeros_are_known():
    run = replace(told("liftoff"), prior=np.full_like(told("liftoff").prior, 1e-9))
    twice, double = run.lasting() + run.lasting(), run.lasting(2.0 * run.seconds + run.edges)
    size = np.sqrt(np.diag(twice.normal))
    size[size == 0.0] = 1.0
    assert np.max(np.abs(double.normal - twice.normal) / np.outer(size, size)) < 1e-6


def test_a_model_that_fits_worse_learns_less():
    one = fitted("sine")
    now = Information.none(one.model)
    good = run_information(drive("sine"), one, {}, draws=2)
    bad = run_information(drive("sine"), one, dict.fromkeys(drive("sine").rows, 3.0), draws=2)
    ratio = half_widths(predicted(one, now + bad.lasting())) / half_widths(predicted(one, now + good.lasting()))
    k = [one.model.names.index(name) for name in ("spring.fl.k", "damper.rl.c")]
    assert ratio[k] == pytest.approx([2.8] * 2, abs=0.3)  # zeros known beforehand do not get worse
    sheet = residual_excess(one)
    assert all(1.0 <= value < 1.5 for value in sheet.values())
    doubled = replace(one, sigma={row: 2.0 * s for row, s in one.sigma.items()})
    assert all(2.0 * sheet[row] >= residual_excess(doubled)[row] >= 1.6 for row in sheet)


def test_pitch_inertia_asks_for_lift_off_and_the_goal_ends_it():
    one = fitted("sine")
    now, runs = fit_information(one), [told("sine"), told("liftoff")]
    found = rank(one, now, runs, VEHICLE, 30.0, ["YY6"])
    assert [r.index for r in found.runs] == [1, 0]
    best = found.runs[0]
    assert best.shrinks[0].before == pytest.approx(half_widths(one)[one.model.names.index("YY6")])
    assert best.worth > np.log(3.0)
    assert best.factor == pytest.approx(np.exp(best.worth))
    loose = rank(one, now, runs, VEHICLE, 30.0, ["YY6"], goal=0.99)
    assert loose.runs[0].worth == 0.0
    short = rank(one, now, runs, VEHICLE, 30.0, ["YY6"], goal=0.05)
    assert [r.index for r in short.runs] == [1, 0]


def test_what_is_poorly_known_is_found_and_what_is_out_of_reach_is_said():
    one = fitted("sine")
    found = rank(one, fit_information(one), [told("liftoff")], VEHICLE, 30.0)
    assert "YY6" in found.targets
    known = quantities(one, VEHICLE)
    for name in one.model.names:
        wide = known[name].half > 0.02 * known[name].size
        assert wide == (name in found.targets or name in found.out_of_reach), name
    assert "XX11" in found.out_of_reach
    assert not set(found.targets) & set(found.out_of_reach)


def test_names_are_matched_or_refused():
    known = quantities(fitted("sine"), VEHICLE)
    assert chosen(known, ["damper.f?.c", "Iyy"]) == ["damper.fl.c", "damper.fr.c", "Iyy"]
    with pytest.raises(UsageError, match="YY6"):
        chosen(known, ["YY66"])
