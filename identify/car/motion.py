"""Motion of the car along a run, from the measurements alone: the input of every effect's regressor columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import other_corner
from lacet.identify.car.car_tree import CHASSIS
from lacet.identify.car.rows import CHASSIS_ROWS, SUSPENSION_ROWS, Row, RowAbsence
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.rigid_body import PARAMETERS, wrench_regressor
from lacet.identify.multibody.vectors import Array, cross, dot
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import RunNote

Course: TypeAlias = tuple[Array, Array, Array]
"""A quantity and its first two derivatives by time, (N,) each, or (5, N) for the joints of a table."""


@dataclass(frozen=True)
class FlatRoad(RunNote):
    """Fewer than three ground lasers: the road counts as flat, its normal is computed from the attitude."""

    is_fault = False


@dataclass(frozen=True)
class GroundLaserOffset(RunNote):
    """A ground laser mounted `ahead` of its wheel's centre [m], negative behind: it meets bumps at another time."""

    ahead: float


@dataclass(frozen=True)
class BrakingLeftOut(RunNote):
    """`seconds` left out of `rows` because the brakes act: `channel` is above `pressure` [Pa]."""

    is_fault = False

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
    rate_rms : (N,) root mean square of the rate over the run [m/s].
    """

    travel: Array
    rate: Array
    travel_sigma: Array
    rate_sigma: Array
    rate_rms: Array


@dataclass(frozen=True)
class CornerMotion:
    """Motion and loads of one corner of the car along a run; vectors (3, N) in body axes, scalars (N,).

    Attributes
    ----------
    travel, rate, accel : suspension travel s [m], compression positive, and its derivatives.
    steer, camber, pitch : carrier attitude Rz(steer) Rx(camber) Ry(pitch) [rad].
    axes : (3, 3, N) that rotation, from carrier to body axes.
    centre : wheel centre from the body origin [m].
    shift : wheel centre from its design position [m].
    dp_ds, dphi_ds : wheel-centre position and carrier rotation per unit of travel, from the bench tables.
    wheel_dphi_ds : the same for the wheel: equal to dphi_ds, or without its part about the spin axis in a suspension
        row from which the half-shaft torque was eliminated.
    torque_work : work per unit of travel of the torque that enters the suspension row [N].
    torque : torque on the wheel that enters the spin row, half-shaft less brake [N·m].
    torque_on_carrier : torque about the spin axis that does work on a pitch of the carrier with travel [N·m]; 0 where
        it is not known.
    wheel_on_carrier : turn of the wheel in a suspension row per pitch of its carrier: 1, or 0 where the half-shaft's
        torque is eliminated from it.
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
    other_dp_ds, other_dphi_ds, other_wheel_dphi_ds, other_torque_work : the same per unit of travel of the axle's
        other wheel, in whose suspension row they stand; None where this wheel does not move with it.

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
    shift: Array
    dp_ds: Array
    dphi_ds: Array
    wheel_dphi_ds: Array
    torque_work: Array
    torque: Array
    torque_on_carrier: Array
    wheel_on_carrier: Array
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
    other_dp_ds: Array | None = None
    other_dphi_ds: Array | None = None
    other_wheel_dphi_ds: Array | None = None
    other_torque_work: Array | None = None

    @property
    def travelled(self) -> Course:
        """The travel and its first two derivatives."""
        return self.travel, self.rate, self.accel

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

    def at_usual_rate(self, sign: float) -> CornerMotion:
        """The corner with the expected travel, and the run's root mean square as its rate. Needs a `conditional`."""
        given = self.conditional
        assert given is not None
        return replace(self, travel=given.travel, rate=sign * given.rate_rms)


_PARTS = (CornerMotion, FrameMotion, ConditionalTravel)
_Part = TypeVar("_Part", bound=CornerMotion | FrameMotion | ConditionalTravel)


