"""Diagnosis of a fitted model: which effect is missing, from a ranking of all candidates.

Rows are weighted by the simulated noise floor, the same for all candidates and versions. Parameters of the model,
sensor zeros of each run and tolerances of the sensor sheet are nuisance, removed from every candidate first (partial
regression). The rank is the gain in blocked cross-validation; a candidate is proposed only when its score passes the
max-score statistic of simulated runs that lack nothing (parametric bootstrap), and the gain matters in newtons.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.chow_test import ParameterConstancy, chow_test
from lacet.identify.selection.columns.linearisation import Linearisation, sheet_products
from lacet.identify.selection.columns.ranked_runs import LocalRuns, RankedRuns
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.forward_selection import best_set, with_ties
from lacet.identify.selection.joint.shape_constants import refined
from lacet.identify.selection.joint.subset_search import found_together, strength
from lacet.identify.selection.lack_of_fit import LackOfFit, excess_is_coloured
from lacet.identify.selection.laws.formulas import Formula, propose
from lacet.identify.selection.relinearisation import relinearise, relinearised_columns, without_fault
from lacet.identify.selection.score_tests import (
    Answer,
    Candidate,
    Pending,
    Reason,
    ScoreTests,
    implausible,
    is_significant,
    judged,
)
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import ToleranceUse
from lacet.identify.validation.noise_floor import NoiseFloor


@dataclass(frozen=True)
class Screening:
    """Result of one screening of all candidates beside a fit.

    Attributes
    ----------
    space : score tests of the candidates.
    now : lack of fit of the model with the sensor tolerances.
    ranked : candidates that can be tested, best first; `untestable` the others.
    best : the first that passes every bar, or None.
    together : keys of the up to three candidates that together explain most.
    excess : weighted squares above the floor in the rows that fail and the best acts on; `explained` the part that the
        best set takes away.
    sheet : sensor tolerances that the runs need with the best in the model, or with none.
    tolerance_exceeded : whether the tolerance test fails, the best explains less than the tolerances, and no other test
        makes the cause unlisted.
    not_constant : Chow test of the best where it rejects constant parameters; None elsewhere, and where the cause is
        unlisted already.
    unlisted : whether the misfit, the failed tolerance test or the inconstant law has a cause that no candidate is.
    """

    space: ScoreTests
    now: LackOfFit
    ranked: tuple[Candidate, ...]
    untestable: tuple[Candidate, ...]
    best: Candidate | None
    together: tuple[str, ...]
    excess: float
    explained: float
    sheet: ToleranceUse
    tolerance_exceeded: bool
    not_constant: ParameterConstancy | None
    unlisted: bool

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Candidates by key."""
        return self.space.effects


def screen(space: ScoreTests, progress: Progress) -> Screening:
    """Screening of all candidates: their ranks, and whether the best of them explain the misfit."""
    now = space.residual_beside([])
    progress(Step(Stage.SCORE_TESTS))
    all_tried = space.family_wise(space.try_all())
    progress(Step(Stage.TIES))
    ranked = _ranked(space, [c for c in all_tried if c.tested])
    progress(Step(Stage.FORWARD_SELECTION))
    together = best_set(space, [c.key for c in ranked if implausible(c, space.effects[c.key]) is None])
    best = next((c for c in ranked if c.answer is Answer.MISSING), None)
    chosen = [c for c in ranked if c.key in together]
    excess, explained, unlisted = _explained(space, now, best, chosen, progress)
    not_constant = None
    if best is not None and not unlisted:
        progress(Step(Stage.PARAMETER_CONSTANCY, subject=best.key))
        found = chow_test(space, best, [c for c in chosen if c.key != best.key])
        not_constant = found if found is not None and found.rejected else None
    # Where the tolerances absorb the whole cause no row fails, and some fault is larger than any tolerance.
    sheet = space.tolerance_use(best.key if best else "")
    tolerance_exceeded = (
        not (unlisted or not_constant) and sheet.tolerance_exceeded and (best is None or strength(best) < sheet.excess)
    )
    return Screening(
        space, now, tuple(ranked), tuple(c for c in all_tried if not c.tested), best, tuple(together), excess,
        explained, sheet, tolerance_exceeded, not_constant, unlisted or tolerance_exceeded or not_constant is not None,
    )  # fmt: skip


