"""Samples of a ranking whose runs are in memory."""

from __future__ import annotations

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.samples import HeldSamples, RunSamples
from lacet.identify.selection.columns.weighted_columns import Block
from lacet.identify.selection.lack_of_fit import LackOfFit


def runs_of(sums: CrossProducts) -> tuple[RunSamples, ...]:
    """The runs' samples."""
    assert isinstance(sums.samples, HeldSamples)
    return sums.samples.runs


def blocks_of(sums: CrossProducts) -> list[tuple[int, Block]]:
    """Index of the run, and a block, one after the other."""
    return [(number, block) for number, run in enumerate(runs_of(sums)) for block in run.blocks]


def remainder_of(left: LackOfFit, row: Row) -> dict[int, tuple[Array, Array]]:
    """Run → (n,) residual of a row, and (D, n) those of simulated runs."""
    remainder = left.remainder
    found = {
        number: run.whole_series(remainder.measured, remainder.simulated, row)
        for number, run in enumerate(runs_of(remainder.sums))
    }
    return {number: pair for number, pair in found.items() if pair is not None}
