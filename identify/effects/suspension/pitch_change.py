"""Wheel carriers that pitch with the travel otherwise than the bench table says: an error of its pitch slope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect, sum_by_row
from lacet.identify.effects.suspension.pitched_carrier import pitched_loads
from lacet.identify.multibody.vectors import Array


class PitchChange(PhysicalEffect):
    """The carriers of an axle pitch by p s more than the bench table says, nose down.

    What brakes on the carrier take does work on that, and loads measured in the carrier's axes turn with them, in all
    rows. The inertia is neglected: that of the carrier acts as an unsprung mass, and of the wheel, whose speed is
    measured against the carrier, a part is missing in its spin row.
    """

    name = "pitch_change"
    about = "carriers that pitch with travel more than the bench table says (spin angle, caster)"
    signature = "chassis.fx follows the travel × the load of an axle; suspension rows follow the torque of its brakes"
    shown_by = "bumps and roll, braking"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.10 (anti-dive, caster angle by travel)"
    rows = ("tyre", "suspension", "chassis")
    looks_like = ("anti_dive",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the slope p; trailing arms of 0.4 m pitch 2.5 rad per metre."""
        return (self.named("p", "rad/m", -3.0, 3.0),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−p s n × F and −p s n × M wherever the loads act, −p M_n in the suspensions."""
        return sum_by_row(self.moved(motion, c, c, 1.0, motion.corners[c].travel) for c in self.corners())

    def moved(self, motion: Motion, corner: str, by: str, slope: Array | float, shift: Array) -> dict[str, Array]:
        """Columns of one wheel whose carrier pitches by `shift` (N,), `slope` of it by the travel of `by`."""
        work = {f"suspension.{by}": -(slope * motion.corners[corner].torque_on_carrier)[None]}
        return sum_by_row([work, pitched_loads(motion, corner, shift)])
