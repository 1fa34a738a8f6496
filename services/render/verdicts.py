"""Sentences of a ranking: the verdict of a diagnosis, and the reason of each candidate's answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from lacet.identify.effects.base import Effect, Implausible, Parameter
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.selection.candidate import Answer, Candidate, Reason, is_significant
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.diagnosis import Diagnosis, Grounds
from lacet.identify.selection.joint.free_constants import least_gain
from lacet.identify.selection.laws.formulas import Formula, Law
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import ToleranceUse
from lacet.identify.validation.score import fails
from lacet.services.render import tables
from lacet.services.render.effect_text import needed, not_measured
from lacet.services.render.intervals import with_interval
from lacet.services.render.known_scale import weak_because
from lacet.services.render.row_needs import shortened
from lacet.services.render.shape_constants import constants_text

K = TypeVar("K")
NOT_NAMED = (Reason.PART_OF_REST, Reason.TIED)
"""Reasons why an effect of the set found is no name beside an unlisted cause."""
_MOST = 0.5
"""Part of the error above which an effect explains most of it."""


def says(d: Diagnosis) -> str:
    """The verdict of a diagnosis in plain sentences with numbers."""
    if d.found:
        text = _missing(d) if len(d.found) == 1 else _several(d)
        return f"{text}{_without_tables(d)}{_remaining(d)}{_in_part(d)}{_small(d)}{_maybe(d)}"
    if d.unlisted:
        return f"{_unlisted(d)}{_without_tables(d)}{_in_part(d)}{_maybe(d)}"
    return _nothing(d)


def why(d: Diagnosis, c: Candidate) -> str:
    """The reason of a candidate's answer, in plain sentences with numbers."""
    found = next((one for one in d.found if one.key == c.key), None)
    if found is not None and c.total is not None and not c.open_at:
        return f"{_takes(c)} {_sentence(_as_one(c.total))}; {_chance(c, False, d.draws)}.{_rivals(d, c)}"
    if found is not None:
        return f"{reason_text(c, d.effects.get(c.key), d.draws)}{_rivals(d, c)}"
    text = reason_text(c, d.effects.get(c.key), d.draws)
    if c.answer is not Answer.UNDECIDED or c.reason in (*NOT_NAMED, Reason.CONFOUNDED, Reason.NO_TABLE):
        return text
    if c.stands_for:
        return f"{text} It cannot be told apart from {c.stands_for}."
    return (
        f"{text} It is judged again once {d.found[0].key} is added." if d.found else f"{text} It explains too little."
    )


def reason_text(c: Candidate, effect: Effect | None, draws: int) -> str:
    """The reason of a candidate's answer; `draws` simulated runs are behind its p."""
    if c.reason is None:
        return ""
    if c.reason is Reason.NOT_COMPUTABLE or effect is None:
        return f"Cannot be tested: {not_measured(c.lacks)}."
    if c.answer is Answer.NOT_TESTABLE:
        return f"Cannot be tested: {_untestable(c)}. What shows it: {effect.shown_by}."
    takes, chance = _takes(c), _chance(c, effect.as_fault is not None, draws)
    match c.reason:
        case Reason.CHANCE:
            return f"{takes} Not needed: {chance}, more than {SELECTION.level(draws):.2g}."
        case Reason.LITTLE:
            least = 100 * SELECTION.least_gain
            return f"{takes} Smaller than asked for: less than {least:g} % of any row, though {chance}."
        case Reason.INEXACT:
            return (
                f"{takes} Smaller than asked for: beside the effects found it takes no more than their laws may be "
                f"inexact ({100 * SELECTION.law_inexactness:g} % of their force)."
            )
        case Reason.STANDS_IN:
            return f"{takes} It stands in for {c.stands_for}: with that in the model chance does as well."
        case Reason.CONFOUNDED:
            return f"{takes} Undecided: an error of these tables could be a part of {c.stands_for}."
        case Reason.IMPLAUSIBLE:
            return f"{takes} Implausible size: {_implausible(c, effect)}; {_instead(effect)} ({chance})."
        case Reason.PART_OF_REST:
            return (
                f"{takes} Undecided: at least as much as it explains remains unlisted in its rows; it may be a part of "
                f"that cause ({chance})."
            )
        case Reason.TIED:
            return f"{takes} Undecided beside a cause that is not listed: {_tied(c)} cannot be ruled out in its place."
        case Reason.NO_TABLE:
            return f"{takes} Undecided: with an unknown bench table of its axle in the fit it need not be there."
        case _ if c.answer is Answer.MISSING and c.open_at:
            return f"{takes} Its size is {open_because(c.open_at)}; {chance}."
        case _ if c.answer is Answer.MISSING:
            return f"{takes} Its size is {sizes(c, effect)} (95 %); {chance}."
        case _:
            return (
                f"{takes} Alone its size would be about {_about(c, effect)}, which other missing effects "
                f"may still move; {chance}."
            )


