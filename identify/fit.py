"""Weighted least squares over several runs, with weights by row to a fixed point and sensor zeros as priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from daq.errors import NotIdentifiable
from identify.base import BaseParameters, find_base
from identify.drive import Drive
from identify.effect import Effect, Parameter
from identify.filters import derivative
from identify.model import Model
from identify.reconstruct import Recording, Signals
from identify.rows import ROWS
from identify.sensitivity import Sensitivity
from identify.stats import clustered_scores, hac
from identify.vectors import Array
from identify.zeros import Zeros, zeros_of

NOISE_DRAWS = 6
"""Pairs of noise draws behind the correction of bias; what their number leaves uncertain is in the intervals."""


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : what was fitted.
    drives : the runs used, sensor faults of the model taken out.
    base : grouping of the model's parameters into what the runs' equations depend on at all.
    theta : (p,) every parameter; those grouped into others are zero.
    covariance : (p, p) of `theta`: serial and cross-row correlation (HAC), zeros' priors included.
    covariance_iid : the same as if residuals were independent, as the paper's sxr % has it.
    sigma : row → weight's σ [N or N·m].
    residual : for each drive, row → (n,) Y − W θ − zeros, after filter and decimation.
    zeros : for each drive, names, values and priors of its sensor zeros.
    sensitivities : for each drive, how its residual answers to its channels.
    correction : (p,) what was added to take out the bias of noise in the regressors.
    """

    model: Model
    drives: tuple[Drive, ...]
    base: BaseParameters
    theta: Array
    covariance: Array
    covariance_iid: Array
    sigma: Mapping[str, float]
    residual: tuple[Mapping[str, Array], ...]
    zeros: tuple[tuple[Zeros, Array], ...]
    sensitivities: tuple[Sensitivity, ...]
    correction: Array

    @property
    def physics(self) -> Array:
        """Values of the physics' parameters, without those of sensor faults."""
        return self.theta[: sum(len(e.parameters) for e in self.model.physics)]

    @property
    def rows(self) -> tuple[str, ...]:
        """Rows that any run has, in the order of reports."""
        return tuple(row for row in ROWS if any(row in drive.rows for drive in self.drives))

    def value(self, name: str) -> float:
        """A parameter by name."""
        return float(self.theta[self.model.names.index(name)])


def fit(
    model: Model,
    drives: Sequence[Drive],
    weights: Mapping[str, float] | None = None,
    zeros: bool = True,
    unbias: bool = True,
) -> Fit:
    """Fit a model to runs.

    Parameters
    ----------
    model : what to fit.
    drives : the runs used.
    weights : σ of each row, frozen (noise-floor weights); by default from the residual, to a fixed point.
    zeros : estimate each run's sensor zeros with the sheet's σ as prior.
    unbias : take out the bias that the sheet's noise in the regressors brings (errors in variables).

    Raises NotIdentifiable when no run has a row, or the model no parameter that acts on one.
    """
    corrected = tuple(drives)
    faults = np.zeros(len(model.faults))
    bounds = [(q.low, q.high) for fault in model.faults for q in fault.parameters]
    low, high = np.array(bounds).reshape(-1, 2).T
    out = _fit_linear(model, corrected, weights, zeros, unbias)
    # A sensor fault is linear only for small values: take out what was found and look again.
    for _ in range(4 if model.faults else 0):
        step = out.theta[out.theta.size - faults.size :]
        faults = np.clip(faults + step, low, high)
        corrected = tuple(Drive(_corrected(drive.recording, model, faults)) for drive in drives)
        out = _fit_linear(model, corrected, weights, zeros, unbias)
        if np.all(np.abs(step) < 1e-3 * np.abs(faults)):
            break
    if model.faults:
        theta = out.theta.copy()
        theta[theta.size - faults.size :] += faults
        out = replace(out, theta=theta)
    return out


