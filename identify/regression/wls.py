"""Weighted least squares over several runs, with weights by row to a fixed point and sensor zeros as priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.daq.errors import NotIdentifiable
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.multibody.base_parameters import BaseParameters, find_base
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.assembly import Assembly, Known
from lacet.identify.regression.corrected_scores import NOISE_DRAWS, NoiseMoments
from lacet.identify.regression.gauss_newton import FAULT_RULE, StepRule
from lacet.identify.regression.huber import BadSecond, bad_seconds, huber_weights
from lacet.identify.regression.identifiability import refuse_not_finite
from lacet.identify.regression.model import Model, known_beforehand
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import (
    Equations,
    RunEquations,
    scaled_triangle,
    triangle,
    zeros_following,
)
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.tolerances import SheetEntry, sheet_entries
from lacet.identify.regression.uncertainty import at_least, block_bootstrap, spread_of
from lacet.identify.signals.reconstruct import Recording

_HUBER_TURNS = 6


@dataclass(frozen=True)
class FitOptions:
    """How a model is fitted.

    Attributes
    ----------
    weights : σ of each row [N or N·m], frozen (noise-floor weights); by default from the residual, to a fixed point.
    zeros : estimate each run's sensor offsets with the sheet's σ as prior.
    unbias : remove the bias that the sheet's noise in the regressors brings (errors in variables).
    robust : let seconds with a residual far beyond their row's usual one count less (Huber).
    draws : pairs of noise draws behind `unbias`.
    """

    weights: Mapping[str, float] | None = None
    zeros: bool = True
    unbias: bool = True
    robust: bool = False
    draws: int = NOISE_DRAWS


@dataclass(frozen=True)
class Stored:
    """Results that fits to the same motions share, so that they are computed once.

    `known` of the runs; `moments` of the noise in the regressors.
    """

    known: Known
    moments: NoiseMoments


@dataclass(frozen=True, repr=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : what was fitted.
    runs : the runs used, sensor faults of the model removed.
    base : grouping of the model's parameters into what the runs' equations depend on at all.
    theta : (p,) every parameter; those grouped into others are zero.
    covariance : (p, p) of `theta`: serial and cross-row correlation (HAC), zeros' priors included; no narrower than
        `covariance_iid`, and as wide as the prior where the regressors are mostly noise.
    covariance_iid : the same as if residuals were independent, as the paper's sxr % has it.
    covariance_sheet : what the sensor sheet's gains and latencies add to it, which no residual shows.
    sigma : row → weight's σ [N or N·m].
    residual : for each run, row → (n,) Y − W θ − zeros, after filter and decimation.
    zeros : for each run, names, priors (1 σ) and values of its sensor zeros.
    correction : (p,) what was added to remove the bias of noise in the regressors, from its `moments`.
    place : (q,) where the parameters of the equations stand in `theta`: those kept, then sensor faults.
    root : (q + 1, q + 1) R factor of the weighted ``[W | Y]`` with priors, every run's zeros eliminated.
    assembly, equations : what it was made from, to go through the samples again.
    options : how it was fitted.
    removed : (f,) sizes of the model's sensor faults that were removed from `runs`.
    """

    model: Model
    runs: tuple[PreparedRun, ...]
    base: BaseParameters
    theta: Array
    covariance: Array
    covariance_iid: Array
    covariance_sheet: Array
    sigma: Mapping[str, float]
    residual: tuple[Mapping[str, Array], ...]
    zeros: tuple[tuple[tuple[str, ...], Array, Array], ...]
    correction: Array
    moments: NoiseMoments
    place: NDArray[np.intp]
    root: Array
    assembly: Assembly
    equations: Equations
    options: FitOptions
    removed: Array

    @cached_property
    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """For each run, how its residual answers to its channels."""
        return self.assembly.sensitivities()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the parameters in the equations, (q,)."""
        return tuple(self.model.names[int(i)] for i in self.place)

    @property
    def solution(self) -> Array:
        """(q,) values of the parameters in the equations."""
        return self.theta[self.place]

    @property
    def stored(self) -> Stored:
        """What further campaigns on the same motions need not compute again."""
        return Stored(self.assembly.as_known(), self.moments)

    def bootstrap(self, draws: int = 499, seed: int = 0) -> Array:
        """(draws, p) values of `theta` from runs put together anew of their own blocks (moving blocks of about 2 s)."""
        out = np.zeros((draws, len(self.theta)))
        drawn = block_bootstrap(self.assembly, self.equations, self.sigma, draws, seed)
        out[:, self.place] = drawn + self.correction[self.place]
        return out

    def bad_seconds(self) -> list[BadSecond]:
        """What a robust fit counted less, worst first."""
        return bad_seconds(self.assembly, [run.name for run in self.runs])

    @property
    def physics(self) -> Array:
        """Values of the physics' parameters, without those of sensor faults."""
        return self.theta[: self.model.physics_size]

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return 2.0 * np.pi * self.runs[0].recording.filters.fit_cutoff

    def latency_rule(self, most: int, longest: float, close: float, first_close: float) -> StepRule:
        """Rule for steps of latencies [s] whose limits are phases ω τ at the fit's cut-off [rad]."""
        return StepRule(most, longest, close, first_close, scale=self.omega)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows that any run has, in the order of reports."""
        return tuple(row for row in ROWS if row in self.sigma)

    def __repr__(self) -> str:
        runs = ", ".join(run.name for run in self.runs)
        return f"Fit({self.model!r} to {runs}: {self.base.rank} base parameters of {len(self.model.names)} parameters)"

    def value(self, name: str) -> float:
        """A parameter by name."""
        return float(self.theta[self.model.names.index(name)])

    @property
    def sheet_entries(self) -> tuple[SheetEntry, ...]:
        """Gains and latencies of the sensor sheet that the rows depend on, those apart that the model has as faults."""
        ours = frozenset[tuple[str, str]]().union(*(fault.sheet_entries for fault in self.model.faults))
        found: dict[SheetEntry, None] = {}
        for run, drive in enumerate(self.runs):
            piece = next(self.assembly.pieces_of(run))
            assert piece.sensitivity is not None
            found |= dict.fromkeys(sheet_entries(drive.recording.rig, piece.sensitivity.channels))
        return tuple(entry for entry in found if entry[:2] not in ours)

    def entry_name(self, entry: SheetEntry) -> str:
        """Name of an entry of the sensor sheet for people: a latency goes by its sensor, a gain by its column."""
        what, channel, component = entry
        if what != "latency":
            return f"{what} of {CHANNELS[channel].columns[component]}"
        sensor = self.runs[0].recording.rig.sensor_of(channel)
        return f"latency of {sensor.name if sensor else channel}"

    def orthonormaliser(self, sigma: Mapping[str, float]) -> Array:
        """(q, q) T: the columns W, weighted by `sigma`, every run's zeros eliminated, are nearly orthonormal as W T."""
        root = self.equations.root({row: sigma.get(row, own) for row, own in self.sigma.items()})
        p = len(self.place)
        R, lengths = scaled_triangle(root[:, :p])
        return np.asarray(scipy.linalg.solve_triangular(R[:p], np.eye(p)), float) / lengths[:, None]

    def with_effect(self, effect: Effect) -> Fit:
        """The model with one more effect, fitted in the same way to the same runs (`extended`)."""
        return extended(self, effect)

    def without_latencies(self, latencies: Mapping[SheetEntry, float]) -> Fit:
        """The same model on the runs without these latencies [s]; sensitivities are this fit's where they are kept."""
        rig = self.runs[0].recording.rig
        faults = [
            SensorLatency.of_sensor(sensor)
            if (sensor := rig.sensor_of(channel))
            else SensorLatency(channel, members=(channel,))
            for _, channel, _ in latencies
        ]
        sizes = np.array(list(latencies.values()))
        drives = [PreparedRun(at_faults(drive.recording, faults, sizes)) for drive in self.runs]
        try:
            stored = self.stored
        except ValueError:  # a long run, in pieces
            stored = None
        return refitted(self, drives, stored)

    def refitted_to(self, other: Fit) -> Fit:
        """The same model, fitted in the same way, to the runs of another fit, with their own sensitivities."""
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
    stored : what is known already from a fit of the same model on the same motions, other noise.
    progress : receives how many runs are corrected for the bias.

    Raises NotIdentifiable when no run has a row, or the model no parameter that acts on one.
    """
    corrected, options = tuple(runs), options or FitOptions()
    biased = replace(options, unbias=False)
    out = _fit_linear(model, corrected, biased if model.faults else options, stored, progress)
    if not model.faults:
        return out

    def remaining_faults(steps_made: int, faults: Array) -> Array:
        """What a fit to the runs without these faults still finds of them."""
        nonlocal corrected, out
        if steps_made:
            corrected = tuple(PreparedRun(at_faults(run.recording, model.faults, faults)) for run in runs)
            out = _fit_linear(model, corrected, biased, stored, near=out.physics)
        return out.theta[out.theta.size - faults.size :]

    # A sensor fault is linear only for small values: remove what was found and re-linearise.
    limits = [(q.low, q.high) for fault in model.faults for q in fault.parameters]
    low, high = np.array(limits).reshape(-1, 2).T
    faults = FAULT_RULE.relinearised(remaining_faults, np.zeros(len(model.faults)), (low, high)).values
    if options.unbias:
        out = _fit_linear(model, corrected, options, stored, progress, out.physics)
    theta = out.theta.copy()
    theta[theta.size - faults.size :] += faults
    return replace(out, theta=theta, removed=faults)


def _fit_linear(
    model: Model, prepared: tuple[PreparedRun, ...], options: FitOptions, stored: Stored | None,
    progress: Progress = silent, near: Array | None = None,
) -> Fit:  # fmt: skip
    """One linear fit; `near` are values of the physics' parameters that are nearly right already."""
    effects = model.physics
    parameters = [q for effect in effects for q in effect.parameters]
    plain = Assembly(effects, np.arange(len(parameters)), (), prepared, None, zeros=False)
    first = _accumulate(plain)
    rows: list[str] = [row for row in ROWS if any(row in run.triangles for run in first)]
    if not rows:
        absent = sorted({name for run in prepared for why in run.motion.left_out.values() for name in why.channels})
        lacking = "; not measured: " + ", ".join(absent) if absent else ""
        raise NotIdentifiable("no row of the equations is measured in these runs" + lacking)
    scale = _row_sizes(first, rows)
    stacked = [R[:, :-1] / scale[row] for run in first for row, R in run.triangles.items()]
    base = find_base(triangle(*stacked), [q.name for q in parameters])
    if not base.rank:
        raise NotIdentifiable("no parameter of the model acts on the rows measured in these runs")
    keep = base.independent
    picked = np.append(keep, len(parameters))
    runs = [replace(run, triangles={row: R[:, picked] for row, R in run.triangles.items()}) for run in first]
    equations = Equations(runs, known_beforehand(model, keep, faults=False), rows)
    least = {row: 1e-10 * scale[row] for row in rows}
    frozen = None if options.weights is None else {row: options.weights.get(row, scale[row]) for row in rows}
    x, sigma = (equations.solve(frozen), frozen) if frozen else equations.iterate(scale, least)
    known, begin = known_beforehand(model, keep), sigma
    need = options.zeros or bool(model.faults)

    def found_at(values: Array) -> tuple[Assembly, Equations, Array, Mapping[str, float]]:
        """Equations with sensitivities at these values of the parameters kept, and their solution."""
        at = np.zeros(len(parameters))
        at[keep] = values
        there = Assembly(
            effects, keep, model.faults, prepared, at if need else None, options.zeros, stored.known if stored else None
        )
        equations = Equations(_accumulate(there), known, rows)
        # From the same σ each time: those of data without noise are too small to begin with.
        return there, equations, *((equations.solve(frozen), frozen) if frozen else equations.iterate(begin, least))

    assembly, equations, x, sigma = found_at(x if near is None else near[keep])
    # How the residual answers to the channels depends on the parameters: what is found before the zeros are removed
    # (a laser's half millimetre is a hundred newtons of tyre load) can be off by a tenth, and the noise floor with it.
    if need and stored is None and near is None:
        assembly, equations, x, sigma = found_at(x[: len(keep)])
    for _ in range(_HUBER_TURNS - 1 if options.robust else 0):
        assembly = assembly.weighted(huber_weights(assembly, equations, x, sigma))
        equations = Equations(_accumulate(assembly), known, rows)
        x, sigma = (equations.solve(frozen), frozen) if frozen else equations.iterate(sigma, least)
    root = equations.root(sigma)
    correction, doubt = np.zeros(len(x)), np.zeros((len(x), len(x)))
    moments = NoiseMoments.none(len(x), options.draws)
    if options.unbias and stored:
        moments = stored.moments
    elif options.unbias:
        followers = zeros_following(equations.runs, sigma)
        for piece in assembly.pieces():
            progress(Step(Stage.NOISE_CORRECTION, piece.run, len(prepared)))
            moments.add(piece, effects, keep, sigma, followers[piece.run])
    if options.unbias:
        corrected, doubt = moments.correct(x, root, 1.0 / np.diag(known)[: len(x)])
        x, correction = corrected, corrected - x
    return _result(model, base, options, _Solution(assembly, equations, x, sigma, root, correction, doubt, moments))


