"""Constants of a run that its wheel loads depend on: zeros and gains of its sensors, errors of the parameters, what is
assumed, a change of mass. Each has a σ beforehand; what the rows say too often says more of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CORNERS, other_corner
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array, cross, dot
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.tolerances import ASSUMED as NOT_MEASURED
from lacet.identify.regression.tolerances import SheetEntry, sheet_entries, sheet_responses
from lacet.identify.signals.decimation import decimated
from lacet.identify.wheel_loads.known_car import Changes, KnownCar
from lacet.identify.wheel_loads.settings import NEW_OFFSET, PASSING
from lacet.identify.wheel_loads.tyre_contact import AxleDifference
from lacet.identify.wheel_loads.without_dynamometers import LOADS

ASSUMED = "assumed"
"""Kind of the constants that are assumed."""
INSTRUMENTS = "gains and latencies"
"""Kind of the errors of the run's and of the study's instruments."""


@dataclass(frozen=True)
class Constant:
    """A constant of a run: its `name` and `kind`; `mean` and `sigma` before the run is seen, in its unit.

    `of_study` : entry of the study's sensor sheet that it is the error of.
    """

    name: str
    kind: str
    sigma: float
    mean: float = 0.0
    of_study: SheetEntry | None = None


@dataclass(frozen=True)
class Column:
    """A constant with the `change` (rows, N) of the rows' residuals, at full rate, that one σ of it takes away."""

    constant: Constant
    change: Array


def per_wheel_mass(motion: Motion, c: str, rows: Sequence[Row]) -> Array:
    """(rows, N) right sides per kilogram of mass at a wheel's centre.

    With ``hub`` loads it is outboard of the transducer and only in the tyre's row, as `outboard_mass` is.
    """
    wheel, out = motion.corners[c], np.zeros((len(rows), motion.t.size))
    for i, row in enumerate(rows):
        if motion.reference == "hub":
            if row == f"tyre.{c}":
                out[i] = -dot(wheel.centre_accel, wheel.normal)
        elif row.kind == "chassis":
            force = wheel.centre_accel if row.unit == "N" else cross(wheel.centre, wheel.centre_accel)
            out[i] = force["xyz".index(row.place[1])]
        elif row == f"suspension.{c}":
            out[i] = dot(wheel.centre_accel, wheel.dp_ds)
        elif row == f"suspension.{other_corner(c)}" and wheel.other_dp_ds is not None:
            out[i] = dot(wheel.centre_accel, wheel.other_dp_ds)
    return out


def without_loads(sensitivity: Sensitivity) -> Sensitivity:
    """A sensitivity to all channels but the wheel loads."""
    coarse = {key: rows for key, rows in sensitivity.taken.coarse.items() if key[0] not in LOADS}
    return replace(sensitivity, taken=replace(sensitivity.taken, coarse=coarse))


