"""Samples that are no measurement are flagged in runs of the reference car, and none is where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.channels import COLUMNS, CORNERS
from lacet.daq.errors import NotIdentifiable
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.identify.validation.channels.recorded_values import StandStill
from lacet.identify.validation.channels.unusable_values import (
    NoiseAlone,
    RangeEnd,
    SentinelValue,
    without_unusable,
)
from lacet.services.workspace.loading import load
from tests.identify.validation.channels.spoilt_columns import series_of, with_column
from tests.support.tables import CAR, piece, without, written

RIG = Rig.load(CAR / "rig.toml")


def some(run: Run, column: str, part: float = 0.01) -> np.ndarray:
    """Some of the samples of a column, by chance."""
    return np.random.default_rng(3).random(series_of(run, column).size) < part


def in_place(run: Run, column: str, where: np.ndarray, value: float) -> Run:
    """The run with one value at some samples of a column."""
    values = series_of(run, column).copy()
    values[where] = value
    return with_column(run, column, values)


def flagged(run: Run, column: str, flag: Flag) -> np.ndarray:
    """The samples of a column that have a flag."""
    return (run.signals[COLUMNS[column][0].name].flags & int(flag)) != 0


def said(run: Run, folder: Path) -> str:
    """Warnings when a run is read."""
    file = written(run, folder / "run.parquet")
    return "\n".join(load([file], CAR / "rig.toml", CAR / "vehicle.toml").warnings)


# -- sentinel values ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("column", "value"), [
    ("wheel.fl.force.z", -9999.0), ("imu.rate.z", 32767.0), ("laser.fr.ground", 1e10), ("imu.accel.x", -999.25),
])  # fmt: skip
def test_a_sentinel_is_flagged_and_said_with_value_count_and_time(column: str, value: float, tmp_path: Path) -> None:
    run = piece()
    where = some(run, column)
    spoilt = in_place(run, column, where, value)
    mended, (found,) = without_unusable(spoilt, RIG)
    first = run.signals[COLUMNS[column][0].name].t[np.argmax(where)]
    assert found == SentinelValue(column, value, int(np.count_nonzero(where)), first)
    np.testing.assert_array_equal(flagged(mended, column, Flag.STATUS), where)
    np.testing.assert_array_equal(series_of(mended, column), series_of(spoilt, column))
    (line,) = said(spoilt, tmp_path).splitlines()
    assert f"{column} is exactly {value:.6g} in {np.count_nonzero(where)} samples, the first at {first:.2f} s" in line


def test_a_laser_that_has_a_sentinel_for_a_stretch_is_named_once(tmp_path: Path) -> None:
    run = piece()
    column = "laser.fr.ground"
    t = run.signals[column].t
    lines = said(in_place(run, column, (t > 9.0) & (t < 10.6), 1e10), tmp_path).splitlines()
    assert [line for line in lines if column in line and "left out 9.0" not in line] == [lines[0]]
    assert "is exactly 1e+10 in" in lines[0]
    assert len(lines) == 2


def test_both_ends_may_be_sentinels() -> None:
    run = piece()
    column = "wheel.rr.force.x"
    low = some(run, column)
    spoilt = in_place(in_place(run, column, low, -1e5), column, np.roll(low, 7), 1e5)
    found = without_unusable(spoilt, RIG)[1]
    assert [one.value for one in found if isinstance(one, SentinelValue)] == [-1e5, 1e5]


def test_a_kerb_is_no_sentinel() -> None:
    """Rare peaks far above all else, of different heights, and one that comes twice by chance."""
    run = piece()
    column = "imu.accel.z"
    values = series_of(run, column).copy()
    values[[300, 900, 901, 1400]] += [80.0, 120.0, 40.0, 95.0]
    values[1900] = values[300]
    assert without_unusable(with_column(run, column, values), RIG)[1] == []


def test_a_switch_with_few_levels_is_no_sentinel() -> None:
    """A coarse steer of the rear wheels: hardly ever but zero."""
    run = piece()
    for corner in ("rl", "rr"):
        column = f"camera.{corner}.steer"
        values = np.zeros(series_of(run, column).size)
        values[500:520], values[900:940] = 0.001, -0.001
        values[910] = -0.003
        run = with_column(run, column, values)
    assert not any(isinstance(one, SentinelValue) for one in without_unusable(run, RIG)[1])


# -- the end of a range ------------------------------------------------------------------------------------------------


def test_a_clipped_load_is_at_the_end_of_its_range() -> None:
    run = piece()
    column = "wheel.rl.force.z"
    values = series_of(run, column)
    end = float(np.quantile(values, 0.8))
    mended, (found,) = without_unusable(with_column(run, column, np.minimum(values, end)), RIG)
    assert isinstance(found, RangeEnd)
    assert (found.column, found.value, found.highest) == (column, end, True)
    assert found.times > 3
    t = run.signals["wheel.rl.force"].t
    assert found.seconds == pytest.approx(0.2 * (t[-1] - t[0]), rel=0.02)
    np.testing.assert_array_equal(flagged(mended, column, Flag.RANGE), values >= end)


def test_where_nothing_remains_of_a_clipped_run_its_ends_are_the_reason(tmp_path: Path) -> None:
    """At each crest of a fast slalom, within the filters' transients of the next one."""
    run = piece()
    column = "imu.accel.y"
    values = series_of(run, column)
    low, high = np.quantile(values, [0.1, 0.9])
    with pytest.raises(NotIdentifiable) as raised:
        said(with_column(run, column, np.clip(values, low, high)), tmp_path)
    lines = str(raised.value)
    assert f"{column} is at its highest value {high:.6g}" in lines
    assert f"{column} is at its lowest value {low:.6g}" in lines
    assert "its range is exceeded" in lines
    assert "stands still" not in lines
    assert "exactly" not in lines


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_the_crest_of_a_coarse_column_is_no_end_of_a_range(step: float) -> None:
    """Levels of a half and of two of its own amplitudes' tenths."""
    run = piece()
    column = "imu.accel.y"
    values = series_of(run, column)
    width = step * 0.1 * float(np.std(values))
    assert without_unusable(with_column(run, column, np.round(values / width) * width), RIG)[1] == []


