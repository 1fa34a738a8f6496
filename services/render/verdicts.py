"""Sentences of the verdict of a diagnosis: what is missing, what remains, and what these runs do not show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.selection.candidate import Candidate, Reason, is_significant
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.diagnosis import Diagnosis, Grounds
from lacet.identify.selection.laws.formulas import Formula, Law
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import ToleranceUse
from lacet.identify.validation.score import fails
from lacet.services.render import tables
from lacet.services.render.candidate_reasons import (
    NOT_NAMED,
    as_one,
    axles_of,
    doubtful_tables,
    implausible_size,
    instead_of,
    listed,
    open_because,
    others_of,
    sizes,
    unit_of,
    why,
)
from lacet.services.render.intervals import with_interval
from lacet.services.render.known_scale import weak_because
from lacet.services.render.row_needs import shortened

K = TypeVar("K")
_TRAVEL_ALONE = frozenset({"spring_quadratic", "spring_cubic", "helper_spring", "bump_stop", "rebound_stop"})
"""Families of laws of a spring: they follow the travel alone."""
_PARTS = 3
"""Laws of one spring, from which it is said that they are [count]. Source: a choice; a progressive spring with a stop
has two."""
_AIR_SPRING = "air = suspension: f*((h/(h - travel))**1.3 - 1), h = 0.1 0.15 0.2 m"
_MOST = 0.5
"""Part of the error above which an effect explains most of it."""


def says(d: Diagnosis) -> str:
    """The verdict of a diagnosis in plain sentences with numbers."""
    if d.found:
        text = _missing(d) if len(d.found) == 1 else _several(d)
        return f"{text}{_one_spring(d)}{_without_tables(d)}{_remaining(d)}{_in_part(d)}{_small(d)}{_maybe(d)}"
    if d.unlisted:
        return f"{_unlisted(d)}{_without_tables(d)}{_in_part(d)}{_maybe(d)}"
    return _nothing(d)


# -- the reason of one candidate's answer ------------------------------------------------------------------------------


# -- the verdict -------------------------------------------------------------------------------------------------------


def _missing(d: Diagnosis) -> str:
    (c,) = d.found
    return f"{c.key} is missing. {why(d, c)}"


def _open_sizes(d: Diagnosis) -> str:
    """The effects found whose sizes are open, and why, by the axles that leave them open."""
    by_axles = dict.fromkeys(c.open_at for c in d.found if c.open_at)
    keys = {axles: [c.key for c in d.found if c.open_at == axles] for axles in by_axles}
    return "".join(f" Of {' and '.join(keys[axles])} the size is {open_because(axles)}." for axles in by_axles)


def _each(d: Diagnosis) -> str:
    """Sizes of the effects found that are known; of those that are known as a sum, the sum once."""
    known = [c for c in d.found if not c.open_at]
    parts = [f"{c.key}: {sizes(c, d.effects[c.key])}" for c in known if c.total is None]
    sums = dict.fromkeys(c.total for c in known if c.total is not None)
    return "; ".join([*parts, *(as_one(total) for total in sums)])


def _several(d: Diagnosis) -> str:
    *first, last = [c.key for c in d.found]
    each = _each(d)
    rows = [row for row in d.failing if any(d.effects[c.key].acts_on(row) for c in d.found)]
    share = f" they explain {100 * d.explained:.0f} % of what is above the noise floor in {listed(rows)}"
    tied = "".join(
        f" {c.key} cannot be told apart from {', '.join(key for key, _ in c.ties)} on these runs."
        for c in d.found
        if c.ties
    )
    tied += "".join(f" Of {c.key} a part may be {doubtful_tables(c)}." for c in d.found if c.confounded)
    whole = all(c.total is not None and len(c.total.keys) == len(d.found) for c in d.found)
    as_one = " as one, or one of them" if whole else ""
    together = f": added together{share}" if rows else ""
    sized = f" Their sizes, from a fit with all of them (95 %, tolerances of the sensors included): {each}."
    return f"{', '.join(first)} and {last} are missing{as_one}{together}.{sized if each else ''}{_open_sizes(d)}{tied}"


def _one_spring(d: Diagnosis) -> str:
    """That several laws of the travel alone at one place are parts of one spring; empty where they are not."""
    places = dict.fromkeys(d.effects[c.key].where for c in d.found)
    together = [[c.key for c in d.found if d.effects[c.key].where == place and _of_travel(d, c)] for place in places]
    parts = [keys for keys in together if len(keys) >= _PARTS]
    if not parts:
        return ""
    named = "; ".join(", ".join(keys) for keys in parts)
    return (
        f" What follows the travel alone at one place is one spring whose rate changes ({named}), each law a part of "
        f"it: a law of its own may do with fewer, as an air spring's: lacet effect DIR '{_AIR_SPRING}'."
    )


def _of_travel(d: Diagnosis, c: Candidate) -> bool:
    return d.effects[c.key].name in _TRAVEL_ALONE


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
            f" And something that is not listed acts in {listed(list(rows))}: with {listed(stand_ins)} in its place "
            f"hardly more than noise remains, but a law of no catalogue explains clearly more."
        )
    return (
        f" And something that is not listed remains in {_times_floor(d)} (÷ floor, with all these in the model)."
        f"{_on_assumptions(d)}"
    )


def _times_floor(d: Diagnosis) -> str:
    """The rows in which something unlisted remains, with their rest ÷ floor."""
    return listed([f"{row} at {d.grounds.ratios[row]:.2f}" for row in d.unlisted_rows])


def _without_tables(d: Diagnosis) -> str:
    """What the lack of bench tables means for the names, where wheels are found to move or turn with the travel."""
    lacking, out = d.without_tables, ""
    sure = [axle for axle in lacking.axles if axle not in lacking.unsure]
    known = [axle for axle in lacking.axles if axle not in lacking.unlisted]
    lead = " The vehicle file has no bench table of the"
    if sure:
        out += (
            f"{lead} {axles_of(sure)}: its wheels are taken to move straight up, and these runs show that they do not."
        )
    if lacking.unsure:
        out += (
            f"{lead} {axles_of(lacking.unsure)}: its wheels are taken to move straight up, and they may not. What "
            f"speaks for that changes from run to run, or may be a part of what is not listed."
        )
    if known and d.found:
        out += f" Sizes of other effects at the {axles_of(known)} are from a fit with an unknown table."
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
    share = f"{100 * best.gain:.0f} % of what {listed(best.rows)} leave"
    size = f"{implausible_size(best, effect)}; {instead_of(effect)}"
    return f" {best.key} would explain {share}, at an implausible size: {size}."


def _in_part(d: Diagnosis) -> str:
    """Listed effects that explain part of the error and are not named beside an unlisted cause."""
    parts = [c for c in d.candidates if c.reason in NOT_NAMED and c.key not in d.grounds.not_constant]
    if not parts:
        return ""
    each = "; ".join(f"{c.key}{' or in its place ' if c.ties else ''}{others_of(c)}" for c in parts)
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
    where = (
        "in rows that stand on assumed channels" if {*d.unlisted_rows} <= {*grounds.assumed}
        else "and the cause is not listed"
    )  # fmt: skip
    text = (
        f"The model fails ({_times_floor(d)} times the floor) {where}: no effect of the catalogue explains it with a "
        f"plausible size, beyond chance, and what remains is not noise."
    )
    text += f" {_not_constant(d)}" if grounds.not_constant else ""
    text += f"{_on_assumptions(d)}{_beyond_plausible(d)}{_from_outside(d)}"
    if not d.formulas:
        return f"{text} No law of the measured states describes it: it may depend on something that is not measured."
    return _with_law(text, d.formulas)


def simple_laws(d: Diagnosis) -> list[str]:
    """The laws of one term that explain most of what is not listed in their rows, largest first."""
    return [formula.of_one_term.text for formula in d.formulas if formula.of_one_term.explained >= _MOST]


def _from_outside(d: Diagnosis) -> str:
    """What acts on the body alone and follows nothing that is measured; empty where other rows fail, or a law does."""
    if any(row.kind != "chassis" for row in d.unlisted_rows) or any(f.law.explained >= _MOST for f in d.formulas):
        return ""
    return (
        " Rows of the body alone fail, and no simple law of what is measured explains most of it: wind, a trailer, or "
        "a mass that moves in the car has a force of that kind."
    )


def _on_assumptions(d: Diagnosis) -> str:
    """Unlisted rows that stand on channels which are not measured: what remains may be no effect."""
    assumed = d.grounds.assumed
    if not assumed:
        return ""
    channels = ", ".join(shortened(dict.fromkeys(chain.from_iterable(assumed.values()))))
    return (
        f" What remains in {listed(list(assumed))} may be the error of assumed channels ({channels}), and no missing "
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
    where = f" in {listed(rows)}" if rows else ""
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
        text += or_a_length(d.grounds.tolerances.sizes)
    return text


def or_a_length(sizes: Mapping[str, float]) -> str:
    """Lengths of the vehicle file that do what another place of the inertial unit does; empty where none may."""
    far = [
        axis for axis in _LENGTHS if abs(sizes.get(f"sensor_position.imu.{axis}", 0.0)) > SELECTION.reported_tolerances
    ]
    if not far:
        return ""
    return (
        f" A wrong {' or '.join(_LENGTHS[axis] for axis in far)} in the vehicle file does what another place of the "
        "inertial unit does: measure both."
    )


_LENGTHS = {"x": "wheelbase", "y": "track", "z": "wheel-centre height"}
"""Axis of the inertial unit's place → length of the car that the forces' levers are made of."""


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
