"""Equations of a car on one run, beside them what a scale error or a delay of each channel would change.

The laws are those of the base model, and spring and damping across each axle.

The left sides are linear in the wheel loads, so that the scale of one of their columns is estimated exactly, beside all
parameters of the car; in the other channels it is a first-order estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.effects.sensors.sensor_position import SensorPosition
from lacet.identify.effects.suspension.across_axle import AcrossAxle
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import ROUGH, Sensitivity
from lacet.identify.signals.decimation import decimated
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.column_kinds import LOADS, kind_of, sensors_of
from lacet.identify.validation.channels.vehicle_lengths import Length, length_columns

BLOCKS = 8
"""Blocks of a run, each left out in turn, from which the estimates have their spread (jackknife)."""
_DRAWS = 8
"""Simulated draws of noise behind the weights of the rows, known to about 2 %."""
_PRIORS = 1e-3
"""Weight of the parameters' priors in the first estimate, by which the equations are linearised."""


ANY_DELAY = 0.05
"""Prior of the delay of an instrument, 1 σ [s]: it is not to be blamed on one of its columns."""
_TOGETHER = 1e-5
"""Prior of the delay of one kind of an instrument's columns behind the others, 1 σ [s]: they share their stamps."""
LATE = 0.010
"""Delay from which a column, or an instrument, is late [s]: several times what sensor sheets leave open."""
_NO_DELAY = 1e-6
"""Prior of a delay that is the rig's, 1 σ [s]."""
_ANYWHERE = 0.5
"""Prior of the inertial unit's position error, and of a length's, 1 σ [m]."""
_EVERY = np.arange(len(Length))
_LENGTHS = _EVERY - len(Length) - 1
_UNIT = np.arange(3) - len(Length) - 4
_COLUMNS = slice(None, -len(Length) - 4)
"""Places of the lengths, of the position of the inertial unit and of the columns' faults in the products."""


@dataclass(frozen=True)
class FaultEstimate:
    """Estimates of a channel's column as the only one at fault.

    Attributes
    ----------
    column : name in the exchange table.
    scale, scale_spread : true ÷ recorded value, 1 for a sound column, and its 1 σ (jackknife).
    delay, delay_spread : samples later than the rig says by this [s], and its 1 σ.
    scale_fall, delay_fall : weighted squares that it takes away, ÷ number of samples.
    noise, rate_noise : variance of the sheet's noise ÷ variance of the column, and of its rate, up to the fit's
        cut-off: where it is not small, noise in the column biases the estimate towards that of a dead one.
    """

    column: str
    scale: float
    scale_spread: float
    delay: float
    delay_spread: float
    scale_fall: float
    delay_fall: float
    noise: float
    rate_noise: float


@dataclass(frozen=True)
class PlaceEstimate:
    """Estimate of places that are not as the files say, all together: of the inertial unit, or of the wheels.

    `value`, `spread` (3,) how much farther along the body axes the unit is, or how much longer each `Length` is, and
    1 σ [m]; `fall` : weighted squares that this takes away, ÷ number of samples.
    """

    value: Array
    spread: Array
    fall: float


