"""Simulated motion: forces and states that the engine computed, as arrays, and the kinematics that follow from them.

Body axes and corner order (fl, fr, rl, rr) throughout. All arrays belong to the same instants: forces and
accelerations come from one solution of the equations of motion.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.simulate.cars import Car
from lacet.simulate.hidden import Hidden
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.road import Road
from lacet.simulate.turning import rotation

Array = NDArray[np.float64]


def rotate(R: Array, v: Array) -> Array:
    """R·v for stacks (…, 3, 3) and (…, 3)."""
    return np.einsum("...ij,...j->...i", R, v)


def rotate_back(R: Array, v: Array) -> Array:
    """Rᵀ·v for stacks (…, 3, 3) and (…, 3)."""
    return np.einsum("...ji,...j->...i", R, v)


def matrices(quaternions: Array) -> Array:
    """(N, 3, 3) rotations of unit quaternions (N, 4), scalar first."""
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def euler_zyx(R: Array) -> Array:
    """(N, 3) roll, pitch, yaw of R = Rz(yaw)·Ry(pitch)·Rx(roll), yaw unwrapped [rad]."""
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = -np.arcsin(np.clip(R[..., 2, 0], -1.0, 1.0))
    yaw = np.unwrap(np.arctan2(R[..., 1, 0], R[..., 0, 0]))
    return np.stack([roll, pitch, yaw], axis=-1)


@dataclass(frozen=True)
class CarMotion(ABC):
    """The motion and forces of one simulated drive, as far as sensors need them: of any simulated car.

    Attributes (N samples at `rate`; SI; corners second)
    ----------
    t : (N,) s from the start of the run.
    position, velocity, acceleration : (N, 3) of the body origin, ground axes (z up).
    attitude : (N, 3, 3) R_ground_body.
    turn, turn_rate : (N, 3) angular velocity and acceleration of the body, body axes.
    spin : (N, 3, 4) wheel angle relative to the carrier and its derivatives, rolling forward positive.
    force, moment : (N, 4, 3) road on tyre reduced to the wheel centre, body axes.
    distance : (N, 4) wheel centre to road along body -z [m]; `normal` : (N, 3) road normal e, body axes.
    deflection : (N, 4) tyre deflection δ [m].
    shaft, brake : (N, 4) half-shaft torque (reacts on the chassis), brake torque (reacts on the carrier) [N·m].
    level : (3, 3) rotation from ground axes (z normal to the undisturbed road) to level ones (z up).
    """

    car: Car | SecondCar
    road: Road
    manoeuvre: str
    settings: dict[str, Any]
    brakes: str
    hidden: tuple[Hidden, ...]
    seed: int
    rate: float
    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    attitude: Array
    turn: Array
    turn_rate: Array
    spin: Array
    force: Array
    moment: Array
    distance: Array
    normal: Array
    deflection: Array
    shaft: Array
    brake: Array
    level: Array

    @property
    @abstractmethod
    def own_wheel_centres(self) -> Array:
        """(N, 4, 3) wheel centres in the axes of the part of the body they are on [m]."""

    @cached_property
    def own_carrier_attitude(self) -> Array:
        """(N, 4, 3, 3) R = Rz(steer)·Rx(camber)·Ry(pitch) relative to the part of the body a carrier is on."""
        raise NotImplementedError

    @cached_property
    def wheel_centre_motion(self) -> tuple[Array, Array]:
        """Velocity and acceleration (N, 4, 3) of the wheel centres, body axes [m/s, m/s²]."""
        raise NotImplementedError

    @cached_property
    def carrier_turn(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration (N, 4, 3) of the carriers, body axes [rad/s, rad/s²]."""
        raise NotImplementedError

    @cached_property
    def twisted(self) -> bool:
        """Whether the rear part of the body rotates relative to the front one."""
        return False

    @cached_property
    def rear_attitude(self) -> Array:
        """(N, 3, 3) R_body_rear of the rear part of the body."""
        return np.broadcast_to(np.eye(3), (len(self.t), 3, 3))

    def on_rear(self, points: Array) -> Array:
        """(N, 3) in body axes of a point given in the rear part's axes: fixed (3,), or moving (N, 3)."""
        return np.broadcast_to(points, (len(self.t), 3))

    @cached_property
    def carrier_attitude(self) -> Array:
        """(N, 4, 3, 3) R_body_carrier."""
        return self.own_carrier_attitude

    @property
    def gravity(self) -> Array:
        """(N, 3) gravity, body axes [m/s²]."""
        return rotate_back(self.attitude, self.level.T @ np.array([0.0, 0.0, -self.car.gravity]))

    @property
    def level_attitude(self) -> Array:
        """(N, 3, 3) R_level_body, the attitude that an inertial unit measures: `attitude` except on a sloping road."""
        return self.level @ self.attitude

    @property
    def steer(self) -> Array:
        """(N, 4) steer about z of the part of the body the wheel is on [rad], as its camera measures it."""
        R = self.own_carrier_attitude
        return np.arctan2(-R[..., 0, 1], R[..., 1, 1])

    @property
    def camber(self) -> Array:
        """(N, 4) camber about x after steer [rad]."""
        return np.arcsin(self.own_carrier_attitude[..., 2, 1])

    @property
    def carrier_pitch(self) -> Array:
        """(N, 4) pitch of the carrier after steer and camber [rad]."""
        R = self.own_carrier_attitude
        return np.arctan2(-R[..., 2, 0], R[..., 2, 2])

    def at(self, points: Array) -> tuple[Array, Array]:
        """Velocity and acceleration (N, k, 3), body axes, of points fixed to the body, (k, 3), or moving, (N, k, 3)."""
        v, a = rotate_back(self.attitude, self.velocity), rotate_back(self.attitude, self.acceleration)
        w, wd = self.turn[:, None, :], self.turn_rate[:, None, :]
        swing = np.cross(w, points)
        return v[:, None, :] + swing, a[:, None, :] + np.cross(wd, points) + np.cross(w, swing)

    def spinning_momentum_rate(self, spin: Array, transverse: Array) -> Array:
        """(N, 4, 3) rate of change of the angular momentum of axisymmetric wheels about their centres, body axes.

        `spin`, `transverse` : (4,) moments of inertia about the spin axis and across it [kg·m²].
        """
        R = self.carrier_attitude
        w, wd = (rotate_back(R, x) for x in self.carrier_turn)
        inertia = np.stack([transverse, spin, transverse], axis=-1)
        y = np.array([0.0, 1.0, 0.0])
        momentum = inertia * (w + self.spin[:, 1, :, None] * y)
        own = inertia * (wd + self.spin[:, 2, :, None] * y)
        return rotate(R, own + np.cross(w, momentum))

    @cached_property
    def hub(self) -> tuple[Array, Array]:
        """Force and moment (N, 4, 3) of wheel on hub (rim and tyre outboard) about the wheel centre, body axes.

        The contact load minus inertia and weight of the outboard mass.
        """
        axles = [self.car.axle(corner) for corner in CORNERS]
        mass = np.array([a.outboard_mass for a in axles])[:, None]
        felt = self.wheel_centre_motion[1] - self.gravity[:, None, :]
        rate = self.spinning_momentum_rate(
            np.array([a.outboard_spin for a in axles]), np.array([a.outboard_transverse for a in axles])
        )
        return self.force - mass * felt, self.moment - rate

    def wheel_loads(self, reference: str) -> tuple[Array, Array]:
        """Force and moment (N, 4, 3), carrier axes, about the wheel centre, in the ``contact`` or ``hub`` reference."""
        force, moment = (self.force, self.moment) if reference == "contact" else self.hub
        return rotate_back(self.carrier_attitude, force), rotate_back(self.carrier_attitude, moment)

    def truth(self) -> dict[str, Any]:
        """True parameters and settings of the run, JSON-able."""
        return {
            "car": self.car.truth(),
            "hidden": [effect.truth() for effect in self.hidden],
            "manoeuvre": {"name": self.manoeuvre, "road": self.road.name, **self.settings},
            "seed": self.seed,
        }


