"""Trees of rigid bodies in the modified Denavit–Hartenberg description of Khalil and Kleinfinger (1986).

T(antecedent → j) = Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r), with θ = q_j + offset for a revolute joint (σ = 0) and
r = q_j + offset for a prismatic one (σ = 1); σ = 2 is a frame fixed in its antecedent. The parameters of body j are
given in frame j at its origin: the inertia about the origin XX XY XZ YY YZ ZZ, the first moments MX MY MZ, the mass M.
A joint may have a rotor inertia and friction: IA q̈ + FV q̇ + FS sign(q̇), as in SYMORO.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lacet.daq.text_source import Source, text_of
from lacet.identify.multibody.arguments import absent_names, all_parameters, joint_states, symbol_values, unused
from lacet.identify.multibody.chain_notes import ChainNote
from lacet.identify.multibody.coupling import Coupling, Follower
from lacet.identify.multibody.rigid_body import FRICTION, PARAMETERS, STANDARD_GRAVITY, wrench, wrench_regressor
from lacet.identify.multibody.symbolic_table import FIXED, GEOMETRY, SymbolicTable, refuse_missing
from lacet.identify.multibody.symoro import read_par
from lacet.identify.multibody.urdf.robot import ROUNDING, read_urdf
from lacet.identify.multibody.vectors import Array, cross, rotation

if TYPE_CHECKING:
    from lacet.identify.multibody.packed_regressor import CompiledRegressor, PackedRegressor

GRAVITY = (0.0, 0.0, -STANDARD_GRAVITY)
"""Default acceleration of gravity in the ground frame [m/s²], z up."""


@dataclass(frozen=True)
class Joint:
    """One joint of a chain, a row of its table: angles [rad], lengths [m]; `theta` and `r` are the constant parts.

    Examples
    --------
    >>> lacet.Joint(j=1, ant=0, sigma=0, r=0.5)
    Joint(j=1, ant=0, sigma=0, gamma=0.0, b=0.0, alpha=0.0, d=0.0, theta=0.0, r=0.5)
    """

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
    """Motion of one frame of a chain, in its own axes, (3, N) each.

    `omega` [rad/s], `omega_dot` [rad/s²], and `accel`, the origin's specific force (acceleration minus gravity) [m/s²].
    """

    omega: Array
    omega_dot: Array
    accel: Array


class Chain:
    """A tree of rigid bodies on revolute and prismatic joints: its kinematics, dynamics and regressor.

    Parameters
    ----------
    joints : numbered 1…n in order, each after its antecedent (0 is the ground).
    gravity : acceleration of gravity in the ground frame [m/s²].
    absent : parameters that the robot lacks (``YY3``, ``IA2``): `base_parameters` leaves them out.
    rotors : whether rotor inertias count among the inertial parameters, as in SYMORO.
    table : the same rows with symbols, whose values are `values`; with values missing only `base_parameters` works.
    given : values of parameters that the robot's file holds.
    notes : what was assumed, left out or not used when the chain was read, as values.
    names : of the joints, one a row; by default ``joint 1`` and so on.
    followers : joints that follow others (`coupling`).

    Raises ValueError when the table is no tree.

    Examples
    --------
    >>> pendulum = lacet.Chain.from_table([{"j": 1, "ant": 0, "sigma": 0, "alpha": "pi/2"}])
    >>> pendulum.inverse_dynamics([[0.0]], [[0.0]], [[0.0]], {"MX1": 2.0}).round(2).tolist()
    [[19.61]]
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        gravity: Sequence[float] = GRAVITY,
        absent: Collection[str] = (),
        rotors: bool = False,
        table: SymbolicTable | None = None,
        values: Mapping[str, float] | None = None,
        given: Mapping[str, float] | None = None,
        notes: Sequence[ChainNote] = (),
        names: Sequence[str] = (),
        followers: Sequence[Follower] = (),
    ):
        self.joints = tuple(joints)
        self.gravity = np.asarray(gravity, float)
        if self.gravity.shape != (3,) or not np.all(np.isfinite(self.gravity)):
            raise ValueError(f"gravity must be three finite numbers, found {gravity!r}")
        if not self.joints:
            raise ValueError("a chain needs at least one joint")
        self.table = table or SymbolicTable.read([vars(joint) for joint in self.joints])
        self.values = dict(values or {})
        self.missing = self.table.missing(self.values)
        self.absent, self.rotors = frozenset(absent), rotors
        self.given, self.notes = dict(given or {}), tuple(notes)
        if unknown := self.absent - {*self.parameter_names, *self.friction_names}:
            raise ValueError(f"absent names what is no parameter of this chain: {', '.join(sorted(unknown))}")
        self.names = tuple(names) or tuple(f"joint {joint.j}" for joint in self.joints)
        if len(self.names) != len(self.joints):
            raise ValueError(f"{len(self.joints)} joints have {len(self.names)} names")
        self.followers = tuple(followers)
        self.coupling = Coupling.of(self.n, [k.j for k in self.joints if k.sigma == FIXED], self.followers)
        # Rz(γ) Rx(α) and the constant part of the origin are fixed per joint.
        self._turn = [rotation(2, k.gamma) @ rotation(0, k.alpha) for k in self.joints]
        self._step = [rotation(2, k.gamma) @ np.array([k.d, 0.0, k.b]) for k in self.joints]

    @classmethod
    def from_table(
        cls, rows: Sequence[Mapping[str, Any]], gravity: Sequence[float] = GRAVITY,
        values: Mapping[str, float] | None = None,
    ) -> Chain:  # fmt: skip
        """The chain of a table with rows of ``j ant sigma gamma b alpha d theta r``; a missing key is 0.

        Parameters
        ----------
        rows : lengths [m] and angles [rad] as numbers, or as expressions with symbols (``"2*L1"``, ``"pi/2"``). A row
            may name parameters that do not exist, which `base_parameters` then leaves out: ``"absent": ["XX", "M"]``,
            or ``"absent": "all"`` for a body without mass. Other keys are ignored, misspelt ones refused.
        gravity : acceleration of gravity in the ground frame [m/s²].
        values : the symbols' values.

        Raises ValueError with every fault of the table.
        """
        rows = list(rows)
        table = SymbolicTable.read(rows)
        known = symbol_values(values or {})
        notes = unused(known, table.symbols)
        return cls._of(table, gravity, known, absent_names(rows), notes=notes)

    @classmethod
    def from_par(
        cls, text: str, values: Mapping[str, float] | None = None, gravity: Sequence[float] | None = None,
        name: str = "par file",
    ) -> Chain:  # fmt: skip
        """The tree that the text of a SYMORO ``.par`` file describes (a closed loop as its equivalent tree: `notes`).

        Parameters
        ----------
        values : numbers of the file's symbols, lengths [m] and angles [rad]. Without them base parameters can be had,
            and whatever needs numbers says which symbols lack one.
        gravity : acceleration of gravity in the ground frame [m/s²]; by default the file's G, and when its third entry
            has no value (``G3``) −`STANDARD_GRAVITY` along z, which `notes` then holds.
        name : of the file, for messages.

        Inertial parameters that the file gives as 0 are `absent`, others that it gives as numbers stand in `given`.
        Raises ParError (a ValueError) with every fault of the file.
        """
        known = symbol_values(values or {})
        par = read_par(text, name)
        field, assumed = (gravity, None) if gravity is not None else par.field(known, GRAVITY)
        given = {name: e.value(known) for name, e in par.given.items() if e.symbols <= known.keys()}
        notes = [*par.notes, *([assumed] if assumed else []), *unused(known, par.symbols)]
        return cls._of(par.table, field, known, par.absent, par.rotors, given, notes)

    @classmethod
    def from_urdf(
        cls, path: Source, gravity: Sequence[float] = GRAVITY, rounding: float = ROUNDING, name: str = "URDF"
    ) -> Chain:
        """The tree of a URDF file: its moving joints in the order of the tree, its links as their bodies.

        A body's parameters are given at the origin of the child link's frame, in its axes; where the joint's axis is
        not ``0 0 1`` these are turned so that z is the axis. Links on fixed joints belong to the body that carries
        them. The file's inertias and `<dynamics damping friction>` stand in `given`, the names of its joints in
        `names`; mimic joints are `followers`, and `coupling` makes the states of all joints from those of the free.

        Parameters
        ----------
        path : the file, or its text.
        gravity : acceleration of gravity in the root link's axes [m/s²].
        rounding : angles nearer to a quarter turn [rad] are taken as it: 1e-5 for a file that has ``1.5708``.
        name : of the file, for messages about a text.

        Raises UrdfError (a ValueError) with every fault of the file and its line, UsageError when there is no file.
        """
        robot = read_urdf(*text_of(path, "<", name), rounding)
        table = SymbolicTable.read(robot.rows)
        joints = [
            Joint(row.j, row.ant, row.sigma, **numbers)
            for row, numbers in zip(table.rows, table.numbers({}), strict=True)
        ]
        return cls(
            joints, gravity, robot.absent, False, table, None, robot.given, robot.notes, robot.names, robot.followers
        )

    @classmethod
    def _of(
        cls, table: SymbolicTable, gravity: Sequence[float], values: Mapping[str, float], absent: Collection[str],
        rotors: bool = False, given: Mapping[str, float] | None = None, notes: Sequence[ChainNote] = (),
        names: Sequence[str] = (), followers: Sequence[Follower] = (),
    ) -> Chain:  # fmt: skip
        # Symbols without a value get random ones, for the structure only: `missing` forbids numerical results.
        anything = table.any_values(np.random.default_rng(1))
        numbers = table.numbers({**anything, **values})
        joints = [Joint(row.j, row.ant, row.sigma, **n) for row, n in zip(table.rows, numbers, strict=True)]
        return cls(joints, gravity, absent, rotors, table, values, given, notes, names, followers)

    def with_values(self, values: Mapping[str, float]) -> Chain:
        """The same chain with values for (more of) the table's symbols.

        Raises ValueError for a symbol that is not in the table (``G3``).
        """
        known = {**self.values, **symbol_values(values, self.table.symbols)}
        return self._of(
            self.table, tuple(self.gravity), known, self.absent, self.rotors, self.given, self.notes, self.names,
            self.followers,
        )  # fmt: skip

    def with_gravity(self, gravity: Sequence[float]) -> Chain:
        """The same chain under another acceleration of gravity, in the ground frame [m/s²]."""
        return Chain(
            self.joints, gravity, self.absent, self.rotors, self.table, self.values, self.given, self.notes,
            self.names, self.followers,
        )  # fmt: skip

    @property
    def n(self) -> int:
        """Number of joints (bodies), fixed frames included."""
        return len(self.joints)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the 10 n standard parameters, body by body: ``XX1 … M1, XX2 …``."""
        return tuple(f"{name}{joint.j}" for joint in self.joints for name in PARAMETERS)

    @cached_property
    def friction_names(self) -> tuple[str, ...]:
        """Names of the 3 n joint parameters, joint by joint: ``IA1 FV1 FS1, IA2 …`` (rotor, viscous, Coulomb)."""
        return tuple(f"{name}{joint.j}" for joint in self.joints for name in FRICTION)

    def to_frame(self, k: int, q: Array, v: Array) -> Array:
        """Vectors `v` (3, …, N) rotated from the axes of joint k's antecedent into frame k (k counts from 0)."""
        return self._into(k, self._turning(k, q), v)

    def _turning(self, k: int, q: Array) -> tuple[Array, Array] | None:
        """Cosine and sine of joint k's angle θ; None where it is always 0."""
        joint = self.joints[k]
        if joint.sigma != 0 and joint.theta == 0.0:
            return None
        angle = joint.theta + (q if joint.sigma == 0 else 0.0)
        return np.cos(angle), np.sin(angle)

    def _into(self, k: int, turning: tuple[Array, Array] | None, v: Array) -> Array:
        """`to_frame` given the cosine and sine of the joint's angle, which several vectors share."""
        v = np.dot(self._turn[k].T, v.reshape(3, -1)).reshape(v.shape)
        if turning is None:
            return v
        c, s = turning
        x = c * v[0]
        x += s * v[1]
        v[1] *= c
        v[1] -= s * v[0]
        v[0] = x
        return v

    def from_frame(self, k: int, q: Array, v: Array) -> Array:
        """Vectors `v` (3, …, N) rotated from frame k into the axes of its antecedent."""
        joint = self.joints[k]
        angle = joint.theta + (q if joint.sigma == 0 else 0.0)
        c, s = np.cos(angle), np.sin(angle)
        return np.tensordot(self._turn[k], np.stack([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]), 1)

    def origin(self, k: int, q: Array) -> Array:
        """(3, N) origin of frame k in the axes of its antecedent [m]."""
        joint = self.joints[k]
        r = joint.r + (q if joint.sigma == 1 else np.zeros_like(q))
        return self._step[k][:, None] + self._turn[k][:, 2:] * r

    def propagate(
        self, q: Array, qd: Array, qdd: Array, start: int = 0, base: FrameMotion | None = None,
        wanted: Collection[int] | None = None,
    ) -> list[FrameMotion | None]:  # fmt: skip
        """Motion of every frame from joint positions, velocities and accelerations.

        Parameters
        ----------
        q, qd, qdd : (n, N) joint positions [rad, m] and their derivatives.
        start : number of the body whose motion is given (0: the ground).
        base : motion of that body in its own axes; by default the ground at rest under gravity.
        wanted : numbers of the bodies whose motion is wanted, by default all.

        Returns one entry a body (index j − 1); bodies that do not descend from `start` are None, and so may be those
        that are not wanted.
        """
        samples = q.shape[1]
        if base is None:
            still = np.zeros((3, samples))
            base = FrameMotion(still, still, np.repeat(-self.gravity[:, None], samples, axis=1))
        # Each frame's three vectors side by side, (3, 3, N), so that they are turned together.
        given = np.stack([base.omega, base.omega_dot, base.accel], axis=1)
        found: list[Array | None] = [None] * self.n
        needed = None if wanted is None else {j for body in wanted for j in self.table.path(body)}
        for k, joint in enumerate(self.joints):
            ant = given if joint.ant == start else (found[joint.ant - 1] if joint.ant else None)
            if ant is not None and k + 1 != start and (needed is None or k + 1 in needed):
                found[k] = self._next(k, ant, q[k], qd[k], qdd[k])
        return [None if v is None else FrameMotion(v[:, 0], v[:, 1], v[:, 2]) for v in found]

    def _next(self, k: int, ant: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Motion of frame k in its own axes from its antecedent's, (3, 3, N): ω, ω̇ and specific force side by side."""
        joint, turning = self.joints[k], self._turning(k, q)
        out = self._into(k, turning, ant)
        omega, omega_dot, accel = out[:, 0], out[:, 1], out[:, 2]
        if joint.d or joint.b:
            p = self._into(k, turning, np.repeat(self._step[k][:, None], q.size, axis=1))
            accel += cross(omega_dot, p) + cross(omega, cross(omega, p))
        if joint.sigma == 1 or joint.r:
            r = joint.r + (q if joint.sigma == 1 else 0.0)
            accel[0] += (omega_dot[1] + omega[0] * omega[2]) * r
            accel[1] += (omega[1] * omega[2] - omega_dot[0]) * r
            accel[2] -= (omega[0] ** 2 + omega[1] ** 2) * r
        if joint.sigma == 0:
            omega_dot[0] += omega[1] * qd
            omega_dot[1] -= omega[0] * qd
            omega_dot[2] += qdd
            omega[2] += qd
        elif joint.sigma == 1:
            twice = 2.0 * qd
            accel[0] += omega[1] * twice
            accel[1] -= omega[0] * twice
            accel[2] += qdd
        return out

    def inverse_dynamics(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, parameters: ArrayLike | Mapping[str, float]
    ) -> NDArray[np.float64]:
        """Joint forces and torques by recursive Newton–Euler.

        Parameters
        ----------
        q, qd, qdd : (N, n) joint states [rad, m; s]; the columns of fixed frames are not read.
        parameters : (10 n,) in the order of `parameter_names`, (13 n,) with `friction_names` appended, or a mapping
            name → value of either kind (missing: 0).

        Returns (N, n) [N, N·m], 0 for fixed frames. Raises KeyError for an unknown name, ValueError for wrong shapes,
        values that are not finite, or symbols without a value.
        """
        self._need_numbers()
        values = all_parameters(self.n, (*self.parameter_names, *self.friction_names), parameters)
        Q, Qd, Qdd = self._states(q=q, qd=qd, qdd=qdd)
        frames = self.propagate(Q, Qd, Qdd)
        force = np.zeros((self.n, 3, Q.shape[1]))
        moment = np.zeros_like(force)
        tau = np.zeros_like(Q)
        for k in reversed(range(self.n)):
            frame, joint = frames[k], self.joints[k]
            assert frame is not None
            own_force, own_moment = wrench(frame.omega, frame.omega_dot, frame.accel, values[10 * k : 10 * k + 10])
            force[k] += own_force
            moment[k] += own_moment
            if joint.sigma != FIXED:
                rotor, viscous, coulomb = values[10 * self.n + 3 * k :][:3]
                tau[k] = force[k, 2] if joint.sigma == 1 else moment[k, 2]
                tau[k] += rotor * Qdd[k] + viscous * Qd[k] + coulomb * np.sign(Qd[k])
            if joint.ant:
                up = self.from_frame(k, Q[k], force[k])
                force[joint.ant - 1] += up
                moment[joint.ant - 1] += self.from_frame(k, Q[k], moment[k]) + cross(self.origin(k, Q[k]), up)
        return tau.T

    def regressor(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, friction: bool = False, *, threads: int = 1,
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:  # fmt: skip
        """Joint torques as a linear map of the parameters: ``regressor @ X == inverse_dynamics(X)``.

        Parameters
        ----------
        q, qd, qdd : (N, n) joint states [rad, m; s]; the columns of fixed frames are not read.
        friction : whether the columns of `friction_names` are appended.
        threads : how many threads share the samples; the numbers do not depend on it.
        out : array to be filled and returned: a long recording can be gone through in pieces with the memory of one.

        Returns (N, n, 10 n), columns in the order of `parameter_names`; with `friction` (N, n, 13 n). Each body's
        wrench is projected on the axes of its ancestors, without the Newton–Euler recursion. The code is compiled at
        the first use on a machine, which takes seconds. Raises ValueError as `inverse_dynamics` does, and for fewer
        than one thread or an `out` of another shape or type.
        """
        return self._compiled.dense(self._numbers(q=q, qd=qd, qdd=qdd), friction, threads, out)

    def packed_regressor(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, friction: bool = False, *, threads: int = 1
    ) -> PackedRegressor:
        """`regressor` without the entries that are zero by structure: for the car 2,792 of 17,640 a sample.

        The arguments, and the errors raised, are those of `regressor`.
        """
        return self._compiled.packed(self._numbers(q=q, qd=qd, qdd=qdd), friction, threads)

    def structure(self, q: Array, qd: Array, qdd: Array, friction: bool = False) -> NDArray[np.float64]:
        """The regressor at states (n, N), also for a chain whose symbols lack values (random ones stand for them).

        Carried by Jacobians in the bodies' axes: another formula than `regressor`'s, and without its seconds at the
        first use, for the few states that show which parameters go together.
        """
        frames = self.propagate(q, qd, qdd)
        width = 10 * self.n
        out = np.zeros((q.shape[1], self.n, width + (3 * self.n if friction else 0)))
        for k, path, jacobian in self._jacobians(q):
            frame = frames[k]
            assert frame is not None
            per_parameter = wrench_regressor(frame.omega, frame.omega_dot, frame.accel)  # (6, 10, N)
            rows = jacobian.transpose(2, 1, 0) @ per_parameter.transpose(2, 0, 1)
            out[:, path, 10 * k : 10 * k + 10] = rows
        for k, joint in enumerate(self.joints if friction else ()):
            if joint.sigma != FIXED:
                out[:, k, width + 3 * k : width + 3 * k + 3] = np.stack([qdd[k], qd[k], np.sign(qd[k])], axis=1)
        return out

    def jacobian(self, body: int, q: ArrayLike, axes: str = "body") -> NDArray[np.float64]:
        """Geometric Jacobian of a body's frame, (N, 6, n).

        Rows 0–2 are the velocity of the frame's origin over the ground, 3–5 the angular velocity, per unit of each
        joint rate, in the axes of the body's frame (`axes` = ``body``) or of the ground (``ground``).

        Raises ValueError for a body that does not exist, other axes, or states as in `inverse_dynamics`.
        """
        if axes not in ("body", "ground"):
            raise ValueError(f"axes must be 'body' or 'ground', found {axes!r}")
        pose = self.pose(body, q)
        (Q,) = self._states(q=q)
        out = np.zeros((Q.shape[1], 6, self.n))
        for k, path, jacobian in self._jacobians(Q):
            if k + 1 == body:
                out[:, :, path] = jacobian.transpose(2, 0, 1)
        if axes == "ground":
            R = pose[:, :3, :3]
            out = np.concatenate([R @ out[:, :3], R @ out[:, 3:]], axis=1)
        return out

    def pose(self, body: int, q: ArrayLike) -> NDArray[np.float64]:
        """Pose of a body's frame: (N, 4, 4) homogeneous transforms from its axes to those of the ground [m].

        Raises ValueError as `jacobian` does.
        """
        if not 1 <= body <= self.n:
            raise ValueError(f"bodies are numbered 1 to {self.n}, found {body}")
        (Q,) = self._states(q=q)
        samples = Q.shape[1]
        columns = np.concatenate([np.repeat(np.eye(3)[:, :, None], samples, axis=2), np.zeros((3, 1, samples))], axis=1)
        for j in self.table.path(body):
            columns = self.from_frame(j - 1, Q[j - 1], columns)
            columns[:, 3] += self.origin(j - 1, Q[j - 1])
        out = np.zeros((samples, 4, 4))
        out[:, :3], out[:, 3, 3] = columns.transpose(2, 0, 1), 1.0
        return out

    def with_geometry(self, numbers: Sequence[Mapping[str, float]], gravity: Array) -> Chain:
        """The chain with other lengths [m], angles [rad] and gravity [m/s²], one mapping a row."""
        joints = [
            Joint(k.j, k.ant, k.sigma, **{key: row[key] for key in GEOMETRY})
            for k, row in zip(self.joints, numbers, strict=True)
        ]
        return Chain(joints, tuple(gravity))

    def _jacobians(self, q: Array) -> Generator[tuple[int, list[int], Array]]:
        """For each body, from 0: the joints above it, itself last, and its Jacobian by these, (6, joints, N)."""
        kept: dict[int, tuple[list[int], Array]] = {}
        children = [sum(1 for other in self.joints if other.ant == k.j) for k in self.joints]
        for k, joint in enumerate(self.joints):
            path, above = kept[joint.ant - 1] if joint.ant else ([], np.zeros((6, 0, q.shape[1])))
            own = np.zeros((6, 1, q.shape[1]))
            if joint.sigma != FIXED:
                own[2 if joint.sigma == 1 else 5] = 1.0
            linear = above[:3] + cross(above[3:], self.origin(k, q[k])[:, None])
            carried = np.concatenate([self.to_frame(k, q[k], linear), self.to_frame(k, q[k], above[3:])])
            found = [*path, k], np.concatenate([carried, own], axis=1)
            if children[k]:
                kept[k] = found
            if joint.ant:
                children[joint.ant - 1] -= 1
                if not children[joint.ant - 1]:
                    del kept[joint.ant - 1]
            yield k, *found

    def _need_numbers(self) -> None:
        refuse_missing(self.missing, self.values)

    def _numbers(self, **states: ArrayLike) -> list[Array]:
        """Joint states (N, n), of a chain whose symbols have values."""
        self._need_numbers()
        return joint_states(self.n, any(joint.sigma == FIXED for joint in self.joints), **states)

    def _states(self, **states: ArrayLike) -> list[Array]:
        """The same as (n, N)."""
        return [np.ascontiguousarray(x.T) for x in self._numbers(**states)]

    @cached_property
    def _compiled(self) -> CompiledRegressor:
        # Loaded when it is wanted: most commands ask for no regressor of a chain.
        from lacet.identify.multibody.packed_regressor import CompiledRegressor

        sigma, ant = [joint.sigma for joint in self.joints], [joint.ant for joint in self.joints]
        constant = np.array([[joint.theta, joint.r] for joint in self.joints])
        return CompiledRegressor(sigma, ant, np.stack(self._turn), np.stack(self._step), constant, self.gravity)
