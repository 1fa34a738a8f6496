"""An engine that moves on its mounts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.recursion import recursion


class EngineMount(PhysicalEffect):
    """A mass of the chassis on vertical springs and dampers: its acceleration differs from that of the body under it.

    The body there has the specific force a = a_z + ω̇_x y − ω̇_y x, the mass H a with H = (2ζω0 p + ω0²) / (p² + 2ζω0 p +
    ω0²) (p = d/dt), so that the wheels carry m (H − 1) a beyond the rigid car. H is one for what is constant: weight
    does not enter. The mass is taken on the middle plane, and slow against its own inertia in pitch.
    """

    name = "engine_mount"
    about = "engine (or another mass) that moves on its mounts"
    signature = "vertical force and pitch moment follow the vertical acceleration near a resonance of 7 to 15 Hz"
    shown_by = "rough road, kerbs"
    source = "Yu, Naganathan and Dukkipati (2001), Mechanism and Machine Theory 36, 123; Genta and Morello (2009)"
    rows = ("chassis.fz", "chassis.my")
    instantaneous = False
    grids: ClassVar = {"frequency": (7.0, 9.0, 11.0, 14.0), "damping": (0.08,)}
    grid_units: ClassVar = {"frequency": "Hz", "damping": ""}
    bounds: ClassVar = {"frequency": (5.0, 18.0), "damping": (0.03, 0.3)}

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant: the car as a whole."""
        return [cls()]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass m, and m x, m x² for its place ahead of the body origin."""
        return (
            self.named("m", "kg", -600.0, 600.0, "positive"),
            self.named("mx", "kg·m", -1500.0, 1500.0),
            self.named("mxx", "kg·m²", -4000.0, 4000.0, "positive"),
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """(H − 1) of the vertical and the pitch acceleration."""
        rate = 1.0 / (motion.t[1] - motion.t[0])
        omega, zeta = 2.0 * np.pi * self.shape.get("frequency", 9.0), self.shape.get("damping", 0.08)
        # Stretched before the bilinear transform, so that the resonance stands where it is said to be.
        omega = 2.0 * rate * np.tan(omega / (2.0 * rate))
        # −p²/(p² + 2ζω0 p + ω0²) with p = 2 rate (1 − z⁻¹)/(1 + z⁻¹).
        k, damped = 2.0 * rate, 4.0 * zeta * omega * rate
        a = (k * k + damped + omega**2, 2.0 * (omega**2 - k * k), k * k - damped + omega**2)
        felt = np.stack([motion.body.accel[2], motion.body.omega_dot[1]])
        # Nothing of what is constant passes: from its first value on the series begins at rest.
        lifted, pitched = recursion((-k * k, 2.0 * k * k, -k * k), a, felt - felt[:, :1])
        zero = np.zeros_like(lifted)
        return {"chassis.fz": np.stack([lifted, -pitched, zero]), "chassis.my": np.stack([zero, -lifted, pitched])}
