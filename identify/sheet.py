"""What one tolerance of each gain and latency of the sensor sheet does to a run's equations."""

from __future__ import annotations

import numpy as np

from daq.channels import CHANNELS
from identify.drive import Drive
from identify.filters import derivative
from identify.sensitivity import Perturbation, Sensitivity
from identify.vectors import Array

SheetEntry = tuple[str, str, int]
"""``gain`` or ``latency``, channel, component; a sensor's latency goes by its first channel."""


def sheet_responses(drive: Drive, sensitivity: Sensitivity) -> dict[SheetEntry, dict[str, Array]]:
    """Change of Y − W θ for one tolerance of each entry, after the parallel filter: entry → row → (n,)."""
    recording = drive.recording
    values, rig = recording.signals.value, recording.rig
    late: dict[str, tuple[str, dict[str, Array]]] = {}
    changes: dict[SheetEntry, Perturbation] = {}
    for channel in dict.fromkeys(name for name, _, _ in sensitivity.slopes):
        gain, latency = rig.tolerance(channel, "gain"), rig.tolerance(channel, "latency")
        sensor = rig.sensor_of(channel)
        if latency > 0.0:
            first, parts = late.setdefault(sensor.name if sensor else channel, (channel, {}))
            parts[channel] = -latency * derivative(values[channel], recording.filters.rate)
            changes["latency", first, 0] = parts
        for k in range(CHANNELS[channel].width if gain > 0.0 else 0):
            change = np.zeros_like(values[channel])
            change[k] = gain * values[channel][k]
            changes["gain", channel, k] = {channel: change}
    return {name: drive.decimated(sensitivity.response(change)) for name, change in changes.items()}
