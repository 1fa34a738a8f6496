"""Latencies of the sensors from ordinary runs, together with the model's parameters.

A late sensor adds to every row that it enters a part in proportion to the rate of its signal. These columns are valid
for small errors only: after each step the runs are read again with the latencies found, until the steps are small. The
equations of motion do not depend on absolute time: the same shift of all sensors changes nothing, so one sensor is the
time base and the others are estimated against it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import UsageError, nearest
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.gauss_newton import CHECK_RULE, LinearStep, StepRule
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.stacked_equations import Columns
from lacet.identify.regression.uncertainty import hac
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.time_base import is_load

PRIOR = 0.020
"""1 σ of a latency's error before any run [s]: so wide that it does not move what the runs determine."""

TESTABLE = 0.005
"""Half of a 95 % interval above which a latency counts as not testable with the runs [s]."""

_NEAR_RULE = replace(CHECK_RULE, close=0.001, close_of_interval=0.1)
"""Rule for a step that is small enough for the next fits to be corrected for noise in the regressors."""


@dataclass(frozen=True)
class SensorTiming:
    """The latency of one sensor.

    Attributes
    ----------
    sensor : row of the rig.
    rig : latency the rig file gives [s].
    found : latency found, when the time base's is right [s].
    half : half of its 95 % interval [s]; infinite when no row depends on the sensor.
    """

    sensor: str
    rig: float
    found: float
    half: float

    @property
    def testable(self) -> bool:
        """Whether its 95 % interval is narrow enough for a test of the rig file's value."""
        return self.half < TESTABLE

    @property
    def agrees(self) -> bool:
        """Whether the rig file's latency is within 3 σ, or within half a millisecond, of the latency found."""
        return abs(self.found - self.rig) <= max(1.5 * self.half, 0.0005)


@dataclass(frozen=True)
class Timings:
    """Latencies of a rig's sensors, estimated from runs.

    Attributes
    ----------
    base : the sensor that is the time base; its latency is the rig's.
    sensors : the others, in the rig's order.
    rig : the rig with the latencies found; those not testable keep their values.
    fit : fit of the model to the runs read with them.
    steps : number of times the runs were read.
    settled : whether the last step was small.
    """

    base: str
    sensors: tuple[SensorTiming, ...]
    rig: Rig
    fit: Fit
    steps: int
    settled: bool


def time_base(rig: Rig, runs: Sequence[Run]) -> str:
    """The sensor that all others are estimated against: that of the wheel loads, else the first that the runs have."""
    there = {channel for run in runs for channel in run.signals}
    measured = [s for s in rig.sensors if there.intersection(s.channels)]
    loads = [s for s in measured if any(map(is_load, s.channels))]
    return (loads or measured)[0].name


def estimate_latencies(
    model: Model,
    runs: Sequence[Run],
    vehicle: Vehicle,
    rig: Rig,
    filters: Filters | None = None,
    base: str | None = None,
    progress: Progress = silent,
    rule: StepRule = CHECK_RULE,
) -> Timings:
    """Estimate the latency of every sensor but the time base.

    Parameters
    ----------
    model : the physics; latencies in it are left out, as they are estimated here.
    runs, vehicle, rig : the runs as recorded, the car, and the rig to start from and to report against.
    base : name of the time base (default: `time_base`).
    rule : limit of the steps, and when they end; the runs are read once more than steps are made.

    Raises UsageError when the rig has no sensor `base`, NotIdentifiable when the runs have no row.
    """
    base = base or time_base(rig, runs)
    if base not in {s.name for s in rig.sensors}:
        names = [s.name for s in rig.sensors]
        raise UsageError(f"the rig has no sensor '{base}'{nearest(base, names)} (it has {', '.join(names)})")
    physics = Model.of(effect for effect in model.effects if not isinstance(effect, SensorLatency))
    there = {channel for run in runs for channel in run.signals}
    late = [s for s in rig.sensors if s.name != base and there.intersection(s.channels)]
    faults = [SensorLatency.of_sensor(s) for s in late]
    last: list[_Reading] = []  # no earlier one is kept: each holds the runs

    def step_at(steps_made: int, shift: Array) -> LinearStep:
        """The next step of the latencies, from the runs read with the present ones."""
        values = dict(zip((s.name for s in late), shift.tolist(), strict=True))
        progress(Step(Stage.LATENCIES, steps_made + 1, rule.most + 1, values=values))
        shifted = shifted_rig(rig, {s.name: float(x) for s, x in zip(late, shift, strict=True)})
        drives = [PreparedRun.of(run, vehicle, shifted, filters) for run in runs]
        # The correction for noise costs most of the time and moves latencies little: it comes last.
        unbias = bool(last) and last[0].is_near
        fitted = fit(physics, drives, FitOptions(unbias=unbias))
        step, covariance, seen = _step(fitted, faults, shift)
        half = TWO_SIDED_95 * np.sqrt(np.diag(covariance))
        last[:] = [_Reading(fitted, half, seen, unbias or _NEAR_RULE.is_small(rule.limited(step), shift, half))]
        return LinearStep(step, half, final=unbias)

    found = rule.relinearised(step_at, np.zeros(len(late)))
    (read,) = last
    timings = tuple(
        SensorTiming(s.name, s.latency, s.latency + float(x), float(h) if ok else np.inf)
        for s, x, h, ok in zip(late, found.values, read.half, read.seen, strict=True)
    )
    rig_found = shifted_rig(rig, {one.sensor: one.found - one.rig for one in timings if one.testable})
    return Timings(base, timings, rig_found, read.fitted, found.made + 1, found.settled)


