"""From channels to motion: tyre deflection, load axes, sensor mounts, latencies, holes, rows that exist."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import NotIdentifiable, RunError
from lacet.daq.run import Run, Signal
from lacet.identify.car.kinematics import build_motion, reconstruct
from lacet.identify.car.motion import GroundLaserOffset
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun, Unmeasured
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import Signals, bring_together
from lacet.services.render.rows import row_absence, run_notes
from tests.identify import cars
from tests.identify.cars import RATE

VEHICLE, RIG = cars.reference_car()
VEHICLE_T = cars.with_tables(VEHICLE)
SEEDS = st.integers(0, 2**32 - 1)


def on_a_plane(signals: Signals, slopes: np.ndarray, height: np.ndarray) -> Signals:
    """Ground lasers that see the plane z = height + slopes · (x, y) of body axes, (N,) and (2, N)."""
    value = dict(signals.value)
    for c in CORNERS:
        x, y, z = VEHICLE.corners[c].position
        value[f"laser.{c}.ground"] = (z + 0.30 - (height + slopes[0] * x + slopes[1] * y))[None]
    return replace(signals, value=value)


@settings(deadline=None, max_examples=15)
@given(SEEDS)
def test_deflection_is_that_of_a_disc_on_a_plane(seed: int) -> None:
    """A disc of radius R0 in the wheel's plane: the way to the road along it, in the steepest direction, and R0."""
    rng = np.random.default_rng(seed)
    n = 8
    signals = cars.random_signals(seed, n)
    slopes, height = rng.uniform(-0.05, 0.05, (2, n)), rng.normal(-0.30, 0.01, n)
    motion = build_motion(cars.recording(on_a_plane(signals, slopes, height), VEHICLE_T, RIG))
    for c, corner in motion.corners.items():
        steer, camber = (signals.value[f"camera.{c}.{what}"][0] for what in ("steer", "camber"))
        axis = Rotation.from_euler("ZX", np.stack([steer, camber], axis=1)).as_matrix()[:, :, 1]
        np.testing.assert_allclose(corner.spin_axis.T, axis, atol=1e-12)
        for i in range(n):
            # Along the wheel's plane: directions u cos a + v sin a; the way to the plane by ray casting.
            u = np.cross(axis[i], [0, 0, 1.0])
            u /= np.linalg.norm(u)
            v = np.cross(u, axis[i])
            a = np.linspace(-np.pi, 0, 4001)
            rays = np.cos(a)[:, None] * u + np.sin(a)[:, None] * v
            gap = corner.centre[2, i] - height[i] - slopes[:, i] @ corner.centre[:2, i]
            falls = rays[:, :2] @ slopes[:, i] - rays[:, 2]
            way = np.min(gap / falls[falls > 0.5])
            assert corner.deflection[i] == pytest.approx(VEHICLE.corners[c].tyre_radius - way, abs=2e-6)


def test_a_flat_road_needs_only_the_attitude() -> None:
    """With fewer than three ground lasers the normal is the vertical seen from the body, and a note says so."""
    signals = cars.random_signals(4)
    value = {k: v for k, v in signals.value.items() if k not in ("laser.fl.ground", "laser.rr.ground")}
    motion = build_motion(cars.recording(replace(signals, value=value), VEHICLE, RIG))
    roll, pitch, yaw = signals.value["imu.attitude"]
    R = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    np.testing.assert_allclose(motion.corners["rl"].normal.T, R[:, 2, :], atol=1e-12)
    assert any("flat road" in note for note in run_notes(motion.notes))
    assert "tyre.fl" in motion.left_out
    assert "laser.fl.ground" in motion.left_out["tyre.fl"].channels
    assert {"tyre.fr", "tyre.rl"} <= set(motion.rows)


