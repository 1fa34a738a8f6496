"""Whole instruments, or kinds of columns, that are later or earlier than the rig says, from the car's own equations.

Their delays behind each other are estimated together, beside the parameters of the base model and spring and damping
across each axle (`fault_columns`). A delay found is removed from the recording and estimated again, as 40 ms are more
than a first-order estimate reaches on a rough road.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.column_kinds import kind_of, sensors_of
from lacet.identify.validation.channels.delays import DelayEstimate, instrument_delays, kind_delays
from lacet.identify.validation.channels.earlier import earlier
from lacet.identify.validation.channels.evidence import NOISY, USUAL, is_large, reach
from lacet.identify.validation.channels.fault_columns import LATE, FaultColumns

_STEPS = 6
"""Largest number of times that delays are removed and estimated again."""
_CLOSE = 1e-3
"""Change of a delay with which it is settled [s]."""
_NOISIEST = 0.5
"""Largest part of noise in what a delay changes: a first estimate is low by it, which goes as the delay is removed."""
_FAILS = 3.0
"""Misfit from which a first estimate at `_COARSE` is worth its time, too."""
_COARSE = 2.0
"""Cut-off at which a first-order estimate reaches a tenth of a second on a rough road, too [Hz]."""
_LATEST = 0.2
"""Largest delay that is looked for [s]; larger ones are clocks that differ (`validation.clocks`)."""


@dataclass(frozen=True)
class LateInstrument:
    """An instrument that is later or earlier than the others, by another time than the rig says.

    Attributes
    ----------
    name : of the rig's sensor, all of whose channels that the run shows are; else of the kind of its columns.
    delay, half : later than the rig says by this [s], and half of its 95 % interval.
    """

    name: str
    delay: float
    half: float


@dataclass(frozen=True)
class LateInstruments:
    """Instruments that are late in runs.

    Attributes
    ----------
    instruments : each with its delay.
    misfit, remaining : root of the weighted squares ÷ samples (1 : noise alone) as it is, and without the delays.
    runs : run → the seconds looked at, from and to.
    """

    instruments: tuple[LateInstrument, ...]
    misfit: float
    remaining: float
    runs: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class WithoutDelays:
    """A run without the delays found in it: what was `found`, the `run` and its `products`."""

    found: LateInstruments
    run: PreparedRun
    products: FaultColumns


def late_instruments(run: PreparedRun, products: FaultColumns) -> WithoutDelays | None:
    """Instruments that are late in a run; None where none is.

    `products` : those of the run. Kinds of columns are late by themselves only where that explains more.
    """
    found = _least(run, products, products)
    if (products if found is None else found.products).misfit > _FAILS**2:
        filters = replace(run.recording.filters, fit_cutoff=min(_COARSE, run.recording.filters.fit_cutoff))
        coarse = FaultColumns.of(PreparedRun(replace(run.recording, filters=filters), is_piece=True))
        other = None if coarse is None else _least(run, products, coarse)
        if other is not None and (found is None or other.found.remaining < found.found.remaining):
            return other
    return found


def _least(run: PreparedRun, products: FaultColumns, begin: FaultColumns) -> WithoutDelays | None:
    """What leaves least of the delays of instruments and of those of kinds of columns."""
    each = [_settled(run, products, begin, estimated) for estimated in (instrument_delays, kind_delays)]
    found = [one for one in each if one is not None]
    return min(found, key=lambda one: one.found.remaining) if found else None


def _settled(
    run: PreparedRun, products: FaultColumns, begin: FaultColumns,
    estimated: Callable[[FaultColumns], list[DelayEstimate]],
) -> WithoutDelays | None:  # fmt: skip
    """The instruments, or kinds of columns, that are late; None where none is for sure.

    `products` : of the run; `begin` : those of the first estimate.
    """
    most = reach(products.block_count)
    delays: dict[str, float] = {}
    moved, found = run, begin
    for _ in range(_STEPS):
        estimates = estimated(found)
        late = _late(estimates, delays, most)
        if not late:
            return None
        kinds = {kind: one.delay for one in late for kind in one.kinds}
        if kinds.keys() == delays.keys() and all(abs(one.delay) < _CLOSE for one in late):
            break
        delays = {kind: delays.get(kind, 0.0) + delay for kind, delay in kinds.items()}
        if max(map(abs, delays.values())) > _LATEST:
            return None
        moved = PreparedRun(earlier(run.recording, _columns(run.recording, delays)), is_piece=True)
        again = FaultColumns.of(moved)
        if again is None:
            return None
        found = again
    else:
        return None
    before, after = products.misfit_as_stamped, found.misfit_as_stamped
    if not is_large(before - after, before):
        return None
    shown = [one for one in estimates if one.noise < NOISY and most * one.spread < LATE]
    half = {kind: USUAL * one.spread for one in late for kind in one.kinds}
    instruments = _named(run.recording, delays, half, {kind for one in shown for kind in one.kinds})
    seconds = {run.name: (float(run.recording.t[0]), float(run.recording.t[-1]))}
    return WithoutDelays(LateInstruments(instruments, before**0.5, after**0.5, seconds), moved, found)


def _late(estimates: Sequence[DelayEstimate], removed: Mapping[str, float], most: float) -> list[DelayEstimate]:
    """Those that are late for sure, by half of `LATE` at least, and noisy ones that are late by the same.

    `removed` : what was removed of the delay of each kind of columns; `most` : of an interval that misses by chance
    alone, half ÷ spread.
    """
    each = [(sum(removed.get(kind, 0.0) for kind in one.kinds) / len(one.kinds) + one.delay, one) for one in estimates]
    late = [(delay, one) for delay, one in each if abs(delay) - most * one.spread > 0.5 * LATE]
    sure = [delay for delay, one in late if one.noise < _NOISIEST]
    return [one for delay, one in late if any(abs(delay - other) < LATE for other in sure)]


def _named(
    recording: Recording, delays: Mapping[str, float], half: Mapping[str, float], shown: Set[str]
) -> tuple[LateInstrument, ...]:
    """The late kinds of columns, as instruments of the rig where all of one are alike.

    Where all that is as the rig says is of one instrument, it is that: what is late of two is not so by chance.
    """
    sensors = {kind: sensors_of(recording, kind) for kind in shown | delays.keys()}
    sound = {sensors[kind] for kind in shown - delays.keys()}
    off = dict.fromkeys(sensors[kind] for kind in delays)
    mean = float(np.mean(list(delays.values())))
    if len(sound) == 1 and len(off) > 1 and all(abs(delay - mean) < LATE for delay in delays.values()):
        (alone,) = sound
        return (LateInstrument(" and ".join(alone), -mean, max(half[kind] for kind in delays)),)
    out: list[LateInstrument] = []
    for sensor in off:
        kinds = [kind for kind in delays if sensors[kind] == sensor]
        values, widest = [delays[kind] for kind in kinds], max(half[kind] for kind in kinds)
        if sensor not in sound and np.ptp(values) < LATE:
            out.append(LateInstrument(" and ".join(sensor), float(np.mean(values)), widest))
        else:
            out += [LateInstrument(kind, delays[kind], half[kind]) for kind in kinds]
    return tuple(out)


def in_common(found: Sequence[LateInstruments]) -> list[LateInstruments]:
    """Those of runs with the same instruments late by the same, within their intervals, as one: that of the first."""
    out: list[LateInstruments] = []
    for one in found:
        same = next((i for i, other in enumerate(out) if _are_alike(one, other)), None)
        if same is None:
            out.append(one)
        else:
            out[same] = replace(out[same], runs={**out[same].runs, **one.runs})
    return out


def _are_alike(one: LateInstruments, other: LateInstruments) -> bool:
    return len(one.instruments) == len(other.instruments) and all(
        a.name == b.name and abs(a.delay - b.delay) < max(a.half + b.half, LATE)
        for a, b in zip(one.instruments, other.instruments, strict=True)
    )


def _columns(recording: Recording, delays: Mapping[str, float]) -> dict[str, float]:
    """Delay of every column of these kinds."""
    return {
        column: delays[kind_of(name)]
        for name in recording.signals.value
        if kind_of(name) in delays
        for column in CHANNELS[name].columns
    }