def _about(c: Candidate, effect: Effect) -> str:
    """A candidate's parameters without intervals: estimated beside a model that lacks others."""
    parts = [f"{last_name(q)} = {value:.3g} {q.unit}" for q, value in zip(effect.parameters, c.values, strict=True)]
    return ", ".join([*parts, *constants_text(effect, c.shape)])


def _rivals(d: Diagnosis, c: Candidate) -> str:
    """What could be in the place of an effect found, or by how much it explains more than its best rival."""
    if c.ties:
        return f" It cannot be told apart from {', '.join(key for key, _ in c.ties)} on these runs.{_wrong_tables(c)}"
    if c.margin is None:
        return _wrong_tables(c)
    margin, rival = f"{three_digits(c.margin)} weighted squares", d.effects.get(c.rival)
    if rival is not None and c.margin < -least_gain(d.effects[c.key], rival):
        lead = (
            f" {c.rival}, the best in its place, explains as much but for {margin}, with more sizes or constants: the "
            f"simpler law is named."
        )
    else:
        lead = f" It explains {margin} more than {c.rival}, the best in its place."
    return f"{lead}{_wrong_tables(c)}"


def _wrong_tables(c: Candidate) -> str:
    return f" A part of it may be {_tables(c)}." if c.confounded else ""


def _tables(c: Candidate) -> str:
    """Bench tables whose error could be a part of an effect found: how far off they may be, and how much of it."""
    return ", ".join(
        f"{one.key} ({100 * one.low:+.0f} to {100 * one.high:+.0f} % here; up to {100 * one.share:.0f} % of it)"
        for one in c.confounded
    )


def sizes(c: Candidate, effect: Effect) -> str:
    """A candidate's parameters with 95 % intervals, its shape constants, and what is unusual about them."""
    each = list(zip(effect.parameters, c.values, c.interval, strict=True))
    parts = [f"{last_name(q)} = {with_interval(value, half)} {q.unit}" for q, value, half in each]
    unusual = [
        last_name(q)
        for q, value, half in each
        if (q.expect == "positive" and value + half < 0.0) or (q.expect == "negative" and value - half > 0.0)
    ]
    unknown = [last_name(q) for q, value, half in each if half >= abs(value)]
    notes = [f"the sign of {', '.join(unusual)} is not the usual one"] if unusual else []
    if unknown and c.answer is Answer.MISSING:
        others = "shape constants and sensor tolerances" if c.shape else "sensor tolerances"
        notes.append(f"it acts, but the interval of {', '.join(unknown)} holds zero, as {others} may be others")
    out = ", ".join([*parts, *constants_text(effect, c.shape)])
    return f"{out} ({'; '.join(notes)})" if notes else out


def unit_of(c: Candidate) -> str:
    """Unit of a candidate's `gain_rms`."""
    return c.rows[0].unit if c.rows else "N"


