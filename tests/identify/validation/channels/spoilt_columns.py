"""Runs with a fault in one column of one channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.run import Run

LATE = 0.030
"""Delay of a late column [s]."""

Array = NDArray[np.float64]
FAULTS: Mapping[str, Callable[[Array, Array], Array]] = {
    "zero": lambda t, x: np.zeros_like(x),
    "constant": lambda t, x: np.full_like(x, x[0]),
    "sign": lambda t, x: -x,
    "× 1000": lambda t, x: 1000.0 * x,
    "÷ 1000": lambda t, x: x / 1000.0,
    "late": lambda t, x: np.asarray(np.interp(t - LATE, t, x), float),
}
"""Fault → the values of a column at times t [s] with it."""
COPY = "copy"
EVERY = (*FAULTS, COPY)


def series_of(run: Run, column: str) -> Array:
    """The values of one column."""
    channel, place = COLUMNS[column]
    return run.signals[channel.name].values[:, place]


def with_column(run: Run, column: str, values: Array | float) -> Run:
    """The run with other values in one column."""
    channel, place = COLUMNS[column]
    table = run.signals[channel.name].values.copy()
    table[:, place] = values
    return run.with_values({channel.name: table})


def spoilt_column(run: Run, column: str, fault: str) -> Run:
    """The run with a fault in one column; a copy is of another corner's, or of the next component."""
    if fault == COPY:
        return with_column(run, column, series_of(run, _other(run, column)))
    return with_column(run, column, FAULTS[fault](run.signals[COLUMNS[column][0].name].t, series_of(run, column)))


def _other(run: Run, column: str) -> str:
    channel, place = COLUMNS[column]
    alike = [name for name in run.signals if CHANNELS[name].family == channel.family and name != channel.name]
    return CHANNELS[alike[0]].columns[place] if alike else channel.columns[(place + 1) % channel.width]