@settings(deadline=None, max_examples=20)
@given(SEEDS)
def test_loads_are_the_same_in_every_axes(seed: int) -> None:
    """One load given in carrier, TYDEX C and body axes: the same load in body axes."""
    signals = cars.random_signals(seed)
    n = signals.value["imu.accel"].shape[1]
    slopes = np.random.default_rng(seed).normal(0, 0.05, (2, n))
    signals = on_a_plane(signals, slopes, np.full(n, -0.3))
    plain = build_motion(cars.recording(signals, VEHICLE_T, RIG))
    given_in: dict[str, dict[str, np.ndarray]] = {"body": {}, "tydex_c": {}}
    e = np.stack([-slopes[0], -slopes[1], np.ones(n)])
    e = e / np.linalg.norm(e, axis=0)
    for c, corner in plain.corners.items():
        angles = np.stack([corner.steer, corner.camber, corner.pitch], axis=1)
        R_body_carrier = Rotation.from_euler("ZXY", angles).as_matrix()
        y = corner.spin_axis
        x = np.cross(y.T, e.T)
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        R_body_c = np.stack([x, y.T, np.cross(x, y.T)], axis=2)
        assert np.all(np.abs(np.einsum("ni,in->n", x, e)) < 1e-12), "x of TYDEX C is parallel to the road"
        for what, found in (("force", corner.force), ("moment", corner.moment)):
            name = f"wheel.{c}.{what}"
            body = np.einsum("nij,jn->in", R_body_carrier, signals.value[name])
            np.testing.assert_allclose(found, body, atol=1e-9)
            given_in["body"][name] = body
            given_in["tydex_c"][name] = np.einsum("nij,in->jn", R_body_c, body)
    for axes, loads in given_in.items():
        rig = cars.in_reference(RIG, "hub", {"wheels": axes})
        moved = replace(signals, value={**signals.value, **loads})
        motion = build_motion(cars.recording(moved, VEHICLE_T, rig))
        for row in plain.rows:
            np.testing.assert_allclose(motion.measured(row), plain.measured(row), atol=1e-8, err_msg=f"{axes} {row}")


