"""Compliance that the tables lack: what a motion without it is off by is what the effects' columns say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.compliance import Compliance
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.suspension.wheel_compliance import LateralCompliance, LongitudinalCompliance
from tests.identify import cars

PLAIN, RIG = cars.reference_car()
JOINTED = cars.with_joints(PLAIN)
N = 20
SMALL = 1e-9
"""Compliance [m/N, rad/N], small so that differences are derivatives."""


def motion(vehicle: Vehicle) -> Motion:
    """Rear wheels straight ahead and upright, whose loads in body axes are those of a bench."""
    signals = cars.random_signals(2, N)
    straight = {f"camera.{c}.{k}": np.zeros((1, N)) for c in CORNERS for k in ("steer", "camber")}
    return build_motion(cars.recording(replace(signals, value={**signals.value, **straight}), vehicle, RIG))


def with_compliance(load: str, change: dict[int, float], other: float) -> Vehicle:
    """The car whose rear wheels give: places of the joints and their change per unit of load."""
    slopes = np.zeros(5)
    for place, value in change.items():
        slopes[place] = value
    # Loads and half track are outwards: what shifts a wheel outwards shifts the other one inwards.
    mirrored = slopes * (-1.0 if load == "lateral" else 1.0)
    given = Compliance({load: slopes}, {load: other * mirrored})
    return replace(
        JOINTED,
        corners={
            c: replace(k, joints=replace(k.joints, compliance=given)) if c[0] == "r" else k  # type: ignore[arg-type]
            for c, k in JOINTED.corners.items()
        },
    )


@pytest.mark.parametrize("other", [0.0, 1.0])
@pytest.mark.parametrize(
    ("kind", "load", "parameter", "change"),
    [
        (LateralCompliance, "lateral", 0, {0: SMALL}),
        (LongitudinalCompliance, "traction", 0, {1: SMALL}),
        (LongitudinalCompliance, "traction", 1, {4: SMALL}),
    ],
)
def test_columns_are_what_a_motion_without_compliance_is_off_by(
    kind: type[LateralCompliance], load: str, parameter: int, change: dict[int, float], other: float
) -> None:
    """Left sides and tyre deflection of the car without it, less those of the car that gives."""
    bare, gives = motion(JOINTED), motion(with_compliance(load, change, other))
    columns = kind("rear", {"other": other}).columns(bare)
    assert any(row.startswith("chassis") for row in columns)
    for row, table in columns.items():
        column, found = table[parameter], Row.parse(row)
        if row.startswith("tyre"):
            before, after = (m.corners[found.place] for m in (bare, gives))
            load_along = np.sum(before.force * before.normal, axis=0)
            firm = before.deflection > 0.1 * np.mean(before.deflection)
            deeper = np.where(firm, (after.deflection - before.deflection) * load_along / before.deflection, 0.0)
            off = bare.measured(found) - gives.measured(found) + deeper
        else:
            off = bare.measured(found) - gives.measured(found)
        expected = SMALL * 1e6 * column
        np.testing.assert_allclose(off, expected, rtol=0.03, atol=2e-3 * np.max(np.abs(expected)) + 1e-9, err_msg=row)
