"""Sentences of one candidate of a ranking: the reason of its answer, its sizes, and what could be in its place."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lacet.identify.effects.base import Effect, Implausible, Parameter
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.free_constants import least_gain
from lacet.identify.selection.settings import SELECTION
from lacet.services.render.effect_text import needed, not_measured
from lacet.services.render.intervals import with_interval
from lacet.services.render.row_needs import shortened
from lacet.services.render.shape_constants import constants_text

NOT_NAMED = (Reason.PART_OF_REST, Reason.TIED)
"""Reasons why an effect of the set found is no name beside an unlisted cause."""


def why(d: Diagnosis, c: Candidate) -> str:
    """The reason of a candidate's answer, in plain sentences with numbers."""
    found = next((one for one in d.found if one.key == c.key), None)
    if found is not None and c.total is not None and not c.open_at:
        return f"{_takes(c)} {_sentence(as_one(c.total))}; {_chance(c, False, d.draws)}.{_rivals(d, c)}"
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
            return f"{takes} Implausible size: {implausible_size(c, effect)}; {instead_of(effect)} ({chance})."
        case Reason.PART_OF_REST:
            return (
                f"{takes} Undecided: at least as much as it explains remains unlisted in its rows; it may be a part of "
                f"that cause ({chance})."
            )
        case Reason.ASSUMED:
            return (
                f"{takes} Undecided: within the tolerances of assumed channels its size may be zero, and rows that "
                f"these hardly move do not show it ({chance})."
            )
        case Reason.TIED:
            return (
                f"{takes} Undecided beside a cause that is not listed: {others_of(c)} cannot be ruled out in its place."
            )
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
    return f" A part of it may be {doubtful_tables(c)}." if c.confounded else ""


def doubtful_tables(c: Candidate) -> str:
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
            f"Added to the model it takes {c.gain_rms:.3g} {unit_of(c)} RMS off {listed(c.rows)} "
            f"({100 * c.gain:.3g} % of what they leave) in parts of the runs it was not fitted to."
        )
    if c.answer is Answer.MISSING:
        return "Without it these runs fit only if the sensor sheet is wrong."
    return f"Added to the model it takes nothing off {listed(c.rows)} in parts of the runs it was not fitted to."


def _chance(c: Candidate, fault: bool, draws: int) -> str:
    alone = "noise and the sheet's tolerances" if fault else "noise alone"
    if c.p <= 1.0 / (draws + 1) + SELECTION.smallest_p_slack:
        return f"{alone} never did as well in {draws} simulated runs (p = {c.p:.2g})"
    return f"{alone} {'do' if fault else 'does'} as well with p = {c.p:.2g}"


def implausible_size(c: Candidate, effect: Effect) -> str:
    """What a candidate's parameter would be, and what is plausible; an empty string where it is."""
    wrong = effect.implausible(c.values, c.interval)
    if wrong is None:
        return ""
    q = wrong.quantity
    value, half = 0.5 * (wrong.low + wrong.high), 0.5 * (wrong.high - wrong.low)
    size = with_interval(value, half) if math.isfinite(half) else _beyond(wrong)
    return f"{last_name(q)} would be {size} {q.unit} (plausible: {q.low:g} to {q.high:g})"


def instead_of(effect: Effect) -> str:
    """What to make of an effect of implausible size."""
    return "look at this instrument first" if effect.as_fault else "no car has that, and something else looks like it"


def _beyond(wrong: Implausible) -> str:
    return f"above {wrong.low:.3g}" if math.isfinite(wrong.low) else f"below {wrong.high:.3g}"


def as_one(total: SumOfPlaces) -> str:
    """The sum of a law's sizes at places that the runs do not distinguish, and what would."""
    value = f"{with_interval(total.value, total.half)} {total.unit}"
    return (
        f"the sum of {total.parameter} over {' and '.join(total.keys)} is {value} (95 %), and these runs do not show "
        f"how it is split; a run in which these places are loaded apart from each other would"
    )


def open_because(axles: Sequence[str]) -> str:
    """Why sizes of effects found at these axles are not given."""
    return f"open: the bench table of the {axles_of(axles)} is not known, and something unlisted remains there"


def axles_of(axles: Sequence[str]) -> str:
    """Axles in words."""
    return " and ".join(f"{axle} axle" for axle in axles)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def others_of(c: Candidate) -> str:
    """The effects that a candidate cannot be told apart from."""
    return listed([key for key, _ in c.ties], "others")


def listed(names: Sequence[str], kind: str = "rows") -> str:
    """The first of some names, and how many more of a kind there are."""
    most = SELECTION.most_reported
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more {kind}"


def last_name(q: Parameter) -> str:
    """A parameter's name without that of its effect."""
    return q.name.rsplit(".", 1)[-1]


def three_digits(value: float) -> str:
    """A number to three digits, without a power of ten."""
    return f"{float(f'{value:.3g}'):.0f}" if value >= 100.0 else f"{value:.3g}"
