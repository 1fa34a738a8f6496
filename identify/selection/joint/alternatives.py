"""Alternatives to a law found: candidates that could be in its place, by Cox's test of separate families.

The runs are simulated with the alternative in the law's place, at the size estimated for it. Where the law would then
explain so much more than the alternative as it does in the measured runs, in one simulated run of a hundred at most,
the alternative is rejected; otherwise both are in the confidence set. Nothing is drawn anew: all follows from the cross
products of the columns with the simulated noise.

Source: D. R. Cox, Further results on tests of separate families of hypotheses, Journal of the Royal Statistical
Society B 24 (1962); confidence sets of models: P. R. Hansen, A. Lunde and J. M. Nason, The model confidence set,
Econometrica 79 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.rest import AddedLaw
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Alternative:
    """A candidate in the place of a law that is in the model.

    Attributes
    ----------
    effect : the candidate, at the shape constants of its grid at which it explains most.
    margin : weighted squares that the law explains more than the candidate in its place.
    p : probability of such a margin where the candidate is the truth.
    correlation : canonical correlation of their columns, everything else removed.
    law_beside : weighted squares that the law explains beside the candidate.
    """

    effect: Effect
    margin: float
    p: float
    correlation: float
    law_beside: float

    @property
    def key(self) -> str:
        """The candidate's key."""
        return self.effect.key


def alternatives(space: ScoreTests, law: AddedLaw) -> list[Alternative]:
    """For each candidate of `space`, at its best shape and within its plausible range: in the place of `law`.

    The nearest first. Sensor faults are left out: their tolerances are nuisance parameters of every test.
    """
    found = _InPlaceOf.of(space, law)
    best: dict[str, Alternative] = {}
    for trial in space.layout.trials:
        if trial.fault or trial.effect.key in space.selected or not found.shows(trial):
            continue
        one = found.by(trial)
        if one is not None and (one.key not in best or one.margin < best[one.key].margin):
            best[one.key] = one
    return sorted(best.values(), key=lambda one: one.margin)


def confidence_set(tried: Sequence[Alternative], draws: int) -> list[Alternative]:
    """The alternatives that are not rejected."""
    return [one for one in tried if one.p > SELECTION.level(draws)]


@dataclass(frozen=True)
class _InPlaceOf:
    """A law of the model, to be compared with candidates in its place.

    `values` (k,) its parameters with the sensor sheet's tolerances, `spread` (k, k) their covariance; `rows` (k, p) of
    the model's turn; `drawn` (w, D) what the simulated runs leave, `moved` (k, D) the law's estimates in them.
    """

    space: ScoreTests
    values: Array
    spread: Array
    rows: Array
    drawn: Array
    moved: Array

    @classmethod
    def of(cls, space: ScoreTests, law: AddedLaw) -> _InPlaceOf:
        known, model = space.regression, space.layout.model
        rows = known.sums.turn[list(law.places)]
        inverse = rows @ known.inverse[:model]
        return cls(
            space, law.values, inverse[:, :model] @ rows.T, rows,
            space.null - known.gain.T @ space.null[known.nuisance], inverse @ space.null[known.nuisance],
        )  # fmt: skip

    def shows(self, trial: Trial) -> bool:
        return bool(np.all(self.space.regression.remaining_energy(trial.place) > SELECTION.gone_share))

    def by(self, trial: Trial) -> Alternative | None:
        """The candidate in the law's place; None where its size would not be plausible."""
        known, at, model = self.space.regression, trial.place, self.space.layout.model
        right, parameters = known.sums.layout.right, trial.effect.parameters
        normal = known.reduced_noisy[at, at] + np.diag([q.prior**-2.0 for q in parameters])
        spread = np.linalg.inv(normal)
        across = -self.rows @ known.gain[:model, at]
        both = self.spread + across @ spread @ across.T
        own = np.linalg.inv(both)
        gain = spread @ across.T @ own

        def compared(score: Array, values: Array) -> tuple[Array, Array, Array]:
            """The margin, the squares of the law beside the candidate, and the candidate's parameters without it."""
            theirs = spread @ score
            ours = values + across @ theirs
            beside = np.einsum("kd,kd->d", ours, own @ ours)
            return beside - np.einsum("kd,kd->d", theirs, normal @ theirs), beside, theirs - gain @ ours

        margin, beside, alone = compared(known.reduced[at, right][:, None], self.values[:, None])
        half = SELECTION.interval_quantile * np.sqrt(np.maximum(0.0, np.diag(spread - gain @ across @ spread)))
        if trial.effect.implausible(alone[:, 0], half) is not None:
            return None
        # With the candidate the truth at that size, the law's own estimate beside it is noise.
        drawn, _, _ = compared(self.drawn[at] + normal @ alone, self.moved - across @ alone)
        p = (1 + int(np.count_nonzero(drawn >= margin[0]))) / (1 + drawn.size)
        # Of the law's columns, everything but the candidate removed, and the candidate's.
        shared = across @ spread @ across.T
        correlation = float(np.sqrt(np.clip(np.max(np.linalg.eigvals(own @ shared).real), 0.0, 1.0)))
        return Alternative(trial.effect, float(margin[0]), p, correlation, float(beside[0]))
