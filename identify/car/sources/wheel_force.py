"""Wheel forces from one measured component: a vertical load cell, a corner scale or a pushrod with a force gauge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner
from lacet.identify.car.body_motion import body_attitude, body_motion, vertical
from lacet.identify.car.car_tree import kinematics
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.vectors import Array, cross, dot
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""


def corner_motion(corner: Corner, signals: Signals, rig: Rig, n: int) -> tuple[FrameMotion, Array]:
    """Motion of the body's origin, and the body's specific force at a wheel centre's design position (3, N)."""
    body = body_motion(signals, rig, n)
    p = np.asarray(corner.position)[:, None]
    return body, body.accel + cross(body.omega_dot, p) + cross(body.omega, cross(body.omega, p))


def shares(signals: Signals, lateral: Assumption, longitudinal: Assumption, load: Array, accel: Array) -> Array:
    """(3, N) force of a wheel whose horizontal parts are in proportion to its load and to the acceleration in g."""
    x = signals.assumed[longitudinal.name][0] * load * accel[0] / GRAVITY
    y = signals.assumed[lateral.name][0] * load * accel[1] / GRAVITY
    return np.stack([x, y, load])


def inboard_mass(signals: Signals, unsprung: Assumption, outboard: Assumption | None) -> Array:
    """(N,) what is unsprung inboard of the point that wheel loads belong to [kg]; `outboard` of hub loads only."""
    mass = signals.assumed[unsprung.name][0]
    return mass if outboard is None else mass - signals.assumed[outboard.name][0]


@dataclass(frozen=True)
class WheelForceLaw(Law[Signals]):
    """Force of the wheel of a corner from what is measured in place of it."""

    corner: Corner

    @property
    def channel(self) -> str:
        """The wheel force."""
        return f"wheel.{self.corner.name}.force"


@dataclass(frozen=True)
class LoadCell(WheelForceLaw):
    """Wheel force from a vertical load in carrier axes, by a load cell; `load` : its channel."""

    load: str
    rig: Rig
    lateral: Assumption
    longitudinal: Assumption

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Shares of the horizontal forces."""
        return self.lateral, self.longitudinal

    def series(self, signals: Signals) -> Series:
        """The force."""
        load = signals.value[self.load][0]
        _, accel = corner_motion(self.corner, signals, self.rig, load.size)
        force = shares(signals, self.lateral, self.longitudinal, load, accel)
        return Series(force, np.zeros_like(force), np.zeros_like(force))


@dataclass(frozen=True)
class Scale(WheelForceLaw):
    """Wheel force from a corner scale, or the load cell of a post, under the tyre: in body axes (3, N).

    It measures along the vertical, which leans in the body's axes as the body rolls and pitches, and in the carrier's
    with the camber, too. Horizontal parts are in proportion to the body's horizontal acceleration. `weight` : mass
    between the scale and the point that the wheel forces belong to.
    """

    rig: Rig
    lateral: Assumption
    longitudinal: Assumption
    weight: Assumption | None = None

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Shares of the horizontal forces, and the mass in between."""
        return (self.lateral, self.longitudinal, *((self.weight,) if self.weight else ()))

    def series(self, signals: Signals) -> Series:
        """The force."""
        load = signals.value[f"scale.{self.corner.name}.load"][0]
        if self.weight is not None:
            load = load - signals.assumed[self.weight.name][0] * GRAVITY
        _, accel = corner_motion(self.corner, signals, self.rig, load.size)
        up = vertical(body_attitude(signals.value, self.rig), load.size)
        level = accel - up * dot(accel, up)
        force = shares(signals, self.lateral, self.longitudinal, load, level)
        force[2] = 0.0
        force = force + up * load
        return Series(force, np.zeros_like(force), np.zeros_like(force))


@dataclass(frozen=True)
class Pushrod(WheelForceLaw):
    """Wheel force from a pushrod with a force gauge: its force × ratio, and the unsprung mass that it does not carry.

    ratio · P = F·∂p/∂s − inertia along s, of all that is between tyre (or transducer) and pushrod, as one mass at the
    wheel centre. The travel's acceleration is that of the measured travel, else a part of the body's. `design` :
    reading of the hub laser at design height [m].
    """

    rig: Rig
    design: float
    ratio: Assumption
    unsprung: Assumption
    outboard: Assumption | None
    follows: Assumption
    lateral: Assumption
    longitudinal: Assumption

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Ratio, masses, travel's part of the acceleration, shares of the horizontal forces."""
        return tuple(
            one
            for one in (self.ratio, self.unsprung, self.outboard, self.follows, self.lateral, self.longitudinal)
            if one is not None
        )

    def series(self, signals: Signals) -> Series:
        """The force."""
        c = self.corner.name
        rod = signals.assumed[self.ratio.name][0] * signals.value[f"pushrod.{c}.force"][0]
        _, accel = corner_motion(self.corner, signals, self.rig, rod.size)
        mass = inboard_mass(signals, self.unsprung, self.outboard)
        hub = signals.accel.get(f"laser.{c}.hub")
        if hub is None:
            up = accel[2] - signals.assumed[self.follows.name][0] * (accel[2] - GRAVITY)
            slope = np.zeros((2, rod.size))
        else:
            up = accel[2] - hub[0]
            # The table of the joints: y to the left, x forward.
            travel = self.design - signals.value[f"laser.{c}.hub"][0]
            slope = kinematics(self.corner, travel, other=0.0).slope[:2]
        load = rod + mass * up
        force = shares(signals, self.lateral, self.longitudinal, load, accel)
        force[2] = load - force[0] * slope[1] - force[1] * slope[0]
        return Series(force, np.zeros_like(force), np.zeros_like(force))
