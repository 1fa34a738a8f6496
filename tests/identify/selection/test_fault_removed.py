"""A sensor fault that its first-order column does not tell is taken out of the runs by the fit with it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lacet.identify.effects.base import SensorFault
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import Fit, FitOptions, extended, fit, refitted
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.chow_test import ParameterConstancy, chow_test_in_model
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import _as_found, diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.rest import AddedLaw, added_faults, departures_on_rows
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE

HUB, CUBIC = "sensor_gain.hub.fl", "spring_cubic.front"


def scaled(record: Recording, by: float) -> Recording:
    """A front hub laser that reads so much too much of its distance."""
    fault = KNOWN[HUB]
    assert isinstance(fault, SensorFault)
    return recording_without_faults(record, [fault], np.array([1.0 / (1.0 + by) - 1.0]))


def diagnosed(record: Recording) -> Diagnosis:
    """What is said of a drive with noise."""
    fitted = fit_of(driven(record, 1))
    return diagnose(fitted, floor_of(fitted, DRAWS), CANDIDATES)


def holds(found: Diagnosis, by: float) -> bool:
    """Whether the laser's scale is proposed, with an interval that holds what it reads too much."""
    (scale,) = (c for c in found.found if c.key == HUB)
    return abs(scale.values[0] - by) <= scale.interval[0] < 0.3 * by


@pytest.mark.parametrize(
    ("k3", "by"),
    [pytest.param(0.0, 0.09, marks=pytest.mark.slow), pytest.param(1.0e6, 0.03, marks=pytest.mark.slow), (1.0e6, 0.09)],
)
def test_a_scale_is_named_that_first_order_does_not_tell(k3: float, by: float):
    """Alone, and beside a stiffening spring, for which a moved zero is another stiffness."""
    found = diagnosed(scaled(exact_with(KNOWN[CUBIC], k3) if k3 else exact(), by))
    assert {c.key for c in found.found} == ({HUB, CUBIC} if k3 else {HUB}), says(found)
    assert holds(found, by)
    assert not found.unlisted


@pytest.mark.parametrize("by", [0.03, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_scale_beside_a_cause_that_is_not_listed_leaves_it_unlisted(by: float):
    """What is not listed is told beside it."""
    found = diagnosed(scaled(exact_with(HIDDEN, SIZE), by))
    assert found.unlisted, says(found)
    assert set(found.unlisted_rows) & {"suspension.fl", "suspension.fr"}


def test_the_fit_beside_the_fault_is_as_the_one_before():
    """Without zeros or the bias of noise taken out where that was so, and with seconds that count less."""
    drive = driven(scaled(exact(), 0.05), 1)
    plain = fit(MODEL, [drive], FitOptions(zeros=False, unbias=False))
    beside = extended(plain, [KNOWN[HUB]])
    assert not beside.assembly.zeros
    assert not beside.options.zeros
    assert not np.any(beside.correction)
    assert not beside.assembly.weights
    assert KNOWN[HUB] in beside.model.effects
    robust = extended(fit(MODEL, [drive], FitOptions(robust=True, draws=2)), [KNOWN[HUB]])
    assert robust.assembly.weights
    assert robust.options.robust
    assert robust.assembly.zeros
    assert np.any(robust.correction)


def test_a_fault_removed_from_the_runs_is_judged_by_all_of_it():
    """By the size that it had, in its own fit and in one of the runs without it; what remains of it is next to none."""
    fault = KNOWN[HUB]
    drives = [driven(scaled(exact(), 0.05), seed) for seed in (1, 2)]
    first = extended(fit(MODEL, drives, FitOptions(draws=2)), [fault])
    again = refitted(first, first.runs)
    size = first.value(f"{HUB}.g")
    assert size == pytest.approx(0.05, rel=0.1)
    assert abs(again.value(f"{HUB}.g")) < 0.1 * size

    def judged(fitted: Fit, removed: dict[str, float]) -> tuple[AddedLaw, float, ParameterConstancy]:
        space = ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), [KNOWN["coulomb.rear"]], 0)
        rows = [row for row in space.sums.over_runs.rows if row.kind == "suspension"]
        (change,) = departures_on_rows(space, [fault], rows, removed)
        (law,) = added_faults(space, removed)
        constancy = chow_test_in_model(space, law)
        assert constancy is not None
        return law, change.force, constancy

    whole, other = judged(first, {}), judged(again, {HUB: size})
    assert whole[0].values[0] == pytest.approx(size, rel=0.1)
    assert other[0].values[0] == pytest.approx(whole[0].values[0], rel=0.02)
    assert other[0].force == pytest.approx(whole[0].force, rel=0.05)
    assert other[1] == pytest.approx(whole[1], rel=0.05)
    for _, _, constancy in (whole, other):
        assert [float(value[0]) for value in constancy.values.values()] == pytest.approx([size, size], rel=0.1)
        assert not constancy.differ_by_more_than(0.01)
    assert whole[0].force > 1e3
    assert whole[0].implausible is other[0].implausible is None
    assert judged(again, {HUB: 1.1})[0].implausible is not None
    for fitted in (first, again):
        for piece in fitted.assembly.pieces():
            zeros = fitted.zeros[piece.run][2]
            for row, measured in piece.right.items():
                direct = measured - piece.blocks[row] @ np.concatenate([zeros, fitted.solution])
                np.testing.assert_allclose(direct, fitted.residual[piece.run][row], atol=1e-6 * np.ptp(measured))


def test_a_latency_removed_from_the_runs_is_tied_with_what_looks_the_same() -> None:
    """The inertial unit early or the lasers late: without wheel loads there is no third instrument."""
    imu, laser, camera = (KNOWN[f"sensor_latency.{name}"] for name in ("imu", "laser", "camera"))
    alone = tuple(
        Candidate(one.key, {}, gain=0.9, total_gain=0.9, drop=900.0, p=0.005, values=(0.04,), interval=(0.005,))
        for one in (imu, laser, camera)
    )
    alike = {laser.key: 0.9999, camera.key: 0.4}
    first = SimpleNamespace(correlation=lambda one, other: alike[other])
    joint = cast(Joint, SimpleNamespace(alone=alone, removed=(imu,), first=first))
    assert _as_found(joint, imu, 199).ties == ((laser.key, 0.9999),)
