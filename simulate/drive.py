"""Time integration of a simulated drive.

Third-order Adams–Bashforth for velocities and slip states, third-order Adams–Moulton for positions (the new velocity
is known when the position is integrated): the equations of motion are solved once a step, and that solution is
recorded, so that forces and accelerations belong to one instant.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.errors import LacetError
from lacet.simulate.cars import Car
from lacet.simulate.engine import Engine
from lacet.simulate.hidden import Hidden
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.engine import LinkageEngine, wheel_motion
from lacet.simulate.linkage.motion import LinkageMotion
from lacet.simulate.manoeuvres import Manoeuvre
from lacet.simulate.memory import OwnLaw
from lacet.simulate.mjcf import level
from lacet.simulate.motion import CarMotion, SimulatedMotion, matrices, rotate_back

STEP = 0.0005
"""Integration step [s]."""
RUBBER_STEP = 0.00025
"""Integration step [s] of a second car on rubber, whose wishbones vibrate on their bushings at up to 300 Hz."""
RECORDED = 0.001
"""Time between recorded instants [s]."""
SETTLE = 2.0
"""Time driven before the recorded run [s]."""
BASHFORTH = np.array([[1.0, 0.0, 0.0], [1.5, -0.5, 0.0], [23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0]])
"""Weights of the rates, newest first, on the first, second and every later step."""
MOULTON = ((0.5, np.array([0.5, 0.0])), (5.0 / 12.0, np.array([8.0 / 12.0, -1.0 / 12.0])))
"""Weights of the new velocity and of the old ones, on the first and every later step."""
FRONT_BRAKES = 0.66
"""Share of the braking torque at the front axle."""


class SimulationFailed(LacetError):
    """Failure of a simulation: the car left the range in which the model is valid."""


class _Recorder:
    """Arrays of a recorded motion, one row an instant."""

    def __init__(self, n: int, nq: int, nv: int, states: int = 8):
        self.states, self.outside = np.zeros((n, states - 8)), np.zeros((n, 6))
        self.q, self.v, self.a = np.empty((n, nq)), np.empty((n, nv)), np.empty((n, nv))
        self.force, self.moment = np.empty((n, 4, 3)), np.empty((n, 4, 3))
        self.normal, self.air = np.empty((n, 3)), np.empty((n, 2, 3))
        self.distance, self.deflection, self.suspension = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4))
        self.shaft, self.brake = np.empty((n, 4)), np.empty((n, 4))

    def write(
        self, row: int, engine: Engine | LinkageEngine, a: NDArray[np.float64], shaft: Sequence[float],
        brake: Sequence[float], states: NDArray[np.float64] | None = None,
    ):  # fmt: skip
        """Record the engine's present instant."""
        now = engine.now
        self.q[row], self.v[row], self.a[row] = engine.data.qpos, engine.data.qvel, a
        self.force[row], self.moment[row] = now.force, now.moment
        self.normal[row], self.air[row, 0], self.air[row, 1] = now.normal, now.air_force, now.air_moment
        self.distance[row], self.deflection[row] = now.distance, now.deflection
        self.suspension[row], self.shaft[row], self.brake[row] = now.suspension, shaft, brake
        self.outside[row] = now.outside
        if states is not None:
            self.states[row] = states


@overload
def run(
    vehicle: Car,
    manoeuvre: Manoeuvre,
    hidden: Sequence[Hidden] = (),
    seed: int = 0,
    settle: float = SETTLE,
    step: float | None = None,
    progress: Callable[[float], None] | None = None,
    own: Sequence[OwnLaw] = (),
) -> SimulatedMotion: ...


