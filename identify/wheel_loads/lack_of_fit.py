"""What a fit leaves of runs beyond sensor noise and uncertain parameters, row by row."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.validation.score import Comparison


def lack_of_fit(comparisons: Iterable[Comparison]) -> dict[Row, float]:
    """Row → RMS over runs by which the residual exceeds its floor and the prediction's doubt [N or N·m].

    Of runs held out where there are any; of runs used it is too small by what their own fit explains.
    """
    squares: dict[Row, list[float]] = {}
    for part in comparisons:
        for row, score in part.scores.items():
            explained = score.floor**2 * (1.0 + score.doubt**2)
            squares.setdefault(row, []).append(max(0.0, score.rms**2 - explained))
    return {row: float(np.sqrt(np.mean(values))) for row, values in squares.items()}
