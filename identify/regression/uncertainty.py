"""Uncertainty of estimates, three ways: as if residuals were independent (the paper's sxr %), from residuals that are
correlated in time and across rows (HAC), and by drawing blocks of the runs again (bootstrap); and what the sensor
sheet's gains and latencies add, which no residual shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Assembly, Piece
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, Key, added
from lacet.identify.regression.sums.tree import merged
from lacet.identify.regression.tolerances import SheetEntry


def clustered_scores(
    rows: Mapping[Key, tuple[Array, Array, float]], instants: Mapping[Key, NDArray[np.intp]], count: int
) -> Array:
    """Scores of the instants, g_t = Σ_rows W_tᵀ r_t / σ², (count, p): the sum over the rows of each instant.

    Parameters
    ----------
    rows : by row, (n, p) columns, (n,) residual, σ.
    instants : by row, (n,) index of each sample's instant.
    """
    width = next(iter(rows.values()))[0].shape[1]
    scores = np.zeros((count, width))
    for row, (W, r, sigma) in rows.items():
        scores[instants[row]] += W * (r / sigma**2)[:, None]
    return scores


def bandwidth(length: int) -> int:
    """Number of lags for so many instants after Newey and West (1994): 4 (T/100)^(2/9), at least 4, doubled because
    filtered residuals are coloured up to the fit's cut-off.
    """
    return min(length - 1, 2 * int(np.ceil(4.0 * (length / 100.0) ** (2.0 / 9.0))))


def hac(scores: Array) -> Array:
    """Driscoll–Kraay covariance of the summed scores with Bartlett weights, (p, p), over `bandwidth` lags."""
    length = scores.shape[0]
    lags = range(bandwidth(length) + 1)
    return bartlett(np.stack([scores[lag:].T @ scores[: length - lag] for lag in lags]))


def bartlett(by_lag: Array) -> Array:
    """(p, p) covariance of summed scores from the sums of their products by lag, (lags + 1, p, p)."""
    out = by_lag[0].copy()
    for lag in range(1, len(by_lag)):
        out += (1.0 - lag / len(by_lag)) * (by_lag[lag] + by_lag[lag].T)
    # Bartlett's weights keep it positive; what rounding leaves below zero is cut.
    return 0.5 * (out + out.T)


@dataclass(frozen=True)
class Spread:
    """Contributions of runs to the covariance of an estimate.

    Attributes
    ----------
    scores : (p, p) covariance of the summed scores, serial and cross-row (Driscoll–Kraay).
    sheet : gain or latency → (p,) change of the normal equations' right side by one tolerance of it.
    """

    scores: Array
    sheet: Mapping[SheetEntry, Array]

    @classmethod
    def merged(cls, parts: Sequence[Spread]) -> Spread:
        """The spread of several runs together: the sum of theirs."""
        entries = dict.fromkeys(entry for part in parts for entry in part.sheet)
        sheet = {entry: added([part.sheet[entry] for part in parts if entry in part.sheet]) for entry in entries}
        return cls(added([part.scores for part in parts]), sheet)


def spread_of(
    assembly: Assembly, equations: Equations, x: Array, zeros: Sequence[Array], sigma: Mapping[Row, float], sheet: bool
) -> tuple[Spread, tuple[Mapping[Row, Array], ...]]:
    """Spread of all runs at the estimate `x` and the runs' zeros, and for each run the residual row → (n,).

    The residual is Y − W x − zeros. The prior information does not contribute to this spread. `sheet` : with the
    responses to the sensor sheet's gains and latencies, for which the assembly must have sensitivities.
    """
    residual: list[Mapping[Row, Array]] = []

    def spreads() -> Iterator[Spread]:
        for number in range(len(assembly.runs)):
            spread, remainder = _run_spread(assembly, equations, x, zeros[number], sigma, sheet, number)
            residual.append(remainder)
            yield spread

    return merged(spreads(), Spread.merged), tuple(residual)


def _run_spread(
    assembly: Assembly, equations: Equations, x: Array, zeros: Array, sigma: Mapping[Row, float], sheet: bool,
    number: int,
) -> tuple[Spread, Mapping[Row, Array]]:  # fmt: skip
    """The spread of one run, and its residual."""
    run = equations.runs[number]
    gain = run.following(sigma)[0]
    residual: dict[Row, list[Array]] = {}
    scores = np.zeros((_comb(assembly.runs[number]), equations.p))
    systematic: dict[SheetEntry, Array] = {}
    for piece in assembly.pieces_of(number):
        columns: dict[Row, Array] = {}
        for row, block in piece.blocks.items():
            left = piece.right[row] - block @ np.concatenate([zeros, x])
            residual.setdefault(row, []).append(left)
            columns[row] = effective(piece, row, gain) / sigma[row] ** 2
            scores[piece.instants[row]] += columns[row] * left[:, None]
        if sheet:
            for name, response in assembly.sheet_responses(piece).items():
                pushed = [columns[row].T @ series for row, series in response.items() if row in columns]
                if pushed:
                    systematic[name] = systematic.get(name, np.zeros(equations.p)) + np.sum(pushed, axis=0)
    meat = hac(scores)
    if gain.size:
        following = gain / run.priors[:, None]
        meat = following.T @ following + meat
    return Spread(meat, systematic), {row: np.concatenate(parts) for row, parts in residual.items()}


def at_least(covariance: Array, other: Array) -> Array:
    """Covariance (p, p) with each σ raised to that of another covariance where it is smaller; correlations are kept.

    Least squares makes the sum of the scores zero, so that HAC sees too little of what is slow, such as a static load:
    of the two σ the larger one holds the truth as often as it says (docs/benchmarks/coverage.md).
    """
    scale = np.sqrt(np.maximum(1.0, np.diag(other) / np.maximum(np.diag(covariance), 1e-300)))
    return covariance * np.outer(scale, scale)


def effective(piece: Piece, row: Row, gain: Array) -> Array:
    """(n, p) columns of a row with the run's zeros eliminated by their `gain`, times the samples' weights."""
    block, z = piece.blocks[row], gain.shape[0]
    out = block[:, z:] - block[:, :z] @ gain if z else block
    return out if piece.weights is None else out * piece.weights[row][:, None] ** 2


def _comb(run: PreparedRun) -> int:
    recording = run.recording
    return recording.t.size // recording.filters.step + 1


BLOCK = 2.0
"""Length of a block that counts as one observation: residuals are correlated within it [s]."""
_BLOCK_UNITS = 4
SUB_BLOCK = BLOCK / _BLOCK_UNITS
"""Shortest unit that the block bootstrap moves [s]."""
_MOST_UNITS = 400
_TOGETHER = 50
"""Number of bootstrap draws whose normal matrices are made at once: they stay in the cache."""


def block_bootstrap(
    assembly: Assembly, equations: Equations, sigma: Mapping[Row, float], draws: int = 499, seed: int = 0
) -> Array:
    """Bootstrap estimates (draws, p) from runs resampled in moving blocks (Künsch 1989).

    Blocks are about 2 s, longer for long runs; the right sides of the priors are drawn as well, the weights are kept.
    NaN for nearly exact data, where rounding makes the normal equations singular.
    """
    rng = np.random.default_rng([seed, 1989])
    units = _units(assembly, equations, sigma)
    total = np.zeros((draws, equations.p, equations.p)) + equations.known.T @ equations.known
    right = rng.standard_normal((draws, len(equations.known))) @ equations.known
    for run, unit in zip(equations.runs, units, strict=True):
        count, z = len(unit), len(run.zeros)
        if count == 0:  # dead data: nothing to draw
            continue
        length = min(_BLOCK_UNITS, count)
        starts = rng.integers(0, count, (draws, -(-count // length)))
        places = (starts[:, :, None] + np.arange(length)) % count  # around the end, so that all units count alike
        times = np.zeros((draws, count))
        np.add.at(times, (np.arange(draws)[:, None], places.reshape(draws, -1)[:, :count]), 1.0)
        ends = rng.standard_normal((draws, z)) / run.priors
        for start in range(0, draws, _TOGETHER):
            some = slice(start, start + _TOGETHER)
            of_zeros = np.tensordot(times[some], unit[:, :z], 1)
            of_zeros[:, range(z), range(z)] += 1.0 / run.priors**2
            of_zeros[:, :, -1] += ends[some]
            gain = np.asarray(np.linalg.solve(of_zeros[:, :, :z], of_zeros[:, :, z:]), float)
            left = np.tensordot(times[some], unit[:, z:-1, z:], 1) - of_zeros[:, :, z:-1].transpose(0, 2, 1) @ gain
            total[some] += left[..., :-1]
            right[some] += left[..., -1]
    diagonal = np.diagonal(total, axis1=1, axis2=2)
    if not np.all(diagonal > 0.0):  # data without noise: the zeros take all there is
        return np.full(right.shape, np.nan)
    lengths = np.sqrt(diagonal)
    scaled = total / lengths[:, :, None] / lengths[:, None, :]
    return np.asarray(np.linalg.solve(scaled, (right / lengths)[..., None])[..., 0], float) / lengths


def _units(assembly: Assembly, equations: Equations, sigma: Mapping[Row, float]) -> list[Array]:
    """For each run (units, k, k) weighted normal matrices of its units, of ``[zeros | parameters | right side]``."""
    steps = [drive.recording.filters.step / drive.recording.filters.rate for drive in assembly.runs]
    seconds = sum(_comb(drive) * step for drive, step in zip(assembly.runs, steps, strict=True))
    unit = max(SUB_BLOCK, seconds / _MOST_UNITS)
    per_unit = [max(1, round(unit / step)) for step in steps]
    out = [
        np.zeros((-(-_comb(drive) // n), *(len(run.zeros) + equations.p + 1,) * 2))
        for drive, n, run in zip(assembly.runs, per_unit, equations.runs, strict=True)
    ]
    for piece in assembly.pieces():
        for row, block in piece.blocks.items():
            stacked = np.column_stack([block, piece.right[row]]) / sigma[row]
            if piece.weights is not None:
                stacked = stacked * piece.weights[row][:, None]
            unit_of = piece.instants[row] // per_unit[piece.run]
            active = np.flatnonzero(np.any(stacked != 0.0, axis=0))
            square = np.ix_(active, active)
            for number in np.unique(unit_of):
                part = stacked[unit_of == number][:, active]
                out[piece.run][number][square] += part.T @ part
    return [part[np.any(part[:, -1:, :] != 0.0, axis=(1, 2))] for part in out]
