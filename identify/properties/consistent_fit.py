"""Physical consistency of a fit, and the nearest consistent fit with the rise of its residual.

A fit holds base parameters. It is consistent when *some* standard parameters with these base values give every body a
positive definite pseudo-inertia and every parameter of certain sign that sign. The nearest consistent estimate is a
convex problem (linear matrix inequalities): minimise ‖R (x − x̂)‖² with R the fit's weighted triangle.

Source: Sousa and Cortesão (2014), Physical feasibility of robot base inertial parameter identification: a linear matrix
inequality approach, International Journal of Robotics Research 33(6); Wensing, Kim and Slotine (2018).
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import SolverError
from lacet.daq.parts import from_part
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Parameter
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.body_consistency import WHOLE, Body, BodyCheck, bodies, check_bodies, clusters, whole
from lacet.identify.regression.information import Information
from lacet.identify.regression.qr_accumulation import zeros_following
from lacet.identify.regression.wls import Fit

LEAST = 1e-6
"""Smallest eigenvalue of a corrected body, in units of the largest plausible mass and size: above a solver's error."""
_OPEN = 100.0
"""Bound of standard parameters that the equations leave free, in plausible sizes.

Unbounded ones would grow until rounding hides all else."""
DRAWS = 99
"""Simulated campaigns behind the p of a distance."""


@dataclass(frozen=True)
class ConsistencyPrice:
    """Cost of the consistency constraints: rise of the residual and change of the parameters.

    Attributes
    ----------
    quadratic : ‖R (x − x̂)‖², the rise of the weighted sum of squared residuals; its root is a distance in σ.
    percent : rise of the weighted sum of squared residuals [%].
    rows : row → rise of the residual's RMS over all runs [%]; negative where the row fits better.
    largest : the base parameter that moved most in its own σ, and by how many σ (from the covariance of the fit).
    changes : parameter → (before, after), those that moved by more than 0.01 σ.
    """

    quadratic: float
    percent: float
    rows: Mapping[Row, float]
    largest: tuple[str, float]
    changes: Mapping[str, tuple[float, float]]

    @property
    def distance(self) -> float:
        """Distance from the estimate to the consistent set [σ]."""
        return float(np.sqrt(self.quadratic))


@dataclass(frozen=True)
class ConsistentFit:
    """The consistent fit nearest to an estimate.

    `fit` has the new parameters, zeros and residuals; its covariance is still that of the unconstrained estimate (an
    interval may reach outside the consistent set: cut it there). `standard` (p,) is one set of the physics' standard
    parameters with these base values that fulfils every constraint.
    """

    fit: Fit
    standard: Array
    price: ConsistencyPrice


@dataclass(frozen=True)
class Consistency:
    """Physical consistency of a fit: distance to the consistent set, its p, and the tests of single bodies.

    Attributes
    ----------
    margin : maximum over standard parameters with the fitted base values of the smallest eigenvalue (or signed value)
        of all bodies, in units of plausible size; at least zero where the fit is consistent.
    distance : to the nearest consistent estimate [σ]; zero when consistent.
    p : share of simulated campaigns of the nearest consistent car whose estimate is at least as far from consistency.
    bodies : the test of each body by itself.
    alone : body → distance [σ] when only that body has to be possible; bodies with grouped parameters count as one
        (``axle.fl + wheel.fl``).
    wrong_sign : spring, damper, mass … → by how many of its own σ it has the impossible sign.
    """

    margin: float
    distance: float
    p: float
    bodies: tuple[BodyCheck, ...]
    alone: Mapping[str, float]
    wrong_sign: Mapping[str, float]

    @property
    def consistent(self) -> bool:
        """Whether standard parameters with the fitted base values exist that fulfil every constraint."""
        return self.margin >= 0.0

    @property
    def judged(self) -> bool:
        """Whether the runs determine the parameters of any body."""
        return any(body.separable for body in self.bodies)

    @property
    def noise_explains(self) -> bool:
        """Whether noise alone brings estimates of a consistent car as far from consistency."""
        return self.p > 0.05

    @property
    def worst(self) -> str:
        """The body or parameter that is farthest from possible."""
        blame = {**{name: d for name, d in self.alone.items() if name != WHOLE}, **self.wrong_sign}
        return max(blame, key=lambda name: blame[name])


