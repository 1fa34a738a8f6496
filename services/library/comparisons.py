"""Comparisons of fitted models with runs, row by row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lacet.daq.errors import UsageError
from lacet.identify.car.manoeuvre_phases import phases_of
from lacet.identify.car.rows import Row
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation import score
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.services.library.display import html_table, shortened
from lacet.services.library.fits import Fit
from lacet.services.library.pictures import Picture, drawn
from lacet.services.library.runs import Runs
from lacet.services.one_thread import one_thread
from lacet.services.render.tables import table
from lacet.services.workspace.loading import check_reference


@dataclass(frozen=True, repr=False)
class Comparison:
    """Comparison of a fitted model with runs: for each run and row, the error relative to the noise floor.

    Returned by `lacet.compare`; a collection by run: ``comparison["rough"].scores["suspension.fl"].ratio``.

    Attributes
    ----------
    runs : name of a run → measured and modelled rows, with their scores.

    Examples
    --------
    >>> comparison = lacet.compare(fitted)
    >>> comparison.ratios["sine"]["chassis.fx"] < 1.2
    True
    >>> comparison.failing["sine"]
    ('suspension.fl', 'suspension.fr', 'suspension.rl', 'suspension.rr')
    """

    runs: Mapping[str, score.Comparison] = field(repr=False)
    _prepared: Mapping[str, PreparedRun] = field(repr=False)

    @property
    def ratios(self) -> dict[str, dict[Row, float]]:
        """Run → row → root mean square of the error ÷ that of the noise floor."""
        return {name: {row: one.ratio for row, one in part.scores.items()} for name, part in self.runs.items()}

    @property
    def overall(self) -> float:
        """Root mean square of these ratios over all rows and runs: 1 at the noise floor."""
        every = [ratio for rows in self.ratios.values() for ratio in rows.values()]
        return float(np.sqrt(np.mean(np.square(every))))

    @property
    def failing(self) -> dict[str, tuple[Row, ...]]:
        """Run → rows in which the model fails."""
        return {
            name: tuple(row for row, ratio in rows.items() if score.fails(ratio)) for name, rows in self.ratios.items()
        }

    def plot(self, run: str, rows: Sequence[Row] | None = None) -> Picture:
        """Draw measured and modelled rows of a run and their difference, for some rows (default: all).

        Raises UsageError for a run or row that is not in the comparison.
        """
        if run not in self.runs:
            raise UsageError(f"there is no run '{run}' in this comparison: {', '.join(self.runs)}")
        if strange := [row for row in rows or () if row not in self.runs[run].measured]:
            raise UsageError(f"{run} has no row {', '.join(strange)}: {', '.join(self.runs[run].measured)}")

        def draw() -> bytes:
            from lacet.services.render.figures.png import charts_png
            from lacet.services.render.figures.study_plots import comparison_charts

            return charts_png(comparison_charts(self.runs[run], rows))

        return drawn(f"{run}: measured and modelled", draw)

    def plot_map(self) -> Picture:
        """Draw the residual map: row × time in units of the noise floor, with the phases of driving."""

        def draw() -> bytes:
            from lacet.services.render.figures.failure_plots import map_figure
            from lacet.services.render.figures.png import png

            phases = [phases_of(one.overview().outline) for one in self._prepared.values()]
            return png(map_figure([*self.runs.values()], phases))

        return drawn("residual map", draw)

    def __getitem__(self, run: str) -> score.Comparison:
        return self.runs[run]

    def __iter__(self) -> Iterator[str]:
        return iter(self.runs)

    def __len__(self) -> int:
        return len(self.runs)

    def _rows(self) -> list[list[str]]:
        rows = dict.fromkeys(row for ratios in self.ratios.values() for row in ratios)
        return [
            [row, *(f"{ratios[row]:.2f}" if row in ratios else "" for ratios in self.ratios.values())] for row in rows
        ]

    def _head(self) -> str:
        return f"Error ÷ noise floor, {self.overall:.2f} over all rows and runs (a row fails above {score.FAILS:g})"

    def __repr__(self) -> str:
        return shortened(f"{self._head()}\n{table(['row', *self.runs], self._rows())}")

    def _repr_html_(self) -> str:
        return html_table(self._head(), ["row", *self.runs], self._rows())


def compare(
    fitted: Fit, runs: Runs | None = None, *, draws: int = SCORE_DRAWS, progress: Callable[[str], object] | None = None
) -> Comparison:
    """Predict runs with a fitted model and score every row relative to its noise floor.

    Parameters
    ----------
    fitted : the model.
    runs : runs held out; by default those it was fitted to. Their sensor offsets are estimated with the sensor sheet's
        tolerances, as they belong to the run and not to the car.
    draws : simulations behind the noise floor.
    progress : called with a sentence at each step, e.g. ``print``.

    Raises UsageError when the wheel loads of `runs` are given at another point than those of the runs used.

    Examples
    --------
    >>> lacet.compare(fitted).overall > 1.2
    True
    """
    if runs is not None:
        check_reference(fitted.runs.reference, runs.reference)
    found: dict[str, score.Comparison] = {}
    prepared = {run.name: run for run in runs or fitted.runs}
    for run in prepared.values():
        if progress:
            progress(f"comparing with {run.name}")
        with one_thread():
            found[run.name] = score.compare(fitted.details, run, draws, knowledge=fitted.knowledge if runs else None)
    return Comparison(found, prepared)
