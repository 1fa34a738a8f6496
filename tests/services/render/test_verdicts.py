"""Parts of a verdict's text that depend on numbers alone."""

from __future__ import annotations

from lacet.identify.selection.settings import SELECTION
from lacet.services.render.verdicts import or_a_length


def test_another_place_of_the_inertial_unit_may_be_a_wrong_length_of_the_car() -> None:
    """Far beyond its tolerance only, and of that axis."""
    far = 2.0 * SELECTION.reported_tolerances
    assert or_a_length({"sensor_position.imu.x": -far, "gain of wheel.fl.force.z": far}) == (
        " A wrong wheelbase in the vehicle file does what another place of the inertial unit does: measure both."
    )
    assert "wheel-centre height" in or_a_length({"sensor_position.imu.z": far})
    assert or_a_length({"sensor_position.imu.x": 0.3 * far, "gain of imu.accel.x": far}) == ""