def constants_of(
    car: KnownCar, changes: Changes, run: PreparedRun, rows: Sequence[Row], sensitivity: Sensitivity,
    assumed: Sequence[Column],
) -> tuple[list[Constant], Array]:  # fmt: skip
    """The constants of a run with estimated loads in place, and (comb, rows, q) change of its rows per σ of each.

    `assumed` : what is assumed, a part of which is constant.
    """
    own, recording = without_loads(sensitivity), run.recording
    zeros = zeros_of(run, own, every=True)
    constants = [Constant(name, "zeros", s) for name, s in zip(zeros.names, zeros.sigma.tolist(), strict=True)]
    parts = [-dense(run, rows, zeros.columns, len(zeros.names)) * zeros.sigma]
    responses = sheet_responses(run, own)
    channels = [name for name in recording.signals.value if name not in LOADS]
    physics = car.fitted.model.physics
    per_parameter = {row: run.matrix(physics, row) for row in run.rows}

    def of_parameters(moved: Array) -> dict[Row, Array]:
        return {row: matrix @ moved for row, matrix in per_parameter.items()}

    entries = sheet_entries(recording.rig, channels, recording.assumptions)
    for error in car.instrument_errors(recording.rig, entries):
        columns = of_parameters(error.moved[:, None])
        if error.here is not None:
            for row, series in responses.get(error.here, {}).items():
                columns[row] = columns.get(row, 0.0) - series[:, None]
        parts.append(dense(run, rows, columns, 1))
        kind = "channels not measured" if error.here is not None and error.here[0] == NOT_MEASURED else INSTRUMENTS
        constants.append(Constant(error.name, kind, 1.0, of_study=error.of_study))
    errors = car.parameter_errors
    parts.append(dense(run, rows, of_parameters(errors), errors.shape[1]))
    constants += [Constant(f"parameters {k + 1}", "parameters", 1.0) for k in range(errors.shape[1])]
    further = [replace(one, change=one.change * np.sqrt(1.0 - PASSING)) for one in assumed]
    motion = run.motion
    if spread := changes.mass_sigma:
        masses = {c: Constant(f"mass of the wheel, {c}", "mass", spread, changes.mass) for c in CORNERS}
        further += [Column(masses[c], -spread * per_wheel_mass(motion, c, rows)) for c in CORNERS]
    if changes.rest is not None:
        for c in CORNERS:
            change = np.zeros((len(rows), motion.t.size))
            if (row := Row(f"suspension.{c}")) in rows:
                change[rows.index(row)] = -NEW_OFFSET
            further.append(Column(Constant(f"static offset, {c}", "offsets", NEW_OFFSET), change))
    filtered = decimated(np.stack([one.change for one in further]), recording.filters)
    parts.append(filtered.transpose(2, 1, 0) * present(run, rows)[..., None])
    return [*constants, *(one.constant for one in further)], np.concatenate(parts, axis=2)


def dense(run: PreparedRun, rows: Sequence[Row], columns: Mapping[Row, Array], width: int) -> Array:
    """(comb, rows, width) columns row → (n, width) of the kept samples, 0 where a row has none."""
    out = np.zeros((run.comb.size, len(rows), width))
    for i, row in enumerate(rows):
        if row in columns and row in run.index:
            out[run.kept(row), i] = columns[row]
    return out


def present(run: PreparedRun, rows: Sequence[Row]) -> Array:
    """(comb, rows) 1 where a row has a kept sample, else 0."""
    return dense(run, rows, {row: np.ones((len(places), 1)) for row, places in run.index.items()}, 1)[..., 0]


def information(
    C: Array, K: Array, rest: Array, weight: Array, difference: AxleDifference, off: Array
) -> tuple[Array, Array]:
    """Normal matrix (q, q) and right side (q,) of the constants ÷ their σ, each instant's unknowns eliminated.

    Parameters
    ----------
    C : (n, rows, q) change of the rows per constant; `K` : (n, rows, unknowns) per unknown.
    rest : (n, rows) residual; `weight` : (n, rows) 1 ÷ variance of each row, 0 where it is absent.
    difference : what is assumed of the axles' longitudinal forces; `off` (n,) how far the unknowns are from it [N].
    """
    used = np.any(weight > 0.0, axis=1)
    per_unknown, weight = K[used], weight[used]
    prior, strength = difference.at(used).equations()
    normal = np.einsum("nri,nr,nrj->nij", per_unknown, weight, per_unknown) + strength
    both = np.concatenate([C[used], rest[used, :, None]], axis=2)
    weighted = both * weight[..., None]
    projected = per_unknown.transpose(0, 2, 1) @ weighted
    projected[..., -1] += prior * off[used, None]
    solved = np.asarray(np.linalg.solve(normal, projected), float)
    total = np.einsum("nrq,nrp->qp", weighted, both, optimize=True)
    total -= np.einsum("niq,nip->qp", projected, solved, optimize=True)
    return total[:-1, :-1], -total[:-1, -1]