@settings(deadline=None, max_examples=20)
@given(SEEDS)
def test_inertial_unit_anywhere_in_the_body(seed: int) -> None:
    """Mounted askew and off the origin: the body's own motion and attitude come out."""
    rng = np.random.default_rng(seed)
    angles, mount = rng.uniform(-0.5, 0.5, 3), rng.uniform(-1.5, 1.5, 3)
    R = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()  # sensor to body
    signals = cars.random_signals(seed)
    omega, omega_dot = signals.value["imu.rate"].T, signals.rate["imu.rate"].T
    accel, attitude = signals.value["imu.accel"].T, signals.value["imu.attitude"]
    there = accel + np.cross(omega_dot, mount) + np.cross(omega, np.cross(omega, mount))
    ground = Rotation.from_euler("ZYX", attitude[::-1].T).as_matrix() @ R
    euler = Rotation.from_matrix(ground).as_euler("ZYX").T[::-1]
    value = {**signals.value, "imu.accel": (there @ R).T, "imu.rate": (omega @ R).T, "imu.attitude": euler}
    rate = {**signals.rate, "imu.rate": (omega_dot @ R).T}
    imu = next(s for s in RIG.sensors if s.name == "imu")
    askew = replace(imu, position={"": tuple(mount)}, orientation=tuple(angles))
    rig = replace(RIG, sensors=tuple(askew if s.name == "imu" else s for s in RIG.sensors))
    motion = build_motion(cars.recording(replace(signals, value=value, rate=rate), VEHICLE, rig))
    np.testing.assert_allclose(motion.body.omega, omega.T, atol=1e-12)
    np.testing.assert_allclose(motion.body.omega_dot, omega_dot.T, atol=1e-11)
    np.testing.assert_allclose(motion.body.accel, accel.T, atol=1e-10)
    assert motion.attitude is not None
    np.testing.assert_allclose(motion.attitude, attitude, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(SEEDS)
def test_speed_at_the_origin_from_a_sensor_elsewhere(seed: int) -> None:
    """The sensor's point also moves by yaw; heading axes stay level while the body rolls and pitches."""
    signals = cars.random_signals(seed)
    motion = build_motion(cars.recording(signals, VEHICLE, RIG))
    assert motion.velocity is not None
    roll, pitch, _ = motion.attitude
    level = Rotation.from_euler("YX", np.stack([pitch, roll], axis=1)).as_matrix()  # body to heading
    mount = np.array([-3.2, 0.0, 0.01])
    there = motion.velocity.T + np.cross(motion.body.omega.T, mount)
    found = np.einsum("nij,nj->ni", level, there)
    np.testing.assert_allclose(found[:, :2].T, signals.value["correvit.speed"], atol=1e-10)
    np.testing.assert_allclose(found[:, 2], 0, atol=1e-10)


# ---- bringing a run together


def made_run(seconds: float = 12.0, seed: int = 2, latencies: bool = True) -> tuple[Run, dict[str, cars.MultiSine]]:
    """A run of smooth channels at their nominal rates, stamped late by the rig's latencies."""
    rng = np.random.default_rng(seed)
    curves = cars.drive_curves(rng)
    curves |= {name: cars.MultiSine(rng, 3, 500.0, (0.0, 0.0, 3000.0)) for name in cars.LOADS}
    signals = {}
    for name, curve in curves.items():
        t = np.arange(0.0, seconds, 1.0 / CHANNELS[name].rate)
        late = RIG.latency(name) if latencies else 0.0
        signals[name] = Signal(t + late, curve.at(t).T, np.zeros(t.size, np.uint8))
    return Run("made", signals, brakes="off"), curves


def test_latencies_are_taken_out() -> None:
    """Every channel at the grid's instants is what it was then, not what was stamped then."""
    run, curves = made_run()
    record = bring_together(run, VEHICLE, RIG, Filters())
    inner = slice(round(RATE), -round(RATE))
    for name, curve in curves.items():
        true, swing = curve.at(record.t), np.max(np.ptp(curve.at(record.t), axis=1))
        np.testing.assert_allclose(record.signals.value[name][:, inner], true[:, inner], atol=2e-4 * swing)
    # And the test can tell: as stamped, the cameras are 25 ms off.
    undone, _ = made_run(latencies=False)
    wrong = bring_together(undone, VEHICLE, RIG, Filters()).signals.value["camera.fl.steer"]
    assert np.max(np.abs(wrong - curves["camera.fl.steer"].at(record.t[: wrong.shape[1]]))) > 1e-3


def flagged(run: Run, name: str, where: slice, flag: Flag) -> Run:
    """The run with a flag on some samples of a channel."""
    signal = run.signals[name]
    flags, values = signal.flags.copy(), signal.values.copy()
    flags[where] |= np.uint8(flag)
    if flag != Flag.GAP:
        values[where] = np.nan
    return replace(run, signals={**run.signals, name: Signal(signal.t, values, flags)})


def test_holes_are_left_out_with_their_edges_by_row() -> None:
    """A second of unusable steer angle takes out its rows there, and no other row or time; the hole is reported."""
    run, _ = made_run()
    filters = Filters()
    held = flagged(run, "camera.fl.steer", slice(400, 500), Flag.STATUS)  # 4 to 5 s
    motion = reconstruct(held, VEHICLE, RIG, filters)
    whole = reconstruct(run, VEHICLE, RIG, filters)
    t = motion.t
    inside = (t > 4.0 - filters.edge + 0.03) & (t < 5.0 + filters.edge - 0.03)
    outside = (t < 4.0 - filters.edge - 0.05) | (t > 5.0 + filters.edge + 0.05)
    for row in motion.rows:
        touched = row.startswith("chassis") or row.endswith(".fl")
        if touched:
            assert not np.any(motion.usable[row][inside]), row
            np.testing.assert_array_equal(motion.usable[row][outside], whole.usable[row][outside])
        else:
            np.testing.assert_array_equal(motion.usable[row], whole.usable[row])
    assert any("camera.fl.steer" in note and note.startswith("left out") for note in run_notes(motion.notes))
    for row in motion.rows:
        assert np.all(np.isfinite(motion.measured(row)))


def test_short_holes_and_gap_flags_cost_nothing() -> None:
    """Five milliseconds of a 500 Hz channel are interpolated; `GAP` alone leaves the sample usable."""
    run, _ = made_run()
    for held in (
        flagged(run, "wheel.fl.force", slice(2000, 2002), Flag.CHECKSUM),
        flagged(run, "wheel.fl.force", slice(2000, 2600), Flag.GAP),
    ):
        motion, whole = reconstruct(held, VEHICLE, RIG), reconstruct(run, VEHICLE, RIG)
        np.testing.assert_array_equal(motion.usable["suspension.fl"], whole.usable["suspension.fl"])
        assert not motion.notes
        row = Row.parse("suspension.fl")
        np.testing.assert_allclose(motion.measured(row), whole.measured(row), atol=2.0)


@pytest.mark.parametrize(
    ("ahead", "told"), [(-0.06, "60 mm behind"), (-0.004, ""), (0.004, ""), (0.05, "50 mm ahead of")]
)
def test_a_laser_that_is_not_above_its_wheel_cannot_tell_tyre_damping(ahead: float, told: str) -> None:
    """It sees a bump earlier or later than the tyre does, which is the column of a damper."""
    run, _ = made_run()
    moved = tuple(
        replace(s, from_wheel_centre=(ahead, 0.0, 0.3)) if s.from_wheel_centre is not None else s for s in RIG.sensors
    )
    drive = PreparedRun.of(run, VEHICLE, replace(RIG, sensors=moved))
    assert any(told in note for note in run_notes(drive.motion.notes)) if told else not drive.motion.notes
    every = catalogue(VEHICLE, "hub")
    lacking = drive.lacks(every["tyre_damping.front"])
    assert lacking == (Unmeasured(drive.name, (GroundLaserOffset(drive.motion.ahead),)) if told else None)
    assert drive.motion.ahead == pytest.approx(ahead)
    assert drive.lacks(every["tyre_progression.front"]) is None


def test_a_clock_jump_is_an_edge() -> None:
    """A sample with a `CLOCK` flag splits the run: what the filters smear of it is left out."""
    run, _ = made_run()
    held = flagged(run, "imu.rate", slice(1200, 1201), Flag.CLOCK)
    motion = reconstruct(held, VEHICLE, RIG)
    near = np.abs(motion.t - 6.0) < 0.7
    assert not np.any(motion.usable["chassis.fx"][near])
    assert np.any(motion.usable["chassis.fx"])


@pytest.mark.parametrize(
    ("lost", "gone"),
    [
        (("laser.fl.hub", "laser.fl.ground"), {"suspension.fl", "tyre.fl"}),
        (("imu.accel",), {"chassis", "suspension", "tyre"}),
        (("camera.rr.steer",), set()),
        (("wheel.rl.speed",), set()),
        (("wheel.rl.moment",), {"spin.rl"}),
        (("wheel.fr.force",), {"chassis", "suspension.fr", "tyre.fr"}),
        (("correvit.speed", "imu.attitude"), set()),
    ],
)
def test_missing_channels_cost_their_rows_and_no_others(lost: tuple[str, ...], gone: set[str]) -> None:
    """What is not measured and can neither be derived nor assumed is named; the rest is fitted."""
    run, _ = made_run()
    run = replace(run, signals={k: v for k, v in run.signals.items() if k not in lost})
    drive = PreparedRun.of(run, VEHICLE, RIG)
    full = {*(f"{kind}.{c}" for kind in ("suspension", "tyre") for c in CORNERS), "spin.rl", "spin.rr"}
    full |= {f"chassis.{x}{k}" for x in "fm" for k in "xyz"}
    expected = {row for row in full if row not in gone and row.partition(".")[0] not in gone}
    assert set(drive.rows) == expected
    for row in full - expected:
        assert any(channel in drive.motion.left_out[row].channels for channel in lost), row
    fitted = fit(Model.of(base_model(VEHICLE, "hub")), [drive], FitOptions(zeros=False, unbias=False))
    assert set(fitted.rows) == expected
    assert np.all(np.isfinite(fitted.theta))
    assert all(fitted.base.names[k] for k in fitted.base.independent)


def test_driven_and_braked_wheels_have_no_spin_row() -> None:
    """The drive torque is not measured; the brake torque neither, unless the run says that brakes were off."""
    run, _ = made_run()
    motion = reconstruct(run, VEHICLE, RIG)
    assert "drive torque" in row_absence(motion.left_out["spin.fl"])
    assert "spin.rl" in motion.rows
    unknown = reconstruct(replace(run, brakes="unknown"), VEHICLE, RIG)
    assert "brake torque" in row_absence(unknown.left_out["spin.rl"])


def test_nothing_measured_is_said() -> None:
    """A run with speed alone has no row: the error gives the reasons."""
    run, _ = made_run()
    bare = replace(run, signals={"correvit.speed": run.signals["correvit.speed"]})
    with pytest.raises(NotIdentifiable, match="not measured"):
        fit(Model.of(base_model(VEHICLE, "hub")), [PreparedRun.of(bare, VEHICLE, RIG)])


@pytest.mark.parametrize(("seconds", "message"), [(1.5, r"overlap for 1\.\d+ s; at least 2\.17 s"), (0.03, "samples")])
def test_a_run_too_short_is_said(seconds: float, message: str) -> None:
    """With how long it should be."""
    run, _ = made_run(seconds)
    with pytest.raises(RunError, match=message):
        PreparedRun.of(run, VEHICLE, RIG)


def test_channels_that_do_not_overlap_name_the_culprits() -> None:
    """The latest start and the earliest end."""
    run, _ = made_run()
    late = run.signals["imu.rate"]
    signals = {**run.signals, "imu.rate": Signal(late.t + 11.5, late.values, late.flags)}
    with pytest.raises(RunError, match=r"latest start: imu\.rate"):
        PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG)


def test_correction_of_a_latency_undoes_it() -> None:
    """`SensorLatency.correct` reads the channel later: exact to interpolation, for latencies of many samples."""
    from lacet.identify.effects.sensors.sensor_latency import SensorLatency

    fault = SensorLatency("laser")
    assert isinstance(fault, SensorFault)
    curve = cars.MultiSine(np.random.default_rng(0), 1, 0.02)
    t = np.arange(0, 8, 1 / RATE)
    tau = 0.0137
    late = curve.at(t - tau)
    signals = Signals.differentiated({"laser.fl.hub": late}, RATE)
    record = cars.recording(signals, VEHICLE, RIG)
    found = fault.correct("laser.fl.hub", record, tau)
    np.testing.assert_allclose(found[:, 50:-50], curve.at(t)[:, 50:-50], atol=1e-7)
    slope = fault.perturb("laser.fl.hub", record)
    np.testing.assert_allclose(slope[:, 50:-50], -curve.at(t - tau, 1)[:, 50:-50], atol=1e-5)
