"""Signature of an effect in a study: its law over the state that it follows, on the partial residual of a row.

The partial residual is the residual of the model with the effect plus the effect's own contribution: what the law is
fitted to. A law of the right form lies on its mean (Larsen and McCleary, Technometrics 14, 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.blocks import block_numbers
from lacet.identify.validation.residual_map import Conditional, conditional_mean
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.states import filtered_states, states_of


@dataclass(frozen=True)
class Signature:
    """An effect's law in a row over a state, and the partial residual that it is fitted to.

    `partial` and `law` are conditional means given the state, over all runs used, of the partial residual and of the
    effect's own contribution [`row_unit`]; `part` of the squares of the law that its mean stands for (0 to 1).
    """

    row: Row
    row_unit: str
    part: float
    partial: Conditional
    law: Conditional


def signature(
    runs: Sequence[PreparedRun], row: Row, laws: Sequence[Array], remaining: Sequence[Array]
) -> Signature | None:
    """The signature over that state of the row which the law follows most; None without any state.

    `laws` : (n,) of each run, the effect's contribution to the row in the model that has it; `remaining` : (n,)
    residual of that model [N or N·m].
    """
    each = [states_of(run.kept_motion, row) for run in runs]
    names = [
        name
        for name, state in (each[0] if each else {}).items()
        if not state.in_left_side and all(name in other for other in each)
    ]
    if not names:
        return None
    law = np.concatenate(list(laws))
    partial = law + np.concatenate(list(remaining))
    blocks = block_numbers(runs, row)
    series = [filtered_states(run, row, names) for run in runs]
    squares = float(np.sum((law - np.mean(law)) ** 2))
    means: list[Conditional] = []
    parts: list[float] = []
    for name in names:
        mean = conditional_mean(np.concatenate([s[name] for s in series]), law, blocks, name, each[0][name].unit)
        # A state that changes slowly stands for the time: only what several stretches of the runs show counts.
        shown = np.isfinite(mean.low)
        explained = float(np.sum((mean.count * (mean.mean - np.mean(law)) ** 2)[shown]))
        means.append(mean)
        parts.append(explained / squares if squares else 0.0)
    best = int(np.argmax(parts))
    values = np.concatenate([s[names[best]] for s in series])
    over = conditional_mean(values, partial, blocks, names[best], means[best].unit)
    return Signature(row, row.unit, parts[best], over, means[best])


def own_row(now: Sequence[Comparison], after: Sequence[Comparison]) -> Row:
    """The row in which a model with one more effect takes most off the squares of residual ÷ floor, over runs."""
    fall: dict[Row, float] = {}
    for before, then in zip(now, after, strict=True):
        for row, score in before.scores.items():
            less = score.ratio**2 - (then.scores[row].rms / score.floor) ** 2 if score.floor else 0.0
            fall[row] = fall.get(row, 0.0) + score.samples * less
    return max(fall, key=lambda row: fall[row])