def consistency(fitted: Fit, draws: int = DRAWS) -> Consistency:
    """The physical consistency of a fit, and its distance to the nearest consistent one.

    Raises MissingPart without the extra ``consistency`` (cvxpy and clarabel), SolverError when the solver fails.
    """
    checks, known = check_bodies(fitted), Information.of(fitted)
    projection = _Projection(fitted, known, bodies(fitted))
    margin = projection.margin()
    if margin >= 0.0:
        return Consistency(margin, 0.0, 1.0, checks, {}, {})
    estimate = fitted.theta[fitted.base.independent]
    base, _, quadratic = projection.nearest(estimate)
    together = whole(fitted)
    alone: dict[str, float] = {}
    for group in (*clusters(fitted), *([(together,)] if together else [])):
        single = _Projection(fitted, known, group, signs=False)
        inside = single.margin() >= 0.0
        alone[" + ".join(body.name for body in group)] = 0.0 if inside else single.nearest(estimate)[2] ** 0.5
    farther = sum(
        projection.nearest(draw)[2] >= quadratic for draw in _campaigns(fitted, known, base, projection.touched, draws)
    )
    return Consistency(margin, quadratic**0.5, (1 + farther) / (1 + draws), checks, alone, _wrong_sign(fitted))


def consistent_fit(fitted: Fit) -> ConsistentFit:
    """The consistent fit nearest to a fit; the fit itself where it is consistent.

    Raises MissingPart without the extra ``consistency`` (cvxpy and clarabel), SolverError when the solver fails.
    """
    known = Information.of(fitted)
    projection = _Projection(fitted, known, bodies(fitted))
    if projection.margin() >= 0.0:
        price = ConsistencyPrice(0.0, 0.0, dict.fromkeys(fitted.rows, 0.0), ("", 0.0), {})
        return ConsistentFit(fitted, projection.completed, price)
    estimate = fitted.theta[fitted.base.independent]
    base, standard, quadratic = projection.nearest(estimate)
    moved = projection.follow @ (base - estimate)[projection.touched]
    out, price = _moved(fitted, moved, quadratic)
    return ConsistentFit(out, np.where(projection.bound, standard, out.physics), price)