@dataclass(frozen=True)
class FaultColumns:
    """Products of the equations with the columns of all faults, by block of the run.

    Attributes
    ----------
    columns : names of the channels' columns that a row depends on.
    whole : (w, w) products of [nuisance, scale and delay of each column, position of the inertial unit along three
        axes, lengths of the vehicle file, left side], rows ÷ noise floor; the zeros of all columns are removed run by
        run.
    left_out : (B, w, w) the same with one block left out.
    halves : (2, w, w) the same of the first and of the second half alone; of several runs, all of theirs.
    precision : (q, q) inverse covariance beforehand of the nuisance: parameters of the laws, delays of kinds of
        columns, of an instrument all alike.
    noise, signal : (c, 2) variance of the sheet's noise, and of the column, of its values and of its rate, up to the
        fit's cut-off, times the number of samples.
    count : number of samples.
    kinds : kinds of columns whose delays are the last of the nuisance, in their order (`kind_of`).
    instruments : (s, k) whether a kind is an instrument's, of those that have several.
    noise_of_delays : (k,) squares that the sheet's noise alone has in the change by each of these delays.
    """

    columns: tuple[str, ...]
    whole: Array
    left_out: Array
    halves: Array
    precision: Array
    noise: Array
    signal: Array
    count: int
    kinds: tuple[str, ...]
    instruments: NDArray[np.bool_]
    noise_of_delays: Array

    @classmethod
    def of(cls, run: PreparedRun, lengths: Collection[Length] = ()) -> FaultColumns | None:
        """The products of a run, of a long one those of its first piece; None where no row can be formed.

        `lengths` : those of the vehicle file that are looked at; the columns of others are zero.
        """
        return next(iter(cls._of_rows(run, lambda rows: [rows], lengths)), None)

    @classmethod
    def of_kinds(cls, run: PreparedRun, kinds: Sequence[str], lengths: Collection[Length] = ()) -> FaultColumns | None:
        """The products of a run's rows of these kinds; None where it has none."""
        parts = cls._of_rows(
            run, lambda rows: [own] if (own := tuple(r for r in rows if r.kind in kinds)) else [], lengths
        )
        return next(iter(parts), None)

    @classmethod
    def by_row(cls, run: PreparedRun) -> dict[Row, FaultColumns]:
        """The products of each row of a run by itself: what it says beside parameters of its own."""
        run = next(iter(run.pieces()))
        return dict(zip(run.rows, cls._of_rows(run, lambda rows: [(row,) for row in rows]), strict=True))

    @classmethod
    def _of_rows(
        cls,
        run: PreparedRun,
        parts: Callable[[tuple[Row, ...]], Sequence[tuple[Row, ...]]],
        lengths: Collection[Length] = (),
    ) -> list[FaultColumns]:
        """The products of these parts of a run's rows; empty where no row can be formed."""
        run = next(iter(run.pieces()))
        if not run.rows:
            return []
        recording = run.recording
        effects = laws_of(recording)
        priors = np.array([q.prior for effect in effects for q in effect.parameters])
        theta = first_estimate(run, effects, priors)
        sensitivity = Sensitivity.of(recording, effects, theta, ROUGH)
        floor = floor_of_rows(run, sensitivity)
        channels = sensitivity.channels
        changes = [_changes(run, sensitivity, channel) for channel in channels]
        each = list(zip(channels, changes, strict=True))
        delays = _by_kind({c: {row: a[1::2] for row, a in one.faults.items()} for c, one in each})
        noises = _by_kind({c: one.noise for c, one in each})
        unit = [_of_position(run, sensitivity, axis) for axis in "xyz"]
        of_lengths = length_columns(run, effects, theta, lengths)
        columns = [(channel, column) for channel in channels for column in CHANNELS[channel].columns]
        rig = recording.rig
        sigmas = np.array([rig.tolerance(channel, "zero") or rig.noise(channel) for channel, _ in columns])
        zeros = np.diag(sigmas**-2)
        variances = [_variances(run, channel) for channel in channels]

        def products(row: Row) -> Array:
            found = [one.zeros[row].T for one in changes]
            found.append(run.matrix(effects, row))
            found += [some[row].T for some in (*delays.values(), *(one.faults for one in changes))]
            found.append(np.stack([*(axis[row] for axis in unit), *of_lengths[row], run.measured[row]], axis=1))
            table = np.concatenate(found, axis=1) / floor[row]
            return np.stack([block.T @ block for block in np.array_split(table, BLOCKS)])

        out: list[FaultColumns] = []
        for rows in parts(tuple(run.rows)):
            blocks = products(rows[0])
            for row in rows[1:]:
                blocks += products(row)
            total = blocks.sum(axis=0)
            out.append(
                cls(
                    tuple(column for _, column in columns),
                    _reduced(total, zeros),
                    np.stack([_reduced(total - block, zeros) for block in blocks]),
                    np.stack([_reduced(half.sum(axis=0), zeros) for half in np.split(blocks, 2)]),
                    _precision(priors, _instruments(recording, tuple(delays))),
                    recording.t.size * np.concatenate([noise for noise, _ in variances]),
                    recording.t.size * np.concatenate([signal for _, signal in variances]),
                    sum(len(run.index[row]) for row in rows),
                    tuple(delays),
                    _instruments(recording, tuple(delays)),
                    np.sum(
                        [[np.sum(one[row] ** 2) / floor[row] ** 2 for one in noises.values()] for row in rows], axis=0
                    ),
                )
            )
        return out

    @classmethod
    def joined(cls, parts: Sequence[FaultColumns]) -> FaultColumns:
        """The products of several runs with the same columns; of many runs, each is one block."""
        whole = np.sum([part.whole for part in parts], axis=0)
        if len(parts) >= BLOCKS:
            left_out = np.stack([whole - part.whole for part in parts])
        else:
            left_out = np.concatenate([whole - part.whole + part.left_out for part in parts])
        return replace(
            parts[0],
            whole=whole,
            left_out=left_out,
            halves=np.concatenate([part.halves for part in parts]),
            noise=np.sum([part.noise for part in parts], axis=0),
            signal=np.sum([part.signal for part in parts], axis=0),
            noise_of_delays=np.sum([part.noise_of_delays for part in parts], axis=0),
            count=sum(part.count for part in parts),
        )

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return len(self.left_out)

    @property
    def misfit(self) -> float:
        """Weighted squares that the laws leave ÷ number of samples: 1 where they lack nothing."""
        return self.misfit_beside(self.precision)

    def misfit_beside(self, precision: Array) -> float:
        """The misfit with another inverse covariance beforehand (q, q) of the nuisance."""
        return float(_reduced(self.whole, precision)[-1, -1]) / self.count

    def estimates(self) -> list[FaultEstimate]:
        """Every column's estimates, the one that explains most first; without those that change nothing."""
        whole = _reduced(self.whole, self.precision)
        values = _single(whole)
        spread = jackknife(np.stack([_single(_reduced(part, self.precision)) for part in self.left_out]))
        fall = values**2 * np.diag(whole)[_COLUMNS] / self.count
        noise = np.divide(self.noise, self.signal, out=np.full(self.noise.shape, np.inf), where=self.signal > 0.0)
        out: list[FaultEstimate] = []
        for i, column in enumerate(self.columns):
            scale, delay = 2 * i, 2 * i + 1
            if np.diag(whole)[scale] > 0.0 and np.isfinite(spread[[scale, delay]]).all():
                falls = float(fall[scale]), float(fall[delay])
                found = 1.0 - float(values[scale]), float(spread[scale]), float(values[delay]), float(spread[delay])
                out.append(FaultEstimate(column, *found, *falls, float(noise[i, 0]), float(noise[i, 1])))
        return sorted(out, key=lambda one: -max(one.scale_fall, one.delay_fall))

    def scales(self, column: str) -> Array:
        """Scale of a column as the only one at fault, in each half of each run; NaN where a half does not show it."""
        place = 2 * self.columns.index(column)
        each = [_reduced(half, self.precision) for half in self.halves]
        shown = np.array([float(one[place, place]) > 0.0 for one in each])
        return np.where(shown, [1.0 - float(_single(one)[place]) for one in each], np.nan)

    @property
    def misfit_as_stamped(self) -> float:
        """The misfit with all delays as the rig says."""
        precision = self.precision.copy()
        precision[np.diag_indices(len(precision))] += np.where(self.are_delays, _NO_DELAY**-2, 0.0)
        return self.misfit_beside(precision)

    @property
    def are_delays(self) -> NDArray[np.bool_]:
        """(q,) which of the nuisance are delays of kinds of columns: the last."""
        return np.arange(len(self.precision)) >= len(self.precision) - len(self.kinds)

    def unit_position(self) -> PlaceEstimate | None:
        """The position error of the inertial unit; None where no row depends on it."""
        return self._places(_UNIT)

    def lengths(self, of: NDArray[np.intp] = _EVERY) -> PlaceEstimate | None:
        """The errors of these lengths, by their places in `Length`; None where no row depends on one."""
        return self._places(_LENGTHS[of])

    def _places(self, part: NDArray[np.intp]) -> PlaceEstimate | None:
        whole = _reduced(self.whole, self.precision)
        if not np.all(np.diag(whole)[part] > 0.0):
            return None
        value = _together(whole, part)
        spread = jackknife(np.stack([_together(_reduced(one, self.precision), part) for one in self.left_out]))
        return PlaceEstimate(value, spread, float(value @ whole[part, -1]) / self.count)


