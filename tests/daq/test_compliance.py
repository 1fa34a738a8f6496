"""Compliance from a bench's load tests, in the signs of each wheel, and its way through the vehicle file."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.bench_compliance import READING, tables_with_compliance
from lacet.daq.bench_readings import SOURCE, BenchReadings
from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.compliance import JOINTS, LOADS
from lacet.daq.errors import VehicleError
from lacet.daq.joint_tables import joints_text
from lacet.daq.vehicle import Vehicle
from tests.daq.test_bench_readings import VEHICLE

RNG = np.random.default_rng(2)
SLOPES = {(axle, place, load): RNG.normal(0, 1e-6, 5) for axle in "fr" for place in ("own", "other") for load in LOADS}
"""Changes of the joints per load [SI], the same on both sides."""
SIDE = {c: 1.0 if c[1] == "l" else -1.0 for c in CORNERS}


def readings(together: tuple[str, ...] = ()) -> BenchReadings:
    """Wheels moved one by one, then loaded on both sides alike, and against each other but for loads `together`."""
    steps: list[dict[str, float]] = [{f"travel.{c}": s} for c in CORNERS for s in np.linspace(-0.05, 0.05, 5)]
    for load, name in READING.items():
        for size in np.linspace(-1500.0, 1500.0, 5) * (1.0 if LOADS[load] == "N" else 0.05):
            steps.append({f"{name}.{c}": size for c in CORNERS})
            if load not in together:
                steps.append({f"{name}.{c}": size * SIDE[c] for c in CORNERS})
    names = [f"{q}.{c}" for c in CORNERS for q in ("travel", "x", "y", "toe", "camber", "spin", *READING.values())]
    columns = {name: np.array([step.get(name, 0.0) for step in steps]) for name in names}
    for c in CORNERS:
        change = np.outer(columns[f"travel.{c}"], [0.05, -0.04, -0.1, -0.2, 0.3])
        for place, wheel in (("own", c), ("other", other_corner(c))):
            for load, name in READING.items():
                sign = {"lateral": SIDE[wheel], "aligning": -SIDE[wheel]}.get(load, 1.0)
                change += np.outer(sign * columns[f"{name}.{wheel}"], SLOPES[c[0], place, load])
        columns |= {f"{SOURCE[joint]}.{c}": change[:, i] for i, joint in enumerate(JOINTS)}
    return BenchReadings({"rack": np.zeros(len(steps)), **columns}, ("made.csv",))


def test_slopes_are_those_of_the_car_on_both_sides_and_of_both_wheels() -> None:
    tables, found = tables_with_compliance(readings())
    for c in CORNERS:
        assert found[c].together == ()
        assert max(found[c].bend.values()) < 1e-12
        assert tables[c].compliance is found[c].slopes
        for place, slopes in (("own", found[c].slopes.own), ("other", found[c].slopes.other)):
            for load in LOADS:
                np.testing.assert_allclose(slopes[load], SLOPES[c[0], place, load], atol=1e-14)


def test_a_load_that_was_on_both_wheels_alike_only_is_left_out_and_named() -> None:
    _, found = tables_with_compliance(readings(together=("lateral",)))
    assert found["rl"].together == ("lateral",)
    assert set(found["rl"].slopes.own) == set(LOADS) - {"lateral"}
    np.testing.assert_allclose(found["rl"].slopes.own["aligning"], SLOPES["r", "own", "aligning"], atol=1e-14)


def test_the_vehicle_file_keeps_it() -> None:
    tables, found = tables_with_compliance(readings())
    vehicle = Vehicle.parse(VEHICLE + joints_text(tables, "bench"))
    for c, corner in vehicle.corners.items():
        assert corner.joints is not None
        assert corner.joints.compliance is not None
        for load in LOADS:
            np.testing.assert_allclose(corner.joints.compliance.other[load], found[c].slopes.other[load], atol=2e-10)


def test_a_wrong_unit_or_load_is_refused() -> None:
    text = VEHICLE + joints_text(tables_with_compliance(readings())[0], "bench")
    with pytest.raises(VehicleError, match="half_track: unit"):
        Vehicle.parse(text.replace('"mm/kN"', '"mm"'))
    with pytest.raises(VehicleError, match="sideways"):
        Vehicle.parse(text.replace("own.lateral]", "own.sideways]"))
