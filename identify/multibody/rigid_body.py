"""Newton–Euler dynamics of one rigid body: its wrench, also as a linear map of its ten parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array, cross

PARAMETERS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""Parameters of a body: inertia tensor about the frame's origin [kg·m²], first moments [kg·m], mass [kg]."""

NEVER_NEGATIVE = ("XX", "YY", "ZZ", "M")
"""Those of them that no body has below zero."""

FRICTION = ("IA", "FV", "FS")
"""Parameters of a joint: rotor inertia, viscous and Coulomb friction, in SYMORO's names."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s²], by definition of the 3rd General Conference on Weights and Measures (1901).

The value used wherever gravity is not measured."""

UNITS = ("kg·m²",) * 6 + ("kg·m",) * 3 + ("kg",)

REVOLUTION = np.array([[name in own for own in (("ZZ",), ("XX", "YY"), ("MZ",), ("M",))] for name in PARAMETERS], float)
"""(10, 4) parameters of a balanced body of revolution about z, per unit of its own four: ZZ, XX = YY, MZ, M."""


def wrench(omega: Array, omega_dot: Array, accel: Array, values: Sequence[float] | Array) -> tuple[Array, Array]:
    """Wrench that moves a body: force [N] and moment about the frame's origin [N·m].

    Parameters
    ----------
    omega, omega_dot, accel : (3, N) in the body's frame; `accel` is the origin's specific force (includes −g).
    values : the ten parameters in the order of `PARAMETERS`.
    """
    xx, xy, xz, yy, yz, zz, mx, my, mz, m = values
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments = np.array([[mx], [my], [mz]])
    force = m * accel + cross(omega_dot, moments) + cross(omega, cross(omega, moments))
    moment = inertia @ omega_dot + cross(omega, inertia @ omega) + cross(moments, accel)
    return force, moment


def wrench_regressor(omega: Array, omega_dot: Array, accel: Array) -> NDArray[np.float64]:
    """The wrench per unit of each parameter, (6, 10, N): three forces, three moments about the origin."""
    (p, q, r), (dp, dq, dr), (ax, ay, az) = omega, omega_dot, accel
    out = np.zeros((6, 10, omega.shape[1]))
    # Columns of [ω̇]× + [ω]×[ω]× for the first moments.
    out[0, 6], out[0, 7], out[0, 8] = -q * q - r * r, p * q - dr, p * r + dq
    out[1, 6], out[1, 7], out[1, 8] = p * q + dr, -p * p - r * r, q * r - dp
    out[2, 6], out[2, 7], out[2, 8] = p * r - dq, q * r + dp, -p * p - q * q
    out[0, 9], out[1, 9], out[2, 9] = ax, ay, az
    # Euler's equations, element by element of the inertia tensor.
    out[3, 0], out[4, 0], out[5, 0] = dp, p * r, -p * q
    out[3, 1], out[4, 1], out[5, 1] = dq - p * r, dp + q * r, p * p - q * q
    out[3, 2], out[4, 2], out[5, 2] = dr + p * q, r * r - p * p, dp - q * r
    out[3, 3], out[4, 3], out[5, 3] = -q * r, dq, p * q
    out[3, 4], out[4, 4], out[5, 4] = q * q - r * r, dr - p * q, dq + p * r
    out[3, 5], out[4, 5], out[5, 5] = q * r, -p * r, dr
    # MS × a.
    out[3, 7], out[3, 8] = az, -ay
    out[4, 6], out[4, 8] = -az, ax
    out[5, 6], out[5, 7] = ay, -ax
    return out


def move_parameters(values: Sequence[float] | Array, R: Array, p: Array) -> NDArray[np.float64]:
    """Ten parameters of a body expressed in another frame.

    Parameters
    ----------
    values : in the body's frame.
    R : 3 × 3 rotation from the body's axes to the new ones.
    p : (3,) the body's origin in the new frame [m].
    """
    xx, xy, xz, yy, yz, zz, mx, my, mz, m = values
    first = R @ np.array([mx, my, mz])
    tensor = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
    p = np.asarray(p, float)
    pp, pm = float(p @ p), float(p @ first)
    tensor = (
        tensor + m * (pp * np.eye(3) - np.outer(p, p)) + 2 * pm * np.eye(3) - np.outer(p, first) - np.outer(first, p)
    )
    first = first + m * p
    return np.array([tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2], *first, m])