class _Projection:
    """The convex problem of projecting an estimate onto the consistent set of some bodies.

    Unknowns are u, in which ‖R (x − x̂)‖² = ‖u‖², and the standard parameters that grouping leaves free (n), in units
    of their plausible size. What no constraint involves follows in closed form.
    """

    def __init__(self, fitted: Fit, known: Information, members: Sequence[Body], signs: bool = True):
        self.fitted = fitted
        self.cp = convex_solver()
        base, width = fitted.base, len(fitted.physics)
        parameters = fitted.model.parameters[:width]
        size = np.array([q.prior for q in parameters])
        sign = np.array([certain_sign(q) for q in parameters]) * signs
        bound = sign != 0.0
        for body in members:
            bound[body.members] = True
        grouping = base.grouping()
        self.touched = np.flatnonzero(np.any(grouping[:, bound] != 0.0, axis=1))
        used = bound | np.any(grouping[self.touched] != 0.0, axis=0)
        hidden = np.array([i for i in (*base.dependent, *base.absent) if used[i]], int)
        self.triangle, self.follow = known.marginal(self.touched)
        # s = from_base x_touched + from_hidden n: a kept parameter is its base value less those grouped into it.
        self.from_base = np.zeros((width, len(self.touched)))
        self.from_base[base.independent[self.touched], np.arange(len(self.touched))] = 1.0
        self.from_hidden = np.zeros((width, len(hidden)))
        self.from_hidden[hidden, np.arange(len(hidden))] = size[hidden]
        kept = base.independent[self.touched]
        self.from_hidden[kept] -= grouping[np.ix_(self.touched, hidden)] * size[hidden]
        self.signed = np.flatnonzero(sign)
        self.unit = sign[self.signed] / size[self.signed]
        self.matrices = [body.matrices() for body in members]
        lengths = np.linalg.norm(self.triangle, axis=0)
        self.step = np.linalg.solve(np.asarray(self.triangle / lengths, float), np.eye(len(lengths))) / lengths[:, None]
        self.bound = np.any(self.from_base != 0.0, axis=1) | np.any(self.from_hidden != 0.0, axis=1)
        self.completed = self._standard(fitted.theta[base.independent][self.touched], np.zeros(len(hidden)))

    def margin(self) -> float:
        """Largest possible smallest eigenvalue and signed value with the fitted base values; at most 1.

        The standard parameters that attain it are stored in `completed`.
        """
        start = self.from_base @ self.fitted.theta[self.fitted.base.independent][self.touched]
        plain = self._smallest(start)
        if plain >= 0.0 or not self.from_hidden.shape[1]:
            return plain
        cp = self.cp
        hidden, level = cp.Variable(self.from_hidden.shape[1]), cp.Variable()
        limits = [*self._constraints(start + self.from_hidden @ hidden, level), level <= 1.0, cp.abs(hidden) <= _OPEN]
        problem = cp.Problem(cp.Maximize(level), limits)
        self._solve(problem)
        standard = start + self.from_hidden @ np.asarray(hidden.value, float)
        self.completed = self._standard(self.fitted.theta[self.fitted.base.independent][self.touched], hidden.value)
        return self._smallest(standard)

    def nearest(self, base: Array) -> tuple[Array, Array, float]:
        """Consistent base parameters (b,) nearest to `base`, standard ones (p,) that have them, and ‖R (x − x̂)‖²."""
        problem, start, far, u, hidden = self._compiled
        start.value = self.from_base @ base[self.touched]
        # Solvers need unknowns near one: far from the consistent set, u is in units of the distance itself.
        change, far.value = np.zeros(len(self.touched)), 1.0
        for _ in range(3):
            self._solve(problem)
            change = float(far.value) * np.asarray(u.value, float)
            size = float(np.linalg.norm(change))
            if 0.01 * size < far.value:
                break
            far.value = size
        out = base.copy()
        out[self.touched] += self.step @ change
        standard = self._standard(out[self.touched], hidden.value if hidden is not None else np.zeros(0))
        if self._smallest(standard) < 0.0:
            raise SolverError(
                f"the consistent fit did not come out consistent (smallest eigenvalue {self._smallest(standard):.2g}): "
                "the fit is too badly scaled for the solver; fit with more runs or a smaller model"
            )
        return out, standard, float(change @ change)

    @cached_property
    def _compiled(self) -> tuple[Any, Any, Any, Any, Any]:
        cp = self.cp
        start, far, u = cp.Parameter(self.from_base.shape[0]), cp.Parameter(), cp.Variable(self.step.shape[0])
        hidden = cp.Variable(self.from_hidden.shape[1]) if self.from_hidden.shape[1] else None
        standard = start + (self.from_base @ self.step) @ (far * u)
        if hidden is not None:
            standard = standard + self.from_hidden @ hidden
        limits = self._constraints(standard, LEAST)
        if hidden is not None:
            limits.append(cp.abs(hidden) <= _OPEN)
        return cp.Problem(cp.Minimize(cp.sum_squares(u)), limits), start, far, u, hidden

    def _constraints(self, standard: Any, level: Any) -> list[Any]:
        """Constraints: every body's pseudo-inertia and every signed parameter at least `level`."""
        cp = self.cp
        out = [
            cp.reshape(table.reshape(len(table), 16).T @ standard, (4, 4), order="C") - level * np.eye(4) >> 0
            for table in self.matrices
        ]
        if len(self.signed):
            out.append(cp.multiply(self.unit, standard[self.signed]) >= level)
        return out

    def _smallest(self, standard: Array) -> float:
        spectra = [np.linalg.eigvalsh(np.tensordot(standard, table, 1))[0] for table in self.matrices]
        return float(np.min([*spectra, *(self.unit * standard[self.signed])]))

    def _standard(self, touched: Array, hidden: Array) -> Array:
        """All standard parameters of the physics; those in no constraint are the fit's."""
        moved = self.from_base @ touched + self.from_hidden @ hidden
        return np.where(self.bound, moved, self.fitted.physics)

    def _solve(self, problem: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate solution is judged below, by the result itself
            try:
                problem.solve(solver=self.cp.CLARABEL)
            except self.cp.error.SolverError as cause:
                raise SolverError(f"the solver Clarabel failed on the consistent fit: {cause}") from None
        if problem.status not in (self.cp.OPTIMAL, self.cp.OPTIMAL_INACCURATE):
            raise SolverError(
                f"the consistent fit has no answer (Clarabel: {problem.status}): a parameter is so well known, or so "
                "badly scaled, that no possible car is near"
            )


def certain_sign(parameter: Parameter) -> float:
    """1 or −1 where a parameter's bounds allow only one sign (springs, dampers, tyres, masses), else 0.

    `Parameter.expect` is no bound: it is the usual sign.
    """
    return 1.0 if parameter.low >= 0.0 else -1.0 if parameter.high <= 0.0 else 0.0


def _wrong_sign(fitted: Fit) -> dict[str, float]:
    sigma = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance)))
    return {
        q.name: float(abs(fitted.theta[i]) / sigma[i]) if sigma[i] > 0.0 else float("inf")
        for i, q in enumerate(fitted.model.parameters[: len(fitted.physics)])
        if i in fitted.base.independent and certain_sign(q) * fitted.theta[i] < 0.0
    }