# -- the reason of one candidate's answer ------------------------------------------------------------------------------


def short_reason(c: Candidate) -> str:
    """Why a candidate cannot be tested, in a few words; an empty string where it was tested."""
    if c.answer is not Answer.NOT_TESTABLE:
        return ""
    match c.reason:
        case Reason.NOT_COMPUTABLE:
            return f"needs: {needed(c.lacks)}"
        case Reason.NEVER_ACTS:
            return "never acts in the rows of these runs"
        case Reason.ROWS_ABSENT:
            return _row_needs(c)
        case Reason.NOT_RECORDED:
            return "these runs have none of its channels"
        case Reason.IN_THE_MODEL:
            return "the model explains all it does"
        case Reason.FEW_BLOCKS:
            return "acts in too few seconds"
        case Reason.SMALL:
            return f"hidden by {_absorbing(c)[0][0]}" if c.absorbed else "too small to stand out"
        case _:
            return "what it follows is mostly noise"


def _row_needs(c: Candidate) -> str:
    """What a candidate's row lacks that the runs do not form."""
    channels = [one for one in c.lacks.needs if isinstance(one, str)] if c.lacks else []
    return f"needs: {', '.join(shortened(channels))}"


def _untestable(c: Candidate) -> str:
    match c.reason:
        case Reason.NEVER_ACTS:
            return "it never acts on these runs"
        case Reason.ROWS_ABSENT:
            return f"these runs form no row that it acts on; its first {_row_needs(c)}"
        case Reason.NOT_RECORDED:
            return "these runs have none of its channels"
        case Reason.IN_THE_MODEL:
            return "the model already explains all it does on these runs"
        case Reason.FEW_BLOCKS:
            return (
                f"it acts in only {c.coverage:.1f} blocks of {SELECTION.block_seconds:g} s "
                f"(at least {SELECTION.least_coverage:g} needed)"
            )
        case Reason.SMALL:
            by = ", ".join(f"{name} {100 * share:.0f} %" for name, share in _absorbing(c)[: SELECTION.most_absorbing])
            return (
                f"even at its largest plausible size it would stand out by only {c.size:.1f} times its noise "
                f"(at least {SELECTION.least_size:g} needed){f', most of it absorbed by {by}' if by else ''}"
            )
        case _:
            return f"{100 * c.noise_part:.0f} % of what it would follow is noise of the sensors"


def _absorbing(c: Candidate) -> list[tuple[str, float]]:
    """What absorbs a candidate, largest share first: a sensor fault's own entry of the sheet has its key."""
    return [("its own tolerance" if name == c.key else name, share) for name, share in c.absorbed]


def _takes(c: Candidate) -> str:
    if c.gain > 0.0:
        return (
            f"Added to the model it takes {c.gain_rms:.3g} {unit_of(c)} RMS off {_listed(c.rows)} "
            f"({100 * c.gain:.3g} % of what they leave) in parts of the runs it was not fitted to."
        )
    if c.answer is Answer.MISSING:
        return "Without it these runs fit only if the sensor sheet is wrong."
    return f"Added to the model it takes nothing off {_listed(c.rows)} in parts of the runs it was not fitted to."


def _chance(c: Candidate, fault: bool, draws: int) -> str:
    alone = "noise and the sheet's tolerances" if fault else "noise alone"
    if c.p <= 1.0 / (draws + 1) + SELECTION.smallest_p_slack:
        return f"{alone} never did as well in {draws} simulated runs (p = {c.p:.2g})"
    return f"{alone} {'do' if fault else 'does'} as well with p = {c.p:.2g}"


def _implausible(c: Candidate, effect: Effect) -> str:
    wrong = effect.implausible(c.values, c.interval)
    if wrong is None:
        return ""
    q = wrong.quantity
    value, half = 0.5 * (wrong.low + wrong.high), 0.5 * (wrong.high - wrong.low)
    size = with_interval(value, half) if math.isfinite(half) else _beyond(wrong)
    return f"{last_name(q)} would be {size} {q.unit} (plausible: {q.low:g} to {q.high:g})"


