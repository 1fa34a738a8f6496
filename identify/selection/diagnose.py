"""Diagnosis of a fitted model: which effects are missing, and what remains that no candidate stands for.

Rows are weighted by the simulated noise floor. Parameters of the model, sensor zeros of each run and tolerances of the
sensor sheet are nuisance, removed from every candidate first (partial regression). Candidates that pass the max-score
statistic of simulated runs (parametric bootstrap) are selected together, with their constants, and fitted; what the
model with them leaves is judged by one omnibus test, beside the names.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.answers import answered
from lacet.identify.selection.candidate import Answer, Candidate, Confounded, Reason, judged
from lacet.identify.selection.chow_test import ParameterConstancy, chow_test, chow_test_in_model
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.ranked_runs import LocalRuns, RankedRuns
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.diagnosis import Diagnosis, Grounds, Verdict
from lacet.identify.selection.joint.alternatives import Alternative, alternatives, confidence_set
from lacet.identify.selection.joint.assumed_errors import only_beyond_assumptions
from lacet.identify.selection.joint.inseparable import with_inseparable
from lacet.identify.selection.joint.refits import (
    Joint,
    less_a_part,
    not_part_of_the_rest,
    only_plausible,
    with_all_tested,
)
from lacet.identify.selection.joint.rounds import (
    continued,
    exchanged,
    found_together,
    relinearised,
    started_with,
    with_a_fault,
    with_floor_at_tolerances,
    without_denied_faults,
)
from lacet.identify.selection.joint.shape_constants import refined
from lacet.identify.selection.joint.starts import starts
from lacet.identify.selection.joint.subset_search import strength
from lacet.identify.selection.joint.unknown_tables import (
    LackingTables,
    beside_tables,
    with_open_sizes,
    with_sizes_beside,
)
from lacet.identify.selection.joint.wrong_tables import axles_without_tables, confounded_with
from lacet.identify.selection.laws.described import Described, described
from lacet.identify.selection.laws.encompassing import only_encompassing
from lacet.identify.selection.laws.formulas import Formula, propose
from lacet.identify.selection.laws.unlisted_rivals import with_unlisted_rivals
from lacet.identify.selection.relinearisation import latencies_beside, relinearised_tests
from lacet.identify.selection.rest import Rest
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor


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
    """The same for runs wherever they are; where these cannot be fitted again, one effect at most is proposed."""
    progress(Step(Stage.SENSOR_TOLERANCES))
    recorded = ScoreTests.of(Linearisation.of_runs(runs, floor), candidates, seed, noise, progress)
    joint = found_together(relinearised_tests(recorded, candidates, seed, progress), seed, progress)
    first = joint.first
    joint, rest = _of_another_start(*_settled(joint, seed, progress), seed, progress)
    listed = {effect.key: effect for effect in candidates}
    if runs.refittable is None:
        return _concluded(runs, floor, joint, rest, _one(joint, progress), listed, seed, progress)
    if not rest.unlisted:
        found = [_as_found(joint, effect, first.draws) for effect in joint.effects]
        changing = _not_constant(joint, rest, found, progress)
        doubted = changing or with_unlisted_rivals(joint, seed, progress)
        if doubted:
            without, rows = _without_doubted(joint, doubted, seed, progress)
            # What an unlisted law does better was found, however small it is; what changes is declared without a rest.
            remains = Rest.of(without.space, without.laws, frozenset() if changing else rows)
            if remains.unlisted:
                joint, rest = without, remains
            elif changing:
                found = [c for c in found if c.key not in without.parts]
                joint = replace(joint, parts=without.parts)
        if not rest.unlisted:
            return _concluded(runs, floor, joint, rest, found, listed, seed, progress, not_constant=changing)
    known = described(joint, rest, seed, progress)
    found = [_as_found(known.beside, effect, first.draws) for effect in known.beside.effects]
    return _concluded(runs, floor, known.joint, known.rest, found, listed, seed, progress, known)


def _settled(joint: Joint, seed: int, progress: Progress) -> tuple[Joint, Rest]:
    """The effects found and the rest, searched again where linearisation or the noise floor may matter."""
    progress(Step(Stage.LACK_OF_FIT))
    joint, rest = without_denied_faults(joint, Rest.of(joint.space, joint.laws), seed, progress)
    for closer in (relinearised, with_floor_at_tolerances):
        if joint.space.linearisation.runs.refittable is not None and _in_doubt(joint, rest):
            other = closer(joint, seed, progress)
            if other is not joint:
                joint = continued(other, seed, progress)
                joint, rest = without_denied_faults(joint, Rest.of(joint.space, joint.laws), seed, progress)
    if joint.base is None:
        return joint, rest
    other = exchanged(joint, seed, progress)
    if other is not joint:
        joint = continued(other, seed, progress)
        rest = Rest.of(joint.space, joint.laws)
    possible = only_plausible(joint, seed, progress)
    rest = rest if possible is joint else Rest.of(possible.space, possible.laws)
    joint, rest = not_part_of_the_rest(possible, rest, seed, progress)
    other = only_beyond_assumptions(joint, seed, progress)
    joint, rest = other, rest if other is joint else Rest.of(other.space, other.laws)
    standing = only_encompassing(joint, seed, progress) if rest.unlisted else joint
    return standing, rest if standing is joint else Rest.of(standing.space, standing.laws)


def _without_doubted(
    joint: Joint, keys: Collection[str], seed: int, progress: Progress
) -> tuple[Joint, frozenset[Row]]:  # fmt: skip
    """The same without these effects, which stand for something unlisted, and without others that may be parts of the
    same cause; and the rows of these effects.

    They change from run to run, and nothing that belongs to the car does; or one law of no catalogue does their work.
    Others in the same rows may stand for it as well: they are compared with what remains there however small it is.
    """
    standing = [one for one in (*joint.laws, *joint.faults) if one.key in keys]
    for one in standing:
        joint = less_a_part(joint, one.key, seed, progress)
    rows = frozenset(row for one in standing for row in one.rows)
    joint, rest = not_part_of_the_rest(*with_all_tested(joint, seed, progress, rows), seed, progress)
    return only_encompassing(joint, seed, progress) if rest.unlisted else joint, rows


def _of_another_start(joint: Joint, rest: Rest, seed: int, progress: Progress) -> tuple[Joint, Rest]:
    """The same; where the sheet would have to be wrong, effects with which it is not, nor anything else remains.

    A sensor fault may be among what is missing. Or the sheet's tolerances, far off, do much of what is missing: they
    predict it in cross-validation as well as its cause does, and a search begins with another effect or none. So others
    begin with effects that are significant. They do so as well where something unlisted remains and the scale of the
    fit is weak: without wheel loads a model that lacks a stiff law in roll may have all sizes near zero and the centre
    of gravity on the ground, and what is significant beside that is not what is missing.
    """
    if joint.base is None:
        return joint, rest
    scale = joint.first.linearisation.runs.scale() if rest.unlisted else None
    weak = scale is not None and scale.weak
    if not weak and (rest.unlisted or not rest.sheet.tolerance_exceeded):
        return joint, rest
    faults = () if weak else with_a_fault(joint, seed, progress)
    others = (started_with(joint, effect, seed, progress) for effect in starts(joint))
    for other in chain(faults, others):
        if other.effects:
            other, remains = _settled(other, seed, progress)
            if other.effects and not remains.unlisted and not remains.sheet.tolerance_exceeded:
                return other, remains
    return joint, rest


def _in_doubt(joint: Joint, rest: Rest) -> bool:
    """Whether latencies of second order, or a floor at other parameters, may change the answer.

    An apparently unlisted cause may be due to either; an effect found to latencies only: it was compared with simulated
    runs that are as noisy as these.
    """
    if rest.unlisted:
        return True
    weakest = min((law.force for law in joint.laws if law.key in joint.keys), default=np.inf)
    return _second_order_squares(joint.space) > SELECTION.second_order_share * weakest


def _second_order_squares(space: ScoreTests) -> float:
    """Weighted squares of the latencies' second-order terms: about (ω τ / 2)² of those of first order."""
    layout, omega = space.layout, space.linearisation.omega
    places = [layout.model + layout.sheet.index(entry) for entry in space.linearisation.latency_tolerances]
    latencies = latencies_beside(space)
    reach = omega * np.max(np.abs(latencies * list(space.linearisation.latency_tolerances.values())), initial=0.0)
    return float((reach / 2.0) ** 2 * latencies @ space.sums.total[np.ix_(places, places)] @ latencies)


