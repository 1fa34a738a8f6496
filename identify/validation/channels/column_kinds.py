"""Columns that are late together: those of one family, or of one wheel's loads."""

from __future__ import annotations

from typing import Final

from lacet.daq.channels import CHANNELS
from lacet.identify.signals.reconstruct import Recording

LOADS: Final = ("wheel.force", "wheel.moment")
"""Families of the wheel loads, each wheel's by an instrument of its own."""


def kind_of(channel: str) -> str:
    """The columns that are late together with a channel's: of its family, or of its wheel's forces and moments."""
    found = CHANNELS[channel]
    return found.name.rpartition(".")[0] if found.family in LOADS else found.family


def sensors_of(recording: Recording, kind: str) -> tuple[str, ...]:
    """Names of the rig's sensors that measure a kind of columns."""
    sensors = (recording.rig.sensor_of(name) for name in recording.signals.value if kind_of(name) == kind)
    return tuple(sorted({sensor.name for sensor in sensors if sensor is not None}))
