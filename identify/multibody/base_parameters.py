"""Base parameters: the linear combinations of parameters that a set of equations determines (Gautier, 1991)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BaseParameters:
    """Grouping of standard parameters into base parameters.

    Attributes
    ----------
    names : all standard parameters, in the order of the columns.
    independent : indices of the columns kept: one base parameter each, named after it.
    dependent : indices of the columns grouped into kept ones.
    absent : indices of the columns without any effect.
    relations : (b, d): base parameter i = X[independent[i]] + Σ_k relations[i, k] X[dependent[k]].
    gap : smallest kept ÷ largest dropped pivot (∞ when none was dropped): how clearly the rank is determined.
    """

    names: tuple[str, ...]
    independent: NDArray[np.int64]
    dependent: NDArray[np.int64]
    absent: NDArray[np.int64]
    relations: Array
    gap: float

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    def __len__(self) -> int:
        return self.rank

    def grouping(self) -> Array:
        """(b, p) matrix that maps standard parameters to base parameters."""
        out = np.zeros((self.rank, len(self.names)))
        out[np.arange(self.rank), self.independent] = 1.0
        out[:, self.dependent] = self.relations
        return out

    def describe(self, i: int, tolerance: float = 1e-7) -> str:
        """Base parameter `i` in numbers, e.g. ``XX6 + YY7 - 0.45 MX8``."""
        terms = [self.names[int(self.independent[i])]]
        for k, factor in enumerate(self.relations[i]):
            if abs(factor) > tolerance:
                size = f"{abs(factor):.6g} ".removeprefix("1 ")
                terms.append(f"{'+' if factor > 0 else '-'} {size}{self.names[int(self.dependent[k])]}")
        return " ".join(terms)


def find_base(W: Array, names: Sequence[str], tolerance: float = 1e-8) -> BaseParameters:
    """The base parameters of an observation matrix, by grouping its dependent columns.

    Columns are processed in their own order: one is kept when its part orthogonal to those before it is larger than
    `tolerance` times its length, so that names stay those of the first bodies and are the same in every run.

    Parameters
    ----------
    W : (rows, p), or the R factor of it.
    names : p names.
    """
    table = np.asarray(W, float)
    if table.shape[0] > table.shape[1]:
        table = np.asarray(scipy.linalg.qr(table, mode="r")[0], float)[: table.shape[1]]
    lengths = np.linalg.norm(table, axis=0)
    largest = float(np.max(lengths, initial=0.0))
    absent = np.flatnonzero(lengths <= 1e-12 * largest)
    present = np.flatnonzero(lengths > 1e-12 * largest)
    unit_columns = table[:, present] / lengths[present]
    kept: list[int] = []
    basis = np.empty((table.shape[0], len(present)))
    kept_pivot, dropped_pivot = np.inf, 0.0
    for k in range(len(present)):
        rest = unit_columns[:, k]
        known = basis[:, : len(kept)]
        for _ in range(2):  # twice is enough (Kahan and Parlett)
            rest = rest - known @ (known.T @ rest)
        pivot = float(np.linalg.norm(rest))
        if pivot > tolerance:
            basis[:, len(kept)] = rest / pivot
            kept.append(k)
            kept_pivot = min(kept_pivot, pivot)
        else:
            dropped_pivot = max(dropped_pivot, pivot)
    dropped = [k for k in range(len(present)) if k not in set(kept)]
    relations = np.zeros((len(kept), len(dropped)))
    if kept and dropped:
        relations, _ = combine(table, present[kept], present[dropped])
        relations[np.abs(relations) < 1e-9] = 0.0
    return BaseParameters(
        tuple(names),
        present[kept],
        present[dropped],
        absent,
        relations,
        kept_pivot / dropped_pivot if dropped_pivot > 0 else np.inf,
    )


def combine(W: Array, kept: NDArray[np.int64], dropped: NDArray[np.int64]) -> tuple[Array, float]:
    """Columns `dropped` as combinations of columns `kept`, (b, d), and the largest relative residual of one of them."""
    lengths = np.linalg.norm(W, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    both = np.concatenate([kept, dropped])
    b = len(kept)
    triangle = np.asarray(scipy.linalg.qr(W[:, both] / lengths[both], mode="r")[0], float)
    solution = np.asarray(scipy.linalg.solve_triangular(triangle[:b, :b], triangle[:b, b:]), float)
    residual = float(np.max(np.linalg.norm(triangle[b:, b:], axis=0), initial=0.0))
    return solution * lengths[dropped] / lengths[kept][:, None], residual