def _ranked(space: ScoreTests, tested: Sequence[Candidate]) -> list[Candidate]:
    """Testable candidates with answers and ties: the strongest first, those explained by chance last."""
    effects = space.effects
    ranked = sorted(tested, key=lambda c: (c.p > SELECTION.level(space.draws), -strength(c)))
    standing_out = {c.key for c in ranked if is_significant(c, effects[c.key], space.draws)}
    return with_ties([judged(c, effects[c.key], space.draws) for c in ranked], space, standing_out)


def _explained(
    space: ScoreTests, now: LackOfFit, best: Candidate | None, chosen: Sequence[Candidate], progress: Progress
) -> tuple[float, float, bool]:
    """Excess of the rows that fail, the part that the best set explains, and whether the cause is unlisted for it.

    `chosen` : candidates of the best set.
    """
    # Rows that do not fail have no excess to explain; their scatter would hide that of a small effect.
    own = [row for row in now.above if best and row in best.rows] or now.above
    excess = now.excess(own)
    if not now.above:
        return excess, 0.0, False
    # A gap between two values of the grid would leave what looks like another cause.
    sharper: list[Candidate] = []
    for c in chosen:
        progress(Step(Stage.SHAPE_CONSTANTS, subject=c.key))
        sharper.append(refined(space, c))
    progress(Step(Stage.LACK_OF_FIT))
    after = space.residual_beside([replace(space.effects[c.key], shape=c.shape) for c in sharper])
    explained = (excess - after.excess(own)) / excess
    chance = max(SELECTION.set_chance, 1.0 / (1.0 + space.floor.count))
    unlisted = excess_is_coloured(now) and (
        best is None
        or (explained < SELECTION.set_share and after.chance(own) <= chance)
        or strength(best) < SELECTION.own_share * excess
        or _excess_remains(space, now, after, best, progress)
    )
    return excess, explained, unlisted


def _excess_remains(space: ScoreTests, now: LackOfFit, after: LackOfFit, best: Candidate, progress: Progress) -> bool:
    """Whether too much of the excess remains with the best set, beyond noise and the noise through the best effect."""
    remainder, most = after.excess(now.above), SELECTION.unexplained_share * now.excess(now.above)
    if after.family > SELECTION.failing_chance or remainder <= most or not excess_is_coloured(after):
        return False
    effect = space.best_tests[best.key].trial.effect.as_physics
    if effect is None:
        return True
    progress(Step(Stage.REGRESSOR_NOISE_OF_EFFECT, subject=best.key))
    c = refined(space, best)
    law = replace(effect, shape=c.shape)
    through = space.linearisation.runs.noise_through(law, np.array(c.values), space.floor.sigma, space.noise_ratio)
    return remainder - sum(max(0.0, through[row]) for row in now.above) > most


class Verdict(StrEnum):
    """Verdict of a diagnosis."""

    MISSING = "missing"
    """An effect is proposed."""
    NOTHING = "nothing missing"
    UNLISTED = "unlisted cause"
    """The model fails for a cause that no candidate stands for."""


