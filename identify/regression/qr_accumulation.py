"""The R factor of a least-squares problem, and the weighted equations of several runs accumulated as such factors.

An R factor holds all that its equations say, in a square, however many equations there were. Factors of parts are
merged by stacking them and factorising again, exactly: that is how chunks of a run, and runs, add up (Golub and Van
Loan, Matrix Computations, section 5.3). Each run has one factor a row, its sensor zeros eliminated: memory grows
neither with the length of runs nor, beyond a small square a run, with their number. Weights by row can be iterated
without touching the samples again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np
import scipy

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sums.tree import merged


def triangle(part: Array, *others: Array) -> Array:
    """R factor (k, k) of parts stacked over each other, filled with zeros where there are fewer than k rows."""
    stacked = np.concatenate([part, *others]) if others else part
    width = stacked.shape[1]
    R = np.asarray(scipy.linalg.qr(stacked, mode="r")[0], float)[:width]
    lacking = width - R.shape[0]
    return np.concatenate([R, np.zeros((lacking, width))]) if lacking else R


def scaled_triangle(stacked: Array) -> tuple[Array, Array]:
    """R factor of a matrix with its columns scaled to unit length, and their lengths (1 for an empty column)."""
    lengths = np.linalg.norm(stacked, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    return triangle(stacked / lengths), lengths


def orthonormaliser(stacked: Array) -> Array:
    """(q, q) matrix T for which the columns (n, q), or their R factor, times T are nearly orthonormal."""
    R, lengths = scaled_triangle(stacked)
    q = stacked.shape[1]
    return np.asarray(scipy.linalg.solve_triangular(R[:q], np.eye(q)), float) / lengths[:, None]


def narrow_triangle(stacked: Array) -> Array:
    """R factor computed from the columns with any entry only; the others are zero in it."""
    active = np.flatnonzero(np.any(stacked != 0.0, axis=0))
    out = np.zeros((len(active), stacked.shape[1]))
    out[:, active] = triangle(stacked[:, active])
    return out


Key = Any
"""What a row is known by: `Row` of a car, the number of a joint of a chain."""
Weights = Mapping[Key, float]
"""σ of each row [N or N·m]."""
_APART = 1e5
"""Ratio of the rows' largest to smallest σ above which normal equations are too inexact [ratio]."""


@dataclass
class RunEquations:
    """Equations of one run, as an R factor for each row.

    Columns are the run's z zeros, the p parameters, the right side.

    Attributes
    ----------
    zeros : names of the run's zeros; `priors` (z,) their 1 σ.
    triangles : row → R factor of ``[zeros | parameters | right side]``, unweighted.
    counts : row → number of samples.
    """

    zeros: tuple[str, ...]
    priors: Array
    triangles: dict[Key, Array] = field(default_factory=dict[Key, Array])
    counts: dict[Key, int] = field(default_factory=dict[Key, int])
    _squares: dict[Key, Array] = field(default_factory=dict[Key, Array], repr=False)

    def add(self, row: Key, block: Array, right: Array, root_weight: Array | None = None) -> None:
        """Add samples of a row: (n, z + p) columns, (n,) right side, and the square roots of their weights (n,)."""
        stacked = np.column_stack([block, right])
        if root_weight is not None:
            stacked = stacked * root_weight[:, None]
        if row in self.triangles:
            stacked = np.concatenate([self.triangles[row], stacked])
        self.triangles[row] = narrow_triangle(stacked)
        self.counts[row] = self.counts.get(row, 0) + len(right)
        self._squares.pop(row, None)

    def reduced(self, sigma: Weights) -> tuple[Array, Array]:
        """Equations with the zeros eliminated, weighted by `sigma`.

        Returns (z, z + p + 1), the equations that give the zeros from the parameters, and (p + 1, p + 1), the R factor
        of the remaining equations in the parameters and the right side.
        """
        z = len(self.zeros)
        width = next(iter(self.triangles.values())).shape[1]
        prior = np.zeros((z, width))
        prior[:, :z] = np.diag(1.0 / self.priors)
        R, lengths = scaled_triangle(np.concatenate([prior, *(R / sigma[row] for row, R in self.triangles.items())]))
        return R[:z] * lengths, R[z:, z:] * lengths[z:]

    def normal(self, sigma: Weights) -> Array:
        """(z + p + 1, z + p + 1) normal matrix with the zeros' priors: quicker than the R factor, with fewer digits."""
        for row, R in self.triangles.items():
            if row not in self._squares:
                self._squares[row] = R.T @ R
        total: Array = np.sum([square / sigma[row] ** 2 for row, square in self._squares.items()], axis=0)
        z = len(self.zeros)
        total[range(z), range(z)] += 1.0 / self.priors**2
        return total

    def reduced_normal(self, sigma: Weights) -> tuple[Array, Array, Array]:
        """Eliminate the zeros from the normal matrix.

        Returns (p + 1, p + 1) what remains, and (z, p) gain and (z,) shift: at parameters x the zeros are
        shift − gain x. All NaN where the matrix is singular.
        """
        z, normal = len(self.zeros), self.normal(sigma)
        try:
            gain = np.asarray(np.linalg.solve(normal[:z, :z], normal[:z, z:]), float)
        except np.linalg.LinAlgError:
            gain = np.full((z, normal.shape[1] - z), np.nan)
        return normal[z:, z:] - normal[z:, :z] @ gain, gain[:, :-1], gain[:, -1]

    def following(self, sigma: Weights) -> tuple[Array, Array]:
        """(z, p) gain and (z,) shift: at parameters x the zeros are shift − gain x."""
        top, z = self.reduced(sigma)[0], len(self.zeros)
        both = np.asarray(scipy.linalg.solve_triangular(top[:, :z], top[:, z:]), float)
        return both[:, :-1], both[:, -1]

    def squares(self, x: Array, zeros: Array) -> dict[Key, float]:
        """Row → sum of squares of the residual at these parameters and zeros."""
        both = np.concatenate([zeros, x, [-1.0]])
        return {row: float(np.sum((R @ both) ** 2)) for row, R in self.triangles.items()}

    @classmethod
    def merged(cls, parts: Sequence[RunEquations]) -> RunEquations:
        """Equations of several runs without zeros, merged into those of one run."""
        rows = dict.fromkeys(row for part in parts for row in part.triangles)
        return cls(
            (),
            np.zeros(0),
            {row: triangle(*(part.triangles[row] for part in parts if row in part.triangles)) for row in rows},
            {row: sum(part.counts.get(row, 0) for part in parts) for row in rows},
        )


