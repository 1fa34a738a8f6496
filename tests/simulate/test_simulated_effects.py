"""Each hidden effect changes what it should and nothing else."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import UsageError
from lacet.services.commands.__main__ import main
from lacet.simulate import IDEAL, KINDS, Hidden, Sheet, find_car, measure
from lacet.simulate.motion import SimulatedMotion, euler_zyx, rotate_back
from lacet.simulate.sensors import pose_matrix
from tests.simulate.simulated_drives import drive, make_rig
from tests.support.places import HOME

CAR = find_car("peugeot-406")
K = np.array([CAR.axle(c).stiffness for c in CORNERS])
C = np.array([CAR.axle(c).damping for c in CORNERS])
UNSPRUNG = np.array([CAR.axle(c).unsprung_mass for c in CORNERS])
QUIET = Sheet(zeros=False)


def suspension_residual(motion: SimulatedMotion) -> np.ndarray:
    """(N, 4) what the base model's suspension row leaves over [N]."""
    felt = motion.wheel_centre_motion[1] - motion.gravity[:, None]
    s = motion.travel
    return motion.force[..., 2] - UNSPRUNG * felt[..., 2] - K * s[:, 0] - C * s[:, 1] - CAR.offsets


def tyre_residual(motion: SimulatedMotion) -> np.ndarray:
    """(N, 4) what kt·δ leaves over along the road normal [N]."""
    return np.sum(motion.force * motion.normal[:, None], -1) - CAR.front.tyre_stiffness * motion.deflection


def chassis_residual(motion: SimulatedMotion) -> np.ndarray:
    """(N, 3) what the base model's chassis force rows leave over [N]."""
    body = CAR.chassis
    felt = motion.at(np.asarray([body.com]))[1][:, 0] - motion.gravity
    wheels = UNSPRUNG[:, None] * (motion.wheel_centre_motion[1] - motion.gravity[:, None])
    return motion.force.sum(1) - body.mass * felt - wheels.sum(1)


LAWS = {
    "anti_roll_bar.front=19780": lambda s, v, other: 19780 * (s - other),
    "coulomb.rear=40": lambda s, v, other: 40 * np.tanh(v / 0.01),
    "damper_asymmetry.front=900": lambda s, v, other: 900 * np.abs(v),
    "damper_digressive.rear=-1500": lambda s, v, other: -1500 * v * np.abs(v),
    "damper_knee.rear=900,v0=0.02": lambda s, v, other: -900 * np.sign(v) * np.maximum(0, np.abs(v) - 0.02),
    "friction_of_load.front=4000": lambda s, v, other: 4000 * np.maximum(0, s) * np.tanh(v / 0.01),
    "damper_stroke.front=20000": lambda s, v, other: 20000 * s * v,
    "damper_groove.front=3000,length=0.005": lambda s, v, other: 3000 * v * np.minimum(1, np.abs(s) / 0.005),
    "spring_quadratic.rear=80000": lambda s, v, other: 80000 * s**2,
    "spring_cubic.front=4e6": lambda s, v, other: 4e6 * s**3,
    "bump_stop.rear=100000,gap=0.004": lambda s, v, other: 1e5 * np.maximum(0, s - 0.004),
    "bump_stop_quadratic.rear=2e6,gap=0.004": lambda s, v, other: 2e6 * np.maximum(0, s - 0.004) ** 2,
    "rebound_stop.front=100000,gap=0.004": lambda s, v, other: 1e5 * np.minimum(0, s + 0.004),
    "helper_spring.rear=15000,gap=-0.002": lambda s, v, other: 15000 * np.minimum(s, -0.002),
}


def test_every_suspension_effect_is_tried() -> None:
    tried = {text.split(".")[0] for text in LAWS}
    here = list(KINDS).index("anti_dive")
    assert tried == set(list(KINDS)[:here])


@pytest.mark.parametrize("text", LAWS)
def test_suspension_effects_leave_their_law_at_their_axle_and_nothing_elsewhere(text: str) -> None:
    motion = drive("rough", text)
    residual, s = suspension_residual(motion), motion.travel
    there = [0, 1] if ".front" in text else [2, 3]
    for i in range(4):
        expected = LAWS[text](s[:, 0, i], s[:, 1, i], s[:, 0, i ^ 1]) if i in there else 0.0
        assert residual[:, i] == pytest.approx(expected, abs=1e-8)
    assert np.max(np.abs(residual[:, there])) > 5.0
    assert np.max(np.abs(tyre_residual(motion))) < 1e-8
    assert np.max(np.abs(chassis_residual(motion))) < 1e-8


