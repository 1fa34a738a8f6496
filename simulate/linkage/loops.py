"""Loops of the rigid variant: equations c(q) = 0 that close the tree, solved by Newton's method.

Rod: its length is the design length. Bushing: displacement 0 in the held directions of its part a. Tie: the sum of two
bushings' displacements is 0. Velocities satisfy J·v = 0 and accelerations J·a + dJ/dt·v = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.simulate.linkage.parts import Linkage
from lacet.simulate.linkage.state import Points, cross

Array = NDArray[np.float64]

CLOSED = 1e-12
"""Largest equation [m] of a closed loop."""
ROUNDS = 30
"""Newton's steps after which a position counts as out of reach."""


class Loops:
    """Equations of the loops of a linkage in a MuJoCo model; none when it is on rubber (`rigid` False)."""

    def __init__(self, lib: Any, model: Any, data: Any, linkage: Linkage, rigid: bool):
        self.lib, self.model, self.data = lib, model, data

        def site(name: str) -> int:
            return int(lib.mj_name2id(model, lib.mjtObj.mjOBJ_SITE, name))

        rods = linkage.rods if rigid else ()
        bushings = linkage.bushings if rigid else ()
        self._rods = [(site(f"{rod.name}.a"), site(f"{rod.name}.b")) for rod in rods]
        self._length = np.array([np.linalg.norm(np.subtract(rod.b.at, rod.a.at)) for rod in rods])
        self._bushings = [(site(f"{b.name}.a"), site(f"{b.name}.b")) for b in bushings]
        pick: list[Array] = []
        self.names = [rod.name for rod in rods]
        for row, bushing in enumerate(bushings):
            for k in range(3):
                if bushing.held[k]:
                    chosen = np.zeros((len(bushings), 3))
                    chosen[row, k] = 1.0
                    pick.append(chosen)
                    self.names.append(f"{bushing.name}.{'xyz'[k]}")
        order = [b.name for b in bushings]
        for tie in linkage.ties if rigid else ():
            chosen = np.zeros((len(bushings), 3))
            for name in tie.bushings:
                chosen[order.index(name), tie.component] = 1.0
            pick.append(chosen)
            self.names.append(tie.name)
        self._pick = np.array(pick).reshape(len(pick), len(bushings) * 3)
        """(equations on bushings, bushings × directions) weights."""
        a = [s for s, _ in (*self._rods, *self._bushings)]
        b = [s for _, s in (*self._rods, *self._bushings)]
        self._a, self._b = np.array(a, dtype=np.int64), np.array(b, dtype=np.int64)
        bodies = model.site_bodyid.astype(np.int64)
        self._on_a, self._on_b = bodies[self._a], bodies[self._b]
        self._points = Points(model, data, np.concatenate([self._on_a, self._on_b]))
        self._work = np.empty((3, model.nv))

    @property
    def count(self) -> int:
        """Number of equations."""
        return len(self.names)

    def _places(self) -> tuple[Array, Array, Array, Array]:
        """Points a and b (n, 3), b - a of rods as unit vectors (r, 3), axes of the bushings' parts a (m, 3, 3)."""
        p = self.data.site_xpos
        a, b = p[self._a], p[self._b]
        r = len(self._rods)
        d = b[:r] - a[:r]
        u = d / np.linalg.norm(d, axis=1, keepdims=True)
        return a, b, u, self.data.xmat[self._on_a[r:]].reshape(-1, 3, 3)

    def value(self) -> Array:
        """(n,) c(q) [m]."""
        a, b, _, R = self._places()
        r = len(self._rods)
        lengths = np.linalg.norm(b[:r] - a[:r], axis=1) - self._length
        return np.concatenate([lengths, self._pick @ np.einsum("nij,ni->nj", R, b[r:] - a[r:]).ravel()])

    def jacobian(self) -> Array:
        """(n, nv) ∂c/∂q."""
        a, b, u, R = self._places()
        r = len(self._rods)
        motion = np.empty((len(a), 3, self.model.nv))
        for i in range(len(a)):
            self.lib.mj_jac(self.model, self.data, self._work, None, b[i], self._on_b[i])
            motion[i] = self._work
            self.lib.mj_jac(self.model, self.data, self._work, None, a[i] if i < r else b[i], self._on_a[i])
            motion[i] -= self._work
        rods = np.einsum("ni,niv->nv", u, motion[:r])
        own = np.einsum("nij,niv->njv", R, motion[r:]).reshape(-1, self.model.nv)
        return np.concatenate([rods, self._pick @ own])

    def drift(self) -> Array:
        """(n,) dJ/dt·v, the acceleration of c at a = 0 [m/s²]; overwrites the data's accelerations."""
        data, lib = self.data, self.lib
        keep = data.qacc.copy()
        data.qacc[:] = 0.0
        lib.mj_rnePostConstraint(self.model, data)
        data.qacc[:] = keep
        a, b, u, R = self._places()
        r, n = len(self._rods), len(a)
        p = np.concatenate([a[:r], b[r:], b])
        v, acceleration = self._points.velocity(p), self._points.acceleration(p)[0]
        w, dv, da = self._points.turn()[r:n], v[n:] - v[:n], acceleration[n:] - acceleration[:n]
        length = np.linalg.norm(b[:r] - a[:r], axis=1)
        along = np.einsum("ij,ij->i", u, dv[:r])
        rods = np.einsum("ij,ij->i", u, da[:r]) + (np.einsum("ij,ij->i", dv[:r], dv[:r]) - along**2) / length
        seen = da[r:] - 2.0 * cross(w, dv[r:])
        return np.concatenate([rods, self._pick @ np.einsum("nij,ni->nj", R, seen).ravel()])

    def _back(self, J: Array) -> Array:
        """(n, nv) J·M⁻¹."""
        out = np.empty_like(J)
        self.lib.mj_solveM(self.model, self.data, out, J)
        return out

    def close(self) -> None:
        """Project position and velocity of the data onto the loops, with the mass matrix as the metric."""
        if not self.count:
            return
        lib, model, data = self.lib, self.model, self.data
        rounds = 0
        while True:
            lib.mj_fwdPosition(model, data)
            c, J = self.value(), self.jacobian()
            back = self._back(J)
            if np.max(np.abs(c)) < CLOSED or rounds == ROUNDS:
                break
            rounds += 1
            lib.mj_integratePos(model, data.qpos, -back.T @ np.linalg.solve(J @ back.T, c), 1.0)
        data.qvel[:] -= back.T @ np.linalg.solve(J @ back.T, J @ data.qvel)

    def accelerate(self, free: Array) -> tuple[Array, Array]:
        """Accelerations that keep the loops closed, and forces λ on the equations [N], from the `free` ones (nv,)."""
        J = self.jacobian()
        back = self._back(J)
        force = np.asarray(-np.linalg.solve(J @ back.T, J @ free + self.drift()), np.float64)
        return free + back.T @ force, force
