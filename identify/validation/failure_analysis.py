"""Where a fitted model fails: rows, phases of driving, states the residual follows, and the explainable residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lacet.identify.car.manoeuvre_phases import Phases
from lacet.identify.car.rows import Row
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.explainable_residual import ExplainableResidual, explainable_residual
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.identify.validation.projected_noise import refitted_draws
from lacet.identify.validation.residual_map import Against, Follows, InPhase, against_states, by_phase, followed_states
from lacet.identify.validation.restoring_force import Surface, restoring_surfaces
from lacet.identify.validation.score import Comparison, fails
from lacet.identify.validation.spectra import RowSpectrum, row_spectrum
from lacet.identify.validation.states import ClearStates

SHOWN_STATES = 6
"""States beside which a row's residual is shown unless every one is asked for."""


@dataclass(frozen=True)
class FailureAnalysis:
    """Where a fitted model fails, as values.

    Attributes
    ----------
    fitted : the fit that is analysed.
    parts, phases : comparisons with the runs asked for, those used first, and their phases of driving.
    ratios : row → RMS of residual ÷ noise floor over the runs used asked for (over all, where none of them was used).
    worst : rows that fail, farthest from their floor first, or the farthest alone when none does.
    in_phase : phase → row → residual ÷ floor, over `parts`.
    explainable, follows, spectra, surfaces : explainable residual, states followed, spectra of the worst rows and
        restoring-force surfaces, from all runs used.
    clear : the states that are clear of noise.
    """

    fitted: Fit
    parts: tuple[Comparison, ...]
    phases: tuple[Phases, ...]
    ratios: Mapping[str, float]
    worst: tuple[Row, ...]
    in_phase: Mapping[str, Mapping[str, InPhase]]
    explainable: Mapping[str, ExplainableResidual]
    follows: Mapping[str, Sequence[Follows]]
    spectra: Mapping[str, RowSpectrum]
    surfaces: Mapping[str, Surface]
    clear: ClearStates

    @property
    def failing(self) -> bool:
        """Whether any row fails."""
        return any(fails(ratio) for ratio in self.ratios.values())

    def against(self, row: Row, every: bool = False) -> dict[str, Against]:
        """A row's residual against the states it follows most, or against every state."""
        names = None if every else [f.state for f in self.follows.get(row, [])][:SHOWN_STATES]
        return against_states(self.fitted.runs, self.fitted.residual, row, names, None if every else self.clear)


def analyse_failure(
    fitted: Fit, floor: NoiseFloor, parts: Sequence[Comparison], phases: Sequence[Phases], row: Row | None = None,
    progress: Progress = silent,
) -> FailureAnalysis:  # fmt: skip
    """Analyse where a fit fails.

    Parameters
    ----------
    floor : noise floor of the fit on its own runs.
    parts, phases : the fit compared with the runs asked for, and their phases of driving.
    row : the one row to analyse; default: every row that fails.
    """
    ratios = _ratios(parts, fitted.rows)
    order = sorted((name for name in fitted.rows if name in ratios), key=lambda name: -ratios[name])
    worst = (row,) if row else tuple(name for name in order if fails(ratios[name])) or tuple(order[:1])
    progress(Step(Stage.STATES_FOLLOWED))
    clear = ClearStates(fitted.runs)
    draws = refitted_draws(fitted, floor)
    progress(Step(Stage.RESIDUAL_SPECTRA))
    found = {name: row_spectrum(fitted, floor, name, clear) for name in worst}
    follows = followed_states(fitted, floor, worst, clear, draws, progress)
    progress(Step(Stage.EXPLAINABLE_RESIDUAL))
    explainable = explainable_residual(fitted, floor, clear, draws=draws, progress=progress)
    progress(Step(Stage.RESTORING_FORCES))
    return FailureAnalysis(
        fitted=fitted, parts=tuple(parts), phases=tuple(phases), ratios=ratios, worst=worst,
        in_phase=by_phase(parts, phases), explainable=explainable, follows=follows,
        spectra={name: s for name, s in found.items() if s is not None}, surfaces=restoring_surfaces(fitted),
        clear=clear,
    )  # fmt: skip


def _ratios(parts: Sequence[Comparison], rows: Sequence[Row]) -> dict[str, float]:
    """Row → RMS of residual ÷ floor over the runs used, over those held out where no other was asked for."""
    chosen = [part for part in parts if part.used] or list(parts)
    out: dict[str, float] = {}
    for row in rows:
        found = [(part.scores[row].ratio ** 2, part.t[row].size) for part in chosen if row in part.scores]
        if found:
            out[row] = (sum(r * n for r, n in found) / sum(n for _, n in found)) ** 0.5
    return out