@dataclass(frozen=True)
class _Solution:
    """A linear fit's solution `x` (q,), the equations it solves, and what was added to it for noise in the regressors.

    `root`, `correction`, `moments` as in `Fit`; `doubt` (q, q) covariance of the correction.
    """

    assembly: Assembly
    equations: Equations
    x: Array
    sigma: Mapping[str, float]
    root: Array
    correction: Array
    doubt: Array
    moments: NoiseMoments


def _accumulate(assembly: Assembly) -> list[RunEquations]:
    """The equations of every run, piece by piece."""
    out: list[RunEquations | None] = [None] * len(assembly.runs)
    for piece in assembly.pieces():
        run = out[piece.run]
        if run is None:
            names, priors = (piece.zeros.names, piece.zeros.sigma) if piece.zeros else ((), np.zeros(0))
            out[piece.run] = run = RunEquations(names, priors)
        if not all(np.all(np.isfinite(a)) for part in (piece.blocks, piece.right) for a in part.values()):
            refuse_not_finite(assembly.physics, [piece.prepared])
        for row, block in piece.blocks.items():
            run.add(row, block, piece.right[row], None if piece.weights is None else piece.weights[row])
    return [run for run in out if run is not None]


def _row_sizes(runs: Sequence[RunEquations], rows: Sequence[str]) -> dict[str, float]:
    """RMS of each row's left side: the length of the factor's last column."""
    out: dict[str, float] = {}
    for row in rows:
        having = [run for run in runs if row in run.triangles]
        squares = sum(float(np.sum(run.triangles[row][:, -1] ** 2)) for run in having)
        out[row] = float(np.sqrt(squares / sum(run.counts[row] for run in having))) or 1.0
    return out


