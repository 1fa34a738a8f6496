"""Full inertial parameters of every body of a fit, with the base parameters that were identified.

A fit holds base parameters; a simulator needs all ten of every body. Those that the rows leave open are chosen: the
bodies nearest to typical ones that have the fit's base parameters, by the log-determinant divergence of pseudo-inertias

    D(J‖J0) = tr(J0⁻¹ J) − log det(J0⁻¹ J) − 4,

which is convex, has one minimum, and is infinite for a body that cannot exist. Where no possible bodies have the fit's
base parameters, these give way, too: ½‖R (x − x̂)‖² + D is least, with R the fit's weighted triangle. That is not the
nearest consistent fit, which lies on the border of what can exist, with wheels of no mass.

Source: Lee, Wensing and Park (2020), Geometric robot dynamic identification: a convex programming approach, IEEE
Transactions on Robotics 36(2), equation 20.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import SolverError
from lacet.identify.multibody.pseudo_inertia import in_units, pseudo_inertia
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.body_consistency import Body, bodies
from lacet.identify.properties.consistent_fit import ConsistencyPrice, moved_fit
from lacet.identify.regression.information import Information
from lacet.identify.regression.wls import Fit

TYPICAL: Mapping[str, tuple[float, ...]] = {
    "chassis": (644.0, 0.0, 460.0, 3824.0, 0.0, 4103.0, -1635.0, 0.0, 433.0, 1498.5),
    "axle": (0.40, 0.0, 0.0, 0.35, 0.0, 0.35, 0.0, 0.0, 0.0, 18.0),
    "wheel.hub": (0.06, 0.0, 0.0, 0.06, 0.0, 0.10, 0.0, 0.0, 0.0, 5.0),
    "wheel.contact": (0.58, 0.0, 0.0, 0.58, 0.0, 1.00, 0.0, 0.0, 0.0, 25.0),
}
"""Typical bodies of a middle-class car: ten parameters in each body's own frame, SI, in the order of
`rigid_body.PARAMETERS`; wheels inboard of a dynamometer (hub, disc) and whole ones. Those of `simulate.peugeot_406`,
which says where they come from."""

_STEPS = 200
"""Largest number of Newton steps: some ten are usual."""
_CLOSE = 1e-10
"""Newton decrement at which a minimum is found, in the divergence's own unit."""
_INSIDE = 1e-9
"""Smallest eigenvalue of a body that can exist, in units of the largest plausible mass and size."""


@dataclass(frozen=True)
class CompleteCar:
    """All parameters of a fit's physics, those that the rows leave open chosen.

    Attributes
    ----------
    fit : the fit, or the nearest consistent one where no possible bodies have its base parameters.
    standard : (p,) parameters of the physics in the model's order: their base parameters are those of `fit`.
    bodies : body (``chassis``, ``axle.fl``, ``wheel.fl``) → its ten parameters in its own frame.
    chosen : names of the parameters that were chosen.
    shared : names of those whose value is the fit's less what was chosen: only the sum is identified.
    price : what consistency cost; None where the fit was consistent.
    """

    fit: Fit
    standard: Array
    bodies: Mapping[str, Array]
    chosen: tuple[str, ...]
    shared: tuple[str, ...]
    price: ConsistencyPrice | None

    def value(self, name: str) -> float:
        """A parameter by name [SI]. Raises KeyError."""
        return dict(zip(self.fit.model.names, self.standard.tolist(), strict=False))[name]


def complete_car(fitted: Fit) -> CompleteCar:
    """The car of a fit with full inertial parameters. Raises SolverError when no possible bodies are found."""
    members = bodies(fitted)
    hidden = _hidden(fitted, members)
    columns = _free_directions(fitted, hidden)
    price = None
    start = _inside(fitted.physics, members, columns)
    if start is None:
        fitted, standard, price = _mended(fitted, members, hidden, columns)
    else:
        standard = fitted.physics + columns @ _nearest(fitted, members, columns, start)
    names = fitted.model.names
    moved = np.any(columns != 0.0, axis=1)
    moved[hidden] = False
    return CompleteCar(
        fitted, standard, {body.name: body.to_ten @ standard for body in members},
        tuple(names[int(i)] for i in hidden), tuple(names[int(i)] for i in np.flatnonzero(moved)), price,
    )  # fmt: skip


