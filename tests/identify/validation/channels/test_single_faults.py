"""One column with another sign, in another unit or late, from the car's equations; none in sound runs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import COLUMNS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.channels.fault_columns import FaultColumns, FaultEstimate
from lacet.identify.validation.channels.single_faults import (
    ColumnFault,
    Fault,
    Suspects,
    _wrong_scale,
    column_faults,
)
from lacet.identify.validation.channels.wrong_places import AboutContact, Misplaced
from lacet.services.render.channels import from_equations
from lacet.simulate import exchange_run, make_manoeuvre
from lacet.simulate import run as simulate_drive
from lacet.simulate.linkage import SecondCar
from lacet.simulate.vehicle_file import vehicle_text
from tests.identify.validation.channels.spoilt_columns import LATE, series_of, spoilt_column, with_column
from tests.support.tables import CAR, piece, without

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")


def prepared(run: Run) -> PreparedRun:
    return PreparedRun.of(run, VEHICLE, RIG)


@cache
def run_of(name: str) -> Run:
    return piece(name, 2.0, 22.0)


@pytest.mark.parametrize(("column", "name"), [
    ("wheel.fl.force.y", "sine"), ("wheel.rr.force.x", "liftoff"), ("wheel.rl.moment.x", "sine"),
])  # fmt: skip
def test_a_wrong_sign_is_named_with_the_factor_that_the_equations_need(column: str, name: str) -> None:
    (found,) = column_faults([prepared(spoilt_column(run_of(name), column, "sign"))])
    assert isinstance(found, ColumnFault)
    assert (found.column, found.fault) == (column, Fault.SIGN)
    assert found.value == pytest.approx(-1.0, abs=max(0.1, 2.0 * found.half))
    assert found.remaining < found.misfit
    assert f"{column} has the wrong sign" in from_equations(found)


def test_wheels_with_mirrored_axes_are_named_together() -> None:
    """Of the right side, as of a maker whose axes point outwards: of the second is seen what the first has hidden."""
    run = run_of("sine")
    mirrored = ("wheel.fr.force.y", "wheel.rr.force.y")
    for column in mirrored:
        run = spoilt_column(run, column, "sign")
    (found,) = column_faults([prepared(run)])
    assert isinstance(found, ColumnFault)
    assert sorted([found.column, *found.others]) == sorted(mirrored)
    assert found.value == pytest.approx(-1.0, abs=0.1)
    assert "have the wrong sign: the car's equations need" in from_equations(found)


def test_moments_about_the_contacts_are_no_higher_inertial_unit() -> None:
    """Both do the same to the moments of the whole car; the spin rows of free wheels know the one from the other."""
    runs: list[PreparedRun] = []
    for name in ("sine", "liftoff"):
        run = run_of(name)
        for corner in ("fl", "fr", "rl", "rr"):
            radius = VEHICLE.corners[corner].tyre_radius
            of_x, of_y = (series_of(run, f"wheel.{corner}.moment.{axis}") for axis in "xy")
            side, along = (series_of(run, f"wheel.{corner}.force.{axis}") for axis in "yx")
            run = with_column(run, f"wheel.{corner}.moment.x", of_x - radius * side)
            run = with_column(run, f"wheel.{corner}.moment.y", of_y + radius * along)
        runs.append(prepared(run))
    (found,) = column_faults(runs)
    assert isinstance(found, AboutContact)
    assert found.remaining < found.misfit
    assert "about the contact of tyre and road" in from_equations(found)


@pytest.mark.parametrize("column", ["wheel.fl.moment.x", "wheel.fr.force.y"])
def test_a_unit_is_named_with_its_factor(column: str) -> None:
    (found,) = column_faults([prepared(spoilt_column(run_of("sine"), column, "× 1000"))])
    assert isinstance(found, ColumnFault)
    assert (found.column, found.fault, found.unit) == (column, Fault.UNIT, "thousandths of its unit")
    assert "recorded in thousandths of its unit" in from_equations(found)


def test_a_scale_that_changes_within_the_run_is_no_unit() -> None:
    """A load that dies, with more noise than its sheet has."""
    run = run_of("sine")
    column = "wheel.fr.force.z"
    values = series_of(run, column).copy()
    late = run.signals["wheel.fr.force"].t > 12.0
    values[late] = 100.0 * np.random.default_rng(0).normal(size=np.count_nonzero(late))
    (found,) = column_faults([prepared(with_column(run, column, values))])
    assert isinstance(found, ColumnFault)
    assert (found.column, found.fault, found.unit) == (column, Fault.UNSTEADY, "")
    assert len(found.halves) == 2
    line = from_equations(found)
    assert f"{column} has no constant scale" in line
    assert "thousandths" not in line


@pytest.mark.parametrize(("column", "name"), [("laser.fr.hub", "rough"), ("imu.accel.z", "rough")])
def test_a_late_column_is_named_with_its_delay(column: str, name: str) -> None:
    """30 ms are more than a first-order estimate reaches: the delay is removed and estimated again."""
    (found,) = column_faults([prepared(spoilt_column(run_of(name), column, "late"))])
    assert isinstance(found, ColumnFault)
    assert (found.column, found.fault) == (column, Fault.LATE)
    assert found.value == pytest.approx(LATE, abs=0.006)  # both anti-roll bars are missing in the model
    assert "ms later than the rig says" in from_equations(found)


def test_runs_with_the_same_fault_share_a_line() -> None:
    runs = [prepared(spoilt_column(run_of(name), "wheel.fl.force.y", "sign")) for name in ("sine", "sweep")]
    (found,) = column_faults(runs)
    assert list(found.runs) == ["sine", "sweep"]
    assert from_equations(found).startswith("sine (2.0 to 22.0 s), sweep (2.0 to 22.0 s): wheel.fl.force.y has the ")


def test_where_no_column_is_at_fault_for_sure_those_to_look_at_are_named() -> None:
    """Two faults at once, of which neither alone explains the misfit."""
    run = spoilt_column(run_of("sine"), "wheel.fl.force.y", "× 1000")
    (found,) = column_faults([prepared(spoilt_column(run, "wheel.rr.force.y", "× 1000"))])
    assert isinstance(found, Suspects)
    assert {"wheel.fl.force.y", "wheel.rr.force.y"} <= set(found.columns)
    assert found.misfit > 100.0
    assert "Check these channels first" in from_equations(found)


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_said_of_sound_runs(name: str) -> None:
    """Both anti-roll bars are missing in the base model, and no channel is blamed for it."""
    assert column_faults([prepared(run_of(name))]) == []


def test_a_wrong_sign_is_not_named_where_the_rows_by_themselves_show_the_right_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a car lacks can look like a reversed column in all rows together, and in none alone."""
    spoilt, column = prepared(spoilt_column(run_of("sine"), "wheel.rl.moment.x", "sign")), "wheel.rl.moment.x"
    of_spoilt, of_sound = FaultColumns.by_row(spoilt), FaultColumns.by_row(prepared(run_of("sine")))
    (shown,) = (one.scale for one in of_spoilt[Row.parse("chassis.mx")].estimates() if one.column == column)
    assert shown == pytest.approx(-1.0, abs=0.2)
    monkeypatch.setattr(FaultColumns, "by_row", lambda run: of_spoilt if run is spoilt else {})
    assert [fault.column for fault in column_faults([spoilt]) if isinstance(fault, ColumnFault)] == [column]
    monkeypatch.setattr(FaultColumns, "by_row", lambda run: of_sound)
    assert not any(isinstance(fault, ColumnFault) for fault in column_faults([spoilt]))
    both = {**of_spoilt, Row.parse("chassis.mx"): of_sound[Row.parse("chassis.mx")]}
    monkeypatch.setattr(FaultColumns, "by_row", lambda run: both)
    assert not any(isinstance(fault, ColumnFault) for fault in column_faults([spoilt]))


