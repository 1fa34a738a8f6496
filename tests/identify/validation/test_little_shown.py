"""Runs that show too little for a verdict: a standing car, and few samples; and none that shows enough."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensor_offsets import Zeros
from lacet.identify.validation.little_shown import little_shown
from lacet.identify.validation.score import Comparison, score_row
from lacet.services.render.little_shown import little_shown_lines, little_shown_result
from tests.support.tables import CAR, piece

RIG = Rig.load(CAR / "rig.toml")
VEHICLE = Vehicle.load(CAR / "vehicle.toml")
ROWS = [Row.parse(name) for name in ("tyre.fl", "tyre.fr", "spin.fl", "chassis.fx")]


def at_rest(run: Run, speed: float) -> Run:
    """The run's means with the noise of its sheet, at a speed of the wheels [rad/s]."""
    rng = np.random.default_rng(1)
    values = {}
    for name, signal in run.signals.items():
        mean = np.mean(signal.values, axis=0)
        if CHANNELS[name].family in ("wheel.speed", "correvit.speed"):
            mean = np.full(len(mean), speed)
        values[name] = mean + RIG.noise(name) * rng.normal(size=signal.values.shape)
    return run.with_values(values)


def prepared(run: Run) -> PreparedRun:
    return PreparedRun.of(run, VEHICLE, RIG)


def compared(name: str, samples: int, ratios: Mapping[str, float]) -> Comparison:
    """A comparison with these ratios of error to floor, all others 1."""
    scores = {}
    for row in ROWS:
        residual = np.ones(samples)
        scores[row] = replace(score_row(row, residual, residual, 1.0), ratio=ratios.get(str(row), 1.0))
    return Comparison(name, {}, {}, {}, scores, (Zeros((), np.zeros(0), {}), np.zeros(0)), True, {}, 20.0)


@pytest.mark.parametrize(("speed", "stands"), [(0.0, True), (40.0, False)])
def test_a_car_that_hardly_moves_gives_no_verdict(speed: float, stands: bool) -> None:
    run = prepared(at_rest(piece(), speed))
    found = little_shown([run], [compared(run.name, 140, {"tyre.fl": 3.2})])
    (still,) = found.still
    assert (still.run, still.stands) == (run.name, stands)
    assert still.variation == pytest.approx(1.0, abs=0.2)
    assert found.few is None
    assert not found.model_fails
    (line,) = little_shown_lines(little_shown_result(found))
    assert ("the car stands for" if stands else "the car hardly moves for") in line
    assert "springs, dampers, inertias" in line


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_runs_that_move_are_not_still(name: str) -> None:
    run = prepared(piece(name))
    found = little_shown([run], [compared(run.name, 200, {"tyre.fl": 3.2})])
    assert found.still == ()
    assert found.model_fails
    assert little_shown_lines(little_shown_result(found)) == []


def test_rows_of_few_samples_fail_by_chance() -> None:
    run = prepared(piece())
    found = little_shown([run], [compared(run.name, 21, {"tyre.fr": 1.25, "spin.fl": 1.22})])
    assert found.few is not None
    assert found.few.rows == (f"{run.name}: tyre.fr", f"{run.name}: spin.fl")
    assert found.few.samples == 21
    assert 0.01 < found.few.p <= 1.0
    assert not found.model_fails
    (line,) = little_shown_lines(little_shown_result(found))
    assert "too short for a verdict. Of 21 samples" in line


def test_the_length_that_is_asked_for_is_enough() -> None:
    """An error of 1.2 floors is none of chance with as many samples, and is with some fewer."""
    run = prepared(piece())
    few = little_shown([run], [compared(run.name, 21, {"tyre.fr": 1.21})]).few
    assert few is not None
    filters = run.recording.filters
    enough = int(np.ceil((few.seconds - 2.0 * filters.edge) * filters.rate / filters.step)) + 1
    assert little_shown([run], [compared(run.name, enough, {"tyre.fr": 1.2001})]).model_fails
    assert not little_shown([run], [compared(run.name, enough - 10, {"tyre.fr": 1.2001})]).model_fails


def test_a_large_error_of_few_samples_is_none_of_chance() -> None:
    run = prepared(piece())
    found = little_shown([run], [compared(run.name, 21, {"tyre.fr": 4.0, "spin.fl": 1.22})])
    assert found.model_fails
    assert found.few is None


def test_where_nothing_fails_nothing_is_said_of_length() -> None:
    run = prepared(piece())
    found = little_shown([run], [compared(run.name, 21, {})])
    assert (found.still, found.few, found.model_fails) == ((), None, False)


def test_studies_of_earlier_versions_say_nothing() -> None:
    assert little_shown_lines({}) == []
