"""A car whose wheels hang on inclined swing arms, in MuJoCo: every bench slope at once, from one hinge a corner.

Nothing here is shared with the identification: the engine solves the motion, the transducer's load is read from the
engine, bench tables come from turning the arms. A *moment* is one instant with given loads: positions, velocities and
loads are free, accelerations and hub loads follow. So every row of the equations must close to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from lacet.daq.channels import CORNERS

GRAVITY = 9.81
WHEELBASE = 2.7
MOUNT = np.array([0.04, 0.02, 0.30])
"""Laser mounts from the design wheel centres: not above them [m]."""
IMU = np.array([-1.2, 0.1, 0.25])
RADIUS = 0.32


@dataclass(frozen=True)
class Arm:
    """One corner. Hinge of its swing arm through `hinge` (from the wheel centre at design) along `axis`; static angles
    [rad] about body x and z; carrier with its centre of mass off the wheel centre, hub and disc, rim and tyre."""

    track: float
    hinge: tuple[float, float, float]
    axis: tuple[float, float, float]
    camber: float
    steer: float
    driven: bool = False
    inboard_brake: bool = False
    height: float = 0.30
    setback: float = 0.0
    stiffness: float = 22e3
    damping: float = 2.4e3
    offset: float = 3.6e3
    tyre: float = 2.1e5
    carrier_mass: float = 21.0
    carrier_com: tuple[float, float, float] = (-0.05, 0.04, 0.02)
    carrier_inertia: tuple[float, float, float] = (0.5, 0.7, 0.6)
    hub_mass: float = 6.0
    hub_inertia: tuple[float, float, float] = (0.06, 0.11, 0.06)
    rim_mass: float = 19.0
    rim_inertia: tuple[float, float, float] = (0.5, 0.9, 0.5)


@dataclass(frozen=True)
class SwingCar:
    """Four different corners: no two share an arm, a track, a camber or a spring."""

    arms: Mapping[str, Arm]
    mass: float = 1350.0
    com: tuple[float, float, float] = (-1.15, 0.03, 0.28)
    inertia: np.ndarray = field(
        default_factory=lambda: np.array([[420.0, 6.0, -30.0], [6.0, 1900.0, 4.0], [-30.0, 4.0, 2100.0]])
    )

    def centre(self, c: str) -> np.ndarray:
        """(3,) wheel centre at design height."""
        origin = 0.5 * (self.arms["fl"].height + self.arms["fr"].height)
        side = 1 if c[1] == "l" else -1
        x = (0.0 if c[0] == "f" else -WHEELBASE) - self.arms[c].setback
        return np.array([x, side * self.arms[c].track / 2, self.arms[c].height - origin])


def default_car(driven: str = "r", inboard: str = "", large: float = 0.0) -> SwingCar:
    """Trailing arms, one of them short and steep; `driven`, `inboard` : letters of corners; `large` : camber [rad]."""
    arms = {
        "fl": Arm(1.52, (-0.9, -0.5, 0.10), (0.25, 1.0, 0.15), 0.02, -0.004, stiffness=21e3, tyre=2.0e5),
        "fr": Arm(1.50, (-1.0, 0.4, 0.16), (-0.20, 1.0, 0.10), -0.01, 0.003, stiffness=23e3, tyre=2.05e5),
        "rl": Arm(
            1.48, (0.42, -0.3, 0.06), (0.35, 1.0, -0.08), 0.03, -0.006, offset=3.1e3, carrier_mass=24.0, setback=0.03
        ),
        "rr": Arm(1.46, (0.48, 0.35, 0.09), (-0.30, 1.0, 0.12), -0.03, 0.008, offset=3.2e3, damping=2.8e3),
    }
    return SwingCar(
        {
            c: replace(
                arm,
                driven=c[0] in driven,
                inboard_brake=c[0] in inboard,
                camber=arm.camber + large * (1 if c[1] == "l" else -1),
            )
            for c, arm in arms.items()
        }
    )


class Corner:
    """What an arm's turn by θ does to its wheel: everything by turning it."""

    def __init__(self, car: SwingCar, c: str):
        arm = self.arm = car.arms[c]
        self.side = 1 if c[1] == "l" else -1
        self.p0 = car.centre(c)
        axis = np.array(arm.axis)
        self.axis = axis / np.linalg.norm(axis)
        self.arm_vector = -np.array(arm.hinge)  # hinge to wheel centre
        self.R0 = Rotation.from_euler("ZX", [arm.steer, arm.camber])
        along = self.axis * (self.axis @ self.arm_vector)
        # Heights of the arm's part along the hinge, across it, and turned by a quarter about it.
        self.swing = along[2], (self.arm_vector - along)[2], np.cross(self.axis, self.arm_vector)[2]

    def turned(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Wheel centre (N, 3), R_body_carrier (N, 3, 3), and its steer, camber, pitch (N, 3)."""
        turn = Rotation.from_rotvec(np.asarray(theta)[:, None] * self.axis)
        R = turn * self.R0
        return self.p0 + turn.apply(self.arm_vector) - self.arm_vector, R.as_matrix(), R.as_euler("ZXY")

    def slopes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """∂/∂θ and ∂²/∂θ² of (travel, steer, camber), (2-tuple of (N, 3)), by five-point differences."""

        def values(shift: float) -> np.ndarray:
            p, _, angles = self.turned(theta + shift)
            return np.column_stack([p[:, 2], angles[:, 0], angles[:, 1]])

        h = 2e-3
        a, b, o, d, e = (values(k * h) for k in (-2, -1, 0, 1, 2))
        return (a - 8 * b + 8 * d - e) / (12 * h), (-a + 16 * b - 30 * o + 16 * d - e) / (12 * h * h)

    def table(self) -> dict[str, np.ndarray]:
        """The bench table, as the vehicle file defines its columns."""
        reach = 0.16 / np.hypot(self.arm_vector[0], self.arm_vector[1])
        theta = np.linspace(-reach, reach, 401)
        p, _, angles = self.turned(theta)
        travel = p[:, 2] - self.p0[2]
        order = slice(None) if travel[-1] > travel[0] else slice(None, None, -1)
        columns = {
            "travel": travel,
            "half_track": self.side * (p[:, 1] - self.p0[1]),
            "half_wheelbase": p[:, 0] - self.p0[0],
            "toe": -self.side * (angles[:, 0] - self.arm.steer),
            "camber": -self.side * (angles[:, 1] - self.arm.camber),
            "pitch": angles[:, 2],
        }
        return {key: column[order] for key, column in columns.items()}


def vehicle_text(car: SwingCar) -> str:
    """The car's vehicle file."""

    def q(value: float, unit: str) -> str:
        return f'{{ value = {value!r}, unit = "{unit}", source = "swing car" }}'

    lines = ['format = "lacet-vehicle 1"', 'name = "swing-car"', "[geometry]", f"wheelbase = {q(WHEELBASE, 'm')}"]
    for place, c in (("axle.front", "fl"), ("axle.rear", "rl"), ("corner.fr", "fr"), ("corner.rr", "rr")):
        arm = car.arms[c]
        lines += [
            f"[{place}]", f"track = {q(arm.track, 'm')}", f"wheel_centre_height = {q(arm.height, 'm')}",
            f"tyre_radius = {q(RADIUS, 'm')}", f"setback = {q(arm.setback, 'm')}",
            f"driven = {str(arm.driven).lower()}",
            f'brakes = "{"inboard" if arm.inboard_brake else "outboard"}"', f"[{place}.kinematics]",
        ]  # fmt: skip
        for key, column in Corner(car, c).table().items():
            unit = "m" if key in ("travel", "half_track", "half_wheelbase") else "rad"
            values = ", ".join(f"{v:.15g}" for v in column)
            lines.append(f'{key} = {{ value = [{values}], unit = "{unit}", source = "swing car" }}')
    return "\n".join(lines) + "\n"


RIG = """
format = "lacet-rig 1"
name = "swing-rig"
wheel_reference = "{reference}"
[[sensor]]
name = "wheels"
channels = ["wheel.*"]
[[sensor]]
name = "imu"
channels = ["imu.*"]
position = [{imu[0]}, {imu[1]}, {imu[2]}]
[[sensor]]
name = "lasers"
channels = ["laser.*"]
position_from_wheel_centre = [{mount[0]}, {mount[1]}, {mount[2]}]
[[sensor]]
name = "cameras"
channels = ["camera.*"]
[[sensor]]
name = "torques"
channels = ["shaft.*", "brake.*"]
"""


def rig_text(reference: str) -> str:
    """A rig without latencies."""
    return RIG.format(reference=reference, imu=IMU, mount=MOUNT)


def _numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _inertial(mass: float, com: Any, tensor: np.ndarray) -> str:
    full = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    return f'<inertial pos="{_numbers(com)}" mass="{mass}" fullinertia="{_numbers(full)}"/>'


def _mjcf(car: SwingCar) -> str:
    corners = ""
    for c in CORNERS:
        k, arm = Corner(car, c), car.arms[c]
        quat = np.roll(k.R0.as_quat(), 1)
        corners += (
            f'<body name="carrier_{c}" pos="{_numbers(k.p0)}" quat="{_numbers(quat)}">'
            f'<joint name="arm_{c}" type="hinge" pos="{_numbers(k.R0.inv().apply(-k.arm_vector))}" '
            f'axis="{_numbers(k.R0.inv().apply(k.axis))}"/>'
            f"{_inertial(arm.carrier_mass, arm.carrier_com, np.diag(arm.carrier_inertia))}"
            f'<body name="hub_{c}"><joint name="spin_{c}" type="hinge" axis="0 1 0"/>'
            f"{_inertial(arm.hub_mass, np.zeros(3), np.diag(arm.hub_inertia))}"
            f'<body name="rim_{c}">{_inertial(arm.rim_mass, np.zeros(3), np.diag(arm.rim_inertia))}</body>'
            "</body></body>"
        )
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="0 0 {-GRAVITY}"><flag contact="disable" constraint="disable"/></option><worldbody>'
        f'<body name="chassis"><freejoint/>{_inertial(car.mass, car.com, car.inertia)}{corners}</body>'
        "</worldbody></mujoco>"
    )


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b of two vectors, without NumPy's overhead."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