def laws_of(recording: Recording) -> list[PhysicalEffect]:
    """Laws beside which a fault is estimated: the base model, and spring and damping across each axle.

    Without the latter each wheel would be taken to be suspended by itself. What beams, rigid axles and bars do between
    the wheels of an axle then has to come from the loads, and is worth several times the moments of a wheel.
    """
    known = catalogue(recording.vehicle, recording.reference).values()
    found = [effect for effect in known if effect.base or isinstance(effect, AcrossAxle)]
    return [physics for effect in found if (physics := effect.as_physics)]


def first_estimate(run: PreparedRun, effects: Sequence[PhysicalEffect], priors: Array) -> Array:
    """(p,) parameters of least squares, every row weighted by its own variation."""
    run.prepare(effects)
    size = {row: float(np.std(run.measured[row])) or 1.0 for row in run.rows}
    table = [run.matrix(effects, row) / size[row] for row in run.rows] + [_PRIORS * np.diag(1.0 / priors)]
    right = [run.measured[row] / size[row] for row in run.rows] + [np.zeros(priors.size)]
    return np.asarray(np.linalg.lstsq(np.concatenate(table), np.concatenate(right), rcond=None)[0], float)


def floor_of_rows(run: PreparedRun, sensitivity: Sensitivity) -> dict[Row, float]:
    """Row → RMS of the residual from the sheet's noise."""
    squares = dict.fromkeys(run.rows, 0.0)
    for drawn in sensitivity.noises(np.random.default_rng(0), _DRAWS):
        for row, series in run.decimated(drawn).items():
            squares[row] += float(np.sum(np.mean(series**2, axis=-1)))
    return {row: float(np.sqrt(total / _DRAWS)) or 1.0 for row, total in squares.items()}


