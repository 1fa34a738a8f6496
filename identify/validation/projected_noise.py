"""Simulated residuals of a model that lacks nothing, after the projection of the fit onto its regressors.

The noise floor's draws are the channels' noise in Y − W θ. The residual of a fit differs: it is smaller by the part
of the noise that the parameters and each run's zeros absorb, and larger by sensor gains and latencies, which are known
to the sensor sheet's tolerance only. Both are applied to every draw, so that it can be compared with a residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from lacet.daq.set_aside import DiskSpace, JoinedOnDisk
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.noise_floor import NoiseFloor

Draws = tuple[Mapping[Row, Array], ...]
"""Simulated residuals: for each run, row → (D, n) [N or N·m]."""


def refitted_draws(fitted: Fit, floor: NoiseFloor, sheet: bool = True, seed: int = 0) -> Draws:
    """The draws of a fit's noise floor after the same weighted fit, as many as every piece of a run has of its own.

    `sheet` : draw the sensor sheet's gains and latencies too, one value for all runs of a draw.
    """
    noise = [_NoisyPieces.of(fitted, floor, run, sheet, seed) for run in range(len(fitted.runs))]
    count = noise[0].count
    solved: list[tuple[Array, Array, int]] = []
    lower: list[Array] = []
    right: list[Array] = []
    for run, zeros in enumerate(fitted.zeros):
        z = len(zeros[0])
        factor, c = _triangle(noise[run], fitted.sigma, zeros[1])
        solved.append((factor, c, z))
        lower.append(factor[z:, z:])
        right.append(c[z:])
    known = fitted.equations.known
    lower.append(known[:, : lower[0].shape[1]])
    right.append(np.zeros((len(known), count)))
    A = np.concatenate(lower)
    lengths = np.linalg.norm(A, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    theta = np.asarray(np.linalg.lstsq(A / lengths, np.concatenate(right), rcond=None)[0], float) / lengths[:, None]
    out: list[Mapping[Row, Array]] = []
    for run, (factor, c, z) in enumerate(solved):
        right_side = c[:z] - factor[:z, z:] @ theta
        own = np.asarray(scipy.linalg.solve_triangular(factor[:z, :z], right_side), float) if z else right_side
        x = np.concatenate([own, theta])
        parts = (
            {row: draws[row] - (block @ x).T for row, block in piece.blocks.items()} for piece, draws in noise[run]
        )
        if fitted.runs[run].is_long:
            space = DiskSpace()
            out.append(JoinedOnDisk([space.put(part) for part in parts]))
        else:
            out.append(next(parts))
    return tuple(out)


@dataclass(frozen=True)
class _NoisyPieces:
    """The pieces of a run of a fit, each with `count` simulated residuals: row → (count, n); of a long run on disk."""

    fitted: Fit
    run: int
    count: int
    noises: tuple[Mapping[Row, Array], ...]

    @classmethod
    def of(cls, fitted: Fit, floor: NoiseFloor, run: int, sheet: bool, seed: int) -> _NoisyPieces:
        """The pieces with as many of the floor's draws as every piece of any run has, and the sheet's tolerances."""
        count, space, drawn = min(one.drawn for one in floor.draws), DiskSpace(), floor.draws[run]
        start = dict.fromkeys(drawn.rows, 0)
        noises: list[Mapping[Row, Array]] = []
        for piece in fitted.assembly.pieces_of(run):
            own: dict[Row, Array] = {}
            for row, block in piece.blocks.items():
                end = start[row] + len(block)
                own[row], start[row] = drawn.piece(row, start[row], end)[0][:count], end
            moved = _with_tolerances(fitted, piece, own, seed) if sheet else own
            noises.append(moved if piece.number is None else space.put(moved))
        return cls(fitted, run, count, tuple(noises))

    def __iter__(self) -> Iterator[tuple[Piece, Mapping[Row, Array]]]:
        # Mapped, so that a piece's arrays are gone before the next piece is read.
        return zip(self.fitted.assembly.pieces_of(self.run), self.noises, strict=True)


def _with_tolerances(fitted: Fit, piece: Piece, draws: Mapping[Row, Array], seed: int) -> dict[Row, Array]:
    """Row → (D, n): a piece's part of the floor's draws, with the sensor sheet's tolerances drawn too."""
    out = {row: series.copy() for row, series in draws.items()}
    if piece.sensitivity is None:
        return out
    for name, response in fitted.assembly.sheet_responses(piece).items():
        # Seeded by the entry's name, so that a run without one sensor draws the same values of the others.
        rng = np.random.default_rng([seed, 7, *"/".join(map(str, name)).encode()])
        sizes = rng.standard_normal((len(next(iter(draws.values()))), 1))
        for row, series in response.items():
            if row in out:
                out[row] += sizes * series
    return out


def _triangle(noise: _NoisyPieces, sigma: Mapping[Row, float], priors: Array) -> tuple[Array, Array]:
    """R factor of a run's weighted columns, zeros first, their priors included, and Qᵀ of the draws."""
    z = len(priors)
    factor, c = np.zeros((z, 0)), np.zeros((z, noise.count))
    for piece, draws in noise:
        if not factor.shape[1]:
            factor = np.zeros((z, next(iter(piece.blocks.values())).shape[1]))
            factor[:, :z] = np.diag(1.0 / priors)
        weight = {row: 1.0 if piece.weights is None else piece.weights[row][:, None] for row in piece.blocks}
        A = np.concatenate([factor, *(weight[row] * block / sigma[row] for row, block in piece.blocks.items())])
        b = np.concatenate([c, *(weight[row] * draws[row].T / sigma[row] for row in piece.blocks)])
        lengths = np.linalg.norm(A, axis=0)
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        q, r = np.linalg.qr(A / lengths)
        factor, c = np.asarray(r * lengths, float), np.asarray(q.T @ b, float)
    return factor, c
