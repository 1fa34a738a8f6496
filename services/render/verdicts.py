"""Sentences of a ranking: the verdict of a diagnosis, and the reason of each candidate's answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, Parameter
from lacet.identify.selection.diagnose import Diagnosis, Grounds
from lacet.identify.selection.laws.formulas import Formula, Law
from lacet.identify.selection.score_tests import Answer, Candidate, Pending, Reason, implausible, is_significant
from lacet.identify.selection.settings import SELECTION
from lacet.services.render import tables
from lacet.services.render.effect_text import not_measured


def says(d: Diagnosis) -> str:
    """The verdict of a diagnosis in plain sentences with numbers."""
    if len(d.found) > 1:
        return _several(d)
    if d.best is not None:
        return _missing(d, d.best)
    return _unlisted(d) if d.unlisted else _nothing(d)


def why(d: Diagnosis, c: Candidate) -> str:
    """The reason of a candidate's answer, in plain sentences with numbers."""
    text = reason_text(c, d.effects.get(c.key), d.draws)
    best = d.best.key if d.best else ""
    match c.pending:
        case None:
            return text
        case Pending.UNTIL_BEST_IS_ADDED:
            return f"{text} It is judged again once {best} is added."
        case Pending.NOT_ENOUGH:
            return f"{text} It does not explain what is left."
        case Pending.TIED_WITH_BEST:
            return f"{text} But it cannot be told apart from {best}."


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
            return f"{takes} Not needed: less than {100 * SELECTION.least_gain:g} % of any row, though {chance}."
        case Reason.IMPLAUSIBLE:
            wrong = _implausible(c, effect)
            return f"{takes} Not needed: {wrong}, which no car has; something else looks like it ({chance})."
        case _:
            return f"{takes} Its size would be {sizes(c, effect.parameters)}; {chance}."


def sizes(c: Candidate, parameters: Sequence[Parameter]) -> str:
    """A candidate's parameters with 95 % intervals, and its shape constants."""
    parts = [
        f"{_last(q)} = {_rounded(value, half)} ± {_two_digits(half)} {q.unit}"
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
    ]
    unusual = [
        _last(q)
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
        if (q.expect == "positive" and value + half < 0.0) or (q.expect == "negative" and value - half > 0.0)
    ]
    out = ", ".join([*parts, *(f"{name} {value:.3g} (SI)" for name, value in c.shape.items())])
    return f"{out} (the sign of {', '.join(unusual)} is not the usual one)" if unusual else out


def unit_of(c: Candidate) -> str:
    """Unit of a candidate's `gain_rms`."""
    return c.rows[0].unit if c.rows else "N"


# -- the reason of one candidate's answer ------------------------------------------------------------------------------


def _untestable(c: Candidate) -> str:
    match c.reason:
        case Reason.NEVER_ACTS:
            return "it never acts on these runs"
        case Reason.IN_THE_MODEL:
            return "the model already explains all it does on these runs"
        case Reason.FEW_BLOCKS:
            return (
                f"it acts in only {c.coverage:.1f} blocks of {SELECTION.block_seconds:g} s "
                f"(at least {SELECTION.least_coverage:g} needed)"
            )
        case Reason.SMALL:
            by = ", ".join(f"{key} {100 * share:.0f} %" for key, share in c.absorbed[: SELECTION.most_absorbing])
            return (
                f"even at its largest plausible size it would stand out by only {c.size:.1f} times its noise "
                f"(at least {SELECTION.least_size:g} needed){f', most of it taken up by {by}' if by else ''}"
            )
        case _:
            return f"{100 * c.noise_part:.0f} % of what it would follow is noise of the sensors"


def _takes(c: Candidate) -> str:
    if c.gain > 0.0:
        return (
            f"Added to the model it takes {c.gain_rms:.3g} {unit_of(c)} RMS off {_listed(c.rows)} "
            f"({100 * c.gain:.3g} % of what they leave) in parts of the runs it was not fitted to."
        )
    return f"Added to the model it takes nothing off {_listed(c.rows)} in parts of the runs it was not fitted to."


def _chance(c: Candidate, fault: bool, draws: int) -> str:
    alone = "noise and the sheet's tolerances" if fault else "noise alone"
    if c.p <= 1.0 / (draws + 1) + SELECTION.smallest_p_slack:
        return f"{alone} never did as well in {draws} simulated runs (p = {c.p:.2g})"
    return f"{alone} {'do' if fault else 'does'} as well with p = {c.p:.2g}"


def _implausible(c: Candidate, effect: Effect) -> str:
    k = implausible(c, effect)
    if k is None:
        return ""
    q, value, half = effect.parameters[k], c.values[k], c.interval[k]
    return f"{_last(q)} would be {value:.3g} ± {_two_digits(half)} {q.unit} (plausible: {q.low:g} to {q.high:g})"


# -- the verdict -------------------------------------------------------------------------------------------------------


def _missing(d: Diagnosis, best: Candidate) -> str:
    tied = f" It cannot be told apart from {', '.join(key for key, _ in best.ties)} on these runs." if best.ties else ""
    return f"{best.key} is missing. {why(d, best)}{tied}"