def _result(model: Model, base: BaseParameters, options: FitOptions, found: _Solution) -> Fit:
    assembly, equations, x, sigma, root = found.assembly, found.equations, found.x, found.sigma, found.root
    zeros = equations.zeros(x, sigma)
    spread = spread_of(assembly, equations, x, zeros, sigma, sheet=assembly.at is not None)
    R, lengths = scaled_triangle(root[:, :-1])
    inverse = np.asarray(scipy.linalg.solve_triangular(R[: len(x)], np.eye(len(x)))) / lengths[:, None]
    iid = inverse @ inverse.T
    ours = frozenset[tuple[str, str]]().union(*(fault.sheet_entries for fault in model.faults))
    moved = [iid @ push for (what, channel, _), push in spread.sheet.items() if (what, channel) not in ours]
    physics = model.physics_size
    total = physics + len(model.faults)
    place = np.concatenate([base.independent, np.arange(physics, total)]).astype(int)

    def square(covariance: Array) -> Array:
        out = np.zeros((total, total))
        out[np.ix_(place, place)] = covariance
        return out

    def line(values: Array) -> Array:
        out = np.zeros(total)
        out[place] = values
        return out

    return Fit(
        model=model,
        runs=assembly.runs,
        base=base,
        theta=line(x),
        covariance=square(at_least(iid @ spread.scores @ iid, iid) + found.doubt),
        covariance_iid=square(iid),
        covariance_sheet=square(_outer(moved, len(x))),
        sigma=dict(sigma),
        residual=spread.residual,
        zeros=tuple((run.zeros, run.priors, z) for run, z in zip(equations.runs, zeros, strict=True)),
        correction=line(found.correction),
        moments=found.moments,
        place=place,
        root=root,
        assembly=assembly,
        equations=equations,
        options=options,
        removed=np.zeros(len(model.faults)),
    )


