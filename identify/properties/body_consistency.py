"""Rigid bodies of a fit: the parameters of each, whether grouping separates them, and their physical consistency.

A fit holds base parameters. What a body's ten numbers are is then a question only for a body of which nothing was
grouped into another's parameters, or another's into its own; `properties.consistent_fit` answers it for all together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.multibody.pseudo_inertia import BASIS, BodyFault, body_fault, in_units
from lacet.identify.multibody.rigid_body import PARAMETERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.whole_vehicle import summation
from lacet.identify.regression.wls import Fit

WHOLE = "vehicle"
"""Name of all bodies taken as one."""

_REVOLUTION = (("ZZ",), ("XX", "YY"), ("MZ",), ("M",))
"""Parameters of the ten that each of the four of a balanced body of revolution stands for."""


@dataclass(frozen=True)
class Body:
    """One body of a model.

    Attributes
    ----------
    name : ``chassis``, ``axle.fl``, ``wheel.fl``, or ``vehicle`` for all as one.
    to_ten : (10, p) from the physics' standard parameters to the body's ten, in the order of `PARAMETERS`.
    mass, length : the largest plausible mass [kg] and radius of gyration [m]: units to see it in.
    """

    name: str
    to_ten: Array
    mass: float
    length: float

    @property
    def members(self) -> NDArray[np.intp]:
        """Indices of the model's parameters that make the body."""
        return np.flatnonzero(np.any(self.to_ten != 0.0, axis=0))

    def matrices(self) -> Array:
        """(p, 4, 4): the pseudo-inertia in the body's units, per unit of each of the physics' parameters."""
        return in_units(np.tensordot(self.to_ten.T, BASIS, 1), self.mass, self.length)


def bodies(fitted: Fit) -> tuple[Body, ...]:
    """Every rigid body of a fit's model, in the model's order."""
    return tuple(_bodies(fitted))


def _bodies(fitted: Fit) -> Iterator[Body]:
    width, start = len(fitted.physics), 0
    for effect in fitted.model.physics:
        stop = start + len(effect.parameters)
        if isinstance(effect, RigidBody):
            to_ten = np.zeros((len(PARAMETERS), width))
            if stop - start == len(PARAMETERS):
                to_ten[:, start:stop] = np.eye(len(PARAMETERS))
            else:
                for column, names in enumerate(_REVOLUTION):
                    to_ten[[PARAMETERS.index(name) for name in names], start + column] = 1.0
            largest = {q.unit: q.largest for q in effect.parameters}
            yield Body(effect.where, to_ten, largest["kg"], float(np.sqrt(largest["kg·m²"] / largest["kg"])))
        start = stop


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
    _, label = connected_components(touches.T.astype(float) @ touches.astype(float), directed=False)
    return tuple(tuple(b for b, k in zip(members, label, strict=True) if k == group) for group in sorted(set(label)))


@dataclass(frozen=True)
class BodyCheck:
    """The direct test of one body: the smallest eigenvalue of its pseudo-inertia.

    Attributes
    ----------
    name : the body.
    shared : parameters counted together with parameters that are not the body's own, or seen by no row: where there
        are any, the values of the fit are not the body's alone, and `possible` says nothing.
    possible : whether a body can have these values.
    smallest : smallest eigenvalue, in units of the largest plausible mass and size of such a body.
    half : half of its 95 % interval, to first order.
    fault : what is impossible about it; None when nothing is.
    """

    name: str
    shared: tuple[str, ...]
    possible: bool
    smallest: float
    half: float
    fault: BodyFault | None

    @property
    def separable(self) -> bool:
        """Whether the fit's values are those of this body and of nothing else."""
        return not self.shared

    @property
    def clear(self) -> bool:
        """Whether it is impossible by more than its own uncertainty."""
        return self.separable and self.smallest + self.half < 0.0


def check_bodies(fitted: Fit) -> tuple[BodyCheck, ...]:
    """The direct test of each body and of the whole vehicle. Needs no solver."""
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
    return BodyCheck(body.name, _shared(fitted, body), fault is None, float(spectrum[0][0]), 1.96 * spread, fault)


def _shared(fitted: Fit, body: Body) -> tuple[str, ...]:
    """Parameters of a body that are grouped with those of other bodies.

    A sum over the body's parameters is its own when grouping leaves it unchanged: it lies in the rows' span then.
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
    """Parameters that a parameter grouped into others is counted in."""
    base = fitted.base
    column = np.flatnonzero(base.dependent == index)
    rows = np.any(base.relations[:, column] != 0.0, axis=1)
    return [fitted.model.names[int(k)] for k in base.independent[rows] if int(k) != index]
