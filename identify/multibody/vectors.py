"""Operations on three-vectors over many samples, arrays of shape (3, N)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cross(a: Array, b: Array) -> Array:
    """a × b for (3, N) arrays (either may be (3, 1))."""
    out = np.empty((3, *np.broadcast_shapes(a.shape[1:], b.shape[1:])))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


def dot(a: Array, b: Array) -> Array:
    """a · b, (N,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def turn(axis: int, angle: Array, v: Array) -> Array:
    """Vectors `v` (3, …, N) rotated by `angle` (N,) about coordinate axis 0, 1 or 2: R(angle) v."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out = np.empty((3, *np.broadcast_shapes(v.shape[1:], np.shape(angle))))
    out[axis] = v[axis]
    out[i] = c * v[i] - s * v[j]
    out[j] = s * v[i] + c * v[j]
    return out


def turned(R: Array, v: Array) -> Array:
    """Vectors `v` (3, …, N) turned by a rotation of each sample, R (3, 3, N): R v."""
    columns = R.reshape(3, 3, *(1,) * (v.ndim - 2), R.shape[-1])
    out = columns[:, 0] * v[0]
    out += columns[:, 1] * v[1]
    out += columns[:, 2] * v[2]
    return out


def rotation(axis: int, angle: float) -> Array:
    """The 3 × 3 rotation by `angle` [rad] about coordinate axis 0, 1 or 2."""
    return turn(axis, np.full(3, angle), np.eye(3))


def rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation matrix R = Rz(yaw) Ry(pitch) Rx(roll), 3 × 3."""
    return rotation(2, yaw) @ rotation(1, pitch) @ rotation(0, roll)


def unit(axis: int) -> Array:
    """Unit vector of coordinate axis 0, 1 or 2 as a (3, 1) array."""
    out = np.zeros((3, 1))
    out[axis] = 1.0
    return out
