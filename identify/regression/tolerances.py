"""Responses of a run's equations to one tolerance of the sensor sheet's gains and latencies, and of assumptions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.signals.time_base import late

SheetEntry = tuple[str, str, int]
"""Entry of the sensor sheet: ``gain`` or ``latency``, channel, component; a sensor's latency has its first channel.
Where channels are not measured also ``assumed``, name of the assumption, 0."""
ASSUMED = "assumed"


def sheet_entries(
    rig: Rig, channels: Iterable[str], assumptions: Iterable[str] = ()
) -> dict[SheetEntry, tuple[str, ...]]:
    """Gains and latencies of the sheet for these channels, entry → the channels that it applies to.

    And an entry without channels for each of the `assumptions`, by name.
    """
    out: dict[SheetEntry, tuple[str, ...]] = {}
    first: dict[str, str] = {}
    for channel in channels:
        if rig.tolerance(channel, "latency") > 0.0:
            sensor = rig.sensor_of(channel)
            entry = ("latency", first.setdefault(sensor.name if sensor else channel, channel), 0)
            out[entry] = (*out.get(entry, ()), channel)
        if rig.tolerance(channel, "gain") > 0.0:
            out |= {("gain", channel, k): (channel,) for k in range(CHANNELS[channel].width)}
    return out | {(ASSUMED, name, 0): () for name in assumptions}


def entry_name(entry: SheetEntry, rig: Rig) -> str:
    """Name of an entry of a rig's sensor sheet, ``latency of <sensor>`` or ``gain of <channel.component>``.

    Of an assumption ``assumed <name>``.
    """
    what, channel, component = entry
    if what == ASSUMED:
        return f"assumed {channel}"
    if what != "latency":
        return f"{what} of {CHANNELS[channel].columns[component]}"
    sensor = rig.sensor_of(channel)
    return f"latency of {sensor.name if sensor else channel}"


def sheet_responses(run: PreparedRun, sensitivity: Sensitivity) -> dict[SheetEntry, dict[Row, Array]]:
    """Responses of a run to the sensor sheet: entry → row → (n,) change of Y − W θ for one tolerance, filtered."""
    recording = run.recording
    values, rig = recording.signals.value, recording.rig
    entries = sheet_entries(rig, sensitivity.channels, sensitivity.assumptions)

    def responses() -> Iterator[dict[Row, Array]]:
        for (what, channel, k), members in entries.items():
            if what == "latency":
                tolerance = rig.tolerance(channel, "latency")
                yield sensitivity.response({name: tolerance * a for name, a in late(members, recording).items()})
            elif what == "gain":
                change = np.zeros_like(values[channel])
                change[k] = rig.tolerance(channel, "gain") * values[channel][k]
                yield sensitivity.response({channel: change})
            else:
                tolerance = recording.assumptions[channel].tolerance
                yield {row: tolerance * series for row, series in sensitivity.assumed(channel).items()}

    return dict(zip(entries, run.decimated_each(responses()), strict=True))
