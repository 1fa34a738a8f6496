"""Noise floor: the residual that sensor noise alone causes, by Monte Carlo through filters, kinematics and rows."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

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


@dataclass(frozen=True)
class NoiseFloor:
    """Simulated residuals of a model that lacks nothing.

    Attributes
    ----------
    draws : for each run, row → (D, n) residual after filter and decimation, from the channels' noise alone.
    by_run : for each run, row → RMS of its draws [N or N·m].
    sigma : row → RMS over all runs: the weights of the ranking.
    """

    draws: tuple[Mapping[Row, Array], ...]
    by_run: tuple[Mapping[Row, float], ...]
    sigma: Mapping[Row, float]

    @classmethod
    def of(cls, draws: Sequence[Mapping[Row, Array]]) -> NoiseFloor:
        """The noise floor of given draws, for each run row → (D, n)."""
        rows = dict.fromkeys(row for part in draws for row in part)
        every = {row: np.concatenate([part[row].ravel() for part in draws if row in part]) for row in rows}
        return cls(
            tuple(draws),
            tuple({row: float(np.sqrt(np.mean(a**2))) for row, a in part.items()} for part in draws),
            {row: float(np.sqrt(np.mean(a**2))) for row, a in every.items()},
        )

    @property
    def count(self) -> int:
        """Number of draws."""
        return next(iter(self.draws[0].values())).shape[0]

    def redrawn(self, fitted: Fit, physics: Array | None = None) -> NoiseFloor:
        """The noise floor of another fit, with as many draws; `physics` (p,): values of its physics, if not its own."""
        return floor_of(fitted, self.count) if physics is None else floor_at(fitted, physics, self.count)

    def of_one_unit(self, rows: Sequence[Row]) -> list[Row]:
        """The rows of `rows` that have the unit of the first."""
        return [row for row in rows if row.unit == rows[0].unit]

    def without_draws(self) -> NoiseFloor:
        """The floor's levels without its draws, for storage."""
        return replace(self, draws=tuple({row: a[:0] for row, a in part.items()} for part in self.draws))


PiecesOfRun = Iterable[tuple[PreparedRun, Sensitivity]]
"""The pieces of a run, each with the sensitivity of its residual to the channels."""


def simulate_floor(
    runs: Sequence[PreparedRun], pieces: Callable[[int], PiecesOfRun], draws: int, seed: int = 0,
    progress: Progress = silent,
) -> NoiseFloor:  # fmt: skip
    """The noise floor of runs, `draws` times drawn; each piece of a long run has draws of its own.

    `pieces` : gives those of the run of an index.
    """
    out: list[dict[Row, Array]] = []
    done, total = itertools.count(1), draws * sum(run.piece_count for run in runs)
    for number in range(len(runs)):
        found: dict[Row, list[Array]] = {}
        for place, (piece, sensitivity) in enumerate(pieces(number)):
            rng = np.random.default_rng([seed, number, place] if place else [seed, number])
            parts: dict[Row, list[Array]] = {row: [] for row in piece.rows}
            for _ in range(draws):
                for row, series in piece.decimated(sensitivity.noise(rng)).items():
                    parts[row].append(series)
                progress(Step(Stage.NOISE_FLOOR, next(done), total))
            for row, series in parts.items():
                found.setdefault(row, []).append(np.stack(series))
        out.append({row: np.concatenate(series, axis=1) for row, series in found.items()})
    return NoiseFloor.of(out)


def floor_at(fitted: Fit, physics: Array, draws: int, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit's runs at other values `physics` (p,) of its physics' parameters."""

    def pieces(run: int) -> PiecesOfRun:
        return fitted.runs[run].sensitive_pieces(fitted.model.physics, physics)

    return simulate_floor(fitted.runs, pieces, draws, seed, progress)


def floor_of(fitted: Fit, draws: int = DEFAULT_DRAWS, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit on its own runs."""
    return simulate_floor(fitted.runs, fitted.sensitive_pieces, draws, seed, progress)
