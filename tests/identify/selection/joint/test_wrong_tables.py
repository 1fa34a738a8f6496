"""Bench tables that could be wrong in place of a part of a law found: against fits with wrong tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.compliance import JOINTS
from lacet.daq.joint_tables import JointCurve, JointTables
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.effects.suspension.anti_roll_bar import AntiRollBar
from lacet.identify.effects.suspension.bench_table import CamberTable, ToeTable
from lacet.identify.effects.suspension.centre_slopes import Jacking
from lacet.identify.effects.suspension.wheel_turn import CamberChange
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.candidate import Confounded
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.wrong_tables import axles_without_tables, confounded_with
from lacet.identify.selection.rest import added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.validation.noise_floor import floor_of
from tests.identify import cars, exact_car

PLAIN, RIG = cars.reference_car()
FILTERS = Filters(rate=100.0, pre_cutoff=None)
BAR = AntiRollBar("rear")
MODEL = exact_car.MODEL + BAR
CAMBER = list(JOINTS).index("camber")


def straight(corner: Corner) -> Corner:
    """The corner with straight tables: in roll the camber changes as that of a twist beam, in bump hardly."""
    s = np.array([-0.1, 0.0, 0.1])
    own, other = (JointCurve(s, np.outer(s, [0.05, -0.03, 0.02, camber, 0.0])) for camber in (-0.3, 0.28))
    return replace(corner, joints=JointTables(own, other, None, {}), driven=False)


VEHICLE = replace(PLAIN, corners={c: straight(one) if c[0] == "r" else one for c, one in PLAIN.corners.items()})


def drive(rolling: float) -> Recording:
    """A drive with noise: the rear rolls with the lateral acceleration, `rolling` of it, and heaves as it may.

    The tables have no tolerance, which would be a part of the intervals.
    """
    t = np.arange(1000) / FILTERS.rate
    curves = cars.drive_curves(np.random.default_rng(21))
    signals = cars.exact_signals(curves, t)
    parts = {part: dict(getattr(signals, part)) for part in ("value", "rate", "accel")}
    for c in ("rl", "rr"):  # of side force at the contact point
        parts["value"][f"wheel.{c}.moment"] = np.outer([1.0, 0.0, 0.0], 1500.0 * signals.value["imu.accel"][1])
    for order, part in enumerate(parts.values()):
        left, right = (part[f"laser.{c}.hub"] for c in ("rl", "rr"))
        heave, roll = 0.5 * (left + right), 0.5 * (left - right)
        roll = rolling * 0.006 * curves["imu.accel"].at(t, order)[1:2] + (1.0 - rolling) * roll
        part["laser.rl.hub"], part["laser.rr.hub"] = heave + roll, heave - roll
    record = cars.recording(replace(signals, **parts), VEHICLE, RIG, FILTERS)
    record = cars.fulfil(record, MODEL.physics, np.append(exact_car.theta(), 1000.0))
    noise = draw_noise(record, record.signals.value, np.random.default_rng(22))
    values = {name: a + noise[name] for name, a in record.signals.value.items()}
    return record.with_signals(Signals.differentiated(values, FILTERS.rate))


def fitted(record: Recording) -> Fit:
    return fit(MODEL, [PreparedRun(record)], FitOptions(draws=2))


def found(one: Fit) -> tuple[float, dict[str, Confounded]]:
    """The size of the bar with the sheet's tolerances, and the tables that it is confounded with."""
    space = ScoreTests.of(Linearisation.of(one, floor_of(one, 19)), [CamberTable("rear"), ToeTable("rear")], 0)
    (law,) = (law for law in added_laws(space) if law.key == BAR.key)
    return float(law.values[0]), {table.key: table for table in confounded_with(space, law)}


def off(vehicle: Vehicle, part: float) -> Vehicle:
    """The car whose rear tables of the camber say less by this part."""
    corners = dict(vehicle.corners)
    for c in ("rl", "rr"):
        joints = corners[c].joints
        assert joints is not None
        assert joints.other is not None
        factor = np.ones(len(JOINTS))
        factor[CAMBER] -= part
        own, other = (JointCurve(one.at, one.values * factor) for one in (joints.own, joints.other))
        tables = replace(joints, own=own, other=other, product=joints.product * factor)
        corners[c] = replace(corners[c], joints=tables)
    return replace(vehicle, corners=corners)


def test_a_bar_in_turns_alone_is_confounded_with_a_table() -> None:
    """And its size changes with a wrong table by what is said."""
    record = drive(rolling=1.0)
    right, tables = found(fitted(record))
    one = tables["camber_table.rear"]
    assert -SELECTION.table_error <= one.low < 0.0 < one.high <= SELECTION.table_error
    wrong, others = found(fitted(replace(record, vehicle=off(VEHICLE, 0.2))))
    each = one.share * abs(right) / max(abs(one.low), abs(one.high))
    assert abs(wrong - right) / 0.2 == pytest.approx(each, rel=0.2)
    # The car's table is a quarter more than the file's, which says a fifth less.
    assert others["camber_table.rear"].low < 0.25
    assert others["camber_table.rear"].low > 0.1


def test_travel_of_its_own_makes_a_bar_known_by_itself() -> None:
    assert not found(fitted(drive(rolling=0.5)))[1]


def test_an_axle_without_tables_is_said_to_be_one() -> None:
    """Where its wheels are found to turn or to move with the travel; a bar says nothing of that."""
    found = [BAR, CamberChange("rear"), Jacking("front")]
    assert axles_without_tables(found, PLAIN) == ("rear", "front")
    assert axles_without_tables(found, VEHICLE) == ("front",)
    assert not axles_without_tables([BAR], PLAIN)
