"""Positions, velocities and accelerations of points of a linkage, from MuJoCo's results by body, all points at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Points:
    """Points fixed to parts of a MuJoCo model: `body` (n,) of each. Ground axes, SI units.

    MuJoCo gives a body's angular velocity and the velocity of the body-fixed point at the tree's centre of mass.
    """

    def __init__(self, model: Any, data: Any, body: Index):
        self.data, self.body = data, body
        self._root = int(model.body_rootid[body[0]]) if len(body) else 0
        self._gravity = np.array(model.opt.gravity)

    def velocity(self, p: Array) -> Array:
        """(n, 3) velocities of the points at `p` (n, 3)."""
        twist = self.data.cvel[self.body]
        return twist[:, 3:] + cross(twist[:, :3], p - self.data.subtree_com[self._root])

    def turn(self) -> Array:
        """(n, 3) angular velocities of the points' bodies."""
        return self.data.cvel[self.body, :3]

    def acceleration(self, p: Array) -> tuple[Array, Array]:
        """Accelerations and angular accelerations (n, 3) of the points at `p`, after `mj_rnePostConstraint`."""
        spatial = self.data.cacc[self.body]
        w = self.turn()
        at = spatial[:, 3:] + cross(spatial[:, :3], p - self.data.subtree_com[self._root])
        return at + self._gravity + cross(w, self.velocity(p)), spatial[:, :3].copy()


def cross(a: Array, b: Array) -> Array:
    """(n, 3) cross products of as many rows; np.cross costs ten times more for a few."""
    out = np.empty_like(a)
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out
