"""Samples of residuals, with simulated ones beside them and regressor columns, a stretch of a run at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.set_aside import JoinedOnDisk
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.blocks import block_numbers
from lacet.identify.validation.cross_validation import Stretch
from lacet.identify.validation.projected_noise import Draws
from lacet.identify.validation.smooth_regressors import Columns


@dataclass(frozen=True)
class Samples:
    """Residuals of rows that have the same samples and columns, each followed by its draws, as targets of regressions.

    Iterated over by stretches, of a long run its pieces.

    Attributes
    ----------
    columns : of all the rows.
    places : row → its residual's place among the targets, and those of its draws.
    residuals, draws : of each run that has the rows, row → (n,) and row → (D, n).
    numbers : (n,) block number of every sample, from 0 without gaps; `blocks` of them.
    """

    columns: Columns
    places: Mapping[Row, slice]
    residuals: Sequence[Mapping[Row, Array]]
    draws: Sequence[Mapping[Row, Array]]
    numbers: NDArray[np.intp]

    @classmethod
    def of(cls, fitted: Fit, draws: Draws, rows: Sequence[Row], columns: Columns) -> Samples:
        """Of the residuals of a fit."""
        having = [i for i, run in enumerate(fitted.runs) if rows[0] in run.index]
        count = 1 + len(draws[having[0]][rows[0]])
        places = {row: slice(k * count, (k + 1) * count) for k, row in enumerate(rows)}
        numbers = np.unique(block_numbers(fitted.runs, rows[0]), return_inverse=True)[1]
        return cls(
            columns, places, [fitted.residual[i] for i in having], [draws[i] for i in having],
            np.asarray(numbers, np.intp),
        )  # fmt: skip

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.numbers[-1]) + 1

    def __iter__(self) -> Iterator[Stretch]:
        begin = 0
        for run, (residual, draws) in enumerate(zip(self.residuals, self.draws, strict=True)):
            start = 0
            for part in draws.parts if isinstance(draws, JoinedOnDisk) else (draws,):
                first = next(iter(self.places))
                if first not in part:
                    continue
                drawn = {row: part[row] for row in self.places}
                stop = start + drawn[first].shape[1]
                targets = np.concatenate(
                    [x for row in self.places for x in (residual[row][None, start:stop], drawn[row])]
                )
                columns = self.columns.stretch(run, start, stop)
                yield Stretch(columns, targets.T, self.numbers[begin + start : begin + stop])
                start = stop
            begin += start
