"""Wheel moment of the forces in the contact patch, where a hub measures forces alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner
from lacet.identify.car.car_tree import orientation
from lacet.identify.car.sources.wheel_force import corner_motion
from lacet.identify.multibody.vectors import Array, turn
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series

LEAST_LOAD = 100.0
"""Load below which the trail is taken as at this load [N]."""


@dataclass(frozen=True)
class Outboard:
    """Mass and spin inertia outside the transducer, for hub loads."""

    mass: Assumption
    spin: Assumption


@dataclass(frozen=True)
class ContactMoment(Law[Signals]):
    """Moment about the wheel centre of the forces that act in the contact patch.

    In carrier axes the patch lies at (f r, κ F_y, −r), and the lateral force a pneumatic trail t behind it: r the
    loaded radius, f the rolling resistance, κ the lateral shift per force. M = patch × F, M_z − t F_y. The trail falls
    from t₀ as the brush model's, t ÷ t₀ = 3 w³ ÷ (1 + w + w²), w³ = 1 − |F_y| ÷ (μ F_z). With hub loads F is that of
    the hub and of the outboard mass, and the outboard wheel's gyroscopic moment is taken off. Pitch of the carrier is
    neglected. Source: Pacejka, Tire and Vehicle Dynamics, sections 3.2 and 4.3.
    """

    corner: Corner
    rig: Rig
    radius: Assumption
    trail: Assumption
    friction: Assumption
    rolling: Assumption
    shift: Assumption
    outboard: Outboard | None

    @property
    def channel(self) -> str:
        """The wheel moment."""
        return f"wheel.{self.corner.name}.moment"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Radius, trail and friction, rolling resistance, lateral shift, outboard mass and spin inertia."""
        outside = (self.outboard.mass, self.outboard.spin) if self.outboard else ()
        return (self.radius, self.trail, self.friction, self.rolling, self.shift, *outside)

    def series(self, signals: Signals) -> Series:
        """The moment."""
        c = self.corner.name
        force = signals.value[f"wheel.{c}.force"]
        n = force.shape[1]
        steer = signals.value[f"camera.{c}.steer"][0]
        force = self._carrier(force, f"wheel.{c}.force", steer)
        r, t, friction, f, shift = (
            signals.assumed[one.name][0] for one in (self.radius, self.trail, self.friction, self.rolling, self.shift)
        )
        gyro = np.zeros((3, n))
        if self.outboard is not None:
            body, accel = corner_motion(self.corner, signals, self.rig, n)
            force = force + signals.assumed[self.outboard.mass.name][0] * turn(2, -steer, accel)
            omega = turn(2, -steer, body.omega)
            spin, spin_accel, _ = signals.scalar(f"wheel.{c}.speed", n)
            gyro = signals.assumed[self.outboard.spin.name][0] * np.stack(
                [-omega[2] * spin, spin_accel, omega[0] * spin]
            )
        x, y, z = force
        used = np.abs(y) / (friction * np.maximum(z, LEAST_LOAD))
        w = np.cbrt(np.clip(1.0 - used, 0.0, 1.0))
        t = t * 3.0 * w**3 / (1.0 + w + w**2)
        ahead, aside = f * r, shift * y
        moment = np.stack([aside * z + r * y, -r * x - ahead * z, ahead * y - aside * x - t * y]) - gyro
        moment = self._as_declared(moment, steer)
        return Series(moment, np.zeros_like(moment), np.zeros_like(moment))

    def _carrier(self, force: Array, channel: str, steer: Array) -> Array:
        """A force in carrier axes, from the axes that the rig declares."""
        sensor = self.rig.sensor_of(channel)
        if sensor is not None and sensor.axes == "body":
            return turn(2, -steer, force)
        return orientation(sensor.orientation) @ force if sensor is not None and sensor.axes == "sensor" else force

    def _as_declared(self, moment: Array, steer: Array) -> Array:
        """The moment in the axes that the rig declares for it."""
        sensor = self.rig.sensor_of(self.channel)
        if sensor is not None and sensor.axes == "body":
            return turn(2, steer, moment)
        return orientation(sensor.orientation).T @ moment if sensor is not None and sensor.axes == "sensor" else moment
