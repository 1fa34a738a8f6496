"""Sensitivity of the residual Y − W θ to small changes of the measured channels.

The motion is built point by point, so the residual at one instant depends on the channels and their derivatives at that
instant alone. Its derivatives by them, taken once on a coarse comb, turn every fault and every noise draw into a few
multiplications: sensor zeros, gains and latencies become columns, and the noise floor is simulated in seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, CORNERS, other_corner
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.measured_rows import MeasuredRows
from lacet.identify.car.motion import Motion
from lacet.identify.car.road import Road
from lacet.identify.car.rows import Row
from lacet.identify.car.table_errors import corners_of
from lacet.identify.effects.base import AXLES, PhysicalEffect, SensorFault, free_parameters, sum_by_row, with_places
from lacet.identify.effects.suspension.with_memory import SuspensionForceOnPath, expected_travel
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.noise_draws import draw_noises
from lacet.identify.signals.reconstruct import Recording, Signals

Perturbation = Mapping[str, Array]
"""Change of channels: name → (k, N), or (k, d, N) for d changes. Their derivatives are computed from it."""

Input = tuple[str, int, int]
"""Input of the equations: a channel, its component, and which of its series, an index of `_PARTS`."""

_PARTS = ("value", "rate", "accel", "mean", "mean_rate", "assumed")
"""Series of a channel: it and its derivatives as measured, and what they are expected to be given its record; and the
value of an assumption."""
_STEPS = (1.0, 20.0, 400.0, 1.0, 5.0, 0.1)
"""Steps of the finite differences, in the channel's noise [SI] or in the assumption's tolerance."""
_MEAN, _MEAN_RATE, _ASSUMED = 3, 4, 5
_COPIES = 22
"""Largest number of perturbed copies of a run computed at once: the inputs that move the whole car; a corner's are
fewer."""
_PER_PERIOD = 5.0
"""Instants in a period of the pre-filter's cut-off at which derivatives by errors of bench tables are computed."""
_SAMPLES = 16_000
"""Largest number of samples of the copies computed at once: it limits the memory for long runs."""
_DRAWN = 32_000
"""Largest number of samples of the noise drawn at once: what many draws are multiplied with then stays in the cache."""
FINE = 0.04
"""Spacing of the instants at which derivatives are computed [s]: below half a period of the fit's cut-off."""
ROUGH = 0.16
"""The same where the derivatives only lead to better parameter values, at which they are computed again, or to a check
of the channels [s]."""


@dataclass(frozen=True)
class ExpansionPoint:
    """Where the residual's derivatives by the channels are computed.

    Attributes
    ----------
    values : (p,) every parameter of the physics.
    spacing : of the instants [s]; in between the derivatives are interpolated.
    """

    values: Array
    spacing: float = FINE


def residual(motion: Motion, effects: Sequence[PhysicalEffect], values: Array) -> dict[Row, Array]:
    """Residual Y − W θ at full rate, row → (N,) [N or N·m], from the effects' force laws."""
    out: dict[Row, Array] = {row: motion.measured(row).copy() for row in motion.rows}
    for effect, place in with_places(effects):
        free, theta = free_parameters(effect, motion), values[place]
        found = effect.force(motion, theta if free is None else free * theta)
        forces = {Row.parse(text): force for text, force in found.items()}
        for row, force in motion.with_body_rows(forces).items():
            if row in out:
                out[row] -= force
    return out


SlopesByInput = Mapping[Input, Mapping[Row, Array]]
"""Derivatives of the residual: input → row → values."""