@dataclass(frozen=True)
class Grounds:
    """Grounds of a verdict, in addition to the numbers of the diagnosis.

    Attributes
    ----------
    strongest : the strongest candidate that passes every bar, whatever the verdict; None where none does.
    ratios : row → residual ÷ floor with the sensor sheet's tolerances in the model.
    tolerances : sensor tolerances that the runs need with the strongest in the model.
    tolerance_exceeded : whether the tolerance test fails and makes the cause unlisted.
    not_constant : Chow test of the strongest where it rejects constant parameters; None elsewhere.
    """

    strongest: Candidate | None
    ratios: Mapping[Row, float]
    tolerances: ToleranceUse
    tolerance_exceeded: bool
    not_constant: ParameterConstancy | None


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of a model: what is missing in it; `lacet.services.render.verdicts` has it in sentences.

    Attributes
    ----------
    verdict : whether an effect is missing.
    best : the candidate proposed, or None.
    candidates : all, best first; those that cannot be tested last.
    ratios : row → residual ÷ floor of the present model on the runs used.
    excess : weighted squares above the floor in the rows that fail and the best acts on; `explained` the part that the
        best set of up to three candidates takes away.
    draws : number of noise-floor simulations behind p.
    noise_ratio : row → noise ÷ noise by the sensor sheet, from the residual with all candidates in the model; at
        least 1.
    failing : rows above their floor by more than chance.
    together : the best set of up to three candidates.
    noise : noise in the columns at the first screening, for the next ranking.
    found : all effects that are found to be missing, the best first; more than one where only together they explain the
        misfit.
    grounds : grounds of the verdict.
    effects : key → effect of every candidate that can be computed.
    formulas : for an unlisted cause, laws that part of the residual follows, best first.
    """

    verdict: Verdict
    best: Candidate | None
    candidates: tuple[Candidate, ...]
    ratios: Mapping[Row, float]
    excess: float
    explained: float
    draws: int
    noise_ratio: Mapping[Row, float]
    failing: tuple[Row, ...]
    together: tuple[str, ...]
    noise: RegressorNoise = field(repr=False)
    grounds: Grounds = field(repr=False)
    effects: Mapping[str, Effect] = field(repr=False)
    formulas: tuple[Formula, ...] = ()
    found: tuple[Candidate, ...] = ()

    @property
    def unlisted(self) -> bool:
        """Whether the model fails for a cause that no candidate stands for."""
        return self.verdict is Verdict.UNLISTED


def diagnose(
    fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect], seed: int = 0, noise: RegressorNoise | None = None,
    progress: Progress = silent,
) -> Diagnosis:  # fmt: skip
    """Diagnosis of a fitted model on the runs it was fitted to: `candidates` ranked, and the verdict.

    `floor` is the noise floor of this fit's runs; its σ are the weights. `noise` in the columns from an earlier ranking
    of the same candidates saves time; without it, it is computed. `progress` receives each step.
    """
    return diagnose_runs(LocalRuns(fitted), floor, candidates, seed, noise, progress)


def diagnose_runs(
    runs: RankedRuns, floor: NoiseFloor, candidates: Sequence[Effect], seed: int = 0,
    noise: RegressorNoise | None = None, progress: Progress = silent,
) -> Diagnosis:  # fmt: skip
    """The same for runs wherever they are; what needs new fits is passed over where these cannot be made."""
    progress(Step(Stage.SENSOR_TOLERANCES))
    found, seen = _screened(Linearisation.of_runs(runs, floor), candidates, seed, noise, progress)
    if fault_may_leave_more(seen) and seen.best is not None and runs.refittable is not None:
        _, beside = _screened(without_fault(seen.space, seen.best.key, progress), candidates, seed, None, progress)
        seen = explained_with_fault(seen, beside)
    best, ranked, failing = (None if seen.unlisted else seen.best), list(seen.ranked), seen.now.above
    together = _listed_together(seen, seed, progress) if seen.unlisted and runs.refittable is not None else None
    if together is not None:
        seen, best = replace(seen, unlisted=False, explained=together.explained, excess=together.excess), None
        ranked = [*together.found, *(c for c in ranked if c.key not in together.keys)]
    if best is not None:
        best = refined(seen.space, best)
        best = replace(best, reason=judged(best, seen.effects[best.key], seen.space.draws).reason)
        ranked = [best if c.key == best.key else c for c in ranked]
    found_all = together.found if together is not None else (best,) if best is not None else ()
    best = found_all[0] if found_all else None
    ranked = [_with_final_answer(c, best, [one.key for one in found_all]) for c in ranked]
    ratios, formulas = runs.row_ratios(floor), list[Formula]()
    if seen.unlisted:
        progress(Step(Stage.SYMBOLIC_LAWS))
        hidden = seen.tolerance_exceeded or not failing
        formulas = propose(seen.space, _worst(ratios) if hidden else failing)
    verdict = Verdict.UNLISTED if seen.unlisted else Verdict.MISSING if best is not None else Verdict.NOTHING
    grounds = Grounds(seen.best, seen.now.ratios, seen.sheet, seen.tolerance_exceeded, seen.not_constant)
    return Diagnosis(
        verdict, best, (*ranked, *seen.untestable), ratios, seen.excess, seen.explained, floor.count,
        seen.space.noise_ratio, failing, together.keys if together is not None else seen.together, found, grounds,
        seen.effects, tuple(formulas), found_all,
    )  # fmt: skip


def _screened(
    linearisation: Linearisation,
    candidates: Sequence[Effect],
    seed: int,
    noise: RegressorNoise | None,
    progress: Progress,
) -> tuple[RegressorNoise, Screening]:
    """Noise in the columns of the first screening, and the last screening, repeated where linearisation may matter."""
    columns = relinearised_columns(linearisation, candidates, seed, progress)
    seen = screen(ScoreTests(columns, noise, progress), progress)
    found = seen.space.noise
    if linearisation.runs.refittable is None:
        return found, seen
    for closer in (_relinearised, _with_floor_at_tolerances):
        if _in_doubt(seen):
            space = seen.space
            closest = closer(space, progress)
            if closest is not space.linearisation:
                # What noise adds cancels in what the model explains at this fit's zeros only.
                same = space.noise if closest.fitted is space.fitted else None
                seen = screen(ScoreTests.of(closest, candidates, seed, same, progress), progress)
    return found, seen


def _in_doubt(seen: Screening) -> bool:
    """Whether a re-linearised screening may change the answer: only where rows fail by little or not at all.

    An apparently unlisted cause may be due to latencies or to a noise floor that is too low. A proposed effect may be
    due to latencies only: it was compared with simulated runs that are as noisy as these.
    """
    now = seen.now
    # Sensors louder than their sheet lift all rows; a cause has a colour.
    noise_ratio = seen.space.noise_ratio if now.above and not excess_is_coloured(now) else dict[Row, float]()
    if any(now.ratios[row] >= SELECTION.marginal_ratio * noise_ratio.get(row, 1.0) for row in now.above):
        return False
    # Latencies may also make a candidate where no row fails.
    unsure = seen.unlisted and bool(now.above)
    return unsure or (
        seen.best is not None and _second_order_squares(seen.space) > SELECTION.second_order_share * strength(seen.best)
    )


def _second_order_squares(space: ScoreTests) -> float:
    """Weighted squares of the latencies' second-order terms: about (ω τ / 2)² of those of first order."""
    layout, omega = space.layout, space.linearisation.omega
    found = dict(zip(space.regression.nuisance.tolist(), space.regression.gain[:, layout.right].tolist(), strict=True))
    places = [layout.model + layout.sheet.index(entry) for entry in space.linearisation.latency_tolerances]
    latencies = np.array([found.get(place, 0.0) for place in places])
    reach = omega * np.max(np.abs(latencies * list(space.linearisation.latency_tolerances.values())), initial=0.0)
    return float((reach / 2.0) ** 2 * latencies @ space.sums.total[np.ix_(places, places)] @ latencies)


