"""Delays of whole instruments, and of kinds of their columns, behind each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.validation.channels.evidence import reach
from lacet.identify.validation.channels.fault_columns import ANY_DELAY, LATE, FaultColumns, jackknife

_LEAST = 1e-6
"""Least spread of a delay [s]: less is rounding."""


@dataclass(frozen=True)
class DelayEstimate:
    """Estimate of the delay of kinds of columns beyond the rig's, behind those that agree with each other.

    Attributes
    ----------
    kinds : all kinds of an instrument's columns, or one kind alone.
    delay, spread : value and 1 σ [s].
    noise : part of the sheet's noise in what the delay changes; where it is not small, it makes the estimate smaller.
    """

    kinds: tuple[str, ...]
    delay: float
    spread: float
    noise: float


def instrument_delays(products: FaultColumns) -> list[DelayEstimate]:
    """Delay of every instrument, all its columns alike, all together beside the laws' parameters.

    A delay that all have in common changes nothing: the most numerous that agree with each other are taken to be as the
    rig says, of equally many those with the wheel loads. One that the runs do not show is near 0 in every block, and
    has the spread of what is known beforehand.
    """
    several = products.instruments
    alone = np.eye(len(products.kinds), dtype=bool)[~several.any(axis=0)]
    return _estimates(products, np.concatenate([several, alone]), products.precision)


def kind_delays(products: FaultColumns) -> list[DelayEstimate]:
    """The same for every kind of columns by itself."""
    precision, delays = products.precision.copy(), np.flatnonzero(products.are_delays)
    precision[np.ix_(delays, delays)] = np.eye(delays.size) / ANY_DELAY**2
    return _estimates(products, np.eye(delays.size, dtype=bool), precision)


def _estimates(products: FaultColumns, members: NDArray[np.bool_], precision: Array) -> list[DelayEstimate]:
    """Estimates of the mean delays of (g, k) groups of the kinds of columns."""
    if not len(members):
        return []
    means = members / members.sum(axis=1, keepdims=True)
    found, known = _joint(products.whole, precision, means)
    blocks = np.stack([_joint(part, precision, means)[0] for part in products.left_out])
    misfit, count = max(1.0, products.misfit_beside(precision) ** 0.5), len(means)

    def spread(contrasts: Array) -> Array:
        by_noise = np.sqrt(np.maximum(0.0, np.sum(contrasts @ known * contrasts, axis=1)))
        return np.maximum(jackknife(blocks @ contrasts.T), misfit * by_noise)

    pairs = np.eye(count)[:, None] - np.eye(count)
    apart = spread(pairs.reshape(-1, count)).reshape(count, count)
    alike = (np.abs(pairs @ found) < 0.5 * LATE) & (reach(products.block_count) * apart < LATE)
    agree = alike[int(np.argmax(alike.sum(axis=1)))]
    behind = np.eye(count) - agree / max(1, np.count_nonzero(agree))
    sigma = spread(behind)
    shown = np.maximum(0.0, (misfit / np.maximum(sigma, _LEAST)) ** 2 - ANY_DELAY**-2)
    part = np.divide(members @ products.noise_of_delays, shown, out=np.ones(count), where=shown > 0.0)
    names = [tuple(kind for kind, has in zip(products.kinds, row, strict=True) if has) for row in members]
    each = zip(names, (behind @ found).tolist(), sigma.tolist(), part.tolist(), strict=True)
    return [DelayEstimate(*values) for values in each]


def _joint(gram: Array, precision: Array, means: Array) -> tuple[Array, Array]:
    """(g,) mean delays of the groups `means` (g, k) [s], and (g, g) their covariance by noise and priors alone [s²]."""
    q = len(precision)
    nuisance = gram[:q, :q] + precision
    size = 1.0 / np.sqrt(np.diag(nuisance))
    first = q - means.shape[1]
    to_means = np.concatenate([np.zeros((first, len(means))), means.T]) * size[:, None]
    scaled = nuisance * size * size[:, None]
    solved = np.linalg.solve(scaled, np.column_stack([size * gram[:q, -1], to_means]))
    return to_means.T @ solved[:, 0], to_means.T @ solved[:, 1:]