def _mended(
    fitted: Fit, members: Sequence[Body], hidden: NDArray[np.intp], columns: Array
) -> tuple[Fit, Array, ConsistencyPrice]:
    """A fit whose base parameters gave way, the standard parameters (p,), and what it cost."""
    base, known = fitted.base, Information.of(fitted)
    held = np.any(columns != 0.0, axis=1) | _of_bodies(fitted, members)
    touched = np.flatnonzero(held[base.independent])
    triangle, follow = known.marginal(touched)
    lengths = np.linalg.norm(triangle, axis=0)
    step = np.linalg.solve(np.asarray(triangle / lengths, float), np.eye(len(lengths))) / lengths[:, None]
    by_base = np.zeros((len(fitted.physics), len(touched)))
    by_base[base.independent[touched]] = step  # unknowns u with ‖R (x − x̂)‖² = ‖u‖²
    every = np.concatenate([by_base, columns], axis=1)
    # From typical bodies, which can exist.
    typical = fitted.physics.copy()
    for body in members:
        own = body.members
        typical[own] = np.linalg.lstsq(body.to_ten[:, own], _typical_ten(body, fitted))[0]
    away = (base.grouping() @ typical - fitted.theta[base.independent])[touched]
    start = np.append(triangle @ away, (typical - fitted.physics)[hidden] / _sizes(fitted)[hidden])
    weight = np.append(np.ones(len(touched)), np.zeros(columns.shape[1]))
    found = _nearest(fitted, members, every, start, weight)
    if not _smallest(fitted.physics + every @ found, members) > 0.0:
        raise SolverError("no bodies that can exist are near the fit's base parameters: fit with more runs")
    u = found[: len(touched)]
    out, price = moved_fit(fitted, follow @ (step @ u), float(u @ u))
    return out, np.where(np.any(every != 0.0, axis=1), fitted.physics + every @ found, out.physics), price


def _nearest(fitted: Fit, members: Sequence[Body], columns: Array, start: Array, weight: Array | None = None) -> Array:
    """Unknowns (h,) with the least divergence from typical bodies, plus ½ Σ weight x²."""
    return _minimise(
        [np.tensordot(fitted.physics, body.matrices(), 1) for body in members],
        [np.tensordot(columns.T, body.matrices(), 1) for body in members],
        [np.asarray(np.linalg.inv(_typical(body, fitted)), float) for body in members],
        start, np.zeros(len(start)), np.zeros(len(start)) if weight is None else weight,
    )  # fmt: skip


def _hidden(fitted: Fit, members: Sequence[Body]) -> NDArray[np.intp]:
    """Indices of the bodies' parameters that have no value of their own."""
    own = _of_bodies(fitted, members)
    return np.array([i for i in sorted((*fitted.base.dependent, *fitted.base.absent)) if own[i]], int)


def _of_bodies(fitted: Fit, members: Sequence[Body]) -> NDArray[np.bool_]:
    out = np.zeros(len(fitted.physics), bool)
    for body in members:
        out[body.members] = True
    return out


def _sizes(fitted: Fit) -> Array:
    return np.array([q.prior for q in fitted.model.parameters[: len(fitted.physics)]])


def _free_directions(fitted: Fit, hidden: NDArray[np.intp]) -> Array:
    """(p, h) changes of the standard parameters that leave every base parameter as it is, one a hidden parameter."""
    base, size = fitted.base, _sizes(fitted)
    out = np.zeros((len(fitted.physics), len(hidden)))
    out[hidden, np.arange(len(hidden))] = size[hidden]
    out[base.independent] -= base.grouping()[:, hidden] * size[hidden]
    return out


