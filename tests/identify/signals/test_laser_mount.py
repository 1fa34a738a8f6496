"""Where a corner's lasers are, by the row of the rig file that says it."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.identify.signals.for_equations import for_equations, laser_mount, stands_in_for
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


def signal(*values: float) -> Signal:
    """One sample of a scalar or a vector."""
    return Signal(np.zeros(1), np.array([values]), np.zeros(1, np.uint8))


def test_travel_stands_in_for_a_hub_laser_that_is_not_measured_alone():
    """At design height less the travel; a laser that is measured stays as it is."""
    signals = {
        "laser.fl.hub": signal(0.4), "suspension.fl.travel": signal(0.01), "suspension.fr.travel": signal(0.02),
        "engine.speed": signal(100.0), "imu.rate": signal(0.1, 0.2, 0.3), "car.yaw_rate": signal(0.4),
        "gnss.speed": signal(20.0),
    }  # fmt: skip
    run, rig = for_equations(Run("a", signals), VEHICLE, Rig.parse(HEAD + HUB))
    found = run.signals
    assert rig == Rig.parse(HEAD + HUB)  # it has no sensor of the travel
    assert set(found) == {"laser.fl.hub", "laser.fr.hub", "imu.rate", "gnss.speed"}
    assert found["laser.fl.hub"].values[0, 0] == pytest.approx(0.4)
    assert found["laser.fr.hub"].values[0, 0] == pytest.approx(0.3 - 0.02)
    assert stands_in_for("suspension.fr.travel") == ("laser.fr.hub",)
    assert stands_in_for("gnss.speed") == ("correvit.speed",)
    assert stands_in_for("engine.speed") == ()


POTS = """
[[sensor]]
name = "pots"
channels = ["suspension.fl.travel", "suspension.fr.travel"]
position = { fl = [9.0, 9.0, 9.0], fr = [9.0, 9.0, 9.0] }
latency = 0.010
noise = { "suspension.travel" = 0.0005 }
tolerance = { "suspension.travel.zero" = 0.003 }
"""


def test_travel_that_stands_in_has_its_own_sensor_s_latency_noise_and_tolerances() -> None:
    """And the mount of the corner's lasers; a corner with a laser keeps it. Once more changes nothing."""
    given = Rig.parse(HEAD + HUB + GROUND + MOUNT + POTS)
    signals = {"laser.fl.hub": signal(0.4), "suspension.fr.travel": signal(0.02), "suspension.rl.travel": signal(0.0)}
    run, rig = for_equations(Run("a", signals), VEHICLE, given)
    assert set(run.signals) == {"laser.fl.hub", "laser.fr.hub", "laser.rl.hub"}
    assert [sensor.channels for sensor in rig.sensors][-1] == ("suspension.fl.travel", "laser.fr.hub")
    assert (rig.latency("laser.fr.hub"), rig.noise("laser.fr.hub")) == (0.010, 0.0005)
    assert (rig.tolerance("laser.fr.hub", "zero"), rig.tolerance("laser.fr.hub", "gain")) == (0.003, 0.002)
    assert rig.tolerance("laser.fr.hub", "drift") == 0.0
    assert rig.latency("laser.fl.hub") == rig.latency("laser.rl.hub") == 0.0
    np.testing.assert_allclose(
        laser_mount(rig, VEHICLE.corners["fr"]), np.add(VEHICLE.corners["fr"].position, (0, 0, 0.3))
    )
    again, same = for_equations(run, VEHICLE, rig)
    assert (again, same) == (run, rig)
