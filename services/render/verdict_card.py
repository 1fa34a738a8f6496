"""The verdict card of the page: which effect is missing and how sure that is, in at most `MOST_WORDS` words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.selection.candidate import Answer
from lacet.identify.validation.score import RowError, RowScore
from lacet.services.render.candidate_reasons import last_name, three_digits
from lacet.services.render.effect_text import effect_label
from lacet.services.render.intervals import with_interval
from lacet.services.render.rows import ratio_text
from lacet.services.render.verdicts import row_of_tolerances

MOST_WORDS = 40
"""Largest number of words on a card, its button apart."""
_RIVALS = 3
"""Number of further candidates whose fate is given."""
_SHOWING = 3
"""Number of manoeuvres named that would show effects which these runs cannot test."""
_OUT = {
    Answer.UNDECIDED: "judged next", Answer.STANDS_IN: "stands in", Answer.IMPLAUSIBLE: "implausible size",
    Answer.SMALL: "too small", Answer.NOT_NEEDED: "chance", Answer.NOT_TESTABLE: "untestable here",
}  # fmt: skip


def verdict_card(diagnosis: Mapping[str, Any], effects: Mapping[str, Effect]) -> dict[str, Any]:
    """The card of a diagnosis as plain data (`diagnosis_result`); `effects` : key → effect of the study.

    `title`, `lines` (each with a term of `lacet.services.render.terms`, or none) and `out`, why further candidates are
    not named, are its words; `add` is the effect to add with
    `shape` and `label`, None where there is none; `untestable` and `showing` are the number of effects that these runs
    cannot test, and the manoeuvres that would show most of them.
    """
    candidates: Sequence[Mapping[str, Any]] = diagnosis["candidates"]
    found = [c for key in _found(diagnosis) for c in candidates if c["effect"] == key]
    untestable = [c["effect"] for c in candidates if c["answer"] == Answer.NOT_TESTABLE]
    best = found[0] if found else None
    if best is not None:
        alike = _alike(best)
        others = len(found) - len(alike)
        more = f", and {others} more" if others else ""
        title = f"Missing: {effect_label(best['effect'])}{_and(alike[1:])}{more}"
        size = _sum(best["sum"]) if best.get("sum") else _size(best, effects.get(best["effect"]))
        sized = ("", _open(best["open_at"])) if best.get("open_at") else ("interval", size)
        lines = [sized, ("lead", _lead(best))]
        if diagnosis["unlisted_rows"]:
            lines.append(("", f"Beside it something unlisted remains in {_rows(diagnosis['unlisted_rows'])}"))
    elif diagnosis["verdict"] == "nothing missing":
        title = f"Nothing missing that these runs can show, {len(untestable)} effects untestable"
        lines = [("error", _by_tolerances(diagnosis))]
    else:
        title = "Something is missing that the catalogue does not have"
        rows = diagnosis["unlisted_rows"]
        lines = [("error", f"{row} is {diagnosis['rows'][row]:.1f} times its noise floor") for row in rows[:1]]
        lines += [("", f"Nearest simple law: {f['text']}") for f in diagnosis.get("formulas", [])[:1]]
        lines += [("", _or_a_table(keys)) for keys in [diagnosis.get("tables_instead")] if keys]
    out = [
        {"effect": c["effect"], "why": _why_out(c, best)}
        for c in candidates
        if c not in found and c["answer"] != Answer.NOT_TESTABLE
    ][:_RIVALS]
    card = {
        "verdict": diagnosis["verdict"],
        "title": title,
        "lines": [{"term": term, "text": text} for term, text in lines if text],
        "out": out,
        "add": best["effect"] if best else None,
        "label": effect_label(best["effect"]) if best else "",
        "shape": dict(best["shape"]) if best else {},
        "untestable": len(untestable),
        "showing": _showing(untestable, effects) if not best else [],
        "heads": {"out": OUT_HEAD, "showing": SHOWING_HEAD},
    }
    while out and words_of(card) > MOST_WORDS:
        out.pop()
    return card


def words_of(card: Mapping[str, Any]) -> int:
    """Number of words on a card as the page shows it, its button apart."""
    lines = [line["text"] for line in card["lines"]]
    out = [f"{one['effect']}: {one['why']}" for one in card["out"]]
    showing = [f"{one['shown_by']} ({one['effects']})" for one in card["showing"]]
    heads = [OUT_HEAD] * bool(out) + [SHOWING_HEAD] * bool(showing)
    return sum(len(text.split()) for text in (card["title"], *lines, *heads, *out, *showing))


OUT_HEAD = "Out:"
"""Words before the further candidates."""
SHOWING_HEAD = "Would show most:"
"""Words before the manoeuvres that would show what these runs cannot."""


def _found(diagnosis: Mapping[str, Any]) -> list[str]:
    """Keys of the effects found; of lacet versions that stored the best alone, that."""
    best = diagnosis.get("best")
    return list(diagnosis.get("found") or ([best] if best else []))


def _alike(c: Mapping[str, Any]) -> list[str]:
    """Keys of the effects of which only the sum with this one is known, itself the first; itself without any."""
    keys: list[str] = (c.get("sum") or {}).get("effects", [])
    return [c["effect"], *(key for key in keys if key != c["effect"])]


def _and(keys: Sequence[str]) -> str:
    return "".join(f" + {key.partition('.')[2]}" for key in keys)


def _sum(total: Mapping[str, Any]) -> str:
    """The sum of a law's sizes over places that the runs do not distinguish."""
    value = f"{with_interval(total['value'], total['half95_sheet'])} {total['unit']}"
    return f"{total['parameter']} summed = {value} (95 %, with sheet); these runs do not show the split"


