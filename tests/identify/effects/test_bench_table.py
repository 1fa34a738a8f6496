"""Bench tables off in proportion: what a motion with the tables of the file is off by is what the columns say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.joint_tables import JointCurve
from lacet.daq.vehicle import Corner
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.effects.suspension.bench_table import CamberTable, HalfTrackTable, HalfWheelbaseTable, ToeTable
from tests.identify import cars

PLAIN, RIG = cars.reference_car()
JOINTED = cars.with_joints(PLAIN)
SMALL = 1e-6


def off(corner: Corner, place: int) -> Corner:
    """The corner with one joint's curves and product by both travels larger by a small part."""
    assert corner.joints is not None
    factor = np.ones(5)
    factor[place] += SMALL
    assert corner.joints.other is not None
    own, other = (JointCurve(one.at, one.values * factor) for one in (corner.joints.own, corner.joints.other))
    return replace(corner, joints=replace(corner.joints, own=own, other=other, product=corner.joints.product * factor))


@pytest.mark.parametrize(
    ("kind", "place"), [(HalfTrackTable, 0), (HalfWheelbaseTable, 1), (ToeTable, 2), (CamberTable, 3)]
)
def test_columns_are_what_a_motion_with_the_file_s_tables_is_off_by(kind: type[PhysicalEffect], place: int) -> None:
    """Left sides with the file's tables, less those of the car; of rear wheels, whose spin rows have no torque."""
    signals = cars.random_signals(6, 20)
    # A bearing passes no moment about the wheel's axis.
    free = {f"wheel.{c}.moment": signals.value[f"wheel.{c}.moment"] * [[1.0], [0.0], [1.0]] for c in CORNERS}
    signals = replace(signals, value={**signals.value, **free})
    car = replace(JOINTED, corners={c: off(k, place) if c[0] == "r" else k for c, k in JOINTED.corners.items()})
    file, right = (build_motion(cars.recording(signals, one, RIG)) for one in (JOINTED, car))
    columns = kind("rear").columns(file)
    assert {row.partition(".")[0] for row in columns} >= {"suspension"}
    for row, column in columns.items():
        difference = (file.measured(Row.parse(row)) - right.measured(Row.parse(row))) / SMALL
        np.testing.assert_allclose(difference, column[0], rtol=1e-3, atol=1e-3 * np.max(np.abs(column)), err_msg=row)


def test_only_axles_with_tables_can_have_wrong_ones() -> None:
    assert not CamberTable.variants(PLAIN, "hub")
    assert [one.key for one in CamberTable.variants(JOINTED, "hub")] == ["camber_table.front", "camber_table.rear"]
