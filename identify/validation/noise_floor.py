"""Noise floor: the residual that sensor noise alone causes, by Monte Carlo through filters, kinematics and rows.

The noise of one piece of a run says nothing of that of the next. So a long run needs fewer draws of each piece than of
the whole: combined in several orders, they are as many draws of sums over the run as are asked for.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.set_aside import ArraysOnDisk, DiskSpace, JoinedOnDisk
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.wls import Fit

DEFAULT_DRAWS = 199
"""Simulated draws behind a ranking; the smallest possible p is 1 ÷ 200."""
LEAST_DRAWS = 19
"""Least number of simulated draws with which a p of 0.05 can be reached."""
SCORE_DRAWS = 20
"""Simulated draws behind the floor of a score; its RMS is then known to about 1 %."""
LEAST_OF_PIECE = 40
"""Least number of draws of a piece of a long run: an effect may act in one alone, and p is then 1 ÷ 41 or more."""


@dataclass(frozen=True)
class RunDraws:
    """Simulated noise of one run, D draws.

    Attributes
    ----------
    series : row → (d, n) noise after filter and decimation [N or N·m], d ≤ D, the pieces of the run end to end; of a
        run in several pieces on disk.
    ends : row → (P,) index one past the last sample of each of its P pieces.
    choice : (P, D) which of the d draws of a piece is part of which of the D.
    """

    series: Mapping[Row, Array]
    ends: Mapping[Row, NDArray[np.intp]]
    choice: NDArray[np.intp]

    @classmethod
    def of(cls, series: Mapping[Row, Array]) -> RunDraws:
        """Draws (D, n) of a run in one piece."""
        count = next(iter(series.values())).shape[0]
        ends = {row: np.array([a.shape[1]], np.intp) for row, a in series.items()}
        return cls(series, ends, np.arange(count, dtype=np.intp)[None])

    @classmethod
    def none(cls, samples: Mapping[Row, int]) -> RunDraws:
        """No draws, of a run with so many samples in each row."""
        return cls.of({row: np.zeros((0, n)) for row, n in samples.items()})

    @classmethod
    def joined(cls, pieces: Sequence[Mapping[Row, Array]], count: int, rng: np.random.Generator) -> RunDraws:
        """`count` draws from those of the pieces, row → (d, n) each; every draw of a piece is used equally often."""
        drawn = next(piece[row].shape[0] for piece in pieces for row in piece)
        if len(pieces) == 1 and drawn == count:
            return cls.of(pieces[0])
        rows = dict.fromkeys(row for piece in pieces for row in piece)
        empty = np.zeros((drawn, 0))
        space = DiskSpace()
        parts = [piece if isinstance(piece, ArraysOnDisk) else space.put(piece) for piece in pieces]
        return cls(
            JoinedOnDisk(parts),
            {row: np.cumsum([piece.get(row, empty).shape[1] for piece in pieces]) for row in rows},
            np.stack([rng.permutation(np.arange(count) % drawn) for _ in pieces]),
        )

    @property
    def count(self) -> int:
        """D, the number of draws."""
        return self.choice.shape[1]

    @property
    def drawn(self) -> int:
        """d, the number of draws of each piece."""
        return next(iter(self.series.values())).shape[0]

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows drawn."""
        return tuple(self.series)

    def of_type(self, number: type[np.floating[Any]]) -> RunDraws:
        """The same in another precision."""
        return replace(self, series={row: a.astype(number) for row, a in self.series.items()})

    def set_aside(self) -> RunDraws:
        """The same with the draws of a run in several pieces on disk, in double precision."""
        pieces = len(self.choice)
        if pieces == 1:
            return self
        space = DiskSpace()
        parts = [
            space.put({row: a[:, self._start(row, k) : self.ends[row][k]] for row, a in self.series.items()})
            for k in range(pieces)
        ]
        return replace(self, series=JoinedOnDisk(parts))

    def _start(self, row: Row, place: int) -> int:
        """Index of the first sample of a piece."""
        return int(self.ends[row][place - 1]) if place else 0

    def whole(self, row: Row) -> Array:
        """(D, n) draws of a row."""
        if len(self.choice) == 1 and self.drawn == self.count:
            return self.series[row]
        return next(self.some_at_once(row, self.count))

    def some_at_once(self, row: Row, count: int) -> Iterator[Array]:
        """`whole` in parts of at most `count` draws."""
        series, starts = self.series[row], np.concatenate([[0], self.ends[row][:-1]])
        for first in range(0, self.count, count):
            parts = zip(self.choice[:, first : first + count], starts, self.ends[row], strict=True)
            yield np.concatenate([series[choice, start:end] for choice, start, end in parts], axis=1)

    def piece(self, row: Row, start: int, end: int) -> tuple[Array, NDArray[np.intp]]:
        """Draws (d, m) of a row's samples from `start` to `end`, of one piece, and their choice (D,)."""
        place = int(np.searchsorted(self.ends[row], start, side="right"))
        if end > self.ends[row][place]:
            raise ValueError(f"samples {start} to {end} of {row} are not of one piece")
        if not isinstance(self.series, JoinedOnDisk):
            return self.series[row][:, start:end], self.choice[place]
        first = self._start(row, place)
        return self.series.parts[place][row][:, start - first : end - first], self.choice[place]


