"""A damper on an elastic mount."""

from __future__ import annotations

from typing import ClassVar

from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter
from lacet.identify.effects.memory import first_order_lag
from lacet.identify.effects.suspension.with_memory import SuspensionForceWithMemory
from lacet.identify.multibody.vectors import Array


class DamperMount(SuspensionForceWithMemory):
    """A damper in series with a spring: of its force c·ṡ only c·y comes, with T·ẏ + y = ṡ and T = c / stiffness.

    F = c (y − ṡ) beside the base model's damper, which so stays the whole damping at low frequency. A smaller c is a
    part of the damper, or a rubber bush (Maxwell's element). The mount's stiffness is c / T: 100 to 500 N/mm at a top
    mount, T 2 to 20 ms.
    """

    name = "damper_mount"
    about = "damper on an elastic mount, or a bush that stiffens with frequency"
    signature = "suspension row lacks damping, and has stiffness instead, above a frequency"
    shown_by = "rough road: travel rates at low and at high frequency"
    source = "Maxwell (1867), Phil. Trans. R. Soc. 157, 49; Dixon (2007), The Shock Absorber Handbook, chapter 3"
    grids: ClassVar = {"T": (0.005, 0.02, 0.08, 0.3)}
    grid_units: ClassVar = {"T": "s"}
    bounds: ClassVar = {"T": (0.002, 1.0)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping c on the mount."""
        return (self.named("c", "N·s/m", 0.0, 1e4, "positive"),)

    def course(self, corner: CornerMotion, step: float) -> Array:
        """Travel rate behind the mount less that of the wheel, y − ṡ [m/s]."""
        return first_order_lag(corner.rate, self.shape.get("T", 0.02), step) - corner.rate
