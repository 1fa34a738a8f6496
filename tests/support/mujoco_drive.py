"""A drive of an exported car by MuJoCo alone, measured from MuJoCo's own sensors, states and forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.rig import Rig
from lacet.daq.run import Run, signal_of

Array = np.ndarray
GRAVITY = 9.80665
STEP = 0.001
EVERY = 4
"""Steps of 1 ms between recorded instants: 250 Hz."""
CORNERING = 55e3
"""N/rad"""

Forces = Callable[[Any, Any, Array], Array]
"""Vertical tyre forces (4,) [N] from model, data and the road's height; it may also apply other forces."""


def without_latency(rig: Rig) -> Rig:
    """The rig with sensors that are not late."""
    return replace(rig, sensors=tuple(replace(sensor, latency=0.0) for sensor in rig.sensors))


def with_sensors(spec: Any, rig: Rig, on: str) -> Any:
    """The model of a specification with inertial unit and speed sensor, and the wheels' loads felt in bodies `on`_*."""
    sensor, kind = spec.add_sensor, mujoco.mjtSensor
    for name, channel in (("imu", "imu.accel"), ("correvit", "correvit.speed")):
        found = rig.sensor_of(channel)
        assert found is not None
        spec.body("chassis").add_site(name=name, pos=found.position[""])
    for kind_, name in ((kind.mjSENS_ACCELEROMETER, "imu"), (kind.mjSENS_GYRO, "imu"),
                        (kind.mjSENS_VELOCIMETER, "correvit")):  # fmt: skip
        sensor(type=kind_, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name)
    for c in CORNERS:
        spec.body(f"{on}_{c}").add_site(name=f"felt_{c}", pos=[0, 0, 0])
        for kind_ in (kind.mjSENS_FORCE, kind.mjSENS_TORQUE):
            sensor(type=kind_, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=f"felt_{c}")
    return spec.compile()


class Waves:
    """A sum of sines with random phases: `size` is its 1 σ, `band` lowest and highest frequency [Hz]."""

    def __init__(self, rng: np.random.Generator, size: float, band: tuple[float, float], tones: int = 14):
        self.w = 2 * np.pi * np.geomspace(*band, tones) * rng.uniform(0.95, 1.05, tones)
        self.phase, self.size = rng.uniform(0, 2 * np.pi, tones), size * np.sqrt(2 / tones)

    def __call__(self, t: float) -> float:
        return float(self.size * np.sum(np.sin(self.w * t + self.phase)))


def drive(
    model: Any, vehicle: Any, rig: Rig, tyres: Forces, name: str, seed: int, *, seconds: float, steer: float,
    push: float, bumps: float, speed: float = 22.0, on: str = "rim",
) -> Run:  # fmt: skip
    """A run of the model: steering angles `steer` [rad], forces along the road `push` [N], a road of `bumps` [m] (1 σ).

    MuJoCo solves for accelerations; they are integrated to third order (Adams), so that forces, velocities and
    positions belong to one instant. Across the road a wheel has a force in proportion to its slip angle.
    """
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    waves = Waves(rng, steer, (0.2, 2.5)), Waves(rng, push, (0.3, 3.0)), Waves(rng, bumps, (0.5, 12.0))
    body = {c: model.body(f"{on}_{c}").id for c in CORNERS}
    carrier = {c: model.body(f"carrier_{c}").id for c in CORNERS}
    spin = [int(model.joint(f"spin_{c}").dofadr[0]) for c in CORNERS]
    data.qvel[0] = speed
    data.qvel[spin] = speed / 0.31
    before, count = 1000, round(seconds * 250)
    rows: dict[str, list[Array]] = {}
    rates, speeds = np.zeros((3, model.nv)), np.zeros((2, model.nv))
    for k in range(before + EVERY * count):
        t = (k - before) * STEP
        height = waves[2](t) * min(1.0, k / before)
        data.xfrc_applied[:] = 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        angle = waves[0](t) * min(1.0, k / before)
        upward = tyres(model, data, np.array([angle, height]))
        road = np.zeros((4, 3))
        for i, c in enumerate(CORNERS):
            n = data.xmat[carrier[c]].reshape(3, 3)[:, 1]
            forward = np.cross(n, [0.0, 0.0, 1.0])
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body[c], velocity, 0)
            slip = float(np.arctan2(velocity[3:] @ n, abs(velocity[3:] @ forward)))
            load = max(0.0, upward[i]) / 4000.0
            road[i] = -CORNERING * load * np.tanh(slip / 0.08) * 0.08 * n
            road[i] += (0.5 * waves[1](t) - 40.0 * (velocity[3:] @ forward - speed)) * forward * (0.6 if i < 2 else 0.4)
            # xfrc_applied acts at the centre of mass, the tyre's force at the wheel centre and its moment about it.
            arm = data.xpos[body[c]] - data.xipos[body[c]]
            moment = np.cross([0.0, 0.0, -0.3], road[i])
            moment -= n * (n @ moment)
            data.xfrc_applied[body[c], :3] += road[i]
            data.xfrc_applied[body[c], 3:] += np.cross(arm, road[i]) + moment
        mujoco.mj_forward(model, data)
        if k >= before and (k - before) % EVERY == 0:
            for channel, value in _felt(model, data, vehicle, rig, upward, height, on).items():
                rows.setdefault(channel, []).append(value)
        rates[1:], rates[0] = rates[:-1].copy(), data.qacc
        speeds[1], speeds[0] = speeds[0], data.qvel
        data.qvel[:] += STEP * (np.array([23.0, -16.0, 5.0]) / 12.0 @ rates)
        mean = (5.0 * data.qvel + 8.0 * speeds[0] - speeds[1]) / 12.0
        mujoco.mj_integratePos(model, data.qpos, mean, STEP)
    t = np.arange(count) / 250.0
    signals = {}
    for channel, values in rows.items():
        exact = np.array(values).reshape(count, -1)
        signals[channel] = signal_of(channel, t, exact + rig.noise(channel) * rng.standard_normal(exact.shape))
    return Run(
        name, {c: signals[c] for c in CHANNELS if c in signals}, wheel_reference=rig.wheel_reference, brakes="off"
    )