def _campaigns(fitted: Fit, known: Information, base: Array, touched: NDArray[np.intp], draws: int) -> Sequence[Array]:
    """Estimates (b,) of simulated campaigns of a car with base parameters `base`.

    The priors draw what no run determines towards zero and add no scatter: the estimate's mean is x − (RᵀR)⁻¹ P x, its
    covariance the fit's less the part (RᵀR)⁻¹ P (RᵀR)⁻¹ that stands for the prior itself.
    """
    inverse = known.inverse()
    plain = inverse @ inverse.T
    truth = np.zeros(len(known.names))
    truth[: len(base)] = base
    mean = base - (plain @ (known.loose @ truth))[: len(base)]
    place = fitted.base.independent
    spread = fitted.covariance[np.ix_(place, place)] - (plain @ known.loose @ plain)[: len(base), : len(base)]
    part = spread[np.ix_(touched, touched)]
    size = np.sqrt(np.diag(plain))[touched]
    values, vectors = np.linalg.eigh(part / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(np.maximum(0.0, values))
    out = np.tile(mean, (draws, 1))
    out[:, touched] += np.random.default_rng(2018).standard_normal((draws, len(touched))) @ root.T
    return list(out)


def _moved(fitted: Fit, change: Array, quadratic: float) -> tuple[Fit, ConsistencyPrice]:
    """A fit with its unknowns changed by `change` (q,) and its residuals accordingly, and the cost."""
    theta, place = fitted.theta.copy(), fitted.place
    theta[place] += change
    fall = [gain @ change for gain, _ in zeros_following(fitted.equations.runs, fitted.sigma)]
    zeros = tuple((names, sigma, z - f) for (names, sigma, z), f in zip(fitted.zeros, fall, strict=True))
    moved_rows: list[dict[Row, list[Array]]] = [{} for _ in fitted.runs]
    for piece in fitted.assembly.pieces():
        step = np.concatenate([-fall[piece.run], change])
        for row, block in piece.blocks.items():
            moved_rows[piece.run].setdefault(row, []).append(block @ step)
    residual = tuple(
        {row: r - np.concatenate(moved[row]) for row, r in before.items()}
        for before, moved in zip(fitted.residual, moved_rows, strict=True)
    )
    out = replace(fitted, theta=theta, residual=residual, zeros=zeros)
    before, after = _squares(fitted), _squares(out)
    weighted = [(after[row] - before[row]) / fitted.sigma[row] ** 2 for row in before]
    total = sum(before[row] / fitted.sigma[row] ** 2 for row in before)
    sigma = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance)))[place]
    moved = np.abs(change) / np.where(sigma > 0.0, sigma, np.inf)
    names = [fitted.model.names[int(i)] for i in place]
    worst = int(np.argmax(moved))
    changes = {names[k]: (float(fitted.theta[place[k]]), float(theta[place[k]])) for k in np.flatnonzero(moved > 0.01)}
    rows = {row: 100.0 * (float(np.sqrt(after[row] / before[row])) - 1.0) for row in before if before[row] > 0.0}
    price = ConsistencyPrice(
        quadratic, 100.0 * float(sum(weighted) / total), rows, (names[worst], float(moved[worst])), changes
    )
    return out, price


def _squares(fitted: Fit) -> dict[Row, float]:
    """Sum of squared residuals by row, over all runs."""
    return {row: float(sum(part[row] @ part[row] for part in fitted.residual if row in part)) for row in fitted.rows}


def convex_solver() -> Any:
    """The module cvxpy. Raises MissingPart without the extra ``consistency``."""
    with from_part("consistency"):
        importlib.import_module("clarabel")
        return importlib.import_module("cvxpy")
