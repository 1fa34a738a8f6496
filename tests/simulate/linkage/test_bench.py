"""The virtual bench measures what the mechanism does, in the signs of the vehicle file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.bench_readings import joint_tables, read_bench
from lacet.daq.channels import other_corner
from lacet.daq.errors import UsageError
from lacet.daq.joint_tables import JOINTS
from lacet.daq.vehicle import Vehicle
from lacet.simulate.linkage.bench import (
    COLUMNS,
    NOISE,
    SIDE,
    Bench,
    BenchTest,
    Step,
    bench_tests,
    find_test,
    toe_camber_spin,
)
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.statics import Loads
from lacet.simulate.linkage.truth import values_at
from lacet.simulate.vehicle_file import vehicle_text
from tests.simulate.linkage.second_cars import mechanism, statics


def short(name: str) -> BenchTest:
    """The first, middle and last step of a test, and those beside the middle."""
    test = find_test(name)
    middle = len(test.steps) // 2
    picked = (0, middle - 1, middle, middle + 1, len(test.steps) - 1)
    return BenchTest(test.name, test.moved, tuple(test.steps[i] for i in picked))


def test_slopes_in_bump_are_those_of_the_mechanism() -> None:
    car = statics("second")
    values = values_at(car, car.solve(np.zeros(4)))
    columns = Bench(mechanism("second")).run(short("bump")).columns
    for i, (corner, side, pair) in enumerate(
        (("fl", 1, (0, 1)), ("fr", -1, (0, 1)), ("rl", 1, (2, 3)), ("rr", -1, (2, 3)))
    ):
        travel = np.diff(columns[f"travel.{corner}"][[1, 3]])[0]
        slope = {name: np.diff(columns[f"{name}.{corner}"][[1, 3]])[0] / travel for name in COLUMNS}
        path, turn = (x[i, list(pair)].sum(axis=0) for x in (values.path, values.turn))
        n = car.mechanism.design_attitudes[i][:, 1]
        change = np.cross(turn, n)
        steer = (n[0] * change[1] - n[1] * change[0]) / (n[0] ** 2 + n[1] ** 2)
        assert slope["x"] == pytest.approx(path[0], abs=3e-3)
        assert slope["y"] == pytest.approx(side * path[1], abs=3e-3)
        assert slope["toe"] == pytest.approx(-side * np.degrees(steer) / 1e3, abs=4e-4)
        assert slope["camber"] == pytest.approx(-side * np.degrees(change[2] / np.sqrt(1 - n[2] ** 2)) / 1e3, abs=4e-4)
        rate = values.wheel_rate[i, list(pair)].sum()
        assert slope["fz"] == pytest.approx(rate / 1e3, rel=0.01)


def test_both_sides_agree_and_opposed_loads_mirror() -> None:
    bench = Bench(mechanism("second"))
    for name in ("bump", "lateral-opposed"):
        columns = bench.run(short(name)).columns
        for column in ("toe", "camber", "x", "y", "z", "spin", "fz"):
            for axle in "fr":
                np.testing.assert_allclose(columns[f"{column}.{axle}l"], columns[f"{column}.{axle}r"], atol=1e-5)
    columns = bench.run(short("roll")).columns
    np.testing.assert_allclose(columns["toe.fl"], columns["toe.fr"][::-1], atol=1e-7)


def test_steering_to_the_left_toes_the_left_wheel_out_and_the_right_one_in() -> None:
    car = SecondCar.named("second")
    columns = Bench(mechanism("second")).run(short("steer")).columns
    forward = columns["rack"] > 0  # a rack behind the axle steers to the right when it moves to the left
    assert np.any(forward)
    assert np.all(columns["toe.fl"][forward] > np.degrees(car.front.toe))
    assert np.all(columns["toe.fr"][forward] < np.degrees(car.front.toe))


def test_the_other_wheel_moves_a_wheel_of_twist_beam_and_live_axle_and_none_of_the_wishbones() -> None:
    moved = {}
    for name in ("second", "second-live-axle"):
        columns = Bench(mechanism(name)).run(short("single-left")).columns
        moved[name] = {c: np.ptp(columns[f"camber.{c}"]) for c in ("fr", "rr")}
        assert moved[name]["rr"] > 20 * moved[name]["fr"]
    assert moved["second-live-axle"]["rr"] > 2.0  # degrees: a rigid axle


def test_the_vehicle_file_has_the_bump_test_and_loads() -> None:
    car = SecondCar.named("second")
    vehicle = Vehicle.parse(vehicle_text(car), "second.toml")
    columns = Bench(mechanism("second")).run(find_test("bump")).columns
    for corner in ("fl", "fr", "rl", "rr"):
        table = vehicle.corners[corner].table
        assert table is not None
        np.testing.assert_allclose(table.travel, 1e-3 * columns[f"travel.{corner}"], atol=1e-9)
        for own, measured in (("half_track", "y"), ("half_wheelbase", "x"), ("toe", "toe"), ("camber", "camber")):
            change = columns[f"{measured}.{corner}"] - columns[f"{measured}.{corner}"][6]
            scale = 1e3 if COLUMNS[measured][0] == "mm" else np.degrees(1.0)
            np.testing.assert_allclose(scale * getattr(table, own), change, atol=1e-4)


def test_the_vehicle_file_has_the_joints_of_each_corner() -> None:
    """Alone they are the mechanism's; both wheels together they are the bump test, within the error they state."""
    vehicle = Vehicle.parse(vehicle_text(SecondCar.named("second")), "second.toml")
    columns, car = Bench(mechanism("second")).run(find_test("bump")).columns, statics("second")
    moved = car.solve(np.array([0.033, 0.0, 0.033, 0.0]), 0.0).centres - car.mechanism.car.wheel_centres
    for i, (c, corner) in enumerate(vehicle.corners.items()):
        joints = corner.joints
        assert joints is not None
        assert joints.steered == (c[0] == "f")
        own, other = (0.033, 0.0) if c[1] == "l" else (0.0, 0.033)
        found = joints.at(np.array(own), np.array(other), np.array(0.0))
        np.testing.assert_allclose(found[:2], [corner.side * moved[i, 1], moved[i, 0]], atol=2e-5)
        travel = 1e-3 * columns[f"travel.{c}"][2:-2]
        lateral = 1e-3 * columns[f"y.{c}"][2:-2]
        error = joints.at(travel, travel, np.zeros_like(travel))[:, 0] - lateral
        assert np.max(np.abs(error)) < joints.mixed["half_track"] + 2e-5