@dataclass(frozen=True)
class _Changes:
    """Change of the rows by a channel of k columns.

    `zeros` : row → (k, n) by its zeros; `faults` : row → (2 k, n) by scale and delay of each column; `noise` : row →
    (1, n) what the delay of all changes in a draw of the sheet's noise.
    """

    zeros: dict[Row, Array]
    faults: dict[Row, Array]
    noise: dict[Row, Array]


def _changes(run: PreparedRun, sensitivity: Sensitivity, channel: str) -> _Changes:
    """Change of the rows by a channel."""
    rate = run.recording.filters.rate
    values = run.recording.signals.value[channel]
    rates = derivative(values, rate)
    k, n = values.shape
    change = np.zeros((k, 3 * k + 1, n))
    for i in range(k):
        change[i, i] = 1.0
        change[i, k + 2 * i] = values[i]
        change[i, k + 2 * i + 1] = -rates[i]
    change[:, -1] = derivative(draw_noise(run.recording, [channel], np.random.default_rng(0))[channel], rate)
    found = run.decimated(sensitivity.response({channel: change}))
    found = {row: found.get(row, np.zeros((3 * k + 1, len(run.index[row])))) for row in run.rows}
    zeros, faults, noise = ({row: a[part] for row, a in found.items()} for part in (np.s_[:k], np.s_[k:-1], np.s_[-1:]))
    return _Changes(zeros, faults, noise)


