"""Stops that end the travel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array

PRESSED = 0.01
"""Compression of a stop at which k is its secant stiffness [m]."""


class _Stop(SuspensionForce):
    """A stop touched beyond a gap, pressed by x: the force k x (x/10 mm)^(n − 1)."""

    source = "Reimpell et al. (2001), The Automotive Chassis, chapter 5; Heißing and Ersoy (2011), Chassis Handbook"
    bend = Bend.TRAVEL
    looks_like = ("helper_spring",)
    grids: ClassVar = {"gap": (0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06), "n": (1.0, 2.0)}
    grid_units: ClassVar = {"gap": "m", "n": ""}
    bounds: ClassVar = {"gap": (0.0, 0.08), "n": (1.0, 3.0)}
    simplest: ClassVar = {"n": 1.0}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of the stop k, the secant's from the gap to 10 mm beyond it."""
        return (self.named("k", "N/m", 0.0, 5e5, "positive"),)

    def pressed(self, beyond: Array) -> Array:
        """(N,) x (x/10 mm)^(n − 1) [m] of a stop pressed by x = max(0, `beyond`) [m]."""
        return PRESSED * (np.maximum(0.0, beyond) / PRESSED) ** self.shape.get("n", 1.0)


class BumpStop(_Stop):
    """A stop touched in compression: F = k x (x/10 mm)^(n − 1), x = max(0, s − gap).

    n is 1 for a second spring or a linear stop, 2 or 3 for rubber and foam; k is the secant stiffness 10 mm beyond the
    gap, in N/m for any n.

    Beside a linear spring, n = 1 is a ``helper_spring`` of the opposite sign; stiffer beyond the gap for k > 0.
    """

    name = "bump_stop"
    about = "bump stop (or second spring) touched beyond a gap in compression, linear or progressive"
    signature = "suspension row bends upwards beyond a travel"
    shown_by = "strong roll, braking, large bumps"

    def law(self, travel: Array, rate: Array) -> Array:
        """x (x/10 mm)^(n − 1), x = max(0, s − gap)."""
        return self.pressed(travel - self.shape.get("gap", 0.03))


class ReboundStop(_Stop):
    """A stop touched in extension: F = −k x (x/10 mm)^(n − 1), x = max(0, −s − gap).

    n and k as of ``bump_stop``.

    Beside a static load, n = 1 is a ``helper_spring`` that goes solid at −gap.
    """

    name = "rebound_stop"
    about = "rebound stop touched beyond a gap in extension, linear or progressive"
    signature = "suspension row bends downwards beyond a travel"
    shown_by = "strong roll, crests"

    def law(self, travel: Array, rate: Array) -> Array:
        """−x (x/10 mm)^(n − 1), x = max(0, −s − gap)."""
        return -self.pressed(-travel - self.shape.get("gap", 0.03))
