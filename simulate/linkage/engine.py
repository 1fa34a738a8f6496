"""Engine of the second car on a road: the forces of one step, and its accelerations.

What drives it is the first car's: the same tyres, roads, manoeuvres, steering response and integrator. A wheel's road
is the plane through the four points below the wheel centres, as there. The rack moves as the driver demands: by the
steer of the front wheels (mean of both at the design position) times the rack's travel per angle.

Half-shafts: the torque on a wheel about its spin axis reacts on the chassis, or on the engine where it is on mounts.
Brakes act between wheel and carrier.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.simulate.air import Air
from lacet.simulate.engine import STEER_FREQUENCY, Instant
from lacet.simulate.hidden import Hidden, total_at
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.front import RACK_ARMATURE
from lacet.simulate.linkage.hidden_laws import OF_TYRES, laws_of
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.state import cross
from lacet.simulate.linkage.statics import rack_per_steer
from lacet.simulate.road import SPACING, Road
from lacet.simulate.tyre import WheelTyre

Array = NDArray[np.float64]


class LinkageEngine:
    """MuJoCo engine of a second car on a road, with the interface of `simulate.engine.Engine`.

    Raises UsageError for hidden effects that it cannot have (`hidden_laws`).
    """

    def __init__(self, car: SecondCar, road: Road, hidden: Sequence[Hidden] = ()):
        self.car, self.road = car, road
        self.mechanism = Mechanism(car, laws_of(hidden, car.name))
        self._air = Air(hidden, car.wheelbase, car.origin_height)
        self.lib, self.model, self.data = self.mechanism.lib, self.mechanism.model, self.mechanism.data
        self.spin_dof, self.spin_q = self.mechanism.spin_dof, self.mechanism.spin_q
        self.states = 8 + self.mechanism.elements.states
        """Number of states besides MuJoCo's: 8 slips, then the stretch of the dampers' mounts."""
        self._tyres = [
            WheelTyre(car.axle(c), car.tyre, *(total_at(hidden, name, c) for name in OF_TYRES)) for c in CORNERS
        ]
        self._tracks = (road.left.tolist(), road.right.tolist())
        self._ratio = rack_per_steer(self.mechanism)
        self._tops = self.mechanism.design_attitudes[:, :, 1]
        self.now = Instant()
        self.now.slip_rates = [0.0] * self.states

    @property
    def driven(self) -> list[int]:
        """Indices of the driven corners."""
        return [i for i, c in enumerate(CORNERS) if self.car.axle(c).driven]

    def load(
        self,
        q: list[float],
        v: list[float],
        slips: list[float],
        steer: float,
        shaft: Sequence[float],
        brake: Sequence[float],
        step: float,
    ) -> Instant:
        """The forces at state (q, v), applied to the model; arguments as of `simulate.engine.Engine.load`."""
        mechanism, data, now = self.mechanism, self.data, self.now
        mechanism.refresh()
        mechanism.clear()
        rates = mechanism.elements.apply(np.array(slips[8:]))
        origin, R = mechanism.body_axes()
        centres = data.xpos[mechanism.wheels]
        axes = np.einsum("nij,nj->ni", data.xmat[mechanism.carriers].reshape(-1, 3, 3), self._tops)
        velocities = mechanism.wheel_points.velocity(centres) @ R
        turns = mechanism.carrier_points.turn() @ R
        e, distances = self._road_below(centres, origin, R)
        n = (axes @ R).tolist()
        up = now.normal = (float(e[0]), float(e[1]), float(e[2]))
        speeds, spins = velocities.tolist(), turns.tolist()
        for i in range(4):
            got = self._tyres[i].contact(
                n[i], up, distances[i] * up[2], speeds[i], spins[i], v[self.spin_dof[i]], slips[i], slips[i + 4], step
            )  # fmt: skip
            now.force[i], now.moment[i], now.deflection[i] = got.force, got.moment, got.deflection
            now.distance[i], now.spin_axis[i] = distances[i], n[i]
            now.slip_rates[i], now.slip_rates[i + 4] = got.kappa_rate, got.alpha_rate
        now.slip_rates[8:] = rates.tolist()
        torque, held = np.array(shaft), np.array(brake) * np.tanh(np.array([v[dof] for dof in self.spin_dof]))
        force, moment = np.array(now.force) @ R.T, np.array(now.moment) @ R.T
        at = mechanism.wheels
        data.xfrc_applied[at, :3] += force
        data.xfrc_applied[at, 3:] += moment + cross(centres - data.xipos[at], force) + (torque - held)[:, None] * axes
        np.add.at(data.xfrc_applied[:, 3:], mechanism.carriers, held[:, None] * axes)
        data.xfrc_applied[mechanism.shaft_body, 3:] -= torque @ axes
        if self._air.acts:
            speed = R.T @ np.array(v[:3])
            now.air_force, now.air_moment = self._air.load(float(speed[0]), float(speed[1]))
            mechanism.on_part(mechanism.chassis_body, R @ now.air_force, R @ now.air_moment, origin)
        rack = mechanism.rack_dof
        demand = steer * self._ratio - q[mechanism.rack_q]
        data.qfrc_applied[rack] += RACK_ARMATURE * STEER_FREQUENCY * (STEER_FREQUENCY * demand - 2.0 * v[rack])
        return now

    def accelerate(self) -> Array:
        """Accelerations of the present state under the loads set."""
        self.mechanism.applied()
        a = self.data.qacc_smooth.copy()
        if self.mechanism.loops.count:
            a = self.mechanism.loops.accelerate(a)[0]
        return a

    def close(self, state: Array) -> None:
        """Close the loops of the data's state, and set the velocities in `state` to those found."""
        self.mechanism.loops.close()
        state[: self.model.nv] = self.data.qvel

    def _height(self, x: float, corner: int) -> float:
        track = self._tracks[corner % 2]
        at = (x - self.road.start) / SPACING
        i = math.floor(at)
        return track[i] + (at - i) * (track[i + 1] - track[i]) if 0 <= i < len(track) - 1 else 0.0

    def _road_below(self, centres: Array, origin: Array, R: Array) -> tuple[Array, list[float]]:
        """Normal (body axes) of the plane through the points below the wheel centres, and their distances along -z."""
        down = R[:, 2]
        if self.road.flat:
            return R[2], (centres[:, 2] / down[2]).tolist()
        distances = np.array(self.now.distance)
        for _ in range(2):
            at = centres[:, 0] - distances * down[0]
            ground = [self._height(x, i) for i, x in enumerate(at.tolist())]
            distances = (centres[:, 2] - ground) / down[2]
        feet = (centres - origin) @ R
        feet[:, 2] -= distances
        middle = feet - feet.mean(axis=0)
        xx, xy, yy = middle[:, 0] @ middle[:, 0], middle[:, 0] @ middle[:, 1], middle[:, 1] @ middle[:, 1]
        xz, yz = middle[:, 0] @ middle[:, 2], middle[:, 1] @ middle[:, 2]
        size = xx * yy - xy * xy
        slope_x, slope_y = (yy * xz - xy * yz) / size, (xx * yz - xy * xz) / size
        length = math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        return np.array([-slope_x / length, -slope_y / length, 1.0 / length]), distances.tolist()


