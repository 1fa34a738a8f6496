"""The regressor of a tree, state by state, in the part of Python that `compiled` makes machine code of.

All vectors are in the axes of the ground. A body's wrench per unit of its ten parameters is a table of forces and
moments; a joint's row is its axis times the tables of the bodies that it carries. Bodies that follow each other in
number stand side by side in the table, so that a row is a few long products: its runs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array

REVOLUTE, PRISMATIC = 0, 1
"""σ of a joint; a fixed frame has neither."""

MOMENTS, FORCES, FIRST_MOMENTS, JOINT = range(4)
"""Kinds of a run: all ten parameters of each body on a revolute joint, or on a prismatic one, whose inertias are zeros;
on a prismatic one only the four that give a force, MX MY MZ M; rotor inertia and friction of the joint itself."""

_LINE, _TABLE, _TABLES = "float64[::1]", "float64[:, ::1]", "float64[:, :, ::1]"
_ARGUMENTS = (
    _TABLE, _TABLE, _TABLE, "int64[:, ::1]", _TABLES, _TABLE, _TABLE, _LINE, "uint64[:, ::1]", "boolean", _TABLE
)  # fmt: skip
SIGNATURE = f"void({', '.join(_ARGUMENTS)})"


def fill_regressor(
    q: Array, qd: Array, qdd: Array, bodies: NDArray[np.int64], turn: Array, step: Array, constant: Array,
    gravity: Array, runs: NDArray[np.uint64], clear: bool, out: Array,
) -> None:  # fmt: skip
    """Write the entries of the regressor that are not zero by structure.

    Parameters
    ----------
    q, qd, qdd : (N, n) joint states [rad, m; s].
    bodies : (n, 3) for each body σ, the number of its antecedent (0: the ground), and whether positions are counted
        from its origin: moments are taken about a point that is close, however far the tree has moved as a whole.
    turn, step : (n, 3, 3) and (n, 3), Rz(γ) Rx(α) and the constant part of the origin in the antecedent's axes [m].
    constant : (n, 2) constant parts of θ [rad] and r [m].
    gravity : (3,) in the ground frame [m/s²].
    runs : (r, 5) for each run the number of its joint, its kind, its first column in the table of its kind, its length
        and its first column in `out`. Unsigned: an index that may be negative costs as much as the product.
    clear : whether the other entries of `out` are to be made zero.
    out : (N, …) entries of each sample.
    """
    n = bodies.shape[0]
    R, p = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    omega, omega_dot, accel = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    arm = np.zeros((n + 1, 3))
    T, F = np.zeros((6, 10 * n)), np.zeros((3, 4 * n))  # forces and moments; the forces without the inertias' columns
    spin, e, d, o = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        R[0, i, i], accel[0, i] = 1.0, -gravity[i]
    for t in range(q.shape[0]):
        for k in range(n):
            b, a = k + 1, bodies[k, 1]
            theta, r = constant[k, 0], constant[k, 1]
            rate, rate_dot, slide, slide_dot = 0.0, 0.0, 0.0, 0.0
            if bodies[k, 0] == REVOLUTE:
                theta, rate, rate_dot = theta + q[t, k], qd[t, k], qdd[t, k]
            elif bodies[k, 0] == PRISMATIC:
                r, slide, slide_dot = r + q[t, k], qd[t, k], qdd[t, k]
            c, s = math.cos(theta), math.sin(theta)
            for i in range(3):
                x, y, z, o[i] = 0.0, 0.0, 0.0, 0.0
                for m in range(3):
                    x += R[a, i, m] * turn[k, m, 0]
                    y += R[a, i, m] * turn[k, m, 1]
                    z += R[a, i, m] * turn[k, m, 2]
                    o[i] += R[a, i, m] * step[k, m]
                R[b, i, 0], R[b, i, 1], R[b, i, 2] = c * x + s * y, c * y - s * x, z
                o[i] += z * r
                p[b, i] = 0.0 if bodies[k, 2] else p[a, i] + o[i]
            # The origin moves with the antecedent and along the axis; the frame turns about the axis.
            wx, wy, wz = omega[a, 0], omega[a, 1], omega[a, 2]
            dx, dy, dz = omega_dot[a, 0], omega_dot[a, 1], omega_dot[a, 2]
            zx, zy, zz = R[b, 0, 2], R[b, 1, 2], R[b, 2, 2]
            hx = wy * o[2] - wz * o[1] + 2.0 * slide * zx
            hy = wz * o[0] - wx * o[2] + 2.0 * slide * zy
            hz = wx * o[1] - wy * o[0] + 2.0 * slide * zz
            ax = accel[a, 0] + wy * hz - wz * hy + dy * o[2] - dz * o[1] + slide_dot * zx
            ay = accel[a, 1] + wz * hx - wx * hz + dz * o[0] - dx * o[2] + slide_dot * zy
            az = accel[a, 2] + wx * hy - wy * hx + dx * o[1] - dy * o[0] + slide_dot * zz
            dx += rate_dot * zx + rate * (wy * zz - wz * zy)
            dy += rate_dot * zy + rate * (wz * zx - wx * zz)
            dz += rate_dot * zz + rate * (wx * zy - wy * zx)
            wx, wy, wz = wx + rate * zx, wy + rate * zy, wz + rate * zz
            px, py, pz = p[b, 0], p[b, 1], p[b, 2]
            accel[b, 0], accel[b, 1], accel[b, 2] = ax, ay, az
            omega[b, 0], omega[b, 1], omega[b, 2] = wx, wy, wz
            omega_dot[b, 0], omega_dot[b, 1], omega_dot[b, 2] = dx, dy, dz
            arm[b, 0], arm[b, 1], arm[b, 2] = py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx
            # First moment along body axis f: force ω̇ × f + ω × (ω × f), moment f × a, both carried to the point.
            for m in range(3):
                fx, fy, fz = R[b, 0, m], R[b, 1, m], R[b, 2, m]
                ux, uy, uz = wy * fz - wz * fy, wz * fx - wx * fz, wx * fy - wy * fx
                gx = dy * fz - dz * fy + wy * uz - wz * uy
                gy = dz * fx - dx * fz + wz * ux - wx * uz
                gz = dx * fy - dy * fx + wx * uy - wy * ux
                h = 10 * k + 6 + m
                T[0, h], T[1, h], T[2, h] = gx, gy, gz
                T[3, h] = fy * az - fz * ay + py * gz - pz * gy
                T[4, h] = fz * ax - fx * az + pz * gx - px * gz
                T[5, h] = fx * ay - fy * ax + px * gy - py * gx
                spin[0, m], spin[1, m], spin[2, m] = ux, uy, uz
                e[m], d[m] = fx * wx + fy * wy + fz * wz, fx * dx + fy * dy + fz * dz
            h = 10 * k + 9
            T[0, h], T[1, h], T[2, h] = ax, ay, az
            T[3, h], T[4, h], T[5, h] = py * az - pz * ay, pz * ax - px * az, px * ay - py * ax
            # Inertia f fᵀ: moment f (f·ω̇) + (ω × f) (f·ω); a product of inertia has both orders.
            h = 10 * k
            for l in range(3):
                for m in range(l, 3):
                    for i in range(3):
                        T[3 + i, h] = R[b, i, l] * d[m] + spin[i, l] * e[m]
                        if l != m:
                            T[3 + i, h] += R[b, i, m] * d[l] + spin[i, m] * e[l]
                    h += 1
            for i in range(3):
                for m in range(4):
                    F[i, 4 * k + m] = T[i, 10 * k + 6 + m]
        if clear:
            for m in range(out.shape[1]):
                out[t, m] = 0.0
        for i in range(runs.shape[0]):
            b, kind, start, length, place = runs[i, 0], runs[i, 1], runs[i, 2], runs[i, 3], runs[i, 4]
            x, y, z = R[b, 0, 2], R[b, 1, 2], R[b, 2, 2]
            u, v, w = arm[b, 0], arm[b, 1], arm[b, 2]
            if kind == MOMENTS:
                for m in range(length):
                    moment = x * T[3, start + m] + y * T[4, start + m] + z * T[5, start + m]
                    out[t, place + m] = moment + u * T[0, start + m] + v * T[1, start + m] + w * T[2, start + m]
            elif kind == FORCES:
                for m in range(length):
                    out[t, place + m] = x * T[0, start + m] + y * T[1, start + m] + z * T[2, start + m]
            elif kind == FIRST_MOMENTS:
                for m in range(length):
                    out[t, place + m] = x * F[0, start + m] + y * F[1, start + m] + z * F[2, start + m]
            else:
                out[t, place], out[t, place + 1] = qdd[t, start], qd[t, start]
                out[t, place + 2] = np.sign(qd[t, start])
