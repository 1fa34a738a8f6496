"""Tyres that differ between runs.

Where tyre rows fail in all runs although each run alone fulfils them, the tyres are not the same. Each run gets
stiffnesses of its own at all wheels, all other parameters staying common (Chow, Econometrica 28, 1960): what that takes
off is compared with what the rows are above their noise floor. Springs and dampers are not tried: a missing anti-roll
bar is another spring in each run, too, and so is a law that bends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.base import with_places
from lacet.identify.effects.tyres.tyre_stiffness import TyreStiffness
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.score import FAILS, Comparison

CHANGED = 0.1
"""Least difference of a stiffness between runs ÷ its mean for another tyre [share]. Source: a choice; pressures that
are 0.2 bar apart, or a law that the tyre lacks, are worth 5 %."""
EXPLAINS = 0.8
"""Least part of what the rows are above their floor that the differences take away [share]: as much as of a
column in another unit (`channels.evidence`)."""


@dataclass(frozen=True)
class TyreDifference:
    """Tyres that differ between runs.

    Attributes
    ----------
    explained : part of what the rows are above their floor that parameters of each run's own take away [share].
    values : name of a stiffness → run → value in it [N/m].
    """

    explained: float
    values: Mapping[str, Mapping[str, float]]


def tyre_difference(fitted: Fit, scores: Sequence[Comparison]) -> TyreDifference | None:
    """Tyres by whose differences between runs failing rows are fulfilled; None where they are the same.

    `scores` : of the runs used.
    """
    if len(fitted.runs) < 2 or not any(one.ratio > FAILS for part in scores for one in part.scores.values()):
        return None
    x = (fitted.theta - fitted.correction)[fitted.place]  # at which the sum of all scores is zero
    normals = [run.reduced_normal(fitted.sigma)[0] for run in fitted.equations.runs]
    total = np.sum([one[:-1, :-1] for one in normals], axis=0) + fitted.equations.known.T @ fitted.equations.known
    excess, places = _excess(fitted, scores), _places(fitted)
    if excess <= 0.0 or not places.size:
        return None
    fall, each = _of_each_run(normals, total, x, places)
    parameters = {q.name: q for effect in fitted.model.physics for q in effect.parameters}
    own = [parameters[fitted.model.names[int(fitted.place[k])]] for k in places]
    possible = all(q.low <= value <= q.high for q, values in zip(own, each.T, strict=True) for value in values)
    apart = float(np.max(np.ptp(each, axis=0) / np.abs(each.mean(axis=0))))
    if not possible or fall < EXPLAINS * excess or apart < CHANGED:
        return None
    runs = [run.name for run in fitted.runs]
    values = {q.name: dict(zip(runs, of.tolist(), strict=True)) for q, of in zip(own, each.T, strict=True)}
    return TyreDifference(min(1.0, fall / excess), values)


def _places(fitted: Fit) -> NDArray[np.intp]:
    """Places of the tyres' stiffnesses among the unknowns."""
    ours = {k for effect, at in with_places(fitted.model.physics) if effect.name == TyreStiffness.name
            for k in range(at.start, at.stop)}  # fmt: skip
    return np.flatnonzero([place in ours for place in fitted.place.tolist()])


def _excess(fitted: Fit, scores: Sequence[Comparison]) -> float:
    """Weighted squares above the floor of all rows."""
    return sum(
        equations.counts[row] / fitted.sigma[row] ** 2 * (score.rms**2 - score.floor**2)
        for equations, part in zip(fitted.equations.runs, scores, strict=True)
        for row, score in part.scores.items()
        if row in equations.counts
    )


def _of_each_run(
    normals: Sequence[Array], total: Array, x: Array, places: NDArray[np.intp]
) -> tuple[float, Array]:  # fmt: skip
    """Fall of the weighted squares by these parameters of each run's own, and their values in each run (runs, k).

    `normals` : of each run with the right side; `total` : of all runs with the priors; `x` : the common solution.
    """
    k, m = len(places), len(normals)
    across = np.concatenate([one[:-1, places] for one in normals], axis=1)
    gain = np.linalg.solve(total, across)
    score = np.concatenate([one[places, -1] - one[places, :-1] @ x for one in normals])
    matrix = -across.T @ gain
    for run, one in enumerate(normals):
        own = slice(run * k, (run + 1) * k)
        matrix[own, own] += one[np.ix_(places, places)]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    change = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-6, hermitian=True) @ (score / scale) / scale
    common = x - gain @ change
    return float(score @ change), common[places] + change.reshape(m, k)