def _instead(effect: Effect) -> str:
    """What to make of an effect of implausible size."""
    return "look at this instrument first" if effect.as_fault else "no car has that, and something else looks like it"


def _beyond(wrong: Implausible) -> str:
    return f"above {wrong.low:.3g}" if math.isfinite(wrong.low) else f"below {wrong.high:.3g}"


# -- the verdict -------------------------------------------------------------------------------------------------------


def _missing(d: Diagnosis) -> str:
    (c,) = d.found
    return f"{c.key} is missing. {why(d, c)}"


def _as_one(total: SumOfPlaces) -> str:
    """The sum of a law's sizes at places that the runs do not distinguish, and what would."""
    value = f"{with_interval(total.value, total.half)} {total.unit}"
    return (
        f"the sum of {total.parameter} over {' and '.join(total.keys)} is {value} (95 %), and these runs do not show "
        f"how it is split; a run in which these places are loaded apart from each other would"
    )


def open_because(axles: Sequence[str]) -> str:
    """Why sizes of effects found at these axles are not given."""
    return f"open: the bench table of the {_axles(axles)} is not known, and something unlisted remains there"


def _axles(axles: Sequence[str]) -> str:
    return " and ".join(f"{axle} axle" for axle in axles)


def _open_sizes(d: Diagnosis) -> str:
    """The effects found whose sizes are open, and why, by the axles that leave them open."""
    by_axles = dict.fromkeys(c.open_at for c in d.found if c.open_at)
    keys = {axles: [c.key for c in d.found if c.open_at == axles] for axles in by_axles}
    return "".join(f" Of {' and '.join(keys[axles])} the size is {open_because(axles)}." for axles in by_axles)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _each(d: Diagnosis) -> str:
    """Sizes of the effects found that are known; of those that are known as a sum, the sum once."""
    known = [c for c in d.found if not c.open_at]
    parts = [f"{c.key}: {sizes(c, d.effects[c.key])}" for c in known if c.total is None]
    sums = dict.fromkeys(c.total for c in known if c.total is not None)
    return "; ".join([*parts, *(_as_one(total) for total in sums)])


def _several(d: Diagnosis) -> str:
    *first, last = [c.key for c in d.found]
    each = _each(d)
    share = f" they explain {100 * d.explained:.0f} % of what is above the noise floor in {_listed(d.failing)}"
    tied = "".join(
        f" {c.key} cannot be told apart from {', '.join(key for key, _ in c.ties)} on these runs."
        for c in d.found
        if c.ties
    )
    tied += "".join(f" Of {c.key} a part may be {_tables(c)}." for c in d.found if c.confounded)
    whole = all(c.total is not None and len(c.total.keys) == len(d.found) for c in d.found)
    as_one = " as one, or one of them" if whole else ""
    together = f": added together{share}" if d.failing else ""
    sized = f" Their sizes, from a fit with all of them (95 %, tolerances of the sensors included): {each}."
    return f"{', '.join(first)} and {last} are missing{as_one}{together}.{sized if each else ''}{_open_sizes(d)}{tied}"


def _remaining(d: Diagnosis) -> str:
    """What remains beside the effects found; empty where nothing is."""
    grounds, out = d.grounds, ""
    if grounds.not_constant:
        out += f" {_not_constant(d)}"
    if grounds.tolerance_exceeded:
        out += f" {_tolerance_exceeded(grounds)}"
    out = _with_law(f"{out}{_remaining_rows(d)}", d.formulas)
    if d.described and any(c.values for c in d.found):
        laws = " and ".join(repr(law) for law in d.described)
        but = " but sums over places" if any(c.total is not None for c in d.found) else ""
        out += (
            f" The sizes above{but} are from a fit that has {laws}, too; without it the cause that is not listed would "
            f"move them."
        )
    return out


