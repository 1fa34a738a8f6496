"""Recommendation of the run that distinguishes tied effects, or excites one that the present runs cannot test."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import plain
from lacet.identify.design.discrimination import (
    NEEDED,
    SHOWS,
    Compared,
    Present,
    Question,
    Separations,
    WeightedRun,
    planned_run,
    present_runs,
    region,
    wrong_pick,
)
from lacet.identify.design.run_ranking import DURATIONS
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import find_effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Candidate
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.services.cache.keys import service_sources, simulator_sources
from lacet.services.planning.manoeuvre_library import Limits, Plan, kinds, library
from lacet.services.planning.nominal_car import known_values, planned_car
from lacet.services.planning.simulated_plans import SECONDS, PlannedRun, SensorSetup, simulated_runs
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render.candidate_reasons import why as why_untested
from lacet.services.render.effect_text import not_measured
from lacet.services.render.separation_report import recommendation, run_sentence, tried_words
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Version
from lacet.simulate.engine import engine_library

FAULT = 4.0
"""Ordinary size of a sensor fault, in 1 σ of its sheet's tolerance."""
ORDINARY = 20.0
"""√λ on the present runs of an ordinary size of physics, where that is plausible."""
_NOTHING = 0.05
"""√λ, or separation, below which a manoeuvre shows nothing of the effects."""
_UNTOUCHED = ("gain", "latency", "drift")
"""Tolerances that the sheet has by channel, or that differ from run to run."""


@dataclass(frozen=True)
class Recommended:
    """One manoeuvre: separation, or √λ of a single effect, `now` and `after` a run of the longest duration.

    `seconds` : the shortest duration that suffices, or None; `ordinary` : √λ of a single effect of ordinary size
    after the run; `information` (n, n) on the sizes of the effects pictured after it (`Recommendation.pictured`).
    """

    run: PlannedRun
    now: float
    after: float
    seconds: float | None
    ordinary: float | None
    sentence: str
    information: Array

    @property
    def manoeuvre(self) -> str:
        """Manoeuvre, speed and amplitude in words."""
        return self.run.label


@dataclass(frozen=True)
class Recommendation:
    """Recommended runs: every manoeuvre, the best first.

    `compared` : the effects at the sizes used; `found` : whether each size is estimated from the runs; `each` : present
    √λ of each; `says` : the recommendation in plain sentences; `of` : number of manoeuvres in the library, of which
    `tried` were. `pictured` : places of the effects whose sizes are pictured, the two least apart, and the present
    (n, n) `information` on them.
    """

    compared: tuple[Compared, ...]
    found: tuple[bool, ...]
    now: float
    each: Sequence[float]
    runs: tuple[Recommended, ...]
    says: str
    warnings: tuple[str, ...]
    tried: int
    of: int
    pictured: tuple[int, ...]
    information: Array

    @property
    def complete(self) -> bool:
        """Whether every manoeuvre of the library was tried."""
        return self.tried == self.of

    @property
    def alone(self) -> bool:
        """Whether it is for one effect alone."""
        return len(self.compared) == 1

    @property
    def needed(self) -> float:
        """Separation, or √λ, that suffices."""
        return SHOWS if self.alone else NEEDED


def next_run(
    session: Session, diagnosis: Diagnosis, names: Sequence[str] = (), without: Sequence[str] = (),
    within: float | None = None,
) -> dict[str, Any] | None:  # fmt: skip
    """What `recommend` finds within the usual limits, as plain data (``docs/json.md``).

    Kept in the study where the whole library was tried; `within` as there.
    """
    limits = Limits()
    asked = [list(names), list(without), asdict(limits), SECONDS, kinds((), without)]
    about = [*asked, service_sources("planning", "render"), simulator_sources()]

    def found() -> tuple[dict[str, Any], bool]:
        best = recommend(session, diagnosis, names, limits, without, session.progress, within)
        return {"next": next_result(best) if best else None}, best is None or best.complete

    return session.values.next_run(session.study.version(), about, found)["next"]