def _one(joint: Joint, progress: Progress) -> tuple[Candidate, ...]:
    """The strongest candidate that passes, where runs cannot be fitted again; none without any."""
    space = joint.space
    passing = [judged(c, space.effects[c.key], space.draws) for c in joint.alone if c.tested]
    best = max((c for c in passing if c.answer is Answer.MISSING), key=strength, default=None)
    if best is None:
        return ()
    progress(Step(Stage.SHAPE_CONSTANTS, subject=best.key))
    return (refined(space, best),)


def _as_found(joint: Joint, effect: Effect, draws: int) -> Candidate:
    """A candidate as missing, with shape constants of `effect`, sizes and intervals of a fit with all found.

    Its ties are the alternatives that are not rejected in its place.
    """
    (c,) = (one for one in joint.alone if one.key == effect.key)
    if effect in joint.removed:
        alike = {one.key: joint.first.correlation(c.key, one.key) for one in joint.alone if one.tested and one is not c}
        same = tuple((key, r) for key, r in alike.items() if r >= SELECTION.same_correlation)
        return replace(judged(c, effect, draws), answer=Answer.MISSING, reason=Reason.PASSES, ties=same)
    fitted = joint.space.fitted
    at = [fitted.model.names.index(q.name) for q in effect.parameters]
    sigma = np.sqrt(np.diag(sum(fitted.covariances_searched)))[at]
    tried = _alternatives(joint, effect.key)
    return replace(
        c, shape=dict(effect.shape), answer=Answer.MISSING, reason=Reason.PASSES, p=1.0 / (1.0 + draws),
        values=tuple(float(x) + joint.sizes.get(effect.key, 0.0) for x in fitted.theta[at]),
        interval=tuple(float(SELECTION.interval_quantile * one) for one in sigma),
        ties=tuple((one.key, one.correlation) for one in confidence_set(tried, joint.space.draws)),
        margin=tried[0].margin if tried else None, rival=tried[0].key if tried else "",
        confounded=_confounded(joint, effect.key),
    )  # fmt: skip