def _of_position(run: PreparedRun, sensitivity: Sensitivity, axis: str) -> dict[Row, Array]:
    """Change of the rows by the inertial unit mounted farther along a body axis, row → (n,)."""
    found = run.decimated(sensitivity.fault(SensorPosition(f"imu.{axis}")))
    return {row: found.get(row, np.zeros(len(run.index[row]))) for row in run.rows}


def _instruments(recording: Recording, kinds: Sequence[str]) -> NDArray[np.bool_]:
    """(s, k) whether a kind of columns is an instrument's, of those that have several."""
    sensors = [sensors_of(recording, kind) for kind in kinds]
    several = [one for one in dict.fromkeys(sensors) if sensors.count(one) > 1]
    return np.array([[of == one for of in sensors] for one in several], bool).reshape(len(several), len(kinds))


def _precision(priors: Array, instruments: NDArray[np.bool_]) -> Array:
    """(q, q) inverse covariance beforehand of the laws' parameters and of the kinds' delays."""
    alone = ~instruments.any(axis=0)
    own = np.diag(np.where(alone, ANY_DELAY, _TOGETHER) ** 2)
    delays = own + ANY_DELAY**2 * (instruments.T.astype(float) @ instruments)
    return np.asarray(scipy.linalg.block_diag(np.diag(priors**-2), np.linalg.inv(delays)), float)


def _by_kind(changes: Mapping[str, Mapping[Row, Array]]) -> dict[str, dict[Row, Array]]:
    """Sum of the changes by the columns of each kind, row → (1, n); wheel loads first."""
    out: dict[str, dict[Row, Array]] = {}
    for channel in sorted(changes, key=lambda name: CHANNELS[name].family not in LOADS):
        change = changes[channel]
        whole = out.setdefault(kind_of(channel), {row: np.zeros((1, a.shape[1])) for row, a in change.items()})
        for row, table in change.items():
            whole[row] = whole[row] + table.sum(axis=0)
    return out


def _variances(run: PreparedRun, channel: str) -> tuple[Array, Array]:
    """(k, 2) variances of the sheet's noise and of a channel: of columns and their rates, after the parallel filter."""
    recording = run.recording
    noise = draw_noise(recording, [channel], np.random.default_rng(0))[channel]

    def variance(series: Array) -> Array:
        rates = derivative(series, recording.filters.rate)
        both = decimated(np.stack([series - np.mean(series, axis=1, keepdims=True), rates], axis=1), recording.filters)
        return np.asarray(np.var(both, axis=-1), float)

    return variance(noise), variance(recording.signals.value[channel])


def _reduced(gram: Array, precision: Array) -> Array:
    """Products of faults and left side with the nuisance removed (partial regression, its priors as equations)."""
    q = len(precision)
    nuisance = gram[:q, :q] + precision
    size = 1.0 / np.sqrt(np.diag(nuisance))
    scaled = nuisance * size * size[:, None]
    explained = np.linalg.solve(scaled, size[:, None] * gram[:q, q:])
    return gram[q:, q:] - (gram[q:, :q] * size) @ explained


def _single(reduced: Array) -> Array:
    """(f,) value of each fault of a column alone; NaN where it changes nothing."""
    squares = np.diag(reduced)[_COLUMNS]
    return np.divide(reduced[_COLUMNS, -1], squares, out=np.full(squares.size, np.nan), where=squares > 0.0)


def _together(reduced: Array, part: NDArray[np.intp]) -> Array:
    """(k,) errors of these places from the reduced products, beside a wide prior."""
    normal = reduced[np.ix_(part, part)]
    return np.asarray(np.linalg.solve(normal + np.eye(len(normal)) / _ANYWHERE**2, reduced[part, -1]), float)


def jackknife(values: Array) -> Array:
    """(f,) 1 σ of estimates from (B, f) those with one block left out."""
    count = len(values)
    return np.sqrt((count - 1) / count * np.sum((values - np.mean(values, axis=0)) ** 2, axis=0))
