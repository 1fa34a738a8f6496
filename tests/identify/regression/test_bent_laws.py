"""Laws that bend within the noise of the travel rate: fitted by their expectation given the record, without bias."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Bend, PhysicalEffect, SuspensionForce, expected_columns, in_turn
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.noise_floor import floor_of
from tests.identify import cars
from tests.identify import exact_car as exact

FRICTION = 45.0
LAW = replace(exact.KNOWN["coulomb.front"], shape={"v0": 0.002})


def calm(seconds: float, law: PhysicalEffect = LAW, size: float = FRICTION) -> Recording:
    """A drive with travel rates of some 20 mm/s, of a car that has friction, by default with a band of 2 mm/s; no
    noise."""
    curves = cars.drive_curves(np.random.default_rng(1))
    for name, curve in curves.items():
        if name.endswith("hub"):
            curve.a = 0.15 * curve.a
    t = np.arange(round(seconds * cars.RATE)) / cars.RATE
    record = cars.recording(cars.exact_signals(curves, t), exact.VEHICLE, exact.RIG, Filters())
    return cars.fulfil(record, (*exact.MODEL.effects, law), np.append(exact.theta(), size))


def measured(record: Recording, seed: int) -> PreparedRun:
    """The drive with the sheet's noise."""
    return PreparedRun(exact.driven(record, seed).recording.smoothed())


@pytest.mark.parametrize("key", ["coulomb.front", "bump_stop.rear", "spring_cubic.front"])
def test_columns_of_an_axle_are_those_of_its_corners(key: str) -> None:
    """Whether the corners were asked for before or not: to 1e-10 the law's own columns, filtered."""
    effect = exact.KNOWN[key].shapes()[0]
    assert isinstance(effect, SuspensionForce)
    drive = measured(calm(6.0), 0)
    expected = drive.decimated({Row.parse(row): series for row, series in effect.columns(drive.motion).items()})
    first, then = drive.uncached(), drive.uncached()
    then.prepare(effect.parts())
    for one in (first, then):
        found = one.columns(effect)
        assert list(found) == list(expected)
        for row, columns in expected.items():
            np.testing.assert_allclose(found[row], columns, rtol=1e-10, atol=1e-10 * np.max(np.abs(columns)))


def test_friction_and_damping_have_no_bias() -> None:
    """Mean over four seeds of noise; with the law at the measured rate friction is 28 % high and damping 29 % low."""
    record, stored, found = calm(40.0), None, list[Array]()
    for seed in range(4):
        fitted = fit(exact.MODEL + LAW, [measured(record, seed)], FitOptions(draws=3), stored=stored)
        stored = stored or fitted.stored
        values = [fitted.value(name) for name in ("coulomb.front.f", "damper.fl.c", "damper.fr.c")]
        found.append(np.array(values) / [FRICTION, 1700.0, 1700.0] - 1.0)
    assert np.all(np.abs(np.mean(found, axis=0)) < 0.04)


@pytest.mark.parametrize(("bend", "law"), [
    (Bend.RATE, lambda travel, rate: np.tanh(rate / 0.002)),
    (Bend.RATE, lambda travel, rate: np.sign(rate) * np.maximum(0.0, np.abs(rate) - 0.01)),
    (Bend.TRAVEL, lambda travel, rate: np.maximum(0.0, travel)),
])  # fmt: skip
def test_the_expectation_is_the_mean_over_the_conditional_distribution(
    bend: Bend, law: Callable[[Array, Array], Array]
) -> None:
    """Against a mean over many draws of it, the linear part of a law of the rate at the measured rate; where signals
    are exact it is the law itself."""
    motion = measured(calm(8.0), 0).motion
    corner = motion.corners["fl"]
    assert corner.conditional is not None
    given, rng = corner.conditional, np.random.default_rng(0)

    def columns(at: Sequence[Motion]) -> dict[str, Array]:
        found = [one.corners["fl"] for one in at]
        return {"suspension.fl": np.concatenate([law(one.travel, one.rate) for one in found])[None]}

    expected = expected_columns(columns, motion, ["fl"], bend)["suspension.fl"][0]
    drawn = np.zeros((2000, expected.size))
    for one in drawn:
        z = rng.standard_normal(expected.size)
        travel = given.travel + (bend is Bend.TRAVEL) * z * given.travel_sigma
        one[:] = law(travel, given.rate + (bend is Bend.RATE) * z * given.rate_sigma)
    scatter, linear = float(np.max(drawn.std(axis=0))), np.zeros(expected.size)
    if bend is Bend.RATE:
        slope = (law(given.travel, given.rate_rms) - law(given.travel, -given.rate_rms)) / (2.0 * given.rate_rms)
        linear = slope * (corner.rate - given.rate)
    np.testing.assert_allclose(expected, drawn.mean(axis=0) + linear, atol=0.12 * scatter)
    still = replace(motion, corners={c: replace(one, conditional=None) for c, one in motion.corners.items()})
    np.testing.assert_array_equal(
        expected_columns(columns, still, ["fl"], bend)["suspension.fl"][0], law(corner.travel, corner.rate)
    )