def _relinearised(space: ScoreTests, progress: Progress) -> Linearisation:
    """Runs re-linearised down to `settled_phase`, where they were not for the first screening."""
    return (
        space.linearisation
        if space.linearisation.latencies
        else relinearise(space.linearisation, progress, SELECTION.settled_phase)
    )


def _with_floor_at_tolerances(space: ScoreTests, progress: Progress) -> Linearisation:
    """Linearisation with the noise floor at the parameters estimated with sensor tolerances in place of the fit's."""
    progress(Step(Stage.FLOOR_AT_TOLERANCES))
    runs = space.linearisation.runs
    if runs.refittable is None:
        return space.linearisation
    floor = space.floor.redrawn(runs.refittable, space.tolerated_parameters)
    return replace(space.linearisation, floor=floor, sums=sheet_products(runs, floor))


def fault_may_leave_more(seen: Screening) -> bool:
    """Whether rows fail for an unlisted cause and the best is a sensor fault, whose first-order column is inexact."""
    rows_fail = seen.unlisted and not seen.tolerance_exceeded and seen.not_constant is None
    return rows_fail and seen.best is not None and seen.effects[seen.best.key].as_fault is not None


def explained_with_fault(seen: Screening, beside: Screening) -> Screening:
    """A screening corrected by `beside`, the screening of the runs with its best, a sensor fault, removed.

    The cause is listed where the fault, alone or with the best set of `beside`, explains as much as any set must.
    """
    assert seen.best is not None
    before = seen.space.residual_without_tolerance(seen.best.key)
    whole, gain_test = before.excess(before.above), beside.now.excess(beside.now.above)
    remainder = gain_test if beside.unlisted else beside.excess * (1.0 - beside.explained)
    if remainder > (SELECTION.unexplained_share if beside.unlisted else 1.0 - SELECTION.set_share) * whole:
        return seen
    together = (seen.best.key,) if beside.unlisted else (seen.best.key, *beside.together)
    best = _as_fitted(seen.best, beside.space.fitted)
    return replace(seen, best=best, unlisted=False, excess=whole, explained=1.0 - remainder / whole, together=together)