def _remaining_rows(d: Diagnosis) -> str:
    """The rows in which something unlisted remains beside the effects found."""
    rows, ratios = d.unlisted_rows, d.grounds.ratios
    if not rows:
        return ""
    stand_ins = [c.key for c in d.candidates if c.reason is Reason.PART_OF_REST and not {*rows}.isdisjoint(c.rows)]
    if stand_ins and d.formulas and not any(fails(ratios[row]) for row in rows):
        return (
            f" And something that is not listed acts in {_listed(list(rows))}: with {_listed(stand_ins)} in its place "
            f"hardly more than noise remains, but a law of no catalogue explains clearly more."
        )
    return (
        f" And something that is not listed remains in {_times_floor(d)} (÷ floor, with all these in the model)."
        f"{_on_assumptions(d)}"
    )


def _times_floor(d: Diagnosis) -> str:
    """The rows in which something unlisted remains, with their rest ÷ floor."""
    return _listed([f"{row} at {d.grounds.ratios[row]:.2f}" for row in d.unlisted_rows])


def _without_tables(d: Diagnosis) -> str:
    """What the lack of bench tables means for the names, where wheels are found to move or turn with the travel."""
    lacking, out = d.without_tables, ""
    sure = [axle for axle in lacking.axles if axle not in lacking.unsure]
    known = [axle for axle in lacking.axles if axle not in lacking.unlisted]
    lead = " The vehicle file has no bench table of the"
    if sure:
        out += f"{lead} {_axles(sure)}: its wheels are taken to move straight up, and these runs show that they do not."
    if lacking.unsure:
        out += (
            f"{lead} {_axles(lacking.unsure)}: its wheels are taken to move straight up, and they may not. What speaks "
            f"for that changes from run to run, or may be a part of what is not listed."
        )
    if known and d.found:
        out += f" Sizes of other effects at the {_axles(known)} are from a fit with an unknown table."
    if d.instead_of_tables:
        names = ", ".join(d.instead_of_tables)
        out += f" Not counted as found, since an unknown table may explain as much: {names}."
    return f"{out} With a bench table in the vehicle file a diagnosis can decide." if out else ""


def _beyond_plausible(d: Diagnosis) -> str:
    """What alone explains more than all other effects, and more than half, at a size that nothing has."""
    tested = [c for c in d.candidates if c.tested]
    best = max(tested, key=lambda c: c.gain, default=None)
    if best is None or best.reason is not Reason.IMPLAUSIBLE or best.gain <= _MOST:
        return ""
    effect = d.effects[best.key]
    share = f"{100 * best.gain:.0f} % of what {_listed(best.rows)} leave"
    return (
        f" {best.key} would explain {share}, at an implausible size: {_implausible(best, effect)}; {_instead(effect)}."
    )


def _in_part(d: Diagnosis) -> str:
    """Listed effects that explain part of the error and are not named beside an unlisted cause."""
    parts = [c for c in d.candidates if c.reason in NOT_NAMED and c.key not in d.grounds.not_constant]
    if not parts:
        return ""
    each = "; ".join(f"{c.key}{' or in its place ' if c.ties else ''}{_tied(c)}" for c in parts)
    return f" These explain a part, and may be a part of what is not listed: {each}. None of them is counted as found."


def _small(d: Diagnosis) -> str:
    """Rests that are less than the user's effect size, or than the laws found may be inexact."""
    if not d.small_rows or d.grounds.not_constant:
        return ""
    forces = d.grounds.forces
    rows = ", ".join(f"{row} {forces[row][0]:.2g} {row.unit} RMS" for row in d.small_rows[: SELECTION.most_reported])
    return (
        f" What remains above the floor is small: {rows}, less than {100 * SELECTION.effect_size:g} % of the row or "
        f"within the inexactness allowed to the laws found."
    )


