"""Tasks of a ranking on a campaign: what each run gives to the tests of all candidates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import read_line
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.cross_products import Extent, SumsOfRuns, samples_of
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.regressor_noise import noise_of_run
from lacet.identify.selection.columns.samples import SampleTask
from lacet.identify.selection.columns.weighted_columns import Weighting
from lacet.identify.validation.noise_floor import NoiseFloor, RunDraws, simulate_floor
from lacet.services.campaign.tasks import EquationsAt, SingleRun


@dataclass(frozen=True)
class PlainEffect:
    """An effect by its key and shape constants: a worker has the law itself, or its `line` and where it acts."""

    key: str
    shape: tuple[tuple[str, float], ...]
    line: str = ""
    where: str = ""

    @classmethod
    def of(cls, effect: Effect) -> PlainEffect:
        """The plain form of an effect."""
        line, where = (effect.line.text, effect.where) if isinstance(effect, OneLine) else ("", "")
        return cls(effect.key, tuple(effect.shape.items()), line, where)

    def among(self, known: Mapping[str, Effect]) -> Effect:
        """The effect, of those `known`, or of the line of a law that no catalogue has."""
        if self.key in known:
            return replace(known[self.key], shape=dict(self.shape))
        return effect_class(read_line(self.line))(self.where, dict(self.shape))


@dataclass(frozen=True)
class PlainWeighting:
    """A `Weighting` whose effects are plain."""

    model: int
    sheet: tuple[SheetEntry, ...]
    effects: tuple[PlainEffect, ...]
    turn: Array
    prior_stiffening: float

    @classmethod
    def of(cls, weighting: Weighting) -> PlainWeighting:
        """The plain form of a weighting."""
        layout = weighting.layout
        effects = tuple(PlainEffect.of(trial.effect) for trial in layout.trials)
        return cls(layout.model, layout.sheet, effects, weighting.turn, weighting.prior_stiffening)

    def weighting(self, known: Mapping[str, Effect]) -> Weighting:
        """The weighting, with the effects `known` to the worker."""
        layout = Layout.of(self.model, self.sheet, [effect.among(known) for effect in self.effects])
        return Weighting(layout, self.turn, self.prior_stiffening)


@dataclass(frozen=True)
class FitAt:
    """A fitted model as plain values, with which a worker makes the fit of its own run.

    Attributes
    ----------
    where : the equations of the last step of the fit.
    fitted : the fitted model without its effects, which a worker has itself.
    """

    where: EquationsAt
    fitted: FittedModel

    @classmethod
    def of(cls, fitted: FittedModel, where: EquationsAt) -> FitAt:
        """The plain values of a fitted model."""
        return cls(where, FittedModel(**(_values(fitted) | {"model": Model.of(())})))

    def fit(self, run: SingleRun) -> Fit:
        """The fit, on one run alone; its residual is not computed."""
        found = self.where.linearised(run)
        (zeros,) = found.equations.zeros(self.fitted.solution, self.fitted.sigma)
        (equations,) = found.equations.runs
        return Fit(
            **(_values(self.fitted) | {"model": run.model}), runs=found.assembly.runs, residual=(),
            zeros=((equations.zeros, equations.priors, zeros),), assembly=found.assembly, equations=found.equations,
        )  # fmt: skip


def _values(fitted: FittedModel) -> dict[str, Any]:
    """Values of a fitted model, without those of a `Fit`."""
    return {one.name: getattr(fitted, one.name) for one in fields(FittedModel)}


@dataclass(frozen=True)
class Draws:
    """How often the noise of a campaign is drawn: `count` simulated campaigns, from `of_piece` draws of each piece."""

    count: int
    of_piece: int

    def floor(self, fit: Fit, run: SingleRun) -> NoiseFloor:
        """The noise floor of one run, drawn with its content as seed."""
        return simulate_floor(fit.runs, fit.sensitive_pieces, self.count, run.reference.seed, of_piece=self.of_piece)


@dataclass(frozen=True)
class RunSurvey:
    """What a ranking has to know of runs before it begins.

    Attributes
    ----------
    squares, counts : row → sum of squares of the simulated noise over draws and samples, and their number.
    sheet : gains and latencies of the sensor sheet that the rows depend on.
    lacks : key → what the first run that cannot show an effect lacks for it.
    """

    squares: Mapping[Row, float]
    counts: Mapping[Row, int]
    sheet: tuple[SheetEntry, ...]
    lacks: Mapping[str, Unmeasured]

    @staticmethod
    def merged(parts: Sequence[RunSurvey]) -> RunSurvey:
        """Of several runs."""
        rows = dict.fromkeys(row for part in parts for row in part.counts)
        return RunSurvey(
            {row: sum(part.squares.get(row, 0.0) for part in parts) for row in rows},
            {row: sum(part.counts.get(row, 0) for part in parts) for row in rows},
            tuple(dict.fromkeys(entry for part in parts for entry in part.sheet)),
            of_the_first([part.lacks for part in parts]),
        )

    @property
    def sigma(self) -> dict[Row, float]:
        """Row → RMS of the simulated noise [N or N·m]."""
        return {row: float(np.sqrt(self.squares[row] / count)) for row, count in self.counts.items()}


class _OfSelection:
    """Sums that are made by the room of selection."""

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "selection"


@dataclass(frozen=True)
class SurveyAt(_OfSelection):
    """The survey of a run, for the candidates of these keys."""

    fit: FitAt
    draws: Draws
    keys: tuple[str, ...]

    def sums(self, run: SingleRun) -> RunSurvey:
        """The survey."""
        fit, known = self.fit.fit(run), run.settings.known_effects()
        (drawn,) = self.draws.floor(fit, run).draws
        lacks = ((key, fit.runs[0].lacks(known[key])) for key in self.keys)
        return RunSurvey(
            {row: float(np.sum(series**2)) for row, series in drawn.series.items()},
            {row: series.size for row, series in drawn.series.items()},
            fit.sheet_entries,
            {key: lack for key, lack in lacks if lack is not None},
        )


@dataclass(frozen=True)
class LacksAt(_OfSelection):
    """What a run lacks for laws that no catalogue has: key → the channels; those it can show are absent."""

    fit: FitAt
    laws: tuple[PlainEffect, ...]

    def sums(self, run: SingleRun) -> dict[str, Unmeasured]:
        """What it lacks."""
        prepared, known = self.fit.fit(run).runs[0], run.settings.known_effects()
        lacks = ((law.key, prepared.lacks(law.among(known))) for law in self.laws)
        return {key: lack for key, lack in lacks if lack is not None}


def of_the_first(parts: Sequence[Mapping[str, Unmeasured]]) -> dict[str, Unmeasured]:
    """What runs lack, of the first that lacks it."""
    return {key: lack for part in reversed(parts) for key, lack in part.items()}


@dataclass(frozen=True)
class WeightedAt(_OfSelection):
    """Samples of a run, weighted by `sigma`; the base of the tasks below."""

    fit: FitAt
    draws: Draws
    columns: PlainWeighting
    sigma: Mapping[Row, float]

    def floor(self, fit: Fit, run: SingleRun) -> NoiseFloor:
        """The noise floor of the run with the campaign's weights."""
        if not self.draws.count:
            none = RunDraws.none({row: len(index) for row, index in fit.runs[0].index.items()})
            return NoiseFloor((none,), (), self.sigma, 0)
        return replace(self.draws.floor(fit, run), sigma=self.sigma)

    def weighting(self, run: SingleRun) -> Weighting:
        """Order and weights of the columns."""
        return self.columns.weighting(run.settings.known_effects())