def test_an_interconnection_couples_front_and_rear_of_each_side() -> None:
    motion = drive("rough", "interconnection=3000")
    s = motion.travel[:, 0]
    expected = 3000 * (s - s[:, [2, 3, 0, 1]])
    assert suspension_residual(motion) == pytest.approx(expected, abs=1e-8)
    assert np.max(np.abs(expected)) > 5.0
    assert np.max(np.abs(chassis_residual(motion))) < 1e-8


def test_tyre_effects_show_in_the_tyre_rows_of_their_axle_alone() -> None:
    damped, stiffer = drive("rough", "tyre_damping.front=150"), drive("rough", "tyre_progression.rear=3e6")
    inner = slice(2, -2)
    d = damped.deflection
    rate = (-d[4:] + 8 * d[3:-1] - 8 * d[1:-3] + d[:-4]) / (12 / damped.rate)
    residual = tyre_residual(damped)
    assert residual[inner, :2] == pytest.approx(150 * rate[:, :2], abs=0.05 * 150 * np.max(np.abs(rate)))
    assert np.corrcoef(residual[inner, 0], rate[:, 0])[0, 1] > 0.999
    assert np.max(np.abs(residual[:, 2:])) < 1e-8
    residual = tyre_residual(stiffer)
    assert residual[:, 2:] == pytest.approx(3e6 * stiffer.deflection[:, 2:] ** 2)
    assert np.max(np.abs(residual[:, :2])) < 1e-8
    for motion in (damped, stiffer):
        assert np.max(np.abs(suspension_residual(motion))) < 1e-8
        assert np.max(np.abs(chassis_residual(motion))) < 1e-8


def test_air_and_payload_show_in_the_chassis_rows_alone() -> None:
    motion = drive("liftoff", "aero_drag=0.4,height=0.5", "aero_lift.rear=0.2")
    vx = motion.at(np.zeros((1, 3)))[0][:, 0, 0]
    assert chassis_residual(motion)[:, 0] == pytest.approx(0.4 * vx**2)
    assert chassis_residual(motion)[:, 2] == pytest.approx(-0.2 * vx**2)
    arm = 0.5 - CAR.origin_height
    assert motion.air[:, 1, 1] == pytest.approx(-arm * 0.4 * vx**2 + CAR.wheelbase * 0.2 * vx**2)
    assert np.max(np.abs(suspension_residual(motion))) < 1e-8
    loaded = drive("rough", "payload=80,x=-2.5,y=0.3,z=0.4")
    felt = loaded.at(np.array([[-2.5, 0.3, 0.4]]))[1][:, 0] - loaded.gravity
    assert chassis_residual(loaded) == pytest.approx(80 * felt, abs=1e-7)
    assert np.max(np.abs(suspension_residual(loaded))) < 1e-8


@pytest.mark.parametrize("text", ["rolling_resistance.front=0.02", "camber_thrust.rear=0.8"])
def test_what_the_wheels_measure_leaves_no_residual(text: str) -> None:
    motion, plain = drive("sinus", text), drive("sinus")
    for residual in (suspension_residual, tyre_residual, chassis_residual):
        assert np.max(np.abs(residual(motion))) < 1e-8
    assert np.max(np.abs(motion.force - plain.force)) > 10.0


def test_tilted_slides_add_their_share_of_the_horizontal_force() -> None:
    motion = drive("braking", "anti_dive.front=0.06", "jacking.rear=0.05")
    u = motion.slides
    assert u[0] == pytest.approx([0.06, 0, 1])
    assert u[3] == pytest.approx([0, -0.05, 1])
    felt = motion.wheel_centre_motion[1] - motion.gravity[:, None]
    s = motion.travel
    row = np.sum((motion.force - UNSPRUNG[:, None] * felt) * u, -1)
    assert row == pytest.approx(K * s[:, 0] + C * s[:, 1] + CAR.offsets, abs=1e-7)
    v = motion.wheel_centres
    assert v[:, 0, 0] == pytest.approx(0.06 * s[:, 0, 0], abs=1e-12)