def _maybe(d: Diagnosis) -> str:
    """Listed effects that cannot be tested and may be the cause."""
    if not d.maybe:
        return ""
    shown = "; ".join(
        f"{key} ({d.effects[key].shown_by})" if key in d.effects else key for key in d.maybe[: SELECTION.most_reported]
    )
    return (
        f" These runs cannot test {shown}: as far as they show it may be the cause. What shows it says "
        f"(lacet diagnose --next {d.maybe[0]})."
    )


def _unlisted(d: Diagnosis) -> str:
    grounds = d.grounds
    if grounds.tolerance_exceeded:
        return _with_law(_tolerance_exceeded(grounds), d.formulas)
    if grounds.not_constant and not d.unlisted_rows:
        return _with_law(_not_constant(d), d.formulas)
    if not d.unlisted_rows:
        return "Something is missing, and these runs do not show what: the effects found, or what a bench table says."
    text = (
        f"The model fails ({_times_floor(d)} times the floor) and the cause is not listed: no effect of the catalogue "
        f"explains it with a plausible size, beyond chance, and what remains is not noise."
    )
    text += f" {_not_constant(d)}" if grounds.not_constant else ""
    text += f"{_on_assumptions(d)}{_beyond_plausible(d)}"
    if not d.formulas:
        return f"{text} No law of the measured states describes it: it may depend on something that is not measured."
    return _with_law(text, d.formulas)


def _on_assumptions(d: Diagnosis) -> str:
    """Unlisted rows that stand on channels which are not measured: what remains may be no effect."""
    assumed = d.grounds.assumed
    if not assumed:
        return ""
    channels = ", ".join(shortened(dict.fromkeys(chain.from_iterable(assumed.values()))))
    return (
        f" What remains in {_listed(list(assumed))} may be the error of assumed channels ({channels}), and no missing "
        f"effect: measure them to be sure."
    )


def _tolerance_exceeded(grounds: Grounds) -> str:
    use = grounds.tolerances
    either = "Either several instruments are off (calibrate them, or write their true tolerances into the rig file)"
    if any(name.startswith("assumed ") for name in use.sizes):
        either += ", or what is assumed of the car is (state it better in the vehicle file)"
    scale = grounds.scale
    if scale is not None and scale.weak:
        either += f", or it is the scale, which is hardly known ({weak_because(scale)}), nor then these tolerances"
    return (
        f"The model fits these runs only if the sensor sheet is wrong (in tolerances: {_off(use.sizes)}). "
        f"The squares of all but latencies sum to {use.squares:.0f}, in simulated runs that lack nothing to "
        f"{np.mean(use.null):.0f} and never above {np.max(use.null):.0f}.{_free_entries(use)} {either}, or the "
        "cause is not listed."
    )


def _free_entries(use: ToleranceUse) -> str:
    """The entries of the sheet of which one alone would have to be wrong; empty where several would."""
    shown = [
        f"{one.name} by {with_interval(one.size, SELECTION.interval_quantile * one.spread, '+')} tolerances (the "
        f"squares of the others then sum to {one.squares:.0f})"
        for one in use.free[: SELECTION.most_reported]
    ]
    if not shown:
        return ""
    return f" If one entry alone is wrong it is {' or '.join(shown)}: look at this first."


def _not_constant(d: Diagnosis) -> str:
    """Effects that would have to be another law in each run: something changes with what no channel says."""
    tests = d.grounds.not_constant
    each = " and ".join(f"{key} ({_apart(d.effects[key], runs)})" for key, runs in tests.items())
    one = len(tests) == 1
    rows = list(dict.fromkeys(row for c in d.candidates if c.key in tests for row in c.rows))
    where = f" in {_listed(rows)}" if rows else ""
    return (
        f"The model lacks something{where} that is not the same in all runs, and the cause is not listed: {each} "
        f"{'explains' if one else 'explain'} most, but {'it' if one else 'each'} would have to be another law in each "
        f"run (simulated runs differ as much with p = {max(runs.p for runs in tests.values()):.2g}). What changes from "
        f"run to run, as a temperature or a load does, may be the cause."
    )


