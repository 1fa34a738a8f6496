"""The inertial unit's position from the car's equations: where the rig says, and 128 mm from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.validation.channels import wrong_places
from lacet.identify.validation.channels.fault_columns import FaultColumns
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.identify.validation.channels.unit_position import unit_position
from lacet.identify.validation.channels.wrong_places import Misplaced
from lacet.services.render.channels import from_equations
from lacet.services.render.sensor_report import position_table
from tests.support.tables import CAR, piece, without

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
KNOWN = catalogue(VEHICLE, "hub")
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")


def moved(*by: float) -> Rig:
    """The rig with the inertial unit elsewhere in the file."""
    sensors = []
    for sensor in RIG.sensors:
        if sensor.name == "imu":
            x = sensor.position[""]
            sensor = replace(sensor, position={"": (x[0] + by[0], x[1] + by[1], x[2] + by[2])})
        sensors.append(sensor)
    return replace(RIG, sensors=tuple(sensors))


def fitted(rig: Rig, names: tuple[str, ...] = ("sine", "rough", "sweep"), *gone: str) -> Fit:
    runs = [PreparedRun.of(without(piece(name, 2.0, 14.0), *gone), VEHICLE, rig) for name in names]
    return fit(Model.of([*(e for e in KNOWN.values() if e.base), *(KNOWN[key] for key in BARS)]), runs)


def test_a_unit_128_mm_from_where_the_rig_says_is_found_where_it_is() -> None:
    found = unit_position(fitted(moved(0.128, -0.03, 0.0)))
    assert [one.axis for one in found] == ["x", "y", "z"]
    true = RIG.sensor_of("imu.accel").position[""]
    for one, x in zip(found, true, strict=True):
        assert one.half < 0.005
        assert one.testable
        assert one.found == pytest.approx(x, abs=1.5 * one.half + 0.002)
    assert [one.agrees for one in found] == [False, False, True]
    assert "differs from the rig by -128" in position_table(found)


def test_a_unit_where_the_rig_says_agrees() -> None:
    found = unit_position(fitted(RIG))
    assert all(one.testable and one.agrees for one in found)
    assert position_table(found).count("agrees") == 3


def test_runs_that_hardly_turn_say_nothing_of_it() -> None:
    x, y, z = unit_position(fitted(moved(0.128, 0.0, 0.0), ("liftoff",)))
    assert not x.testable
    assert not y.testable
    assert z.agrees
    assert "not testable with these runs" in position_table([x, y, z])


def test_without_a_row_of_the_chassis_there_is_no_position() -> None:
    assert unit_position(fitted(RIG, ("sine",), "wheel.fl.force")) == []


def test_a_unit_at_another_place_is_named_when_runs_are_read_beside_anti_roll_bars_that_are_missing() -> None:
    runs = [PreparedRun.of(piece(name, 2.0, 22.0), VEHICLE, moved(0.128, 0.0, 0.0)) for name in ("sine", "rough")]
    (found,) = column_faults(runs)
    assert isinstance(found, Misplaced)
    assert found.off == {"x": pytest.approx(-0.128, abs=0.04)}
    assert "rough (2.0 to 22.0 s): the inertial unit is not where the rig says" in from_equations(found)


def test_a_unit_that_only_suspension_and_tyre_rows_want_elsewhere_is_where_the_rig_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A law that a suspension lacks, as a bump stop, may want that; in the chassis rows it does not act."""
    off, sound = (
        [PreparedRun.of(piece(name, 2.0, 22.0), VEHICLE, rig) for name in ("sine", "rough")]
        for rig in (moved(0.128, 0.0, 0.0), RIG)
    )
    right = {run.name: FaultColumns.of_kinds(run, ["chassis"]) for run in sound}
    assert right["sine"].count < FaultColumns.of(off[0]).count
    monkeypatch.setattr(FaultColumns, "of_kinds", lambda run, kinds, lengths: right[run.name])
    assert not [found for found in column_faults(off) if isinstance(found, Misplaced)]


def pulled(run: Run, mass: float) -> Run:
    """A run of a car that a trailer of this mass pulls at the rear axle, against its acceleration."""
    accel = run.signals["imu.accel"]
    signals = dict(run.signals)
    for name in ("wheel.rl.force", "wheel.rr.force"):
        values = signals[name].values.copy()
        for k in (0, 1):
            values[:, k] += 0.5 * mass * np.interp(signals[name].t, accel.t, accel.values[:, k])
        signals[name] = replace(signals[name], values=values)
    return replace(run, signals=signals)


def test_a_force_on_the_body_that_the_model_lacks_does_not_move_the_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chassis rows want the unit elsewhere too, and are hardly better for it."""
    towing = [
        PreparedRun.of(pulled(piece(name, 2.0, 14.0), 300.0), VEHICLE, RIG) for name in ("liftoff", "sine", "rough")
    ]
    assert not [found for found in column_faults(towing) if isinstance(found, Misplaced)]
    monkeypatch.setattr(wrong_places, "_PART_OF_ROWS", 0.0)
    assert [found for found in column_faults(towing) if isinstance(found, Misplaced)]