def _as_fitted(fault: Candidate, fitted: FittedModel) -> Candidate:
    """A sensor fault as candidate, with size and interval from the fit by which it was removed."""
    (at,) = (i for i, name in enumerate(fitted.model.names) if name.startswith(f"{fault.key}."))
    wide = np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at])
    return replace(fault, values=(float(fitted.theta[at]),), interval=(SELECTION.interval_quantile * float(wide),))


@dataclass(frozen=True)
class Together:
    """Effects that together explain what no one of them, nor the first best set, explains.

    Attributes
    ----------
    found : the effects as candidates, the strongest first, with sizes of a fit with all of them.
    excess, explained : as of `Screening`, over the rows that fail.
    """

    found: tuple[Candidate, ...]
    excess: float
    explained: float

    @property
    def keys(self) -> tuple[str, ...]:
        """Their keys."""
        return tuple(c.key for c in self.found)


def _listed_together(seen: Screening, seed: int, progress: Progress) -> Together | None:
    """Several listed effects that explain a misfit with an apparently unlisted cause; None where none do.

    They must explain as much as any set must, and the law of each must be the same in all runs.
    """
    if not seen.now.above:
        return None
    subset = found_together(seen.space, seed, progress)
    if not subset.settled:
        return None
    # What fails elsewhere is judged with these in the model.
    acting = frozenset[Row]().union(*(one.rows for one in subset.settled))
    own = [row for row in seen.now.above if row in acting] or list(seen.now.above)
    excess, after = seen.now.excess(own), subset.space.residual_beside([])
    explained = 1.0 - after.excess(own) / excess
    if explained < 1.0 - SELECTION.unexplained_share:
        return None
    settled = sorted(subset.settled, key=lambda one: -one.force)
    alone = {c.key: c for c in (*seen.ranked, *seen.untestable)}
    fitted, draws = subset.space.fitted, seen.space.draws
    found = tuple(_as_found(alone[one.effect.key], one.effect, fitted, draws) for one in settled)
    progress(Step(Stage.PARAMETER_CONSTANCY, subject=", ".join(c.key for c in found)))
    for c in found:
        runs = chow_test(seen.space, c, [other for other in found if other.key != c.key])
        if runs is not None and runs.rejected:
            return None
    return Together(found, excess, explained)


def _as_found(c: Candidate, effect: Effect, fitted: FittedModel, draws: int) -> Candidate:
    """A candidate as missing, with shape constants of `effect`, sizes and intervals of a fit with it."""
    at = [fitted.model.names.index(q.name) for q in effect.parameters]
    sigma = np.sqrt(np.diag(fitted.covariance + fitted.covariance_sheet))[at]
    return replace(
        c, shape=dict(effect.shape), answer=Answer.MISSING, reason=Reason.PASSES, p=1.0 / (1.0 + draws),
        values=tuple(map(float, fitted.theta[at])), ties=(),
        interval=tuple(float(SELECTION.interval_quantile * one) for one in sigma),
    )  # fmt: skip


def _with_final_answer(c: Candidate, best: Candidate | None, found: Collection[str]) -> Candidate:
    """The candidate with its answer by the verdict: missing for those found and those tied with the best."""
    tied = c.key in dict(best.ties) if best else False
    if c.answer is Answer.MISSING and not tied and c.key not in found:
        pending = Pending.UNTIL_BEST_IS_ADDED if best else Pending.NOT_ENOUGH
    elif c.answer is Answer.NOT_NEEDED and best and tied:
        pending = Pending.TIED_WITH_BEST
    else:
        return c
    return replace(c, answer=Answer.UNDECIDED, pending=pending)


def _worst(ratios: Mapping[Row, float]) -> list[Row]:
    """Rows whose squares above the floor are at least `worst_rows_share` of the worst row's."""
    half = SELECTION.worst_rows_share * (max(ratios.values()) ** 2 - 1.0)
    return [row for row, ratio in ratios.items() if ratio > 1.0 and ratio**2 - 1.0 >= half]
