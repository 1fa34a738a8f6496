"""Information of a run on a model's parameters, and the intervals that a fit with it would have.

Information is additive. A run has the normal matrix Wᵀ Σ⁻¹ W and the covariance of the scores Wᵀ Σ⁻¹ r under its
coloured noise, both with the run's own sensor zeros eliminated (Schur complement). Added to those of the runs at hand
and the priors, they give the covariance A⁻¹ S A⁻¹ that the fit would report: only a motion is needed, no measurement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import with_places
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.base_parameters import find_base
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.corrected_scores import given_back
from lacet.identify.regression.model import Model, known_beforehand
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import triangle
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.shape_uncertainty import ConstantChange
from lacet.identify.regression.uncertainty import at_least, clustered_scores, hac
from lacet.identify.regression.wls import Fit, with_constant_changes
from lacet.identify.validation.noise_floor import floor_of

NOISE_DRAWS = 8
"""Draws of the channels' noise behind a run's scores: half-widths are then uncertain by some per cent."""


@dataclass(frozen=True)
class Information:
    """Information of runs on all p parameters of a model, their sensor zeros eliminated, without priors.

    Attributes
    ----------
    normal : (p, p) Wᵀ Σ⁻¹ W.
    scores : (p, p) covariance of Wᵀ Σ⁻¹ r: equal to `normal` for white noise, larger for coloured noise.
    noise : (p, p) the part of `normal` that is noise in the columns; it carries no information.
    root : (k, k) R factor of the weighted columns of the physics' k parameters, from which base parameters follow.
    """

    normal: Array
    scores: Array
    noise: Array
    root: Array

    @classmethod
    def none(cls, model: Model) -> Information:
        """The information of no run."""
        p, k = len(model.parameters), model.physics_size
        return cls(np.zeros((p, p)), np.zeros((p, p)), np.zeros((p, p)), np.zeros((k, k)))

    def __add__(self, other: Information) -> Information:
        normal, scores, noise = self.normal + other.normal, self.scores + other.scores, self.noise + other.noise
        return Information(normal, scores, noise, triangle(self.root, other.root))


@dataclass(frozen=True)
class RunInformation:
    """Information of one run with its sensor zeros still in it, so that its duration can be changed.

    `normal`, `scores` : (p + z, p + z) of the parameters and the run's zeros; `noise` : (p, p) as in `Information`;
    `prior` : (z,) 1 σ of the zeros; `root` : as in `Information`; `seconds` : duration without the filters' transients
    [s]; `edges` : that of the transients [s].
    """

    normal: Array
    scores: Array
    noise: Array
    prior: Array
    root: Array
    seconds: float
    edges: float

    def lasting(self, duration: float | None = None) -> Information:
        """The information of a run of this kind that lasts `duration` [s], by default its own duration.

        The rows grow with the time driven; the zeros' priors do not.
        """
        share = 1.0 if duration is None else max(0.0, duration - self.edges) / self.seconds
        p = len(self.normal) - len(self.prior)
        known = np.zeros(len(self.normal))
        known[p:] = self.prior**-2.0
        normal, scores = share * self.normal + np.diag(known), share * self.scores + np.diag(known)
        if p < len(normal):
            K = np.asarray(scipy.linalg.solve(normal[p:, p:], normal[p:, :p], assume_a="pos"), float)
            out = np.concatenate([np.eye(p), -K]).T
            normal = normal[:p, :p] - normal[:p, p:] @ K
            scores = out @ scores @ out.T
        else:
            normal, scores = normal[:p, :p], scores[:p, :p]
        return Information(_symmetric(normal), _symmetric(scores), share * self.noise, np.sqrt(share) * self.root)


def run_information(
    run: PreparedRun, fitted: Fit, excess: Mapping[Row, float] | None = None, draws: int = NOISE_DRAWS, seed: int = 0
) -> RunInformation:
    """The information of a motion, measured with the rig's sensors, on the parameters of a fitted model.

    Parameters
    ----------
    run : the motion as the sensors would see it without noise, or a measured run of the kind.
    fitted : the model, and the parameter values at which noise is propagated through it.
    excess : row → how far above its noise floor the model's residual is (`residual_excess`); 1 where absent.
    draws, seed : of the channels' noise.
    """
    model = fitted.model
    sensitivity = Sensitivity.of(run.recording, model.physics, fitted.physics)
    zeros = zeros_of(run, sensitivity)
    faults = [run.decimated(sensitivity.fault(fault)) for fault in model.faults]
    rng = np.random.default_rng([seed, draws])
    noise = [run.decimated(sensitivity.noise(rng)) for _ in range(draws)]
    step = run.recording.filters.step
    count = run.recording.t.size // step + 1
    instants: dict[Row, NDArray[np.intp]] = {row: run.index[row] // step for row in run.rows}
    p, z = len(model.parameters), len(zeros.sigma)
    normal, scores = np.zeros((p + z, p + z)), np.zeros((p + z, p + z))
    blocks: dict[Row, Array] = {}
    sigma: dict[Row, float] = {}
    larger = {row: (excess or {}).get(row, 1.0) for row in run.rows}
    roots: list[Array] = []
    for row in run.rows:
        W = run.matrix(model.physics, row)
        beside = [found[row][:, None] if row in found else np.zeros((len(W), 1)) for found in faults]
        blocks[row] = np.concatenate([W, *beside, zeros.columns[row]], axis=1)
        floor = float(np.sqrt(np.mean([np.mean(one[row] ** 2) for one in noise])))
        # A row without noise would get infinite weight; 1e-9 of its size stands for rounding.
        sigma[row] = larger[row] * max(floor, 1e-9 * float(np.max(np.abs(run.measured[row]), initial=1.0)))
        normal += blocks[row].T @ blocks[row] / sigma[row] ** 2
        roots.append(triangle(W / sigma[row]))
    for one in noise:
        parts: dict[Row, tuple[Array, Array, float]] = {
            row: (blocks[row], larger[row] * one[row], sigma[row]) for row in run.rows
        }
        if parts:
            scores += hac(clustered_scores(parts, instants, count)) / draws
    edges = 2.0 * run.recording.filters.edge
    k = model.physics_size
    root = triangle(*roots) if roots else np.zeros((k, k))
    longest = max((len(run.index[row]) for row in run.rows), default=1) * step / run.recording.filters.rate
    return RunInformation(normal, scores, _noise(run, model, sigma, [seed, draws]), zeros.sigma, root, longest, edges)


def _noise(run: PreparedRun, model: Model, sigma: Mapping[Row, float], seed: Sequence[int]) -> Array:
    """(p, p) E[δWᵀ Σ⁻¹ δW] of noise in the columns, estimated by one draw added and subtracted.

    Without that of changes of shape constants (`with_constants`).
    """
    p = len(model.parameters)
    changes = [at.start for effect, at in with_places(model.physics) if isinstance(effect, ConstantChange)]
    out = np.zeros((p, p))
    added, taken = run.noisy(seed)
    k = model.physics_size
    for row in run.rows:
        moved = 0.5 * (added.matrix(model.physics, row) - taken.matrix(model.physics, row)) / sigma[row]
        moved[:, changes] = 0.0
        out[:k, :k] += moved.T @ moved
    return out


def fit_information(fitted: Fit) -> Information:
    """The information of a fit's runs, from the covariances that it reports, without its priors."""
    q, rank = len(fitted.place), fitted.base.rank
    physics = len(fitted.physics)
    equations = known_beforehand(fitted.model, fitted.base.independent)
    known = equations.T @ equations
    R = fitted.root[:q, :q]
    A = R.T @ R
    noise = fitted.moments.slopes.mean(axis=0)
    size = np.sqrt(np.diag(A))
    inverse = np.asarray(scipy.linalg.solve_triangular(triangle(R / size), np.eye(q)), float) / size[:, None]
    found = fitted.covariance[np.ix_(fitted.place, fitted.place)]
    S = A @ (found - given_back(inverse, noise, 1.0 / np.diag(equations)[:q])) @ A
    # Columns grouped into others are combinations of these: W = W_kept G.
    G = np.zeros((q, len(fitted.theta)))
    G[:rank, :physics] = fitted.base.grouping()
    G[rank:, physics:] = np.eye(len(fitted.theta) - physics)
    normal, scores = G.T @ (A - known) @ G, G.T @ (S - known) @ G
    return Information(
        _symmetric(normal), _symmetric(scores), _symmetric(G.T @ noise @ G), triangle((R @ G)[:, :physics])
    )