@dataclass(frozen=True)
class _Reading:
    """Runs read with given latencies, and the fit to them.

    Attributes
    ----------
    fitted : fit of the model to these runs.
    half, seen : (l,) half of each latency's 95 % interval [s]; whether any row depends on it.
    is_near : whether the last step was small enough for the next fit to be corrected for noise.
    """

    fitted: Fit
    half: Array
    seen: NDArray[np.bool_]
    is_near: bool


def shifted_rig(rig: Rig, shifts: Mapping[str, float]) -> Rig:
    """The rig with latencies increased by `shifts`, sensor → [s]."""
    sensors = tuple(replace(s, latency=s.latency + shifts.get(s.name, 0.0)) for s in rig.sensors)
    return replace(rig, sensors=sensors)


def _step(fitted: Fit, faults: Sequence[SensorLatency], shift: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Step of the latencies (l,) [s], its covariance (l, l), and whether any row depends on each latency (l,).

    At the fit, the scores of the model's parameters are zero, corrected for noise or not. Those of the latencies need
    no such correction: to first order the noise of a latency's column is the rate of the residual's own noise, and a
    stationary series is orthogonal to its rate.
    """
    equations = Columns(fitted)
    q, n = len(faults), equations.start.size
    square, mixed, right = np.zeros((q, q)), np.zeros((n, q)), np.zeros(q)
    blocks: list[dict[Row, tuple[Array, Array, Array]]] = []
    for d, run in enumerate(fitted.runs):
        answers = [run.decimated(fitted.sensitivities[d].fault(fault)) for fault in faults]
        part: dict[Row, tuple[Array, Array, Array]] = {}
        for row in run.rows:
            U = equations.columns(d, row, run) @ equations.inverse
            none = np.zeros(len(U))
            C = np.stack([answer.get(row, none) for answer in answers], axis=1) / fitted.sigma[row]
            r = fitted.residual[d][row] / fitted.sigma[row]
            part[row] = U, C, r
            square, mixed, right = square + C.T @ C, mixed + U.T @ C, right + C.T @ r
        blocks.append(part)
    seen = np.diag(square) > 0.0
    information = square - mixed.T @ mixed + np.eye(q) / PRIOR**2
    spread = np.eye(q) / PRIOR**2
    for d, part in enumerate(blocks):
        step = fitted.runs[d].recording.filters.step
        scores = np.zeros((fitted.runs[d].recording.t.size // step + 1, q))
        for row, (known, late, r) in part.items():
            scores[fitted.runs[d].index[row] // step] += (late - known @ mixed) * r[:, None]
        spread += hac(scores)
    inverse = np.linalg.inv(information)
    return inverse @ (right - shift / PRIOR**2), inverse @ spread @ inverse, seen
