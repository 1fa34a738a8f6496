"""Wheel positions and axes under hidden effects: a twisting rear part, carriers that rotate with travel.

Without such an effect the engine keeps its constants, and this module is not used.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triple = tuple[float, float, float]


def rotation(vector: Array) -> Array:
    """(…, 3, 3) rotation by the rotation vectors (…, 3) [rad]."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(np.asarray(vector, float), -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.eye(3) + first * cross + second * (cross @ cross)


class Corner(NamedTuple):
    """Constants of a corner in the axes of the part it is mounted on.

    `centre` of the wheel at design position, `slide` per unit of travel, `axes` (fixed, cosine, sine parts of the spin
    axis about the kingpin axis, kingpin axis), `turn` [rad/m].
    """

    centre: Triple
    slide: Triple
    axes: tuple[Triple, Triple, Triple, Triple]
    turn: Triple


def turned(corner: Corner, travel: float) -> Corner:
    """The corner with its carrier rotated by its travel."""
    tx, ty, tz = corner.turn
    rate = math.sqrt(tx * tx + ty * ty + tz * tz)
    ax, ay, az = tx / rate, ty / rate, tz / rate
    c, s = math.cos(rate * travel), math.sin(rate * travel)

    def about(v: Triple) -> Triple:
        x, y, z = v
        along = (1.0 - c) * (ax * x + ay * y + az * z)
        return (
            c * x + s * (ay * z - az * y) + along * ax,
            c * y + s * (az * x - ax * z) + along * ay,
            c * z + s * (ax * y - ay * x) + along * az,
        )

    fixed, cosine, sine, kingpin = corner.axes
    return corner._replace(axes=(about(fixed), about(cosine), about(sine), about(kingpin)))


def twisted(corner: Corner, angle: float, z: float) -> Corner:
    """The corner on a rear part rotated by `angle` about the x axis at height `z`."""
    c, s = math.cos(angle), math.sin(angle)

    def about(v: Triple) -> Triple:
        return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]

    x, y, over = about((corner.centre[0], corner.centre[1], corner.centre[2] - z))
    fixed, cosine, sine, kingpin = corner.axes
    axes = (about(fixed), about(cosine), about(sine), about(kingpin))
    return Corner((x, y, over + z), about(corner.slide), axes, about(corner.turn))


def coupling(nv: int, slides: list[int], turns: list[int], ratios: list[float]) -> Array:
    """(k, nv) matrix G of G·v = 0: each rotating joint moves at `ratios` times the speed of its slide."""
    coupled = [(s, t, r) for s, t, r in zip(slides, turns, ratios, strict=True) if t >= 0]
    G = np.zeros((len(coupled), nv))
    for row, (slide, turn, ratio) in zip(G, coupled, strict=True):
        row[turn], row[slide] = 1.0, -ratio
    return G