def _alternatives(joint: Joint, key: str) -> list[Alternative]:
    law = next((law for law in joint.laws if law.key == key), None)
    return [] if law is None else alternatives(joint.space, law)


def _confounded(joint: Joint, key: str) -> tuple[Confounded, ...]:
    law = next((law for law in joint.laws if law.key == key), None)
    return () if law is None else confounded_with(joint.space, law)


def _concluded(
    runs: RankedRuns, floor: NoiseFloor, joint: Joint, rest: Rest, found: Sequence[Candidate],
    candidates: Mapping[str, Effect], seed: int, progress: Progress, known: Described | None = None,
    not_constant: Mapping[str, ParameterConstancy] | None = None,
) -> Diagnosis:  # fmt: skip
    """The diagnosis of the effects found and the rest that they leave, of all `candidates`.

    `known` : what is found beside laws that describe what is unlisted, where these were searched; `not_constant` :
    Chow tests that reject an effect found, where these were made already.
    """
    first = joint.first
    now = first.residual_beside([])
    if not_constant is None:
        not_constant = _not_constant(*((known.beside, known.beside_rest) if known else (joint, rest)), found, progress)
    found = [c for c in found if c.key not in not_constant]
    judged_rest = runs.refittable is not None or not found
    unlisted = rest.unlisted if judged_rest else ()
    tied = [c for c in found if unlisted and any(like < SELECTION.same_correlation for _, like in c.ties)]
    found = [c for c in found if c.key not in {one.key for one in tied}]
    force = {law.key: law.force for law in joint.laws}
    explained_squares = sum(force.get(c.key, strength(c)) for c in found)
    exceeded = (
        judged_rest and not (unlisted or not_constant)
        and rest.sheet.tolerance_exceeded and explained_squares < rest.sheet.excess
    )  # fmt: skip
    if exceeded:
        found = []
    found = sorted(found, key=lambda c: -force.get(c.key, 0.0))
    if judged_rest:
        joint, found = _with_sums(joint, found, seed, progress)
    # A slope that is no name beside an unlisted cause may show that wheels move, too: by more than a slope.
    no_names = {*joint.parts, *not_constant, *(c.key for c in tied)}
    named = [effect for effect in joint.effects if effect.key not in no_names]
    lacking = LackingTables.of(named, [first.effects[key] for key in no_names], rest, runs.vehicle)
    of_tables: Sequence[Candidate] = ()
    if judged_rest and lacking.axles:
        axles = axles_without_tables(joint.effects, runs.vehicle)
        # Sizes are those of the fit with the laws that describe an unlisted rest.
        space = known.beside.space if known else joint.space
        found, of_tables = with_sizes_beside(found, beside_tables(space, axles, seed, progress))
        found = with_open_sizes(found, joint.effects, lacking.unlisted)
    acting = frozenset[Row]().union(*(c.rows for c in found)) if found else frozenset[Row]()
    own = [row for row in now.above if row in acting] or list(now.above)
    excess = now.excess(own)
    explained = 1.0 - rest.lack.excess(own) / excess if found and excess > 0.0 and judged_rest else 0.0
    formulas = list(known.formulas) if known else []
    if (unlisted or exceeded or not_constant) and not found and not formulas:
        progress(Step(Stage.SYMBOLIC_LAWS))
        failing = list(unlisted) or _worst(runs.row_ratios(floor))
        # Laws that change from run to run are in the last fit, and not in the car.
        formulas = propose(first if not_constant else joint.space, failing)
    scale = runs.scale() if exceeded else None
    assumed = runs.assumed({row: rest.forces[row][0] for row in unlisted})
    grounds = Grounds(rest.lack.ratios, rest.forces, rest.sheet, exceeded, not_constant, scale, assumed)
    verdict = Verdict.MISSING if found else Verdict.NOTHING
    if not found and (unlisted or exceeded or not_constant or of_tables):
        verdict = Verdict.UNLISTED
    diagnosis = Diagnosis(
        verdict, tuple(found), tuple(unlisted), rest.small if judged_rest else (),
        _maybe(joint, found, unlisted, candidates), answered(joint, found, tied, of_tables), runs.row_ratios(floor),
        excess, explained, floor.count, first.noise_ratio, now.above, first.noise, grounds, first.effects,
        tuple(formulas), known.laws if known else (), lacking,
    )  # fmt: skip
    if not found or not judged_rest or not_constant or tied:
        return diagnosis
    return replace(diagnosis, after=_after(joint, rest, candidates, seed, progress, formulas))


