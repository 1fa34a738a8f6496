"""Estimated wheel forces beside measured ones, for runs that do have dynamometers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.errors import NotIdentifiable
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import CHASSIS_ROWS
from lacet.identify.effects.base import AXLES
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array, dot
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import corrected_run
from lacet.identify.signals.decimation import decimated
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.wheel_loads.known_car import KnownCar
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.identify.wheel_loads.outputs import FORCES, SUMS, EstimatedForces
from lacet.identify.wheel_loads.settings import DRAWS
from lacet.identify.wheel_loads.tyre_contact import UNKNOWNS, WheelAxes
from lacet.identify.wheel_loads.without_dynamometers import LOADS


@dataclass(frozen=True)
class ForceError:
    """Error of an estimated force against the dynamometers.

    Attributes
    ----------
    measured : (n,) the dynamometers' force, their zero removed; NaN where it is not estimated.
    offset : mean of measured − estimated over the run, before that [N]: no zero of a dynamometer is known better.
    rms : of the error about its mean [N]; `floors` : the same ÷ noise floor of the force's row.
    zero : what was taken as the zeros of the dynamometers [N], from the offset with the sheet's σ as prior.
    inside : part of the instants at which the 95 % band, widened by the dynamometers' noise, holds the measured force.
    """

    measured: Array
    offset: float
    rms: float
    floors: float
    zero: float
    inside: float


@dataclass(frozen=True)
class ComparedForces:
    """Wheel forces of a run with dynamometers, `estimated` without them, and their `errors` by name."""

    estimated: EstimatedForces
    errors: Mapping[str, ForceError]


def compare_forces(car: KnownCar, run: PreparedRun) -> ComparedForces | None:
    """Wheel forces of a run estimated without its dynamometers, beside theirs; None where the rows do not give them."""
    if not has_loads(run):
        return None
    try:
        estimated = estimate_forces(car, run)
    except NotIdentifiable:
        return None
    return ComparedForces(estimated, errors(estimated, corrected_run(run, car.fitted)))


def forces_of(motion: Motion) -> Array:
    """(forces, N) the forces of `FORCES` that the loads of a motion make, at full rate [N]."""
    axes = {c: WheelAxes(wheel) for c, wheel in motion.corners.items()}
    by_name = {f"z.{c}": dot(motion.corners[c].force, axes[c].z) for c in CORNERS}
    for axle, wheels in AXLES.items():
        for name in "xy":
            along = [dot(motion.corners[c].force, getattr(axes[c], name)) for c in wheels]
            by_name[f"{name}.{axle}"] = np.sum(along, axis=0)
    return SUMS @ np.stack([by_name[name] for name in UNKNOWNS])


def has_loads(run: PreparedRun) -> bool:
    """Whether dynamometers measured all wheel loads of a run."""
    return all(name in run.recording.signals.value for name in LOADS)


def errors(estimated: EstimatedForces, run: PreparedRun, exact: bool = False) -> Mapping[str, ForceError]:
    """Errors of the estimated forces of a run with dynamometers, by name.

    `exact` : the run's loads have neither noise nor zeros. Raises ValueError for a run without dynamometers.
    """
    if not has_loads(run):
        raise ValueError(f"{run.name} has no measured wheel loads")
    series = run.filtered(CHASSIS_ROWS[0], forces_of)
    t = run.recording.t[run.index[CHASSIS_ROWS[0]]]
    place, there = _places(estimated.t, t)
    noise, tolerance = np.zeros(len(FORCES)), np.zeros(len(FORCES))
    if not exact:
        noise, tolerance = _noise(run), _tolerance(run)
    out: dict[str, ForceError] = {}
    for i, name in enumerate(FORCES):
        force = estimated[name]
        measured = np.where(there & force.determined, series[i, place], np.nan)
        used = np.isfinite(measured)
        if not np.any(used):
            continue
        off = measured[used] - force.value[used]
        spread = float(np.mean(force.half95[used])) / TWO_SIDED_95
        offset, rms = float(np.mean(off)), float(np.std(off))
        zero = offset * tolerance[i] ** 2 / (tolerance[i] ** 2 + spread**2) if tolerance[i] else 0.0
        error = off - zero
        half = np.hypot(force.half95[used], TWO_SIDED_95 * noise[i])
        inside = float(np.mean(np.abs(error) <= half))
        out[name] = ForceError(measured - zero, offset, rms, rms / force.floor if force.floor else 0.0, zero, inside)
    return out


def _places(wanted: Array, t: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Index in `t` of each wanted instant, and whether it is there."""
    place = np.clip(np.searchsorted(t, wanted - 1e-6), 0, t.size - 1)
    return place, np.abs(t[place] - wanted) < 1e-6


def _noise(run: PreparedRun) -> Array:
    """(forces,) 1 σ of the dynamometers' noise in each force after the filter [N]."""
    recording = run.recording
    part = recording.at(slice(0, min(recording.t.size, round(20.0 * recording.filters.rate))))
    names = [f"wheel.{c}.force" for c in CORNERS]
    squares: list[float] = []
    for seed in range(DRAWS):
        drawn = draw_noise(part, names, np.random.default_rng([seed, 31]))
        series = np.stack([drawn[name][2] for name in names])
        squares.append(float(np.mean(decimated(series, recording.filters) ** 2)))
    return float(np.sqrt(np.mean(squares))) * np.sqrt(_wheels())


def _tolerance(run: PreparedRun) -> Array:
    """(forces,) 1 σ of the zeros of the dynamometers in each force, by the sensor sheet [N]."""
    rig = run.recording.rig
    each = float(np.mean([rig.tolerance(f"wheel.{c}.force", "zero") for c in CORNERS]))
    return each * np.sqrt(_wheels())


def _wheels() -> Array:
    """(forces,) number of wheels whose forces are in each."""
    return SUMS @ np.array([1.0 if name.startswith("z") else 2.0 for name in UNKNOWNS])