def draws_of_piece(draws: int, pieces: int) -> int:
    """Number of draws of each piece of a run, for `draws` of the run in so many `pieces`."""
    return draws if pieces == 1 else min(draws, max(LEAST_OF_PIECE, math.ceil(draws / pieces)))


@dataclass(frozen=True)
class NoiseFloor:
    """Simulated residuals of a model that lacks nothing.

    Attributes
    ----------
    draws : for each run, residuals after filter and decimation from the channels' noise alone.
    by_run : for each run, row → RMS of its draws [N or N·m].
    sigma : row → RMS over all runs: the weights of the ranking.
    count : number of draws.
    """

    draws: tuple[RunDraws, ...]
    by_run: tuple[Mapping[Row, float], ...]
    sigma: Mapping[Row, float]
    count: int

    @classmethod
    def of(cls, draws: Sequence[RunDraws]) -> NoiseFloor:
        """The noise floor of given draws."""
        rows = dict.fromkeys(row for run in draws for row in run.rows)

        def every(row: Row) -> Array:
            return np.concatenate([run.series[row].ravel() for run in draws if row in run.series])

        return cls(
            tuple(draws),
            tuple({row: float(np.sqrt(np.mean(a**2))) for row, a in run.series.items()} for run in draws),
            {row: float(np.sqrt(np.mean(every(row) ** 2))) for row in rows},
            draws[0].count,
        )

    def redrawn(self, fitted: Fit, physics: Array | None = None) -> NoiseFloor:
        """The noise floor of another fit, with as many draws; `physics` (p,): values of its physics, if not its own."""
        return floor_of(fitted, self.count) if physics is None else floor_at(fitted, physics, self.count)

    def of_one_unit(self, rows: Sequence[Row]) -> list[Row]:
        """The rows of `rows` that have the unit of the first."""
        return [row for row in rows if row.unit == rows[0].unit]

    def without_draws(self) -> NoiseFloor:
        """The floor's levels without its draws, for storage."""
        none = (RunDraws.none({row: a.shape[1] for row, a in run.series.items()}) for run in self.draws)
        return replace(self, draws=tuple(none), count=0)


PiecesOfRun = Iterable[tuple[PreparedRun, Sensitivity]]
"""The pieces of a run, each with the sensitivity of its residual to the channels."""


def simulate_floor(
    runs: Sequence[PreparedRun], pieces: Callable[[int], PiecesOfRun], draws: int, seed: int = 0,
    progress: Progress = silent, of_piece: int | None = None,
) -> NoiseFloor:  # fmt: skip
    """The noise floor of runs, `draws` times drawn; the pieces of a long run less often (`RunDraws`).

    `pieces` : gives those of the run of an index; `of_piece` : number of draws of each piece, where these runs are some
    of many.
    """
    out: list[RunDraws] = []
    often = [of_piece or draws_of_piece(draws, run.piece_count) for run in runs]
    done, total = itertools.count(1), sum(n * run.piece_count for n, run in zip(often, runs, strict=True))
    for number, count in enumerate(often):
        found: list[Mapping[Row, Array]] = []
        space = DiskSpace()
        for place, (piece, sensitivity) in enumerate(pieces(number)):
            rng = np.random.default_rng([seed, number, place] if place else [seed, number])
            parts: dict[Row, list[Array]] = {row: [] for row in piece.rows}
            for drawn in sensitivity.noises(rng, count):
                for row, series in piece.decimated(drawn).items():
                    parts[row].append(series)
                for _ in next(iter(drawn.values()), ()):
                    progress(Step(Stage.NOISE_FLOOR, next(done), total))
            whole = {row: np.concatenate(series) for row, series in parts.items()}
            found.append(space.put(whole) if runs[number].is_long else whole)
        out.append(RunDraws.joined(found, draws, np.random.default_rng([seed, number, 0, 29])))
    return NoiseFloor.of(out)


def floor_at(fitted: Fit, physics: Array, draws: int, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit's runs at other values `physics` (p,) of its physics' parameters."""

    def pieces(run: int) -> PiecesOfRun:
        return fitted.runs[run].sensitive_pieces(fitted.model.physics, physics)

    return simulate_floor(fitted.runs, pieces, draws, seed, progress)


def floor_of(fitted: Fit, draws: int = DEFAULT_DRAWS, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit on its own runs."""
    return simulate_floor(fitted.runs, fitted.sensitive_pieces, draws, seed, progress)
