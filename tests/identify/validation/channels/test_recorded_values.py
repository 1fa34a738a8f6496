"""Columns that stand still and columns that are copies, in runs of the reference car; and none where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.identify.validation.channels.recorded_values import StandStill, copied_columns, resting_stretches
from lacet.services.workspace.loading import load
from tests.identify.validation.channels.spoilt_columns import series_of, with_column
from tests.support.tables import CAR, piece, without, written

RIG = Rig.load(CAR / "rig.toml")
EVERY = [column for column, (channel, _) in COLUMNS.items() if not channel.optional]


def at_rest(run: Run) -> list[StandStill]:
    """Columns that stand still, by stretch."""
    return [found for found, _ in resting_stretches(run, RIG)]


@pytest.mark.parametrize("column", EVERY)
@pytest.mark.parametrize("value", [0.0, 14.0])
def test_a_column_that_stands_still_all_the_time_is_told_with_its_seconds(column: str, value: float) -> None:
    run = piece()
    (found,) = at_rest(with_column(run, column, value))
    assert found.values == {column: value}
    t = run.signals[COLUMNS[column][0].name].t
    assert (found.start, found.stop) == (t[0], t[-1])


def test_a_column_that_stops_is_told_from_then_on() -> None:
    run = piece()
    column = "laser.rl.hub"
    t, values = run.signals[column].t, series_of(run, column).copy()
    dead = t > 11.0
    values[dead] = values[~dead][-1]
    (found,) = at_rest(with_column(run, column, values))
    assert [*found.values] == [column]
    assert found.start == pytest.approx(11.0, abs=0.01)
    assert found.stop == t[-1]


def test_columns_that_stop_together_are_told_together(tmp_path: Path) -> None:
    """A logger that hangs for two seconds, and one laser that is dead longer."""
    run = piece()
    hung = ["imu.accel.x", "imu.rate.z", "wheel.fl.force.x", "laser.fl.hub"]
    for column in [*hung, "laser.rr.hub"]:
        t, values = run.signals[COLUMNS[column][0].name].t, series_of(run, column).copy()
        still = (t >= 8.0) & (t <= (10.0 if column in hung else 12.0))
        values[still] = values[still][0]
        run = with_column(run, column, values)
    found = sorted(at_rest(run), key=lambda one: one.stop)
    assert [sorted(one.values) for one in found] == [sorted(hung), ["laser.rr.hub"]]
    said = load([written(run, tmp_path / "run.parquet")], CAR / "rig.toml", CAR / "vehicle.toml").warnings
    (together,) = (line for line in said if "stand still together" in line)
    assert "4 columns stand still together from 8.00 to 10.00 s" in together
    assert all(column in together for column in hung)


def test_a_value_held_over_several_rows_is_no_rest() -> None:
    """A slow instrument in a fast table, and a coarse one."""
    run = piece()
    held = np.repeat(series_of(run, "camera.fl.steer")[::5], 5)[: run.signals["camera.fl.steer"].t.size]
    run = with_column(run, "camera.fl.steer", held)
    coarse = np.round(series_of(run, "laser.fl.hub"), 3)
    assert at_rest(with_column(run, "laser.fl.hub", coarse)) == []


def test_a_rounded_column_is_no_rest() -> None:
    """Of 2 mm or 0.25 m/s², equal for a while where the car holds still; one that stops while others of its
    kind move by several steps is at rest."""
    run = piece("liftoff")
    for column in EVERY:
        step = {"laser": 0.002, "imu": 0.25}.get(column.partition(".")[0])
        if step is not None and ("laser" in column or "accel" in column):
            run = with_column(run, column, step * np.round(series_of(run, column) / step))
    assert at_rest(run) == []
    column = "laser.rl.hub"
    values = series_of(run, column).copy()
    values[run.signals[column].t > 5.0] = values[0]
    (found,) = at_rest(with_column(run, column, values))
    assert [*found.values] == [column]


def test_a_car_that_stands_has_no_column_at_rest() -> None:
    """Wheels and road stand still together, while the loads have their noise."""
    run = piece()
    for channel in (c for c in CHANNELS.values() if c.family in ("wheel.speed", "wheel.angle", "correvit.speed")):
        run = run.with_values({channel.name: 0.0 * run.signals[channel.name].values})
    assert at_rest(run) == []


@pytest.mark.parametrize(("column", "of"), [
    ("laser.fr.hub", "laser.fl.hub"), ("wheel.rl.force.z", "wheel.rr.force.z"), ("imu.rate.y", "imu.rate.x"),
    ("camera.fr.steer", "camera.fl.steer"), ("laser.rr.ground", "laser.rr.hub"),
])  # fmt: skip
def test_a_copy_is_told_with_what_it_is_a_copy_of(column: str, of: str) -> None:
    run = piece()
    (found,) = copied_columns(with_column(run, column, series_of(run, of)))
    assert set(found.columns) == {column, of}


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_said_of_sound_runs(name: str) -> None:
    run = open_run(CAR / f"{name}.parquet")
    assert at_rest(run) == []
    assert copied_columns(run) == []


@pytest.mark.parametrize("gone", ["imu.", "imu.accel", "correvit", "laser.", "camera.fl", "wheel.", "wheel.fl.speed"])
def test_what_was_not_measured_is_no_fault(gone: str) -> None:
    run = without(piece(), gone)
    assert at_rest(run) == []
    assert copied_columns(run) == []


def test_a_user_is_told_when_runs_are_read(tmp_path: Path) -> None:
    run = with_column(piece(), "wheel.fl.force.x", 14.0)
    run = with_column(run, "laser.fr.hub", series_of(run, "laser.fl.hub"))
    file = written(run, tmp_path / "run.parquet")
    said = load([file], CAR / "rig.toml", CAR / "vehicle.toml").warnings
    assert any("run: wheel.fl.force.x stands still at 14 from 5.00 to 15.00 s while others" in line for line in said)
    assert any("run: laser.fr.hub is laser.fl.hub again, sample by sample" in line for line in said)
