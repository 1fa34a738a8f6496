"""Helper springs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class HelperSpring(SuspensionForce):
    """A helper spring that goes solid beyond a gap: F = k min(s, gap).

    Beside a linear spring it is a linear bump stop of the opposite sign: min(s, gap) = s − max(0, s − gap); softer
    beyond the gap for k > 0. With a negative gap it is a linear rebound stop at −gap and a static load.
    """

    name = "helper_spring"
    about = "helper spring that goes solid beyond a gap"
    signature = "suspension row is steeper below a travel than above it"
    shown_by = "strong roll, crests, large bumps"
    source = "Milliken and Milliken (1995), Race Car Vehicle Dynamics, chapter 16; Reimpell et al. (2001), chapter 5"
    bend = Bend.TRAVEL
    looks_like = ("bump_stop", "rebound_stop")
    grids: ClassVar = {"gap": (-0.04, -0.02, -0.01, 0.0, 0.01, 0.02, 0.04)}
    grid_units: ClassVar = {"gap": "m"}
    bounds: ClassVar = {"gap": (-0.08, 0.08)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Rate k."""
        return (self.named("k", "N/m", 0.0, 2e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """min(s, gap)."""
        return np.minimum(travel, self.shape.get("gap", 0.01))
