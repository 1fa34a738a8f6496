"""Observer of the wheel forces: weighted least squares at each instant, and the run's constants from all instants.

Of each row of the equations, A f = W θ + T, everything but the loads f is known from the model and from the run's other
channels. The unknowns u are the vertical force at each wheel and the longitudinal and lateral force of each axle; they
make the loads f together with what is assumed of the contact (`tyre_contact`). With the rows' noise floors and lack of
fit as weights, u is the weighted least-squares solution of every instant (`instants`). What is constant in a run is
estimated with its tolerance as prior from what the rows say too often (`run_constants`), and what remains unknown of
it is in the band. Formulas: docs/forces.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.sources.completion import completed
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import corrected_run
from lacet.identify.wheel_loads.instants import Instants, Solved
from lacet.identify.wheel_loads.known_car import NOTHING, Changes, KnownCar
from lacet.identify.wheel_loads.outputs import FORCES, EstimatedForce, EstimatedForces, RunConstant, row_of
from lacet.identify.wheel_loads.without_dynamometers import as_measured, placed, rows_of


def estimate_forces(car: KnownCar, run: PreparedRun, changes: Changes = NOTHING, seed: int = 1) -> EstimatedForces:
    """Wheel forces of a run. Its own wheel loads, where it has any, are not used.

    `car` : as a study knows it. `changes` : what differs on this run. `seed` : of the noise draws.

    Raises NotIdentifiable, with the channels to add, where a row is missing without which they cannot be found.
    """
    # Wheel speeds, say, can be derived as soon as there are loads to form rows of.
    hidden = PreparedRun(completed(placed(as_measured(corrected_run(run, car.fitted).recording), {})))
    rows = rows_of(hidden.recording, car.fitted.sigma)
    pieces = [
        Instants(car, piece, rows, changes, np.random.default_rng([seed, number])).solved()
        for number, piece in enumerate(hidden.pieces())
    ]
    band, constants = _of_all(car, pieces)
    recording = hidden.recording
    return EstimatedForces(
        recording.run, np.concatenate([piece.t for piece in pieces]), _forces(pieces, band), recording.reference, rows,
        constants, recording.filters.fit_cutoff,
    )  # fmt: skip


@dataclass(frozen=True)
class _Band:
    """(n, forces) `value` of the forces and their `variance`; source → (forces,) mean square that it adds to it."""

    value: Array
    variance: Array
    parts: Mapping[str, Array]


def _of_all(car: KnownCar, pieces: Sequence[Solved]) -> tuple[_Band, tuple[RunConstant, ...]]:
    """The forces of all pieces with the run's constants, which all of them and the study's runs together say."""
    constants = pieces[0].constants
    known, side = car.said_by_study([one.of_study for one in constants])
    normal = np.eye(len(constants)) + known + np.sum([piece.normal for piece in pieces], axis=0)
    covariance = np.asarray(np.linalg.inv(normal), float)
    found = covariance @ (side + np.sum([piece.right for piece in pieces], axis=0))
    value = np.concatenate([piece.value + piece.slopes @ found for piece in pieces])
    count, total = len(value), np.concatenate([_spread(piece, covariance) for piece in pieces])
    # The part of a kind of constants: what the variance would lose if they were known.
    parts: dict[str, Array] = {}
    for kind in dict.fromkeys(one.kind for one in constants):
        others = np.array([one.kind != kind for one in constants])
        left = np.zeros_like(covariance)
        left[np.ix_(others, others)] = np.linalg.inv(normal[np.ix_(others, others)])
        parts[kind] = (
            np.mean(total, axis=0) - np.sum([np.sum(_spread(p, left), axis=0) for p in pieces], axis=0) / count
        )
    variance = total
    for source in pieces[0].variance:
        own = np.concatenate([piece.variance[source] for piece in pieces])
        variance = variance + own
        parts[source] = parts.get(source, 0.0) + np.mean(own, axis=0)
    seen = tuple(
        RunConstant(one.name, one.kind, one.mean, one.sigma, one.mean + one.sigma * x, one.sigma * float(np.sqrt(left)))
        for one, x, left in zip(constants, found.tolist(), np.diag(covariance), strict=True)
    )
    return _Band(value, variance, parts), seen


def _spread(piece: Solved, covariance: Array) -> Array:
    """(n, forces) variance of the forces of a piece from that of the constants, each ÷ its σ."""
    slopes = piece.slopes.astype(float)
    return np.sum((slopes @ covariance) * slopes, axis=2)


def _forces(pieces: Sequence[Solved], band: _Band) -> dict[str, EstimatedForce]:
    """The forces by name; longitudinal ones by axle only where they are determined."""
    axles = np.concatenate([piece.axles for piece in pieces])
    out: dict[str, EstimatedForce] = {}
    for i, name in enumerate(FORCES):
        by_axle = name.startswith("axle") and name.endswith("x")
        known, row = (axles if by_axle else np.ones_like(axles)), row_of(name)
        floors = [piece.floors[row] ** 2 for piece in pieces if row in piece.floors]
        parts = {kind: float(np.sqrt(max(part[i], 0.0))) for kind, part in band.parts.items()}
        value = np.where(known, band.value[:, i], np.nan)
        half = np.where(known, TWO_SIDED_95 * np.sqrt(band.variance[:, i]), np.nan)
        out[name] = EstimatedForce(name, value, half, parts, row, float(np.sqrt(np.mean(floors))) if floors else 0.0)
    return out
