"""Springs whose rate changes with travel."""

from __future__ import annotations

from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class SpringQuadratic(SuspensionForce):
    """Progressive in one direction: F = k2 s²."""

    name = "spring_quadratic"
    about = "spring rate that grows with compression"
    signature = "suspension row follows the square of travel"
    shown_by = "strong roll, large bumps"
    source = "Reimpell et al. (2001), The Automotive Chassis, chapter 5 (springing)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Quadratic rate k2."""
        return (self.named("k2", "N/m²", -1e6, 1e6),)

    def law(self, travel: Array, rate: Array) -> Array:
        """s²."""
        return travel**2


class SpringCubic(SuspensionForce):
    """Progressive in both directions: F = k3 s³."""

    name = "spring_cubic"
    about = "spring rate that grows with travel both ways"
    signature = "suspension row follows the cube of travel"
    shown_by = "strong roll, large bumps"
    source = "Reimpell et al. (2001), The Automotive Chassis, chapter 5 (springing)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Cubic rate k3."""
        return (self.named("k3", "N/m³", -3e7, 3e7),)

    def law(self, travel: Array, rate: Array) -> Array:
        """s³."""
        return travel**3
