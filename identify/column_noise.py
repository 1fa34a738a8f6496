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
from numpy.typing import NDArray

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

    `labels` : what the columns are; `runs` : for each run, row → places (a,) of the columns that are not empty and
    their products (a, a), its zeros first, the residual last.
    """

    labels: tuple[str, ...]
    runs: tuple[Mapping[str, tuple[NDArray[np.intp], Array]], ...]

    @classmethod
    def of(
        cls, fitted: Fit, layout: Layout, sigma: Mapping[str, float], pairs: int = NOISE_PAIRS,
        progress: Progress | None = None,
    ) -> ColumnNoise:  # fmt: skip
        """Draw it, weighted by the rows' `sigma`."""
        seconds = sum(float(np.ptp(drive.recording.t)) for drive in fitted.drives)
        every = max(1, int(seconds // _SECONDS))
        runs: list[dict[str, tuple[NDArray[np.intp], Array]]] = []
        for run in range(len(fitted.drives)):
            pieces = list(fitted.assembly.pieces_of(run))
            taken = pieces[::every]
            share = sum(_samples(piece) for piece in taken) / sum(_samples(piece) for piece in pieces)
            found: dict[str, tuple[NDArray[np.intp], Array]] = {}
            for piece in taken:
                for row, (places, products) in _of_piece(fitted, layout, sigma, piece, pairs).items():
                    found[row] = places, products / share + (found[row][1] if row in found else 0.0)
            runs.append(found)
            if progress is not None:
                progress(run + 1, len(fitted.drives))
        return cls(column_labels(fitted, layout), tuple(runs))

    def seen_by(self, fitted: Fit, sums: TrialSums, louder: Mapping[str, float]) -> Array:
        """(w, w) what it adds to `TrialSums.total` where the noise of rows is `louder` than the sheet's by a factor."""
        layout, w = sums.layout, sums.layout.width
        turn = np.eye(w)
        turn[: layout.model, : layout.model] = sums.turn
        out = np.zeros((w, w))
        for (_, priors, values), following, rows in zip(fitted.zeros, sums.following, self.runs, strict=True):
            z = len(priors)
            # The right side here is the residual, from which the zeros that were found are taken already.
            further = following.copy()
            further[:, layout.right] -= values * sums.temper / priors
            whole = np.zeros((z + w, z + w))
            for row, (places, products) in rows.items():
                whole[np.ix_(places, places)] += louder.get(row, 1.0) ** 2 * products
            side = scipy.linalg.block_diag(np.diag(priors / sums.temper), turn)
            out += at_zeros(side.T @ whole @ side, further)
        return out


def column_labels(fitted: Fit, layout: Layout) -> tuple[str, ...]:
    """What the columns are: noise found for others is of no use."""
    zeros = (name for names, _, _ in fitted.zeros for name in names)
    return (*zeros, *fitted.columns, *layout.labels)


def _of_piece(
    fitted: Fit, layout: Layout, sigma: Mapping[str, float], piece: Piece, pairs: int
) -> dict[str, tuple[NDArray[np.intp], Array]]:
    values = fitted.zeros[piece.run][2]
    z, p = len(values), layout.model
    clean = dict(columns_of(fitted, layout, piece, sigma))
    zeros = {row: block[:, :z] / sigma[row] for row, block in piece.blocks.items()}
    # The right side is the fit's own residual, so that the mean shift of a bent law meets no static load.
    for row, (columns, _) in clean.items():
        columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
    place = (piece.run,) if piece.number is None else (piece.run, piece.number)
    out: dict[str, tuple[NDArray[np.intp], Array]] = {}
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
    piece.drive.forget_noisy(loads=True)
    return out


def _samples(piece: Piece) -> int:
    return sum(len(right) for right in piece.right.values())
