"""Loads of the four wheels as a function of the few forces that are unknown, at each instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Corner
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import AXLES
from lacet.identify.multibody.vectors import Array, cross, dot, turned
from lacet.identify.wheel_loads.settings import Assumptions, Tolerance

_AT_FIRST = 5000.0
"""1 σ of the difference of the axles' longitudinal forces before the car's is known [N]: that of hard braking."""
_WEAK = 1e-6
"""Strength that holds every unknown near 0 ÷ that of the axles' difference: a wheel none of whose rows is usable for a
while then follows from the others as far as they go."""

UNKNOWNS = (*(f"z.{c}" for c in CORNERS), *(f"{k}.{axle}" for k in "xy" for axle in AXLES))
"""Unknown forces: vertical at each wheel, longitudinal and lateral of each axle [N]."""


DIFFERENCE = np.array([{"x.front": 1.0, "x.rear": -1.0}.get(name, 0.0) for name in UNKNOWNS])
"""Longitudinal force of the front axle less that of the rear one, in the unknowns."""


@dataclass(frozen=True)
class AxleDifference:
    """What is assumed of the longitudinal force of the front axle less that of the rear one.

    `mean`, `sigma` : (N,) mean and 1 σ [N].
    """

    mean: Array
    sigma: Array

    def off(self, values: Array) -> Array:
        """(N,) difference of the unknowns' values (8, N) less the mean [N]."""
        return DIFFERENCE @ values - self.mean

    def at(self, instants: NDArray[Any], alike: float = 1.0) -> AxleDifference:
        """The same at some of the instants, if what is off stays the same for `alike` of them."""
        return AxleDifference(self.mean[instants], self.sigma[instants] * np.sqrt(alike))

    def equations(self) -> tuple[Array, Array]:
        """(N, unknowns) what one newton of it adds to the normal equations' right side, (N, unknowns, unknowns) to the
        matrix.
        """
        square = np.outer(DIFFERENCE, DIFFERENCE) + _WEAK * np.eye(len(UNKNOWNS))
        weight = self.sigma[:, None] ** -2.0
        return weight * DIFFERENCE, weight[..., None] * square


@dataclass(frozen=True)
class WheelLoad:
    """Force [N] and moment about the wheel centre [N·m] of a wheel in body axes, (3, N) each.

    `brake` : torque of the brake on it that is not measured, positive against rolling forward; (N,) or 0 [N·m].
    """

    force: Array
    moment: Array
    brake: Array | float = 0.0


WheelLoads = Mapping[str, WheelLoad]
"""Loads by corner."""


@dataclass(frozen=True)
class Assumed:
    """A quantity of one place that is assumed: its name, 1 σ, and the loads per unit of it, by corner."""

    name: str
    sigma: float
    loads: WheelLoads


class WheelAxes:
    """Axes of a wheel on the road: z the road's normal, x in the wheel's plane and the road's, y to the left.

    Those of TYDEX (W axes). `arm` is the place of contact from the wheel centre (3, N) [m].
    """

    def __init__(self, wheel: CornerMotion):
        n, self.z = wheel.spin_axis, wheel.normal
        x = cross(n, self.z)
        tilt = np.linalg.norm(x, axis=0)
        self.x = x / tilt
        self.y = cross(self.z, self.x)
        self.down = -(self.z - dot(n, self.z) * n) / tilt
        self.radius = wheel.height / tilt
        self.arm = self.radius * self.down


