"""The noise floor: what the sensor sheet alone does to the residual, simulated through the whole pipeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.wls import Fit


@dataclass(frozen=True)
class NoiseFloor:
    """Simulated residuals of a model that lacks nothing.

    Attributes
    ----------
    draws : for each drive, row → (D, n) residual after filter and decimation, from the channels' noise alone.
    by_drive : for each drive, row → its RMS [N or N·m].
    sigma : row → RMS over all drives: the weights of the ranking.
    """

    draws: tuple[Mapping[str, Array], ...]
    by_drive: tuple[Mapping[str, float], ...]
    sigma: Mapping[str, float]

    @classmethod
    def of(cls, draws: Sequence[Mapping[str, Array]]) -> NoiseFloor:
        """A floor from its draws, for each drive row → (D, n)."""
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

    def without_draws(self) -> NoiseFloor:
        """The same levels alone."""
        return replace(self, draws=tuple({row: a[:0] for row, a in part.items()} for part in self.draws))


def simulate_floor(
    drives: Sequence[Drive], sensitivities: Sequence[Sensitivity], draws: int, seed: int = 0,
    progress: Progress = silent,
) -> NoiseFloor:  # fmt: skip
    """Draw the residual's noise `draws` times on every run."""
    out: list[dict[str, Array]] = []
    done, total = 0, draws * len(drives)
    for number, (drive, sensitivity) in enumerate(zip(drives, sensitivities, strict=True)):
        rng = np.random.default_rng([seed, number])
        parts: dict[str, list[Array]] = {row: [] for row in drive.rows}
        for _ in range(draws):
            for row, series in drive.decimated(sensitivity.noise(rng)).items():
                parts[row].append(series)
            done += 1
            progress(Step(Stage.NOISE_FLOOR, done, total))
        out.append({row: np.stack(series) for row, series in parts.items()})
    return NoiseFloor.of(out)


def floor_at(fitted: Fit, physics: Array, draws: int, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit's runs at other values `physics` (p,) of the parameters of its physics."""
    sensitivities = [Sensitivity.of(drive.recording, fitted.model.physics, physics) for drive in fitted.drives]
    return simulate_floor(fitted.drives, sensitivities, draws, seed, progress)


def floor_of(fitted: Fit, draws: int = 199, seed: int = 0, progress: Progress = silent) -> NoiseFloor:
    """The noise floor of a fit, on its own runs."""
    return simulate_floor(fitted.drives, fitted.sensitivities, draws, seed, progress)
