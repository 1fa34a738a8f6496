"""Where a corner's lasers are, by the row of the rig file that says it."""

from __future__ import annotations

import pytest

from lacet.daq.rig import Rig
from lacet.identify.signals.for_equations import laser_mount
from tests.identify.exact_car import VEHICLE

HEAD = 'format = "lacet-rig 1"\nname = "x"\n'
HUB = '[[sensor]]\nname = "hub"\nchannels = ["laser.fl.hub"]\n'
GROUND = '[[sensor]]\nname = "ground"\nchannels = ["laser.fl.ground"]\n'
MOUNT = "position = [0.02, 0.8, 0.55]\n"
CENTRE = VEHICLE.corners["fl"].position


@pytest.mark.parametrize("rows", [HUB + MOUNT, GROUND + MOUNT, HUB + GROUND + MOUNT, HUB + MOUNT + GROUND])
def test_either_row_says_where_both_lasers_of_a_corner_are(rows: str):
    """A row of one corner needs no table by corner."""
    assert laser_mount(Rig.parse(HEAD + rows), VEHICLE.corners["fl"]) == pytest.approx((0.02, 0.8, 0.55))


@pytest.mark.parametrize(
    ("rows", "above"), [(HUB, 0.3), (GROUND + "position_from_wheel_centre = [0, 0, 0.4]\n" + HUB, 0.4)]
)
def test_without_a_position_they_are_above_the_wheel_centre(rows: str, above: float):
    mount = laser_mount(Rig.parse(HEAD + rows), VEHICLE.corners["fl"])
    assert mount == pytest.approx((CENTRE[0], CENTRE[1], CENTRE[2] + above))
