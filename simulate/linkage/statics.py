"""Statics of a second car's mechanism on a fixed chassis: equilibria under travels, rack and loads, and tangents.

Unknown are the coordinates q of all parts but chassis, wheel rotations (locked to their carriers) and rack, and the
forces λ on the equations: loops of the rigid variant, and travels that are given. Newton's method on

    f(q) + J(q)ᵀ·λ = 0,   c(q) = 0,   z_i(q) - z_i0 = s_i

with f all generalised forces (elements, gravity, loads). λ of a travel is the vertical force at that wheel centre that
holds it, body z: the force conjugate to the travel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import LacetError
from lacet.simulate.linkage.loops import Loops
from lacet.simulate.linkage.mechanism import Mechanism

Array = NDArray[np.float64]
EPSILON = 1e-6
"""Step [m or rad] of differences."""
ROUNDS = 40
BALANCED = 1e-7
"""Largest unbalanced generalised force [N or N·m] of an equilibrium, unless rounding leaves more where all is stiff."""
SMALLEST = 1e-12
"""A step of Newton's method [m or rad] that is rounding alone."""
SMALLEST_FORCE = 1e-4
"""A step of the forces on the equations [N or N·m] that is rounding alone: rigid parts take loads without moving."""
FURTHEST = 0.2
"""Longest step of Newton's method [m or rad]."""
SLOW = 0.2
"""A step that is more than this part of the one before calls for the matrix of the present position."""
CLOSED = 1e-11
"""Largest error of the equations of an equilibrium [m]."""


class OutOfReach(LacetError):
    """Position that the mechanism cannot take."""


@dataclass(frozen=True)
class Loads:
    """Loads of a bench on the four wheels: `force` [N] and `moment` [N·m] (4, 3), body axes.

    They act at the contact points, straight below the wheel centres on the road of the design position.
    """

    force: Array
    moment: Array

    @classmethod
    def none(cls) -> Loads:
        """No loads."""
        return cls(np.zeros((4, 3)), np.zeros((4, 3)))


@dataclass(frozen=True)
class Shape:
    """An equilibrium.

    `q` : coordinates; `held` : (4,) force that holds each travel [N], body z at the wheel centre (0 where the travel is
    free); `centres`, `attitudes` : of the wheels, body axes.
    """

    q: Array
    held: Array
    centres: Array
    attitudes: Array