FAULTS = {
    "sensor_latency.imu=0.01": {"imu."},
    "sensor_latency.laser.ground=0.01": {"laser.fl.ground", "laser.fr.ground", "laser.rl.ground", "laser.rr.ground"},
    "sensor_gain.wheel.force=0.02": {f"wheel.{c}.force" for c in CORNERS},
    "sensor_gain.hub.rl=0.02": {"laser.rl.hub"},
    "sensor_zero.wheel.fl.force.x=50": {"wheel.fl.force"},
    "sensor_drift.imu.rate.z=0.01": {"imu.rate"},
    "sensor_misalignment.imu.yaw=0.02": {"imu."},
    "sensor_misalignment.correvit.yaw=0.02": {"correvit."},
    "sensor_crosstalk.wheel.force=0.01": {f"wheel.{c}.force" for c in CORNERS},
    "sensor_crosstalk.rl=0.01": {"wheel.rl.force"},
    "sensor_drift.wheel.force=60": {f"wheel.{c}.force" for c in CORNERS},
    "sensor_position.imu.z=0.1": {"imu.accel"},
    "laser_tilt.roll=0.03": {f"laser.{c}.ground" for c in CORNERS},
}


@pytest.mark.parametrize("text", FAULTS)
def test_sensor_faults_touch_their_channels_alone(text: str) -> None:
    motion, rig, fault = drive("sinus"), make_rig(), Hidden.parse(text)
    good, bad = (measure(motion, rig, 3, timing=IDEAL, sheet=QUIET, noise=False, faults=f) for f in ([], [fault]))
    changed = set()
    for name in good:
        common = np.isin(good[name].t_ns, bad[name].t_ns)  # a late sensor has nothing to deliver at first
        late = len(bad[name]) - np.count_nonzero(common)
        assert late == 0
        assert np.count_nonzero(~common) <= 3
        if not np.array_equal(good[name].values[common], bad[name].values):
            changed.add(name)
    assert changed
    assert all(any(name.startswith(start) for start in FAULTS[text]) for name in changed)
    assert all(any(name.startswith(start) for name in changed) for start in FAULTS[text])
    if "zero" in text:
        assert bad["wheel.fl.force"].values - good["wheel.fl.force"].values == pytest.approx(
            np.tile([50.0, 0, 0], (len(good["wheel.fl.force"]), 1))
        )