@overload
def run(
    vehicle: SecondCar,
    manoeuvre: Manoeuvre,
    hidden: Sequence[Hidden] = (),
    seed: int = 0,
    settle: float = SETTLE,
    step: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> LinkageMotion: ...


def run(
    vehicle: Car | SecondCar,
    manoeuvre: Manoeuvre,
    hidden: Sequence[Hidden] = (),
    seed: int = 0,
    settle: float = SETTLE,
    step: float | None = None,
    progress: Callable[[float], None] | None = None,
    own: Sequence[OwnLaw] = (),
) -> CarMotion:
    """The motion of `vehicle` driven through `manoeuvre`, at 1 kHz, without any sensor.

    `hidden` : effects added to the car (sensor faults are kept for `measure`); `seed` : of the random road; `settle` :
    time driven before the run starts [s]; `step` : integration step [s], a divisor of 1 ms, by default 0.5 ms, for a
    second car on rubber 0.25 ms; `progress` : called with the fraction done every 0.1 s of the run; `own` : suspension
    laws given as functions, of a `Car`. The same arguments give the same motion. Raises UsageError when MuJoCo is
    missing, SimulationFailed when the car overturns or leaves the road.
    """
    if isinstance(vehicle, SecondCar):
        step = (STEP if vehicle.rigid else RUBBER_STEP) if step is None else step
        engine = LinkageEngine(vehicle, manoeuvre.road(vehicle.sizes, seed, settle), hidden)
        record = _drive(engine, manoeuvre, settle, step, progress)
        return _linkage_motion(engine, manoeuvre, record, tuple(hidden), seed)
    car = vehicle
    for effect in hidden:
        if effect.effect == "payload":
            car = car.with_payload(effect.size, (effect.shape["x"], effect.shape["y"], effect.shape["z"]))
    road = manoeuvre.road(car, seed, settle)
    engine = Engine(car, road, [effect for effect in hidden if not effect.of_sensor], own)
    record = _drive(engine, manoeuvre, settle, STEP if step is None else step, progress)
    return _motion(engine, manoeuvre, record, tuple(hidden), seed)


def _drive(
    engine: Engine | LinkageEngine,
    manoeuvre: Manoeuvre,
    settle: float,
    step: float,
    progress: Callable[[float], None] | None,
) -> _Recorder:
    every = round(RECORDED / step)
    before = round(settle / (step * every)) * every
    samples = round(manoeuvre.duration / (step * every)) + 1
    record = _Recorder(samples, engine.model.nq, engine.model.nv, engine.states)
    _integrate(engine, manoeuvre, record, before, samples, every, step, progress or (lambda fraction: None))
    return record


def _integrate(
    engine: Engine | LinkageEngine, manoeuvre: Manoeuvre, record: _Recorder, before: int, samples: int, every: int,
    step: float, progress: Callable[[float], None],
) -> None:  # fmt: skip
    data, car, lib = engine.data, engine.car, engine.lib
    radii = [
        car.axle(c).radius - d / car.axle(c).tyre_stiffness / 3 for c, d in zip(CORNERS, car.static_loads, strict=True)
    ]
    data.qvel[0] = manoeuvre.speed
    for dof, radius in zip(engine.spin_dof, radii, strict=True):
        data.qvel[dof] = manoeuvre.speed / radius
    mass = car.total.mass + (car.payload.mass if car.payload else 0.0)
    driven, torque, brakes = engine.driven, 0.0, 0.0
    nv = engine.model.nv
    shares = [
        axle / 2.0 * (1.0 + side * uneven)
        for axle, uneven in zip((FRONT_BRAKES, 1.0 - FRONT_BRAKES), manoeuvre.uneven, strict=True)
        for side in (1.0, -1.0)
    ]
    drag = [car.axle(c).brake_drag for c in CORNERS]
    state = np.concatenate([data.qvel, np.zeros(engine.states)])  # velocities, tyre slips, states of hidden effects
    rates, speeds = np.zeros((3, len(state))), np.zeros((2, nv))  # newest first
    for k in range(before + (samples - 1) * every + 1):
        t = (k - before) * step
        q, v = data.qpos.tolist(), data.qvel.tolist()
        if not math.isfinite(sum(q) + sum(v)):
            raise _failed(manoeuvre, t)
        speed, steer = _driver(manoeuvre, t, q, v)
        torque += step / manoeuvre.torque_lag * (manoeuvre.drive(t, speed) - torque)
        brakes += step / 0.02 * (manoeuvre.brake(t, speed) - brakes)
        total = brakes * mass * car.front.radius
        shaft = [torque / len(driven) if i in driven else 0.0 for i in range(4)]
        brake = [total * part + released for part, released in zip(shares, drag, strict=True)]
        now = engine.load(q, v, state[nv:].tolist(), steer, shaft, brake, step)
        a = engine.accelerate()
        if k >= before and (k - before) % every == 0:
            record.write((k - before) // every, engine, a, shaft, brake, state[nv + 8 :])
            _check(manoeuvre, t, q, a)
        rates[1:], rates[0, :nv], rates[0, nv:] = rates[:-1].copy(), a, now.slip_rates
        speeds[1], speeds[0] = speeds[0], state[:nv]
        if k % 200 == 0:
            progress(k * step / (before * step + manoeuvre.duration))
        state += step * (BASHFORTH[min(k, 2)] @ rates)
        data.qvel[:] = state[:nv]
        new, old = MOULTON[min(k, 1)]
        lib.mj_integratePos(engine.model, data.qpos, new * state[:nv] + old @ speeds, step)
        engine.close(state)


def _driver(manoeuvre: Manoeuvre, t: float, q: list[float], v: list[float]) -> tuple[float, float]:
    """Forward speed and demanded steering angle; on a straight the driver keeps to the line y = 0."""
    w, x, y, z = q[3:7]
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    steer = manoeuvre.steer(t)
    if manoeuvre.straight or t < 0.0:
        steer += max(-0.02, min(0.02, -0.1 * yaw - 0.004 * q[1]))
    return v[0] * math.cos(yaw) + v[1] * math.sin(yaw), steer


def _check(manoeuvre: Manoeuvre, t: float, q: list[float], a: NDArray[np.float64]) -> None:
    upright = 1.0 - 2.0 * (q[4] ** 2 + q[5] ** 2)
    if not np.all(np.isfinite(a)) or upright < 0.9:
        raise _failed(manoeuvre, t)


def _failed(manoeuvre: Manoeuvre, t: float) -> SimulationFailed:
    return SimulationFailed(
        f"the simulated car overturned or flew apart {t:.2f} s into '{manoeuvre.name}': "
        "lower the amplitude or the speed, or the size of the hidden effects"
    )


def _of_any_car(
    engine: Engine | LinkageEngine, manoeuvre: Manoeuvre, record: _Recorder, hidden: tuple[Hidden, ...], seed: int
) -> dict[str, Any]:
    """What the motions of all cars have."""
    spin, n = engine.spin_dof, len(record.q)
    return {
        "road": engine.road,
        "manoeuvre": manoeuvre.name,
        "settings": dataclasses.asdict(manoeuvre),
        "brakes": manoeuvre.brakes,
        "hidden": hidden,
        "seed": seed,
        "rate": 1.0 / RECORDED,
        "t": np.arange(n) * RECORDED,
        "position": record.q[:, :3],
        "velocity": record.v[:, :3],
        "acceleration": record.a[:, :3],
        "attitude": matrices(record.q[:, 3:7]),
        "turn": record.v[:, 3:6],
        "turn_rate": record.a[:, 3:6],
        "spin": np.stack([record.q[:, engine.spin_q], record.v[:, spin], record.a[:, spin]], axis=1),
        "force": record.force,
        "moment": record.moment,
        "distance": record.distance,
        "normal": record.normal,
        "deflection": record.deflection,
        "shaft": record.shaft,
        "brake": record.brake * np.tanh(record.v[:, spin]),
    }


def _linkage_motion(
    engine: LinkageEngine, manoeuvre: Manoeuvre, record: _Recorder, hidden: tuple[Hidden, ...], seed: int
) -> LinkageMotion:
    wheels = wheel_motion(engine, record.q, record.v, record.a)
    return LinkageMotion(
        **_of_any_car(engine, manoeuvre, record, hidden, seed),
        car=engine.car,
        level=np.eye(3),
        centres=wheels["centre"],
        attitudes=wheels["attitude"],
        centre_velocity=wheels["velocity"],
        centre_acceleration=wheels["acceleration"],
        carrier_rate=wheels["turn"],
        carrier_rate_change=wheels["turn_rate"],
        q=record.q,
        v=record.v,
        a=record.a,
    )


def _motion(
    engine: Engine, manoeuvre: Manoeuvre, record: _Recorder, hidden: tuple[Hidden, ...], seed: int
) -> SimulatedMotion:
    def joint(dofs: list[int], scale: Sequence[float]) -> NDArray[np.float64]:
        out = np.zeros((len(record.q), 3, 4))
        for i, dof in enumerate(dofs):
            if dof >= 0:
                columns = record.q[:, dof + 1], record.v[:, dof], record.a[:, dof]
                out[:, :, i] = np.stack(columns, axis=1) / scale[i]
        return out

    def columns(dofs: Sequence[int]) -> NDArray[np.float64]:
        at = list(dofs)
        return np.stack([record.q[:, [dof + 1 for dof in at]], record.v[:, at], record.a[:, at]], axis=1)

    given = _of_any_car(engine, manoeuvre, record, hidden, seed)
    twist = np.zeros((len(record.q), 3)) if engine.twist is None else columns([engine.torsion_dof])[..., 0]
    return SimulatedMotion(
        **given,
        car=engine.car,
        travel=joint(engine.slide_dof, engine.stretch),
        kingpin=joint(engine.steer_dof, [1.0] * 4),
        suspension=record.suspension,
        air=record.air,
        slides=engine.slides,
        turns=engine.turns,
        twist=twist,
        twist_height=engine.twist.z if engine.twist is not None else 0.0,
        attached={part.name: columns(dofs) for part, dofs in zip(engine.attached, engine.attached_dof, strict=True)},
        outside=np.stack([rotate_back(given["attitude"], record.outside[:, :3]), record.outside[:, 3:]], axis=1),
        level=level(engine.hidden),
        memory=record.states,
    )