def merged_squares(parts: Sequence[Mapping[Key, float]]) -> dict[Key, float]:
    """Sums of squares of several runs: row → sum over them."""
    return {
        row: sum(part[row] for part in parts if row in part)
        for row in dict.fromkeys(row for part in parts for row in part)
    }


def added(parts: Sequence[Array]) -> Array:
    """Sum of arrays of one shape, in their order."""
    return reduce(np.add, parts)


class WeightedEquations(ABC):
    """Equations of runs in common parameters, each run's zeros eliminated, as sums at given weights.

    Attributes
    ----------
    known : (k, p) prior information as equations with σ = 1 and right side 0.
    rows : the rows of any of the runs.
    """

    known: Array
    rows: Sequence[Key]

    @abstractmethod
    def sample_counts(self) -> Mapping[Key, int]:
        """Number of samples of each row, over all runs."""

    @abstractmethod
    def root(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) R factor of the weighted ``[W | Y]``, priors included, every run's zeros eliminated."""

    @abstractmethod
    def reduced_normal(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) normal matrix of these equations: quicker, fewer digits; NaN where a run's is singular."""

    @abstractmethod
    def squares(self, x: Array, sigma: Weights, quick: bool) -> Mapping[Key, float]:
        """Row → sum of squares at parameters `x` and each run's zeros that belong to them; `quick` : by the normal
        matrix."""

    @property
    def p(self) -> int:
        """Number of parameters."""
        return self.known.shape[1]

    def solve(self, sigma: Weights) -> Array:
        """(p,) least-squares estimate of the parameters with these weights."""
        R, lengths = scaled_triangle(self.root(sigma))
        p = self.p
        return np.asarray(scipy.linalg.solve_triangular(R[:p, :p], R[:p, p]), float) * lengths[p] / lengths[:p]

    def iterate(self, start: Weights, least: Weights, tied: Weights | None = None) -> tuple[Array, dict[Key, float]]:
        """Estimate (p,) and the rows' σ, iterated until σ is the RMS of the residuals; σ is at least `least`.

        `tied` : rows whose σ are in these proportions, with the RMS of their residuals together (`tied_sizes`).
        """
        sigma, counts = dict(start), self.sample_counts()
        for _ in range(50):
            x = self._solve_normal(sigma)
            quick = bool(np.all(np.isfinite(x)))
            if not quick:
                x = self.solve(sigma)
            squares = self.squares(x, sigma, quick)
            before = sigma
            sigma = tied_sizes({row: float(np.sqrt(squares[row] / counts[row])) for row in self.rows}, counts, tied)
            sigma = {row: max(sigma[row], least[row]) for row in self.rows}
            if all(abs(sigma[row] - before[row]) < 1e-4 * sigma[row] for row in self.rows):
                break
        return self.solve(sigma), sigma

    def _solve_normal(self, sigma: Weights) -> Array:
        """(p,) estimate by normal equations, for the iteration of weights, which need three digits; NaN if singular."""
        nothing = np.full(self.p, np.nan)
        if max(sigma.values()) > _APART * min(sigma.values()):
            return nothing
        whole = self.reduced_normal(sigma)
        total, right = whole[:-1, :-1], whole[:-1, -1]
        if not np.all(np.diag(total) > 0.0):
            return nothing
        lengths = np.sqrt(np.diag(total))
        return np.asarray(np.linalg.solve(total / np.outer(lengths, lengths), right / lengths), float) / lengths


