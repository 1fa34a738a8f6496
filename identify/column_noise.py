"""What noise in the columns themselves adds to the sums that a ranking is made of.

A column made of noisy channels is correlated with the residual, which the same noise is in: without this, a law that
follows a rate sensor's noise looks like an effect, and so does the scale of a noisy sensor. One draw of noise added and
the same draw subtracted leave the products of errors and the mean shift of bent laws, as `identify.noise_bias` has it
for the fit. It depends on the motion and hardly on the fit, so it is found once and kept with the noise floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from identify.assembly import Piece
from identify.fit import Fit
from identify.floor import Progress
from identify.layout import Layout
from identify.trial_sums import TrialSums, at_zeros, columns_of
from identify.vectors import Array

NOISE_PAIRS = 2
"""Pairs of draws."""
_SECONDS = 180.0
"""Of more data than this, pieces are left out [s]."""


@dataclass(frozen=True)
class ColumnNoise:
    """Products of noise, run by run.

    `labels` : what the columns are; `runs` : for each run (z + w, z + w), its zeros first, the measured side last.
    """

    labels: tuple[str, ...]
    runs: tuple[Array, ...]

    @classmethod
    def of(
        cls, fitted: Fit, layout: Layout, sigma: Mapping[str, float], pairs: int = NOISE_PAIRS,
        progress: Progress | None = None,
    ) -> ColumnNoise:  # fmt: skip
        """Draw it, weighted by the rows' `sigma`."""
        seconds = sum(float(np.ptp(drive.recording.t)) for drive in fitted.drives)
        every = max(1, int(seconds // _SECONDS))
        runs: list[Array] = []
        for run in range(len(fitted.drives)):
            pieces = list(fitted.assembly.pieces_of(run))
            taken = pieces[::every]
            share = sum(_samples(piece) for piece in taken) / sum(_samples(piece) for piece in pieces)
            parts = [_of_piece(fitted, layout, sigma, piece, pairs) for piece in taken]
            runs.append(np.sum(parts, axis=0) / share)
            if progress is not None:
                progress(run + 1, len(fitted.drives))
        return cls(column_labels(fitted, layout), tuple(runs))

    def seen_by(self, fitted: Fit, sums: TrialSums) -> Array:
        """(w, w) what it adds to `TrialSums.total`."""
        layout, priors = sums.layout, [zeros[1] / sums.temper for zeros in fitted.zeros]
        turn = np.eye(layout.width)
        turn[: layout.model, : layout.model] = sums.turn
        turn[: layout.model, layout.right] = -fitted.solution
        out = np.zeros((layout.width, layout.width))
        for prior, following, products in zip(priors, sums.following, self.runs, strict=True):
            whole = scipy.linalg.block_diag(np.diag(prior), turn)
            out += at_zeros(whole.T @ products @ whole, following)
        return out


def column_labels(fitted: Fit, layout: Layout) -> tuple[str, ...]:
    """What the columns are: noise found for others is of no use."""
    zeros = (name for names, _, _ in fitted.zeros for name in names)
    return (*zeros, *fitted.columns, *layout.labels)


def _of_piece(fitted: Fit, layout: Layout, sigma: Mapping[str, float], piece: Piece, pairs: int) -> Array:
    z = next(iter(piece.blocks.values())).shape[1] - layout.model
    out = np.zeros((z + layout.width, z + layout.width))
    clean = {row: columns for row, (columns, _) in columns_of(fitted, layout, piece, sigma)}
    zeros = {row: block[:, :z] / sigma[row] for row, block in piece.blocks.items()}
    place = (piece.run,) if piece.number is None else (piece.run, piece.number)
    for draw in range(pairs):
        for sign in (1, -1):
            noisy = piece.drive.noisy(draw, sign, [2003, *place, draw], loads=True)
            for row, (columns, active) in columns_of(fitted, layout, piece, sigma, noisy):
                at = z + active
                out[np.ix_(at, at)] += columns.T @ columns - clean[row].T @ clean[row]
                across = zeros[row].T @ (columns - clean[row])
                out[np.ix_(np.arange(z), at)] += across
                out[np.ix_(at, np.arange(z))] += across.T
            noisy.forget_motion()
    piece.drive.forget_noisy(loads=True)
    return out / (2 * pairs)


def _samples(piece: Piece) -> int:
    return sum(len(right) for right in piece.right.values())
