"""The shipped vehicle file and the simulated car are the same car."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.simulate.cars import find_car

VEHICLE = Vehicle.load("peugeot-406")


@pytest.mark.parametrize("corner", CORNERS)
def test_the_simulated_car_has_the_same_geometry(corner):
    car, mine = find_car("peugeot-406"), VEHICLE.corners[corner]
    axle = car.axle(corner)
    assert mine.position == pytest.approx(car.wheel_centres[CORNERS.index(corner)], abs=1e-6)
    assert mine.height == pytest.approx(car.heights[CORNERS.index(corner)], abs=1e-6)
    assert mine.tyre_radius == axle.radius
    if axle.steered:
        assert (mine.caster, mine.kingpin_inclination) == pytest.approx((axle.caster, axle.kingpin_inclination))
    assert mine.driven == axle.driven
    numbers = VEHICLE.numbers
    place = f"axle.{'front' if corner[0] == 'f' else 'rear'}"
    assert numbers[f"{place}.static_camber"].value == pytest.approx(axle.camber)
    assert numbers[f"{place}.static_toe"].value == pytest.approx(axle.toe)


def test_the_simulated_car_has_the_a_priori_values():
    car, value = find_car("peugeot-406"), {key: q.value for key, q in VEHICLE.apriori.items()}
    assert value["mass"] == value["M6"] == car.total.mass
    assert [value[f"cog.{axis}"] for axis in "xyz"] == pytest.approx(car.total.com)
    tensor = np.asarray(car.total.tensor)
    assert [value["Ixx"], value["Iyy"], value["Izz"], value["Ixz"]] == [*np.diag(tensor), tensor[0, 2]]
    wheels = {"rl": 14, "rr": 23, "fl": 32, "fr": 41}
    for corner in CORNERS:
        axle = car.axle(corner)
        assert value[f"spring.{corner}.k"] == axle.stiffness
        assert value[f"damper.{corner}.c"] == axle.damping
        assert value[f"tyre_stiffness.{corner}.kt"] == axle.tyre_stiffness
        assert value[f"ZZ{wheels[corner]}"] == axle.spin_inertia