def good_and_bad(text: str, motion: SimulatedMotion) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Values by channel without and with a fault, nothing else wrong."""
    out = []
    for faults in ([], [Hidden.parse(text)]):
        blocks = measure(motion, make_rig(), 3, timing=IDEAL, sheet=QUIET, noise=False, faults=faults)
        out.append({name: block.values for name, block in blocks.items()})
    return out[0], out[1]


@pytest.mark.parametrize(("axis", "at"), [("x", [1.0, 0, 0]), ("y", [0, 1.0, 0]), ("z", [0, 0, 1.0])])
def test_misplaced_imu_feels_the_acceleration_of_where_it_is(axis: str, at: list[float]) -> None:
    motion = drive("sinus")
    good, bad = good_and_bad(f"sensor_position.imu.{axis}=0.2", motion)
    R = pose_matrix(0.02, -0.03, 0.05)
    w, wd, arm = motion.turn[::5], motion.turn_rate[::5], 0.2 * np.asarray(at)
    more = np.cross(wd, arm) + np.cross(w, np.cross(w, arm))
    assert bad["imu.accel"] - good["imu.accel"] == pytest.approx(more @ R, abs=1e-9)
    assert np.max(np.abs(more)) > 0.01


@pytest.mark.parametrize(("axis", "down"), [("pitch", [-0.05, 0.0, -1.0]), ("roll", [0.0, 0.05, -1.0])])
@pytest.mark.parametrize("name", ["sinus", "rough"])
def test_tilted_laser_beams_end_on_the_road(name: str, axis: str, down: list[float]) -> None:
    motion = drive(name)
    good, bad = good_and_bad(f"laser_tilt.{axis}={float(np.arctan(0.05))!r}", motion)
    beam = np.asarray(down) / np.linalg.norm(down)
    for i, corner in enumerate(CORNERS):
        assert np.array_equal(bad[f"laser.{corner}.hub"], good[f"laser.{corner}.hub"])
        mount = CAR.wheel_centres[i] + [0, 0, 0.30]
        reach = mount + bad[f"laser.{corner}.ground"] * beam
        end = motion.position[::4] + np.einsum("nij,nj->ni", motion.attitude[::4], reach)
        assert end[:, 2] == pytest.approx(motion.road.height(end[:, 0], corner[1]), abs=1e-5)
        assert np.max(np.abs(bad[f"laser.{corner}.ground"] - good[f"laser.{corner}.ground"])) > 3e-4


def test_crosstalk_takes_the_share_of_each_pair() -> None:
    motion = drive("braking")
    good, bad = good_and_bad("sensor_crosstalk.fr=0.01,x=0,y=2,zx=-1,zy=0.5", motion)
    x, y, z = good["wheel.fr.force"].T
    assert bad["wheel.fr.force"] == pytest.approx(np.stack([x, y + 0.02 * z, z + 0.01 * (-x + 0.5 * y)], 1))


def test_drift_of_a_family_grows_with_time() -> None:
    good, bad = good_and_bad("sensor_drift.wheel.force=60", drive("sinus"))
    for corner in CORNERS:
        more = bad[f"wheel.{corner}.force"] - good[f"wheel.{corner}.force"]
        assert more == pytest.approx(np.repeat(np.arange(len(more))[:, None] / 500.0, 3, 1), abs=1e-9)


def test_a_slope_is_in_gravity_and_in_what_the_inertial_unit_measures() -> None:
    motion = drive("straight", "slope.grade=0.05", "slope.bank=-0.03")
    g, plain = motion.gravity, drive("straight")
    assert np.linalg.norm(g, axis=1) == pytest.approx(CAR.gravity)
    on_road = np.einsum("nij,nj->ni", motion.attitude, g)
    ahead, across = -np.sin(0.05), np.cos(0.05) * np.sin(0.03)
    assert on_road[:, :2] == pytest.approx(np.tile([ahead, across], (len(g), 1)) * CAR.gravity, abs=1e-9)
    for residual in (suspension_residual, tyre_residual, chassis_residual):
        assert np.max(np.abs(residual(motion))) < 1e-8
    roll, pitch, _ = euler_zyx(motion.level_attitude)[-1] - euler_zyx(plain.level_attitude)[-1]
    assert pitch == pytest.approx(-0.05, rel=0.3)  # nose up when it climbs, and the springs give some more
    assert roll == pytest.approx(-0.03, rel=0.5)
    # gravity by the measured attitude is gravity
    down = rotate_back(motion.level_attitude, np.array([0.0, 0.0, -CAR.gravity]))
    assert down == pytest.approx(g, abs=1e-12)


@pytest.mark.parametrize("name", ["sensor_latency.imu", "sensor_latency.laser.ground"])
@pytest.mark.parametrize("size", [0.02, -0.02])
def test_a_late_sensor_delivers_older_values(name: str, size: float) -> None:
    motion, rig = drive("sinus"), make_rig()
    good, bad = (
        measure(motion, rig, 3, timing=IDEAL, noise=False, faults=faults) for faults in ([], [Hidden(name, size)])
    )
    channel = "imu.rate" if name.endswith("imu") else "laser.rl.ground"
    steps = round(size * CHANNELS[channel].rate)
    now = {int(t): v for t, v in zip(good[channel].t_ns, good[channel].values, strict=True)}
    period = round(1e9 / CHANNELS[channel].rate)
    for t, v in list(zip(bad[channel].t_ns, bad[channel].values, strict=True))[10:-10]:
        assert v == pytest.approx(now[int(t) - steps * period], abs=1e-12)
    assert np.array_equal(bad["laser.rl.ground"].t_ns, bad["laser.rl.hub"].t_ns)  # they share a frame


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("anti_rol_bar.front=1", "anti_roll_bar.front"),
        ("anti_roll_bar.middle=1", "anti_roll_bar.front"),
        ("anti_roll_bar=1", "anti_roll_bar.front"),
        ("aero_drag.front=1", "aero_drag"),
        ("bump_stop.front=1,gapp=2", "gap"),
        ("bump_stop.front", "name=size"),
        ("coulomb.rear=nan", "finite"),
        ("sensor_latency.imv=0.1", "imu"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_match(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        Hidden.parse(text)


def test_documentation_lists_every_effect_with_its_unit_and_constants() -> None:
    text = (HOME / "docs" / "simulated-car.md").read_text(encoding="utf-8")
    rows = {line.split("`")[1]: line for line in text.splitlines() if line.startswith("| `")}
    assert set(rows) == set(KINDS)
    for name, kind in KINDS.items():
        cells = [cell.strip() for cell in rows[name].replace("\\|", "!").strip("|").split("|")]
        assert cells[2] == kind.unit.replace("-", "–")
        given = dict(zip(re.findall(r"`(\w+)`", cells[4]), re.findall(r"` ([−\d.]+)", cells[4]), strict=True))
        assert set(given) == set(kind.shape)
        for key, value in given.items():
            assert float(value.replace("−", "-")) == kind.shape[key]


def test_hide_alone_lists_every_effect(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "--hide"])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    for name, kind in KINDS.items():
        assert f"{name}  [{kind.unit}]" in printed
        assert kind.about in printed