@dataclass(frozen=True)
class Equations(WeightedEquations):
    """Equations of several runs in common parameters.

    Attributes
    ----------
    runs : each run's equations.
    known : (k, p) prior information as equations with σ = 1 and right side 0.
    rows : the rows of any of the runs.
    """

    # Nothing sets what is declared above, which a frozen class only reads.
    runs: Sequence[RunEquations]
    known: Array  # pyrefly: ignore[bad-override]
    rows: Sequence[Key]  # pyrefly: ignore[bad-override]

    def sample_counts(self) -> dict[Key, int]:
        """Number of samples of each row, over all runs."""
        return {row: sum(run.counts.get(row, 0) for run in self.runs) for row in self.rows}

    def root(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) R factor of the weighted ``[W | Y]``, priors included, every run's zeros eliminated."""
        return merged([known_root(self.known), *(run.reduced(sigma)[1] for run in self.runs)], merged_triangles)

    def reduced_normal(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) normal matrix of these equations: quicker, fewer digits; NaN where a run's is singular."""
        return merged([known_normal(self.known), *(run.reduced_normal(sigma)[0] for run in self.runs)], added)

    def squares(self, x: Array, sigma: Weights, quick: bool) -> dict[Key, float]:
        """Row → sum of squares at parameters `x` and each run's zeros that belong to them."""
        return merged([squares_at(run, x, sigma, quick) for run in self.runs], merged_squares)

    def zeros(self, x: Array, sigma: Weights) -> list[Array]:
        """Each run's zeros at parameters `x`."""
        return [shift - gain @ x for gain, shift in zeros_following(self.runs, sigma)]


def tied_sizes(sizes: Weights, counts: Mapping[Key, int], tied: Weights | None) -> dict[Key, float]:
    """RMS of rows, of those that are `tied` in these proportions with the mean square over all of them together.

    A row whose left side is small, all of whose terms are in proportion to unknown parameters, must not have a weight
    of its own: parameters near zero leave it a residual near zero, which would count ever more.
    """
    out = dict(sizes)
    rows = [row for row in sizes if tied and row in tied]
    if tied and rows:
        square = sum(counts[row] * (sizes[row] / tied[row]) ** 2 for row in rows) / sum(counts[row] for row in rows)
        out |= {row: tied[row] * float(np.sqrt(square)) for row in rows}
    return out


def squares_at(run: RunEquations, x: Array, sigma: Weights, quick: bool) -> dict[Key, float]:
    """Row → sum of squares of a run at parameters `x` and the zeros that belong to them; `quick` : by the normal
    matrix."""
    gain, shift = run.reduced_normal(sigma)[1:] if quick else run.following(sigma)
    return run.squares(x, shift - gain @ x)


def known_root(known: Array) -> Array:
    """(k, p + 1) prior information as equations, with their right side 0."""
    return np.column_stack([known, np.zeros(len(known))])


def known_normal(known: Array) -> Array:
    """(p + 1, p + 1) normal matrix of the prior information, with its right side 0."""
    whole = known_root(known)
    return whole.T @ whole


def merged_triangles(parts: Sequence[Array]) -> Array:
    """R factor of several R factors, taken as equations."""
    return triangle(*parts)


def zeros_following(runs: Sequence[RunEquations], sigma: Weights) -> list[tuple[Array, Array]]:
    """For each run (z, p) gain and (z,) shift: at parameters x its zeros are shift − gain x."""
    return [run.following(sigma) for run in runs]
