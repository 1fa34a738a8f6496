"""Blocks of about two seconds of a row: independent observations for cluster-robust intervals and cross-validation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.uncertainty import BLOCK


def block_numbers(runs: Sequence[PreparedRun], row: Row) -> NDArray[np.intp]:
    """Block number (n,) of every sample of a row, over all runs that have it, one after the other.

    A residual is correlated within `BLOCK` [s]. No block reaches over two runs.
    """
    parts: list[NDArray[np.intp]] = []
    first = 0
    for run in runs:
        if row in run.index:
            since = run.recording.t[run.index[row]] - run.recording.t[0]
            parts.append(first + (since // BLOCK).astype(np.intp))
        first += int(np.ptp(run.recording.t) // BLOCK) + 1
    return np.concatenate(parts)
