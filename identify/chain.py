"""Trees of rigid bodies in the modified Denavit–Hartenberg description of Khalil and Kleinfinger (1986).

T(antecedent → j) = Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r), with θ = q_j + offset for a revolute joint (σ = 0) and
r = q_j + offset for a prismatic one (σ = 1). The parameters of body j are given in frame j at its origin: the inertia
about the origin XX XY XZ YY YZ ZZ, the first moments MX MY MZ, the mass M.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base import BaseParameters, find_base
from identify.rigid_body import PARAMETERS, wrench, wrench_regressor
from identify.vectors import Array, cross, rotation, unit

_Z = unit(2)


@dataclass(frozen=True)
class Joint:
    """One row of the table: angles [rad], lengths [m]; `theta` and `r` are the constant parts."""

    j: int
    ant: int
    sigma: int
    gamma: float = 0.0
    b: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    r: float = 0.0


@dataclass(frozen=True)
class FrameMotion:
    """Motion of one frame, in its own axes, (3, N) each.

    `omega` [rad/s], `omega_dot` [rad/s²], and `accel`, the origin's specific force (acceleration minus gravity) [m/s²].
    """

    omega: Array
    omega_dot: Array
    accel: Array


class Chain:
    """A tree of joints and bodies.

    Parameters
    ----------
    joints : numbered 1…n in order, each after its antecedent (0 is the ground).
    gravity : acceleration of gravity in the ground frame [m/s²].

    Raises ValueError when the table is no tree.
    """

    def __init__(self, joints: Sequence[Joint], gravity: Sequence[float] = (0.0, 0.0, -9.81)):
        self.joints = tuple(joints)
        self.gravity = np.asarray(gravity, float)
        for place, joint in enumerate(self.joints, start=1):
            if joint.j != place or not 0 <= joint.ant < place or joint.sigma not in (0, 1):
                raise ValueError(
                    f"row {place}: joints are numbered 1, 2, … in order, each after its antecedent, with sigma 0 or 1; "
                    f"found j={joint.j}, ant={joint.ant}, sigma={joint.sigma}"
                )
        # Rz(γ) Rx(α) and the constant part of the origin are fixed per joint.
        self._turn = [rotation(2, k.gamma) @ rotation(0, k.alpha) for k in self.joints]
        self._step = [rotation(2, k.gamma) @ np.array([k.d, 0.0, k.b]) for k in self.joints]

    @classmethod
    def from_table(cls, rows: Sequence[Mapping[str, float]], gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Chain:
        """Build a chain from rows with ``j ant sigma gamma b alpha d theta r``; a missing key is 0."""
        names = ("gamma", "b", "alpha", "d", "theta", "r")
        joints = [
            Joint(
                int(row["j"]), int(row.get("ant", 0)), int(row.get("sigma", 0)), *(float(row.get(k, 0)) for k in names)
            )
            for row in rows
        ]
        return cls(joints, gravity)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the 10 n standard parameters, body by body: ``XX1 … M1, XX2 …``."""
        return tuple(f"{name}{joint.j}" for joint in self.joints for name in PARAMETERS)

    def to_frame(self, k: int, q: Array, v: Array) -> Array:
        """Turn `v` (3, N) from the axes of joint k's antecedent into frame k (k counts from 0)."""
        joint = self.joints[k]
        v = self._turn[k].T @ v
        if joint.sigma == 1 and joint.theta == 0.0:
            return v
        angle = joint.theta + (q if joint.sigma == 0 else 0.0)
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([c * v[0] + s * v[1], c * v[1] - s * v[0], v[2] + 0.0 * c])

    def from_frame(self, k: int, q: Array, v: Array) -> Array:
        """Turn `v` (3, N) from frame k into the axes of its antecedent."""
        joint = self.joints[k]
        angle = joint.theta + (q if joint.sigma == 0 else 0.0)
        c, s = np.cos(angle), np.sin(angle)
        return self._turn[k] @ np.stack([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2] + 0.0 * c])

    def origin(self, k: int, q: Array) -> Array:
        """(3, N) origin of frame k in the axes of its antecedent [m]."""
        joint = self.joints[k]
        r = joint.r + (q if joint.sigma == 1 else np.zeros_like(q))
        return self._step[k][:, None] + self._turn[k][:, 2:] * r

    def propagate(
        self, q: Array, qd: Array, qdd: Array, start: int = 0, base: FrameMotion | None = None
    ) -> list[FrameMotion | None]:
        """Motion of every frame from joint positions, velocities and accelerations.

        Parameters
        ----------
        q, qd, qdd : (n, N) joint positions [rad, m] and their derivatives.
        start : number of the body whose motion is given (0: the ground).
        base : that body's motion in its own axes; by default the ground at rest under gravity.

        Returns one entry a body (index j − 1); bodies that do not descend from `start` are None.
        """
        samples = q.shape[1]
        if base is None:
            still = np.zeros((3, samples))
            base = FrameMotion(still, still, np.repeat(-self.gravity[:, None], samples, axis=1))
        frames: list[FrameMotion | None] = [None] * self.n
        for k, joint in enumerate(self.joints):
            ant = base if joint.ant == start else (frames[joint.ant - 1] if joint.ant else None)
            if ant is None or k + 1 == start:
                continue
            p = self.origin(k, q[k])
            accel = ant.accel + cross(ant.omega_dot, p) + cross(ant.omega, cross(ant.omega, p))
            carried = self.to_frame(k, q[k], ant.omega)
            omega_dot = self.to_frame(k, q[k], ant.omega_dot)
            accel = self.to_frame(k, q[k], accel)
            rate, rate_dot = _Z * qd[k], _Z * qdd[k]
            if joint.sigma == 0:
                frames[k] = FrameMotion(carried + rate, omega_dot + rate_dot + cross(carried, rate), accel)
            else:
                frames[k] = FrameMotion(carried, omega_dot, accel + rate_dot + 2.0 * cross(carried, rate))
        return frames

    def inverse_dynamics(
        self, q: Array, qd: Array, qdd: Array, parameters: Array | Mapping[str, float]
    ) -> NDArray[np.float64]:
        """Joint forces and torques by recursive Newton–Euler.

        Parameters
        ----------
        q, qd, qdd : (N, n) joint states.
        parameters : (10 n,) in the order of `parameter_names`, or a mapping name → value (missing: 0).

        Returns (N, n) [N, N·m]. Raises KeyError for an unknown name.
        """
        values = self._parameters(parameters)
        q, qd, qdd = (np.ascontiguousarray(np.asarray(a, float).T) for a in (q, qd, qdd))
        frames = self.propagate(q, qd, qdd)
        force = np.zeros((self.n, 3, q.shape[1]))
        moment = np.zeros_like(force)
        tau = np.empty_like(q)
        for k in reversed(range(self.n)):
            frame, joint = frames[k], self.joints[k]
            assert frame is not None
            own_force, own_moment = wrench(frame.omega, frame.omega_dot, frame.accel, values[10 * k : 10 * k + 10])
            force[k] += own_force
            moment[k] += own_moment
            tau[k] = force[k, 2] if joint.sigma == 1 else moment[k, 2]
            if joint.ant:
                up = self.from_frame(k, q[k], force[k])
                force[joint.ant - 1] += up
                moment[joint.ant - 1] += self.from_frame(k, q[k], moment[k]) + cross(self.origin(k, q[k]), up)
        return tau.T

    def regressor(self, q: Array, qd: Array, qdd: Array) -> NDArray[np.float64]:
        """Joint torques as a linear map of the parameters, (N, n, 10 n): ``regressor @ X == inverse_dynamics(X)``.

        Each body's wrench regressor is carried to its ancestors with Jacobians, not by the Newton–Euler recursion.
        """
        q, qd, qdd = (np.ascontiguousarray(np.asarray(a, float).T) for a in (q, qd, qdd))
        frames = self.propagate(q, qd, qdd)
        out = np.zeros((q.shape[1], self.n, 10 * self.n))
        for k in range(self.n):
            frame = frames[k]
            assert frame is not None
            per_parameter = wrench_regressor(frame.omega, frame.omega_dot, frame.accel)  # (6, 10, N)
            for ancestor, jacobian in self.jacobian_columns(k, q):
                out[:, ancestor, 10 * k : 10 * k + 10] = np.einsum("cN,cpN->Np", jacobian, per_parameter)
        return out

    def jacobian_columns(self, k: int, q: Array) -> list[tuple[int, Array]]:
        """How body k's frame moves with each joint above it, in frame k.

        Returns (joint index from 0, (6, N) velocity of the origin and angular velocity per unit joint rate).
        """
        out: list[tuple[int, Array]] = []
        samples = q.shape[1]
        path = [k]
        while self.joints[path[-1]].ant:
            path.append(self.joints[path[-1]].ant - 1)
        for ancestor in path:
            linear, angular = np.zeros((3, samples)), np.zeros((3, samples))
            (linear if self.joints[ancestor].sigma == 1 else angular)[2] = 1.0
            for step in reversed(path[: path.index(ancestor)]):  # carry it down to body k
                linear = self.to_frame(step, q[step], linear + cross(angular, self.origin(step, q[step])))
                angular = self.to_frame(step, q[step], angular)
            out.append((ancestor, np.concatenate([linear, angular])))
        return out

    def base_parameters(self, seed: int = 0) -> BaseParameters:
        """The base (minimal) parameters: which combinations of the standard ones the joint torques depend on.

        Found by rank-revealing QR of the regressor at random states; earlier parameters are kept before later ones.
        """
        rng = np.random.default_rng(seed)
        count = 30 + 5 * self.n
        q, qd, qdd = rng.uniform(-2, 2, (3, count, self.n))
        return find_base(self.regressor(q, qd, qdd).reshape(count * self.n, -1), self.parameter_names)

    def _parameters(self, parameters: Array | Mapping[str, float]) -> NDArray[np.float64]:
        if isinstance(parameters, Mapping):
            index = {name: i for i, name in enumerate(self.parameter_names)}
            values = np.zeros(10 * self.n)
            for name, value in parameters.items():
                values[index[name]] = value
            return values
        values = np.asarray(parameters, float)
        if values.shape != (10 * self.n,):
            raise ValueError(f"{10 * self.n} parameters expected, found an array of shape {values.shape}")
        return values
