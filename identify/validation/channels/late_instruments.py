"""Whole instruments that are later, or earlier, than the rig says, from the car's own equations.

The delays of all instruments behind the wheel loads are estimated together, beside the parameters of the base model and
spring and damping across each axle (`fault_columns`). A delay found is removed from the recording and estimated again,
as 40 ms are more than a first-order estimate reaches on a rough road.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from lacet.daq.channels import CHANNELS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.earlier import earlier
from lacet.identify.validation.channels.evidence import NOISY, USUAL, is_large, reach
from lacet.identify.validation.channels.fault_columns import LATE, DelayEstimate, FaultColumns

_STEPS = 6
"""Largest number of times that delays are removed and estimated again."""
_CLOSE = 1e-3
"""Change of a delay with which it is settled [s]."""
_LATEST = 0.2
"""Largest delay that is looked for [s]; larger ones are clocks that differ (`validation.clocks`)."""


@dataclass(frozen=True)
class LateInstruments:
    """Instruments that are later or earlier than the wheel loads, by another time than the rig says.

    Attributes
    ----------
    delay, half : instrument → later than the rig says by this [s], and half of its 95 % interval.
    loads : whether it is the wheel loads: all instruments whose delay the run shows, two or more, are off alike.
    misfit, remaining : root of the weighted squares ÷ samples (1 : noise alone) as it is, and without the delays.
    runs : run → the seconds looked at, from and to.
    """

    delay: Mapping[str, float]
    half: Mapping[str, float]
    loads: bool
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

    `products` : those of the run.
    """
    delays: dict[str, float] = {}
    moved, found = run, products
    for _ in range(_STEPS):
        now = {name: one for name, one in found.instrument_delays().items() if one.noise < NOISY}
        each = {name: delays.get(name, 0.0) + one.delay for name, one in now.items()}
        late = {name: delay for name, delay in each.items() if name in delays or _is_late(delay, now[name], products)}
        if not late or max(map(abs, late.values())) > _LATEST:
            return None
        if (
            delays
            and late.keys() == delays.keys() <= now.keys()
            and all(abs(now[name].delay) < _CLOSE for name in late)
        ):
            break
        delays = late
        moved = PreparedRun(earlier(run.recording, _columns(run.recording, delays)), is_piece=True)
        again = FaultColumns.of(moved)
        if again is None:
            return None
        found = again
    else:
        return None
    before, after = products.misfit_as_stamped, found.misfit_as_stamped
    if not is_large(before - after, before) or not all(_is_late(delays[name], now[name], products) for name in delays):
        return None
    half = {name: USUAL * now[name].spread for name in delays}
    shown = [name for name, one in now.items() if reach(products.block_count) * one.spread < LATE]
    mean = sum(delays.values()) / len(delays)
    loads = len(delays) > 1 and set(shown) <= delays.keys() and all(abs(d - mean) < LATE for d in delays.values())
    seconds = {run.name: (float(run.recording.t[0]), float(run.recording.t[-1]))}
    return WithoutDelays(LateInstruments(delays, half, loads, before**0.5, after**0.5, seconds), moved, found)


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
    return one.delay.keys() == other.delay.keys() and all(
        abs(delay - other.delay[name]) < max(one.half[name] + other.half[name], LATE)
        for name, delay in one.delay.items()
    )


def _is_late(delay: float, estimate: DelayEstimate, products: FaultColumns) -> bool:
    return abs(delay) - reach(products.block_count) * estimate.spread > LATE


def _columns(recording: Recording, delays: Mapping[str, float]) -> dict[str, float]:
    """Delay of every column of these instruments."""
    sensors = {name: recording.rig.sensor_of(name) for name in recording.signals.value}
    return {
        column: delays[sensor.name]
        for name, sensor in sensors.items()
        if sensor is not None and sensor.name in delays
        for column in CHANNELS[name].columns
    }