def _outer(moved: Sequence[Array], p: int) -> Array:
    """Σ m mᵀ."""
    return np.einsum("fi,fj->ij", moved, moved) if len(moved) else np.zeros((p, p))


def corrected_run(run: PreparedRun, fitted: Fit) -> PreparedRun:
    """A run with the sensor faults of a fitted model removed; the run itself when the model has none."""
    if not fitted.model.faults:
        return run
    return PreparedRun(at_faults(run.recording, fitted.model.faults, fitted.theta[len(fitted.physics) :]))


def refitted(fitted: Fit, runs: Sequence[PreparedRun], stored: Stored | None = None) -> Fit:
    """The same model, in the same way, on the same runs with channels moved; `stored` as in `fit`.

    Sizes of the model's sensor faults are those that remain.
    """
    return _fit_linear(fitted.model, tuple(runs), _weights_free(fitted), stored, near=fitted.physics)


def extended(fitted: Fit, effect: Effect) -> Fit:
    """The model with one more effect, fitted in the same way to the same runs.

    Sizes of the sensor faults that the model has already are those that remain.
    """
    return fit(fitted.model + effect, fitted.runs, _weights_free(fitted))


def _weights_free(fitted: Fit) -> FitOptions:
    """The options of a fit, rows weighted anew by their residuals."""
    return replace(fitted.options, weights=None)


def at_faults(recording: Recording, faults: Sequence[SensorFault], values: Array) -> Recording:
    """A recording with sensor faults of these sizes removed."""
    for fault, p in zip(faults, values, strict=True):
        there = [channel for channel in fault.channels() if channel in recording.signals.value]
        undone = {channel: fault.correct(channel, recording, float(p)) for channel in there}
        recording = recording.with_signals(recording.signals.changed(undone, recording.filters.rate))
    return recording
