"""The weighted least-squares solve for the unknown forces at each instant of a run, all instants at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.car.rows import CHASSIS_ROWS, Row
from lacet.identify.effects.base import AXLES, with_places
from lacet.identify.effects.user_files import checked_columns
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.uncertainty import BLOCK
from lacet.identify.signals.decimation import decimated
from lacet.identify.wheel_loads.known_car import Changes, KnownCar
from lacet.identify.wheel_loads.outputs import SUMS
from lacet.identify.wheel_loads.run_constants import (
    ASSUMED,
    Column,
    Constant,
    constants_of,
    information,
    per_wheel_mass,
    present,
    without_loads,
)
from lacet.identify.wheel_loads.settings import DRAWS, PASSING, TURNS
from lacet.identify.wheel_loads.tyre_contact import (
    UNKNOWNS,
    TyreContact,
    WheelLoads,
    with_loads,
)
from lacet.identify.wheel_loads.without_dynamometers import placed, vertical_rows


@dataclass(frozen=True)
class Solved:
    """Forces of a run or a piece of it before its constants are known, and how they depend on these.

    Attributes
    ----------
    t : (n,) [s].
    value : (n, forces) [N]; `slopes` (n, forces, q) change of it per σ of each constant, in single precision.
    variance : source → (n, forces) variance of `value` that is not from the constants [N²].
    axles : (n,) whether longitudinal forces are determined by axle.
    constants : of the run; `normal` (q, q), `right` (q,) what the samples say of them, each ÷ its σ.
    floors : row → noise floor with dynamometers [N or N·m].
    """

    t: Array
    value: Array
    slopes: NDArray[np.float32]
    variance: Mapping[str, Array]
    axles: NDArray[np.bool_]
    constants: tuple[Constant, ...]
    normal: Array
    right: Array
    floors: Mapping[Row, float]


@dataclass(frozen=True)
class RowErrors:
    """Errors of the rows at an instant.

    Attributes
    ----------
    noise : (rows, rows) covariance of the noise of the run's channels.
    dynamometers : (rows,) variance that dynamometers would add.
    lack, assumed : (rows,) variances of the lack of fit, and of what is assumed and passes within the run.
    """

    noise: Array
    dynamometers: Array
    lack: Array
    assumed: Array

    def variance(self, alike: float = 1.0) -> Array:
        """(rows,) variance of a row, in which errors other than noise stay the same for `alike` samples."""
        return np.diag(self.noise) + alike * (self.lack + self.assumed)


class Instants:
    """Equations of a run, or of a piece of a long one, for its wheel loads at each instant.

    Parameters
    ----------
    run : with loads of 0 in the place of measured ones.
    rows : the rows to join.
    """

    def __init__(
        self, car: KnownCar, run: PreparedRun, rows: tuple[Row, ...], changes: Changes, rng: np.random.Generator
    ):
        self.car, self.run, self.rows, self.changes, self.rng = car, run, rows, changes, rng
        self.motion = run.motion
        self.usable = _through_gaps(run, rows)

    def solved(self) -> Solved:
        """The forces and what they depend on."""
        fitted = self.car.fitted
        contact = TyreContact(self.motion, self.run.recording.vehicle.corners, self.car.assumed, self.car.outboard)
        values = np.zeros((len(UNKNOWNS), self.motion.t.size))
        variance = np.array([fitted.sigma[row] ** 2 for row in self.rows])
        for turn in range(TURNS):
            contact = contact.divided(values) if turn else contact
            values = self.improved(contact, values, self.solver(contact, variance))
        contact = contact.divided(values)
        loads = contact.loads(values)
        # With the loads in place, noise and zeros of the other channels do in the rows what they do to true loads.
        run = PreparedRun(placed(self.run.recording, loads), self.run.offset, self.run.index, is_piece=True)
        sensitivity = Sensitivity.of(run.recording, fitted.model.physics, fitted.physics)
        assumed = self._assumed(contact, values)
        errors = self._errors(run, sensitivity, assumed)
        gains = self.solver(contact, errors.variance())
        values = self.improved(contact, values, gains)
        constants, C = constants_of(self.car, self.changes, run, self.rows, sensitivity, assumed)
        return self._solved(contact, values, gains, errors, tuple(constants), C)

    def improved(self, contact: TyreContact, values: Array, gains: tuple[Array, Array]) -> Array:
        """The values (8, N) of the unknowns that rows and assumed difference of the axles give, from others near by."""
        gain, split = gains
        back = np.einsum("nir,rn->in", gain, self._residual(contact.loads(values)))
        return values - back - split.T * contact.difference.off(values)

    def _residual(self, loads: WheelLoads) -> Array:
        """(rows, N) left less right sides with these loads, at full rate."""
        fitted, motion = self.car.fitted, with_loads(self.motion, loads)
        out = np.stack([motion.measured(row) for row in self.rows])
        place_of = {row: i for i, row in enumerate(self.rows)}
        for effect, place in with_places(fitted.model.physics):
            values = fitted.physics[place]
            for row, columns in checked_columns(effect, motion).items():
                if row in place_of:
                    out[place_of[row]] -= values @ columns
        if self.changes.mass:
            more = np.sum([per_wheel_mass(self.motion, c, self.rows) for c in CORNERS], axis=0)
            out -= self.changes.mass * more
        return out

    def _per_unknown(self, contact: TyreContact) -> Array:
        """(N, rows, unknowns) left sides per newton of each unknown."""
        return np.stack([contact.in_rows(loads, self.rows) for loads in contact.per_unit()]).transpose(2, 1, 0)

    def solver(self, contact: TyreContact, variance: Array) -> tuple[Array, Array]:
        """(N, unknowns, rows) what each row's residual takes from the unknowns, and (N, unknowns) what one newton of
        the axles' assumed difference adds; `variance` (rows,).
        """
        K, weight = self._per_unknown(contact), (self.usable / variance[:, None]).T
        prior, strength = contact.difference.equations()
        weighted = (K * weight[..., None]).transpose(0, 2, 1)
        both = np.concatenate([weighted, prior[..., None]], axis=2)
        found = np.asarray(np.linalg.solve(weighted @ K + strength, both), float)
        return found[..., :-1], found[..., -1]

    def _assumed(self, contact: TyreContact, values: Array) -> list[Column]:
        """What is assumed, with its change of the rows for one σ, at full rate."""
        grounds = [c for c in CORNERS if f"laser.{c}.ground" in self.run.recording.signals.value]
        return [
            Column(Constant(one.name, ASSUMED, one.sigma), one.sigma * contact.in_rows(one.loads, self.rows))
            for one in contact.assumptions(values, grounds)
        ]

    def _errors(self, run: PreparedRun, sensitivity: Sensitivity, assumed: Sequence[Column]) -> RowErrors:
        """Errors of the rows, from the sheet's noise, the study's lack of fit and the tolerances."""
        passing = PASSING * np.sum([np.mean(one.change**2, axis=1) for one in assumed], axis=0)
        lack = np.array([self.car.lack.get(row, 0.0) for row in self.rows]) ** 2
        noise = self._covariance(run, without_loads(sensitivity))
        with_dynamometers = np.diag(self._covariance(run, sensitivity))
        return RowErrors(noise, np.maximum(with_dynamometers - np.diag(noise), 0.0), lack, passing)

    def _covariance(self, run: PreparedRun, sensitivity: Sensitivity) -> Array:
        """(rows, rows) covariance of the rows from the noise of the channels of a sensitivity, after the filter."""
        square, count = np.zeros((len(self.rows), len(self.rows))), np.zeros((len(self.rows), len(self.rows)))
        there = present(run, self.rows).T
        for drawn in sensitivity.noises(self.rng, DRAWS):
            series = run.decimated(drawn)
            found = np.zeros((len(next(iter(drawn.values()))), *there.shape))
            for i, row in enumerate(self.rows):
                if row in series:
                    found[:, i, run.kept(row)] = series[row]
            square += np.einsum("drn,dsn->rs", found, found, optimize=True)
            count += len(found) * (there @ there.T)
        return square / np.maximum(count, 1.0)

    def _solved(
        self, contact: TyreContact, values: Array, gains: tuple[Array, Array], errors: RowErrors,
        constants: tuple[Constant, ...], C: Array,
    ) -> Solved:  # fmt: skip
        """The forces after the filter, with their dependence on the constants `C` (comb, rows, q)."""
        recording, comb = self.run.recording, self.run.comb
        difference = contact.difference.at(comb)
        there = present(self.run, self.rows)
        rest = decimated(self._residual(contact.loads(values)), recording.filters).T * there
        alike = BLOCK * recording.filters.rate / recording.filters.step
        weight = there / errors.variance(alike)
        if self.changes.rest is not None:
            start, stop = self.changes.rest
            weight = weight * ((recording.t[comb] >= start) & (recording.t[comb] <= stop))[:, None]
        off = decimated(contact.difference.off(values)[None], recording.filters)[0]
        lasting = contact.difference.at(comb, alike)
        normal, right = information(C, self._per_unknown(contact)[comb], rest, weight, lasting, off)
        T, split = SUMS @ gains[0][comb], gains[1][comb] @ SUMS.T
        slopes = -(T @ C)
        among = np.array([one.kind == ASSUMED for one in constants])
        variance = {
            "noise": np.einsum("nfr,rs,nfs->nf", T, errors.noise, T, optimize=True),
            "lack of fit": np.einsum("nfr,r->nf", T**2, errors.lack),
            ASSUMED: PASSING / (1.0 - PASSING) * np.sum(slopes[..., among] ** 2, axis=2)
            + (difference.sigma[:, None] * split) ** 2,
        }
        own, by_axle = self._reported(there)
        reported = decimated(values, recording.filters).T @ SUMS.T
        floors = np.sqrt(np.diag(errors.noise) + errors.dynamometers)
        return Solved(
            recording.t[comb][own], reported[own], slopes[own].astype(np.float32),
            {kind: part[own] for kind, part in variance.items()}, by_axle[own], constants, normal, right,
            dict(zip(self.rows, floors.tolist(), strict=True)),
        )  # fmt: skip

    def _reported(self, there: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(comb,) instants at which the forces are determined, and at which longitudinal ones are by axle.

        `there` (comb, rows) : 1 where a row has a sample. What was solved without a row is not smeared into them.
        """
        place = {row: i for i, row in enumerate(self.rows)}
        own = _determined(there.T > 0.0, self.rows)
        by_axle = np.zeros_like(own)
        for wheels in AXLES.values():
            spins = [place[row] for c in wheels if (row := Row(f"spin.{c}")) in place]
            by_axle |= (len(spins) == len(wheels)) & np.all(there[:, spins] > 0.0, axis=1)
        filters = self.run.recording.filters
        width = 2 * round(filters.edge * filters.rate / filters.step) + 1

        gap = (own & ~by_axle).astype(float)
        return own, by_axle & (scipy.ndimage.maximum_filter1d(gap, width, mode="constant") == 0.0)


def _through_gaps(run: PreparedRun, rows: Sequence[Row]) -> NDArray[np.bool_]:
    """(rows, N) whether a row is solved with: where it is usable, and where the forces are not determined otherwise.

    These are the run's ends and gaps, of which nothing is reported. Without rows the solution there would be without
    bound, and the filter would carry it to instants that are.
    """
    measured = run.measured_rows
    usable = np.stack([measured.usable[row] for row in rows])
    always = np.array([not measured.torques[row].released for row in rows])
    return usable | (always[:, None] & ~_determined(usable, rows))


def _determined(there: NDArray[np.bool_], rows: Sequence[Row]) -> NDArray[np.bool_]:
    """(N,) whether `there` (rows, N) has the chassis rows and, of each wheel, a row of its vertical force."""
    place = {row: i for i, row in enumerate(rows)}
    out = there[place[CHASSIS_ROWS[0]]].copy()
    for c in CORNERS:
        out &= np.any(there[[place[row] for row in vertical_rows(c) if row in place]], axis=0)
    return out
