"""Tables of a K&C bench: names by a map, units, signs and sides checked; joints put together, mixed terms stated."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.bench_readings import REPEATABILITY, BenchError, _curve, joint_tables, read_bench
from lacet.daq.errors import VehicleError
from lacet.daq.joint_tables import JOINTS, JointCurve, joints_text
from lacet.daq.vehicle import Vehicle

VEHICLE = """
format = "lacet-vehicle 1"
name = "trial"
[geometry]
wheelbase = { value = 2.6, unit = "m", source = "drawing" }
[axle.front]
track = { value = 1.5, unit = "m", source = "drawing" }
wheel_centre_height = { value = 0.29, unit = "m", source = "drawing" }
tyre_radius = { value = 0.31, unit = "m", source = "drawing" }
[axle.rear]
track = { value = 1.5, unit = "m", source = "drawing" }
wheel_centre_height = { value = 0.29, unit = "m", source = "drawing" }
tyre_radius = { value = 0.31, unit = "m", source = "drawing" }
"""
CORNERS = ("fl", "fr", "rl", "rr")
MIXED, BEYOND = 0.8, 300.0
"""Toe by own travel × rack [rad/m²], and by own travel² × rack² [rad/m⁴]."""

Readings = dict[str, np.ndarray]


def joint(name: str, corner: str, own: float, other: float, rack: float) -> float:
    """A car of known joints [m, rad]: smooth curves of each variable, and one mixed term."""
    side = 1.0 if corner[1] == "l" else -1.0
    front = corner[0] == "f"
    return {
        "y": 0.05 * own - 2.0 * own**2 + 0.01 * other,
        "x": -0.04 * own + 0.3 * own**2 - 0.02 * other - (0.5 * side * rack if front else 0.0),
        "toe": -0.1 * own
        + 0.03 * other
        + (side * (7.0 * rack + MIXED * own * rack + BEYOND * own**2 * rack**2) if front else 0.0)
        + 0.002,
        "camber": -0.2 * own - 0.05 * other - (0.4 * side * rack if front else 0.0) - 0.01,
        "spin": -0.6 * own + 1.5 * own**2,
    }[name]


def readings() -> Readings:
    """All tests of a bench: wheels alone, both, the rack at three travels; SI."""
    line = np.linspace(-0.05, 0.05, 11)
    states = [(s, 0.0, 0.0) for s in line] + [(0.0, s, 0.0) for s in line]
    states += [(a, b, 0.0) for a, b in itertools.product((-0.03, 0.0, 0.03), repeat=2)]
    states += [(s, s, r) for s in (-0.03, 0.0, 0.03) for r in np.linspace(-0.04, 0.04, 9)]
    return of_states(states)


def of_states(states: Sequence[tuple[float, float, float]]) -> Readings:
    """Readings at left travels, right travels and settings of the rack; SI."""
    out: dict[str, list[float]] = {"rack": [r for _, _, r in states]}
    for corner in CORNERS:
        for name in ("travel", "z", "y", "x", "toe", "camber", "spin"):
            values = []
            for left, right, rack in states:
                own, other = (left, right) if corner[1] == "l" else (right, left)
                values.append(own if name in ("travel", "z") else joint(name, corner, own, other, rack))
            out[f"{name}.{corner}"] = values
    return {name: np.array(values) for name, values in out.items()}


def write(path: Path, columns: Readings, name_of: Callable[[str], str] | None = None, angle: str = "deg") -> Path:
    """As a table, lengths in mm, angles in deg or rad."""
    angles = {name for name in columns if name.partition(".")[0] in ("toe", "camber", "spin")}
    heads = []
    for name in columns:
        shown = name if name_of is None else name_of(name)
        heads.append(f"{shown} [{angle if name in angles else 'mm'}]" if name_of is None else shown)
    scales = [(np.degrees(1.0) if angle == "deg" else 1.0) if name in angles else 1e3 for name in columns]
    rows = np.stack([scale * values for scale, values in zip(scales, columns.values(), strict=True)], axis=1)
    lines = [",".join(heads), *(",".join(repr(float(v)) for v in row) for row in rows)]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_curves_and_products_are_those_of_the_car_and_the_mixed_error_is_what_remains(tmp_path: Path) -> None:
    tables = joint_tables(read_bench([write(tmp_path / "all.csv", readings())]))
    names = {"half_track": "y", "half_wheelbase": "x", "toe": "toe", "camber": "camber", "pitch": "spin"}
    for corner, table in tables.items():
        for own, other, rack in ((0.02, 0.0, 0.0), (-0.04, 0.03, 0.0), (0.0, 0.01, 0.03)):
            got = table.at(np.array(own), np.array(other), np.array(rack))
            for i, name in enumerate(JOINTS):
                expected = joint(names[name], corner, own, other, rack) - joint(names[name], corner, 0.0, 0.0, 0.0)
                assert got[i] == pytest.approx(expected, abs=2e-5)
        side = 1.0 if corner[1] == "l" else -1.0
        toe = list(JOINTS).index("toe")
        assert table.rack_product[toe] == pytest.approx(side * MIXED if corner[0] == "f" else 0.0, abs=1e-6)
        np.testing.assert_allclose(table.product, 0.0, atol=1e-3)  # 1 µm at 30 mm of both travels
        largest = BEYOND * 0.03**2 * 0.04**2 if corner[0] == "f" else 0.0
        assert table.mixed["toe"] == pytest.approx(largest, abs=2e-6)
        assert table.mixed["half_track"] == pytest.approx(0.0, abs=2e-5)
        slope = table.own.value(np.array(0.01), 1)[list(JOINTS).index("pitch")]
        assert slope == pytest.approx(-0.6 + 3.0 * 0.01, abs=2e-2)


def test_a_map_gives_names_units_and_signs(tmp_path: Path) -> None:
    plain = joint_tables(read_bench([write(tmp_path / "plain.csv", readings())]))
    steered = readings()
    for corner in ("fl", "rl"):
        steered[f"toe.{corner}"] = -steered[f"toe.{corner}"]  # a rig that gives steer angles to the left
    file = write(tmp_path / "rig.csv", steered, lambda name: "K_" + name.replace(".", "_"), "rad")
    lines = ['format = "lacet-bench-map 1"', "[columns]"]
    for name in steered:
        sign = "-" if name in ("toe.fl", "toe.rl") else ""
        unit = "rad" if name.partition(".")[0] in ("toe", "camber", "spin") else "mm"
        lines.append(f'"{name}" = {{ from = "{sign}K_{name.replace(".", "_")}", unit = "{unit}" }}')
    bench_map = tmp_path / "map.toml"
    bench_map.write_text("\n".join(lines), encoding="utf-8")
    for corner, table in joint_tables(read_bench([file], bench_map)).items():
        np.testing.assert_allclose(table.own.values, plain[corner].own.values, atol=1e-9)
        steered = table.rack, plain[corner].rack
        if corner[0] == "r":
            assert steered == (None, None)  # no rack turns it
            continue
        assert all(steered)
        np.testing.assert_allclose(*(curve.values for curve in steered if curve), atol=1e-9)


def spoilt(which: str) -> Readings:
    columns = readings()
    if which == "z":
        columns["z.rl"] = -columns["z.rl"]
    elif which == "steer":
        columns["toe.fr"] = -columns["toe.fr"]
    elif which == "camber":
        columns["camber.rr"] = -columns["camber.rr"]
    elif which == "sides":
        for name in ("x", "y", "toe", "camber", "spin"):
            columns[f"{name}.rl"], columns[f"{name}.rr"] = columns[f"{name}.rr"], columns[f"{name}.rl"]
    elif which == "outwards":
        columns["y.fr"] = -columns["y.fr"]
    elif which == "radians":
        columns["camber.fl"] = np.degrees(columns["camber.fl"])
    return columns


@pytest.mark.parametrize(
    ("which", "says"),
    [
        ("z", r"z\.rl: does not rise with travel\.rl"),
        ("steer", r"toe\.fl and toe\.fr change alike with the rack"),
        ("camber", r"camber\.rl and camber\.rr change against each other"),
        ("sides", r"columns of left and right are exchanged"),
        ("outwards", r"y\.fl and y\.fr change against each other"),
        ("radians", r"camber\.fl: reaches \d+°"),
    ],
)
def test_a_wrong_sign_or_side_is_refused_by_name(tmp_path: Path, which: str, says: str) -> None:
    with pytest.raises(BenchError, match=says):
        read_bench([write(tmp_path / "all.csv", spoilt(which))])


def test_wrong_units_names_and_numbers_are_refused_with_the_file(tmp_path: Path) -> None:
    file = write(tmp_path / "all.csv", readings())
    text = file.read_text(encoding="utf-8")
    for old, new, says in (
        ("toe.fl [deg]", "toe.fl [mm]", r"toe\.fl: unit 'mm' is not one of a quantity in rad"),
        ("toe.fl [deg]", "toe.fl", r"toe\.fl: .*no unit"),
        ("camber.rr [deg]", "kamber.rr [deg]", r"missing: camber\.rr"),
    ):
        file.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(BenchError, match=says) as error:
            read_bench([file])
        assert "all.csv" in str(error.value)
    file.write_text(text.replace("\n", "\nx,", 1), encoding="utf-8")
    with pytest.raises(BenchError, match="each row needs a number"):
        read_bench([file])
    with pytest.raises(BenchError, match=r"nothing\.csv"):
        read_bench([tmp_path / "nothing.csv"])


def test_without_a_wheel_moved_alone_there_are_no_tables(tmp_path: Path) -> None:
    columns = readings()
    both = np.abs(columns["travel.fl"] - columns["travel.fr"]) < 1e-9
    file = write(tmp_path / "bump.csv", {name: values[both] for name, values in columns.items()})
    with pytest.raises(BenchError, match="fl: no test moves it"):
        joint_tables(read_bench([file]))


def test_bump_and_roll_tests_are_enough_but_for_how_what_is_even_is_shared(tmp_path: Path) -> None:
    """This car's other wheel acts in proportion: nothing of it is even."""
    line = np.linspace(-0.05, 0.05, 11)
    states = [(s, s, 0.0) for s in line] + [(s, -s, 0.0) for s in line]
    for name, reach in (("bump", 11), ("roll", 11), ("short", 9)):
        part = states[11:] if name == "roll" else states[:11]
        columns = of_states(part[(11 - reach) // 2 : (11 + reach) // 2])
        write(tmp_path / f"{name}.csv", columns)
    whole = joint_tables(read_bench([write(tmp_path / "all.csv", readings())]))
    for first in ("bump", "short"):
        tables = joint_tables(read_bench([tmp_path / f"{first}.csv", tmp_path / "roll.csv"]))
        for corner, table in tables.items():
            assert table.own.at[-1] == pytest.approx(0.05 if first == "bump" else 0.04)
            for own, other in ((0.02, 0.0), (-0.04, 0.03), (0.0, 0.01)):
                at = np.array(own), np.array(other), np.array(0.0)
                np.testing.assert_allclose(table.at(*at), whole[corner].at(*at), atol=2e-5)


def test_what_readings_scatter_by_makes_no_slopes(tmp_path: Path) -> None:
    """Every 5 mm with a rig's repeatability: slopes of a curve through all readings are three times as far off."""
    rng, line = np.random.default_rng(4), np.linspace(-0.07, 0.07, 29)
    exact = of_states([(s, 0.0, 0.0) for s in line] + [(0.0, s, 0.0) for s in line])
    read = {
        name: values + rng.normal(0.0, 2e-5 if name[:2] in ("x.", "y.") else np.radians(0.003), values.shape)
        if name.partition(".")[0] in ("x", "y", "toe", "camber", "spin") else values
        for name, values in exact.items()
    }  # fmt: skip
    at = np.linspace(-0.06, 0.06, 49)
    true, found = (
        joint_tables(read_bench([write(tmp_path / f"{i}.csv", columns)])) for i, columns in enumerate((exact, read))
    )
    errors, raw = [], []
    for corner in CORNERS:
        errors.append(found[corner].own.value(at, 1) - true[corner].own.value(at, 1))
        rows = slice(0, 29) if corner[1] == "l" else slice(29, 58)
        names = {"half_track": "y", "half_wheelbase": "x", "toe": "toe", "camber": "camber", "pitch": "spin"}
        through = JointCurve(line, np.stack([read[f"{names[joint]}.{corner}"][rows] for joint in JOINTS], axis=1))
        raw.append(through.value(at, 1) - true[corner].own.value(at, 1))
    rms = [np.sqrt(np.mean(np.square(np.concatenate(part)), axis=0)) for part in (errors, raw)]
    assert np.all(rms[0] < 0.5 * rms[1])
    assert np.mean(rms[0] / rms[1]) < 0.4


def test_a_curve_is_no_smoother_than_readings_scatter() -> None:
    """Few settings of a bend of third order, which cross-validation alone takes for scatter."""
    x = np.linspace(-0.06, 0.06, 11)
    exact = np.stack([0.1 * x + 20.0 * x**3] * len(JOINTS), axis=1)
    curve = _curve(x, exact)
    assert curve is not None
    off = np.sqrt(np.mean((curve.values - exact) ** 2, axis=0))
    np.testing.assert_array_less(off, 1.1 * REPEATABILITY)
    assert np.any(off > 0.1 * REPEATABILITY)


def test_a_sweep_without_settings_is_a_curve_too(tmp_path: Path) -> None:
    """A reading every 0.1 mm, up and down again: means of every millimetre."""
    line = np.concatenate([np.arange(-0.06, 0.06, 1e-4), np.arange(0.06, -0.06, -1e-4)])
    swept = of_states([(s, 0.0, 0.0) for s in line] + [(0.0, s, 0.0) for s in line])
    tables = joint_tables(read_bench([write(tmp_path / "swept.csv", swept)]))
    at, none = np.linspace(-0.05, 0.05, 21), np.zeros(21)
    for corner, table in tables.items():
        assert 100 < len(table.own.at) < 140
        expected = [joint("camber", corner, s, 0.0, 0.0) - joint("camber", corner, 0.0, 0.0, 0.0) for s in at]
        camber = list(JOINTS).index("camber")
        np.testing.assert_allclose(table.at(at, none, none)[:, camber], expected, atol=2.0 * np.radians(0.003))
        np.testing.assert_allclose(table.own.value(at, 1)[:, camber], -0.2, atol=0.004)


def test_joints_are_written_into_a_vehicle_file_and_read_again(tmp_path: Path) -> None:
    tables = joint_tables(read_bench([write(tmp_path / "all.csv", readings())]))
    vehicle = Vehicle.parse(VEHICLE + joints_text(tables, "bench"), "trial.toml")
    for corner, table in tables.items():
        joints = vehicle.corners[corner].joints
        assert joints is not None
        np.testing.assert_allclose(joints.own.values, table.own.values, atol=1e-7)
        where = np.array(0.013), np.array(-0.021), np.array(0.017)
        np.testing.assert_allclose(joints.at(*where), table.at(*where), atol=5e-7)
        assert joints.mixed["toe"] == pytest.approx(table.mixed["toe"], abs=1e-7)
    assert Vehicle.parse(VEHICLE, "trial.toml").corners["fl"].joints is None
    bad = VEHICLE + joints_text(tables, "bench").replace("[corner.fl.joints.own]", "[corner.fl.joints.owm]")
    with pytest.raises(VehicleError, match=r"corner\.fl\.joints.*owm"):
        Vehicle.parse(bad, "trial.toml")


def test_curves_go_on_straight_beyond_their_ends() -> None:
    tables = JointCurve(np.array([-0.05, 0.0, 0.05]), np.outer([0.3, 0.0, 0.1], np.ones(5)))
    for end in tables.at[[0, -1]]:
        slope = tables.value(end, 1)
        np.testing.assert_allclose(tables.value(2.0 * end), tables.value(end) + slope * end, atol=1e-15)
        np.testing.assert_allclose(tables.value(2.0 * end, 1), slope)
        assert not np.any(tables.value(2.0 * end, 2))


def test_a_rack_whose_toe_turns_back_is_refused(tmp_path: Path) -> None:
    tables = joint_tables(read_bench([write(tmp_path / "all.csv", readings())]))
    text = VEHICLE + joints_text(tables, "bench")
    rack = tables["fl"].rack
    assert rack is not None
    turned = {**tables, "fl": replace(tables["fl"], rack=replace(rack, values=np.abs(rack.values)))}
    Vehicle.parse(text, "trial.toml")
    with pytest.raises(VehicleError, match=r"corner\.fl\.joints\.rack\.toe: must rise, or fall"):
        Vehicle.parse(VEHICLE + joints_text(turned, "bench"), "trial.toml")