@dataclass(frozen=True)
class ProductsAt(WeightedAt):
    """Sums of products of a run; `drifts`, `seed`, `extent` as of `CrossProducts.of`."""

    drifts: Mapping[str, float]
    seed: int
    extent: Extent

    def sums(self, run: SingleRun) -> SumsOfRuns:
        """The sums."""
        fit, weighting = self.fit.fit(run), self.weighting(run)
        samples, products = samples_of(fit, self.floor(fit, run), weighting, 0, extent=self.extent)
        seed = [self.seed, 6, run.reference.seed]
        return SumsOfRuns.of(products, samples, weighting, self.drifts, seed, self.extent)


@dataclass(frozen=True)
class SamplesAt(WeightedAt):
    """A task for the samples of a run."""

    task: SampleTask[Any]

    def sums(self, run: SingleRun) -> Any:
        """Its result."""
        fit = self.fit.fit(run)
        return self.task.of_run(samples_of(fit, self.floor(fit, run), self.weighting(run), 0)[0])


@dataclass(frozen=True)
class ColumnNoiseAt(WeightedAt):
    """Noise in the columns of a run, from so many `pairs` of draws."""

    pairs: int

    def sums(self, run: SingleRun) -> dict[Row, Array]:
        """Row → (w, w) products."""
        fit, weighting = self.fit.fit(run), self.weighting(run)
        samples, _ = samples_of(fit, self.floor(fit, run), weighting, 0)
        found = noise_of_run(fit, weighting.layout, self.sigma, 0, self.pairs)
        return {row: found.eliminated(weighting, samples.zero_gain, {row: 1.0}) for row in found.rows}


def added(parts: Sequence[Mapping[Row, Any]]) -> dict[Row, Any]:
    """Values by row of several runs, added."""
    rows = dict.fromkeys(row for part in parts for row in part)
    return {row: sum(part[row] for part in parts if row in part) for row in rows}