def _at(part: _Part, index: NDArray[np.intp]) -> _Part:
    """The same with every array at the samples `index`."""
    taken: dict[str, Any] = {
        name: _at(value, index) if isinstance(value, _PARTS) else value[..., index]
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
    channels : channels the run has; `derived` : those that follow from others.
    notes : notes for the reader of the results.
    ahead : distance of ground lasers ahead of their wheels' centres [m], negative behind: the largest in magnitude.
    masses : known masses, of ``chassis`` and ``axle.{c}`` (what is unsprung at a corner) → (N,) [kg]; empty where wheel
        loads are measured. Their inertia is on the left side.
    known : known parameters by name → (N,), where one stands in for a known mass (`car.rows.PARAMETER_OF`). Their force
        is on the left side, too.
    road_height : height of a flat road at design position above the body origin, negative [m].
    pitching : corners whose wheel loads are measured in axes that pitch with the carrier.

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
    masses: Mapping[str, Array] = field(default_factory=dict[str, Array])
    known: Mapping[str, Array] = field(default_factory=dict[str, Array])
    road_height: float = 0.0
    pitching: frozenset[str] = frozenset()
    derived: frozenset[str] = frozenset()
    _off: dict[tuple[tuple[str, ...], float, float], Motion] = field(
        default_factory=dict[tuple[tuple[str, ...], float, float], "Motion"], init=False, repr=False, compare=False
    )
    _weights: dict[Row, dict[Row, Array | float]] = field(
        default_factory=dict[Row, dict[Row, "Array | float"]], init=False, repr=False, compare=False
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

    def at_usual_rate(self, corners: tuple[str, ...], sign: float) -> Motion:
        """The motion with the rate of some corners at ± the run's root mean square."""
        return replace(self, corners={**self.corners, **{c: self.corners[c].at_usual_rate(sign) for c in corners}})

    def given(self, other: Motion) -> Motion:
        """The motion with what is expected of the corners' travel given another record, that of `other`."""
        corners = {c: replace(one, conditional=other.corners[c].conditional) for c, one in self.corners.items()}
        return replace(self, corners=corners)

    def measured(self, row: Row) -> Array:
        """(N,) the measured left side of a row [N or N·m].

        Chassis rows are ΣF and Σ(M + r × F) about the body origin in body axes; a suspension row is the virtual work of
        the wheel load and of the torque on the wheel per unit of travel, and of those on the axle's other wheel where
        it moves too; a tyre row the load along the road normal; a spin row the moment and the torque about the wheel's
        axis; a combined row a combination of these (`car.rows`). The inertia of known masses and the force of known
        parameters are subtracted.
        """
        if row.combined:
            return sum(
                (weight * self.measured(part) for part, weight in self.weights(row).items()), np.zeros(self.t.size)
            )
        if row.kind == "chassis":
            axis = "xyz".index(row.place[1])
            forces = {name: c.force - self._inertia(name) for name, c in self.corners.items()}
            if row.unit == "N":
                own = self.masses.get("chassis", 0.0) * self.body.accel[axis]
                return np.sum([force[axis] for force in forces.values()], axis=0) - own
            moments = [c.moment[axis] + cross(c.centre, forces[name])[axis] for name, c in self.corners.items()]
            return np.sum(moments, axis=0) - self._of_known_inertias(axis)
        corner = self.corners[row.place]
        if row.kind == "suspension":
            force = corner.force - self._inertia(row.place)
            own = dot(force, corner.dp_ds) + dot(corner.moment, corner.wheel_dphi_ds) + corner.torque_work
            return own + self._work_of_other(other_corner(row.place)) - self._of_known_suspension(row.place)
        if row.kind == "tyre":
            known = self.known.get(f"tyre_stiffness.{row.place}.kt", 0.0) * corner.deflection
            return dot(corner.force, corner.normal) - known
        return dot(corner.moment, corner.spin_axis) + corner.torque

    def _work_of_other(self, name: str) -> Array | float:
        """(N,) work of the load and torque on a wheel per unit of travel of the axle's other wheel [N]."""
        wheel = self.corners[name]
        if wheel.other_dp_ds is None or wheel.other_wheel_dphi_ds is None or wheel.other_torque_work is None:
            return 0.0
        force = wheel.force - self._inertia(name)
        turning = dot(wheel.moment, wheel.other_wheel_dphi_ds) + wheel.other_torque_work
        return dot(force, wheel.other_dp_ds) + turning

    def _of_known_suspension(self, name: str) -> Array | float:
        """(N,) force of the known spring, damper and static load at a corner [N]."""
        corner = self.corners[name]
        names = (f"spring.{name}.k", f"damper.{name}.c", f"offset.{name}.f0")
        k, c, f0 = (self.known.get(parameter, 0.0) for parameter in names)
        return k * corner.travel + c * corner.rate + f0

    def _of_known_inertias(self, axis: int) -> Array | float:
        """(N,) moment about the body's axis of the sprung mass' known moments of inertia [N·m]."""
        known = {k: self.known[f"{kind}{CHASSIS}"] for k, kind in _INERTIAS.items() if f"{kind}{CHASSIS}" in self.known}
        if not known:
            return 0.0
        table = wrench_regressor(self.body.omega, self.body.omega_dot, self.body.accel)[3 + axis]
        return np.sum([value * table[k] for k, value in known.items()], axis=0)

    def _inertia(self, corner: str) -> Array | float:
        """(3, N) mass × specific force of what is unsprung at a corner, where its mass is known [N]; else 0."""
        mass = self.masses.get(f"axle.{corner}")
        return 0.0 if mass is None else mass * self.corners[corner].centre_accel

    @cached_property
    def equations(self) -> frozenset[Row]:
        """Its rows, and those that its combined rows consist of."""
        parts = (part for row in self.rows if row.combined for part in self.weights(row))
        return frozenset((*self.rows, *parts))

    def weights(self, row: Row) -> dict[Row, Array | float]:
        """Weights of the rows that a combined row consists of: 1, or lengths [m], (N,) or scalar.

        ``heave`` = f_z − Σ suspension, ``roll`` = m_x − Σ y suspension + z̄ f_y and
        ``pitch`` = m_y + Σ x suspension − z̄ f_x, with x, y the wheel's centre and z̄ the mean height of the contact
        patches above the body origin. A vertical force at a wheel cancels; horizontal ones remain with the small lever
        of their own patch to the mean one, and with the slopes of the bench tables. ``corner.{c}`` = suspension −
        tyre × rise of the wheel along the road's normal per travel. Kept, as every effect asks for
        them.
        """
        if row not in self._weights:
            self._weights[row] = self._weights_of(row)
        return self._weights[row]

    def _weights_of(self, row: Row) -> dict[Row, Array | float]:
        if row.kind == "corner":
            own, other = self.corners[row.place], self.corners[other_corner(row.place)]
            upward: dict[Row, Array | float] = {Row(f"tyre.{row.place}"): -own.dp_ds[2] / own.normal[2]}
            if other.other_dp_ds is not None:
                upward[Row(f"tyre.{other_corner(row.place)}")] = -other.other_dp_ds[2] / other.normal[2]
            return {Row(f"suspension.{row.place}"): 1.0, **upward}
        force, moment, axis, sign = _BALANCED[row.place]
        out: dict[Row, Array | float] = {CHASSIS_ROWS[moment]: 1.0}
        if force is not None:
            travel = np.mean([corner.travel for corner in self.corners.values()], axis=0)
            out[CHASSIS_ROWS[force]] = -sign * (self.road_height + travel)
        for suspension in SUSPENSION_ROWS:
            out[suspension] = -1.0 if axis is None else sign * self.corners[suspension.place].centre[axis]
        return out

    def with_body_rows(self, rows: Mapping[Row, Array]) -> dict[Row, Array]:
        """Series (…, N) of rows, and of the combined rows of this motion that they act on.

        The one place where these are made of other rows; a motion without combined rows returns the same series.
        """
        out = dict(rows)
        for row in self.rows:
            if row.combined:
                parts = [weight * rows[part] for part, weight in self.weights(row).items() if part in rows]
                if parts:
                    out[row] = np.sum(parts, axis=0)
        return out


_INERTIAS = {PARAMETERS.index(kind): kind for kind in ("XX", "YY")}
"""Moments of inertia that may be known, by their place among a body's parameters."""
_BALANCED: Mapping[str, tuple[int | None, int, int | None, float]] = {
    # Of a body row: place in `CHASSIS_ROWS` of the horizontal force, and of the row itself; axis of the wheel centres'
    # lever, and its sign.
    "heave": (None, 2, None, 0.0), "roll": (1, 3, 1, -1.0), "pitch": (0, 4, 0, 1.0),
}  # fmt: skip