def _apart(effect: Effect, runs: ParameterConstancy) -> str:
    """The parameter of an effect that differs most between two runs."""
    k, *two = runs.farthest_apart
    q = effect.parameters[k]
    values = " and ".join(
        f"{with_interval(runs.values[r][k], SELECTION.interval_quantile * runs.spread[r][k])} {q.unit} in {r}"
        for r in two
    )
    by, sigma = runs.difference(k, *two)
    apart = with_interval(abs(by), SELECTION.interval_quantile * sigma)
    return f"{q.name} is {values}, a difference of {apart} {q.unit}"


def _with_law(text: str, formulas: Sequence[Formula]) -> str:
    if not formulas:
        return text
    best = formulas[0]
    text = (
        f"{text} What comes nearest of simple laws is '{best.text}'{_listed_as(best.law)}, which explains "
        f"{100 * best.law.explained:.0f} % of what is above the floor in {', '.join(best.rows)}, in parts of the runs "
        f"it was not fitted to: a description, not a cause."
    )
    if others := [_point(law) for law in best.front if law != best.law]:
        text += f" Simpler or longer: {'; '.join(others)}."
    if elsewhere := [f"'{one.text}' ({100 * one.law.explained:.0f} %)" for one in formulas[1:]]:
        text += f" And at other places: {'; '.join(elsewhere[: SELECTION.most_reported])}."
    return text


def _point(law: Law) -> str:
    """A law of a Pareto front, how many terms and constants it has, and what it explains."""
    many = f"{law.terms} term{'s' if law.terms > 1 else ''}"
    if law.constants:
        many += f", {law.constants} constant{'s' if law.constants > 1 else ''}"
    return f"'{law.text}'{_listed_as(law)} ({many}: {100 * law.explained:.0f} %)"


def _listed_as(law: Law) -> str:
    """The catalogue's names for a law, or for terms of it."""
    if not law.listed:
        return ""
    part = "which is" if law.terms == 1 else "of which a term is"
    return f", {part} {' or '.join(law.listed[: SELECTION.most_reported])} of the catalogue on these runs"


def _nothing(d: Diagnosis) -> str:
    ratios, ranked = d.grounds.ratios, [c for c in d.candidates if c.tested]
    worst = max(ratios, key=lambda row: ratios[row])
    best = min(ranked, key=lambda c: c.p, default=None)
    least = best.p if best else 1.0
    if best and least <= SELECTION.level(d.draws):
        chance = f"and the best of {len(ranked)} candidates, {best.key} (p = {least:.2g}), is {best.answer}"
    else:
        chance = f"and chance does as well as the best of {len(ranked)} candidates with p = {least:.2g}"
    text = (
        f"Nothing is missing that these runs can show: within the sensor sheet's tolerances the row farthest above "
        f"its noise floor is {worst}, at {ratios[worst]:.2f} times, {chance}. {len(d.candidates) - len(ranked)} more "
        f"could not be tested on these runs."
    )
    text += _by_tolerances(d) + _small(d)
    if small := [c for c in ranked if is_significant(c, d.effects[c.key], d.draws)]:
        listed = ", ".join(
            f"{c.key} {c.gain_rms:.3g} {unit_of(c)} RMS, p = {c.p:.2g}" for c in small[: SELECTION.most_reported]
        )
        text += (
            f" Chance does not explain all: {listed}. That is less than {100 * SELECTION.least_gain:g} % of any row; "
            f"add it if so little matters to you."
        )
    noisy = [f"{row} {x:.1f} times" for row, x in d.noise_ratio.items() if x > SELECTION.reported_noise_ratio]
    if noisy:
        text += f" Sensors are noisier than their sheet says ({', '.join(noisy)}): lacet check shows which."
    if off := _off(d.grounds.tolerances.sizes, SELECTION.reported_tolerances):
        text += (
            f" For that the sensor sheet would have to be off by more than {SELECTION.reported_tolerances:g} of its "
            f"tolerances ({off}): look at these instruments (lacet check measures latencies)."
        )
    return text


