"""Samples of the runs of a ranking, wherever they are: each pass over them is a task for each run, and a merge."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from lacet.daq.set_aside import ArraysOnDisk, DiskSpace
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sums.tree import merged
from lacet.identify.selection.columns.weighted_columns import Block

T = TypeVar("T")


@dataclass(frozen=True)
class Blocks:
    """Weighted samples of one run, or of pieces of it, row by row.

    Attributes
    ----------
    held : the blocks; of a long run without zeros, columns and draws, which are read when a block is reached.
    on_disk : zeros, columns and draws of each block; empty where they are held.
    """

    held: tuple[Block, ...]
    on_disk: tuple[ArraysOnDisk[str], ...] = ()

    @classmethod
    def of(cls, blocks: Iterable[Block], is_long: bool) -> Blocks:
        """Given blocks; those of a long run one after the other to disk."""
        if not is_long:
            return cls(tuple(blocks))
        space, held, on_disk, none = DiskSpace(), list[Block](), list[ArraysOnDisk[str]](), np.zeros((0, 0))
        for block in blocks:
            on_disk.append(space.put({"zeros": block.zeros, "columns": block.columns, "draws": block.draws}))
            held.append(replace(block, zeros=none, columns=none, draws=none))
        return cls(tuple(held), tuple(on_disk))

    def __iter__(self) -> Iterator[Block]:
        return self.of_row(None)

    def of_row(self, row: Row | None) -> Iterator[Block]:
        """The blocks of a row, or all."""
        for number, block in enumerate(self.held):
            if row is None or block.row == row:
                if self.on_disk:
                    kept = self.on_disk[number]
                    block = replace(block, zeros=kept["zeros"], columns=kept["columns"], draws=kept["draws"])
                yield block


@dataclass(frozen=True)
class RunSamples:
    """Weighted samples of one run, and what its zeros explain of them.

    Attributes
    ----------
    blocks : the samples.
    zero_gain : (z, w) regression of each column on the run's zeros.
    noise_zeros : (z, D) regression of its simulated noise on them.
    first : number of the run's first block in the cross-validation of all runs.
    """

    blocks: Blocks
    zero_gain: Array
    noise_zeros: Array
    first: int = 0

    @property
    def block_count(self) -> int:
        """Number of blocks of the cross-validation."""
        return 1 + max((int(block.number.max()) for block in self.blocks.held), default=-1)

    def series(self, coefficients: Array, row: Row | None = None) -> Iterator[tuple[Block, Array]]:
        """For each block, or each of a `row`, (n, k) columns · coefficients (w, k), less their regression on zeros."""
        nuisance = self.zero_gain @ coefficients
        for block in self.blocks.of_row(row):
            yield block, block.columns @ coefficients[block.active] - block.zeros @ nuisance

    def noise_series(self, coefficients: Array, row: Row) -> Iterator[tuple[Block, Array]]:
        """For each block of a row (n, D) noise plus columns · coefficients (w, D), less the regression on zeros."""
        for block, moved in self.series(coefficients, row):
            yield block, block.draws.T[:, block.choice] - block.zeros @ self.noise_zeros + moved

    def whole_series(self, measured: Array, simulated: Array, row: Row) -> tuple[Array, Array] | None:
        """(n,) residual of a row and (D, n) those of simulated runs, by coefficients (w, 1) and (w, D) of the columns.

        None where the run has no such row.
        """
        own = [series[:, 0] for _, series in self.series(measured, row)]
        drawn = [series.T for _, series in self.noise_series(simulated, row)]
        return (np.concatenate(own), np.concatenate(drawn, axis=1)) if own else None


class SampleTask(Protocol[T]):
    """A task for the samples of each run: plain values, and functions that depend on nothing else."""

    def of_run(self, run: RunSamples) -> T:
        """The result for one run."""
        ...

    def merged(self, parts: Sequence[T]) -> T:
        """Results for several runs, in their order, as one."""
        ...


class Samples(Protocol):
    """Samples of all runs."""

    def sum(self, task: SampleTask[T]) -> T:
        """The result of a task over all runs."""
        ...


@dataclass(frozen=True)
class HeldSamples:
    """Samples in memory."""

    runs: tuple[RunSamples, ...]

    def sum(self, task: SampleTask[T]) -> T:
        """The result of a task over all runs, one after the other."""
        return merged((task.of_run(run) for run in self.runs), task.merged)
