"""Stops that end the travel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array

_GAPS = (0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06)


class BumpStop(SuspensionForce):
    """A stop touched in compression: F = k max(0, s − gap).

    With a linear spring in the model it is a helper spring that goes solid, of the opposite sign: max(0, s − gap) =
    s − min(s, gap). A stop makes the suspension stiffer beyond the gap: k > 0.
    """

    name = "bump_stop"
    about = "bump stop touched beyond a gap in compression"
    signature = "suspension row bends upwards beyond a travel"
    shown_by = "strong roll, braking, large bumps"
    source = "Reimpell et al. (2001), The Automotive Chassis, chapter 5 (springing)"
    looks_like = ("helper_spring",)
    grids: ClassVar = {"gap": _GAPS}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of the stop k."""
        return (self.named("k", "N/m", 0.0, 5e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """max(0, s − gap)."""
        return np.maximum(0.0, travel - self.shape.get("gap", 0.03))


class ReboundStop(SuspensionForce):
    """A stop touched in extension: F = −k max(0, −s − gap).

    Beside a static load it is a helper spring that goes solid at −gap: min(s, −gap) + gap = −max(0, −s − gap).
    """

    name = "rebound_stop"
    about = "rebound stop touched beyond a gap in extension"
    signature = "suspension row bends downwards beyond a travel"
    shown_by = "strong roll, crests"
    source = "Reimpell et al. (2001), The Automotive Chassis, chapter 5 (springing)"
    looks_like = ("helper_spring",)
    grids: ClassVar = {"gap": _GAPS}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of the stop k."""
        return (self.named("k", "N/m", 0.0, 5e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """−max(0, −s − gap)."""
        return -np.maximum(0.0, -travel - self.shape.get("gap", 0.03))