def wheel_motion(engine: LinkageEngine, q: Array, v: Array, a: Array) -> dict[str, Any]:
    """Motion of the wheels over a run, from the engine's coordinates (N, nq), velocities and accelerations (N, nv).

    `centre` (N, 4, 3) and `attitude` (N, 4, 3, 3) relative to the body, body axes; `velocity`, `acceleration`, `turn`,
    `turn_rate` (N, 4, 3) in space, body axes.
    """
    mechanism, data = engine.mechanism, engine.data
    n = len(q)
    out: dict[str, Any] = {
        key: np.empty((n, 4, 3)) for key in ("centre", "velocity", "acceleration", "turn", "turn_rate")
    }
    out["attitude"] = np.empty((n, 4, 3, 3))
    for i in range(n):
        data.qpos[:], data.qvel[:] = q[i], v[i]
        mechanism.lib.mj_kinematics(mechanism.model, data)
        mechanism.lib.mj_comPos(mechanism.model, data)
        mechanism.lib.mj_fwdVelocity(mechanism.model, data)
        data.qacc[:] = a[i]
        mechanism.lib.mj_rnePostConstraint(mechanism.model, data)
        R = mechanism.body_axes()[1]
        out["centre"][i], out["attitude"][i] = mechanism.wheel_places()
        at = data.xpos[mechanism.wheels]
        out["velocity"][i] = mechanism.wheel_points.velocity(at) @ R
        out["acceleration"][i] = mechanism.wheel_points.acceleration(at)[0] @ R
        out["turn"][i] = mechanism.carrier_points.turn() @ R
        out["turn_rate"][i] = mechanism.carrier_points.acceleration(at)[1] @ R
    return out