def recommend(
    session: Session, diagnosis: Diagnosis, names: Sequence[str] = (), limits: Limits | None = None,
    without: Sequence[str] = (), progress: Progress = silent, within: float | None = None,
) -> Recommendation | None:  # fmt: skip
    """The recommendation of the run that separates effects best, over the library of manoeuvres.

    Parameters
    ----------
    names : effects to distinguish, or the one to be excited; by default the best candidate and those tied with it.
    limits, without : limits of what may be driven, and excluded manoeuvres.
    within : time [s] in which it ends, after one manoeuvre at the earliest: none is begun that would take longer, by
        the longest so far; None tries all. The strongest of each kind come first, and where none of these shows
        anything the others are not tried.

    Returns None when no names are given and nothing is tied. Raises UsageError for effects that are unknown or already
    in the model, and without the simulator.
    """
    version = session.study.version()
    with session.planned(("next", version)):
        return _recommended(session, version, diagnosis, names, limits or Limits(), without, progress, within)


def _recommended(
    session: Session, version: Version, diagnosis: Diagnosis, names: Sequence[str], limits: Limits,
    without: Sequence[str], progress: Progress, within: float | None,
) -> Recommendation | None:  # fmt: skip
    until = np.inf if within is None else time.monotonic() + within
    fitted = session.values.fitted(version)
    wanted = list(dict.fromkeys(names or tied(diagnosis)))
    if not wanted:
        return None
    try:
        engine_library()
    except UsageError as missing:
        raise UsageError(f"runs are predicted by simulation: {missing}") from None
    known = session.study.effects(session.runs.reference(version))
    compared, found = _compared(fitted, known, diagnosis, wanted)
    untested = next((c for c in diagnosis.candidates if [c.key] == wanted and not c.tested), None)
    why = why_untested(diagnosis, untested) if untested else ""
    faults = [fault for e in known.values() if (fault := e.as_fault) and fault.tolerance not in _UNTOUCHED]
    rig = fitted.runs[0].recording.rig
    question = Question(fitted, compared, [(fault, fault.sheet_bound(rig)) for fault in faults])
    progress(ServiceStep(ServiceStage.PRESENT_INFORMATION))
    present = present_runs(question, session.values.floor(version), diagnosis.noise_ratio)
    before = Separations(question, present)
    sized = _sized(before, found)
    question = Question(fitted, sized, question.tolerances)
    before = Separations(question, present)
    pictured = before.closest()
    simulate, plans = _library(session, fitted, limits, without)
    kinds_of_runs = len({plan.manoeuvre.name for plan in plans})
    runs: list[Recommended] = []
    problems: list[str] = []
    tried, shows_nothing, longest = 0, False, 0.0
    for number, plan in enumerate(plans, 1):
        shows_nothing = tried == kinds_of_runs and not any(run.after > _NOTHING for run in runs)
        begun = time.monotonic()
        if shows_nothing or (tried and begun + longest > until):
            break
        progress(ServiceStep(ServiceStage.SIMULATING_RUN, number, len(plans), plan.label))
        planned, failed = simulate(plan)
        problems += failed
        tried += 1
        for one in planned:
            drive = PreparedRun(one.prepared.recording)  # its motion is large, and not needed again
            lacking = next((lack for c in compared if (lack := drive.lacks(c.effect))), None)
            if lacking:
                problems.append(f"left out: {one.label}: {not_measured(lacking)}")
                continue
            weighted = planned_run(question, drive, diagnosis.noise_ratio)
            runs.append(_judged(question, present, before, one, weighted, limits, bool(why), pictured))
        longest = max(longest, time.monotonic() - begun)
    runs.sort(key=lambda r: (r.seconds is None, -r.after))
    now, each = _value(before), _sizes(before)
    says = recommendation(keys_of(question), now, runs[0] if runs else None, not names, why)
    if tried < len(plans):
        says = f"{says} {tried_words(tried, len(plans), shows_nothing)}"
    return Recommendation(
        question.compared, tuple(found), now, each, tuple(runs), says, tuple(problems), tried, len(plans),
        tuple(pictured), before.information(pictured),
    )  # fmt: skip