def _by_tolerances(d: Diagnosis) -> str:
    """What the sensors' tolerances explain of the worst row; empty where it is little.

    The error ÷ floor of a version is that of the runs as recorded, and stays there with nothing missing.
    """
    row, off = row_of_tolerances(d.ratios, d.grounds.ratios), _off(d.grounds.tolerances.sizes)
    if row is None:
        return ""
    late = "latency" in off
    remedy = " (lacet check --only latency --write-rig FILE makes a rig file without these latencies)" if late else ""
    return (
        f" In the runs as recorded {row} is at {d.ratios[row]:.2f}, and at {d.grounds.ratios[row]:.2f} without what "
        f"the sensors may be off by (in tolerances: {off}): correct the rig file and that part of the error goes, "
        f"too{remedy}."
    )


def row_of_tolerances(recorded: Mapping[K, float], tolerated: Mapping[K, float]) -> K | None:
    """The row of which is said what the sensors' tolerances explain: the worst one, if it is far above its floor.

    Parameters
    ----------
    recorded, tolerated : row → residual ÷ floor of the runs as recorded, and without what the sensors may be off by.
    """
    row = max(recorded, key=lambda row: recorded[row], default=None)
    if row is None or row not in tolerated or recorded[row] < SELECTION.reported_row_ratio:
        return None
    return row


def _off(tolerances: Mapping[str, float], least: float = 0.0) -> str:
    """Entries of the sensor sheet that are farthest off, in tolerances."""
    most = sorted(tolerances.items(), key=lambda one: -abs(one[1]))[: SELECTION.most_reported]
    return ", ".join(f"{name} {size:+.1f}" for name, size in most if abs(size) > least)


def _tied(c: Candidate) -> str:
    return _listed([key for key, _ in c.ties], "others")


def _listed(names: Sequence[str], kind: str = "rows") -> str:
    most = SELECTION.most_reported
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more {kind}"


def last_name(q: Parameter) -> str:
    """A parameter's name without that of its effect."""
    return q.name.rsplit(".", 1)[-1]


def three_digits(value: float) -> str:
    """A number to three digits, without a power of ten."""
    return f"{float(f'{value:.3g}'):.0f}" if value >= 100.0 else f"{value:.3g}"


def print_diagnosis(result: Mapping[str, Any], most: int, why: bool) -> None:
    """Print the verdict and the ranking."""
    print(f"{result['says']}\n\n{tables.candidates(result, most)}\n", flush=True)
    if why:
        for c in result["candidates"]:
            print(f"  {c['effect']}: {c['why']}")


def print_change(item: Mapping[str, Any], what: str = "Added") -> None:
    """Print the change of the error in one line."""
    used, held = item["used"], item["held"]
    text = f"{what} {item['effect']}: error ÷ floor {used['before']:.2f} → {used['after']:.2f} on the runs used"
    if held["before"] == held["before"]:
        text += f", {held['before']:.2f} → {held['after']:.2f} on those held out"
    print(f"{text}.{_helps_nobody(item, what)}\n", flush=True)


def change_sentence(item: Mapping[str, Any], what: str = "Added") -> str:
    """The change of the error on the effect's own row, in a sentence for the page."""
    row = item["row"]
    own = f": {row['row']} {row['before']:.2f} → {row['after']:.2f} times its floor" if row else ""
    return f"{what} {item['effect']}{own}.{_helps_nobody(item, what)}"


def _helps_nobody(item: Mapping[str, Any], what: str) -> str:
    return " It helps no row: undo it." if what == "Added" and not item["helps"] else ""