def _size(c: Mapping[str, Any], effect: Effect | None) -> str:
    """Parameters ± half of their 95 % interval, the tolerances of the sensor sheet included."""
    if effect is None:
        return ""
    parts = [
        f"{last_name(q)} = {with_interval(value, half)} {q.unit}"
        for q, value, half in zip(effect.parameters, c["values"], c["half95"], strict=False)
    ][:2]
    more = len(c["values"]) - len(parts)
    return f"{', '.join(parts)}{f' and {more} more' if more > 0 else ''} (95 %, with sheet)"


def _open(axles: Sequence[str]) -> str:
    """Why the size of an effect found is not given."""
    return f"Size open: no bench table of the {' and '.join(axles)} axle, and something unlisted there"


def _or_a_table(keys: Sequence[str]) -> str:
    """Effects of the set found that an unknown bench table may explain as well."""
    others = len(keys) - 1
    more = f" and {others} more" if others else ""
    return f"Undecided beside an unknown bench table: {effect_label(keys[0])}{more}"


def _lead(c: Mapping[str, Any]) -> str:
    """How far it is ahead of its best rival, or that nothing parts the two on these runs."""
    if c["ties"]:
        others = len(c["ties"]) - 1
        return f"Not told apart from {c['ties'][0]['effect']}{f' and {others} more' if others else ''} on these runs"
    if c.get("margin") is None:
        return ""
    return f"{three_digits(c['margin'])} weighted squares ahead of {c['rival']}"


def _why_out(c: Mapping[str, Any], best: Mapping[str, Any] | None) -> str:
    """Why a candidate is not the one named, in one to three words."""
    if best is not None and c["effect"] in [tie["effect"] for tie in best["ties"]]:
        return "tied"
    if c["answer"] == Answer.UNDECIDED and best is None:
        return "undecided"
    if c["answer"] == Answer.STANDS_IN and c.get("stands_for"):
        return f"stands for {c['stands_for']}"
    return _OUT.get(Answer(c["answer"]), c["answer"])


def _by_tolerances(diagnosis: Mapping[str, Any]) -> str:
    """What the sensors' tolerances explain of the worst row; empty where it is little, or was not stored."""
    rows, tolerated = diagnosis["rows"], diagnosis.get("tolerated", {})
    row = row_of_tolerances(rows, tolerated)
    return f"{row} {rows[row]:.2f} → {tolerated[row]:.2f} once the rig file is right: lacet check" if row else ""


def _showing(untestable: Sequence[str], effects: Mapping[str, Effect]) -> list[dict[str, Any]]:
    """The manoeuvres that show most of some effects, with the number of these."""
    counts: dict[str, int] = {}
    for key in untestable:
        if key in effects:
            shown = manoeuvre(effects[key])
            counts[shown] = counts.get(shown, 0) + 1
    most = sorted(counts.items(), key=lambda one: -one[1])[:_SHOWING]
    return [{"shown_by": shown_by, "effects": number} for shown_by, number in most]


def manoeuvre(effect: Effect) -> str:
    """The manoeuvre that shows an effect, in a few words: what is common to the effects that it shows."""
    return re.split(r"[:;,(]| with (?:large|small) | while ", effect.shown_by)[0].strip()


def _rows(rows: Sequence[str]) -> str:
    return rows[0] if len(rows) == 1 else f"{rows[0]} and {len(rows) - 1} more"


def preview_sentence(row: Row, run: str, now: RowScore, after: RowScore, before: RowError, then: RowError) -> str:
    """What a model with one more effect does where it does most: in its row's worst run, and over all runs used."""
    part = 1.0 - after.rms / now.rms if now.rms > 0.0 else 0.0
    fall = "no change" if abs(part) < 0.005 else f"{100 * abs(part):.0f} % {'less' if part > 0.0 else 'more'}"
    return (
        f"{row} in {run}: {now.rms:.3g} → {after.rms:.3g} {now.unit} RMS residual, {fall}; over all runs used "
        f"{ratio_text(before.ratio)} → {ratio_text(then.ratio)} times its floor."
    )