@pytest.mark.parametrize("name", ["second", "second-live-axle"])
def test_loads_move_and_turn_the_wheels_as_the_vehicle_file_s_compliance_says(name: str) -> None:
    """Loads of any kind on all wheels at once: shifts to 0.02 mm, angles to 0.01° of up to 1 mm and 0.4°."""
    car = statics(name)
    vehicle = Vehicle.parse(vehicle_text(car.mechanism.car), f"{name}.toml")
    rng = np.random.default_rng(3)
    force, moment, drive = (
        rng.normal(0, 300, (4, 3)) * [1.0, 1.0, 0.0],
        rng.normal(0, 20, (4, 3)),
        rng.normal(0, 300, 4),
    )
    moment[:, :2] = 0.0
    step = Step(np.zeros(4), 0.0, Loads(force, moment), drive)
    still, moved = car.solve(np.zeros(4)), car.solve(np.zeros(4), 0.0, step.all_loads(car.mechanism.car.heights))
    zero, angles = (toe_camber_spin(shape.attitudes, car.mechanism.design_attitudes) for shape in (still, moved))
    loads = {
        c: {
            "longitudinal": force[i, :1], "traction": drive[i : i + 1], "lateral": SIDE[i] * force[i, 1:2],
            "aligning": -SIDE[i] * moment[i, 2:],
        }
        for i, c in enumerate(vehicle.corners)
    }  # fmt: skip
    for i, (c, corner) in enumerate(vehicle.corners.items()):
        assert corner.joints is not None
        assert corner.joints.compliance is not None
        shift = moved.centres[i] - still.centres[i]
        expected = [SIDE[i] * shift[1], shift[0], *(angles - zero)[i]]
        found = corner.joints.compliance.change(loads[c], loads[other_corner(c)])[:, 0]
        np.testing.assert_allclose(found[:2], expected[:2], atol=2e-5)
        np.testing.assert_allclose(found[2:], expected[2:], atol=np.radians(0.01))
        assert np.max(np.abs(expected[:2])) > 1e-4


