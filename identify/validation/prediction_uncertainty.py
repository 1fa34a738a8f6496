"""Uncertainty of a prediction from the parameters of a fit, those included that the runs used do not determine.

A parameter that the runs do not excite has a value all the same: the prior's, a share of a group, or one fitted to the
noise in its own column. The covariance here holds all three, so that a prediction or a derived value that depends on
such a parameter shows it, and the parameter can be named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensor_offsets import Zeros
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import shown_by

ENOUGH = 0.5
"""Prediction's 1 σ ÷ noise floor up to which a row can be judged: it adds at most 12 % to the error."""


@dataclass(frozen=True)
class OpenParameters:
    """Parameters that the runs used do not determine well enough for a prediction or a derived value.

    `names` is empty where no single parameter is decisive; `shown_by` : the runs that excite them, each once.
    """

    names: tuple[str, ...]
    shown_by: tuple[str, ...]


@dataclass(frozen=True)
class Knowledge:
    """Joint uncertainty of the physics' parameters after a fit.

    Attributes
    ----------
    names : (p,) parameters of the physics.
    shown_by : (p,) the run that excites each.
    covariance : (p, p) of their values: the fit's (as wide as the prior where columns are mostly noise), plus that of
        the distribution of a group's value over its members.
    """

    names: tuple[str, ...]
    shown_by: tuple[str, ...]
    covariance: Array

    @classmethod
    def of(cls, fitted: Fit) -> Knowledge:
        """The uncertainty of a fit's parameters, from the runs it used."""
        parameters = [q for effect in fitted.model.physics for q in effect.parameters]
        runs = [shown_by(q.name, effect) for effect in fitted.model.physics for q in effect.parameters]
        p = len(parameters)
        prior = np.array([q.prior for q in parameters])
        covariance = fitted.covariance[:p, :p].copy()
        covariance += _shared(fitted, prior)
        return cls(tuple(q.name for q in parameters), tuple(runs), covariance)

    def spread(self, slopes: Array) -> Array:
        """(k,) 1 σ of linear functions of the parameters with these slopes, (k, p)."""
        return np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slopes, self.covariance, slopes)))

    def responsible(self, gram: Array, enough: float, most: int = 3) -> tuple[int, ...]:
        """Parameters that make tr(gram · covariance) large, gram (p, p): knowledge of them would lower it to `enough`.

        Greedy: at each step the parameter whose knowledge lowers the trace most, among those whose own column (or
        slope) matters: a static load can be as uncertain as the mass it was confused with and still have no influence.
        """
        covariance = self.covariance
        found: list[int] = []
        while len(found) < most and float(np.sum(gram * covariance)) > enough:
            own = np.diag(covariance)
            total = float(np.sum(gram * covariance))
            moves = (own > 1e-12 * np.diag(self.covariance)) & (np.diag(gram) * own > 0.05 * total)
            effect = np.where(
                moves, np.einsum("ij,jk,ki->i", covariance, gram, covariance) / np.where(moves, own, 1.0), 0.0
            )
            best = int(np.argmax(effect))
            if effect[best] < 0.02 * total:
                break
            found.append(best)
            covariance = covariance - np.outer(covariance[best], covariance[best]) / own[best]
        return tuple(found)

    def prediction(
        self, effects: Sequence[PhysicalEffect], run: PreparedRun, zeros: Zeros, floor: Mapping[Row, float]
    ) -> dict[Row, tuple[float, OpenParameters | None]]:
        """Row → prediction's 1 σ ÷ noise floor, RMS over the samples, and the parameters that make it large, or None.

        What the run's own sensor zeros absorb is projected out: it does not concern the car.
        """
        weight = {row: 1.0 / floor[row] if floor[row] else 0.0 for row in run.rows}
        W = {row: weight[row] * run.matrix(effects, row) for row in run.rows}
        Z = {row: weight[row] * zeros.columns[row] for row in run.rows}
        normal: Array = np.diag(zeros.sigma**-2.0) + np.sum([z.T @ z for z in Z.values()], axis=0)
        moments: Array = np.sum([Z[row].T @ W[row] for row in run.rows], axis=0)
        taken = np.linalg.solve(normal, moments)
        out: dict[Row, tuple[float, OpenParameters | None]] = {}
        for row in run.rows:
            column = W[row] - Z[row] @ taken
            gram = column.T @ column / len(column)
            ratio = float(np.sqrt(max(0.0, float(np.sum(gram * self.covariance)))))
            why = self.open_parameters(self.responsible(gram, ENOUGH**2)) if ratio > ENOUGH else None
            out[row] = (ratio, why)
        return out

    def open_parameters(self, which: tuple[int, ...]) -> OpenParameters:
        """The parameters at these places and the runs that excite them."""
        runs = dict.fromkeys(self.shown_by[i] for i in which)
        return OpenParameters(tuple(self.names[i] for i in which), tuple(runs))


def place_of(fitted: Fit, run: PreparedRun) -> int | None:
    """Place of a run among those that a fit used; None where it is none of them."""
    return next((i for i, one in enumerate(fitted.runs) if one.recording.t is run.recording.t), None)


def _shared(fitted: Fit, prior: Array) -> Array:
    """(p, p) prior covariance of how groups distribute their values over members, and of parameters without column."""
    base = fitted.base
    p = len(prior)
    out = np.zeros((p, p))
    out[base.absent, base.absent] = prior[base.absent] ** 2
    if len(base.dependent):
        null = np.zeros((p, len(base.dependent)))
        null[base.independent] = -base.relations
        null[base.dependent] = np.eye(len(base.dependent))
        scaled = null / prior[:, None]
        out += null @ np.linalg.inv(scaled.T @ scaled) @ null.T
    return out