def _with_sums(
    joint: Joint, found: Sequence[Candidate], seed: int, progress: Progress
) -> tuple[Joint, Sequence[Candidate]]:
    """The effects found with the same laws at places that these runs do not distinguish, and the fit with them all."""
    joint, sums = with_inseparable(joint, [c.key for c in found], seed, progress)
    out: list[Candidate] = []
    for c in found:
        members = sums[c.key].keys if c.key in sums else (c.key,)
        for key in members:
            if key in {one.key for one in out}:
                continue
            if key not in sums:
                out.append(c)
                continue
            effect = next(one for one in joint.effects if one.key == key)
            own = _as_found(joint, effect, joint.first.draws)
            # In the place of a part of a sum, whose own size is open, anything could be.
            ties = tuple(tie for tie in c.ties if tie[0] not in members)
            out.append(replace(own, total=sums[key], ties=ties, margin=None, rival=""))
    return joint, out


def _after(
    joint: Joint, rest: Rest, candidates: Mapping[str, Effect], seed: int, progress: Progress,
    formulas: Sequence[Formula],
) -> Diagnosis:  # fmt: skip
    """The diagnosis of the model with all effects found, from the score tests beside them."""
    space = joint.space
    alone = Joint(space, joint.beside, space, joint.beside, (), joint.laws)
    known = Described(alone, rest, alone, rest, tuple(formulas)) if formulas else None
    return _concluded(space.linearisation.runs, space.floor, alone, rest, (), candidates, seed, progress, known)