@dataclass
class Contact:
    """One wheel on the plane road at one instant, ground axes."""

    centre: np.ndarray
    axis: np.ndarray
    deflection: float
    point: np.ndarray


class SwingEngine:
    """The car in MuJoCo on a plane road through `origin` (the ground's). `road` : its normal, ground axes."""

    def __init__(self, car: SwingCar, road: np.ndarray):
        self.car, self.road, self.origin = car, road / np.linalg.norm(road), np.zeros(3)
        self.model = mujoco.MjModel.from_xml_string(_mjcf(car))
        self.data = mujoco.MjData(self.model)
        self.corners = {c: Corner(car, c) for c in CORNERS}

        def dof(name: str) -> int:
            return int(self.model.jnt_dofadr[self.model.joint(name).id])

        self.arm_dof = {c: dof(f"arm_{c}") for c in CORNERS}
        self.spin_dof = {c: dof(f"spin_{c}") for c in CORNERS}
        names = ["chassis", *(f"{part}_{c}" for part in ("carrier", "hub", "rim") for c in CORNERS)]
        self.body = {name: self.model.body(name).id for name in names}

    def place(self, q: np.ndarray, v: np.ndarray) -> None:
        """Go to a state."""
        self.data.qpos[:], self.data.qvel[:] = q, v
        self.data.qfrc_applied[:], self.data.xfrc_applied[:] = 0.0, 0.0
        mujoco.mj_fwdPosition(self.model, self.data)

    def contact(self, c: str) -> Contact:
        """The wheel as a disc: from its centre along its plane, the steepest way down, to the road."""
        rim = self.body[f"rim_{c}"]
        p, n, e = self.data.xpos[rim].copy(), self.data.xmat[rim].reshape(3, 3)[:, 1].copy(), self.road
        down = -(e - n * (n @ e))
        down /= math.sqrt(down @ down)
        reach = -((p - self.origin) @ e) / (down @ e)
        return Contact(p, n, RADIUS - reach, p + reach * down)

    def load(
        self, force: Mapping[str, np.ndarray], moment: Mapping[str, np.ndarray], shaft: Mapping[str, float],
        brake: Mapping[str, float],
    ) -> None:  # fmt: skip
        """Apply wheel loads (ground axes, about the wheel centre), half-shaft and outboard brake torques, springs."""
        x = self.data.xfrc_applied
        for c, k in self.corners.items():
            carrier, hub, rim = (self.body[f"{what}_{c}"] for what in ("carrier", "hub", "rim"))
            n = self.data.xmat[hub].reshape(3, 3)[:, 1]
            x[rim, :3] += force[c]
            x[rim, 3:] += moment[c]
            x[hub, 3:] += (shaft[c] - brake[c]) * n
            x[self.body["chassis"], 3:] -= shaft[c] * n
            x[carrier, 3:] += brake[c] * n
            theta, rate = self.data.qpos[self.arm_dof[c] + 1], self.data.qvel[self.arm_dof[c]]
            c_, s_ = math.cos(theta), math.sin(theta)
            fixed, across, height = k.swing
            s, lift = fixed + c_ * across + s_ * height - k.arm_vector[2], c_ * height - s_ * across  # s, ∂s/∂θ
            arm = k.arm
            self.data.qfrc_applied[self.arm_dof[c]] = -lift * (
                arm.stiffness * s + arm.damping * lift * rate + arm.offset
            )

    def accelerate(self) -> tuple[np.ndarray, dict[str, tuple[np.ndarray, np.ndarray]]]:
        """Accelerations, and the load of rim and tyre on each hub (ground axes, about the wheel centre)."""
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_rnePostConstraint(self.model, self.data)
        hub: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for c in CORNERS:
            rim = self.body[f"rim_{c}"]
            inner = -self.data.cfrc_int[rim]  # of the rim on the hub, about the whole car's centre of mass
            arm = self.data.subtree_com[self.model.body_rootid[rim]] - self.data.xpos[rim]
            hub[c] = inner[3:].copy(), inner[:3] + cross(arm, inner[3:])
        return self.data.qacc.copy(), hub

    def lasers(self, q: np.ndarray) -> np.ndarray:
        """(4,) ground lasers: from the mounts along body −z to the road."""
        w, x, y, z = q[3:7]
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        out = []
        for k in self.corners.values():
            at = q[:3] + R @ (k.p0 + MOUNT)
            out.append(((at - self.origin) @ self.road) / (R[:, 2] @ self.road))
        return np.array(out)

    def laser_rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(4,) their rates, by moving the car a little."""
        ahead, behind, h = q.copy(), q.copy(), 1e-5
        mujoco.mj_integratePos(self.model, ahead, v, h)
        mujoco.mj_integratePos(self.model, behind, v, -h)
        return (self.lasers(ahead) - self.lasers(behind)) / (2 * h)


def tyre_force(contact: Contact, road: np.ndarray, stiffness: float, along: float, across: float) -> np.ndarray:
    """Force of the road: kt δ along its normal, the rest in its plane, ground axes [N]."""
    ahead = cross(contact.axis, road)
    ahead /= math.sqrt(ahead @ ahead)
    return stiffness * contact.deflection * road + along * ahead + across * cross(road, ahead)


Channels = dict[str, np.ndarray]


@dataclass(frozen=True)
class Moments:
    """Instants of a drive: channel values, first and second derivatives, (k, N) by channel name."""

    value: Channels
    rate: Channels
    accel: Channels


def record(
    engine: SwingEngine, q: np.ndarray, v: np.ndarray, a: np.ndarray, loads: np.ndarray, torques: np.ndarray
) -> Moments:
    """What ideal instruments read. `q` (N, nq), `v`, `a` (N, nv); `loads` (N, 4, 6) on the wheels in ground axes;
    `torques` (N, 4, 2) of half-shafts and outboard brakes."""
    R = Rotation.from_quat(np.roll(q[:, 3:7], -1, axis=1))
    w, wd = v[:, 3:6], a[:, 3:6]
    felt = R.inv().apply(a[:, :3] + [0.0, 0.0, GRAVITY])
    out = Moments({}, {}, {})
    out.value["imu.accel"] = (felt + np.cross(wd, IMU) + np.cross(w, np.cross(w, IMU))).T
    out.value["imu.rate"], out.rate["imu.rate"] = w.T, wd.T
    out.value["imu.attitude"] = R.as_euler("ZYX").T[::-1]
    ground = np.array([engine.lasers(one) for one in q])
    ground_rate = np.array([engine.laser_rates(one, speed) for one, speed in zip(q, v, strict=True)])
    for i, (c, k) in enumerate(engine.corners.items()):
        theta, rate, accel = q[:, engine.arm_dof[c] + 1], v[:, engine.arm_dof[c]], a[:, engine.arm_dof[c]]
        p, R_body_carrier, angles = k.turned(theta)
        first, second = k.slopes(theta)
        moved = {"laser.{}.hub": (-1.0, 0), "camera.{}.steer": (1.0, 1), "camera.{}.camber": (1.0, 2)}
        # Mount minus wheel centre, and the two angles.
        now = np.column_stack([p[:, 2] - k.p0[2] - MOUNT[2], angles[:, 0], angles[:, 1]])
        for name, (sign, j) in moved.items():
            channel = name.format(c)
            out.value[channel] = sign * now[None, :, j]
            out.rate[channel] = sign * (first[:, j] * rate)[None]
            out.accel[channel] = sign * (first[:, j] * accel + second[:, j] * rate**2)[None]
        out.value[f"laser.{c}.ground"], out.rate[f"laser.{c}.ground"] = ground[None, :, i], ground_rate[None, :, i]
        out.value[f"wheel.{c}.speed"] = v[None, :, engine.spin_dof[c]]
        out.rate[f"wheel.{c}.speed"] = a[None, :, engine.spin_dof[c]]
        R_ground_carrier = R * Rotation.from_matrix(R_body_carrier)
        out.value[f"wheel.{c}.force"] = R_ground_carrier.inv().apply(loads[:, i, :3]).T
        out.value[f"wheel.{c}.moment"] = R_ground_carrier.inv().apply(loads[:, i, 3:]).T
        out.value[f"shaft.{c}.torque"], out.value[f"brake.{c}.torque"] = torques[None, :, i, 0], torques[None, :, i, 1]
    return out


def moments(
    engine: SwingEngine, reference: str, seed: int, n: int = 30, drive: float = 800.0, brake: float = 1500.0
) -> Moments:
    """Random instants: the car anywhere near the road, moving anyhow, with any loads that the tyres' stiffness allows.

    `drive`, `brake` : 1 σ of the half-shafts' torque on driven wheels and of the brakes' on all of them [N·m].
    """
    rng, model, road = np.random.default_rng(seed), engine.model, engine.road
    q, v, a = np.zeros((n, model.nq)), np.zeros((n, model.nv)), np.zeros((n, model.nv))
    loads, torques = np.zeros((n, 4, 6)), np.zeros((n, 4, 2))
    level, _ = Rotation.align_vectors([road], [[0.0, 0.0, 1.0]])
    for i in range(n):
        tilt = Rotation.from_euler("ZYX", [rng.uniform(-3, 3), *rng.normal(0, 0.03, 2)])
        q[i, :3] = road * rng.normal(0.30, 0.01) + level.apply([*rng.uniform(-50, 50, 2), 0.0])
        q[i, 3:7] = np.roll((level * tilt).as_quat(), 1)
        v[i, :3], v[i, 3:6] = rng.normal(0, 10, 3), rng.normal(0, 0.5, 3)
        for c, k in engine.corners.items():
            reach = 0.03 / np.hypot(*k.arm_vector[:2])
            q[i, engine.arm_dof[c] + 1], v[i, engine.arm_dof[c]] = rng.normal(0, reach), rng.normal(0, 10 * reach)
            q[i, engine.spin_dof[c] + 1], v[i, engine.spin_dof[c]] = rng.uniform(-3, 3), rng.normal(70, 20)
        engine.place(q[i], v[i])
        force, moment, shaft, outboard = {}, {}, {}, {}
        for j, (c, k) in enumerate(engine.corners.items()):
            along, across = rng.normal(0, 2000, 2)
            force[c] = tyre_force(engine.contact(c), road, k.arm.tyre, along, across)
            moment[c] = rng.normal(0, 300, 3)
            on = brake * rng.normal()
            shaft[c] = drive * rng.normal() * k.arm.driven - on * k.arm.inboard_brake
            outboard[c] = on * (not k.arm.inboard_brake)
            torques[i, j] = shaft[c], outboard[c]
        engine.load(force, moment, shaft, outboard)
        a[i], hub = engine.accelerate()
        for j, c in enumerate(CORNERS):
            loads[i, j] = np.concatenate([force[c], moment[c]] if reference == "contact" else hub[c])
    return record(engine, q, v, a, loads, torques)


@dataclass(frozen=True)
class Drive:
    """A drive on a shaker: the plane road heaves, pitches and rolls under the car. 500 samples a second.

    `value` : channels without noise, by name; `t` (N,) s; `braking` (N,) whether the brakes act.
    """

    t: np.ndarray
    value: Mapping[str, Channels]
    braking: np.ndarray


STEP, SETTLE = 2e-3, 2.0
FRICTION = 0.9


def drive(car: SwingCar, seconds: float, torque: float, brake: float, seed: int = 1) -> Drive:
    """Drive in pulses of `torque` [N·m] on each driven wheel and brake in between with `brake` on each wheel.

    Tyres: kt δ along the normal, tanh of the slip in the road's plane. Leap-frog integration, so that the second
    differences of what is recorded are the accelerations the loads belong to.
    """
    rng = np.random.default_rng(seed)
    engine = SwingEngine(car, np.array([0.0, 0.0, 1.0]))
    model, data = engine.model, engine.data
    w, phase = 2 * np.pi * rng.uniform(0.3, 3.5, (3, 8)), rng.uniform(0, 2 * np.pi, (3, 8))
    size = np.array([[0.012], [0.008], [0.012]]) / (1.0 + w / 10.0)
    q, v = np.zeros(model.nq), np.zeros(model.nv)
    q[2], q[3], v[0] = 0.305, 1.0, 20.0
    v[list(engine.spin_dof.values())] = 20.0 / 0.30
    before = np.zeros(model.nv)
    steps, first = round((seconds + SETTLE) / STEP), round(SETTLE / STEP)
    kept: list[tuple[Any, ...]] = []
    for k in range(steps):
        t = k * STEP - SETTLE
        heave, pitch, roll = np.sum(size * np.sin(w * t + phase), axis=1) * min(1.0, k * STEP)
        normal = np.array([math.sin(pitch), math.sin(roll), 1.0])
        engine.road = normal / math.sqrt(normal @ normal)
        engine.origin = np.array([q[0], q[1], heave])
        on = t > 0 and t % 6.0 > 3.5
        now = v + 0.5 * STEP * before
        engine.place(q, now)
        force, moment, shaft, outboard = {}, {}, {}, {}
        for c, corner in engine.corners.items():
            touch = engine.contact(c)
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, engine.body[f"rim_{c}"], velocity, 0)
            arm = touch.point - touch.centre
            slip = velocity[3:] + cross(velocity[:3], arm)
            ahead = cross(touch.axis, engine.road)
            load = max(0.0, corner.arm.tyre * touch.deflection)
            speed = max(3.0, abs(velocity[3:] @ ahead))
            side = cross(engine.road, ahead)
            along, across = (-FRICTION * load * math.tanh(18.0 * (slip @ axis) / speed) for axis in (ahead, side))
            force[c] = tyre_force(touch, engine.road, corner.arm.tyre, along, across)
            moment[c] = cross(arm, force[c])
            mine = brake * (0.5 - 0.5 * np.cos(2 * np.pi * (t % 6.0 - 3.5) / 2.5)) * on
            pulse = torque * np.sin(2 * np.pi * t / 3.0) ** 2 * (t > 0) * (not on)
            shaft[c] = pulse * corner.arm.driven - mine * corner.arm.inboard_brake
            outboard[c] = mine * (not corner.arm.inboard_brake)
        engine.load(force, moment, shaft, outboard)
        before, hub = engine.accelerate()
        if k >= first:
            loads = {
                "contact": [np.concatenate([force[c], moment[c]]) for c in CORNERS],
                "hub": [np.concatenate(hub[c]) for c in CORNERS],
            }
            torques = [(shaft[c], outboard[c]) for c in CORNERS]
            kept.append((t, q.copy(), v + 0.5 * STEP * before, before, loads, torques, engine.lasers(q), on))
        v = v + STEP * before
        mujoco.mj_integratePos(model, q, v, STEP)
    q, v, a = (np.array([one[i] for one in kept]) for i in (1, 2, 3))
    torques = np.array([one[5] for one in kept])
    value: dict[str, Channels] = {}
    for reference in ("contact", "hub"):
        loads = np.array([one[4][reference] for one in kept])
        value[reference] = record(engine, q, v, a, loads, torques).value
        for i, c in enumerate(CORNERS):
            value[reference][f"laser.{c}.ground"] = np.array([[one[6][i] for one in kept]])
    return Drive(np.array([one[0] for one in kept]), value, np.array([one[7] for one in kept]))


def _about(mass: float, com: np.ndarray, tensor: np.ndarray) -> list[float]:
    """Ten parameters about the origin: XX XY XZ YY YZ ZZ MX MY MZ M."""
    full = tensor + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return [*full[np.triu_indices(3)], *(mass * com), mass]


def truth(car: SwingCar, reference: str) -> dict[str, float]:
    """Parameter name → value, for the bodies inboard of the transducer (``hub``) or all of them."""
    ten = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
    out = {f"{name}6": x for name, x in zip(ten, _about(car.mass, np.array(car.com), car.inertia), strict=True)}
    for c, first in {"rl": 7, "rr": 16, "fl": 25, "fr": 34}.items():
        arm = car.arms[c]
        carrier = _about(arm.carrier_mass, np.array(arm.carrier_com), np.diag(arm.carrier_inertia))
        out |= {f"{name}{first + 4}": x for name, x in zip(ten, carrier, strict=True)}
        outboard = reference == "contact"
        side, spin, _ = np.array(arm.hub_inertia) + outboard * np.array(arm.rim_inertia)
        out |= {f"ZZ{first + 7}": spin, f"XX{first + 7}": side, f"MZ{first + 7}": 0.0}
        out[f"M{first + 7}"] = arm.hub_mass + outboard * arm.rim_mass
        out |= {f"spring.{c}.k": arm.stiffness, f"damper.{c}.c": arm.damping, f"offset.{c}.f0": arm.offset}
        out |= {f"tyre_stiffness.{c}.kt": arm.tyre, f"outboard_mass.{c}.m": arm.rim_mass}
    return out
