"""Draws of the channels' noise as the sensor sheet has it, seen after the pre-filter."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from daq.channels import CHANNELS
from identify.filters import zero_phase
from identify.reconstruct import Recording
from identify.vectors import Array


def draw_noise(recording: Recording, channels: Iterable[str], rng: np.random.Generator) -> dict[str, Array]:
    """One draw, (k, N) by channel, on the recording's grid.

    White noise of the sheet's σ at each channel's own rate has the same spectrum below the pre-filter's cut-off as
    white noise on the grid with σ scaled by the root of the rates.
    """
    filters, n = recording.filters, recording.t.size
    out: dict[str, Array] = {}
    for channel in channels:
        scale = recording.rig.noise(channel) * np.sqrt(filters.rate / recording.rates[channel])
        white = scale * rng.standard_normal((CHANNELS[channel].width, n))
        if filters.pre_cutoff is not None:
            white = zero_phase(white, filters.pre_cutoff, filters.rate, filters.order)
        out[channel] = white
    return out