def tied(diagnosis: Diagnosis) -> list[str]:
    """The best candidate and those that cannot be distinguished from it, or nothing."""
    best = diagnosis.best
    return [best.key, *(key for key, _ in best.ties)] if best and best.ties else []


def untestable(diagnosis: Diagnosis) -> list[str]:
    """The candidates that cannot be tested with these runs."""
    return [c.key for c in diagnosis.candidates if not c.tested]


def keys_of(question: Question) -> list[str]:
    """Keys of the effects compared."""
    return [one.effect.key for one in question.compared]


def _compared(
    fitted: Fit, known: Mapping[str, Effect], diagnosis: Diagnosis, wanted: Sequence[str]
) -> tuple[list[Compared], list[bool]]:
    """The effects at the sizes estimated from the runs, or at ordinary ones."""
    by_key = {c.key: c for c in diagnosis.candidates}
    out: list[Compared] = []
    found: list[bool] = []
    for key in wanted:
        effect = find_effect(key, dict(known))
        if key in fitted.model:
            raise UsageError(f"{key} is in the model: only effects that are not can be told apart")
        if not effect.parameters:
            raise UsageError(f"{key} has no parameters: the measurements hold it already")
        for run in fitted.runs:
            if lacking := run.lacks(effect):
                raise UsageError(f"{key} cannot be computed on these runs: {not_measured(lacking)}")
        c = by_key.get(key)
        real = c is not None and c.answer in (Answer.MISSING, Answer.UNDECIDED) and bool(c.values)
        if c is not None and real:
            effect, values = replace(effect, shape=dict(c.shape)), np.array(c.values)
        else:
            effect = replace(effect, shape=_middle(effect, c))
            values = ordinary(fitted, effect)
        out.append(Compared(effect, values))
        found.append(real)
    return out, found


