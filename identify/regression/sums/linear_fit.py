"""The fit of a model from sums over runs: the same steps wherever the runs are, in this process or on other machines.

What a step needs of a run does not depend on the other runs; what it needs of all of them is a sum. The steps: what the
parameters group into, and rough values of them; sensitivities at those, and the rows' weights to a fixed point; robust
weights; the correction for noise in the regressors; the spread of the scores.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.errors import NotIdentifiable
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.multibody.base_parameters import BaseParameters, find_base
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, silent
from lacet.identify.regression.corrected_scores import NOISE_DRAWS, NoiseMoments
from lacet.identify.regression.gauss_newton import FAULT_RULE
from lacet.identify.regression.model import Model, known_beforehand
from lacet.identify.regression.qr_accumulation import (
    Equations,
    RunEquations,
    WeightedEquations,
    scaled_triangle,
    tied_sizes,
    triangle,
)
from lacet.identify.regression.sensitivity import FINE, ROUGH, ExpansionPoint
from lacet.identify.regression.sensor_offsets import PayloadSpread
from lacet.identify.regression.uncertainty import Spread, at_least

_HUBER_TURNS = 6


@dataclass(frozen=True)
class FitOptions:
    """How a model is fitted.

    Attributes
    ----------
    weights : σ of each row [N or N·m], frozen (noise-floor weights); by default from the residual, to a fixed point.
    zeros : estimate each run's sensor offsets with the sheet's σ as prior.
    unbias : remove the bias that the sheet's noise in the regressors brings (errors in variables).
    robust : let seconds with a residual far beyond their row's usual one count less (Huber).
    draws : pairs of noise draws behind `unbias`.
    seeds : number of each run in the seeds of those draws; by default its place among the runs.
    payload : how much the runs' payloads differ; each run then has its own, which is eliminated as its zeros are.
    """

    weights: Mapping[Row, float] | None = None
    zeros: bool = True
    unbias: bool = True
    robust: bool = False
    draws: int = NOISE_DRAWS
    seeds: tuple[int, ...] = ()
    payload: PayloadSpread | None = None


class LinearisedRuns(Protocol):
    """Equations of runs with their sensitivities taken at one set of parameters, as sums."""

    @property
    def equations(self) -> WeightedEquations:
        """The equations in the parameters kept and the model's sensor faults."""
        ...

    def reweighted(self, x: Array, sigma: Mapping[Row, float]) -> Self:
        """The same with robust weights of the samples from the residual at `x`."""
        ...

    def noise_moments(self, sigma: Mapping[Row, float], draws: int, progress: Progress) -> NoiseMoments:
        """What noise in the regressors does, of all runs."""
        ...


L_co = TypeVar("L_co", bound=LinearisedRuns, covariant=True)


class RunSums(Protocol[L_co]):
    """Interface of runs, in this process or elsewhere, by the sums that a fit needs."""

    @property
    def levers(self) -> Mapping[Row, float]:
        """Proportions of the residuals of the body's rows, by the car's geometry (`body_levers`)."""
        ...

    def columns(self) -> RunEquations | None:
        """Equations of all runs in every parameter of the physics, without zeros; None where no run has a row."""
        ...

    def absent_channels(self) -> Collection[str]:
        """Channels that rows of the equations lack in these runs."""
        ...

    def linearised(self, keep: NDArray[np.int64], at: ExpansionPoint | None, known: Array, rows: Sequence[Row]) -> L_co:
        """Equations with sensitivities.

        Parameters
        ----------
        keep : places of the physics' parameters that have columns of their own.
        at : where sensitivities are computed, or None: neither zeros nor sensor faults.
        known : (k, q) what is known of the parameters kept and the sensor faults beforehand.
        rows : the rows any run has.
        """
        ...

    def without_faults(self, values: Array) -> RunSums[L_co]:
        """The runs as recorded, the model's sensor faults removed at these sizes."""
        ...


@dataclass(frozen=True)
class LinearSolution(Generic[L_co]):
    """Solution of the equations linearised at the present values.

    Attributes
    ----------
    base : grouping of the model's parameters.
    runs : the equations, linearised.
    x : (q,) parameters kept, then sensor faults.
    sigma : row → weight's σ.
    root : (q + 1, q + 1) R factor of the weighted ``[W | Y]`` with priors, every run's zeros eliminated.
    correction, doubt : (q,) what was added to `x` for noise in the regressors, and (q, q) covariance of that.
    moments : of the noise in the regressors.
    removed : (f,) sizes of the model's sensor faults that were removed from the runs before.
    """

    base: BaseParameters
    runs: L_co
    x: Array
    sigma: Mapping[Row, float]
    root: Array
    correction: Array
    doubt: Array
    moments: NoiseMoments
    removed: Array