@dataclass(frozen=True)
class SimulatedMotion(CarMotion):
    """The motion and forces of one drive of a car whose wheel centres slide along body z.

    Attributes beside those of `CarMotion`
    ----------
    travel : (N, 3, 4) s, ds/dt, d²s/dt², compression positive, along body z.
    kingpin : (N, 3, 4) angle about the kingpin axis and its derivatives, left positive (rear: 0).
    suspension : (N, 4) spring, damper and all other forces between chassis and carrier along the travel [N].
    air : (N, 2, 3) aerodynamic force and moment about the body origin, body axes.
    slides : (4, 3) displacement of the wheel centres per unit of travel, `turns` : (4, 3) rotation of the carriers per
        unit of travel [rad/m], both in the axes of the part of the body they are on.
    twist : (N, 3) angle of the rear part of the body relative to the front one about x and its derivatives; 0 without
        a hidden chassis torsion. `twist_height` : z of its axis [m].
    attached : coordinates of hidden bodies and their derivatives, (N, 3, k) by effect.
    outside : (N, 2, 3) road force on hidden bodies and its moment about the body origin, body axes.
    memory : (N, m) states of hidden effects, corner by corner, then those of bodies.
    """

    car: Car
    travel: Array
    kingpin: Array
    suspension: Array
    air: Array
    slides: Array
    turns: Array
    twist: Array
    twist_height: float
    attached: dict[str, Array]
    outside: Array
    memory: Array

    @cached_property
    def twisted(self) -> bool:
        """Whether the rear part of the body rotates relative to the front one."""
        return bool(np.any(self.twist))

    @cached_property
    def rear_attitude(self) -> Array:
        """(N, 3, 3) R_body_rear of the rear part of the body."""
        return rotation(self.twist[:, :1] * np.array([1.0, 0.0, 0.0]))

    def on_rear(self, points: Array) -> Array:
        """(N, 3) in body axes of a point given in the rear part's axes: fixed (3,), or moving (N, 3)."""
        hinge = np.array([0.0, 0.0, self.twist_height])
        return hinge + rotate(self.rear_attitude, np.broadcast_to(points - hinge, (len(self.t), 3)))

    @property
    def own_wheel_centres(self) -> Array:
        """(N, 4, 3) wheel centres in the axes of the part of the body they are on [m]."""
        return self.car.wheel_centres + self.travel[:, 0, :, None] * self.slides

    @cached_property
    def wheel_centres(self) -> Array:
        """(N, 4, 3) wheel centres in body axes [m]."""
        out = self.own_wheel_centres
        if self.twisted:
            for i in (2, 3):
                out[:, i] = self.on_rear(out[:, i])
        return out

    @cached_property
    def own_carrier_attitude(self) -> Array:
        """(N, 4, 3, 3) R = Rz(steer)·Rx(camber)·Ry(pitch) relative to the part of the body a carrier is on."""
        out = np.empty((len(self.t), 4, 3, 3))
        for i, corner in enumerate(CORNERS):
            k, angle = self.car.kingpin(corner), self.kingpin[:, 0, i, None, None]
            cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
            turned = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
            if np.any(self.turns[i]):
                turned = rotation(self.travel[:, 0, i, None] * self.turns[i]) @ turned
            out[:, i] = turned @ self.car.design_attitude(corner)
        return out

    @cached_property
    def carrier_attitude(self) -> Array:
        """(N, 4, 3, 3) R_body_carrier; without twist Rz(steer)·Rx(camber)·Ry(pitch)."""
        out = self.own_carrier_attitude
        if self.twisted:
            out = out.copy()
            out[:, 2:] = self.rear_attitude[:, None] @ out[:, 2:]
        return out

    @cached_property
    def wheel_centre_motion(self) -> tuple[Array, Array]:
        """Velocity and acceleration (N, 4, 3) of the wheel centres, body axes [m/s, m/s²]."""
        v, a = self.at(self.wheel_centres)
        s, w = self.travel[..., None], self.turn[:, None, :]
        slip, more = s[:, 1] * self.slides, s[:, 2] * self.slides
        if self.twisted:
            hinge = np.array([0.0, 0.0, self.twist_height])
            own = self.twist[:, 1, None, None] * np.array([1.0, 0.0, 0.0])
            slide = self.rear_attitude[:, None] @ slip[:, 2:, :, None]
            swing = np.cross(own, self.wheel_centres[:, 2:] - hinge)
            more[:, 2:] = (self.rear_attitude[:, None] @ more[:, 2:, :, None])[..., 0]
            more[:, 2:] += np.cross(own, swing) + 2.0 * np.cross(own, slide[..., 0])
            more[:, 2:] += np.cross(
                self.twist[:, 2, None, None] * np.array([1.0, 0.0, 0.0]), self.wheel_centres[:, 2:] - hinge
            )
            slip[:, 2:] = slide[..., 0] + swing
        return v + slip, a + more + 2.0 * np.cross(w, slip)

    @cached_property
    def carrier_turn(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration (N, 4, 3) of the carriers, body axes [rad/s, rad/s²]."""
        w, wd = self.turn[:, None, :], self.turn_rate[:, None, :]
        k = np.stack([self.car.kingpin(corner) for corner in CORNERS])
        if not (self.twisted or np.any(self.turns)):
            own = self.kingpin[:, 1, :, None] * k
            return w + own, wd + self.kingpin[:, 2, :, None] * k + np.cross(w, own)
        s, x = self.travel[..., None], np.zeros((len(self.t), 4, 3))
        first, second = x.copy(), x.copy()  # of the part of the body each wheel is on, relative to the body
        first[:, 2:, 0], second[:, 2:, 0] = self.twist[:, 1, None], self.twist[:, 2, None]
        base = np.broadcast_to(np.eye(3), (len(self.t), 4, 3, 3)).copy()
        base[:, 2:] = self.rear_attitude[:, None]
        axis = rotate(base, np.broadcast_to(self.turns, x.shape))
        kingpin = rotate(base @ rotation(s[:, 0] * self.turns), np.broadcast_to(k, x.shape))
        for about, rate, more in (
            (axis, s[:, 1], s[:, 2]),
            (kingpin, self.kingpin[:, 1, :, None], self.kingpin[:, 2, :, None]),
        ):
            second = second + more * about + np.cross(first, rate * about)
            first = first + rate * about
        return w + first, wd + second + np.cross(w, first)
