"""Motion of the car along a run, from the measurements alone: the input of every effect's regressor columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row, RowAbsence
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.vectors import Array, cross, dot
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import RunNote


@dataclass(frozen=True)
class FlatRoad(RunNote):
    """Fewer than three ground lasers: the road counts as flat, its normal is computed from the attitude."""


@dataclass(frozen=True)
class GroundLaserOffset(RunNote):
    """A ground laser mounted `ahead` of its wheel's centre [m], negative behind: it meets bumps at another time."""

    ahead: float


@dataclass(frozen=True)
class BrakingLeftOut(RunNote):
    """`seconds` left out of `rows` because the brakes act: `channel` is above `pressure` [Pa]."""

    seconds: float
    rows: tuple[Row, ...]
    channel: str
    pressure: float


@dataclass(frozen=True)
class ConditionalTravel:
    """Suspension travel and its rate at a corner given the whole noisy record: Gaussian, independent at an instant.

    Attributes
    ----------
    travel, rate : (N,) expected values [m, m/s].
    travel_sigma, rate_sigma : (N,) 1 σ.
    """

    travel: Array
    rate: Array
    travel_sigma: Array
    rate_sigma: Array


@dataclass(frozen=True)
class CornerMotion:
    """Motion and loads of one corner of the car along a run; vectors (3, N) in body axes, scalars (N,).

    Attributes
    ----------
    travel, rate, accel : suspension travel s [m], compression positive, and its derivatives.
    steer, camber, pitch : carrier attitude Rz(steer) Rx(camber) Ry(pitch) [rad].
    axes : (3, 3, N) that rotation, from carrier to body axes.
    centre : wheel centre from the body origin [m].
    dp_ds, dphi_ds : wheel-centre position and carrier rotation per unit of travel, from the bench tables.
    wheel_dphi_ds : the same for the wheel: equal to dphi_ds, or without its part about the spin axis in a suspension
        row from which the half-shaft torque was eliminated.
    torque_work : work per unit of travel of the torque that enters the suspension row [N].
    torque : torque on the wheel that enters the spin row, half-shaft less brake [N·m].
    force, moment : measured wheel load, about the wheel centre [N, N·m].
    spin_axis : the wheel's axis, to the left.
    spin, spin_accel : wheel speed about it [rad/s], and its derivative.
    normal : the road's normal.
    height : wheel centre above the road along the normal [m].
    deflection : tyre deflection δ = R0 − h/√(1 − (n·e)²) [m].
    deflection_rate : its derivative, the road's normal turning with the ground lasers' rates [m/s].
    centre_accel : specific force at the wheel centre [m/s²].
    axle : motion of the axle's body (the wheel carrier) in carrier axes.
    wheel : motion of the wheel in its joint frame, z along the spin axis.
    conditional : travel and rate given the record, for laws that bend within the noise; None for exact signals.

    Examples
    --------
    >>> corner = runs.prepared[0].motion.corners["fl"]
    >>> corner.travel.shape == corner.rate.shape
    True
    """

    travel: Array
    rate: Array
    accel: Array
    steer: Array
    camber: Array
    pitch: Array
    axes: Array
    centre: Array
    dp_ds: Array
    dphi_ds: Array
    wheel_dphi_ds: Array
    torque_work: Array
    torque: Array
    force: Array
    moment: Array
    spin_axis: Array
    spin: Array
    spin_accel: Array
    normal: Array
    height: Array
    deflection: Array
    deflection_rate: Array
    centre_accel: Array
    axle: FrameMotion
    wheel: FrameMotion
    conditional: ConditionalTravel | None = None

    def at(self, index: NDArray[np.intp]) -> CornerMotion:
        """The corner at the samples `index`."""
        return _at(self, index)

    def off_expectation(self, travel: float, rate: float) -> CornerMotion:
        """The corner with travel and rate so many σ off what is expected given the record. Needs a `conditional`."""
        given = self.conditional
        assert given is not None
        return replace(
            self, travel=given.travel + travel * given.travel_sigma, rate=given.rate + rate * given.rate_sigma
        )