def solve_runs(
    model: Model, runs: RunSums[L_co], options: FitOptions, moments: NoiseMoments | None = None,
    progress: Progress = silent,
) -> LinearSolution[L_co]:  # fmt: skip
    """The fit of a model to runs, its sensor faults linearised anew at their sizes.

    Parameters
    ----------
    model, options : what to fit, and how.
    runs : the runs, as recorded.
    moments : of the noise in the regressors, where they are known from a fit of the same motions.

    Raises NotIdentifiable when no run has a row, or the model no parameter that acts on one.
    """
    biased = replace(options, unbias=False)
    out = solve_linear(model, runs, biased if model.faults else options, moments, progress)
    if not model.faults:
        return out
    corrected, physics = runs, model.physics_size

    def remaining_faults(steps_made: int, faults: Array) -> Array:
        """What a fit to the runs without these faults still finds of them."""
        nonlocal corrected, out
        if steps_made:
            corrected = runs.without_faults(faults)
            out = solve_linear(model, corrected, biased, moments, near=_physics(out, physics))
        return out.x[len(out.base.independent) :]

    # A sensor fault is linear only for small values: remove what was found and re-linearise.
    limits = [(q.low, q.high) for fault in model.faults for q in fault.parameters]
    low, high = np.array(limits).reshape(-1, 2).T
    faults = FAULT_RULE.relinearised(remaining_faults, np.zeros(len(model.faults)), (low, high)).values
    if options.unbias:
        out = solve_linear(model, corrected, options, moments, progress, _physics(out, physics))
    return replace(out, removed=faults)


def _physics(solution: LinearSolution[L_co], size: int) -> Array:
    """(p,) values of the physics' parameters."""
    out, keep = np.zeros(size), solution.base.independent
    out[keep] = solution.x[: len(keep)]
    return out


def solve_linear(
    model: Model, runs: RunSums[L_co], options: FitOptions, known_moments: NoiseMoments | None = None,
    progress: Progress = silent, near: Array | None = None,
) -> LinearSolution[L_co]:  # fmt: skip
    """One linear fit; `near` are values of the physics' parameters that are nearly right already."""
    parameters = [q for effect in model.physics for q in effect.parameters]
    first = runs.columns()
    rows: list[Row] = [] if first is None else [row for row in ROWS if row in first.triangles]
    if first is None or not rows:
        absent = sorted(runs.absent_channels())
        lacking = "; not measured: " + ", ".join(absent) if absent else ""
        raise NotIdentifiable("no row of the equations is measured in these runs" + lacking)
    scale = _row_sizes(first, rows, runs.levers)
    base = find_base(
        triangle(*(R[:, :-1] / scale[row] for row, R in first.triangles.items())), [q.name for q in parameters]
    )
    if not base.rank:
        raise NotIdentifiable("no parameter of the model acts on the rows measured in these runs")
    keep = base.independent
    picked = np.append(keep, len(parameters))
    plain = replace(first, triangles={row: R[:, picked] for row, R in first.triangles.items()})
    least = {row: 1e-10 * scale[row] for row in rows}
    frozen = None if options.weights is None else {row: options.weights.get(row, scale[row]) for row in rows}

    def solution(equations: WeightedEquations, begin: Mapping[Row, float]) -> tuple[Array, Mapping[Row, float]]:
        return (equations.solve(frozen), frozen) if frozen else equations.iterate(begin, least, runs.levers)

    x, begin = solution(Equations([plain], known_beforehand(model, keep, faults=False), rows), scale)
    known = known_beforehand(model, keep)
    need = options.zeros or bool(model.faults)

    def found_at(values: Array, spacing: float) -> tuple[L_co, Array, Mapping[Row, float]]:
        """Equations with sensitivities at these values of the parameters kept, and their solution."""
        at = np.zeros(len(parameters))
        at[keep] = values
        there = runs.linearised(keep, ExpansionPoint(at, spacing) if need else None, known, rows)
        # From the same σ each time: those of data without noise are too small to begin with.
        return there, *solution(there.equations, begin)

    # How the residual answers to the channels depends on the parameters: what is found before the zeros are removed
    # (a laser's half millimetre is a hundred newtons of tyre load) can be off by a tenth, and the noise floor with it.
    again = need and known_moments is None and near is None
    linearised, x, sigma = found_at(x if near is None else near[keep], ROUGH if again else FINE)
    if again:
        linearised, x, sigma = found_at(x[: len(keep)], FINE)
    for _ in range(_HUBER_TURNS - 1 if options.robust else 0):
        linearised = linearised.reweighted(x, sigma)
        x, sigma = solution(linearised.equations, sigma)
    root = linearised.equations.root(sigma)
    correction, doubt = np.zeros(len(x)), np.zeros((len(x), len(x)))
    moments = NoiseMoments.zero(len(x), options.draws)
    if options.unbias:
        moments = known_moments or linearised.noise_moments(sigma, options.draws, progress)
        corrected, doubt = moments.correct(x, root, 1.0 / np.diag(known)[: len(x)])
        x, correction = corrected, corrected - x
    removed = np.zeros(len(model.faults))
    return LinearSolution(base, linearised, x, sigma, root, correction, doubt, moments, removed)


