"""What stays unexplained: rows against what simulated runs leave, with some candidates added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.trials import TrialSpace, Tried
from identify.vectors import Array

MOST_TOGETHER = 3
"""Effects that are tried together before a cause is called unlisted."""


@dataclass(frozen=True)
class Left:
    """What a set of candidates leaves of the residual.

    Attributes
    ----------
    ratios : row → RMS ÷ that of simulated runs treated alike.
    excess : weighted squares above those of simulated runs, over all rows.
    p : row → probability that a simulated run leaves as much; `family` over all rows together.
    residual : row and run → (n,) what is left, weighted; `draws` (D, n) the same of simulated runs.
    """

    ratios: dict[str, float]
    excess: float
    p: dict[str, float]
    family: float
    residual: dict[tuple[int, str], Array]
    draws: dict[tuple[int, str], Array]


def left_by(space: TrialSpace, added: Sequence[Tried]) -> Left:
    """The residual after model, zeros, sensor sheet and some candidates, beside simulated runs treated alike."""
    taken, prior = _with(space, added)
    sums, right = space.sums, space.layout.right
    G = sums.total[np.ix_(taken, taken)] + prior
    own = np.zeros((space.layout.width, 1))
    own[right] = 1.0
    own[taken] = -np.linalg.solve(G, sums.total[taken, right])[:, None]
    drawn = np.zeros_like(space.null)
    noise = np.sum([products[taken] for products in sums.null.values()], axis=0)
    drawn[taken] = -np.linalg.solve(G, noise)
    residual = {(b.run, b.row): [] for b in sums.blocks}
    draws: dict[tuple[int, str], list[Array]] = {key: [] for key in residual}
    for block, series in sums.series(own):
        residual[block.run, block.row].append(series[:, 0])
    for block, series in sums.noise_series(drawn):
        draws[block.run, block.row].append(series.T)
    here = {key: np.concatenate(parts) for key, parts in residual.items()}
    there = {key: np.concatenate(parts, axis=1) for key, parts in draws.items()}
    rows = list(dict.fromkeys(row for _, row in here))
    squares = {row: sum(float(np.sum(r**2)) for (_, name), r in here.items() if name == row) for row in rows}
    null = {
        row: np.sum([np.sum(d**2, axis=1) for (_, name), d in there.items() if name == row], axis=0) for row in rows
    }
    means = {row: float(np.mean(null[row])) for row in rows}
    spread = {row: float(np.std(null[row])) for row in rows}
    count = space.null.shape[1]
    worst = np.max([(null[row] - means[row]) / spread[row] for row in rows], axis=0)
    most = max((squares[row] - means[row]) / spread[row] for row in rows)
    return Left(
        ratios={row: float(np.sqrt(squares[row] / means[row])) for row in rows},
        excess=sum(squares.values()) - sum(means.values()),
        p={row: (1 + int(np.count_nonzero(null[row] >= squares[row]))) / (1 + count) for row in rows},
        family=(1 + int(np.count_nonzero(worst >= most))) / (1 + count),
        residual=here,
        draws=there,
    )


def best_set(space: TrialSpace, keys: Sequence[str]) -> list[str]:
    """Up to three candidates that together take away most, found one after the other; at most one sensor fault.

    Several gains set free together would scale the measurement away with whatever is in it.
    """
    left, right = space.partialled.left.copy(), space.layout.right
    open_, chosen = list(keys), list[str]()
    for _ in range(MOST_TOGETHER):
        drops = {key: _drop(left, space.tried[key].trial.place, right, space) for key in open_}
        if not drops or max(drops.values()) <= 0.0:
            break
        best = max(drops, key=lambda key: drops[key])
        chosen.append(best)
        place = space.tried[best].trial.place
        left = left - left[:, place] @ np.linalg.solve(left[place, place], left[place])
        fault = space.tried[best].trial.fault
        open_ = [key for key in open_ if key != best and not (fault and space.tried[key].trial.fault)]
    return chosen


def _drop(left: Array, place: slice, right: int, space: TrialSpace) -> float:
    G, score = left[place, place], left[place, right]
    if np.any(np.diag(G) < 1e-9 * np.diag(space.sums.total)[place]) or np.linalg.cond(G) > 1e12:
        return 0.0
    return float(score @ np.linalg.solve(G, score))


def louder_rows(space: TrialSpace) -> dict[str, float]:
    """Row → by how much its noise exceeds the sensor sheet's, never less than 1.

    Everything that any testable candidate could explain is taken out first: what is left is noise, or a cause nobody
    has listed; both make a fall of the same size less remarkable.
    """
    kept = [one for one in space.tried.values() if np.all(space.partialled.remaining(one.trial.place) > 1e-6)]
    return {row: max(1.0, ratio) for row, ratio in left_by(space, kept).ratios.items()}


def _with(space: TrialSpace, added: Sequence[Tried]) -> tuple[NDArray[np.intp], Array]:
    """Places of model, sheet and candidates, and the normal matrix of what is known of them beforehand."""
    base, prior = space.partialled.taken, space.partialled.prior
    there = set(base.tolist())
    fresh = [(i, q.prior) for one in added for i, q in _columns(one) if i not in there]
    taken = np.concatenate([base, np.array([i for i, _ in fresh], np.intp)]).astype(np.intp)
    out = np.zeros((len(taken), len(taken)))
    out[: len(base), : len(base)] = prior
    for n, (_, sigma) in enumerate(fresh, start=len(base)):
        out[n, n] = sigma**-2.0
    # A sensor fault that is added is set free from the sheet's tolerance.
    free = {i: q.prior for one in added if one.trial.fault for i, q in _columns(one)}
    for n, i in enumerate(base.tolist()):
        if i in free:
            out[n, n] = free[i] ** -2.0
    return taken, out


def _columns(one: Tried):
    place = one.trial.place
    return zip(range(place.start, place.stop), one.trial.effect.parameters, strict=True)
