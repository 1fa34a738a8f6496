"""Columns of a model, of the sensor sheet and of every candidate beside them, with what is known of each beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Tell, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.lack_of_fit import louder_rows
from lacet.identify.selection.layout import Layout
from lacet.identify.selection.reading import Reading
from lacet.identify.selection.trial_sums import TrialSums


@dataclass(frozen=True)
class TrialColumns:
    """Columns on a fit's runs, as sums.

    Attributes
    ----------
    reading : the fit and its floor, on runs as they were read.
    effects : candidates that can be computed on these runs; those of the model are passed over.
    cannot : key → why another candidate cannot be.
    sums : of products of all columns.
    sheet : place → name of the columns that stand for the sensor sheet's tolerances; `sigma` one tolerance, in the
        column's own unit.
    taken : places of the columns of model and sheet that act.
    prior, pull : (a, a) normal matrix and (a,) right side of what is known of their parameters.
    drawn : (s, D) tolerances of the sheet drawn for every simulated run.
    louder : row → by how much its noise exceeds the sheet's: so much louder are the simulated runs, too.
    """

    reading: Reading
    effects: tuple[Effect, ...]
    cannot: Mapping[str, str]
    sums: TrialSums
    sheet: Mapping[int, str]
    sigma: Mapping[int, float]
    taken: NDArray[np.intp]
    prior: Array
    pull: Array
    drawn: Array
    louder: Mapping[str, float]

    @classmethod
    def of(cls, reading: Reading, candidates: Sequence[Effect], seed: int, tell: Tell = silent) -> TrialColumns:
        """Go once over the samples; `seed` is of the simulated zeros and tolerances."""
        fitted, floor = reading.fitted, reading.floor
        fresh = [effect for effect in candidates if effect.key not in fitted.model]
        cannot = {e.key: why for e in fresh if (why := _cannot(fitted, e))}
        effects = [effect for effect in fresh if effect.key not in cannot]
        temper = reading.misfit()
        rng = np.random.default_rng([seed, 6])
        bounds = {e.key: _tolerance(fitted, e) for e in effects if isinstance(e, SensorFault)}
        kinds = {e.key: e.tolerance for e in effects if isinstance(e, SensorFault)}
        drifts = {key: bound for key, bound in bounds.items() if kinds[key] == "drift" and bound > 0.0}
        shapes = [one for effect in effects for one in effect.shapes()]
        layout = Layout.of(len(fitted.place), reading.sums.layout.sheet, shapes)
        tell(f"what {len(effects)} effects would do")
        sums = TrialSums.of(fitted, floor, layout, temper, drifts, rng)
        # Gains and latencies stand in the sheet channel by channel; other faults stand for their own tolerance.
        sheet = {layout.model + i: f"{e[0]} of {e[1]}" for i, e in enumerate(layout.sheet)}
        sigma = dict.fromkeys(sheet, 1.0)
        for trial in layout.trials:
            key = trial.effect.key
            if trial.fault and bounds[key] > 0.0 and kinds[key] not in ("gain", "latency", "drift"):
                sheet[trial.place.start], sigma[trial.place.start] = key, bounds[key]
        there = [place for place in sheet if sums.total[place, place] > 0.0]
        one = np.array([sigma[place] for place in there])
        prior = scipy.linalg.block_diag(sums.known, np.diag((temper / one) ** 2))
        taken = np.concatenate([np.arange(layout.model), there]).astype(np.intp)
        known = np.zeros(layout.width)
        known[: len(reading.pull)] = reading.pull
        pull = np.concatenate([np.zeros(layout.model), (temper / one) ** 2 * known[there]])
        drawn = one[:, None] * rng.standard_normal((len(there), floor.count))
        louder = louder_rows(sums, taken, prior, pull)
        return cls(reading, tuple(effects), cannot, sums, sheet, sigma, taken, prior, pull, drawn, louder)


def _tolerance(fitted: Fit, fault: SensorFault) -> float:
    rig = fitted.drives[0].recording.rig
    return max((rig.tolerance(channel, fault.tolerance) for channel in fault.channels()), default=0.0)


def _cannot(fitted: Fit, effect: Effect) -> str:
    return next((why for drive in fitted.drives if (why := drive.can(effect))), "")