def _typical(body: Body, fitted: Fit) -> Array:
    """Pseudo-inertia (4, 4) of a typical body of that kind, in the body's units."""
    return in_units(pseudo_inertia(_typical_ten(body, fitted)), body.mass, body.length)


def _typical_ten(body: Body, fitted: Fit) -> tuple[float, ...]:
    kind = body.name.partition(".")[0]
    return TYPICAL[f"wheel.{fitted.runs[0].recording.reference}" if kind == "wheel" else kind]


def _smallest(standard: Array, members: Sequence[Body]) -> float:
    """Smallest eigenvalue of any body, in units of plausible size."""
    return min(float(np.linalg.eigvalsh(np.tensordot(standard, b.matrices(), 1))[0]) for b in members)


def _inside(physics: Array, members: Sequence[Body], columns: Array) -> Array | None:
    """Values of the hidden parameters with which every body can exist; None where there are none.

    Phase one of an interior-point method: the least t with which every body plus t times the identity can exist.
    """
    width = columns.shape[1]
    if _smallest(physics, members) > _INSIDE:
        return np.zeros(width)
    at = [np.asarray(np.tensordot(physics, body.matrices(), 1), float) for body in members]
    along = [
        np.concatenate([np.tensordot(columns.T, body.matrices(), 1), np.eye(4)[None]]) for body in members
    ]  # the last unknown is t
    x: Array = np.append(np.zeros(width), 1.0 - _smallest(physics, members))
    # The trace keeps what no row determines from growing without bound; t counts more from round to round.
    for weight in (10.0**k for k in range(12)):
        x = _minimise(at, along, [np.eye(4)] * len(at), x, np.append(np.zeros(width), weight), np.zeros(width + 1))
        if x[-1] < 0.0 and _smallest(physics + columns @ x[:-1], members) > _INSIDE:
            return x[:-1]
    return None


def _minimise(
    at: Sequence[Array], along: Sequence[Array], inverse: Sequence[Array], start: Array, cost: Array, weight: Array
) -> Array:
    """Least Σ tr(P J) − log det J + cost·x + ½ Σ weight x² over x (h,) by Newton's method, from a start that is inside.

    J = `at` + Σ x `along`, matrices (4, 4) and (h, 4, 4) a body; `inverse` the matrices P.
    """
    x = start.copy()
    linear = sum((np.einsum("kij,ij->k", a, p) for a, p in zip(along, inverse, strict=True)), np.zeros(len(x)))
    linear = linear + cost

    def value(x: Array) -> float:
        total = float(linear @ x + 0.5 * weight @ x**2)
        for b, a in zip(at, along, strict=True):
            try:
                root = np.linalg.cholesky(b + np.tensordot(x, a, 1))
            except np.linalg.LinAlgError:
                return np.inf
            total -= 2.0 * float(np.sum(np.log(np.diag(root))))
        return total

    here = value(x)
    for _ in range(_STEPS):
        slope, curve = linear + weight * x, np.diag(weight)
        for b, a in zip(at, along, strict=True):
            mixed = np.linalg.solve(b + np.tensordot(x, a, 1), a)  # J⁻¹ A, (h, 4, 4)
            slope -= np.trace(mixed, axis1=1, axis2=2)
            curve = curve + np.einsum("kij,lji->kl", mixed, mixed)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(curve), 1e-300))
        step = -scale * np.linalg.lstsq(curve * scale * scale[:, None], scale * slope)[0]
        decrement = -float(slope @ step)
        if decrement < _CLOSE:
            break
        length, after = 1.0, value(x + step)
        while length > 1e-12 and not after < here - 0.1 * length * decrement:
            length *= 0.5
            after = value(x + length * step)
        if length <= 1e-12:  # nothing but rounding remains
            break
        x, here = x + length * step, after
    return x