def _fit_linear(
    model: Model, drives: tuple[Drive, ...], weights: Mapping[str, float] | None, zeros: bool, unbias: bool
) -> Fit:
    effects = model.physics
    p = sum(len(effect.parameters) for effect in effects)
    rows = [row for row in ROWS if any(row in drive.rows for drive in drives)]
    if not rows:
        reasons = sorted({why for drive in drives for why in drive.motion.left_out.values()})
        raise NotIdentifiable("no row of the equations is measured in these runs: " + "; ".join(reasons))
    blocks = {(d, row): drive.matrix(effects, row) for d, drive in enumerate(drives) for row in drive.rows}
    left = {(d, row): drive.measured[row] for d, drive in enumerate(drives) for row in drive.rows}
    scale = {row: _rms(np.concatenate([y for (_, r), y in left.items() if r == row])) or 1.0 for row in rows}
    stacked = _triangle(np.concatenate([W / scale[row] for (_, row), W in blocks.items()]))
    base = find_base(stacked, [q.name for effect in effects for q in effect.parameters])
    if not base.rank:
        raise NotIdentifiable("no parameter of the model acts on the rows measured in these runs")
    keep = base.independent
    known = _known_beforehand([q for effect in effects for q in effect.parameters], keep)
    problem = _Problem({k: W[:, keep] for k, W in blocks.items()}, left, known, rows)
    theta, sigma = problem.solve(weights, scale)
    full = np.zeros(p)
    full[keep] = theta
    sensitivities: tuple[Sensitivity, ...] = ()
    nuisance: tuple[Zeros, ...] = ()
    if zeros or model.faults:
        sensitivities = tuple(Sensitivity.of(drive.recording, effects, full) for drive in drives)
        nuisance = tuple(zeros_of(d, s) for d, s in zip(drives, sensitivities, strict=True)) if zeros else ()
        problem = problem.with_faults(model, drives, sensitivities).with_zeros(nuisance)
        theta, sigma = problem.solve(weights, scale, start=sigma)
    bias, doubt = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    if unbias:
        bias, doubt = problem.bias(drives, effects, keep, theta, sigma)
        theta = theta - bias
    return _result(model, drives, base, problem, theta, sigma, nuisance, sensitivities, p, bias, doubt)