class TyreContact:
    """Wheel loads as a function of the unknown forces, with assumptions on the contact between tyre and road.

    Parameters
    ----------
    motion : of the run; its loads are not used.
    outboard : corner → mass outboard of the transducer [kg], with ``hub`` loads; empty with ``contact`` loads.
    share : axle → (N,) part of its lateral force that the left wheel has.
    difference : what is assumed of the axles' longitudinal forces.
    """

    def __init__(
        self, motion: Motion, corners: Mapping[str, Corner], assumed: Assumptions, outboard: Mapping[str, float],
        share: Mapping[str, Array] | None = None, difference: AxleDifference | None = None,
    ):  # fmt: skip
        self.motion, self.vehicle, self.assumed, self.outboard = motion, corners, assumed, outboard
        self.axes = {c: WheelAxes(wheel) for c, wheel in motion.corners.items()}
        self.share = share or {axle: np.full(motion.t.size, 0.5) for axle in AXLES}
        at_first = AxleDifference(np.zeros(motion.t.size), np.full(motion.t.size, _AT_FIRST))
        self.difference = at_first if difference is None else difference

    def divided(self, values: Array) -> TyreContact:
        """The same with forces divided as the unknowns suggest, of which `values` (8, N) are known."""
        share: dict[str, Array] = {}
        for axle in AXLES:
            part = self._left_part(values, axle) - 0.5
            share[axle] = 0.5 + part * (1.0 - self.assumed.degression.mean)
        out = TyreContact(self.motion, self.vehicle, self.assumed, self.outboard, share, self._axle_difference(values))
        out.axes = self.axes
        return out

    def _axle_difference(self, values: Array) -> AxleDifference:
        """Driven wheels drive; all brake, in proportion to their loads, as brakes are laid out."""
        along = np.sum([values[UNKNOWNS.index(f"x.{axle}")] for axle in AXLES], axis=0)
        loads = {axle: sum(values[UNKNOWNS.index(f"z.{c}")] for c in wheels) for axle, wheels in AXLES.items()}
        driven = {axle: any(self.vehicle[c].driven for c in wheels) for axle, wheels in AXLES.items()}

        def shared(front: Array | float, rear: Array | float) -> Array:
            total = np.maximum(front + rear, 1.0)
            return np.clip((front - rear) / total, -1.0, 1.0)

        braking = shared(*loads.values())
        driving = shared(*(load * driven[axle] for axle, load in loads.items())) if any(driven.values()) else braking
        size = self.assumed.axles.sigma * np.abs(along) + self.assumed.axles_force.sigma
        return AxleDifference(along * np.where(along > 0.0, driving, braking), size)

    @staticmethod
    def _left_part(values: Array, axle: str) -> Array:
        """(N,) part of an axle's vertical load on its left wheel, between 0 and 1."""
        left, right = (values[UNKNOWNS.index(f"z.{c}")] for c in AXLES[axle])
        total = np.maximum(left + right, 1.0)
        return np.clip(left / total, 0.0, 1.0)

    def load(self, c: str, x: Array | float = 0.0, y: Array | float = 0.0, z: Array | float = 0.0) -> WheelLoad:
        """Load of a wheel with these forces at its contact [N], with trail and rolling resistance; linear in them."""
        axes, mean = self.axes[c], self.assumed
        force = axes.x * x + axes.y * y + axes.z * z
        moment = cross(axes.arm, force) - axes.z * (mean.trail.mean * y)
        moment = moment - axes.y * (mean.rolling.mean * self._rolling[c] * z) + axes.x * (mean.shift.mean * z)
        return WheelLoad(force, moment)

    @cached_property
    def _rolling(self) -> dict[str, Array]:
        """Corner → loaded radius with the sign of the wheel's speed [m]; 0 at rest."""
        return {c: axes.radius * np.tanh(self.motion.corners[c].spin) for c, axes in self.axes.items()}

    def per_unit(self) -> list[WheelLoads]:
        """Loads per newton of each of the unknowns."""
        out: list[WheelLoads] = [{c: self.load(c, z=1.0)} for c in CORNERS]
        out += [{c: self.load(c, x=0.5) for c in wheels} for wheels in AXLES.values()]
        for axle, (left, right) in AXLES.items():
            share = self.share[axle]
            out.append({left: self.load(left, y=share), right: self.load(right, y=1.0 - share)})
        return out

    def constant(self) -> WheelLoads:
        """Loads that do not depend on the unknowns: weight, inertia and gyroscopic moment outboard of a transducer, and
        released brakes that drag.
        """
        zero = np.zeros_like(next(iter(self.axes.values())).z)
        out: dict[str, WheelLoad] = {}
        for c in CORNERS:
            moment = zero
            if mass := self.outboard.get(c, 0.0):
                moment = mass * cross(self.axes[c].arm, self.motion.corners[c].centre_accel)
                moment = moment + self.assumed.spin_inertia.mean * self._spin_moment(c)
            out[c] = WheelLoad(zero, moment, self.assumed.brake_drag.mean * self._drags[c])
        return out

    @cached_property
    def _drags(self) -> dict[str, Array]:
        """Corner → (N,) sign of the torque of a released brake, 0 where a measured torque contains it."""
        out: dict[str, Array] = {}
        for c, wheel in self.motion.corners.items():
            inboard = self.vehicle[c].brakes == "inboard"
            measured = {f"brake.{c}.torque", *([f"shaft.{c}.torque"] if inboard else [])} & self.motion.channels
            out[c] = np.zeros_like(wheel.spin) if measured else np.tanh(wheel.spin)
        return out

    def _spin_moment(self, c: str) -> Array:
        """(3, N) moment of the outboard parts' spin, per unit of their moment of inertia ÷ m R0²."""
        wheel = self.motion.corners[c]
        turning, n = turned(wheel.axes, wheel.axle.omega), wheel.spin_axis
        momentum = self.outboard[c] * self.vehicle[c].tyre_radius ** 2
        return -momentum * (wheel.spin_accel * n + (wheel.spin + dot(turning, n)) * cross(turning, n))

    def loads(self, values: Array) -> WheelLoads:
        """Loads at values (8, N) of the unknowns [N]."""
        out = dict(self.constant())
        for part, value in zip(self.per_unit(), values, strict=True):
            for c, load in part.items():
                force, moment = out[c].force + load.force * value, out[c].moment + load.moment * value
                out[c] = replace(out[c], force=force, moment=moment)
        return out

    def assumptions(self, values: Array, grounds: Sequence[str]) -> list[Assumed]:
        """Everything assumed, at values (8, N) of the unknowns; `grounds` : corners with a measured road."""
        size = self.assumed
        at = dict(zip(UNKNOWNS, values, strict=True))
        out: list[Assumed] = []

        def add(name: str, tolerance: Tolerance, loads: WheelLoads) -> None:
            out.append(Assumed(name, tolerance.sigma, loads))

        resistance = {c: self._resistance(c, at[f"z.{c}"]) for c in CORNERS}
        add("rolling resistance", size.rolling, resistance)
        for axle, (left, right) in AXLES.items():
            x, y = at[f"x.{axle}"], at[f"y.{axle}"]
            part = self._left_part(values, axle) - 0.5
            both = ((left, 1.0), (right, -1.0))
            for name, tolerance, lateral in (
                ("toe", size.toe, np.ones_like(y)), ("division of lateral force", size.proportion, y),
                ("degression", size.degression, -part * y),
            ):  # fmt: skip
                add(f"{name}, {axle}", tolerance, {c: self.load(c, y=sign * lateral) for c, sign in both})
            for name, tolerance, along in (
                ("longitudinal difference", size.longitudinal, x),
                ("longitudinal force difference", size.longitudinal_force, np.ones_like(x)),
            ):
                add(f"{name}, {axle}", tolerance, {c: self.load(c, x=sign * along) for c, sign in both})
            for c, share in ((left, self.share[axle]), (right, 1.0 - self.share[axle])):
                axes, z, lateral = self.axes[c], at[f"z.{c}"], share * y
                none = np.zeros_like(axes.z)
                force = axes.x * (0.5 * x) + axes.y * lateral + axes.z * z
                radius = size.radius if c in grounds else size.radius_unmeasured
                add(f"trail, {c}", size.trail, {c: WheelLoad(none, -axes.z * lateral)})
                add(f"shift of load, {c}", size.shift, {c: WheelLoad(none, axes.x * z)})
                add(f"rolling resistance, {c}", size.rolling_own, {c: resistance[c]})
                add(f"released brake, {c}", size.brake_drag, {c: WheelLoad(none, none, self._drags[c])})
                add(f"loaded radius, {c}", radius, {c: WheelLoad(none, cross(axes.down, force))})
                if self.outboard.get(c):
                    spin = WheelLoad(none, self._spin_moment(c))
                    add(f"spin inertia outboard, {c}", size.spin_inertia, {c: spin})
        return out

    def _resistance(self, c: str, z: Array) -> WheelLoad:
        """Load of a wheel by a rolling resistance of 1 at a vertical force [N]."""
        axes = self.axes[c]
        return WheelLoad(np.zeros_like(axes.z), -axes.y * (self._rolling[c] * z))

    def in_rows(self, loads: WheelLoads, rows: Sequence[Row]) -> Array:
        """(rows, N) left sides that these loads alone make, without torques on the wheels."""
        moved = with_loads(self.motion, loads, torques=False)
        return np.stack([moved.measured(row) for row in rows])


def with_loads(motion: Motion, loads: WheelLoads, torques: bool = True) -> Motion:
    """The motion with these wheel loads, 0 at other corners; with or without the torques on the wheels."""
    corners: dict[str, CornerMotion] = {}
    for c, wheel in motion.corners.items():
        zero = np.zeros_like(wheel.normal)
        load, kept = loads.get(c, WheelLoad(zero, zero)), 1.0 if torques else 0.0
        # Where the half-shaft's torque is eliminated from a suspension row, the brake's stands in its place.
        slope = dot(wheel.spin_axis, wheel.dphi_ds - wheel.wheel_dphi_ds)
        by_other = wheel.other_torque_work
        if by_other is not None and wheel.other_dphi_ds is not None and wheel.other_wheel_dphi_ds is not None:
            other_slope = dot(wheel.spin_axis, wheel.other_dphi_ds - wheel.other_wheel_dphi_ds)
            by_other = kept * by_other + other_slope * load.brake
        corners[c] = replace(
            wheel, force=load.force, moment=load.moment, torque=kept * wheel.torque - load.brake,
            torque_work=kept * wheel.torque_work + slope * load.brake, other_torque_work=by_other,
        )  # fmt: skip
    return replace(motion, corners=corners)
