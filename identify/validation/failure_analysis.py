"""Failure analysis of a fitted model: rows and manoeuvre phases it fails in, states that its residual depends on."""

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
"""Number of states that a row's residual is shown against unless every state is asked for."""


@dataclass(frozen=True)
class FailureAnalysis:
    """Failure analysis of a fitted model, as values.

    Attributes
    ----------
    rows : the rows of the fit.
    parts, phases : comparisons with the runs asked for, runs used by the fit first, and their manoeuvre phases.
    ratios : row → RMS residual ÷ RMS noise floor, each over the runs asked for that the fit used; over all where it
        used none.
    worst : rows that fail, largest ratio first; the row of the largest ratio alone when none fails.
    in_phase : manoeuvre phase → row → residual ÷ floor, over `parts`.
    explainable : explainable residual of each row, from all runs of the fit; so are the next three.
    follows : row → the states its residual depends on.
    spectra : spectra of the rows in `worst`.
    surfaces : corner → restoring-force surface.
    against : row of `worst` → state → the residual against it, for the states that predict most of it, with the part
        that the model absorbed added again.
    against_every : state → the residual of the first of `worst` against it, every state of the row.
    """

    rows: tuple[Row, ...]
    parts: tuple[Comparison, ...]
    phases: tuple[Phases, ...]
    ratios: Mapping[Row, float]
    worst: tuple[Row, ...]
    in_phase: Mapping[str, Mapping[Row, InPhase]]
    explainable: Mapping[Row, ExplainableResidual]
    follows: Mapping[Row, Sequence[Follows]]
    spectra: Mapping[Row, RowSpectrum]
    surfaces: Mapping[str, Surface]
    against: Mapping[Row, Mapping[str, Against]]
    against_every: Mapping[str, Against]

    @property
    def failing(self) -> bool:
        """Whether any row fails."""
        return any(fails(ratio) for ratio in self.ratios.values())


def analyse_failure(
    fitted: Fit, floor: NoiseFloor, parts: Sequence[Comparison], phases: Sequence[Phases], row: Row | None = None,
    progress: Progress = silent,
) -> FailureAnalysis:  # fmt: skip
    """Analyse where and on what states a fitted model fails.

    Parameters
    ----------
    floor : noise floor of the fit on its own runs.
    parts, phases : comparisons of the fit with the runs asked for, and their manoeuvre phases.
    row : the one row to analyse; default: every row that fails.
    progress : receives each stage.
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
    against = {
        name: against_states(
            fitted.runs, fitted.residual, name, [f.state for f in follows.get(name, [])][:SHOWN_STATES], clear
        )
        for name in worst
    }
    return FailureAnalysis(
        rows=fitted.rows, parts=tuple(parts), phases=tuple(phases), ratios=ratios, worst=worst,
        in_phase=by_phase(parts, phases), explainable=explainable, follows=follows,
        spectra={name: s for name, s in found.items() if s is not None}, surfaces=restoring_surfaces(fitted),
        against=against,
        against_every=against_states(fitted.runs, fitted.residual, worst[0]) if worst else {},
    )  # fmt: skip


def _ratios(parts: Sequence[Comparison], rows: Sequence[Row]) -> dict[Row, float]:
    """Row → RMS residual ÷ RMS floor over the runs used; over the runs held out where `parts` has no other."""
    chosen = [part for part in parts if part.used] or list(parts)
    out: dict[Row, float] = {}
    for row in rows:
        found = [(part.scores[row], part.t[row].size) for part in chosen if row in part.scores]
        squares, floor = (sum(n * getattr(s, name) ** 2 for s, n in found) for name in ("rms", "floor"))
        if found:
            out[row] = float(squares / floor) ** 0.5 if floor else 0.0
    return out
