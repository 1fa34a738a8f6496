"""Estimated wheel forces in words: rounded as every value beside its interval."""

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.wheel_loads.measured_forces import ForceError
from lacet.identify.wheel_loads.outputs import EstimatedForce, EstimatedForces
from lacet.services.render.forces_text import forces_table
from lacet.services.render.intervals import half_width

HALVES = {"wheel.fl.force_estimated.z": 87.62, "car.force_estimated.x": 0.4371, "axle.front.force_estimated.y": 1264.0}


def test_half_widths_have_two_significant_digits():
    row = Row("suspension.fl")
    forces = {
        name: EstimatedForce(name, np.full(3, 4321.6), np.full(3, half), {"noise": half / 1.96}, row, 7.0)
        for name, half in HALVES.items()
    }
    found = EstimatedForces("sine", np.arange(3.0), forces, "hub", (row,), (), 6.0)
    for name, half in HALVES.items():
        assert f"{name} ± {half_width(half)} N" in repr(found)
    table = forces_table(
        found, {name: ForceError(np.zeros(3), 0.1, 0.2584, 1.0, 0.0, 0.95) for name in HALVES}
    ).splitlines()
    line = next(line.split() for line in table if line.split()[:1] == ["car.force_estimated.x"])
    assert line == ["car.force_estimated.x", "4321.60", "0.44", "0.22", "0.258", "1.00", "95", "%"]
