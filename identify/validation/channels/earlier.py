"""A recording with some columns shifted in time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.daq.channels import COLUMNS
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.signals.spline import CubicSpline


def earlier(recording: Recording, delays: Mapping[str, float]) -> Recording:
    """The recording with each of these columns read its delay [s] later, by cubic interpolation."""
    rate, changed = recording.filters.rate, dict(recording.signals.value)
    samples = np.arange(recording.t.size, dtype=float)
    for column, delay in delays.items():
        channel, place = COLUMNS[column]
        values = changed[channel.name].copy()
        at = np.clip(samples + delay * rate, 0.0, samples[-1])
        values[place] = CubicSpline.of(samples, values[place][None]).at(at)[0]
        changed[channel.name] = values
    shifted = {COLUMNS[column][0].name for column in delays}
    return recording.with_signals(recording.signals.changed({name: changed[name] for name in shifted}, rate))
