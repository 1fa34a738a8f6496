"""What the sensors deliver: definitions, clocks, noise, reproducibility."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.channels import CHANNELS, CORNERS, IN_EQUATIONS
from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.simulate import IDEAL, Hidden, Sheet, Timing, exchange_run, find_car, measure
from lacet.simulate.measuring import START_NS, interpolate
from lacet.simulate.road import ROUGHNESS, rough_road
from tests.simulate.simulated_drives import RIG, drive, make_rig

CAR = find_car("peugeot-406")
QUIET = Sheet(zeros=False)


def rz(a: np.ndarray) -> np.ndarray:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.moveaxis(np.array([[c, -s, o], [s, c, o], [o, o, i]]), -1, 0)


def rx(a: np.ndarray) -> np.ndarray:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.moveaxis(np.array([[i, o, o], [o, c, -s], [o, s, c]]), -1, 0)


def ry(a: np.ndarray) -> np.ndarray:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.moveaxis(np.array([[c, o, s], [o, i, o], [-s, o, c]]), -1, 0)


def difference(x: np.ndarray, rate: float) -> np.ndarray:
    """Fourth-order central difference of the inner samples."""
    return (-x[4:] + 8 * x[3:-1] - 8 * x[1:-3] + x[:-4]) * rate / 12


def test_springs_dampers_and_tyres_follow_from_the_channels_alone() -> None:
    """From measured channels to k, c, offset and kt by least squares, with nothing taken from the simulation."""
    motion = drive("rough", grade="C")
    text = "\n".join(line for line in RIG.splitlines() if not line.startswith("latency"))
    rig = Rig.parse(text.format(reference="contact", axes="carrier"), "trial")
    run = exchange_run(motion, rig, rate=1000.0, sheet=QUIET, noise=False)
    value = {name: signal.values for name, signal in run.signals.items()}
    imu = rig.sensor_of("imu.accel")
    assert imu is not None
    roll, pitch, yaw = (np.array([a]) for a in imu.orientation)
    R = (rz(yaw) @ ry(pitch) @ rx(roll))[0]
    rate = value["imu.rate"] @ R.T
    accel, turn = value["imu.accel"] @ R.T, difference(rate, 1000.0)
    mount = np.asarray(imu.position[""])
    inner = slice(2, -2)
    for i, corner in enumerate(CORNERS):
        axle = CAR.axle(corner)
        n = CAR.wheel_centres[i]
        s = 0.30 - value[f"laser.{corner}.hub"][:, 0]
        sd = difference(s, 1000.0)
        sdd = np.gradient(np.gradient(s, 1e-3), 1e-3)[inner]
        r = n + np.outer(s, [0, 0, 1]) - mount
        w = rate[inner]
        felt = accel[inner] + np.cross(turn, r[inner]) + np.cross(w, np.cross(w, r[inner]))
        felt[:, 2] += sdd
        felt += 2 * np.cross(w, np.outer(sd, [0, 0, 1]))
        steer, camber = value[f"camera.{corner}.steer"][:, 0], value[f"camera.{corner}.camber"][:, 0]
        R_carrier = rz(steer) @ rx(camber) @ ry(motion_pitch(motion, i, len(s)))
        force = np.einsum("nij,nj->ni", R_carrier, value[f"wheel.{corner}.force"])
        y = force[inner, 2] - axle.unsprung_mass * felt[:, 2]
        columns = np.stack([s[inner], sd, np.ones_like(sd)], 1)
        k, c, offset = np.linalg.lstsq(columns, y, rcond=None)[0]
        assert k == pytest.approx(axle.stiffness, rel=2e-3)
        assert c == pytest.approx(axle.damping, rel=2e-3)
        assert offset == pytest.approx(CAR.offsets[i], rel=2e-3)
        height = (value[f"laser.{corner}.ground"] - value[f"laser.{corner}.hub"])[:, 0]
        e = road_normal(value)
        axis = R_carrier[..., 1]
        deflection = axle.radius - height * e[:, 2] / np.sqrt(1 - np.sum(axis * e, 1) ** 2)
        kt = np.sum(force * e, 1) @ deflection / (deflection @ deflection)
        assert kt == pytest.approx(axle.tyre_stiffness, rel=1e-6)


def motion_pitch(motion, i: int, n: int) -> np.ndarray:
    """Carrier pitch of the first n samples (no channel measures it: geometry of the kingpin)."""
    return motion.carrier_pitch[:n, i]


def road_normal(value: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 3) normal of the least-squares plane through the four ground-laser points, body axes."""
    centres = CAR.wheel_centres
    z = np.stack([centres[i, 2] + 0.30 - value[f"laser.{c}.ground"][:, 0] for i, c in enumerate(CORNERS)])
    a = np.linalg.lstsq(np.column_stack([centres[:, :2], np.ones(4)]), z, rcond=None)[0]
    e = np.stack([-a[0], -a[1], np.ones_like(a[0])], 1)
    return e / np.linalg.norm(e, axis=1, keepdims=True)