def test_a_law_that_hardly_bends_is_a_damper() -> None:
    """Noise in it too: a column with the rate's noise smoothed away would explain the noise of the damper's."""
    motion = measured(calm(8.0), 0).motion

    def columns(at: Sequence[Motion]) -> dict[str, Array]:
        return {"suspension.fl": 5.0 * np.tanh(in_turn([one.corners["fl"].rate for one in at]) / 5.0)[None]}

    corner = motion.corners["fl"]
    assert corner.conditional is not None
    assert np.std(corner.rate - corner.conditional.rate) > 1e-3
    found = expected_columns(columns, motion, ["fl"], Bend.RATE)["suspension.fl"][0]
    np.testing.assert_allclose(found, corner.rate, atol=1e-6)


def test_laws_that_bend_share_the_motions_off_the_expected_one() -> None:
    """An axle's law has the columns of its corners, whichever is asked for first, and leaves the motion as it was."""
    motion = measured(calm(8.0), 0).motion
    before = motion.corners["fl"].rate.copy()

    def columns(at: Sequence[Motion]) -> dict[str, Array]:
        rates = {c: in_turn([one.corners[c].rate for one in at]) for c in ("fl", "fr")}
        return {f"suspension.{c}": np.tanh(rate / 0.002)[None] for c, rate in rates.items()}

    right = expected_columns(columns, motion, ["fr"], Bend.RATE)
    both = expected_columns(columns, motion, ["fl", "fr"], Bend.RATE)
    left = expected_columns(columns, motion, ["fl"], Bend.RATE)
    np.testing.assert_array_equal(both["suspension.fr"], right["suspension.fr"])
    np.testing.assert_array_equal(both["suspension.fl"], left["suspension.fl"])
    np.testing.assert_allclose(right["suspension.fl"], columns([motion])["suspension.fl"], rtol=1e-14)  # fl as measured
    assert np.any(np.abs(left["suspension.fl"] - right["suspension.fl"]) > 1e-3)
    np.testing.assert_array_equal(motion.corners["fl"].rate, before)
    moved = motion.off_expectation(("fl", "fr"), 0.0, 1.5)
    given = motion.corners["fr"].conditional
    assert given is not None
    np.testing.assert_array_equal(moved.corners["fr"].rate, given.rate + 1.5 * given.rate_sigma)
    assert moved.corners["rl"] is motion.corners["rl"]


def test_noise_in_the_residual_includes_what_the_law_is_not_told() -> None:
    """The floor of a run with friction: as large as the residual of the true parameters."""
    record = calm(40.0)
    run = measured(record, 5)
    values = np.append(exact.theta(), FRICTION)
    physics = (exact.MODEL + LAW).physics
    sensitivity = Sensitivity.of(run.recording, physics, values)
    draws = [run.decimated(sensitivity.noise(np.random.default_rng(k))) for k in range(12)]
    for row in run.rows:
        if row.kind == "suspension":
            residual = run.measured[row] - run.matrix(physics, row) @ values
            floor = np.sqrt(np.mean([np.mean(draw[row] ** 2) for draw in draws]))
            assert np.sqrt(np.mean(residual**2)) == pytest.approx(floor, rel=0.12), row


