"""What a suspension does beyond a linear spring and damper."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from identify.effect import Parameter, SuspensionForce
from identify.vectors import Array


class Coulomb(SuspensionForce):
    """Coulomb friction with a stick band: F = f tanh(ṡ/v0)."""

    name = "coulomb"
    about = "dry friction in the dampers and joints"
    signature = "suspension row changes sign with the travel rate, whatever its size"
    shown_by = "smooth driving with small travel rates, slow sinus steering"
    source = "paper, table 6 (fs); Armstrong-Hélouvry et al. (1994)"
    # Narrower bands than the noise of the travel rate (7 mm/s from lasers of 0.3 mm) would be fitted to that noise.
    grids: ClassVar = {"v0": (0.01, 0.02, 0.04)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Friction force f."""
        return (self.named("f", "N", -500.0, 500.0, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """tanh(ṡ/v0)."""
        return np.tanh(rate / self.shape.get("v0", 0.01))


class DamperAsymmetry(SuspensionForce):
    """Different damping in bump and rebound: F = a |ṡ|; c_bump = c + a, c_rebound = c − a."""

    name = "damper_asymmetry"
    about = "damping different in bump and rebound"
    signature = "suspension row follows the size of the travel rate"
    shown_by = "rough road"
    source = "Dixon (2007), chapter 3"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Half the difference of bump and rebound damping."""
        return (self.named("a", "N·s/m", -4e3, 4e3, "negative"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """|ṡ|."""
        return np.abs(rate)


class BumpStop(SuspensionForce):
    """A stop touched in compression: F = k max(0, s − gap)."""

    name = "bump_stop"
    about = "bump stop touched beyond a gap in compression"
    signature = "suspension row bends upwards beyond a travel"
    shown_by = "strong roll, braking, large bumps"
    source = "method, section 7"
    grids: ClassVar = {"gap": (0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of the stop k."""
        return (self.named("k", "N/m", -5e5, 5e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """max(0, s − gap)."""
        return np.maximum(0.0, travel - self.shape.get("gap", 0.03))


class ReboundStop(SuspensionForce):
    """A stop touched in extension: F = −k max(0, −s − gap)."""

    name = "rebound_stop"
    about = "rebound stop touched beyond a gap in extension"
    signature = "suspension row bends downwards beyond a travel"
    shown_by = "strong roll, crests"
    source = "method, section 7"
    grids: ClassVar = BumpStop.grids

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of the stop k."""
        return (self.named("k", "N/m", -5e5, 5e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """−max(0, −s − gap)."""
        return -np.maximum(0.0, -travel - self.shape.get("gap", 0.03))


class SpringQuadratic(SuspensionForce):
    """Progressive in one direction: F = k2 s²."""

    name = "spring_quadratic"
    about = "spring rate that grows with compression"
    signature = "suspension row follows the square of travel"
    shown_by = "strong roll, large bumps"
    source = "Dixon (2009), section 2.4"

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
    source = "Dixon (2009), section 2.4"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Cubic rate k3."""
        return (self.named("k3", "N/m³", -3e7, 3e7),)

    def law(self, travel: Array, rate: Array) -> Array:
        """s³."""
        return travel**3
