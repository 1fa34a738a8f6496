"""Weighted least squares over several runs: row weights iterated to a fixed point, sensor zeros with priors."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import Effect, with_places
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, silent
from lacet.identify.regression.assembly import Assembly, MotionResponses
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.gauss_newton import StepRule
from lacet.identify.regression.huber import BadSecond, bad_seconds
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, orthonormaliser
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.shape_uncertainty import constant_changes
from lacet.identify.regression.sums.linear_fit import (
    FitOptions,
    FittedModel,
    LinearSolution,
    solve_linear,
    solve_runs,
)
from lacet.identify.regression.sums.prepared_runs import PreparedEquations, PreparedRuns, without_faults
from lacet.identify.regression.tolerances import SheetEntry, entry_name, sheet_entries
from lacet.identify.regression.uncertainty import at_least, block_bootstrap, spread_of


@dataclass(frozen=True)
class Stored:
    """Intermediate results of a fit, for further fits to the same motions with other noise.

    `responses` of the residual to channels and sensor sheet; `moments` of the noise in the regressors.
    """

    responses: MotionResponses
    moments: NoiseMoments


@dataclass(frozen=True, repr=False)
class Fit(FittedModel):
    """A fitted model, with the runs it was fitted to.

    Attributes
    ----------
    runs : the runs used, sensor faults of the model removed.
    residual : for each run, row → (n,) Y − W θ − zeros, after filter and decimation.
    zeros : for each run, names, priors (1 σ) and values of its sensor zeros.
    assembly, equations : the equations of the runs, by sample and as R factors.
    """

    runs: tuple[PreparedRun, ...]
    residual: tuple[Mapping[Row, Array], ...]
    zeros: tuple[tuple[tuple[str, ...], Array, Array], ...]
    assembly: Assembly
    equations: Equations

    @cached_property
    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """For each run, the derivatives of its residual by its channels."""
        return self.assembly.sensitivities()

    def sensitive_pieces(self, run: int) -> Iterator[tuple[PreparedRun, Sensitivity]]:
        """The pieces of a run, each with its sensitivity at the values where the fit was linearised.

        Raises ValueError for a model fitted without zeros.
        """
        for piece in self.assembly.pieces_of(run):
            if piece.sensitivity is None:
                raise ValueError("a model fitted without zeros has no sensitivities")
            yield piece.prepared, piece.sensitivity

    @cached_property
    def sheet_moves(self) -> Mapping[SheetEntry, Array]:
        """Entry of the sensor sheet → (p,) change of `theta` by one tolerance of it; `covariance_sheet` is of these."""
        if self.assembly.at is None:
            return {}
        zeros = [values for _, _, values in self.zeros]
        spread, _ = spread_of(self.assembly, self.equations, self.solution, zeros, self.sigma, sheet=True)
        inverse = self.covariance_iid[np.ix_(self.place, self.place)]
        known = set(self.sheet_entries)
        out: dict[SheetEntry, Array] = {}
        for entry, push in spread.sheet.items():
            if entry in known:
                out[entry] = np.zeros_like(self.theta)
                out[entry][self.place] = inverse @ push
        return out

    @property
    def stored(self) -> Stored:
        """Intermediate results for fits to the same motions with other noise."""
        return Stored(self.assembly.motion_responses(), self.moments)

    @property
    def covariances_searched(self) -> tuple[Array, Array]:
        """`covariance` and `covariance_sheet` of `theta` where shape constants were searched on the same runs."""
        return self._covariances_searched

    @cached_property
    def _covariances_searched(self) -> tuple[Array, Array]:
        return _covariances_searched(self)

    def bootstrap(self, draws: int = 499, seed: int = 0) -> Array:
        """(draws, p) bootstrap values of `theta`, from runs resampled in moving blocks of about 2 s."""
        out = np.zeros((draws, len(self.theta)))
        drawn = block_bootstrap(self.assembly, self.equations, self.sigma, draws, seed)
        out[:, self.place] = drawn + self.correction[self.place]
        return out

    def bad_seconds(self) -> list[BadSecond]:
        """Intervals with reduced weight in a robust fit, smallest weight first."""
        return bad_seconds(self.assembly, [run.name for run in self.runs])

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return 2.0 * np.pi * self.runs[0].recording.filters.fit_cutoff

    def latency_rule(self, most: int, longest: float, close: float, first_close: float) -> StepRule:
        """Rule for steps of latencies [s] whose limits are phases ω τ at the fit's cut-off [rad]."""
        return StepRule(most, longest, close, first_close, scale=self.omega)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows of any of the runs, in the order of reports."""
        return tuple(row for row in ROWS if row in self.sigma)

    def __repr__(self) -> str:
        runs = ", ".join(run.name for run in self.runs)
        return f"Fit({self.model!r} to {runs}: {self.base.rank} base parameters of {len(self.model.names)} parameters)"

    @property
    def sheet_entries(self) -> tuple[SheetEntry, ...]:
        """Gains, latencies and assumptions that the rows depend on, without those that the model has as faults."""
        ours = frozenset[tuple[str, str]]().union(*(fault.sheet_entries for fault in self.model.faults))
        found: dict[SheetEntry, None] = {}
        for run, drive in enumerate(self.runs):
            piece = next(self.assembly.pieces_of(run))
            assert piece.sensitivity is not None
            own = piece.sensitivity
            found |= dict.fromkeys(sheet_entries(drive.recording.rig, own.channels, own.assumptions))
        return tuple(entry for entry in found if entry[:2] not in ours)

    def entry_name(self, entry: SheetEntry) -> str:
        """Name of an entry of the sensor sheet, ``latency of <sensor>`` or ``gain of <channel.component>``."""
        return entry_name(entry, self.runs[0].recording.rig)

    def orthonormaliser(self, sigma: Mapping[Row, float]) -> Array:
        """(q, q) matrix T for which W T has nearly orthonormal columns, W weighted by `sigma`, zeros eliminated."""
        root = self.equations.root({row: sigma.get(row, own) for row, own in self.sigma.items()})
        return orthonormaliser(root[:, : len(self.place)])

    def with_effect(self, effect: Effect) -> Fit:
        """Fit of the model with one more effect to the same runs, with the same options (`extended`)."""
        return extended(self, [effect])

    def with_effects(self, effects: Sequence[Effect]) -> Fit:
        """The same with several effects."""
        return extended(self, effects)

    def without_effects(self, keys: Collection[str], removed: Mapping[str, float] | None = None) -> Fit:
        """Fit of the model without these effects to the same runs, with the same options.

        `removed` : size by key of those sensor faults that were removed from the runs before; a fault that the model
        does without is given back to them, to first order of its size.
        """
        effects = [effect for effect in self.model.effects if effect.key not in keys]
        if len(effects) == len(self.model.effects):
            return self
        back = [fault for fault in self.model.faults if fault.key in keys and fault.key in (removed or {})]
        sizes = -np.array([(removed or {})[fault.key] for fault in back])
        runs = tuple(without_faults(run, back, sizes) for run in self.runs) if back else self.runs
        return fit(Model.of(effects), runs, _weights_free(self))

    def without_latencies(self, latencies: Mapping[SheetEntry, float]) -> Fit:
        """Fit of the model to the runs with these latencies [s] removed; it shares the sensitivities of this fit."""
        rig = self.runs[0].recording.rig
        faults = [
            SensorLatency.of_sensor(sensor)
            if (sensor := rig.sensor_of(channel))
            else SensorLatency(channel, members=(channel,))
            for _, channel, _ in latencies
        ]
        sizes = np.array(list(latencies.values()))
        drives = [without_faults(drive, faults, sizes) for drive in self.runs]
        try:
            stored = self.stored
        except ValueError:  # a long run, in pieces
            stored = None
        return refitted(self, drives, stored)

    def refitted_to(self, other: Fit) -> Fit:
        """Fit of the model to the runs of another fit, with new sensitivities and the options of this fit."""
        return refitted(self, other.runs)


def fit(
    model: Model,
    runs: Sequence[PreparedRun],
    options: FitOptions | None = None,
    stored: Stored | None = None,
    progress: Progress = silent,
) -> Fit:
    """Fit a model to runs.

    Parameters
    ----------
    model : what to fit.
    runs : the runs used.
    options : how (default: `FitOptions()`).
    stored : intermediate results of a fit of the same model to the same motions with other noise.
    progress : receives the number of runs corrected for the bias.

    Raises NotIdentifiable when no run has a row, or the model no parameter that acts on one.
    """
    options = options or FitOptions()
    responses, moments = (stored.responses, stored.moments) if stored else (None, None)
    prepared = PreparedRuns(model, tuple(runs), options.zeros, responses, options.seeds, options.payload)
    return fit_of(model, options, solve_runs(model, prepared, options, moments, progress))


def fit_of(model: Model, options: FitOptions, found: LinearSolution[PreparedEquations]) -> Fit:
    """The fit of a solution, with the residuals computed at it."""
    assembly, equations = found.runs.assembly, found.runs.equations
    zeros = equations.zeros(found.x, found.sigma)
    spread, residual = spread_of(assembly, equations, found.x, zeros, found.sigma, sheet=assembly.at is not None)
    values = FittedModel.of(model, options, found, spread)
    return Fit(
        **{one.name: getattr(values, one.name) for one in fields(FittedModel)},
        runs=assembly.runs,
        residual=residual,
        zeros=tuple((run.zeros, run.priors, z) for run, z in zip(equations.runs, zeros, strict=True)),
        assembly=assembly,
        equations=equations,
    )


def corrected_run(run: PreparedRun, fitted: Fit) -> PreparedRun:
    """A run with the sensor faults of a fitted model removed; the run itself when the model has none."""
    if not fitted.model.faults:
        return run
    return without_faults(run, fitted.model.faults, fitted.theta[len(fitted.physics) :])


def refitted(fitted: Fit, runs: Sequence[PreparedRun], stored: Stored | None = None) -> Fit:
    """Fit of a fitted model to runs with changed channels, with the fit's options; `stored` as in `fit`.

    Sizes of the model's sensor faults are those that remain in these runs.
    """
    options = _weights_free(fitted)
    responses, moments = (stored.responses, stored.moments) if stored else (None, None)
    prepared = PreparedRuns(fitted.model, tuple(runs), options.zeros, responses, options.seeds, options.payload)
    found = solve_linear(fitted.model, prepared, options, moments, near=fitted.physics)
    return fit_of(fitted.model, options, found)


def extended(fitted: Fit, effects: Sequence[Effect]) -> Fit:
    """Fit of a fitted model with more effects to the same runs, with the fit's options.

    Sizes of the model's sensor faults are those that remain in these runs, from which they were removed.
    """
    return fit(Model.of((*fitted.model.effects, *effects)), fitted.runs, _weights_free(fitted))


def with_constant_changes(fitted: Fit) -> Fit:
    """The fit with changes of the model's shape constants as further parameters, at the same weights.

    A shape constant is one that has bounds. The fit itself where the model has none.
    """
    changes = constant_changes([(effect, fitted.theta[at]) for effect, at in with_places(fitted.model.physics)])
    if not changes:
        return fitted
    try:
        # The changes are zero: the residual answers to the channels as it does without them.
        shared = fitted.assembly.motion_responses()
    except ValueError:  # a long run, in pieces, or a fit without zeros
        shared = None
    model = Model.of((*fitted.model.effects, *changes))
    options = replace(fitted.options, weights=dict(fitted.sigma), unbias=False)
    prepared = PreparedRuns(model, fitted.runs, options.zeros, shared, options.seeds, options.payload)
    near = np.concatenate([fitted.physics, np.zeros(len(changes))])
    return fit_of(model, options, solve_linear(model, prepared, options, near=near))


def _covariances_searched(fitted: Fit) -> tuple[Array, Array]:
    """Both (p, p), the covariance no narrower than where the constants are known."""
    wider = with_constant_changes(fitted)
    if wider is fitted:
        return fitted.covariance, fitted.covariance_sheet
    names = fitted.model.names
    kept = [int(place) for place in fitted.place if names[int(place)] in wider.columns]
    own, there = np.ix_(kept, kept), np.ix_(*2 * [[wider.model.names.index(names[place]) for place in kept]])
    covariance, sheet = fitted.covariance.copy(), fitted.covariance_sheet.copy()
    covariance[own] = at_least(wider.covariance[there], fitted.covariance[own])
    sheet[own] = wider.covariance_sheet[there]
    return covariance, sheet


def _weights_free(fitted: Fit) -> FitOptions:
    """The options of a fit, with the rows' weights from their residuals."""
    return replace(fitted.options, weights=None)