class _Problem:
    """Blocks of the equations by run and row; what is known beforehand are equations with σ = 1 and right side 0."""

    def __init__(
        self, blocks: dict[tuple[int, str], Array], left: dict[tuple[int, str], Array], known: Array, rows: list[str]
    ):
        self.blocks, self.left, self.known, self.rows = blocks, left, known, rows
        # One triangle a row: weights can then be iterated without touching the samples again.
        self.triangles = {
            row: np.concatenate([_narrow(W, left[key]) for key, W in blocks.items() if key[1] == row]) for row in rows
        }
        self.counts = {row: sum(len(y) for key, y in left.items() if key[1] == row) for row in rows}

    def with_faults(self, model: Model, drives: Sequence[Drive], sensitivities: Sequence[Sensitivity]) -> _Problem:
        """The same with the columns of the model's sensor faults."""
        if not model.faults:
            return self
        blocks: dict[tuple[int, str], Array] = {}
        for (d, row), W in self.blocks.items():
            columns: list[Array] = []
            for fault in model.faults:
                found = drives[d].decimated(sensitivities[d].fault(fault))
                columns.append(found.get(row, np.zeros(len(W))))
            blocks[d, row] = np.column_stack([W, *columns])
        prior = np.array([q.prior for fault in model.faults for q in fault.parameters])
        return _Problem(blocks, self.left, _beside(self.known, np.diag(1.0 / prior)), self.rows)

    def with_zeros(self, zeros: Sequence[Zeros]) -> _Problem:
        """The same with each run's zeros, side by side."""
        if not zeros:
            return self
        starts = np.concatenate([[0], np.cumsum([len(z.names) for z in zeros])]).astype(int)
        blocks: dict[tuple[int, str], Array] = {}
        for (d, row), W in self.blocks.items():
            wide = np.zeros((len(W), starts[-1]))
            wide[:, starts[d] : starts[d + 1]] = zeros[d].columns[row]
            blocks[d, row] = np.column_stack([W, wide])
        prior = np.concatenate([z.sigma for z in zeros])
        return _Problem(blocks, self.left, _beside(self.known, np.diag(1.0 / prior)), self.rows)

    def solve(
        self, weights: Mapping[str, float] | None, scale: Mapping[str, float], start: Mapping[str, float] | None = None
    ) -> tuple[Array, dict[str, float]]:
        """Parameters and row σ: with frozen weights at once, else iterated to a fixed point."""
        sigma = dict(start or scale)
        if weights is not None:
            sigma = {row: weights.get(row, scale[row]) for row in self.rows}
            return self._solve(sigma), sigma
        theta = self._solve(sigma)
        squares = {row: R.T @ R for row, R in self.triangles.items()}
        for _ in range(50):
            before = dict(sigma)
            for row in self.rows:
                R = self.triangles[row]
                left = R[:, :-1] @ theta - R[:, -1]
                sigma[row] = max(float(np.linalg.norm(left)) / np.sqrt(self.counts[row]), 1e-10 * scale[row])
            if all(abs(sigma[row] - before[row]) < 1e-4 * sigma[row] for row in self.rows):
                break
            theta = self._solve_normal(squares, sigma)
        return self._solve(sigma), sigma

    def _solve(self, sigma: Mapping[str, float]) -> Array:
        stacked = self.stacked(sigma)
        lengths = np.linalg.norm(stacked[:, :-1], axis=0)
        triangle = _triangle(stacked / np.append(lengths, 1.0))
        p = self.known.shape[1]
        return np.asarray(scipy.linalg.solve_triangular(triangle[:p, :p], triangle[:p, p]), float) / lengths

    def _solve_normal(self, squares: Mapping[str, Array], sigma: Mapping[str, float]) -> Array:
        """Quick, by normal equations: good enough to iterate the weights, which need three digits."""
        total: Array = np.sum([square / sigma[row] ** 2 for row, square in squares.items()], axis=0)
        A = total[:-1, :-1] + self.known.T @ self.known
        lengths = np.sqrt(np.diag(A))
        right: Array = total[:-1, -1] / lengths
        return np.linalg.solve(A / np.outer(lengths, lengths), right) / lengths

    def stacked(self, sigma: Mapping[str, float]) -> Array:
        """Weighted triangles of all rows over what is known beforehand, right-hand side last."""
        known = np.column_stack([self.known, np.zeros(len(self.known))])
        return np.concatenate([*(self.triangles[row] / sigma[row] for row in self.rows), known])

    def bias(
        self,
        drives: Sequence[Drive],
        effects: Sequence[Effect],
        keep: NDArray[np.int64],
        theta: Array,
        sigma: Mapping[str, float],
    ) -> tuple[Array, Array]:
        """What noise in the regressors does to the estimate: Monte-Carlo corrected scores (Novick and Stefanski, 2002).

        At the true θ the scores Wᵀ r have the mean E[δWᵀ δr] instead of zero. One draw of noise added and the same draw
        subtracted leave just that product, and the sum over the samples is its mean.

        Returns the bias, and the covariance that the finite number of draws leaves in it.
        """
        p, width = len(keep), len(theta)
        # E[δWᵀ δr] = constant − slope θ; what multiplies the zeros is not measured, and cancels between the two signs.
        slopes, constants = np.zeros((NOISE_DRAWS, p, p)), np.zeros((NOISE_DRAWS, p))
        for d, drive in enumerate(drives):
            for draw in range(NOISE_DRAWS):
                for sign in (1, -1):
                    noisy = drive.noisy(draw, sign, [2002, d, draw])
                    for row in drive.rows:
                        scale = 0.5 / sigma[row] ** 2
                        plain, moved = self.blocks[d, row][:, :p], noisy.matrix(effects, row)[:, keep]
                        slopes[draw] += scale * (moved.T @ moved - plain.T @ plain)
                        constants[draw] += scale * (moved.T @ noisy.measured[row] - plain.T @ self.left[d, row])
                    noisy.forget_motion()
        slope, constant = np.zeros((width, width)), np.zeros(width)
        slope[:p, :p], constant[:p] = slopes.mean(axis=0), constants.mean(axis=0)
        stacked = self.stacked(sigma)[:, :-1]
        lengths = np.linalg.norm(stacked, axis=0)
        triangle = _triangle(stacked / lengths)[:width]
        # In coordinates where the normal matrix is the identity, the corrected equations are (I − S) x = x₀ − k.
        solved = np.asarray(scipy.linalg.solve_triangular(triangle, np.eye(width)), float)
        inverse: Array = solved / lengths[:, None]
        x0, k = triangle @ (lengths * theta), inverse.T @ constant
        spectrum = np.linalg.eigh(inverse.T @ (0.5 * (slope + slope.T)) @ inverse)
        part, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
        # Where noise makes up most of what a direction seems to know, there is nothing to correct.
        sound = part < 0.5
        growth = np.asarray(np.where(sound, 1.0 / np.where(sound, 1.0 - part, 1.0), 0.0), float)
        x = np.asarray(np.where(sound, growth * (V.T @ (x0 - k)), V.T @ x0), float)
        corrected = inverse @ (V @ x)
        scores = np.zeros((NOISE_DRAWS, width))
        scores[:, :p] = constants - slopes @ corrected[:p]
        scatter = (scores - scores.mean(axis=0)) @ (inverse @ (V * growth) @ V.T).T
        return theta - corrected, scatter.T @ scatter / (NOISE_DRAWS * (NOISE_DRAWS - 1))

    def residual(self, theta: Array) -> dict[tuple[int, str], Array]:
        """Y − W θ of every block."""
        return {key: self.left[key] - W @ theta for key, W in self.blocks.items()}


