"""Suspension travel where no laser measures it, by a potentiometer on the damper or from the wheel's load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner
from lacet.identify.car.sources.wheel_force import GRAVITY, corner_motion
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Conditional, Law, Series


@dataclass(frozen=True)
class LoadTravel(Law[Signals]):
    """Travel s = s₀ + d (F_z ÷ F̄_z − 1), d the static deflection; s̈ = −γ (a_z − g), what a wheel on its road does.

    It places the wheel centre in the moments about the body's origin and moves the unsprung mass; it can say nothing
    of the suspension that it assumes. `mean` : F̄_z, the run's mean load [N]; `design` : reading of the hub laser at
    design height [m]; `follows` : γ, whose tolerance is that of `UnsprungForce`.
    """

    corner: Corner
    rig: Rig
    mean: float
    design: float
    deflection: Assumption
    start: Assumption
    follows: float

    @property
    def channel(self) -> str:
        """The hub laser."""
        return f"laser.{self.corner.name}.hub"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Static deflection and travel at the mean load."""
        return (self.deflection, self.start)

    def series(self, signals: Signals) -> Series:
        """The hub laser's reading and its acceleration; its rate is neglected."""
        load = signals.value[f"wheel.{self.corner.name}.force"][2]
        deflection, start = (signals.assumed[one.name][0] for one in self.assumptions)
        travel = start + deflection * (load / self.mean - 1.0)
        _, accel = corner_motion(self.corner, signals, self.rig, load.size)
        up = self.follows * (accel[2] - GRAVITY)
        return Series((self.design - travel)[None], np.zeros((1, load.size)), up[None])


@dataclass(frozen=True)
class UnsprungForce(Law[Signals]):
    """Wheel force, moved by what the unsprung mass' own acceleration may be off where no travel is measured.

    m ((γ − γ₀) (a_z − g) + κ (a_z,other − g)) along z with m a nominal unsprung `mass` [kg] and a_z,other the body's
    specific force at the other axle, whose road this wheel meets as well. At the nominal values it is the measured
    force: with a nominal mass the response does not hang on masses that such a rig hardly identifies.
    """

    corner: Corner
    other: Corner
    rig: Rig
    mass: float
    own: Assumption
    far: Assumption

    @property
    def channel(self) -> str:
        """The wheel force."""
        return f"wheel.{self.corner.name}.force"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Parts of the body's acceleration, here and at the other axle."""
        return (self.own, self.far)

    def series(self, signals: Signals) -> Series:
        """The force."""
        force = signals.value[self.channel]
        own, far = (signals.assumed[one.name][0] - one.value for one in self.assumptions)
        _, here = corner_motion(self.corner, signals, self.rig, force.shape[1])
        _, there = corner_motion(self.other, signals, self.rig, force.shape[1])
        up = self.mass * (own * (here[2] - GRAVITY) + far * (there[2] - GRAVITY))
        moved = np.stack([force[0], force[1], force[2] + up])
        return Series(moved, np.zeros_like(moved), np.zeros_like(moved))


@dataclass(frozen=True)
class DamperTravel(Law[Signals]):
    """Travel by a potentiometer on the damper: its reading ÷ the motion ratio. `design` as in `LoadTravel`."""

    corner: Corner
    design: float
    ratio: Assumption

    @property
    def channel(self) -> str:
        """The hub laser."""
        return f"laser.{self.corner.name}.hub"

    @property
    def damper(self) -> str:
        """The potentiometer."""
        return f"damper.{self.corner.name}.travel"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The motion ratio."""
        return (self.ratio,)

    def series(self, signals: Signals) -> Series:
        """The hub laser's reading and its derivatives."""
        ratio = signals.assumed[self.ratio.name]
        value, rate, accel = (part[self.damper] for part in (signals.value, signals.rate, signals.accel))
        return Series(self.design - value / ratio, -rate / ratio, -accel / ratio)

    def conditional(self, signals: Signals) -> Conditional | None:
        """The same of the potentiometer's."""
        if self.damper not in signals.mean:
            return None
        ratio, size = signals.assumed[self.ratio.name], abs(self.ratio.value)
        return Conditional(
            self.design - signals.mean[self.damper] / ratio, -signals.mean_rate[self.damper] / ratio,
            signals.sigma[self.damper] / size, signals.rate_sigma[self.damper] / size,
            signals.rate_rms[self.damper] / size,
        )  # fmt: skip
