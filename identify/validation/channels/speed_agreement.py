"""Faults of the inertial unit and the speed sensor, estimated from how these agree, without any force on the car.

At one point of the body the velocity v changes by v̇ + ω × v = f − g, with the rates ω, the specific force f less
gravity g in body axes. Along x and y the speed sensor measures the left side and the inertial unit the right one. An
unknown force changes both alike, a fault of one of them does not (D. H. Titterton and J. L. Weston, Strapdown Inertial
Navigation Technology, 2004, on aiding by velocity).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.identify.car.body_motion import body_attitude, body_motion
from lacet.identify.car.kinematics import body_velocity
from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array, cross
from lacet.identify.regression.prepared_run import PIECE, PreparedRun
from lacet.identify.signals.decimation import comb, decimated
from lacet.identify.signals.filters import Filters, derivative
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals

_CHANNELS = ("imu.accel", "imu.rate", "imu.attitude", "correvit.speed")
_CUTOFF = 2.0
"""Frequency up to which the instruments are compared [Hz]: manoeuvres are below it, and the noise of the speed's
derivative, which grows with frequency, biases sizes by a percent at 6 Hz."""
_DRAWS = 8
"""Simulated draws of noise behind the weights, known to some percent from a run of 20 s."""
_MOST_REMAINING = 2.0
"""Squares that may remain with all faults as large as is plausible, ÷ those of the noise: with more the instruments do
not measure the same motion, and nothing follows from how they differ."""
_STEP = 1e-3
"""Step of the finite differences by sizes of faults and zeros [their units]."""


@dataclass(frozen=True)
class AgreeingSize:
    """Size of a sensor fault with which the inertial unit and the speed sensor agree best.

    Attributes
    ----------
    value, sigma : the size and its 1 σ [SI], beside the zeros of both instruments and all that the sensor sheet allows.
    """

    value: float
    sigma: float

    def chance(self, expected: float = 0.0, tolerance: float = 0.0) -> float:
        """Probability that it is as far from `expected` by noise and a `tolerance`, 1 σ [SI]."""
        return math.erfc(abs(self.value - expected) / math.sqrt(2.0 * (self.sigma**2 + tolerance**2)))


@dataclass(frozen=True)
class SpeedAgreement:
    """How the inertial unit and the speed sensor agree on some runs, and what their faults change in that.

    Attributes
    ----------
    faults : all faults of these instruments; `bounds` (f,) their tolerances in the sensor sheet, 1 σ [SI], or 0.
    products : (f + 1, f + 1) of each fault's column per unit and of the disagreement, ÷ its noise; each run's zeros are
        eliminated.
    count : number of samples.
    """

    faults: tuple[SensorFault, ...]
    bounds: Array
    products: Array
    count: int

    @classmethod
    def of(cls, runs: Sequence[PreparedRun]) -> SpeedAgreement | None:
        """Of the runs that have both instruments with the unit's attitude.

        None where no run has, or where they disagree whatever faults they have.
        """
        measured = [run.recording for run in runs if is_compared(run.recording)]
        if not measured:
            return None
        known = catalogue(measured[0].vehicle, measured[0].reference).values()
        every = (fault for effect in known if (fault := effect.as_fault))
        faults = tuple(fault for fault in every if set(fault.channels()) <= set(_CHANNELS))
        parts = [_products(recording, faults) for recording in measured]
        bounds = np.array([fault.sheet_bound(measured[0].rig) for fault in faults])
        found = cls(faults, bounds, np.sum([part for part, _ in parts], axis=0), sum(count for _, count in parts))
        return found if found._estimate(found.keys)[3] <= _MOST_REMAINING else None

    @property
    def keys(self) -> list[str]:
        """Keys of the faults."""
        return [fault.key for fault in self.faults]

    def sizes(self, keys: Collection[str]) -> dict[str, AgreeingSize]:
        """Sizes of these faults together, by key; keys of faults of other instruments are left out.

        Each has its plausible range as a prior, which one that does not show keeps; all others have the sheet's.
        """
        places, value, spread, remains = self._estimate(keys)
        sigma = np.sqrt(max(1.0, remains)) * spread
        found = {
            self.faults[i].key: AgreeingSize(float(v), float(s)) for i, v, s in zip(places, value, sigma, strict=True)
        }
        return {key: one for key, one in found.items() if key in keys}

    def _estimate(self, keys: Collection[str]) -> tuple[list[int], Array, Array, float]:
        """Places of the faults, their sizes, 1 σ if noise alone remains, and the squares that do, ÷ the noise's."""
        free = [fault.key in keys for fault in self.faults]
        plausible = [fault.parameters[0].prior for fault in self.faults]
        prior = np.where(free, plausible, self.bounds)
        places = np.flatnonzero(prior > 0.0)
        inverse = np.linalg.inv(self.products[np.ix_(places, places)] + np.diag(prior[places] ** -2.0))
        right = self.products[places, -1]
        value = inverse @ right
        remains = float(self.products[-1, -1] - value @ right) / self.count
        return places.tolist(), value, np.sqrt(np.diag(inverse)), remains

    def beyond_sheet(self, significance: float) -> list[SensorFault]:
        """Faults without which the instruments disagree by more than the sheet allows, the most significant first.

        `significance` : probability that there is any by chance. One that others found later explain is none.
        """
        found: list[SensorFault] = []
        open_ones = list(self.faults)
        while open_ones:
            tried = {fault.key: self._chances([*found, fault])[fault.key] for fault in open_ones}
            best = min(open_ones, key=lambda fault: tried[fault.key])
            if tried[best.key] > significance:
                break
            open_ones.remove(best)
            chances = self._chances([*found, best])
            found = [fault for fault in (*found, best) if chances[fault.key] <= significance]
        return found

    def _chances(self, faults: Sequence[SensorFault]) -> dict[str, float]:
        """Key → probability that any fault is as large by chance and its tolerance, of each beside the others."""
        sizes = self.sizes([fault.key for fault in faults])
        bounds = dict(zip(self.keys, self.bounds.tolist(), strict=True))
        return {key: len(self.faults) * one.chance(tolerance=bounds[key]) for key, one in sizes.items()}