def _result(
    model: Model, drives: tuple[Drive, ...], base: BaseParameters, problem: _Problem, theta: Array,
    sigma: Mapping[str, float], nuisance: tuple[Zeros, ...], sensitivities: tuple[Sensitivity, ...], p: int,
    bias: Array, doubt: Array,
) -> Fit:  # fmt: skip
    residual = problem.residual(theta)
    stacked = problem.stacked(sigma)[:, :-1]
    lengths = np.linalg.norm(stacked, axis=0)
    triangle = _triangle(stacked / lengths)[: len(theta)]
    inverse = np.asarray(scipy.linalg.solve_triangular(triangle, np.eye(len(theta)))) / lengths[:, None]
    iid = inverse @ inverse.T
    spread = problem.known.T @ problem.known
    for d, drive in enumerate(drives):
        comb = np.arange(drive.recording.t.size // drive.recording.filters.step + 1)
        scores = clustered_scores(
            {row: (problem.blocks[d, row], residual[d, row], sigma[row]) for row in drive.rows},
            {row: drive.index[row] // drive.recording.filters.step for row in drive.rows},
            comb.size,
        )
        spread += hac(scores)
    robust = iid @ spread @ iid + doubt
    fitted = len(base.independent)
    total = p + len(model.faults)
    place = np.concatenate([base.independent, np.arange(p, total)]).astype(int)
    picked = np.arange(fitted + len(model.faults))
    full = np.zeros(total)
    full[place] = theta[picked]
    shift = np.zeros(total)
    shift[place] = -bias[picked]
    covariance, covariance_iid = np.zeros((total, total)), np.zeros((total, total))
    covariance[np.ix_(place, place)] = robust[np.ix_(picked, picked)]
    covariance_iid[np.ix_(place, place)] = iid[np.ix_(picked, picked)]
    rest = theta[len(picked) :]
    ends = np.cumsum([len(z.names) for z in nuisance])
    zeros = tuple((z, part) for z, part in zip(nuisance, np.split(rest, ends[:-1]), strict=True)) if nuisance else ()
    return Fit(
        model, drives, base, full, covariance, covariance_iid, dict(sigma),
        tuple({row: residual[d, row] for row in drive.rows} for d, drive in enumerate(drives)), zeros, sensitivities,
        shift,
    )  # fmt: skip


def corrected_drive(drive: Drive, fitted: Fit) -> Drive:
    """A run with the sensor faults of a fitted model taken out; the run itself when the model has none."""
    if not fitted.model.faults:
        return drive
    return Drive(_corrected(drive.recording, fitted.model, fitted.theta[len(fitted.physics) :]))


def _corrected(recording: Recording, model: Model, values: Array) -> Recording:
    """A recording with sensor faults of these sizes taken out."""
    rate = recording.filters.rate
    channels = dict(recording.signals.value)
    derived = Signals.differentiated(channels, rate)
    for fault, p in zip(model.faults, values, strict=True):
        for channel in fault.channels():
            if channel in channels:
                slope = derived.rate.get(channel)
                if slope is None:
                    slope = derivative(channels[channel], rate)
                channels[channel] = fault.correct(channel, channels[channel], slope, float(p), rate)
    return recording.with_signals(Signals.differentiated(channels, rate))


def _triangle(W: Array) -> Array:
    """The R factor, square even when there are fewer rows than columns."""
    triangle = np.asarray(scipy.linalg.qr(W, mode="r", check_finite=True)[0], float)[: W.shape[1]]
    lacking = W.shape[1] - triangle.shape[0]
    return np.concatenate([triangle, np.zeros((lacking, W.shape[1]))]) if lacking else triangle


def _known_beforehand(parameters: Sequence[Parameter], keep: NDArray[np.int64]) -> Array:
    """Equations in the parameters kept: each within what is plausible, and left and right parts of one kind alike."""
    kept = [parameters[int(i)] for i in keep]
    names = [q.name for q in kept]
    lines = [np.diag([1.0 / q.prior for q in kept])]
    for i, q in enumerate(kept):
        if q.twin in names:
            line = np.zeros((1, len(kept)))
            line[0, i], line[0, names.index(q.twin)] = 1.0 / q.twin_sigma, -1.0 / q.twin_sigma
            lines.append(line)
    return np.concatenate(lines)


def _beside(a: Array, b: Array) -> Array:
    """Two sets of equations in different parameters, as one."""
    out = np.zeros((a.shape[0] + b.shape[0], a.shape[1] + b.shape[1]))
    out[: a.shape[0], : a.shape[1]] = a
    out[a.shape[0] :, a.shape[1] :] = b
    return out


def _narrow(W: Array, y: Array) -> Array:
    """The R factor of [W y], spread out again over the columns of W that are all zero (other runs' sensor zeros)."""
    active = np.append(np.flatnonzero(np.any(W != 0.0, axis=0)), W.shape[1])
    out = np.zeros((len(active), W.shape[1] + 1))
    out[:, active] = _triangle(np.column_stack([W, y])[:, active])
    return out


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
