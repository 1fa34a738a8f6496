"""Columns in other units and with other signs that their values show beside others of their kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import COLUMNS
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.channels.recorded_faults import recorded_faults
from lacet.identify.validation.channels.sizes import (
    SteersAgainst,
    negative_distances,
    opposed_steer,
    other_sizes,
    quiet_columns,
    unmirrored_camber,
)
from lacet.services.render.channels import sentence
from tests.identify.validation.channels.spoilt_columns import series_of, spoilt_column, with_column
from tests.support.tables import CAR, piece, without

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")


@pytest.mark.parametrize("column", [c for c, (channel, _) in COLUMNS.items() if not channel.optional and "wheel" in c])
def test_a_wheel_s_column_in_thousands_is_quieter_than_its_noise(column: str) -> None:
    run = spoilt_column(piece(), column, "÷ 1000")
    found = [*quiet_columns(run, RIG), *other_sizes(run, RIG)]
    assert {one.column for one in found} == {column}


def test_a_load_cell_that_is_dead_but_for_a_little_noise_is_named() -> None:
    run = piece()
    load = series_of(run, "wheel.fr.force.z")
    run = with_column(run, "wheel.fr.force.z", 14.0 + 1e-3 * (load - load.mean()))
    (found,) = quiet_columns(run, RIG)
    assert "wheel.fr.force.z varies by " in sentence(found)
    assert "it is dead, or recorded in a larger unit" in sentence(found)


@pytest.mark.parametrize("column", ["wheel.rl.force.z", "camera.fl.camber", "camera.rr.steer", "laser.fr.ground"])
def test_a_column_in_thousandths_is_larger_than_the_others(column: str) -> None:
    (found,) = other_sizes(spoilt_column(piece(), column, "× 1000"), RIG)
    assert found.column == column
    assert 500.0 < found.size / found.others < 2000.0
    assert f"{column} is " in sentence(found)
    assert sentence(found).endswith("is it in another unit?")


@pytest.mark.parametrize("corner", ["fl", "fr", "rl", "rr"])
@pytest.mark.parametrize("factor", [1.0 / 4.448, 4.448, 10.0])
def test_a_load_in_pounds_is_told_by_the_loads_of_the_other_axle(corner: str, factor: float) -> None:
    """With what its axle's other wheel carries in the proportion of the other axle's."""
    run, column = piece(), f"wheel.{corner}.force.z"
    (found,) = other_sizes(with_column(run, column, factor * series_of(run, column)), RIG)
    assert found.column == column
    assert found.size / found.others == pytest.approx(factor, rel=0.2)
    assert "is it in another unit?" in sentence(found)


def test_the_inner_wheels_of_a_circle_have_no_other_unit() -> None:
    """They carry a part of what the outer ones do, and not of both axles the same; an axle may be heavier."""
    run = piece()
    for corner, factor in (("fl", 0.25), ("rl", 0.6)):
        run = with_column(run, f"wheel.{corner}.force.z", factor * series_of(run, f"wheel.{corner}.force.z"))
    assert [found.column for found in other_sizes(run, RIG)] == ["wheel.fl.force.z"]  # straight on
    circle = with_column(run, "imu.accel.y", 5.0 + series_of(run, "imu.accel.y"))
    assert other_sizes(circle, RIG) == []
    rear = piece()
    for corner in ("rl", "rr"):
        rear = with_column(rear, f"wheel.{corner}.force.z", 0.3 * series_of(rear, f"wheel.{corner}.force.z"))
    assert other_sizes(rear, RIG) == []


@pytest.mark.parametrize("column", ["laser.fl.hub", "laser.rr.ground"])
def test_a_distance_below_zero_has_the_wrong_sign(column: str) -> None:
    (found,) = negative_distances(spoilt_column(piece(), column, "sign"))
    assert sentence(found).startswith(f"{column} is -")


@pytest.mark.parametrize("column", ["camera.fl.steer", "camera.fr.steer"])
def test_the_front_wheel_that_steers_against_the_turn_is_named(column: str) -> None:
    run = PreparedRun.of(spoilt_column(piece(), column, "sign"), VEHICLE, RIG)
    found = opposed_steer(run)
    assert found is not None
    assert found.column == column
    assert found.slope == pytest.approx(-1.0, abs=0.2)
    assert f"{column} steers against the other front wheel" in sentence(found)


def test_without_a_yaw_rate_one_of_the_two_steers_against_the_other() -> None:
    run = spoilt_column(without(piece(), "imu"), "camera.fl.steer", "sign")
    found = opposed_steer(PreparedRun.of(run, VEHICLE, RIG))
    assert isinstance(found, SteersAgainst)
    assert found.column == ""
    assert "one of camera.fl.steer and camera.fr.steer steers" in sentence(found)


def leaning(run: Run, left: float, right: float) -> Run:
    """The run with rear wheels that lean."""
    for column, camber in (("camera.rl.camber", left), ("camera.rr.camber", right)):
        run = with_column(run, column, series_of(run, column) - series_of(run, column).mean() + camber)
    return run


def test_wheels_of_an_axle_that_lean_to_the_same_side_are_named() -> None:
    assert unmirrored_camber(leaning(piece(), 0.018, -0.017), RIG) == []
    (found,) = unmirrored_camber(leaning(piece(), 0.018, 0.017), RIG)
    assert found.columns == ("camera.rl.camber", "camera.rr.camber")
    assert "both wheels lean to the same side" in sentence(found)
    assert unmirrored_camber(leaning(piece(), 0.002, 0.001), RIG) == []  # the cameras' zeros


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_said_of_sound_runs(name: str) -> None:
    run = open_run(CAR / f"{name}.parquet")
    assert recorded_faults(run, PreparedRun.of(run, VEHICLE, RIG)) == []


def test_front_wheels_that_toe_in_and_out_without_a_turn_have_no_wrong_sign() -> None:
    """On a straight, rough road bump steer turns the wheels against each other, by more than the driver does."""
    run = piece()
    rng = np.random.default_rng(4)
    signals = dict(run.signals)
    slow = np.convolve(rng.standard_normal(len(signals["camera.fl.steer"].t) + 49), np.ones(50) / 50.0, "valid")
    for column, side in (("camera.fl.steer", 1.0), ("camera.fr.steer", -1.0)):
        signal = signals[column]
        signals[column] = replace(signal, values=0.05 * signal.values + side * 0.02 * slow[:, None])
    bumpy = replace(run, signals=signals)
    left, right = (bumpy.signals[c].values[:, 0] for c in ("camera.fl.steer", "camera.fr.steer"))
    assert np.corrcoef(left, right)[0, 1] < -0.75
    assert opposed_steer(PreparedRun.of(bumpy, VEHICLE, RIG)) is None
