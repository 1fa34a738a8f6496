"""Physical consistency of a rigid body's ten parameters: its pseudo-inertia matrix is positive definite.

Source: Wensing, Kim and Slotine (2018), Linear matrix inequalities for physically consistent inertial parameter
identification, IEEE Robotics and Automation Letters 3(1); Traversaro et al. (2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.multibody.rigid_body import PARAMETERS
from lacet.identify.multibody.vectors import Array


def pseudo_inertia(values: Sequence[float] | Array) -> Array:
    """Pseudo-inertia [[Σ, h], [hᵀ, M]], (4, 4), of ten parameters in the order of `rigid_body.PARAMETERS`.

    Σ = ½ tr(I) 1 − I is the second moment of the mass ∫ r rᵀ dm [kg·m²] about the frame's origin, h the first moments
    [kg·m], M the mass [kg]: J = ∫ (r, 1)(r, 1)ᵀ dm, positive semidefinite exactly when some distribution of mass that
    is nowhere negative has these ten parameters.
    """
    return np.tensordot(np.asarray(values, float), BASIS, 1)


def _basis() -> Array:
    out = np.zeros((len(PARAMETERS), 4, 4))
    for k, name in enumerate(PARAMETERS):
        axes = ["XYZ".index(letter) for letter in name if letter in "XYZ"]
        if name == "M":
            out[k, 3, 3] = 1.0
        elif name.startswith("M"):
            out[k, axes[0], 3] = out[k, 3, axes[0]] = 1.0
        elif axes[0] == axes[1]:
            out[k, :3, :3] = 0.5 * np.eye(3)
            out[k, axes[0], axes[0]] = -0.5
        else:
            out[k, axes[0], axes[1]] = out[k, axes[1], axes[0]] = -1.0
    return out


BASIS = _basis()
"""(10, 4, 4): the pseudo-inertia is Σ_k values[k] BASIS[k]."""

_ROUNDING = 1e-12
"""Relative rounding error by which the pseudo-inertia of points on a line or plane is found negative."""


def in_units(J: Array, mass: float, length: float) -> Array:
    """Pseudo-inertias (…, 4, 4) in units of a mass [kg] and a length [m], with unchanged definiteness.

    Without it the rows of a chassis (thousands of kg·m² beside kg) and of a hub differ by orders of magnitude.
    """
    scale = np.array([1.0 / length] * 3 + [1.0]) / np.sqrt(mass)
    return J * scale[:, None] * scale


@dataclass(frozen=True)
class MassFault:
    """A body's `mass` [kg] is not above zero."""

    mass: float


@dataclass(frozen=True)
class MomentFault:
    """A moment of inertia about the centre of gravity, `moment` [kg·m²], is below zero."""

    moment: float


@dataclass(frozen=True)
class TriangleFault:
    """The `largest` moment of inertia about the centre of gravity exceeds the sum of the `others` [kg·m²]."""

    largest: float
    others: float


BodyFault = MassFault | MomentFault | TriangleFault
"""Condition of mechanics that a body's parameters violate."""


def body_fault(values: Sequence[float] | Array) -> BodyFault | None:
    """The first condition of mechanics that ten parameters violate; None when they fulfil all.

    In order: positive mass; moments of inertia about the centre of gravity that are not negative; the triangle
    inequality between them (none is larger than the sum of the other two).
    """
    ten = np.asarray(values, float)
    mass, J = float(ten[9]), pseudo_inertia(ten)
    if float(np.linalg.eigvalsh(J)[0]) >= -_ROUNDING * float(np.linalg.norm(J)):
        return None
    if mass <= 0.0:
        return MassFault(mass)
    second = J[:3, :3] - np.outer(J[:3, 3], J[:3, 3]) / mass
    moments = np.sort(np.trace(second) - np.linalg.eigvalsh(second))
    if moments[0] < 0.0:
        return MomentFault(float(moments[0]))
    small, middle, large = moments
    return TriangleFault(float(large), float(small + middle))