@dataclass(frozen=True)
class CombSlopes:
    """Derivatives of the residual by its inputs at evenly spaced instants, interpolated in between.

    Attributes
    ----------
    t : (N,) time of each sample [s].
    comb : indices of the samples at which the derivatives were computed.
    coarse : input → row → values at those samples, or a scalar where a derivative is constant.
    """

    t: Array
    comb: NDArray[np.intp]
    coarse: SlopesByInput

    @cached_property
    def every(self) -> SlopesByInput:
        """Input → row → (N,) interpolated values at every sample, or a scalar where a derivative is constant."""
        at = self.t[self.comb]
        return {
            key: {row: slope if slope.size == 1 else np.interp(self.t, at, slope) for row, slope in rows.items()}
            for key, rows in self.coarse.items()
        }

    @cached_property
    def orders(self) -> Mapping[tuple[str, int], Sequence[int]]:
        """Channel, component → those of its `_PARTS` that any row depends on, in order."""
        out: dict[tuple[str, int], list[int]] = {}
        for name, k, order in sorted(self.coarse):
            out.setdefault((name, k), []).append(order)
        return out


@dataclass(frozen=True)
class AssumedSlopes:
    """Slopes of the residual by assumptions and by errors of bench tables, computed when they are first asked for.

    The fits on the way to better parameter values do without them.

    Attributes
    ----------
    recording, effects, theta : where they are taken.
    motion : those with another recording of the same motion, of which the errors of bench tables are taken.
    """

    recording: Recording
    effects: Sequence[PhysicalEffect]
    theta: Array
    motion: AssumedSlopes | None = None

    @cached_property
    def slopes(self) -> Mapping[str, Mapping[Row, Array]]:
        """Name of the assumption or the table's error → row → values at every sample, or a scalar."""
        own = _by_assumptions(self.recording, self.effects, self.theta)
        if self.motion is None:
            found = own | _by_tables(self.recording, self.effects, self.theta)
            return {name: rows for (name, _, _), rows in found.items()}
        # What hardly acts may pass the bar of rounding with this noise and not with that.
        of_own = {name: rows for (name, _, _), rows in own.items()}
        return {
            name: {row: of_own.get(name, {}).get(row, slope) for row, slope in rows.items()}
            for name, rows in self.motion.slopes.items()
        }


@dataclass(frozen=True)
class PathForces:
    """Forces of a model that follow the path of a wheel's travel, and what noise of the travel changes in them.

    They have no derivatives at separate instants; a draw of the noise is a path of its own.

    Attributes
    ----------
    laws : effects with their parameter values (p,).
    motion : of the run; None without such a law or where the travel is exact.
    levers : channel → corner → change of the corner's expected travel per unit of what is expected of the channel [m].
    """

    laws: Sequence[tuple[SuspensionForceOnPath, Array]] = ()
    motion: Motion | None = None
    levers: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])

    @classmethod
    def of(cls, recording: Recording, effects: Sequence[PhysicalEffect], values: Array) -> PathForces:
        """Those of a model's effects at parameter values θ."""
        laws = [
            (effect, values[place]) for effect, place in with_places(effects)
            if isinstance(effect, SuspensionForceOnPath) and np.any(values[place])
        ]  # fmt: skip
        if not laws or not recording.smoothers:
            return cls()
        before = _expected_travels(recording)
        levers: dict[str, Mapping[str, float]] = {}
        for channel in recording.smoothers:
            step, mean = recording.rig.noise(channel), recording.signals.mean
            moved = replace(recording.signals, mean={**mean, channel: mean[channel] + step})
            after = _expected_travels(replace(recording, signals=moved))
            found = {c: float(np.mean(after[c] - travel)) / step for c, travel in before.items()}
            levers[channel] = {c: lever for c, lever in found.items() if lever}
        return cls(laws, build_motion(recording), {channel: own for channel, own in levers.items() if own})

    def response(self, recording: Recording, drawn: Perturbation, others: Perturbation) -> dict[Row, Array]:
        """Change of the residual, row → (d, N), for draws of the noise and as many independent ones, (1, d, N)."""
        errors: dict[str, Array] = {}
        for channel, levers in self.levers.items():
            if channel not in drawn:
                continue
            error = recording.smoothers[channel].error(drawn[channel][0], others[channel][0])
            for c, lever in levers.items():
                errors[c] = errors.get(c, 0.0) + lever * error
        out: dict[Row, Array] = {}
        for law, values in self.laws if self.motion is not None else ():
            assert self.motion is not None
            forces: dict[Row, Array] = {}
            for c in law.corners():
                if c in errors:
                    travel = expected_travel(self.motion.corners[c])
                    forces[Row.parse(f"suspension.{c}")] = values[0] * (law.path(travel) - law.path(travel + errors[c]))
            found = self.motion.with_body_rows(forces)
            out = sum_by_row([out, {row: change for row, change in found.items() if row in self.motion.rows}])
        return out