def test_correvit_gives_the_speed_over_the_road_in_heading_axes() -> None:
    motion = drive("sinus")
    speed = measure(motion, make_rig(), noise=False, sheet=QUIET, timing=IDEAL)["correvit.speed"].values
    R, mount = motion.attitude, np.array([-3.2, 0.0, 0.01])
    path = motion.position + np.einsum("nij,j->ni", R, mount)
    ground = difference(path, motion.rate)[::4]
    yaw = np.arctan2(R[2:-2:4, 1, 0], R[2:-2:4, 0, 0])
    along = np.cos(yaw) * ground[:, 0] + np.sin(yaw) * ground[:, 1]
    across = -np.sin(yaw) * ground[:, 0] + np.cos(yaw) * ground[:, 1]
    half = interpolate(np.stack([along, across], 1), 250.0, np.arange(8, len(along) - 8) / 250.0 - 0.002)
    assert speed[8 : 8 + len(half)] == pytest.approx(half, abs=1e-4)


def test_imu_specific_force_is_the_second_derivative_of_its_path_minus_gravity() -> None:
    motion = drive("sweep")
    rig = make_rig()
    accel = measure(motion, rig, noise=False, sheet=QUIET, timing=IDEAL)["imu.accel"].values
    mount = np.array([-1.35, 0.1, 0.31])
    path = motion.position + np.einsum("nij,j->ni", motion.attitude, mount)
    second = (path[2:] - 2 * path[1:-1] + path[:-2]) * motion.rate**2 + [0, 0, CAR.gravity]
    size = np.linalg.norm(second, axis=1)[4::5]
    assert np.linalg.norm(accel, axis=1)[1 : 1 + len(size)] == pytest.approx(size, abs=2e-3)


def test_noise_has_the_sheets_size_and_zeros_are_one_draw_a_run() -> None:
    motion, rig = drive("sinus"), make_rig()
    clean = measure(motion, rig, 1, noise=False, sheet=QUIET, timing=IDEAL)
    noisy = measure(motion, rig, 1, sheet=QUIET, timing=IDEAL)
    shifted = measure(motion, rig, 1, noise=False, timing=IDEAL)
    draws = []
    for name, channel in ((n, CHANNELS[n]) for n in IN_EQUATIONS):
        error = noisy[name].values - clean[name].values
        if channel.family == "wheel.angle":
            error = np.mod(error + np.pi, 2 * np.pi) - np.pi
        n = error.size
        assert np.std(error) == pytest.approx(channel.noise, rel=5 / np.sqrt(2 * n))
        assert abs(np.mean(error)) < 5 * channel.noise / np.sqrt(n)
        assert abs(np.mean(error[1:] * error[:-1])) < 5 * channel.noise**2 / np.sqrt(n)
        zero = shifted[name].values - clean[name].values
        assert np.max(np.ptp(zero, axis=0)) < 1e-9
        if sigma := rig.tolerance(name, "zero"):
            draws += (zero[0] / sigma).tolist()
    assert len(draws) > 40
    assert np.std(draws) == pytest.approx(1.0, abs=0.4)
    assert np.max(np.abs(draws)) < 5