class Statics:
    """Equilibria of a mechanism whose chassis is held in its design position."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        model = mechanism.model
        fixed = {*range(6), mechanism.rack_dof, *mechanism.spin_dof}
        self.free = np.array([i for i in range(model.nv) if i not in fixed], dtype=np.int64)
        """Velocities that are unknown."""
        self._work = np.empty((3, model.nv))
        mechanism.data.qpos[:] = mechanism.design
        mechanism.data.qvel[:] = 0.0
        mechanism.refresh()
        self._design = mechanism.wheel_places()[0]
        self._last = np.zeros(mechanism.loops.count + 4)
        self._inverse: Array | None = None
        self._held: list[int] = []

    def equations(self, given: Array) -> tuple[Array, Array]:
        """Values and Jacobian (all nv) of loops and travels `given` (4,) [m]; NaN: that travel is free."""
        mechanism = self.mechanism
        mechanism.refresh()
        held = np.flatnonzero(~np.isnan(given))
        centres = mechanism.wheel_places()[0]
        values = [mechanism.loops.value(), (centres - self._design)[held, 2] - given[held]]
        rows = [mechanism.loops.jacobian()] if mechanism.loops.count else []
        for i in held:
            mechanism.lib.mj_jac(
                mechanism.model, mechanism.data, self._work, None, mechanism.data.xpos[mechanism.wheels[i]],
                mechanism.wheels[i],
            )  # fmt: skip
            rows.append(self._work[2:3].copy())
        return np.concatenate(values), np.concatenate(rows) if rows else np.zeros((0, mechanism.model.nv))

    def force(self, loads: Loads) -> Array:
        """(nv,) generalised force of elements, gravity and loads at the present position."""
        mechanism = self.mechanism
        mechanism.refresh()
        mechanism.clear()
        mechanism.elements.apply(np.zeros(mechanism.elements.states))
        for i in range(4):
            if np.any(loads.force[i]) or np.any(loads.moment[i]):
                at = mechanism.data.xpos[mechanism.wheels[i]] - [0.0, 0.0, mechanism.car.heights[i]]
                mechanism.on_part(int(mechanism.wheels[i]), loads.force[i], loads.moment[i], at)
        out = mechanism.applied()
        mechanism.clear()
        return out

    def _differences(self, of: Callable[[], Array]) -> Array:
        """Derivative of a function of the position by the unknown velocities' directions, by central differences."""
        mechanism, data = self.mechanism, self.mechanism.data
        q = data.qpos.copy()
        columns = []
        for i in self.free:
            way = np.zeros(mechanism.model.nv)
            way[i] = 1.0
            ends = []
            for sign in (EPSILON, -EPSILON):
                data.qpos[:] = q
                mechanism.lib.mj_integratePos(mechanism.model, data.qpos, way, sign)
                ends.append(of())
            columns.append((ends[0] - ends[1]) / (2.0 * EPSILON))
        data.qpos[:] = q
        mechanism.refresh()
        return np.array(columns).T

    def _matrix(self, given: Array, loads: Loads, force: Array) -> Array:
        """Derivative of the balance of the unknowns and the equations by (q, λ)."""

        def balance() -> Array:
            J = self.equations(given)[1]
            return (self.force(loads) + J.T @ force)[self.free]

        stiffness = self._differences(balance)
        J = self.equations(given)[1][:, self.free]
        return np.block([[stiffness, J.T], [J, np.zeros((len(J), len(J)))]])

    def solve(self, travel: Array, rack: float = 0.0, loads: Loads | None = None, start: Array | None = None) -> Shape:
        """The equilibrium at travels (4,) [m] (NaN: free) and rack position [m], from `start` or the design position.

        Raises OutOfReach where there is none.
        """
        mechanism, data = self.mechanism, self.mechanism.data
        given, loads = np.asarray(travel, float), loads or Loads.none()
        held = np.flatnonzero(~np.isnan(given))
        data.qvel[:] = 0.0
        data.qpos[:] = mechanism.design if start is None else start
        data.qpos[mechanism.rack_q] = rack
        if held.tolist() != self._held:
            self._inverse, self._held = None, held.tolist()
        n = len(self.free)
        loops = mechanism.loops.count
        force = np.concatenate([self._last[:loops], self._last[loops + held]])
        largest, largest_force = np.inf, np.inf
        for _ in range(ROUNDS):
            value, J = self.equations(given)
            rest = (self.force(loads) + J.T @ force)[self.free]
            closed = not len(value) or np.max(np.abs(value)) < CLOSED
            still = largest < SMALLEST and largest_force < SMALLEST_FORCE
            if closed and (np.max(np.abs(rest)) < BALANCED or still):
                break
            unbalanced = np.concatenate([rest, value])
            inverse = self._inverse
            if inverse is None or np.max(np.abs((inverse @ unbalanced)[:n])) > SLOW * largest:
                inverse = np.asarray(np.linalg.inv(self._matrix(given, loads, force)), np.float64)
                self._inverse = inverse
            step = -inverse @ unbalanced
            largest = float(np.max(np.abs(step[:n])))
            largest_force = float(np.max(np.abs(step[n:]), initial=0.0))
            part = min(1.0, FURTHEST / max(largest, SMALLEST))
            force = force + part * step[n:]
            way = np.zeros(mechanism.model.nv)
            way[self.free] = step[:n]
            mechanism.lib.mj_integratePos(mechanism.model, data.qpos, way, part)
        else:
            raise OutOfReach(f"the car '{mechanism.car.name}' has no equilibrium at travels {given} m, rack {rack} m")
        mechanism.refresh()
        centres, attitudes = mechanism.wheel_places()
        out = np.zeros(4)
        out[held] = force[loops:]
        self._last = np.concatenate([force[:loops], out])
        return Shape(data.qpos.copy(), out, centres, attitudes)

    def tangent(self, shape: Shape) -> tuple[Array, Array]:
        """At an equilibrium with all four travels held: (nv, 4) motion per travel, and (4, 4) ∂held/∂travel [N/m].

        The motion follows the equilibria: on rubber the bushings give as their loads change.
        """
        mechanism = self.mechanism
        mechanism.data.qpos[:] = shape.q
        given = shape.centres[:, 2] - self._design[:, 2]
        value, J = self.equations(given)
        force = self._forces(J)
        matrix = self._matrix(given, Loads.none(), force)
        n, m = len(self.free), len(value)
        right = np.zeros((n + m, 4))
        right[n + m - 4 :] = np.eye(4)
        found = np.asarray(np.linalg.solve(matrix, right), np.float64)
        motion = np.zeros((mechanism.model.nv, 4))
        motion[self.free] = found[:n]
        return motion, found[n + m - 4 :]

    def _forces(self, J: Array) -> Array:
        """Forces on the equations that balance the present position."""
        found = np.linalg.lstsq(J[:, self.free].T, -self.force(Loads.none())[self.free], rcond=None)[0]
        return np.asarray(found, np.float64)


def rack_per_steer(mechanism: Mechanism) -> float:
    """Travel of the rack [m] per steer [rad] (left positive, mean of both front wheels) at the design position.

    By the rigid linkage: rods keep their lengths, bushings their places, all wheel centres their travel.
    """
    data, model = mechanism.data, mechanism.model
    keep = data.qpos.copy(), data.qvel.copy()
    data.qpos[:], data.qvel[:] = mechanism.design, 0.0
    mechanism.refresh()
    loops = Loops(mechanism.lib, model, data, mechanism.car.linkage, True)
    rows = [loops.jacobian()]
    work, turn = np.empty((3, model.nv)), np.empty((3, model.nv))
    steer = np.zeros(model.nv)  # of the spin axis n about z, the mean of both front wheels
    for i in range(4):
        at = data.xpos[mechanism.wheels[i]]
        mechanism.lib.mj_jac(model, data, work, turn, at, mechanism.carriers[i])
        rows.append(work[2:3].copy())
        if i < 2:
            n = mechanism.design_attitudes[i][:, 1]
            change = np.cross(turn.T, n)
            steer += 0.5 * (n[0] * change[:, 1] - n[1] * change[:, 0]) / (n[0] ** 2 + n[1] ** 2)
    J = np.concatenate(rows)
    fixed = {*range(6), mechanism.rack_dof, *mechanism.spin_dof}
    unknown = [i for i in range(model.nv) if i not in fixed]
    motion = np.zeros(model.nv)
    motion[mechanism.rack_dof] = 1.0
    motion[unknown] = np.linalg.lstsq(J[:, unknown], -J[:, mechanism.rack_dof], rcond=None)[0]
    data.qpos[:], data.qvel[:] = keep
    mechanism.refresh()
    return float(1.0 / (steer @ motion))