def _row_sizes(runs: RunEquations, rows: Sequence[Row], levers: Mapping[Row, float]) -> dict[Row, float]:
    """RMS of each row's left side, of the body's rows together: the length of the factor's last column."""
    sizes = {row: float(np.sqrt(float(np.sum(runs.triangles[row][:, -1] ** 2)) / runs.counts[row])) for row in rows}
    return {row: size or 1.0 for row, size in tied_sizes(sizes, runs.counts, levers).items()}


@dataclass(frozen=True, repr=False)
class FittedModel:
    """A model with the values of its parameters, and what the runs' sums say of them.

    Attributes
    ----------
    model : what was fitted.
    base : grouping of the model's parameters into what the runs' equations depend on at all.
    theta : (p,) every parameter; those grouped into others are zero.
    covariance : (p, p) of `theta`: serial and cross-row correlation (HAC), zeros' priors included; no narrower than
        `covariance_iid`, and as wide as the prior where the regressors are mostly noise.
    covariance_iid : the same as if residuals were independent, as the paper's sxr % has it.
    covariance_sheet : what the sensor sheet's gains and latencies add to it, which no residual shows.
    sigma : row → weight's σ [N or N·m].
    correction : (p,) what was added to remove the bias of noise in the regressors, from its `moments`.
    place : (q,) where the parameters of the equations stand in `theta`: those kept, then sensor faults.
    root : (q + 1, q + 1) R factor of the weighted ``[W | Y]`` with priors, every run's zeros eliminated.
    options : how it was fitted.
    removed : (f,) sizes of the model's sensor faults that were removed from the runs.
    """

    model: Model
    base: BaseParameters
    theta: Array
    covariance: Array
    covariance_iid: Array
    covariance_sheet: Array
    sigma: Mapping[Row, float]
    correction: Array
    moments: NoiseMoments
    place: NDArray[np.intp]
    root: Array
    options: FitOptions
    removed: Array

    @classmethod
    def of(
        cls, model: Model, options: FitOptions, found: LinearSolution[LinearisedRuns], spread: Spread
    ) -> FittedModel:
        """From a solution, and the spread of the runs' scores there."""
        x, root, known = found.x, found.root, found.runs.equations.known
        R, lengths = scaled_triangle(root[:, :-1])
        inverse = np.asarray(scipy.linalg.solve_triangular(R[: len(x)], np.eye(len(x)))) / lengths[:, None]
        iid = inverse @ inverse.T
        ours = frozenset[tuple[str, str]]().union(*(fault.sheet_entries for fault in model.faults))
        moved = [iid @ push for (what, channel, _), push in spread.sheet.items() if (what, channel) not in ours]
        physics = model.physics_size
        total = physics + len(model.faults)
        place = np.concatenate([found.base.independent, np.arange(physics, total)]).astype(int)

        def square(covariance: Array) -> Array:
            out = np.zeros((total, total))
            out[np.ix_(place, place)] = covariance
            return out

        def line(values: Array) -> Array:
            out = np.zeros(total)
            out[place] = values
            return out

        theta = line(x)
        theta[physics:] += found.removed
        return cls(
            model=model,
            base=found.base,
            theta=theta,
            covariance=square(at_least(iid @ (known.T @ known + spread.scores) @ iid, iid) + found.doubt),
            covariance_iid=square(iid),
            covariance_sheet=square(_outer(moved, len(x))),
            sigma=dict(found.sigma),
            correction=line(found.correction),
            moments=found.moments,
            place=place,
            root=root,
            options=options,
            removed=found.removed,
        )

    @property
    def covariances_searched(self) -> tuple[Array, Array]:
        """`covariance` and `covariance_sheet`; where runs are at hand, with the uncertainty of shape constants."""
        return self.covariance, self.covariance_sheet

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the parameters in the equations, (q,)."""
        return tuple(self.model.names[int(i)] for i in self.place)

    @property
    def solution(self) -> Array:
        """(q,) values of the parameters in the equations; of sensor faults what remains in the runs without them."""
        out = self.theta[self.place]
        out[len(out) - len(self.removed) :] -= self.removed
        return out

    @property
    def physics(self) -> Array:
        """Values of the physics' parameters, without those of sensor faults."""
        return self.theta[: self.model.physics_size]

    def value(self, name: str) -> float:
        """A parameter by name."""
        return float(self.theta[self.model.names.index(name)])


def _outer(moved: Sequence[Array], p: int) -> Array:
    """Σ m mᵀ."""
    return np.einsum("fi,fj->ij", moved, moved) if len(moved) else np.zeros((p, p))