def test_same_seed_same_samples_and_another_seed_other_noise() -> None:
    motion, rig = drive("sinus"), make_rig()
    first, again, other = (measure(motion, rig, seed) for seed in (4, 4, 5))
    fewer = Rig.parse(rig.text.replace('"camera.*"', '"camera.fl.*"'), "fewer")
    partly = measure(motion, fewer, 4)
    for name in IN_EQUATIONS:
        assert np.array_equal(first[name].values, again[name].values)
        assert np.array_equal(first[name].t_ns, again[name].t_ns)
        assert not np.array_equal(first[name].values[:50], other[name].values[:50])
        if name in partly:
            assert np.array_equal(first[name].values, partly[name].values)
    assert "camera.rr.steer" not in partly
    assert drive("rough").force == pytest.approx(drive.__wrapped__("rough").force, abs=0)


def test_gains_and_latencies_belong_to_the_instrument_not_to_the_run() -> None:
    motion, rig = drive("sinus"), make_rig()
    sheet = Sheet(zeros=False, gains=True, latencies=True, seed=9)
    one, two = (measure(motion, rig, seed, noise=False, sheet=sheet, timing=IDEAL) for seed in (1, 2))
    plain = measure(motion, rig, 1, noise=False, sheet=QUIET, timing=IDEAL)
    for name in IN_EQUATIONS:
        assert np.array_equal(one[name].values, two[name].values)
    late = (one["imu.rate"].t_ns - plain["imu.rate"].t_ns)[0]
    assert late != 0
    assert late == (one["imu.accel"].t_ns - plain["imu.accel"].t_ns)[0]
    ratio = one["wheel.fl.force"].values[:, 2] / plain["wheel.fl.force"].values[:, 2]
    assert np.ptp(ratio) < 1e-12
    assert 1e-6 < abs(ratio[0] - 1) < 0.02


@settings(max_examples=20, deadline=None)
@given(st.floats(0, 100), st.floats(0, 0.02), st.integers(0, 1000))
def test_arrivals_are_late_by_latency_and_bounded_jitter_and_keep_their_order(
    drift: float, jitter: float, seed: int
) -> None:
    motion, rig = drive("sinus"), make_rig()
    timing = Timing(drift, {"serial": jitter, "udp": jitter})
    blocks = measure(motion, rig, seed, timing=timing, noise=False, sheet=QUIET)
    ideal = measure(motion, rig, seed, timing=Timing(drift, {}), noise=False, sheet=QUIET)
    for name, latency in (("imu.rate", 0.004), ("camera.fl.steer", 0.025)):
        block, punctual = blocks[name], ideal[name]
        late = (block.t_ns - punctual.t_ns) * 1e-9
        assert np.all(late >= 0)
        assert np.all(late <= jitter + 1e-8)
        assert np.all(np.diff(block.t_ns) >= 0)
        assert np.array_equal(block.values, punctual.values)
        assert block.device_ns is not None
        period = 1e9 / CHANNELS[name].rate
        assert np.all(np.abs(np.diff(block.device_ns) - period) <= 1)
        t = (punctual.t_ns - START_NS) * 1e-9 - latency
        pace = np.polyfit(t, block.device_ns * 1e-9, 1)[0]
        assert abs(pace - 1) < 6 * drift * 1e-6 + 1e-8
        ideal_at = interpolate(motion.steer[:, :1], motion.rate, t)
        if name.startswith("camera"):
            assert block.values == pytest.approx(ideal_at, abs=1e-9)
    assert blocks["wheel.fl.force"].device_ns is None


def test_a_table_holds_what_was_felt_a_latency_before_its_stamp() -> None:
    motion, rig = drive("sinus"), make_rig()
    run = exchange_run(motion, rig, noise=False, sheet=QUIET)
    for name, felt in (("camera.fl.steer", motion.steer[:, :1]), ("laser.rr.hub", 0.30 - motion.travel[:, 0, 3:])):
        t = run.signals[name].t - rig.latency(name)
        assert t[0] >= 0
        assert run.signals[name].values == pytest.approx(interpolate(felt, motion.rate, t), abs=1e-12)
    late = exchange_run(motion, rig, noise=False, sheet=QUIET, faults=[Hidden("sensor_latency.camera", 0.02)])
    assert late.signals["camera.fl.steer"].values[:-5] == pytest.approx(
        run.signals["camera.fl.steer"].values[: len(late.signals["camera.fl.steer"].t) - 5], abs=1e-12
    )


