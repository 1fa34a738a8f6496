"""Channels of a run on one time grid: latencies removed, pre-filtered, differentiated; before any geometry.

No quantity that is measured directly is obtained by integration or differentiation: the inertial unit gives specific
force and rates, of which only the angular acceleration is a derivative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lacet.daq.assumptions import Assumption
from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import RunError
from lacet.daq.pauses import PERIODS, pauses
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Vehicle
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import Filters, bring_to_grid, derivative
from lacet.identify.signals.for_equations import for_equations
from lacet.identify.signals.own_rate import sample_rate
from lacet.identify.signals.sources import Law, Source
from lacet.identify.signals.wiener import WienerSmoother, motion_beyond

_LEAST_USABLE = 30
"""Least number of usable samples of a channel."""


_LONGEST_HOLE = 600.0
"""Longest time without any sample that a run may have [s]: it is filled up, in memory and time, and not used."""


class RunNote:
    """A note on how a run was read, for the reader of its results; `is_fault` : whether something is wrong with it."""

    is_fault: ClassVar[bool] = True


@dataclass(frozen=True)
class FewSamples(RunNote):
    """A channel is left out: it has too few `samples` for the filters."""

    channel: str
    samples: int


@dataclass(frozen=True)
class FewUsableSamples(RunNote):
    """A channel is left out: it has fewer usable samples than `least`."""

    channel: str
    least: int


@dataclass(frozen=True)
class Gaps(RunNote):
    """Intervals (from, to) [s] in which a channel has no usable samples."""

    channel: str
    intervals: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Signals:
    """Channels on one grid with their time derivatives, (k, N) each, by channel name; latencies removed.

    Attributes
    ----------
    value, rate, accel : as measured.
    mean, mean_rate : expected true value and rate of channels, given their whole noisy record (`wiener`); empty where
        signals are exact.
    sigma, rate_sigma : the standard deviations of the true ones from those.
    rate_rms : root mean square of the true rate over the run, at every sample.
    assumed : value of each assumption (1, N), by name; empty where every channel is measured and there is no bench
        table.
    """

    value: Mapping[str, Array]
    rate: Mapping[str, Array]
    accel: Mapping[str, Array]
    mean: Mapping[str, Array] = field(default_factory=dict[str, Array])
    mean_rate: Mapping[str, Array] = field(default_factory=dict[str, Array])
    sigma: Mapping[str, Array] = field(default_factory=dict[str, Array])
    rate_sigma: Mapping[str, Array] = field(default_factory=dict[str, Array])
    rate_rms: Mapping[str, Array] = field(default_factory=dict[str, Array])
    assumed: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @classmethod
    def differentiated(cls, value: Mapping[str, Array], rate: float) -> Signals:
        """Signals with derivatives by central differences at `rate` [Hz]; second ones for positions and angles only."""
        first = {name: derivative(array, rate) for name, array in value.items() if _derived(name) >= 1}
        second = {name: derivative(first[name], rate) for name in first if _derived(name) == 2}
        return cls(value, first, second)

    def changed(self, value: Mapping[str, Array], rate: float) -> Signals:
        """These signals with some channels replaced and differentiated at `rate` [Hz]."""
        new = Signals.differentiated(value, rate)
        return replace(
            self,
            value={**self.value, **new.value},
            rate={**self.rate, **new.rate},
            accel={**self.accel, **new.accel},
        )

    def conditioned(self, smoothers: Mapping[str, WienerSmoother]) -> Signals:
        """These signals with the conditional distribution of those channels that have a smoother."""
        return replace(
            self,
            mean={name: smoother.mean(self.value[name]) for name, smoother in smoothers.items()},
            mean_rate={name: smoother.mean(self.rate[name]) for name, smoother in smoothers.items()},
            sigma={name: smoother.sigma[None] for name, smoother in smoothers.items()},
            rate_sigma={name: smoother.rate_sigma[None] for name, smoother in smoothers.items()},
            rate_rms={name: np.full_like(one.rate_sigma, one.rate_rms)[None] for name, one in smoothers.items()},
        )

    def scalar(self, channel: str, n: int) -> tuple[Array, Array, Array]:
        """A scalar channel and its two derivatives, (n,) each; zeros where the channel or a derivative is absent."""
        parts = (part.get(channel) for part in (self.value, self.rate, self.accel))
        value, rate, accel = (np.zeros(n) if part is None else part[0] for part in parts)
        return value, rate, accel

    def at(self, index: NDArray[np.intp] | slice) -> Signals:
        """The signals at the samples `index`."""
        parts: list[Mapping[str, Array]] = [
            self.value, self.rate, self.accel, self.mean, self.mean_rate, self.sigma, self.rate_sigma, self.rate_rms,
            self.assumed,
        ]  # fmt: skip
        return Signals(*({name: a[:, index] for name, a in part.items()} for part in parts))


_BENT = ("laser.hub", "damper.travel")
"""Families of channels whose value and rate are arguments of laws that bend within the noise: suspension travel."""
_DERIVED = {
    "imu.rate": 1, "wheel.speed": 1, "laser.ground": 1, "laser.hub": 2, "camera.steer": 2, "camera.camber": 2,
    "damper.travel": 2, "steering.angle": 2, "car.yaw_rate": 1, "car.lateral_accel": 2,
}  # fmt: skip


def _derived(channel: str) -> int:
    """Number of time derivatives of a channel that the equations use."""
    return _DERIVED.get(CHANNELS[channel].family, 0)


@dataclass(frozen=True)
class Recording:
    """A run on one time grid, before any geometry; a `Motion` is computed from it sample by sample.

    Attributes
    ----------
    run : name of the run; `reference`, `brakes` : as declared by run and rig.
    t : (N,) s.
    signals : channels and derivatives.
    usable : channel → (N,) whether a sample is outside flagged gaps and the filter transients around them.
    rates : each channel's own sample rate [Hz].
    start : time of the run's first sample [s]; `t` begins later in a piece of a long run.
    smoothers : channel → conditional distribution of its true value and rate, for channels whose laws bend; empty at
        single samples, whose `signals` have it.
    sources, laws : where channels that are not measured come from, and how they follow from others.
    tables : how far the bench tables of the vehicle file may be off (`car.table_errors`).
    measured_elsewhere : rows that another run measures, which are not taken on assumptions in this one.

    Examples
    --------
    >>> recording = runs.prepared[0].recording
    >>> recording.signals.value["imu.accel"].shape[0]
    3
    """

    run: str
    t: Array
    signals: Signals
    usable: Mapping[str, NDArray[np.bool_]]
    rates: Mapping[str, float]
    vehicle: Vehicle
    rig: Rig
    filters: Filters
    reference: str
    brakes: str
    notes: tuple[RunNote, ...] = ()
    start: float = 0.0
    smoothers: Mapping[str, WienerSmoother] = field(default_factory=dict[str, WienerSmoother])
    sources: Mapping[str, Source] = field(default_factory=dict[str, Source])
    laws: tuple[Law[Signals], ...] = ()
    tables: tuple[Assumption, ...] = ()
    measured_elsewhere: frozenset[str] = frozenset()

    @property
    def assumptions(self) -> dict[str, Assumption]:
        """What is assumed, by name: by the laws, and of the bench tables."""
        of_laws = {one.name: one for law in self.laws for one in law.assumptions}
        return of_laws | {one.name: one for one in self.tables}

    @property
    def completed(self) -> Signals:
        """The signals with the channels that follow from others by the `laws`, at each sample."""
        signals = self.signals
        for law in self.laws:
            found = law.series(signals)
            signals = replace(
                signals,
                value={**signals.value, law.channel: found.value},
                rate={**signals.rate, law.channel: found.rate},
                accel={**signals.accel, law.channel: found.accel},
            )
            if (given := law.conditional(signals)) is not None:
                signals = replace(
                    signals,
                    mean={**signals.mean, law.channel: given.mean},
                    mean_rate={**signals.mean_rate, law.channel: given.mean_rate},
                    sigma={**signals.sigma, law.channel: given.sigma},
                    rate_sigma={**signals.rate_sigma, law.channel: given.rate_sigma},
                    rate_rms={**signals.rate_rms, law.channel: given.rate_rms},
                )
        return signals

    def smoothed(self, beyond: float | None = None) -> Recording:
        """The recording with the conditional distributions that follow from its own noise and motion.

        `beyond` : mean square of the rate of motion that the pre-filter stopped; by default as known before.
        """
        if beyond is None:
            beyond = max((one.beyond for one in self.smoothers.values()), default=0.0)
        smoothers: dict[str, WienerSmoother] = {}
        for name in self.signals.value:
            if CHANNELS[name].family in _BENT:
                # White noise at the channel's own rate, as white noise of the same density on the grid.
                sigma = self.rig.noise(name) * float(np.sqrt(self.filters.rate / self.rates[name]))
                found = WienerSmoother.of(self.signals.rate[name][0], sigma, self.filters, beyond)
                if found is not None:
                    smoothers[name] = found
        return replace(self, signals=self.signals.conditioned(smoothers), smoothers=smoothers)

    def at(self, index: NDArray[np.intp] | slice) -> Recording:
        """The recording at the samples `index`."""
        usable = {name: mask[index] for name, mask in self.usable.items()}
        smoothers: dict[str, WienerSmoother] = {}
        if isinstance(index, slice) and index.step is None:
            smoothers = {name: one.at(index) for name, one in self.smoothers.items()}
        return replace(self, t=self.t[index], signals=self.signals.at(index), usable=usable, smoothers=smoothers)

    def thinned(self, step: int) -> Recording:
        """Every `step`-th sample, as a recording at a lower rate."""
        return replace(self.at(slice(None, None, step)), filters=replace(self.filters, rate=self.filters.rate / step))

    def with_signals(self, signals: Signals) -> Recording:
        """The recording with these channel values."""
        if self.signals.assumed and not signals.assumed:
            signals = replace(signals, assumed=self.signals.assumed)
        return replace(self, signals=signals.conditioned(self.smoothers) if self.smoothers else signals)


def bring_together(run: Run, vehicle: Vehicle, rig: Rig, filters: Filters, on: Array | None = None) -> Recording:
    """A recording of a run: latencies removed, every channel pre-filtered at its own rate, all on one grid.

    The grid covers the time that all channels have, or is `on` (N,) [s], that of another recording of the same run,
    which may exceed a channel's time by the filters' edge.

    Raises RunError when the run is too short for the filters.
    """
    run, rig = for_equations(run, vehicle, rig)
    grid, notes = _grid(run, rig, filters)
    grid = grid if on is None else on
    values: dict[str, Array] = {}
    usable: dict[str, NDArray[np.bool_]] = {}
    gaps: list[Gaps] = []
    raw: list[tuple[Array, float]] = []
    for name, signal in run.signals.items():
        if len(signal.t) <= 3 * (filters.order + 1):
            continue
        stamped = grid + rig.latency(name)
        filled, holes = _fill(signal)
        if filled is None:
            notes.append(FewUsableSamples(name, _LEAST_USABLE))
            continue
        values[name] = bring_to_grid(signal.t, filled, stamped, filters.pre_cutoff, filters.order)
        if CHANNELS[name].family in _BENT:
            raw.append((filled[:, 0], (len(signal.t) - 1) / float(np.ptp(signal.t))))  # interpolated values as well
        usable[name] = _outside(holes, stamped, filters.edge)
        if holes:
            gaps.append(Gaps(name, tuple(holes)))
    signals = Signals.differentiated(values, filters.rate)
    reference = run.wheel_reference or rig.wheel_reference
    rates = {name: sample_rate(run.signals[name]) for name in values}
    return Recording(
        run.name, grid, signals, usable, rates, vehicle, rig, filters, reference, run.brakes, (*notes, *gaps),
        float(grid[0]),
    ).smoothed(motion_beyond(raw, filters))  # fmt: skip


def _grid(run: Run, rig: Rig, filters: Filters) -> tuple[Array, list[RunNote]]:
    spans = [
        (signal.t[0] - rig.latency(name), signal.t[-1] - rig.latency(name), name)
        for name, signal in run.signals.items()
        if len(signal.t) > 3 * (filters.order + 1)
    ]
    short = [name for name, signal in run.signals.items() if len(signal.t) <= 3 * (filters.order + 1)]
    if not spans:
        raise RunError(run.name, ["no channel has enough samples to be filtered; record for some seconds at least"])
    if (hole := _longest_hole([run.signals[name] for *_, name in spans])) is not None:
        a, b = hole
        raise RunError(
            run.name,
            [
                f"no channel has samples from {a:.2f} to {b:.2f} s, {b - a:.3g} s: several drives, or a clock that was "
                f"set. Use one part at a time: --to {a:.2f}, or --from {b:.2f}"
            ],
        )
    fastest = max(1.0 / float(np.median(np.diff(run.signals[name].t))) for *_, name in spans)
    if fastest < 2.0 * filters.fit_cutoff:
        raise RunError(
            run.name,
            [
                f"no channel has more than {fastest:.3g} samples a second; a fit up to {filters.fit_cutoff:g} Hz needs "
                f"{2.0 * filters.fit_cutoff:g} at least. Are the times right ('lacet info')?"
            ],
        )
    start, stop = max(s[0] for s in spans), min(s[1] for s in spans)
    least = 2.0 * filters.edge + 4.0 / filters.fit_cutoff
    if stop - start < least:
        raise RunError(
            run.name,
            [
                f"the channels overlap for {max(0.0, stop - start):.2f} s; at least {least:.2f} s are needed for a "
                f"fit up to {filters.fit_cutoff:g} Hz (latest start: {max(spans)[2]}, earliest end: "
                f"{min(spans, key=lambda s: s[1])[2]})"
            ],
        )
    # A small step inside both ends keeps every channel's stamps around the grid.
    count = int(np.floor((stop - start) * filters.rate - 1e-6)) + 1
    notes: list[RunNote] = [FewSamples(name, len(run.signals[name].t)) for name in short]
    return start + np.arange(count) / filters.rate, notes


def _longest_hole(signals: Sequence[Signal]) -> tuple[float, float] | None:
    """The longest time in which no signal has a sample (from, to) [s]; None where none exceeds `_LONGEST_HOLE`."""
    holes = pauses(max((signal.t for signal in signals), key=len), _LONGEST_HOLE / PERIODS)
    for signal in signals:
        ends = [end for hole in holes for end in _ends(signal, *hole)]
        holes = [(a, b) for a, b in ends if b - a > _LONGEST_HOLE]
    return max(holes, key=lambda hole: hole[1] - hole[0], default=None)


def _ends(signal: Signal, a: float, b: float) -> list[tuple[float, float]]:
    """The parts of a hole before a signal's first sample in it and behind the last."""
    first, behind = int(np.searchsorted(signal.t, a, "right")), int(np.searchsorted(signal.t, b))
    return [(a, float(signal.t[first])), (float(signal.t[behind - 1]), b)] if behind > first else [(a, b)]


def _fill(signal: Signal) -> tuple[Array | None, list[tuple[float, float]]]:
    """Values with unusable samples interpolated, and the gaps (`pauses`) as (from, to) [s]."""
    good = signal.usable
    if np.count_nonzero(good) < _LEAST_USABLE:
        return None, []
    t = signal.t[good]
    values = signal.values
    if not np.all(good):
        columns = [np.asarray(np.interp(signal.t, t, column[good]), float) for column in signal.values.T]
        values = np.stack(columns, axis=1)
    # Lost samples leave no rows: a gap shows as a long step between usable stamps, whatever its cause.
    edges = np.concatenate(([signal.t[0] - 1e-9], t, [signal.t[-1] + 1e-9]))
    holes = pauses(edges, float(np.median(np.diff(t))))
    clock = signal.t[(signal.flags & int(Flag.CLOCK)) != 0]
    return values, holes + [(float(x), float(x)) for x in clock]


def _outside(holes: list[tuple[float, float]], t: Array, margin: float) -> NDArray[np.bool_]:
    keep = np.ones(t.size, bool)
    for start, stop in holes:
        keep &= (t < start - margin) | (t > stop + margin)
    return keep