def test_a_steer_that_is_held_is_no_end_of_a_range() -> None:
    """Without noise, at the highest value twice, while the car leans and moves."""
    run = piece()
    for corner in CORNERS:
        column = f"camera.{corner}.steer"
        steer = np.round(np.sin(run.signals[column].t), 3)
        run = with_column(run, column, np.asarray(np.clip(steer, -0.7, 0.7), np.float64))
    assert not any(isinstance(one, RangeEnd) for one in without_unusable(run, RIG)[1])


def test_speeds_of_a_car_that_stands_before_and_after_are_no_ends_of_a_range() -> None:
    """Sensors of speed that are exactly zero below some speed; one wheel that is locked for a while."""
    run = piece()
    for channel in [name for name in run.signals if name.endswith(".speed")]:
        signal = run.signals[channel]
        values = np.abs(signal.values) * np.clip(np.minimum(signal.t - 7.0, 13.0 - signal.t), 0.0, 1.0)[:, None]
        if channel == "wheel.fr.speed":
            values[(signal.t > 9.0) & (signal.t < 9.3)] = 0.0
        run = run.with_values({channel: values})
    mended, found = without_unusable(run, RIG)
    assert [(type(one), one.left_out) for one in found if isinstance(one, StandStill)] == [(StandStill, False)] * len(
        found
    )
    assert mended is run


def test_loads_that_are_zero_on_a_rig_between_lifts_are_no_ends_of_a_range() -> None:
    """All wheels in the air at the same time: nothing moves."""
    run = without(piece(), "correvit", "wheel.fl.speed", "wheel.fr.speed", "wheel.rl.speed", "wheel.rr.speed")
    for corner in CORNERS:
        channel = f"wheel.{corner}.force"
        signal = run.signals[channel]
        values = np.abs(signal.values) * np.clip(np.minimum(signal.t - 7.0, 13.0 - signal.t), 0.0, 1.0)[:, None]
        run = run.with_values({channel: values})
    assert without_unusable(run, RIG)[1] == []


# -- dead stretches ----------------------------------------------------------------------------------------------------


def test_a_stuck_stretch_of_a_table_is_flagged_and_its_sound_seconds_are_used(tmp_path: Path) -> None:
    run = piece()
    column = "laser.rl.hub"
    t = run.signals[column].t
    still = t >= 11.0
    spoilt = in_place(run, column, still, float(series_of(run, column)[still][0]))
    mended, (found,) = without_unusable(spoilt, RIG)
    assert isinstance(found, StandStill)
    assert found.left_out
    np.testing.assert_array_equal(flagged(mended, column, Flag.STUCK), still)
    file = written(spoilt, tmp_path / "run.parquet")
    loaded = load([file], CAR / "rig.toml", CAR / "vehicle.toml")
    assert any("Those samples are left out" in line for line in loaded.warnings)
    recording = loaded.prepared[0].recording
    usable = recording.usable[column]
    assert not usable[recording.t > 11.0].any()
    assert usable[recording.t < 10.0].any()


