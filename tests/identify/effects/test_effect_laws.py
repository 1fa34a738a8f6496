"""Single laws of the catalogue against an independent statement of the same: memory, bench tables, payload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from lacet.daq.joint_tables import JointCurve
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.effects.body.chassis_torsion import ChassisTorsion
from lacet.identify.effects.body.engine_mount import EngineMount
from lacet.identify.effects.catalogue import catalogue, effect_classes
from lacet.identify.effects.memory import dahl
from lacet.identify.effects.suspension.damper_asymmetry import DamperAsymmetry
from lacet.identify.effects.suspension.damper_knee import DamperKnee, DamperKneeBump, DamperKneeRebound
from lacet.identify.effects.suspension.pitch_change import PitchChange
from lacet.identify.effects.suspension.stops import BumpStop, ReboundStop
from lacet.identify.effects.suspension.with_memory import SuspensionForceWithMemory
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.regression.sensitivity import Sensitivity, residual
from tests.identify import cars
from tests.identify.cars import RATE

VEHICLE, RIG = cars.reference_car()
VEHICLE_T = cars.with_tables(VEHICLE)
FAMILIES = effect_classes()
KNOWN = {key: one for key, one in catalogue(VEHICLE_T, "hub", runs=("exact", "another")).items() if one.as_physics}
"""``exact`` is the run of `cars.recording`."""


@pytest.mark.parametrize("length", [0.001, 0.01])
def test_dahl_against_its_recursion(length: float) -> None:
    """The scan is the state carried from sample to sample; the state stays between −1 and 1."""
    travel = np.cumsum(np.random.default_rng(1).normal(0.0, 0.0007, 3000))
    z, states = 0.0, [0.0]
    for step in np.diff(travel):
        a = np.exp(-abs(step) / length)
        z = a * z + (1.0 - a) * np.sign(step)
        states.append(z)
    found = dahl(travel, length)
    np.testing.assert_allclose(found, states, atol=1e-12)
    assert np.max(np.abs(found)) <= 1.0
    np.testing.assert_array_equal(dahl(np.full(10, 0.02), length), 0.0)


def test_the_engine_on_its_mounts_is_an_oscillator() -> None:
    """Sines below, at and above the resonance: (H − 1) a, by its transfer function; gravity does nothing."""
    motion = build_motion(cars.recording(cars.random_signals(1), VEHICLE_T, RIG))
    t = np.arange(5000) / RATE
    effect = KNOWN["engine_mount"]
    shape = {"frequency": 9.0, "damping": 0.08}
    for f in (0.9, 9.0, 20.0):
        body = FrameMotion(np.zeros((3, t.size)), np.zeros((3, t.size)), np.zeros((3, t.size)))
        body.accel[2] = 9.81 + np.sin(2 * np.pi * f * t)
        out = replace(effect, shape=shape).columns(replace(motion, t=t, body=body))["chassis.fz"][0][2500:]
        # The bilinear transform bends the axis of frequencies; at the resonance it is right.
        w, w0 = (np.tan(np.pi * x / RATE) for x in (f, 9.0))
        gain = w**2 / (w0**2 - w**2 + 2j * 0.08 * w0 * w)
        expected = np.imag(gain * np.exp(2j * np.pi * f * t[2500:]))
        np.testing.assert_allclose(out, expected, atol=2e-3 * abs(gain))


@pytest.mark.parametrize("axes", ["carrier", "body"])
@pytest.mark.parametrize(
    ("key", "column", "sign"),
    [("jacking", "half_track", 1.0), ("anti_dive", "half_wheelbase", 1.0), ("toe_change", "toe", 1.0),
     ("camber_change", "camber", 1.0), ("pitch_change", "pitch", 1.0)],
)  # fmt: skip
def test_an_error_of_the_bench_table_is_its_effect(key: str, column: str, sign: float, axes: str) -> None:
    """A table whose slope is 0.02 too small, with the effect at 0.02: the residual of the right table.

    Of wheel loads in the carrier's axes, and in those of the body, in which pitch does not turn them.

    Row by row, of a model without inertia of axles and wheels, which the effects neglect, apart from the next test.
    """
    signals, p = cars.random_signals(11), 0.02
    right, rig = VEHICLE_T, cars.in_reference(RIG, RIG.wheel_reference, {"wheels": axes})
    wrong = replace(
        right,
        corners={
            name: replace(c, table=replace(c.table, **{column: getattr(c.table, column) - sign * p * c.table.travel}))
            if name.startswith("f")
            else c
            for name, c in right.corners.items()
        },
    )
    values = np.array([p, 0.0]) if key == "pitch_change" else np.array([p])
    truth = residual(build_motion(cars.recording(signals, right, rig)), (), np.zeros(0))
    seen = residual(build_motion(cars.recording(signals, wrong, rig)), (), np.zeros(0))
    effect = KNOWN[f"{key}.front"].force(build_motion(cars.recording(signals, wrong, rig)), values)
    for row in truth:
        gone = seen[row] - truth[row]
        expected = effect.get(row, np.zeros_like(gone))
        size = np.max(np.abs(gone)) + 1e-9
        # The moment about the spin axis is left out of toe, where it has the sine of the camber for a share.
        # Loads turn by the sine of the pitch, whose first order the effect has.
        tolerance = {"toe_change": 0.2, "pitch_change": 1e-3}.get(key, 1e-6)
        assert np.max(np.abs(gone - expected)) <= tolerance * size + 1e-9, row


@pytest.mark.parametrize("tables", ["bump", "joints"])
@pytest.mark.parametrize("driven", [False, True])
def test_a_wheel_whose_carrier_pitches_turns_against_its_sensor(tables: str, driven: bool) -> None:
    """Its inertia in every row, of a table whose pitch slope is p smaller: p J × the column, J at fixed 1.1 kg·m².

    Of a driven wheel whose half-shaft's torque is eliminated no work of it on the travel remains.
    """
    signals, p, J = cars.random_signals(11), 1e-5, 1.1
    right = cars.with_tables(VEHICLE) if tables == "bump" else cars.with_joints(VEHICLE)
    if driven:
        right = replace(right, corners={name: replace(c, driven=True) for name, c in right.corners.items()})
        torques = [name for name in signals.value if "torque" in name]
        signals = replace(signals, value={name: one for name, one in signals.value.items() if name not in torques})

    def wrong(corner: Corner) -> Corner:
        if corner.joints is None:
            table = corner.table
            return replace(corner, table=replace(table, pitch=table.pitch - p * table.travel))
        own = corner.joints.own
        off = np.outer(p * own.at, [0.0, 0.0, 0.0, 0.0, 1.0])
        return replace(corner, joints=replace(corner.joints, own=JointCurve(own.at, own.values - off)))

    off = {name: wrong(c) if name.startswith("f") else c for name, c in right.corners.items()}
    wheels = [KNOWN[f"body.wheel.{c}"] for c in ("fl", "fr")]

    def rows(vehicle: Vehicle) -> tuple[Motion, dict[str, np.ndarray]]:
        motion = build_motion(replace(cars.recording(signals, vehicle, RIG), brakes="off"))
        still = residual(motion, (), np.zeros(0))
        moving = residual(motion, wheels, np.array([J, 0.0, 0.0, 0.0] * 2))
        return motion, {row: moving[row] - still[row] for row in still}

    (_, truth), (motion, seen) = rows(right), rows(replace(right, corners=off))
    columns = PitchChange("front").columns(motion)
    follows = {"suspension.fl", "chassis.mz", "chassis.my"} | (set() if driven else {"spin.fl", "spin.fr"})
    assert follows <= {row for row in truth if np.max(np.abs(seen[row] - truth[row])) > 1e-3 * p * J}
    for row in truth:
        gone = seen[row] - truth[row]
        expected = p * J * columns[row][1] if row in columns else np.zeros_like(gone)
        assert np.max(np.abs(gone - expected)) <= 1e-3 * np.max(np.abs(gone)) + 1e-12, row


def test_a_law_with_a_memory_does_not_mix_the_copies_of_a_sensitivity() -> None:
    """Slopes are taken on copies of a thinned run: what has a memory stays out, and changes no slope of the others."""
    record = cars.recording(cars.random_signals(4, 400), VEHICLE_T, RIG)
    model = [KNOWN["spring.fl"], KNOWN["damper_hysteresis.fl"], KNOWN["engine_mount"], KNOWN["damper.fl"]]
    values = np.array([2e4, 300.0, 200.0, 20.0, 5.0, 1500.0])
    found = Sensitivity.of(record, model, values).slopes
    plain = Sensitivity.of(record, [model[0], model[3]], values[[0, 5]]).slopes
    assert found.keys() == plain.keys()
    for key, rows in plain.items():
        for row, slope in rows.items():
            np.testing.assert_array_equal(found[key][row], slope)
    assert {name for name, e in KNOWN.items() if not e.instantaneous} >= {"damper_hysteresis.fl", "engine_mount"}


def test_what_says_it_is_instantaneous_is() -> None:
    """The columns of some samples are those samples of the columns, in any order."""
    record = cars.recording(cars.random_signals(4, 60), VEHICLE_T, RIG)
    index = np.random.default_rng(0).permutation(60)[:40]
    motion, part = build_motion(record), build_motion(record.at(index))
    for key, effect in KNOWN.items():
        whole, some = effect.columns(motion), effect.columns(part)
        same = all(np.allclose(some[row], whole[row][:, index], rtol=1e-9, atol=1e-9) for row in whole)
        assert same or not effect.instantaneous, key
        if isinstance(effect, SuspensionForceWithMemory | EngineMount | ChassisTorsion):
            assert not same, key


def test_a_helper_spring_is_a_bump_stop_with_the_other_sign() -> None:
    """s − max(0, s − gap) = min(s, gap): why each names the other."""
    motion = build_motion(cars.recording(cars.random_signals(2), VEHICLE_T, RIG))
    shape = {"gap": 0.01}
    helper, stop = (
        replace(KNOWN[f"{name}.fl"], shape=shape).columns(motion) for name in ("helper_spring", "bump_stop")
    )
    linear = KNOWN["spring.fl"].columns(motion)["suspension.fl"]
    np.testing.assert_allclose(helper["suspension.fl"], linear - stop["suspension.fl"], atol=1e-15)


def test_a_stop_has_the_same_stiffness_10_mm_beyond_its_gap_whatever_its_exponent() -> None:
    """k × 10 mm there, 2^n of it at twice as much, nothing before the gap; without n, as in old results, linear."""
    travel = np.array([-0.1, 0.0, 0.0199, 0.02, 0.03, 0.04])
    bump, rebound = BumpStop("fl", {"gap": 0.02}), ReboundStop("fl", {"gap": 0.02})
    np.testing.assert_allclose(bump.law(travel, travel), [0.0, 0.0, 0.0, 0.0, 0.01, 0.02], atol=1e-15)
    for n in (1.0, 1.5, 2.0, 3.0):
        shape = {"gap": 0.02, "n": n}
        pressed = replace(bump, shape=shape).law(travel, travel)
        np.testing.assert_allclose(pressed, [0.0, 0.0, 0.0, 0.0, 0.01, 0.01 * 2.0**n], rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(replace(rebound, shape=shape).law(-travel, travel), -pressed)


def test_a_knee_changes_the_slope_beyond_it_alone() -> None:
    """By −1,000 N·s/m on a damper of 1,500: slopes 500, 1,500 and 500, without a step."""
    rate = np.array([-0.16, -0.11, -0.06, 0.0, 0.06, 0.11, 0.16])
    force = 1500.0 * rate - 1000.0 * DamperKnee("fl", {"v0": 0.06}).law(rate, rate)
    np.testing.assert_allclose(np.diff(force) / np.diff(rate), [500, 500, 1500, 1500, 500, 500], rtol=1e-12)


def test_a_damper_may_have_four_slopes() -> None:
    """Slopes of its own in bump and rebound, and beyond a knee of its own each way, without a step."""
    rate = np.array([-0.3, -0.2, -0.12, -0.1, 0.0, 0.05, 0.06, 0.1, 0.3])
    force = (
        2000.0 * rate
        - 500.0 * DamperAsymmetry("fl").law(rate, rate)
        - 700.0 * DamperKneeBump("fl", {"v0": 0.06}).law(rate, rate)
        - 1600.0 * DamperKneeRebound("fl", {"v0": 0.12}).law(rate, rate)
    )
    slopes = [900, 900, 2500, 2500, 1500, 1500, 800, 800]
    np.testing.assert_allclose(np.diff(force) / np.diff(rate), slopes, rtol=1e-12)


def test_a_law_may_have_several_parameters() -> None:
    """A column each, in the rows of its corners."""

    class Both(DamperKnee):
        def law(self, travel: np.ndarray, rate: np.ndarray) -> np.ndarray:
            return np.stack([np.maximum(0.0, rate), np.minimum(0.0, rate)])

    motion = build_motion(cars.recording(cars.random_signals(2), VEHICLE_T, RIG))
    table = Both("front").columns(motion)["suspension.fl"]
    np.testing.assert_array_equal(table.sum(axis=0), motion.corners["fl"].rate)
    assert DamperKnee("front").columns(motion)["suspension.fl"].shape == (1, motion.t.size)


@pytest.mark.parametrize("name", [name for name, family in FAMILIES.items() if family.grids])
def test_a_law_is_a_continuous_function_of_its_constants_within_their_bounds(name: str) -> None:
    """Bounds enclose the grid; a step ten times smaller from any value, the bounds among them, changes ten times less.

    The share of each column that changes is taken, the largest of its rows.
    """
    motion = build_motion(cars.recording(cars.random_signals(3), VEHICLE_T, RIG))
    effect = next(one for one in KNOWN.values() if one.name == name)
    assert set(effect.bounds) <= set(effect.grids)
    for constant, values in effect.grids.items():
        low, high = effect.bounds_of(constant)
        assert low <= min(values) <= max(values) <= high
        assert low < high

        def at(value: float, constant: str = constant) -> dict[str, np.ndarray]:
            shape = {**effect.shapes()[0].shape, constant: value}
            return replace(effect, shape=shape).columns(motion)

        def change(start: float, step: float, at: Callable[[float], dict[str, np.ndarray]] = at) -> float:
            before, after = at(start), at(start + step)
            size = max(float(np.linalg.norm(table)) for table in before.values())
            return max(float(np.linalg.norm(after[row] - before[row])) for row in before) / (size + 1e-6)

        for start in (low, *values, 0.5 * (low + high), high):
            step = 1e-4 * (high - low) * (1.0 if start < high else -1.0)
            large, small = change(start, step), change(start, 0.1 * step)
            assert small <= 0.2 * large + 1e-9, (constant, start)


def test_constants_without_bounds_keep_to_their_grid() -> None:
    """Smallest and largest value tried, as of a user's own effect."""

    class Own(type(KNOWN["bump_stop.fl"])):
        grids: ClassVar = {"gap": (0.03, 0.01, 0.02)}
        bounds: ClassVar = {}

    assert Own("fl").bounds_of("gap") == (0.01, 0.03)
    assert KNOWN["bump_stop.fl"].bounds_of("n") == (1.0, 3.0)