def _middle(effect: Effect, c: Candidate | None) -> dict[str, float]:
    """Shape constants with the best fit in the ranking, or those in the middle of their grids."""
    middle = {name: values[len(values) // 2] for name, values in effect.grids.items()}
    return {**middle, **effect.shape, **(c.shape if c else {})}


def _sized(before: Separations, found: Sequence[bool]) -> list[Compared]:
    """The effects, those of plausible size reduced to a √λ of `ORDINARY` at present."""
    out: list[Compared] = []
    for i, (c, real) in enumerate(zip(before.question.compared, found, strict=True)):
        size = before.size(i)
        share = 1.0 if real or len(found) == 1 or size <= ORDINARY else ORDINARY / size
        out.append(replace(c, values=share * c.values))
    return out


def ordinary(fitted: Fit, effect: Effect) -> Array:
    """(p,) ordinary sizes: of physics 1 σ of the prior, of a sensor fault four times its tolerance."""
    sizes = np.array([q.prior * (-1.0 if q.expect == "negative" else 1.0) for q in effect.parameters])
    if (tolerance := effect.sheet_bound(fitted.runs[0].recording.rig)) > 0.0:
        return np.minimum(sizes, FAULT * tolerance)
    return sizes


Simulate = Callable[[Plan], tuple[list[PlannedRun], list[str]]]
"""Motion of a plan, or why it could not be simulated."""


def _library(session: Session, fitted: Fit, limits: Limits, without: Sequence[str]) -> tuple[Simulate, Sequence[Plan]]:
    """The library, the strongest of each kind of manoeuvre first, and what simulates one of it."""
    loaded = session.runs.loaded
    like = planned_car(loaded.vehicle, known_values(loaded.vehicle, fitted, loaded.reference))
    plans = library(like.car, limits, kinds((), without), SECONDS)
    channels = frozenset(name for run in loaded.prepared for name in run.recording.rates)
    sensors = SensorSetup(loaded.rig, session.study.filters, loaded.prepared[0].recording.rates, channels)
    rank = {id(plan): place for kind in _by_kind(plans) for place, plan in enumerate(reversed(kind))}
    folder = session.study.folder / "planned"

    def simulate(plan: Plan) -> tuple[list[PlannedRun], list[str]]:
        return simulated_runs([plan], like, loaded.vehicle, sensors, limits, folder, silent)

    return simulate, sorted(plans, key=lambda plan: rank[id(plan)])


def _by_kind(plans: Sequence[Plan]) -> list[list[Plan]]:
    """The plans by manoeuvre, in the order of the library: the strongest last."""
    found: dict[str, list[Plan]] = {}
    for plan in plans:
        found.setdefault(plan.manoeuvre.name, []).append(plan)
    return list(found.values())


def _judged(
    question: Question, present: Present, before: Separations, run: PlannedRun, weighted: WeightedRun, limits: Limits,
    blocked: bool, pictured: Sequence[int],
) -> Recommended:  # fmt: skip
    """One manoeuvre of the longest duration, and the shortest duration that suffices."""
    after = Separations(question, present, weighted.lasting(limits.duration))
    value, now = _value(after), _value(before)
    needed = SHOWS if len(question.compared) == 1 else NEEDED
    seconds = None
    if value >= needed and (now < needed or blocked):
        tried = [*(d for d in DURATIONS if d < limits.duration), limits.duration]
        enough = (d for d in tried if _value(Separations(question, present, weighted.lasting(d))) >= needed)
        seconds = next(enough, limits.duration)
    ordinary = _alone(after, question.compared[0].values) if len(question.compared) == 1 else None
    sentence = run_sentence(keys_of(question), run.label, seconds or limits.duration, now, value, limits.duration)
    return Recommended(run, now, value, seconds, ordinary, sentence, after.information(pictured))


def _value(separations: Separations) -> float:
    """√λ of a single effect; of several the smallest separation of two."""
    return _sizes(separations)[0] if len(separations.question.compared) == 1 else separations.least()


def _sizes(separations: Separations) -> list[float]:
    """√λ of each effect; of a single one at its largest plausible size."""
    compared = separations.question.compared
    if len(compared) == 1:
        return [_alone(separations, np.array([q.largest for q in compared[0].effect.parameters]))]
    return [separations.size(i) for i in range(len(compared))]


def _alone(separations: Separations, sizes: Array) -> float:
    """√λ of the first effect, of its parameter with the largest."""
    return max((separations.size(0, values) for values in np.diag(sizes)), default=0.0)


def next_result(found: Recommendation) -> dict[str, Any]:
    """A recommendation as plain data (``docs/json.md``, ``diagnose``)."""

    def smallest(stands: float, c: Compared) -> float | None:
        single = found.alone and len(c.effect.parameters) == 1 and stands > 0.0
        return c.effect.parameters[0].largest * SHOWS / stands if single else None

    return plain(
        {
            "says": found.says,
            "quantity": "size" if found.alone else "separation",
            "needed": found.needed,
            "now": found.now,
            "effects": [
                {
                    "effect": c.effect.key,
                    "shape": dict(c.effect.shape),
                    "values": list(c.values),
                    "largest": [q.largest for q in c.effect.parameters],
                    "units": [q.unit for q in c.effect.parameters],
                    "found": real,
                    "size": size,
                }
                for c, real, size in zip(found.compared, found.found, found.each, strict=True)
            ],
            "runs": [
                {
                    "run": one.run.label,
                    "manoeuvre": one.run.manoeuvre,
                    "settings": {key: value for key, value in one.run.settings.items() if key != "duration"},
                    "after": one.after,
                    "seconds": one.seconds,
                    "wrong_pick": None if found.alone else wrong_pick(one.after),
                    "ordinary": one.ordinary,
                    "smallest": smallest(one.after, found.compared[0]),
                    "says": one.sentence,
                }
                for one in found.runs
            ],
            "warnings": list(found.warnings),
            "tried": found.tried,
            "of": found.of,
            "picture": {
                "effects": [found.compared[i].effect.key for i in found.pictured],
                "now": region(found.information),
                "after": region(found.runs[0].information) if found.runs else None,
            },
        }
    )