def disagreement(recording: Recording, signals: Signals | None = None) -> Array:
    """What the speed sensor has more than the inertial unit along x and y of the body, (2, n) [m/s²].

    After a low-pass, at the samples that decimation keeps. `signals` : instead of the recording's own.
    """
    signals, filters = signals or recording.signals, _filters(recording)
    body = body_motion(signals, recording.rig, recording.t.size)
    attitude = body_attitude(signals.value, recording.rig)
    assert attitude is not None
    velocity = body_velocity(signals.value, recording.rig, body, attitude)
    assert velocity is not None
    roll, pitch, _ = attitude
    up = np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    # The car drives along the road, with a part of its speed along z of a body that is pitched or rolled.
    velocity = np.stack([*velocity[:2], -(up[0] * velocity[0] + up[1] * velocity[1]) / up[2]])
    turning, upward = cross(body.omega, velocity)[:2], STANDARD_GRAVITY * up[:2]
    return decimated(derivative(velocity[:2], filters.rate) + turning + upward - body.accel[:2], filters)


def _filters(recording: Recording) -> Filters:
    """The recording's filters with a lower cut-off, and what they spoil at the ends of a run and around gaps [s]."""
    own = recording.filters
    cutoff = min(_CUTOFF, own.fit_cutoff)
    return replace(own, fit_cutoff=cutoff, edge=own.edge * own.fit_cutoff / cutoff)