def _several(d: Diagnosis) -> str:
    *first, last = [c.key for c in d.found]
    each = "; ".join(f"{c.key}: {sizes(c, d.effects[c.key].parameters)}" for c in d.found)
    return (
        f"{', '.join(first)} and {last} are missing: added together they explain {100 * d.explained:.0f} % of what is "
        f"above the noise floor in {_listed(d.failing)}. Their sizes, from a fit with all of them (95 %, tolerances of "
        f"the sensors included): {each}."
    )


def _unlisted(d: Diagnosis) -> str:
    grounds = d.grounds
    if grounds.tolerance_exceeded:
        return _with_law(_tolerance_exceeded(grounds), d.formulas)
    if grounds.not_constant is not None and grounds.strongest is not None:
        return _with_law(_not_constant(d, grounds, grounds.strongest), d.formulas)
    text = _lack_of_fit(d, grounds)
    if not d.formulas:
        return f"{text} No law of the measured states describes it: it may depend on something that is not measured."
    return _with_law(text, d.formulas)


def _lack_of_fit(d: Diagnosis, grounds: Grounds) -> str:
    strongest, ratios = grounds.strongest, grounds.ratios
    worst = max(d.failing, key=lambda row: ratios[row])
    own = [row for row in d.failing if strongest and row in strongest.rows] or d.failing
    where = f" in {', '.join(own)}" if len(own) < len(d.failing) else ""
    text = (
        f"The model fails ({worst} at {ratios[worst]:.2f} times its floor) and the cause is not listed: the best "
        f"set of effects of the catalogue ({', '.join(d.together) or 'none'}) explains "
        f"{100 * max(0.0, d.explained):.0f} % of what is above the floor{where}, and the rest is no noise."
    )
    if strongest and where and d.explained >= SELECTION.set_share:
        text += f" Of these rows {strongest.key} may be the cause: add it, and see what the others still lack."
    return text


def _tolerance_exceeded(grounds: Grounds) -> str:
    use, strongest = grounds.tolerances, grounds.strongest
    beside = f"Beside {strongest.key}, the best of the catalogue, the" if strongest else "The"
    return (
        f"{beside} model fits these runs only if the sensor sheet is wrong (in tolerances: {_off(use.sizes)}). "
        f"The squares of all but latencies sum to {use.squares:.0f}, in simulated runs that lack nothing to "
        f"{np.mean(use.null):.0f} and never above {np.max(use.null):.0f}. Either several instruments are off "
        f"(calibrate them, or write their true tolerances into the rig file), or the cause is not listed."
    )


def _not_constant(d: Diagnosis, grounds: Grounds, law: Candidate) -> str:
    runs = grounds.not_constant
    assert runs is not None
    k, *two = runs.farthest_apart
    q = d.effects[law.key].parameters[k]
    values = " and ".join(
        f"{runs.values[r][k]:.3g} ± {SELECTION.interval_quantile * runs.spread[r][k]:.2g} {q.unit} in {r}" for r in two
    )
    return (
        f"The model lacks something, and the cause is not listed: {law.key} explains most, but it would have to be "
        f"another law in each run ({q.name} is {values}; simulated runs differ as much with p = {runs.p:.2g})."
    )


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
    least = min((c.p for c in ranked), default=1.0)
    text = (
        f"Nothing is missing that these runs can show: with the sensor sheet's tolerances taken out the row farthest "
        f"above its noise floor is {worst}, at {ratios[worst]:.2f}, and what the best of {len(ranked)} candidates "
        f"does, chance does with p = {least:.2g}."
    )
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
        text += f" Sensors are noisier than their sheet says ({', '.join(noisy)}): lacet check tells which."
    if off := _off(d.grounds.tolerances.sizes, SELECTION.reported_tolerances):
        text += (
            f" For that the sensor sheet would have to be off by more than {SELECTION.reported_tolerances:g} of its "
            f"tolerances ({off}): look at these instruments (lacet check measures latencies)."
        )
    return text


def _off(tolerances: Mapping[str, float], least: float = 0.0) -> str:
    """Entries of the sensor sheet that are farthest off, in tolerances."""
    most = sorted(tolerances.items(), key=lambda one: -abs(one[1]))[: SELECTION.most_reported]
    return ", ".join(f"{name} {size:+.1f}" for name, size in most if abs(size) > least)


def _listed(rows: Sequence[Row]) -> str:
    most = SELECTION.most_reported
    shown = ", ".join(rows[:most])
    return shown if len(rows) <= most else f"{shown} and {len(rows) - most} more rows"


def _last(q: Parameter) -> str:
    return q.name.rsplit(".", 1)[-1]


def _two_digits(half: float) -> str:
    """An interval to two digits, without a power of ten up to a million."""
    return f"{float(f'{half:.2g}'):g}"


def _rounded(value: float, half: float) -> str:
    """A value to the second digit of its interval."""
    if not half > 0.0 or not np.isfinite(half):
        return f"{value:.3g}"
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(half))))}f}"


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
    print(f"{text}.\n", flush=True)
