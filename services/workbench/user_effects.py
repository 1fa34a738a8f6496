"""Users' own effects on the page: parsing, explanation and storage of a line, and the catalogue with it."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.formats.result import plain
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.effects.language.linearity import FUNCTIONS
from lacet.identify.effects.language.misspelling import doubtful, doubtful_words
from lacet.identify.effects.language.parser import LineFault
from lacet.identify.effects.language.states import STATES, SUFFIXES
from lacet.identify.progress import silent
from lacet.services.render.effect_text import effect_label, trial_outcome
from lacet.services.render.units import unit_text
from lacet.services.workbench.refusals import Busy
from lacet.services.workbench.session_cache import WAIT, SessionCache
from lacet.services.workspace.effect_list import effect_records
from lacet.services.workspace.effect_trial import try_effect
from lacet.services.workspace.study import Study
from lacet.services.workspace.user_effects import line_result, may_have, own_lines, put, with_name

LONGEST = 2000
"""Length of the longest line [characters]."""


def check(cache: SessionCache, name: str, line: str) -> dict[str, Any]:
    """Interpretation of a line, or its fault and place. Raises UsageError without a study."""
    study = cache.study
    text = _joined(name, line)
    try:
        cls, stored = with_name(text, study)
        may_have(study, cls)
    except LineFault as fault:
        at, until = _at(fault, line)
        return _NOTHING | {"error": fault.says, "at": at, "until": until, "doubts": _doubts(doubtful_words(text), line)}
    except LacetError as error:
        return _NOTHING | {"error": str(error)}
    found = line_result(cls, study.vehicle, _reference(study))
    variants = found["variants"]
    says = (
        f"{cls.name}: {found['about']}. Tried as {', '.join(variants)}." if variants else "it has no place on this car"
    )
    doubts = _doubts(doubtful(cls.line), line)
    return plain({**_NOTHING, "ok": True, "says": says, **_shown(found), "line": stored, "doubts": doubts})


def keep(cache: SessionCache, name: str, line: str, parameters: Collection[str] = ()) -> dict[str, Any]:
    """Try a line on the study's first run and store it in the study.

    `parameters` : names that are meant as parameters though a state's is nearly the same. Raises UsageError, also for
    such a name that is not among them, LineFault, and LacetError where its values are not finite; nothing is written
    then.
    """
    study = cache.study
    cls, stored = with_name(_joined(name, line), study)
    may_have(study, cls)
    for own, state in doubtful(cls.line).items():
        if own not in parameters:
            raise UsageError(f"did you mean '{state}'? '{own}' is no state, and would be a parameter")
    tried, sentence = _tried(cache, study, cls)
    replaced = put(study, cls, stored)
    found = line_result(cls, study.vehicle, _reference(study))
    return plain({"ok": True, **_shown(found), "line": stored, "replaced": replaced, "tried": tried, "tells": sentence})


_NOTHING: dict[str, Any] = {
    "ok": False, "says": "", "rows": [], "parameters": [], "variants": [], "doubts": [], "error": None, "at": None,
}  # fmt: skip
"""Answer on a line of which nothing is known."""


def _doubts(names: dict[str, str], line: str) -> list[dict[str, Any]]:
    """Names that may be misspelt states, with their first place in the law of a line, in characters from 0."""
    law = line.find(":") + 1
    out: list[dict[str, Any]] = []
    for name, state in names.items():
        if found := re.compile(rf"\b{re.escape(name)}\b").search(line, law):
            out.append({"name": name, "state": state, "at": found.start(), "until": found.end()})
    return out


def _tried(cache: SessionCache, study: Study, cls: type[OneLine]) -> tuple[list[dict[str, Any]], str]:
    """Result of trying an effect, as plain data and in words; nothing is tried while a job runs."""
    try:
        with cache.computing(WAIT):
            loaded = cache.session(study, silent).runs.loaded
            tried = try_effect(cls, loaded.prepared[0], loaded.vehicle, loaded.reference)
    except Busy:
        return [], "not tried on a run yet: lacet is at work on something else"
    return tried, f"tried on {study.paths()[0].name}: {trial_outcome(tried)}"


def catalogue_payload(cache: SessionCache) -> dict[str, Any]:
    """Every effect that can be added, the study's own among them, and the vocabulary of a line."""
    study = cache.study
    in_model = set(study.version().effects)
    own = {cls.name: cls.line.text for cls in own_lines(study)}
    return plain(
        {
            "effects": [
                {**r, "own": r["family"] in own, "line": own.get(r["family"]), "in_model": r["effect"] in in_model}
                for r in map(_shown, effect_records(study, _reference(study)))
            ],
            "own": [{"effect": name, "line": text} for name, text in own.items()],
            "states": [{"name": s.name, "unit": s.unit, "about": s.about, "of": "wheel" if s.wheel else "body"}
                       for s in STATES.values()],
            "suffixes": list(SUFFIXES),
            "functions": list(FUNCTIONS),
        }
    )  # fmt: skip


def _shown(record: dict[str, Any]) -> dict[str, Any]:
    """The record of an effect with its name in words, and the units of its parameters as shown."""
    label = effect_label(record["effect"])
    return {**record, "label": label, "parameters": [{**p, "unit": unit_text(p["unit"])} for p in record["parameters"]]}


def _reference(study: Study) -> str:
    """Wheel reference of the study's runs, which takes precedence over the rig's."""
    return str(study.version().result["wheel_reference"])


def _joined(name: str, line: str) -> str:
    """A line of text with the name put before it where it has none of its own."""
    if len(line) > LONGEST or len(name) > 100:
        raise UsageError(f"a line has at most {LONGEST} characters")
    if "\n" in line or "\r" in line or "\n" in name:
        raise UsageError("an effect of one's own is one line")
    return f"{name.strip()} = {line.strip()}" if name.strip() and not _named(line) else line.strip()


def _named(line: str) -> bool:
    """Whether a line begins with ``NAME =``."""
    head = line.split(":", 1)[0]
    return "=" in head


def _at(fault: LineFault, line: str) -> tuple[int, int]:
    """Start and end of a fault in the text that the user typed, in characters from 0."""
    before = len(fault.text) - len(line.strip())
    typed = len(line) - len(line.lstrip())
    start, stop = (max(0, place - max(0, before)) + typed for place in (fault.start, fault.stop))
    return min(start, len(line)), min(max(stop, start + 1), len(line))
