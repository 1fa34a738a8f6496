"""What noise in the columns themselves adds to the sums that a ranking is made of.

A column made of noisy channels is correlated with the residual, which the same noise is in: without this, a law that
follows a rate sensor's noise looks like an effect, and so does the scale of a noisy sensor. One draw of noise added and
the same draw subtracted leave the products of errors and the mean shift of bent laws, as `identify.noise_bias` has it
for the fit. It depends on the motion and hardly on the noise of a run, so it is found once and kept with the noise
floor.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from identify.assembly import Piece
from identify.fit import Fit
from identify.freed import Freed
from identify.layout import Layout
from identify.news import Progress
from identify.partialling import Partialled, at_gain
from identify.trial_sums import TrialSums, at_zeros, columns_of
from identify.vectors import Array

NOISE_PAIRS = 2
"""Pairs of draws."""
_SECONDS = 180.0
"""Of more data than this, pieces are left out [s]."""


_Products = dict[str, tuple[NDArray[np.intp], Array]]


@dataclass(frozen=True)
class ColumnNoise:
    """What noise adds to the sums of a ranking, everything else partialled out.

    Attributes
    ----------
    labels : what the columns are: noise found for others is of no use.
    shifts : row → (w,) what it adds to each column's product with the residual.
    squares : row → for each trial (k, k), what it adds to its columns' own products.
    freed : row → place of a fault → (2,) what it adds to its product with itself and with the residual, where its own
        tolerance is not partialled out (`identify.freed`).
    """

    labels: tuple[str, ...]
    shifts: Mapping[str, Array]
    squares: Mapping[str, tuple[Array, ...]]
    freed: Mapping[str, Mapping[int, Array]]

    @classmethod
    def of(
        cls, fitted: Fit, space: Partialled, sigma: Mapping[str, float], freed: Mapping[int, Freed],
        pairs: int = NOISE_PAIRS, progress: Progress | None = None,
    ) -> ColumnNoise:  # fmt: skip
        """Draw it, weighted by the rows' `sigma`; `progress` is told how many draws are done."""
        layout = space.sums.layout
        w, places = layout.width, [trial.place for trial in layout.trials]
        totals = {row: np.zeros((w, w)) for row in sigma}
        chosen, share = _chosen(fitted)
        done, total = itertools.count(1), pairs * sum(len(pieces) for pieces in chosen.values())
        drawn = (lambda: None) if progress is None else (lambda: progress(next(done), total))
        for run, pieces in chosen.items():
            for row, products in _of_run(fitted, space.sums, sigma, run, pieces, pairs, drawn).items():
                totals[row] += products / share
        left = {row: at_gain(total, space.taken, space.gain) for row, total in totals.items()}
        return cls(
            column_labels(fitted, layout),
            {row: part[:, layout.right].copy() for row, part in left.items()},
            {row: tuple(part[place, place].copy() for place in places) for row, part in left.items()},
            {row: {place: _pair(total, one) for place, one in freed.items()} for row, total in totals.items()},
        )

    def fits(self, labels: tuple[str, ...], freed: Mapping[int, Freed]) -> bool:
        """Whether it is of these columns and faults: what another run or an earlier lacet left may be of others."""
        return labels == self.labels and all(self.freed.get(row, {}).keys() == freed.keys() for row in self.shifts)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it as plain arrays, for keeping."""
        flat = {f"squares|{row}": np.concatenate([np.zeros(0), *(a.ravel() for a in every)])
                for row, every in self.squares.items()}  # fmt: skip
        sizes = [len(a) for a in next(iter(self.squares.values()), ())]
        shifts = {f"shift|{row}": a for row, a in self.shifts.items()}
        freed = {f"freed|{row}": np.array([[place, *pair] for place, pair in every.items()]).reshape(-1, 3)
                 for row, every in self.freed.items()}  # fmt: skip
        return {"labels": np.array(self.labels), "sizes": np.array(sizes, int), **shifts, **flat, **freed}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ColumnNoise:
        """What `arrays` gave."""
        sizes = arrays["sizes"].astype(int)
        ends = np.cumsum(sizes**2)
        squares: dict[str, tuple[Array, ...]] = {}
        shifts: dict[str, Array] = {}
        freed: dict[str, dict[int, Array]] = {}
        for name, values in arrays.items():
            kind, _, row = name.partition("|")
            if kind == "shift":
                shifts[row] = values.astype(float)
            elif kind == "squares":
                parts = np.split(values.astype(float), ends)
                squares[row] = tuple(part.reshape(k, k) for part, k in zip(parts, sizes, strict=False))
            elif kind == "freed":
                freed[row] = {int(line[0]): line[1:] for line in values.astype(float)}
        return cls(tuple(str(label) for label in arrays["labels"]), shifts, squares, freed)


def _pair(total: Array, fault: Freed) -> Array:
    both = fault.coefficients()
    return both[:, 0] @ total @ both


def column_labels(fitted: Fit, layout: Layout) -> tuple[str, ...]:
    """What the columns are."""
    return (*fitted.columns, *layout.labels)


def _chosen(fitted: Fit) -> tuple[dict[int, list[int]], float]:
    """Run → numbers of its pieces that are taken, of about `_SECONDS` of data in all; and the part that is of all."""
    counts = {
        (run, k): _samples(piece)
        for run in range(len(fitted.drives))
        for k, piece in enumerate(fitted.assembly.pieces_of(run))
    }
    seconds = sum(float(np.ptp(drive.recording.t)) for drive in fitted.drives)
    taken = list(counts)[:: max(1, int(seconds // _SECONDS))]
    chosen: dict[int, list[int]] = {}
    for run, k in taken:
        chosen.setdefault(run, []).append(k)
    return chosen, sum(counts[place] for place in taken) / sum(counts.values())


def _of_run(
    fitted: Fit, sums: TrialSums, sigma: Mapping[str, float], run: int, chosen: Sequence[int], pairs: int,
    drawn: Callable[[], None],
) -> dict[str, Array]:  # fmt: skip
    """Row → (w, w) products of noise in the chosen pieces of one run, its zeros eliminated."""
    layout, (_, priors, values) = sums.layout, fitted.zeros[run]
    z, w = len(priors), layout.width
    turn = np.eye(w)
    turn[: layout.model, : layout.model] = sums.turn
    side = scipy.linalg.block_diag(np.diag(priors / sums.temper), turn)
    # The right side here is the residual, from which the zeros that were found are taken already.
    further = sums.following[run].copy()
    further[:, layout.right] -= values * sums.temper / priors
    whole: dict[str, Array] = {}
    for piece in (piece for k, piece in enumerate(fitted.assembly.pieces_of(run)) if k in chosen):
        for row, (places, products) in _of_piece(fitted, layout, sigma, piece, pairs, drawn).items():
            there = whole.setdefault(row, np.zeros((z + w, z + w)))
            there[np.ix_(places, places)] += products
    return {row: at_zeros(side.T @ products @ side, further) for row, products in whole.items()}


def _of_piece(
    fitted: Fit, layout: Layout, sigma: Mapping[str, float], piece: Piece, pairs: int, drawn: Callable[[], None]
) -> _Products:
    """Row → places (a,) of the columns that are not empty and their products (a, a), zeros first, the residual last."""
    values = fitted.zeros[piece.run][2]
    z, p = len(values), layout.model
    clean = dict(columns_of(fitted, layout, piece, sigma))
    zeros = {row: block[:, :z] / sigma[row] for row, block in piece.blocks.items()}
    # The right side is the fit's own residual, so that the mean shift of a bent law meets no static load.
    for row, (columns, _) in clean.items():
        columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
    place = (piece.run,) if piece.number is None else (piece.run, piece.number)
    out: _Products = {}
    for row, (_, active) in clean.items():
        places = np.concatenate([np.arange(z), z + active]).astype(np.intp)
        out[row] = places, np.zeros((len(places), len(places)))
    for draw in range(pairs):
        for sign in (1, -1):
            noisy = piece.drive.noisy(draw, sign, [2003, *place, draw], loads=True)
            for row, (columns, active) in columns_of(fitted, layout, piece, sigma, noisy):
                columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
                before, there = clean[row]
                # A column without any entry on this run may have some with more noise.
                columns = columns[:, np.isin(active, there)]
                products = out[row][1]
                products[z:, z:] += (columns.T @ columns - before.T @ before) / (2 * pairs)
                across = zeros[row].T @ (columns - before) / (2 * pairs)
                products[:z, z:] += across
                products[z:, :z] += across.T
            noisy.forget_motion()
        drawn()
    piece.drive.forget_noisy(loads=True)
    return out


def _samples(piece: Piece) -> int:
    return sum(len(right) for right in piece.right.values())
