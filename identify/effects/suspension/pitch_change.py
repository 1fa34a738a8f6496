"""Wheel carriers that pitch with the travel otherwise than the bench table says: an error of its pitch slope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Course, Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect, sum_by_row
from lacet.identify.effects.suspension.pitched_carrier import pitched_loads, spun_wheel
from lacet.identify.multibody.vectors import Array


class PitchChange(PhysicalEffect):
    """The carriers of an axle pitch by p s more than the bench table says, nose down.

    What brakes on the carrier take does work on that, and loads measured in the carrier's axes turn with them, in all
    rows. The wheel, whose speed is measured against the carrier, then turns faster by p ds/dt: its inertia J about its
    axis is in a column of its own, as p J. The carrier's inertia is neglected: it acts as an unsprung mass.
    """

    name = "pitch_change"
    about = "carriers that pitch with travel more than the bench table says (spin angle, caster)"
    signature = (
        "chassis.fx follows the travel × the load of an axle, suspension rows the torque of its brakes, spin rows the "
        "acceleration of the travel"
    )
    shown_by = "bumps and roll, braking"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.10 (anti-dive, caster angle by travel)"
    rows = ("tyre", "suspension", "chassis", "spin")
    looks_like = ("anti_dive",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the slope p, 2.5 rad per metre of trailing arms of 0.4 m; p J, with J of 1.5 kg·m² at most."""
        return self.named("p", "rad/m", -3.0, 3.0), self.named("pJ", "kg·m", -4.5, 4.5)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−p s n × F and −p s n × M wherever the loads act, −p M_n in the suspensions; p J d(n ds/dt)/dt."""
        return sum_by_row(self.moved(motion, c, c, 1.0, motion.corners[c].travelled) for c in self.corners())

    def moved(self, motion: Motion, corner: str, by: str, slope: Array | float, shift: Course) -> dict[str, Array]:
        """Columns of one wheel whose carrier pitches by `shift`, `slope` of it by the travel of `by`."""
        wheel = motion.corners[corner]
        loads = sum_by_row(
            [{f"suspension.{by}": -(slope * wheel.torque_on_carrier)[None]}, pitched_loads(motion, corner, shift[0])]
        )
        turns = wheel.wheel_on_carrier * (slope * wheel.wheel.omega_dot[2])
        inertia = sum_by_row([{f"suspension.{by}": turns[None]}, spun_wheel(motion, corner, shift)])
        zero = np.zeros((1, motion.t.size))
        return {row: np.concatenate([loads.get(row, zero), inertia.get(row, zero)]) for row in loads | inertia}