def with_constants(fitted: Fit) -> tuple[Fit, Information]:
    """The fit with changes of its shape constants as parameters, and the information of its runs on all of them.

    What is not known of a stop's gap is not known of its rate either. The fit itself where it has no such constants.
    Noise in the column of a change is left out: it multiplies a change of zero.
    """
    wider, own = with_constant_changes(fitted), fit_information(fitted)
    if wider is fitted:
        return fitted, own
    places = [wider.model.names.index(name) for name in fitted.model.names]
    found = fit_information(wider)
    noise = np.zeros_like(found.noise)
    noise[np.ix_(places, places)] = own.noise
    return wider, replace(found, noise=noise)


def residual_excess(fitted: Fit, draws: int = NOISE_DRAWS, seed: int = 0) -> dict[Row, float]:
    """Row → the fit's residual ÷ the residual that its runs' sensor noise alone would leave, at least 1.

    A model that lacks an effect, or sensors worse than their sheet, leave the same excess on the next run.
    """
    if not fitted.sensitivities:
        return {}
    floor = floor_of(fitted, draws, seed).sigma
    return {row: max(1.0, fitted.sigma[row] / floor[row]) for row in fitted.sigma if floor.get(row, 0.0) > 0.0}


def predicted(fitted: Fit, information: Information) -> Fit:
    """The fit with the intervals it would have from this information instead of its own runs'.

    Values stay; base parameters and both covariances are those that a fit to such runs would report. Residuals,
    equations and the covariance from the sheet's gains and latencies remain those of its own runs.
    """
    model = fitted.model
    physics = len(fitted.physics)
    names = [q.name for effect in model.physics for q in effect.parameters]
    base = find_base(information.root, names)
    place = np.concatenate([base.independent, np.arange(physics, len(fitted.theta))]).astype(int)
    equations = known_beforehand(model, base.independent)
    known = equations.T @ equations
    iid = _inverse(information.normal[np.ix_(place, place)] + known)
    robust = iid @ (information.scores[np.ix_(place, place)] + known) @ iid
    size = np.sqrt(np.diag(iid))
    factor = np.linalg.cholesky(iid / np.outer(size, size)) if len(size) else iid
    inverse = np.asarray(size[:, None] * factor, float)
    lost = given_back(inverse, information.noise[np.ix_(place, place)], 1.0 / np.diag(equations)[: len(place)])
    covariance, covariance_iid = np.zeros((2, len(fitted.theta), len(fitted.theta)))
    covariance[np.ix_(place, place)] = at_least(_symmetric(robust), iid) + lost
    covariance_iid[np.ix_(place, place)] = iid
    return replace(fitted, base=base, place=place, covariance=covariance, covariance_iid=covariance_iid)


def half_widths(fitted: Fit) -> Array:
    """(p,) half of each parameter's 95 % interval; the plausible range where the runs do not determine it by itself."""
    kept = {int(i) for i in fitted.base.independent} | set(range(len(fitted.physics), len(fitted.theta)))
    sigma = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance)))
    prior = np.array([q.prior for q in fitted.model.parameters])
    return TWO_SIDED_95 * np.where([i in kept for i in range(len(prior))], np.minimum(sigma, prior), prior)


def _inverse(A: Array) -> Array:
    """Inverse of a positive definite matrix whose rows differ much in unit."""
    size = np.sqrt(np.diag(A))
    factor = scipy.linalg.cho_factor(_symmetric(A / np.outer(size, size)))
    inverse = np.asarray(scipy.linalg.cho_solve(factor, np.eye(len(A))), float)
    return _symmetric(inverse) / np.outer(size, size)


def _symmetric(A: Array) -> Array:
    return 0.5 * (A + A.T)