def _not_constant(
    joint: Joint, rest: Rest, found: Sequence[Candidate], progress: Progress
) -> dict[str, ParameterConstancy]:
    """Chow tests that reject an effect found, beside those not rejected; a law belongs to the car."""
    out: dict[str, ParameterConstancy] = {}
    standing, laws = list(found), {law.key: law for law in (*joint.laws, *joint.faults)}
    # Where more remains than a selected law may be inexact, the law may stand in for it: it must then hold in each run
    # as well as it may be inexact there, also where a run shows little of it.
    doubted = {
        law.key
        for law in joint.laws
        if rest.lack.excess(law.rows & set(rest.unlisted)) > SELECTION.selected_inexactness**2 * law.force
    }
    while standing:
        rejected: dict[str, ParameterConstancy] = {}
        for c in standing:
            progress(Step(Stage.PARAMETER_CONSTANCY, subject=c.key))
            if c.key in laws:
                runs = chow_test_in_model(joint.space, laws[c.key], [laws[key] for key in out if key in laws])
            elif c.key in joint.space.selected:  # a latency removed from the runs
                runs = chow_test(joint.space.releasing([c.key]), c)
            else:
                runs = chow_test(joint.first, c, [other for other in standing if other.key != c.key])
            if runs is not None and (
                runs.differ_by_more_than(SELECTION.inconstant_share, len(standing))
                or (c.key in doubted and runs.fails_in_a_run(SELECTION.selected_inexactness**2, len(standing)))
            ):
                rejected[c.key] = runs
        if not rejected:
            break
        out |= rejected
        # What these stood for is in the residual again: another stand-in for it changes from run to run with it.
        standing = [c for c in standing if c.key not in rejected]
    return out


def _maybe(
    joint: Joint, found: Sequence[Candidate], unlisted: Sequence[Row], candidates: Mapping[str, Effect]
) -> tuple[str, ...]:
    """Listed effects that cannot be tested and may be the cause: of what remains, or in place of one found.

    In place of one found: those that cannot be tested alone either, as beside it all that it does is explained. Of what
    remains those that, with their plausible range as prior, explain as much of it as the best that can be
    tested, and those that cannot be computed on these runs and act on its rows.
    """
    space = joint.space
    closed = {c.key for c in joint.beside if not c.tested}
    never = closed & {c.key for c in joint.alone if not c.tested}
    out = [key for c in found for key, _ in c.ties if key in never]
    if unlisted:
        most = max((c.drop for c in joint.beside if c.tested), default=0.0)
        out += [key for key in closed & space.best_tests.keys() if _fall_within_range(space, key) >= most]
        absent = [candidates[key] for key in space.columns.unmeasured]
        laws = [effect for effect in absent if effect.as_physics is not None]
        out += [effect.key for effect in laws if any(effect.acts_on(row) for row in unlisted)]
    return tuple(dict.fromkeys(out))


def _fall_within_range(space: ScoreTests, key: str) -> float:
    """Fall of the weighted squares by a candidate, its plausible range as prior."""
    trial = space.best_tests[key].trial
    at, right = trial.place, space.layout.right
    normal = space.regression.reduced_noisy[at, at] + np.diag([q.prior**-2.0 for q in trial.effect.parameters])
    score = space.regression.reduced[at, right]
    return float(score @ np.linalg.solve(normal, score))


def _worst(ratios: Mapping[Row, float]) -> list[Row]:
    """Rows whose squares above the floor are at least `worst_rows_share` of the worst row's."""
    half = SELECTION.worst_rows_share * (max(ratios.values()) ** 2 - 1.0)
    return [row for row, ratio in ratios.items() if ratio > 1.0 and ratio**2 - 1.0 >= half]