def _felt(model: Any, data: Any, vehicle: Any, rig: Rig, upward: Array, height: float, on: str) -> dict[str, Array]:
    """Exact measurements of one instant."""
    q, v = data.qpos, data.qvel
    chassis = model.body("chassis").id
    R = data.xmat[chassis].reshape(3, 3)
    out: dict[str, Array] = {"imu.accel": data.sensordata[0:3], "imu.rate": data.sensordata[3:6]}
    roll, pitch, yaw = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])
    out["imu.attitude"] = np.array([roll, pitch, yaw])
    east = R @ data.sensordata[6:9]
    c, s = np.cos(yaw), np.sin(yaw)
    out["correvit.speed"] = np.array([c * east[0] + s * east[1], -s * east[0] + c * east[1]])
    for i, corner in enumerate(CORNERS):
        body, carrier = model.body(f"{on}_{corner}").id, model.body(f"carrier_{corner}").id
        C = data.xmat[carrier].reshape(3, 3)
        centre = np.asarray(vehicle.corners[corner].position)
        now = R.T @ (data.xpos[carrier] - data.xpos[chassis])
        mount = centre + np.array([0.0, 0.0, 0.30])
        out[f"laser.{corner}.hub"] = mount[2:] - now[2:]
        above = data.xpos[chassis][2] + R[2] @ np.array([now[0], now[1], mount[2]]) - height
        out[f"laser.{corner}.ground"] = np.array([above / R[2, 2]])
        A = R.T @ C
        out[f"camera.{corner}.steer"] = np.array([np.arctan2(-A[0, 1], A[1, 1])])
        out[f"camera.{corner}.camber"] = np.array([np.arcsin(A[2, 1])])
        joint = model.joint(f"spin_{corner}")
        out[f"wheel.{corner}.speed"] = v[joint.dofadr[0] : joint.dofadr[0] + 1].copy()
        out[f"wheel.{corner}.angle"] = q[joint.qposadr[0] : joint.qposadr[0] + 1].copy()
        # MuJoCo's interaction force knows of applied forces, not of those that actuators exert at a site.
        W = data.site_xmat[model.site(f"felt_{corner}").id].reshape(3, 3)
        at = 9 + 6 * i
        force, moment = W @ data.sensordata[at : at + 3], W @ data.sensordata[at + 3 : at + 6]
        tyre = np.array([0.0, 0.0, upward[i]]) if model.nu else np.zeros(3)
        out[f"wheel.{corner}.force"] = C.T @ (tyre - force)
        out[f"wheel.{corner}.moment"] = C.T @ -moment
        assert body > 0
    return {name: value.copy() for name, value in out.items()}
