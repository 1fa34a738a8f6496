"""A body that twists between its axles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array, cross, unit
from lacet.identify.signals.filters import derivative


class ChassisTorsion(PhysicalEffect):
    """Front and rear of the body turn about x against each other, by the torque T that the wheels pass through it.

    T is half the difference of the roll moments of front and rear wheels; resonances lie above 20 Hz, so that the twist
    follows T. Relative to the inertial unit the front turns by p_f T and the rear by −p_r T. Loads at a turned axle are
    F + θ x × F (and M likewise); the twist's acceleration takes a roll moment.
    """

    name = "chassis_torsion"
    about = "body that twists about its long axis between front and rear axle"
    signature = "lateral force and yaw moment follow the difference of roll moments, front and rear, times the load"
    shown_by = "one-sided bumps, kerbs, fast steering with unequal roll stiffness front and rear"
    source = "Deakin et al. (2000), SAE 2000-01-3554; Sampò, Sorniotti and Crocombe (2010), SAE 2010-01-0094"
    rows = ("chassis.fy", "chassis.fz", "chassis.mx", "chassis.my", "chassis.mz")
    instantaneous = False

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant: the car as a whole."""
        return [cls()]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Compliances from the inertial unit to the front and to the rear axle; (p_f I_f − p_r I_r) of the inertia."""
        return (
            self.named("front", "rad/(N·m)", -2e-5, 2e-5, "positive"),
            self.named("rear", "rad/(N·m)", -2e-5, 2e-5, "positive"),
            self.named("inertia", "s²", -0.01, 0.01),
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−θ x × (F, M) of each axle per unit of compliance; d²T/dt² on the roll moment."""
        loads: list[tuple[Array, Array]] = []
        for corners in AXLES.values():
            parts = [motion.corners[c] for c in corners]
            force = np.sum([part.force for part in parts], axis=0)
            loads.append((force, np.sum([part.moment + cross(part.centre, part.force) for part in parts], axis=0)))
        torque = 0.5 * (loads[0][1][0] - loads[1][1][0])
        rate = 1.0 / (motion.t[1] - motion.t[0])
        zero = np.zeros_like(torque)
        turned = [
            [-sign * torque * cross(unit(0), vector) for vector in axle]
            for sign, axle in zip((1.0, -1.0), loads, strict=True)
        ]
        (force_f, moment_f), (force_r, moment_r) = turned
        twisting = derivative(derivative(torque, rate), rate)
        return {
            "chassis.fy": np.stack([force_f[1], force_r[1], zero]),
            "chassis.fz": np.stack([force_f[2], force_r[2], zero]),
            "chassis.mx": np.stack([zero, zero, twisting]),
            "chassis.my": np.stack([moment_f[1], moment_r[1], zero]),
            "chassis.mz": np.stack([moment_f[2], moment_r[2], zero]),
        }