def _expected_travels(recording: Recording) -> dict[str, Array]:
    """Corner → expected travel (N,) of a recording, of the corners where it is not exact."""
    road = Road(recording.completed, recording.rig, recording.vehicle, recording.t.size)
    found = {c: road.conditional_travel(c) for c in CORNERS}
    return {c: given.travel for c, given in found.items() if given is not None}


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of a run's residual by its channels, and responses of the residual computed with them.

    Attributes
    ----------
    recording : the run, to whose channels changes are applied.
    taken : the derivatives, computed on this recording or on another of the same motion.
    of_assumed : the derivatives by assumptions and bench tables, computed when they are first asked for.
    paths : forces that follow the path of a travel, which noise changes as no derivative says.
    """

    recording: Recording
    taken: CombSlopes
    of_assumed: AssumedSlopes
    paths: PathForces

    @property
    def slopes(self) -> SlopesByInput:
        """The derivatives at every sample (N,), or a scalar where one is constant."""
        return self.taken.every

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that any row depends on."""
        return tuple(dict.fromkeys(name for name, _, _ in self.taken.coarse))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Names of the assumptions that any row depends on."""
        return tuple(self.of_assumed.slopes)

    @property
    def _bent(self) -> tuple[str, ...]:
        """Channels in laws that bend."""
        return tuple(dict.fromkeys(name for name, _, order in self.taken.coarse if order in (_MEAN, _MEAN_RATE)))

    @classmethod
    def of(
        cls, recording: Recording, effects: Sequence[PhysicalEffect], values: Array, spacing: float = FINE
    ) -> Sensitivity:
        """The sensitivity of a run at parameter values θ, by finite differences at instants `spacing` [s] apart."""
        every = max(1, round(spacing * recording.filters.rate))
        # The same instants in a piece of a long run as in the whole.
        before_it = round(float(recording.t[0] - recording.start) * recording.filters.rate)
        comb = np.arange(-before_it % every, recording.t.size, every)
        coarse = recording.at(comb)
        measured = MeasuredRows.of(coarse)
        active = [e for e in effects if _enters(e)]
        theta = _active_values(effects, values)
        motion = build_motion(coarse, measured=measured)
        before = residual(motion, active, theta)
        parts = [*range(_ASSUMED)] if any(effect.conditional for effect in active) else [*range(_MEAN)]
        slopes = _derivatives(coarse, measured, motion, before, active, theta, _inputs(coarse.signals, parts))
        assumed = AssumedSlopes(recording, active, theta)
        return cls(recording, CombSlopes(recording.t, comb, slopes), assumed, PathForces.of(recording, effects, values))

    def on(self, recording: Recording) -> Sensitivity:
        """These derivatives with another recording of the same motion."""
        return replace(self, recording=recording)

    def noisy(self, recording: Recording, effects: Sequence[PhysicalEffect], values: Array) -> Sensitivity:
        """These derivatives with another recording of the same motion, from which those by assumptions are taken.

        What an assumption does is made of the channels at each sample, and holds their noise: without it the noise that
        the residual has in common with it would be taken for a wrong assumption. Errors of bench tables multiply loads,
        of which noise is a small part. At parameter values θ of `effects`.
        """
        if not self.recording.laws:
            return self.on(recording)
        active = [e for e in effects if _enters(e)]
        motion = self.of_assumed.motion or self.of_assumed
        own = AssumedSlopes(recording, active, _active_values(effects, values), motion)
        return replace(self, recording=recording, of_assumed=own)

    def uncached(self) -> Sensitivity:
        """The sensitivity without the cached interpolation to every sample, which needs much memory."""
        return replace(self, taken=replace(self.taken))

    def response(self, perturbation: Perturbation, other: Perturbation | None = None) -> dict[Row, Array]:
        """Change of the residual at full rate, row → (…, N), for a change of channels (k, …, N).

        `other` : where the change is a draw of the noise, an independent one of the channels in laws that bend.
        """
        rate = self.recording.filters.rate
        out: dict[Row, Array] = {}
        term = np.empty(next((change.shape[1:] for change in perturbation.values()), ()))
        for channel, change in perturbation.items():
            moving = [k for k, part in enumerate(change) if np.any(part[..., 0]) or np.any(part)]
            orders = {order for k in moving for order in self.taken.orders.get((channel, k), ())}
            if not orders:
                continue
            series = [change, derivative(change, rate) if orders - {0} else change]
            series.append(derivative(series[1], rate) if 2 in orders else change)
            if orders & {_MEAN, _MEAN_RATE}:
                series += self._expected(channel, series[:2], None if other is None else other[channel])
            for k in moving:
                for order in self.taken.orders.get((channel, k), ()):
                    for row, slope in self.slopes[channel, k, order].items():
                        if row in out:
                            out[row] += np.multiply(slope, series[order][k], out=term)
                        else:
                            out[row] = slope * series[order][k]
        return out

    def _expected(self, channel: str, changes: Sequence[Array], other: Array | None) -> list[Array]:
        """Changes of a channel's conditional means of value and rate, for `changes` of them (k, …, N).

        With an `other` draw of the noise, the errors of those means.
        """
        smoother = self.recording.smoothers.get(channel)
        if smoother is None:
            return list(changes)
        if other is None:
            return [smoother.mean(change) for change in changes]
        others = other, derivative(other, self.recording.filters.rate)
        errors = [smoother.error(change, one) for change, one in zip(changes, others, strict=True)]
        return [errors[0], errors[1] - smoother.faster(others[1])]

    def zero(self, channel: str, component: int) -> dict[Row, Array]:
        """Change of the residual per unit of a constant added to a channel's component, row → (N,)."""
        ones = np.ones(self.recording.t.size)
        out: dict[Row, Array] = {}
        for order in (0, _MEAN):
            for row, slope in self.slopes.get((channel, component, order), {}).items():
                out[row] = out.get(row, 0.0) + slope * ones
        return out

    def assumed(self, name: str) -> dict[Row, Array]:
        """Change of the residual per unit of an assumption, row → (N,)."""
        ones = np.ones(self.recording.t.size)
        return {row: slope * ones for row, slope in self.of_assumed.slopes.get(name, {}).items()}

    def fault(self, fault: SensorFault) -> dict[Row, Array]:
        """Change of the residual per unit of a sensor fault's parameter, row → (N,)."""
        return self.response(fault.changes(self.recording))

    def noise(self, rng: np.random.Generator) -> dict[Row, Array]:
        """One random draw of the residual's noise from the channels' noise, row → (N,)."""
        (drawn,) = self.noises(rng, 1)
        return {row: series[0] for row, series in drawn.items()}

    def noises(self, rng: np.random.Generator, draws: int) -> Iterator[dict[Row, Array]]:
        """As many random draws as of `noise`, row → (d, N), some at a time."""
        together = max(1, _DRAWN // self.recording.t.size)
        for start in range(0, draws, together):
            some = min(together, draws - start)
            drawn = draw_noises(self.recording, self.channels, rng, some)
            others = draw_noises(self.recording, tuple(dict.fromkeys((*self._bent, *self.paths.levers))), rng, some)
            yield sum_by_row([self.response(drawn, others), self.paths.response(self.recording, drawn, others)])


def _by_assumptions(
    recording: Recording, effects: Sequence[PhysicalEffect], theta: Array
) -> dict[Input, dict[Row, Array]]:
    """Slopes of the residual by what a recording's laws assume, at every sample: they follow the signals themselves."""
    names = dict.fromkeys(one.name for law in recording.laws for one in law.assumptions)
    return _by_inputs(recording, effects, theta, [(name, 0, _ASSUMED) for name in names])


def _by_tables(recording: Recording, effects: Sequence[PhysicalEffect], theta: Array) -> dict[Input, dict[Row, Array]]:
    """Slopes of the residual by errors of bench tables, interpolated from instants that hold the pre-filter's band."""
    names = [one.name for one in recording.tables]
    # What an axle has in common does what its corners' errors do together.
    sums = {name: parts for name in names if (parts := corners_of(name)) and set(parts) <= set(names)}
    inputs = [(name, 0, _ASSUMED) for name in names if name not in sums]
    filters = recording.filters
    step = 1 if filters.pre_cutoff is None else max(1, round(filters.rate / (_PER_PERIOD * filters.pre_cutoff)))
    some = recording.at(slice(None, None, step))
    found = _by_inputs(some, effects, theta, inputs)
    for name, parts in sums.items():
        found[name, 0, _ASSUMED] = sum_by_row([found.get((part, 0, _ASSUMED), {}) for part in parts])
    return {
        key: {row: slope if slope.size == 1 else np.interp(recording.t, some.t, slope) for row, slope in rows.items()}
        for key, rows in found.items()
        if rows
    }


def _by_inputs(
    recording: Recording, effects: Sequence[PhysicalEffect], theta: Array, inputs: Sequence[Input]
) -> dict[Input, dict[Row, Array]]:
    if not inputs:
        return {}
    measured = MeasuredRows.of(recording)
    motion = build_motion(recording, measured=measured)
    before = residual(motion, effects, theta)
    return _derivatives(recording, measured, motion, before, effects, theta, inputs)


def _derivatives(
    recording: Recording, measured: MeasuredRows, motion: Motion, before: Mapping[Row, Array],
    effects: Sequence[PhysicalEffect], theta: Array, inputs: Sequence[Input],
) -> dict[Input, dict[Row, Array]]:  # fmt: skip
    """Slopes of the residual `before` by these inputs, at the recording's samples."""
    slopes = {key: dict[Row, Array]() for key in inputs}
    unchanged: dict[int, _Copies] = {}
    # Samples do not see each other, so that many changed copies of the run go through in one pass.
    for corner, group in _groups(recording, inputs, max(1, min(_COPIES, _SAMPLES // recording.t.size))):
        steps = [_scale(recording, one) * _STEPS[one[2]] for one in group]
        if len(group) not in unchanged:
            unchanged[len(group)] = _Copies.made(len(group), recording, measured, motion)
        copies = unchanged[len(group)]
        changed = _stepped(copies.recording, group, steps)
        still, moving = (copies.motion, _moved_by(corner, recording.vehicle)) if corner else (None, CORNERS)
        after = residual(build_motion(changed, still, moving, copies.measured), effects, theta)
        slopes |= zip(group, _slopes(before, after, steps), strict=True)
    return {key: rows for key, rows in slopes.items() if rows}


@dataclass(frozen=True)
class _Copies:
    """Copies of a run one after the other, as if they were one: `places` of their samples in the run."""

    places: NDArray[np.intp]
    recording: Recording
    measured: MeasuredRows
    of: Motion

    @classmethod
    def made(cls, number: int, recording: Recording, measured: MeasuredRows, motion: Motion) -> _Copies:
        """So many copies of a recording whose rows and motion are known."""
        places = np.tile(np.arange(recording.t.size), number)
        return cls(places, recording.at(places), measured.at(places), motion)

    @cached_property
    def motion(self) -> Motion:
        """Their motion, of the corners alone."""
        return replace(self.of, corners={name: corner.at(self.places) for name, corner in self.of.corners.items()})


def _enters(effect: PhysicalEffect) -> bool:
    """Whether an effect's response to the channels is part of the sensitivities.

    The derivatives of an effect with memory cannot be computed at separate instants and are left out: such an effect
    is a small addition to a spring, a damper or an inertia, whose derivatives are included. The noise of those that
    follow the path of a travel is in `PathForces`.
    """
    return effect.instantaneous


def _active_values(effects: Sequence[PhysicalEffect], values: Array) -> Array:
    keep: list[float] = []
    for effect, place in with_places(effects):
        if _enters(effect):
            keep.extend(values[place])
    return np.asarray(keep)


def _inputs(signals: Signals, parts: Sequence[int]) -> list[Input]:
    """All inputs of a run: every component of every channel in these of its `_PARTS`."""
    return [
        (channel, k, order)
        for order in parts
        for channel, array in getattr(signals, _PARTS[order]).items()
        for k in range(array.shape[0])
    ]


def _scale(recording: Recording, one: Input) -> float:
    """Noise of a channel, or tolerance of an assumption."""
    name, _, order = one
    if order != _ASSUMED:
        return recording.rig.noise(name)
    assumption = recording.assumptions[name]
    return assumption.tolerance or abs(assumption.value) or 1.0


def _groups(recording: Recording, inputs: Sequence[Input], most: int) -> list[tuple[str, list[Input]]]:
    """Groups of at most `most` inputs, each with the corner or axle whose channels or tables they are, or ""."""
    by_corner: dict[str, list[Input]] = {}
    tables = {one.name for one in recording.tables}
    for one in inputs:
        corner = ""
        if one[0] in tables:
            corner = one[0].partition(".")[2]
        elif not recording.laws:  # which may take one corner's channel for another's
            # A ground laser turns the road's plane under every wheel.
            channel = CHANNELS[one[0]]
            corner = "" if channel.family == "laser.ground" else channel.corner or ""
        by_corner.setdefault(corner, []).append(one)
    return [
        (corner, inputs[start : start + most])
        for corner, inputs in by_corner.items()
        for start in range(0, len(inputs), most)
    ]


def _moved_by(corner: str, vehicle: Vehicle) -> tuple[str, ...]:
    """Corners whose motion depends on a corner's channels: the axle's other one too if this one moves it; of an axle's
    tables both.
    """
    if corner in AXLES:
        return AXLES[corner]
    other = other_corner(corner)
    return (corner, other) if vehicle.corners[other].depends_on_other else (corner,)


def _stepped(copies: Recording, group: Sequence[Input], steps: Sequence[float]) -> Recording:
    """The copies of a recording, in each of which one input of the group is changed by its step."""
    n = copies.t.size // len(group)
    parts = {part: dict[str, Array](getattr(copies.signals, part)) for part in _PARTS}
    for part, channel in {(_PARTS[order], channel) for channel, _, order in group}:
        parts[part][channel] = parts[part][channel].copy()
    for copy, ((channel, k, order), step) in enumerate(zip(group, steps, strict=True)):
        parts[_PARTS[order]][channel][k, copy * n : (copy + 1) * n] += step
    return copies.with_signals(replace(copies.signals, **parts))


def _slopes(before: Mapping[Row, Array], after: Mapping[Row, Array], steps: Sequence[float]) -> list[dict[Row, Array]]:
    """Of each changed copy, row → slope of the residual, a scalar where it is constant; rows that do not change are
    left out.

    `before` : row → (n,) residual; `after` : row → the residuals of the copies, one after the other.
    """
    out: list[dict[Row, Array]] = [{} for _ in steps]
    step = np.asarray(steps)
    for row, base in before.items():
        slope = (after[row].reshape(step.size, -1) - base) / step[:, None]
        highest, lowest = np.max(slope, axis=1), np.min(slope, axis=1)
        largest = np.maximum(highest, -lowest)
        still = largest * step < 1e-9 * (1.0 + float(np.max(np.abs(base))))
        constant, means = highest - lowest < 1e-6 * largest, np.mean(slope, axis=1)
        for copy in np.flatnonzero(~still).tolist():  # not finite: kept, and refused with the equations
            out[copy][row] = np.asarray(means[copy] if constant[copy] else slope[copy].copy(), float)
    return out
