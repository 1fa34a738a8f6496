"""A placement as a row of the modified Denavit–Hartenberg table: Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r).

Any placement is such a product: γ, α, θ are Euler angles, and b, d, r are the parts of the translation along z, the
common normal and the new z. Where both z axes are parallel b is free, and 0.
"""

from __future__ import annotations

import math

import numpy as np

from lacet.identify.multibody.vectors import Array

_PARALLEL = 1e-10
"""Sine of α below which both axes are parallel: the rounding of a placement in ten digits."""
_STEEP = 1e-3
"""Sine of α below which b and r would be a thousand times as long as the placement: it takes two rows then."""
_NOTHING = 1e-12
"""Lengths [m] and angles [rad] below which an entry is the rounding of 0."""
Numbers = dict[str, float]


def rows_of(R: Array, p: Array) -> tuple[Numbers, ...]:
    """Entries γ b α d θ r whose product is a placement: one row, or a fixed frame's and a row where axes are nearly
    parallel.

    Parameters
    ----------
    R, p : (3, 3) rotation and (3,) translation [m] of the placement.
    """
    sine = math.hypot(R[0, 2], R[1, 2])
    if sine < _PARALLEL:
        return (_parallel(R, p),)
    turned = math.atan2(R[0, 2], -R[1, 2]), math.atan2(sine, R[2, 2]), math.atan2(R[2, 0], R[2, 1])
    gamma, alpha, theta = turned
    if gamma > math.pi / 2 or gamma <= -math.pi / 2:  # the same rotation, with the smaller γ
        gamma, alpha, theta = _wrapped(gamma + math.pi), -alpha, _wrapped(theta + math.pi)
    c, s = math.cos(gamma), math.sin(gamma)
    normal, across = c * p[0] + s * p[1], c * p[1] - s * p[0]
    if sine < _STEEP and abs(across) > _NOTHING:
        return _parallel(np.eye(3), p), _clean(gamma=gamma, alpha=alpha, theta=theta)
    r = -across / math.sin(alpha)
    return (_clean(gamma=gamma, b=p[2] - r * math.cos(alpha), alpha=alpha, d=normal, theta=theta, r=r),)


def _parallel(R: Array, p: Array) -> Numbers:
    """The row of a placement whose z axes are parallel, or opposite."""
    length, angle = math.hypot(p[0], p[1]), math.atan2(R[1, 0], R[0, 0])
    gamma = math.atan2(p[1], p[0]) if length > _NOTHING else 0.0
    if gamma > math.pi / 2 or gamma <= -math.pi / 2:
        gamma, length = _wrapped(gamma + math.pi), -length
    if R[2, 2] > 0.0:
        return _clean(gamma=gamma, d=length, theta=_wrapped(angle - gamma), r=float(p[2]))
    return _clean(gamma=gamma, alpha=math.pi, d=length, theta=_wrapped(gamma - angle), r=-float(p[2]))


def _wrapped(angle: float) -> float:
    """An angle between −π and π."""
    return math.remainder(angle, 2.0 * math.pi)


def _clean(**entries: float) -> Numbers:
    """The entries, with roundings of 0 and of quarter turns taken as these."""
    out: Numbers = {key: 0.0 for key in ("gamma", "b", "alpha", "d", "theta", "r")}  # noqa: C420
    for key, value in entries.items():
        near = round(2.0 * value / math.pi) * (math.pi / 2) if key in ("gamma", "alpha", "theta") else 0.0
        out[key] = near if abs(value - near) < _NOTHING else float(value)
    return out