def test_noise_is_that_of_a_rig_and_the_table_is_a_csv_with_units() -> None:
    test = short("bump")
    clean, noisy = (Bench(mechanism("second"), noise=noise).run(test) for noise in (0.0, 1.0))
    for unit, sigma in NOISE.items():
        names = [f"{name}.{c}" for name, (of, _) in COLUMNS.items() if of == unit for c in ("fl", "fr", "rl", "rr")]
        errors = np.concatenate([noisy.columns[name] - clean.columns[name] for name in names])
        assert 0.6 * sigma < np.std(errors) < 1.5 * sigma
    head, *rows = clean.csv().splitlines()
    assert len(rows) == len(test.steps)
    assert "toe.fl [deg]" in head
    assert "fz.rr [N]" in head
    assert len(head.split(",")) == len(rows[0].split(",")) == 1 + 4 * len(COLUMNS)


def test_an_unknown_test_is_refused_with_the_list() -> None:
    with pytest.raises(UsageError, match="bump"):
        find_test("bumb")
    assert "grid" in bench_tests()


@pytest.mark.parametrize(
    ("name", "tests"),
    [
        ("second-live-axle", ("single-left", "single-right", "grid")),
        pytest.param("second", ("single-left", "single-right", "grid", "steer"), marks=pytest.mark.slow),
    ],
)
def test_joint_tables_of_the_bench_are_the_mechanism_within_the_error_they_state(
    tmp_path: Path, name: str, tests: tuple[str, ...]
) -> None:
    bench, files = Bench(mechanism(name)), []
    for test in tests:
        files.append(tmp_path / f"{test}.csv")
        files[-1].write_text(bench.run(find_test(test)).csv(), encoding="utf-8")
    tables = joint_tables(read_bench(files))
    car = statics(name)
    design = toe_camber_spin(car.mechanism.design_attitudes, car.mechanism.design_attitudes)
    centres = car.mechanism.car.wheel_centres
    places = [(0.033, 0.0, 0.0), (-0.041, 0.028, 0.0), (0.017, 0.017, 0.033 if "steer" in tests else 0.0)]
    for left, right, rack in places:
        shape = car.solve(np.array([left, right, left, right]), rack)
        moved, angles = (
            shape.centres - centres,
            toe_camber_spin(shape.attitudes, car.mechanism.design_attitudes) - design,
        )
        for i, (corner, table) in enumerate(tables.items()):
            own, other = (left, right) if corner[1] == "l" else (right, left)
            found = dict(zip(JOINTS, table.at(np.array(own), np.array(other), np.array(rack)), strict=True))
            side = 1.0 if corner[1] == "l" else -1.0
            true = {"half_track": side * moved[i, 1], "half_wheelbase": moved[i, 0]}
            true |= dict(zip(("toe", "camber", "pitch"), angles[i], strict=True))
            alone = (other == 0.0) + (rack == 0.0) == 2
            for joint, value in true.items():
                slack = 2e-5 if JOINTS[joint] == "m" else 1e-4
                assert abs(found[joint] - value) < slack + (0.0 if alone else table.mixed[joint])
        if name == "second-live-axle":
            # The product of both travels is nearly all that is mixed: 1.85 mm at 50 mm each.
            assert abs(tables["rl"].product[0]) * 0.05**2 > 1.5e-3
            assert tables["rl"].mixed["half_track"] < 1e-4