def test_exchange_table_round_trip(tmp_path) -> None:
    motion = drive("braking")
    run = exchange_run(motion, make_rig("hub"), 2)
    write_table(run, tmp_path / "braking.parquet")
    back = open_run(tmp_path / "braking.parquet")
    assert set(back.signals) == set(IN_EQUATIONS)
    assert (back.brakes, back.wheel_reference, back.vehicle) == ("used", "hub", "peugeot-406")
    assert not back.problems
    for name in IN_EQUATIONS:
        if CHANNELS[name].family not in ("wheel.angle", "imu.attitude"):
            assert np.array_equal(back.signals[name].values, run.signals[name].values)
    assert np.all(np.diff(back.signals["wheel.fl.angle"].values[:, 0]) > 0)
    assert np.diff(run.signals["imu.rate"].t) == pytest.approx(1 / 250)


def test_truth_is_json_and_never_in_the_blocks() -> None:
    motion = drive("sinus", "anti_roll_bar.front=19780")
    truth = json.loads(json.dumps(motion.truth()))
    assert truth["hidden"][0]["size"] == 19780
    assert truth["car"]["front"]["stiffness"] == 20000
    assert truth["car"]["whole"]["mass"] == pytest.approx(1668.5)


@pytest.mark.parametrize("grade", ROUGHNESS)
def test_random_roads_have_their_classes_spectrum_and_coherent_tracks(grade: str) -> None:
    roads = [rough_road(grade, 0.0, 800.0, seed, 1.49, 0.01) for seed in range(6)]
    left = np.array([r.left[2000:-2000] for r in roads])
    right = np.array([r.right[2000:-2000] for r in roads])
    window = np.hanning(left.shape[1])
    a, b = np.fft.rfft(left * window), np.fft.rfft(right * window)
    wave = np.fft.rfftfreq(left.shape[1], 0.01)
    for low, high in ((0.05, 0.15), (0.3, 0.6), (1.0, 2.0)):
        band = (wave > low) & (wave < high)
        for x in (a, b):
            density = 2 * 0.01 * np.mean(np.abs(x[:, band]) ** 2, 0) / np.sum(window**2)
            expected = ROUGHNESS[grade] * (wave[band] / 0.1) ** -2
            assert np.mean(density / expected) == pytest.approx(1.0, rel=0.2)
        cross = np.abs(np.sum(a[:, band] * np.conj(b[:, band])))
        coherence = cross / np.sqrt(np.sum(np.abs(a[:, band]) ** 2) * np.sum(np.abs(b[:, band]) ** 2))
        weight = wave[band] ** -2.0
        expected = np.sum(weight * np.exp(-3.0 * 1.49 * wave[band])) / np.sum(weight)
        assert coherence == pytest.approx(expected, abs=0.12)
    same = rough_road(grade, 0.0, 800.0, 0, 1.49, 0.01)
    assert np.array_equal(same.left, roads[0].left)


def test_wheel_loads_in_other_axes_are_the_same_loads() -> None:
    motion = drive("rough")
    given = {
        axes: measure(motion, make_rig("hub", axes), noise=False, sheet=QUIET, timing=IDEAL)
        for axes in ("carrier", "body", "tydex_c")
    }
    pick = slice(0, -1, 2)  # 500 Hz samples of the 1 kHz motion
    R = motion.carrier_attitude[pick]
    for i, corner in enumerate(CORNERS):
        for what in ("force", "moment"):
            carrier, body, tydex = (given[axes][f"wheel.{corner}.{what}"].values[:-1] for axes in given)
            assert np.einsum("nij,nj->ni", R[:, i], carrier) == pytest.approx(body, abs=1e-8)
            assert tydex[:, 1] == pytest.approx(carrier[:, 1], abs=1e-8)  # both have y along the spin axis
            assert np.linalg.norm(tydex, axis=1) == pytest.approx(np.linalg.norm(carrier, axis=1), rel=1e-12)
    # x of TYDEX C is parallel to the road: what stands on the road has no share along it but by friction
    n, e = motion.carrier_attitude[pick, 0, :, 1], motion.normal[pick]
    x = np.cross(n, e)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    body = given["body"]["wheel.fl.force"].values[:-1]
    assert given["tydex_c"]["wheel.fl.force"].values[:-1, 0] == pytest.approx(np.sum(x * body, 1), abs=1e-8)
