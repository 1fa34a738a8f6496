"""Columns of two joints that are exchanged: of their positions, of their torques, or of both."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations

import numpy as np

from lacet.daq.errors import NotIdentifiable
from lacet.identify.chains.fit import ChainFit, fit_chain
from lacet.identify.chains.samples import Recorded
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import Filters

_CLEARLY = 0.5
"""Error of both joints with their columns exchanged ÷ as they are, below which they are exchanged [ratio]. Source: far
from what a law that is missing may change at two joints at once, and from 1."""
_WRONG = 0.05
_WRONG_ONE = 0.25
"""RMS error of two joints ÷ RMS variation of their torques from which both their columns may be exchanged, and, at one
of them, one column alone [ratio]. Source: processor time; exchanged positions or torques leave 0.5 at least, both 0.08
(simulated arms)."""
_SEARCHED, _SECONDS = 12, 60.0
"""Equations ÷ values of the model [count], and length [s], from which a part of a long record shows an exchange.
Source: processor time."""
_ALIKE = 0.01
"""Difference of the falls of two exchanges' likelihoods ÷ either, up to which they fit alike [ratio]: two slides whose
bodies do not act on each other fit with either column exchanged."""


class ExchangedColumns(StrEnum):
    """Which columns of two joints are exchanged; the values are those of the arguments of `identify_chain`."""

    POSITIONS = "q"
    TORQUES = "tau"
    BOTH = "q and tau"


@dataclass(frozen=True)
class ExchangedJoints:
    """Two joints whose columns fit with each in the place of the other.

    Attributes
    ----------
    joints : their names.
    columns : of what; several where these fit alike.
    sigma, exchanged : (2,) σ of their equations as the columns are given, and exchanged [N·m, N].
    """

    joints: tuple[str, str]
    columns: tuple[ExchangedColumns, ...]
    sigma: tuple[float, float]
    exchanged: tuple[float, float]


def exchanged_joints(
    fitted: ChainFit, recorded: Recorded, filters: Filters, slowest: Array
) -> ExchangedJoints | None:  # fmt: skip
    """The two joints whose columns are exchanged; None where no exchange makes the errors of both joints far smaller.

    Every pair of joints that the model fails at is fitted with their positions, their torques and both exchanged, to
    the beginning of a long record; the exchange of largest likelihood counts. `slowest` : (f,) rates below which an
    equation does not count, as in the fit.
    """
    chain = fitted.model.chain
    enough = _SEARCHED * len(fitted.x) / max(1, int(fitted.used.sum()))
    part = max(enough, _SECONDS * recorded.rate / len(recorded.q))
    if part < 0.5:
        recorded = recorded.beginning(part)
        try:
            fitted = fit_chain(fitted.model, recorded.samples(filters), slowest)
        except NotIdentifiable:
            return None
    variation = np.nanstd(np.where(fitted.used, fitted.measured, np.nan), axis=0)
    names = [chain.names[j - 1] for j in chain.coupling.free]
    found: list[tuple[float, ExchangedJoints]] = []
    wrong = fitted.sigma / variation
    for i, k in combinations(np.flatnonzero(wrong > _WRONG).tolist(), 2):
        one = max(wrong[i], wrong[k]) > _WRONG_ONE
        for columns, sigma in _tries(fitted, recorded, filters, slowest, (i, k), one):
            fall = float(np.sum(np.count_nonzero(fitted.used, axis=0) * np.log(fitted.sigma / sigma)))
            if fall > 0.0 and np.all(sigma[[i, k]] < _CLEARLY * fitted.sigma[[i, k]]):
                given, other = ((float(x[i]), float(x[k])) for x in (fitted.sigma, sigma))
                found.append((fall, ExchangedJoints((names[i], names[k]), (columns,), given, other)))
    if not found:
        return None
    most, best = max(found, key=lambda one: one[0])
    alike = [one for fall, one in found if one.joints == best.joints and most - fall <= _ALIKE * most]
    return replace(best, columns=tuple(column for one in alike for column in one.columns))


def _tries(
    fitted: ChainFit, recorded: Recorded, filters: Filters, slowest: Array, pair: tuple[int, int], one: bool
) -> Iterator[tuple[ExchangedColumns, Array]]:
    """Columns of a pair of joints that are exchanged, and (f,) σ of all joints' equations then; both, or `one` too."""
    order = np.arange(len(slowest))
    order[list(pair)] = order[list(pair[::-1])]
    qd, qdd = (None if x is None else x[:, order] for x in (recorded.qd, recorded.qdd))
    positions = replace(recorded, q=recorded.q[:, order], qd=qd, qdd=qdd)
    torques = recorded.tau[:, order]
    for columns, other, limit in (
        (ExchangedColumns.TORQUES, replace(recorded, tau=torques), slowest),
        (ExchangedColumns.POSITIONS, positions, slowest[order]),
        (ExchangedColumns.BOTH, replace(positions, tau=torques), slowest[order]),
    ):
        if columns is not ExchangedColumns.BOTH and not one:
            continue
        try:
            yield columns, fit_chain(fitted.model, other.samples(filters), limit).sigma
        except NotIdentifiable:
            continue
