"""A run in outline: the few series of its motion that checks of channels, manoeuvre phases and ranges look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import TYRE_ROWS, Row
from lacet.identify.multibody.vectors import Array, dot
from lacet.identify.signals.filters import Filters


@dataclass(frozen=True)
class CornerOutline:
    """Series of one corner, each as in `CornerMotion`, (N,); `force` (3, N).

    `load` : the wheel force's component along the road's normal [N].
    """

    travel: Array
    rate: Array
    steer: Array
    spin: Array
    height: Array
    deflection: Array
    force: Array
    load: Array

    @classmethod
    def of(cls, corner: CornerMotion) -> CornerOutline:
        """The outline of a corner's motion."""
        load = dot(corner.force, corner.normal)
        return cls(
            corner.travel, corner.rate, corner.steer, corner.spin, corner.height, corner.deflection, corner.force, load
        )


@dataclass(frozen=True)
class Outline:
    """A run's motion with few of its series, so that a run of an hour is held in memory.

    Attributes
    ----------
    t, filters, channels, velocity, attitude : as in `Motion`.
    omega, accel : (3, N) angular velocity [rad/s] and specific force [m/s²] of the body's axes, in these.
    corners : by name.
    tyres : measured left sides of the tyres' rows, row → (N,) [N].
    """

    t: Array
    filters: Filters
    channels: frozenset[str]
    velocity: Array | None
    attitude: Array | None
    omega: Array
    accel: Array
    corners: Mapping[str, CornerOutline]
    tyres: Mapping[Row, Array]

    @classmethod
    def of(cls, motion: Motion) -> Outline:
        """The outline of a motion."""
        return cls(
            motion.t, motion.filters, motion.channels, motion.velocity, motion.attitude, motion.body.omega,
            motion.body.accel, {name: CornerOutline.of(corner) for name, corner in motion.corners.items()},
            {row: motion.measured(row) for row in TYRE_ROWS if row in motion.rows},
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: Sequence[Outline]) -> Outline:
        """The outline of a run from those of its stretches, in order."""
        first = parts[0]
        corners = {
            name: CornerOutline(**{key: _end_to_end([getattr(part.corners[name], key) for part in parts])
                                   for key in vars(corner)})
            for name, corner in first.corners.items()
        }  # fmt: skip
        return cls(
            _end_to_end([part.t for part in parts]), first.filters, first.channels,
            None if first.velocity is None else _end_to_end([part.velocity for part in parts]),
            None if first.attitude is None else _end_to_end([part.attitude for part in parts]),
            _end_to_end([part.omega for part in parts]), _end_to_end([part.accel for part in parts]), corners,
            {row: _end_to_end([part.tyres[row] for part in parts]) for row in first.tyres},
        )  # fmt: skip


def _end_to_end(parts: Sequence[Array | None]) -> Array:
    """Series (…, n) of the stretches of a run, which all have it, one after the other."""
    return np.concatenate([part for part in parts if part is not None], axis=-1)