_Part = TypeVar("_Part", CornerMotion, FrameMotion, ConditionalTravel)


def _at(part: _Part, index: NDArray[np.intp]) -> _Part:
    """The same with every array at the samples `index`."""
    taken: dict[str, Any] = {
        name: value[..., index] if isinstance(value, np.ndarray) else _at(value, index)
        for name, value in vars(part).items()
        if value is not None
    }
    return replace(part, **taken)


@dataclass(frozen=True)
class Motion:
    """A run as motion and loads on one uniform time grid.

    Attributes
    ----------
    name : the run's name.
    t : (N,) s.
    filters : filter settings of the signals.
    reference : ``contact`` or ``hub``.
    body : motion of the body axes' origin, in body axes.
    velocity : (3, N) m/s of the origin over the ground in body axes, or None where no speed sensor was read.
    attitude : (3, N) roll, pitch, yaw of the body [rad], or None where it was not measured.
    corners : by name.
    rows : the rows whose left side is measured, in the order of `ROWS`.
    left_out : why each other row is absent.
    usable : row → (N,) whether a sample is outside flagged intervals and filter transients.
    channels : channels the run has.
    notes : notes for the reader of the results.
    ahead : distance of ground lasers ahead of their wheels' centres [m], negative behind: the largest in magnitude.

    Examples
    --------
    >>> motion = runs.prepared[0].motion
    >>> sorted(motion.corners)
    ['fl', 'fr', 'rl', 'rr']
    """

    name: str
    t: Array
    filters: Filters
    reference: str
    body: FrameMotion
    velocity: Array | None
    attitude: Array | None
    corners: Mapping[str, CornerMotion]
    rows: tuple[Row, ...]
    left_out: Mapping[Row, RowAbsence]
    usable: Mapping[Row, NDArray[np.bool_]]
    channels: frozenset[str]
    notes: tuple[RunNote, ...] = ()
    ahead: float = 0.0
    _off: dict[tuple[tuple[str, ...], float, float], Motion] = field(
        default_factory=dict[tuple[tuple[str, ...], float, float], "Motion"], init=False, repr=False, compare=False
    )

    def off_expectation(self, corners: tuple[str, ...], travel: float, rate: float) -> Motion:
        """The motion with travel and rate of some corners so many σ off what is expected given the record.

        `corners` : of those with a `conditional`. Kept, as every law that bends asks for the same few.
        """
        key = corners, travel, rate
        if key not in self._off:
            if len(corners) == 1:
                moved = {corners[0]: self.corners[corners[0]].off_expectation(travel, rate)}
            else:
                moved = {c: self.off_expectation((c,), travel, rate).corners[c] for c in corners}
            self._off[key] = replace(self, corners={**self.corners, **moved})
        return self._off[key]

    def measured(self, row: Row) -> Array:
        """(N,) the measured left side of a row [N or N·m].

        Chassis rows are ΣF and Σ(M + r × F) about the body origin in body axes; a suspension row is the virtual work of
        the wheel load and of the torque on the wheel per unit of travel; a tyre row the load along the road normal; a
        spin row the moment and the torque about the wheel's axis (`car.rows`).
        """
        if row.kind == "chassis":
            axis = "xyz".index(row.place[1])
            if row.unit == "N":
                return np.sum([c.force[axis] for c in self.corners.values()], axis=0)
            return np.sum([c.moment[axis] + cross(c.centre, c.force)[axis] for c in self.corners.values()], axis=0)
        corner = self.corners[row.place]
        if row.kind == "suspension":
            return dot(corner.force, corner.dp_ds) + dot(corner.moment, corner.wheel_dphi_ds) + corner.torque_work
        if row.kind == "tyre":
            return dot(corner.force, corner.normal)
        return dot(corner.moment, corner.spin_axis) + corner.torque
