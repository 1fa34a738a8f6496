"""The rigid bodies of the car: chassis, axles, wheels."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from lacet.daq.channels import other_corner
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.car_tree import AXLE, CHASSIS, WHEEL, car_chain
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.rigid_body import PARAMETERS, UNITS, wrench, wrench_regressor
from lacet.identify.multibody.vectors import Array, cross, dot, turned

# Largest plausible values: a loaded light truck's chassis; an axle (hub, brake, knuckle, share of the arms) of at most
# 100 kg within 0.2 m of its wheel centre; a wheel of at most 60 kg and 0.4 m.
_LARGEST = {
    "chassis": {"kg": 1e4, "kg·m": 2e4, "kg·m²": 5e4},
    "axle": {"kg": 100.0, "kg·m": 5.0, "kg·m²": 3.0},
    "wheel": {"kg": 60.0, "kg·m": 5.0, "kg·m²": 4.0},
}


class RigidBody(PhysicalEffect):
    """Inertia of one body (Newton and Euler, through the modified DH chain).

    The chassis is given in body axes; axles in carrier axes (x forward, y left, z up) about their wheel centre: the
    paper's C11 … C38, whose inertia turns with the carrier, its pitch included; wheels in their joint frame, whose z is
    the spin axis (ZZ14), as bodies of revolution.
    """

    name = "body"
    rows = ("chassis", "suspension", "spin")
    about = "inertia of a rigid body: mass, first moments, inertia tensor"
    signature = "every chassis row follows acceleration and angular acceleration"
    shown_by = "sinus steering for yaw and roll, braking or bumps for pitch"
    parameters_shown_by: ClassVar = {
        "XX6": "sinus steering (roll)",
        "YY6": "braking, a sudden lift-off or bumps (pitch)",
        "ZZ6": "sinus steering (yaw)",
        "XZ6": "sinus steering or sweep (roll and yaw)",
        "MX6": "bumps or a sudden lift-off (heave and pitch)",
        "MZ6": "braking, a sudden lift-off or bumps (pitch), or sinus steering (roll)",
        "M6": "bumps (heave)",
    }
    source = "Khalil and Dombre (2002), chapter 9; Venture et al. (2003)"
    base = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Chassis, four axles, four wheels."""
        corners = tuple(vehicle.corners)
        return [cls("chassis"), *(cls(f"axle.{c}") for c in corners), *(cls(f"wheel.{c}") for c in corners)]

    @property
    def number(self) -> int:
        """The body's number in the paper."""
        kind, _, corner = self.where.partition(".")
        return CHASSIS if kind == "chassis" else (AXLE if kind == "axle" else WHEEL)[corner]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """``XX6 … M6`` and so on."""
        names = zip(PARAMETERS, UNITS, strict=True)
        if self.where.startswith("wheel"):  # a balanced body of revolution
            names = (("ZZ", "kg·m²"), ("XX", "kg·m²"), ("MZ", "kg·m"), ("M", "kg"))
        largest = _LARGEST[self.where.partition(".")[0]]
        twin = self._twin()
        return tuple(
            Parameter(f"{n}{self.number}", u, -largest[u], largest[u], twin=twin if n == "M" else "", twin_sigma=2.0)
            for n, u in names
        )

    def _twin(self) -> str:
        """Mass of the opposite axle body, stated on the left: hub, brake and knuckle are the same parts, to 2 kg."""
        kind, _, corner = self.where.partition(".")
        return f"M{AXLE[corner[0] + 'r']}" if kind == "axle" and corner.endswith("l") else ""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """Chassis rows, and for axles and wheels the suspension and spin rows they act on."""
        if self.where == "chassis":
            body = motion.body
            table = wrench_regressor(body.omega, body.omega_dot, body.accel)
            if self._known(motion):
                table[:, 9] = 0.0
            return {row: table[k] for k, row in enumerate(_CHASSIS)}
        corner = motion.corners[self.where.partition(".")[2]]
        table = wrench_regressor(*_vectors(self._frame(corner)))
        if self._known(motion):
            table[:, 9] = 0.0
        if self.where.startswith("wheel"):  # fold the ten into the four of a body of revolution
            table = np.stack([table[:, 5], table[:, 0] + table[:, 3], table[:, 8], table[:, 9]], axis=1)
        # The inertia tensor's columns come first and have no force.
        return self._rows(corner, table[:3, 2 if self.where.startswith("wheel") else 6 :], table[3:])

    def force(self, motion: Motion, values: Array) -> dict[str, Array]:
        """By Newton and Euler directly, without the regressor."""
        if self._known(motion):
            values = np.array([*values[:-1], 0.0])
        if self.where == "chassis":
            force, moment = wrench(*_vectors(motion.body), values)
            return {row: (*force, *moment)[k] for k, row in enumerate(_CHASSIS)}
        corner = motion.corners[self.where.partition(".")[2]]
        if self.where.startswith("wheel"):
            zz, xx, mz, m = values
            values = np.array([xx, 0, 0, xx, 0, zz, 0, 0, mz, m])
        force, moment = wrench(*_vectors(self._frame(corner)), values)
        return {row: series[0] for row, series in self._rows(corner, force[:, None], moment[:, None]).items()}

    def _known(self, motion: Motion) -> bool:
        """Whether the motion knows the body's mass, whose inertia is then on the left side; a wheel's is its axle's."""
        return self.where.replace("wheel", "axle") in motion.masses

    def _frame(self, corner: CornerMotion) -> FrameMotion:
        return corner.wheel if self.where.startswith("wheel") else corner.axle

    def _rows(self, corner: CornerMotion, force: Array, moment: Array) -> dict[str, Array]:
        """Rows that wrenches about the wheel centre act on: row → (p, N).

        `moment` (3, p, N) and `force` (3, f, N) in the body's frame; the first p − f wrenches have no force.
        """
        name = self.where.partition(".")[2]
        spin, dphi_ds, other_dphi_ds = None, corner.dphi_ds, corner.other_dphi_ds
        if self.where.startswith("wheel"):
            to_carrier = car_chain().to_body[self.number - 1]
            force, moment = np.tensordot(to_carrier, force, 1), np.tensordot(to_carrier, moment, 1)
            spin, dphi_ds, other_dphi_ds = moment[1], corner.wheel_dphi_ds, corner.other_wheel_dphi_ds
        force, moment = turned(corner.axes, force), turned(corner.axes, moment)
        first = moment.shape[1] - force.shape[1]

        def work(dp_ds: Array, dphi_ds: Array) -> Array:
            out = dot(moment, dphi_ds[:, None])
            out[first:] += dot(force, dp_ds[:, None])
            return out

        out = {f"suspension.{name}": work(corner.dp_ds, dphi_ds)}
        if corner.other_dp_ds is not None and other_dphi_ds is not None:
            out[f"suspension.{other_corner(name)}"] = work(corner.other_dp_ds, other_dphi_ds)
        moment[:, first:] += cross(corner.centre[:, None], force)  # from here on about the body origin
        force = np.concatenate([np.zeros((3, first, force.shape[2])), force], axis=1)
        out = {**dict(zip(_CHASSIS, (*force, *moment), strict=True)), **out}
        if spin is not None:
            out[f"spin.{name}"] = spin
        return out


_CHASSIS = ("chassis.fx", "chassis.fy", "chassis.fz", "chassis.mx", "chassis.my", "chassis.mz")


def _vectors(frame: FrameMotion) -> tuple[Array, Array, Array]:
    return frame.omega, frame.omega_dot, frame.accel
