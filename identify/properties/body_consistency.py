"""Rigid bodies of a fit: the ten parameters of each, whether the rows separate them, and their physical consistency.

A fit holds base parameters. A body's ten standard parameters follow from them only where none is grouped with another
body's; `properties.consistent_fit` tests all bodies together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.effects.base import with_places
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.pseudo_inertia import BASIS, BodyFault, body_fault, in_units
from lacet.identify.multibody.rigid_body import PARAMETERS, REVOLUTION
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.whole_vehicle import summation
from lacet.identify.regression.wls import Fit

WHOLE = "vehicle"
"""Name of all bodies as one."""


@dataclass(frozen=True)
class Body:
    """One body of a model.

    Attributes
    ----------
    name : ``chassis``, ``axle.fl``, ``wheel.fl``, or ``vehicle`` for all as one.
    to_ten : (10, p) map from the physics' standard parameters to the body's ten, in the order of `PARAMETERS`.
    mass, length : the largest plausible mass [kg] and radius of gyration [m], used as units.
    """

    name: str
    to_ten: Array
    mass: float
    length: float

    @property
    def members(self) -> NDArray[np.intp]:
        """Indices of the model's parameters that belong to the body."""
        return np.flatnonzero(np.any(self.to_ten != 0.0, axis=0))

    def matrices(self) -> Array:
        """(p, 4, 4): pseudo-inertia per unit of each of the physics' parameters, in the body's units."""
        return in_units(np.tensordot(self.to_ten.T, BASIS, 1), self.mass, self.length)


def bodies(fitted: Fit) -> tuple[Body, ...]:
    """Every rigid body of a fit's model, in the model's order."""
    return tuple(_bodies(fitted))


def _bodies(fitted: Fit) -> Iterator[Body]:
    for effect, place in with_places(fitted.model.physics):
        if isinstance(effect, RigidBody):
            to_ten = np.zeros((len(PARAMETERS), len(fitted.physics)))
            full = place.stop - place.start == len(PARAMETERS)
            to_ten[:, place] = np.eye(len(PARAMETERS)) if full else REVOLUTION
            largest = {q.unit: q.largest for q in effect.parameters}
            yield Body(effect.where, to_ten, largest["kg"], float(np.sqrt(largest["kg·m²"] / largest["kg"])))


def whole(fitted: Fit) -> Body | None:
    """All bodies as one, about the body origin; None when the model has no chassis."""
    chassis = next((body for body in bodies(fitted) if body.name == "chassis"), None)
    if chassis is None:
        return None
    to_ten = summation(fitted, fitted.runs[0].recording.vehicle)[:, : len(fitted.physics)]
    return Body(WHOLE, to_ten, chassis.mass, chassis.length)


def clusters(fitted: Fit) -> tuple[tuple[Body, ...], ...]:
    """Groups of bodies whose parameters share a base parameter."""
    members = bodies(fitted)
    inside = np.array([np.any(body.to_ten != 0.0, axis=0) for body in members], float).reshape(len(members), -1)
    touches = np.abs(fitted.base.grouping()) @ inside.T > 0.0
    _, label = scipy.sparse.csgraph.connected_components(
        touches.T.astype(float) @ touches.astype(float), directed=False
    )
    return tuple(tuple(b for b, k in zip(members, label, strict=True) if k == group) for group in sorted(set(label)))


@dataclass(frozen=True)
class BodyCheck:
    """Consistency test of one body by itself: the smallest eigenvalue of its pseudo-inertia.

    Attributes
    ----------
    name : the body.
    shared : its parameters that are grouped with those of other bodies, or that no row depends on: where there are any,
        the fit's values are not the body's alone, and `possible` is meaningless.
    possible : whether a rigid body can have these values.
    smallest : smallest eigenvalue, in units of the largest plausible mass and size of such a body.
    half : half of its 95 % interval, to first order.
    fault : the condition violated; None where there is none.
    """

    name: str
    shared: tuple[str, ...]
    possible: bool
    smallest: float
    half: float
    fault: BodyFault | None

    @property
    def separable(self) -> bool:
        """Whether the fit's values are those of this body alone."""
        return not self.shared

    @property
    def clear(self) -> bool:
        """Whether the body is impossible by more than the uncertainty of its eigenvalue."""
        return self.separable and self.smallest + self.half < 0.0


def check_bodies(fitted: Fit) -> tuple[BodyCheck, ...]:
    """Consistency tests of each body and of the whole vehicle, by eigenvalues; needs no solver."""
    together = whole(fitted)
    return tuple(_check(fitted, body) for body in (*bodies(fitted), *((together,) if together else ())))


def _check(fitted: Fit, body: Body) -> BodyCheck:
    matrices = body.matrices()
    spectrum = np.linalg.eigh(np.tensordot(fitted.physics, matrices, 1))
    vector = np.asarray(spectrum[1], float)[:, 0]
    slope = np.einsum("i,pij,j->p", vector, matrices, vector)
    width = len(slope)
    spread = float(np.sqrt(max(0.0, slope @ fitted.covariance[:width, :width] @ slope)))
    fault = body_fault(body.to_ten @ fitted.physics)
    return BodyCheck(
        body.name, _shared(fitted, body), fault is None, float(spectrum[0][0]), TWO_SIDED_95 * spread, fault
    )


def _shared(fitted: Fit, body: Body) -> tuple[str, ...]:
    """Parameters of a body that are grouped with those of other bodies.

    A sum over the body's parameters is its own when grouping leaves it unchanged: it then lies in the rows' span.
    """
    grouping = fitted.base.grouping()
    grouped = body.to_ten[:, fitted.base.independent] @ grouping
    changed = np.abs(grouped - body.to_ten) > 1e-5 * (1.0 + np.abs(body.to_ten))
    names = fitted.model.names
    if body.name == WHOLE:
        return tuple(PARAMETERS[int(k)] for k in np.flatnonzero(np.any(changed, axis=1)))
    own = set(body.members.tolist())
    shared: list[str] = []
    for index in body.members:
        ten = np.flatnonzero(body.to_ten[:, index] != 0.0)
        involved = set(np.flatnonzero(np.any(changed[ten], axis=0)).tolist())
        if involved:
            others = [names[k] for k in sorted(involved - own)] or _holders(fitted, int(index))
            shared.append(names[int(index)] + (f" (with {', '.join(others[:3])})" if others else ""))
    return tuple(shared)


def _holders(fitted: Fit, index: int) -> list[str]:
    """Parameters that hold the value of a parameter grouped into others."""
    base = fitted.base
    column = np.flatnonzero(base.dependent == index)
    rows = np.any(base.relations[:, column] != 0.0, axis=1)
    return [fitted.model.names[int(k)] for k in base.independent[rows] if int(k) != index]