def test_every_stuck_stretch_is_flagged() -> None:
    run = piece()
    column = "laser.rl.hub"
    t = run.signals[column].t
    still = ((t > 7.0) & (t < 8.5)) | ((t > 12.0) & (t < 13.0))
    values = series_of(run, column).copy()
    for a, b in ((7.0, 8.5), (12.0, 13.0)):
        inside = (t > a) & (t < b)
        values[inside] = values[inside][0]
    mended, (found,) = without_unusable(with_column(run, column, values), RIG)
    assert isinstance(found, StandStill)
    assert found.more == 1
    np.testing.assert_array_equal(flagged(mended, column, Flag.STUCK), still)


def test_a_frozen_steering_angle_is_flagged_and_a_brake_may_rest() -> None:
    """Optional channels, too: a rack that is read has noise, whatever is steered; nobody brakes for minutes."""
    run, rng = piece("sine", 2.0, 22.0), np.random.default_rng(2)
    steer = run.signals["camera.fl.steer"]
    angle = 15.0 * steer.values + 0.002 * rng.standard_normal(steer.values.shape)
    frozen = (steer.t > steer.t[0] + 6.0) & (steer.t < steer.t[0] + 9.0)
    angle[frozen] = angle[frozen][0]
    pressure = np.where(steer.t[:, None] < steer.t[0] + 12.0, 0.0, 1e5 + 1e3 * rng.standard_normal(angle.shape))
    more = {"steering.angle": replace(steer, values=angle), "brake.pressure": replace(steer, values=pressure)}
    sound, found = without_unusable(replace(run, signals={**run.signals, **more}), RIG)
    (one,) = found
    assert isinstance(one, StandStill)
    assert list(one.values) == ["steering.angle"]
    np.testing.assert_array_equal(flagged(sound, "steering.angle", Flag.STUCK), frozen)
    assert sound.signals["brake.pressure"].usable.all()


def test_a_column_without_noise_is_said_and_used() -> None:
    """A steer of the rear wheels that is zero but for a while: coarse, and no sensor that is stuck."""
    run = piece()
    for corner in ("rl", "rr"):
        column = f"camera.{corner}.steer"
        values = np.zeros(series_of(run, column).size)
        values[500:520], values[900:940] = 0.001, -0.001
        run = with_column(run, column, values)
    mended, found = without_unusable(run, RIG)
    assert not any(isinstance(one, StandStill) and one.left_out for one in found)
    assert mended.signals["camera.rl.steer"].usable.all()


def test_a_rear_steer_filled_with_zeros_is_used() -> None:
    run = piece()
    for corner in ("rl", "rr"):
        run = with_column(run, f"camera.{corner}.steer", 0.0)
    mended = without_unusable(run, RIG)[0]
    assert mended.signals["camera.rl.steer"].usable.all()


@pytest.mark.parametrize(("column", "noise"), [("wheel.fr.force.z", 30.0), ("laser.fr.hub", 0.0003)])
def test_a_column_that_falls_to_noise_is_dead_from_then_on(column: str, noise: float, tmp_path: Path) -> None:
    run = piece()
    values = series_of(run, column).copy()
    dead = run.signals[COLUMNS[column][0].name].t >= 10.0
    values[dead] = noise * np.random.default_rng(1).normal(size=np.count_nonzero(dead))
    spoilt = with_column(run, column, values)
    mended, (found,) = without_unusable(spoilt, RIG)
    assert isinstance(found, NoiseAlone)
    assert found.start == pytest.approx(10.0, abs=0.01)
    np.testing.assert_array_equal(flagged(mended, column, Flag.STUCK), dead)
    lines = said(spoilt, tmp_path)
    assert f"{column} has noise alone" in lines
    assert "from 10.00 to 15.00 s" in lines
    assert "thousandths" not in lines


def test_all_wheels_that_become_quiet_are_not_dead() -> None:
    """The car comes to rest."""
    run = piece()
    rng = np.random.default_rng(1)
    for corner in CORNERS:
        for axis in "xyz":
            column = f"wheel.{corner}.force.{axis}"
            values = series_of(run, column).copy()
            rest = run.signals[f"wheel.{corner}.force"].t >= 10.0
            values[rest] = values[rest][0] + 30.0 * rng.normal(size=np.count_nonzero(rest))
            run = with_column(run, column, values)
    assert without_unusable(run, RIG)[1] == []


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_sound_runs_keep_every_sample(name: str) -> None:
    run = open_run(CAR / f"{name}.parquet")
    assert without_unusable(run, RIG) == (run, [])