def test_dampers_that_both_wheels_of_a_live_axle_move_are_no_fault() -> None:
    """On a rough road they are worth more than the wheels' camber moments, which then seemed to have the other sign."""
    pytest.importorskip("mujoco")
    car = SecondCar.named("second-live-axle")
    run = exchange_run(simulate_drive(car, make_manoeuvre("rough", duration=3.0), [], 0), RIG, 0, name="rough")
    products = FaultColumns.of(PreparedRun.of(run, Vehicle.parse(vehicle_text(car)), RIG))
    assert products is not None
    assert products.misfit < 1.3
    scales = {one.column: one for one in products.estimates()}
    for column in ("wheel.rl.moment.x", "wheel.rr.moment.x"):
        assert scales[column].scale > scales[column].scale_spread


def test_zeros_that_differ_from_run_to_run_are_no_fault() -> None:
    """Within the sheet: half a millimetre of a laser is a hundred newtons of its tyre."""
    runs = [run_of(name) for name in ("sine", "rough", "sweep")]
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (len(runs), len(COLUMNS)))
    moved: list[PreparedRun] = []
    for run, each in zip(runs, signs, strict=True):
        for sign, (column, (channel, _)) in zip(each.tolist(), COLUMNS.items(), strict=True):
            if channel.name in run.signals:
                off = sign * RIG.tolerance(channel.name, "zero")
                run = with_column(run, column, series_of(run, column) + off)
        moved.append(prepared(run))
    assert column_faults(moved) == []


@pytest.mark.parametrize("gone", ["imu.", "laser.", "wheel.fl", "camera.fl", "correvit"])
def test_what_was_not_measured_is_no_fault(gone: str) -> None:
    assert column_faults([prepared(without(run_of("sine"), gone))]) == []


def test_products_of_runs_add_up() -> None:
    one, other = (FaultColumns.of(prepared(run_of(name))) for name in ("sine", "rough"))
    assert one is not None
    assert other is not None
    both = FaultColumns.joined([one, other])
    assert both.block_count == one.block_count + other.block_count
    assert both.count == one.count + other.count
    assert both.misfit >= (one.misfit * one.count + other.misfit * other.count) / both.count


@pytest.mark.parametrize(("scale", "fall", "sign"), [(-3.3, 0.6, False), (-3.3, 2.2, True), (-1.05, 0.3, True)])
def test_a_column_that_should_be_reversed_and_far_larger_stands_in_for_another_fault(
    scale: float, fall: float, sign: bool
) -> None:
    """Unless that explains nearly all: a unit 0.4 m off its place wanted one wheel's force -3.3 times."""
    misfit = 3.4  # so that 2.4 are above the floor
    one = FaultEstimate("wheel.fr.force.x", scale, 0.1, 0.0, 1.0, fall, 0.0, 0.01, 0.01)
    found = _wrong_scale(one, misfit, 0.5)
    assert (found is not None and found[0] is Fault.SIGN) == sign


def test_where_most_remains_a_length_may_be_wrong_and_not_the_place_of_the_unit() -> None:
    place = {"runs": {"rough": (0.0, 20.0)}, "off": {"x": 0.218}, "half": {"x": 0.027}}
    assert "a length may be wrong in its place" in from_equations(Misplaced(misfit=4.34, remaining=4.19, **place))
    assert "measure it again" in from_equations(Misplaced(misfit=4.34, remaining=1.2, **place))