def usable_samples(recording: Recording, own: slice = slice(None)) -> NDArray[np.bool_]:
    """(n,) the kept samples outside flagged gaps and the low-pass's transients around them, of those in `own`."""
    masks = [recording.usable.get(name, np.ones(recording.t.size, bool)) for name in _CHANNELS]
    filters = _filters(recording)
    beyond = math.ceil((filters.edge - recording.filters.edge) * filters.rate)
    # Both ends of a run are a gap, too.
    unusable = np.pad(~np.all(masks, axis=0), beyond, constant_values=True)
    before = np.concatenate([[0], np.cumsum(unusable)])
    sound = before[2 * beyond + 1 :] == before[: recording.t.size]
    inside = np.zeros(recording.t.size, bool)
    inside[own] = True
    return np.asarray((sound & inside)[comb(recording.t.size, filters)])


def is_compared(recording: Recording) -> bool:
    """Whether both instruments are there, with noise, none of their channels made of others, and samples are usable."""
    there = all(name in recording.signals.value and name not in recording.sources for name in _CHANNELS)
    return (
        there and all(recording.rig.noise(name) > 0.0 for name in _CHANNELS) and bool(usable_samples(recording).any())
    )


def _pieces(recording: Recording) -> Iterator[tuple[Recording, slice]]:
    """Pieces of about `PIECE` [s] that reach over their ends by as much as the low-pass sees, and their own samples."""
    filters, n = _filters(recording), recording.t.size
    count, step = max(1, round(n / (PIECE * filters.rate))), filters.step
    margin = math.ceil(filters.memory * filters.rate / step) * step
    for start, end in pairwise([*(n * k // count // step * step for k in range(count)), n]):
        first = max(0, start - margin)
        yield recording.at(slice(first, end + margin)), slice(start - first, end - first)


def _products(recording: Recording, faults: Sequence[SensorFault]) -> tuple[Array, int]:
    """Products of the changes by each fault's unit and of the disagreement, ÷ its noise, and the number of samples.

    The zeros of this run are eliminated.
    """
    zeros = [recording.rig.tolerance(name, "zero") or recording.rig.noise(name) for name in _CHANNELS]
    known = np.repeat(zeros, [CHANNELS[name].width for name in _CHANNELS])
    q, count = known.size, 0
    grams, squares = np.zeros((2, q + len(faults) + 1, q + len(faults) + 1)), np.zeros(2)
    for piece, own in _pieces(recording):
        kept, before = usable_samples(piece, own), disagreement(piece)
        columns = [(_changed(piece, changes, _STEP) - before) / _STEP for changes in _changes(piece, faults)]
        table = np.stack([*columns, before])[:, :, kept]
        grams += np.einsum("ian,jan->aij", table, table)
        squares += _noise_squares(piece, before, kept)
        count += int(np.count_nonzero(kept))
    gram: Array = np.sum(grams * (count / squares)[:, None, None], axis=0)
    gain = np.linalg.solve(gram[:q, :q] + np.diag(known**-2.0), gram[:q, q:])
    return np.asarray(gram[q:, q:] - gram[q:, :q] @ gain), 2 * count


def _changes(recording: Recording, faults: Sequence[SensorFault]) -> Iterator[Mapping[str, Array]]:
    """Changes of channels by each zero, and by each fault, of one unit."""
    for name in _CHANNELS:
        for one in np.eye(CHANNELS[name].width):
            yield {name: np.outer(one, np.ones(recording.t.size))}
    for fault in faults:
        yield fault.changes(recording)


def _changed(recording: Recording, changes: Mapping[str, Array], size: float) -> Array:
    """The disagreement with channels changed by `size` times `changes`, (2, n) [m/s²]."""
    values = {name: recording.signals.value[name] + size * change for name, change in changes.items()}
    return disagreement(recording, recording.signals.changed(values, recording.filters.rate))


def _noise_squares(recording: Recording, before: Array, kept: NDArray[np.bool_]) -> Array:
    """(2,) sums of squares over the samples `kept` of what the sheet's noise changes in the disagreement `before`."""
    rng = np.random.default_rng(0)
    drawn = [_changed(recording, draw_noise(recording, _CHANNELS, rng), 1.0) - before for _ in range(_DRAWS)]
    return np.asarray(np.sum(np.square(drawn)[:, :, kept], axis=(0, 2)) / _DRAWS)