def test_payload_acts_in_its_run_alone() -> None:
    """And is the chassis' own mass there; a campaign of one run has none."""
    motion = build_motion(cars.recording(cars.random_signals(2), VEHICLE_T, RIG))
    chassis = KNOWN["body.chassis"].columns(motion)
    here = replace(KNOWN["payload.exact"], shape={"x": 0.0}).columns(motion)  # about the body origin
    assert KNOWN["payload.another"].columns(motion) == {}
    for row, table in here.items():
        np.testing.assert_array_equal(table[0], chassis[row][9])
        np.testing.assert_array_equal(table[1:], chassis[row][6:9])
    assert not any(key.startswith("payload") for key in catalogue(VEHICLE, "hub", runs=["exact"]))


def test_friction_and_a_damper_that_saturates_share_no_constants() -> None:
    """With the same band they are one law, and have one name."""
    friction, damper = KNOWN["coulomb.front"], KNOWN["damper_saturation.front"]
    assert friction.bounds_of("v0")[1] <= damper.bounds_of("v0")[0]


@pytest.mark.parametrize(("own", "other"), [(1.02, 0.05), (0.86, 0.17), (0.9, -0.1)])
def test_dampers_that_both_wheels_move_are_dampers_and_damping_across_the_axle(own: float, other: float) -> None:
    """Two dampers, each compressed by both wheels: force at a wheel by their power, against two laws."""
    motion, rate = build_motion(cars.recording(cars.random_signals(12), VEHICLE_T, RIG)), 3100.0
    left, right = (motion.corners[c].rate for c in ("rl", "rr"))
    forces = rate * np.stack([own * left + other * right, other * left + own * right])
    expected = {
        "suspension.rl": own * forces[0] + other * forces[1],
        "suspension.rr": other * forces[0] + own * forces[1],
    }
    across = KNOWN["axle_damping.rear"].force(motion, np.array([-2.0 * rate * own * other]))
    for row, force in expected.items():
        damper = KNOWN[f"damper.{row.rpartition('.')[2]}"].force(motion, np.array([rate * (own + other) ** 2]))
        np.testing.assert_allclose(damper[row] + across[row], force, atol=1e-9 * np.max(np.abs(force)))