def test_a_law_that_bends_brings_its_linear_part_alone_into_the_residual() -> None:
    """What noise in the rate does through it there is what it does through a damper of the law's slope."""
    law = replace(exact.KNOWN["coulomb.fl"], shape={"v0": 0.002})
    run = measured(calm(12.0), 1)
    given = run.motion.corners["fl"].conditional
    assert given is not None
    slope = np.tanh(given.rate_rms[0] / 0.002) / given.rate_rms[0]
    fitted = fit(exact.MODEL + law, [run], FitOptions(draws=2))
    friction, damper = (list(fitted.columns).index(name) for name in ("coulomb.fl.f", "damper.fl.c"))
    through = fitted.moments.slopes
    assert np.any(through[:, :, damper] != 0.0)
    np.testing.assert_allclose(
        through[:, :, friction],
        slope * through[:, :, damper],
        rtol=1e-6,
        atol=1e-6 * np.max(np.abs(through[:, :, friction])),
    )
    assert np.any(
        np.abs(through[:, friction] - slope * through[:, damper]) > 0.1 * np.max(np.abs(through[:, friction]))
    )


def test_the_noise_floor_of_friction_holds_motion_that_the_pre_filter_stopped() -> None:
    """Of 30 mm/s, which only the axle with friction has to do with; the column holds it as well."""
    record, sigma = measured(calm(20.0), 0).recording, dict[float, dict[Row, float]]()
    for rms in (0.0, 0.03):
        drive = PreparedRun(record.smoothed(beyond=rms**2))
        sigma[rms] = dict(floor_of(fit(exact.MODEL + LAW, [drive], FitOptions(draws=2)), 60).sigma)
    ratio = {row: sigma[0.03][row] / sigma[0.0][row] for row in sigma[0.0]}
    assert all(ratio[Row(f"suspension.{c}")] > 1.3 for c in ("fl", "fr"))
    assert all(0.9 < ratio[Row(f"suspension.{c}")] < 1.1 for c in ("rl", "rr"))


DAHL = replace(exact.KNOWN["damper_hysteresis.front"], shape={"length": 0.004})
"""Friction that turns round over 4 mm."""


def test_friction_with_memory_follows_the_travel_expected_given_the_record() -> None:
    """And not the path of the noise, which would turn it round: it is nearer to what acts in the car."""
    exactly = calm(30.0, DAHL, 260.0)
    run = measured(exactly, 3)
    assert run.expects(DAHL)  # so that noise counts in what follows it alone
    true, motion = PreparedRun(exactly).motion, run.motion
    for c in ("fl", "fr"):
        corner = motion.corners[c]
        assert corner.conditional is not None
        (found,) = DAHL.columns(motion)[f"suspension.{c}"]
        np.testing.assert_array_equal(found, DAHL.path(corner.conditional.travel))
        acting = DAHL.path(true.corners[c].travel)
        assert np.std(found - acting) < 0.5 * np.std(DAHL.path(corner.travel) - acting)


def test_the_noise_floor_holds_what_noise_of_the_travel_does_to_friction_with_memory() -> None:
    """The residual of the true parameters is as large as the floor, in the rows with friction and the others."""
    run = measured(calm(40.0, DAHL, 260.0), 3)
    physics, values = (exact.MODEL + DAHL).physics, np.append(exact.theta(), 260.0)
    sensitivity = Sensitivity.of(run.recording, physics, values)
    draws = [run.decimated(drawn) for drawn in _each(sensitivity, 12)]
    without = Sensitivity.of(run.recording, exact.MODEL.physics, exact.theta())
    smaller = [run.decimated(drawn) for drawn in _each(without, 12)]
    for row in run.rows:
        if row.kind == "suspension":
            residual = run.measured[row] - run.matrix(physics, row) @ values
            floor, less = (np.sqrt(np.mean([np.mean(one[row] ** 2) for one in some])) for some in (draws, smaller))
            assert np.sqrt(np.mean(residual**2)) == pytest.approx(floor, rel=0.15), row
            assert (floor > 1.2 * less) == (row.place in ("fl", "fr"))


def _each(sensitivity: Sensitivity, count: int) -> list[dict[Row, Array]]:
    return [sensitivity.noise(np.random.default_rng(k)) for k in range(count)]
