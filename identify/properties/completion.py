"""Full inertial parameters of an identified car: bodies that can exist and have the base parameters identified.

Runs determine combinations of the bodies' parameters alone. A simulator wants all ten of every body, so those left
open are chosen: as near to a guess as the runs let them be, in the entropic divergence of pseudo-inertias, which is
finite for bodies that can exist only.

Source: Lee, Wensing and Park (2020), Geometric robot dynamic identification: a convex programming approach, IEEE
Transactions on Robotics 36(2).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.errors import SolverError
from lacet.identify.multibody.pseudo_inertia import in_units, pseudo_inertia
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.body_consistency import Body, bodies
from lacet.identify.properties.consistent_fit import convex_solver
from lacet.identify.regression.information import Information
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import estimates


@dataclass(frozen=True)
class Completion:
    """One full set of inertial parameters that an identified car can have.

    Attributes
    ----------
    ten : body (``chassis``, ``axle.fl``, ``wheel.fl`` …) → its ten parameters (10,), in the body's own frame.
    held : base parameters of bodies that the runs determine, in words (``M29 + M32``) → value in the completion.
    fitted : the same base parameters → the fit's value; equal unless `moved`.
    moved : the determined base parameter that differs most from the fit's, and by how many of its σ; None where all are
        the fit's exactly. They differ where no body that can exist has the fit's.
    distance : root of the rise of the weighted sum of squared residuals that the choice costs [σ].
    """

    ten: Mapping[str, Array]
    held: Mapping[str, float]
    fitted: Mapping[str, float]
    moved: tuple[str, float] | None
    distance: float


def complete_bodies(fitted: Fit, guess: Mapping[str, Array]) -> Completion:
    """Full inertial parameters of the car of a fit.

    `guess` : body → ten parameters, (10,), in the body's frame, of a similar car; it decides what the runs leave open.
    Raises UsageError without the extra ``consistency`` (cvxpy and clarabel), SolverError when the solver fails.
    """
    members, base = bodies(fitted), fitted.base
    inside = np.zeros(len(fitted.physics), bool)
    for body in members:
        inside[body.members] = True
    grouping = base.grouping()
    of_bodies = np.flatnonzero(np.any(grouping[:, inside] != 0.0, axis=1))
    known = {e.name for e in estimates(fitted) if e.identifiable}
    determined = np.array([fitted.model.names[int(i)] in known for i in base.independent[of_bodies]], bool)
    problem = _Completing(fitted, members, guess, np.flatnonzero(inside), of_bodies)
    moved: tuple[str, float] | None = None
    try:
        standard, distance = problem.solved(of_bodies[determined])
    except SolverError:  # no bodies that can exist have these values
        standard, distance = problem.solved(of_bodies[:0])
    chosen = of_bodies[determined]
    value, estimate = grouping[chosen] @ standard, fitted.theta[base.independent[chosen]]
    words = [base.describe(int(k)) for k in chosen]
    sigma = np.sqrt(np.diag(fitted.covariance))[base.independent[chosen]]
    off = np.abs(value - estimate) / sigma
    if off.size and np.max(off) > 1e-6:
        moved = words[int(np.argmax(off))], float(np.max(off))
    return Completion(
        {body.name: body.to_ten @ standard for body in members},
        dict(zip(words, value.tolist(), strict=True)),
        dict(zip(words, estimate.tolist(), strict=True)),
        moved,
        distance,
    )


class _Completing:
    """The convex problem: misfit of base parameters that are not held, and divergence from the guess.

    Unknowns are the bodies' standard parameters, in units of their plausible size.
    """

    def __init__(
        self, fitted: Fit, members: Sequence[Body], guess: Mapping[str, Array], inside: NDArray[np.intp],
        of_bodies: NDArray[np.intp],
    ):  # fmt: skip
        self.fitted, self.members, self.inside, self.of_bodies = fitted, members, inside, of_bodies
        self.cp = convex_solver()
        self.size = np.array([q.prior for q in fitted.model.parameters[: len(fitted.physics)]])
        # Base values by the bodies' parameters in units of their size.
        self.grouping = fitted.base.grouping()[np.ix_(of_bodies, inside)] * self.size[inside]
        self.estimate = fitted.theta[fitted.base.independent[of_bodies]]
        self.root = Information.of(fitted).root[:, of_bodies]
        self.guess = np.zeros(len(fitted.physics))
        for body in members:
            self.guess[body.members] = np.linalg.lstsq(body.to_ten[:, body.members], guess[body.name], rcond=None)[0]

    def solved(self, held: NDArray[np.intp]) -> tuple[Array, float]:
        """All standard parameters (p,), those of `held` base parameters exact; distance from the estimate [σ].

        Raises SolverError when no bodies that can exist have the values held.
        """
        cp, at = self.cp, np.searchsorted(self.of_bodies, held)
        start = self.guess[self.inside] / self.size[self.inside]
        free = np.eye(len(start))
        if len(at):
            rows = self.grouping[at]
            start = start + np.linalg.pinv(rows) @ (self.estimate[at] - rows @ start)
            free = np.asarray(scipy.linalg.null_space(rows), float)
        z = cp.Variable(free.shape[1])
        slope, rest = self.root @ self.grouping @ free, self.root @ (self.grouping @ start - self.estimate)
        # The misfit as a triangle: its norm is the same, with no more rows than unknowns.
        triangle = np.asarray(np.linalg.qr(np.column_stack([slope, rest]), mode="r"), float)
        cost = [0.5 * cp.sum_squares(triangle[:, :-1] @ z + triangle[:, -1])]
        for body in self.members:
            table = body.matrices()[self.inside] * self.size[self.inside, None, None]
            likely = in_units(pseudo_inertia(body.to_ten @ self.guess), body.mass, body.length)
            half = np.linalg.cholesky(np.linalg.inv(likely))
            table = half.T @ table @ half  # the guess is the unit matrix
            fixed, moving = np.tensordot(start, table, 1), np.tensordot(free.T, table, 1)
            if np.max(np.abs(moving), initial=0.0) < 1e-9 * np.max(np.abs(fixed)):
                if np.linalg.eigvalsh(fixed)[0] <= 0.0:
                    raise SolverError(f"no body that can exist has the values identified for {body.name}")
                continue
            flat = moving.reshape(len(moving), 16).T @ z + fixed.reshape(16)
            J = cp.reshape(flat, (4, 4), order="C")
            cost.append(cp.trace(J) - cp.log_det(0.5 * (J + J.T)))
        value = self._minimum(cp.Problem(cp.Minimize(cp.sum(cost))), z)
        scaled = start + free @ value
        out = self.fitted.physics.copy()
        out[self.inside] = scaled * self.size[self.inside]
        for body in self.members:
            if np.linalg.eigvalsh(np.tensordot(out, body.matrices(), 1))[0] <= 0.0:
                raise SolverError(f"no body that can exist was found for {body.name}")
        return out, float(np.linalg.norm(triangle[:, :-1] @ value + triangle[:, -1]))

    def _minimum(self, problem: Any, z: Any) -> Array:
        cp = self.cp
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate solution is judged by the bodies it gives
            try:
                problem.solve(solver=cp.CLARABEL)
            except cp.error.SolverError as cause:
                raise SolverError(f"the solver Clarabel failed on the full parameters: {cause}") from None
        found = z.value
        if found is None:
            raise SolverError("no bodies that can exist have the values identified")
        return np.asarray(found, float)
