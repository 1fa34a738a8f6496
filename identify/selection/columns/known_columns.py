"""Weighted samples with columns that other samples of the same fit and weights have already.

Most columns of one set of cross products are columns of another: of the model, of the sensor sheet, of candidates at
the same shape constants. Only the columns of further effects are computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.layout import Layout, Trial
from lacet.identify.selection.columns.samples import HeldSamples, RunSamples, Samples
from lacet.identify.selection.columns.weighted_columns import Block, Weighting
from lacet.identify.validation.noise_floor import NoiseFloor


@dataclass(frozen=True)
class KnownColumns:
    """Columns of a layout that samples of the same fit have, and the others.

    Attributes
    ----------
    before, runs : weighting of those samples, and the samples of each run.
    place : (w,) place of each column of the layout in theirs, −1 for none.
    fresh : trials without a column there, with their effects.
    """

    before: Weighting
    runs: tuple[RunSamples, ...]
    place: NDArray[np.intp]
    fresh: tuple[tuple[Trial, PhysicalEffect], ...]

    @classmethod
    def of(cls, layout: Layout, before: Weighting, samples: Samples) -> KnownColumns | None:
        """The columns of a layout in samples with a weighting.

        None where the samples are elsewhere, or columns of others than physical effects are not among them.
        Columns of sensor faults are made with the sensitivities of the residual, which only the fit's pieces have.
        """
        old = before.layout
        if not isinstance(samples, HeldSamples) or (old.model, old.sheet) != (layout.model, layout.sheet):
            return None
        there = {repr(trial.effect): trial.place for trial in old.trials}
        place = np.full(layout.width, -1, np.intp)
        place[: layout.model + len(layout.sheet)] = np.arange(layout.model + len(layout.sheet))
        place[layout.right] = old.right
        fresh: list[tuple[Trial, PhysicalEffect]] = []
        for trial in layout.trials:
            if (known := there.get(repr(trial.effect))) is not None:
                place[trial.place] = np.r_[known]
            elif (physics := trial.effect.as_physics) is not None:
                fresh.append((trial, physics))
            else:
                return None
        return cls(before, samples.runs, place, tuple(fresh))

    def blocks(self, fitted: Fit, floor: NoiseFloor, weighting: Weighting, run: int) -> Iterator[Block]:
        """Weighted samples of one run, as of `weighted_columns.blocks_of`, from those that are known."""
        known = self.runs[run].blocks
        seen = dict.fromkeys((block.row for block in known.held), 0)
        each = {row: known.of_row(row) for row in seen}
        stiffer = self.before.prior_stiffening / weighting.prior_stiffening
        effects = [effect for _, effect in self.fresh]
        for part in fitted.assembly.runs[run].pieces():
            found = part.each_column(effects)
            for row in part.rows:
                block = next(each[row])
                start, stop = seen[row], seen[row] + len(block.number)
                seen[row] = stop
                position = np.full(self.before.layout.width, -1)
                position[block.active] = np.arange(len(block.active))
                source = np.where(self.place < 0, -1, position[self.place])
                taken = np.flatnonzero(source[:-1] >= 0)
                own = [(trial.place, columns[row]) for (trial, _), columns in zip(self.fresh, found, strict=True)
                       if row in columns]  # fmt: skip
                parts = [block.columns[:, source[taken]], *(columns.T / floor.sigma[row] for _, columns in own),
                         block.columns[:, -1:]]  # fmt: skip
                active = [taken, *(np.r_[place] for place, _ in own), [weighting.layout.right]]
                noise, choice = floor.draws[run].piece(row, start, stop)
                yield Block(
                    row, block.zeros * stiffer, np.concatenate(parts, axis=1),
                    np.concatenate(active).astype(np.intp), block.number, noise / floor.sigma[row], choice,
                )  # fmt: skip
