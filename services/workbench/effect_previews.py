"""Previews for the page: what a version's model with one more effect does, fitted anew, where it does most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import find_effect
from lacet.identify.validation.contributions import Shares
from lacet.identify.validation.score import Comparison, row_errors
from lacet.identify.validation.signature import Signature, own_row, signature
from lacet.services.progress import Progress
from lacet.services.render.effect_text import effect_label
from lacet.services.render.units import display_unit
from lacet.services.render.verdict_card import preview_sentence
from lacet.services.workbench.packed_arrays import packed
from lacet.services.workbench.refusals import Needs, NotThere
from lacet.services.workbench.session_cache import Previewed, SessionCache
from lacet.services.workspace.kept.kept_values import trial
from lacet.services.workspace.results import scores
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study, Version


@dataclass(frozen=True)
class Trial:
    """A candidate of a version's ranking: the study at the version, and the effect with the ranking's constants."""

    study: Study
    version: Version
    effect: Effect


def candidate(cache: SessionCache, number: int | None, key: str) -> Trial:
    """A candidate by its key. Raises Needs before the version is ranked, NotThere where the ranking has no such."""
    study, version = cache.version(number)
    found = replace(study, current=version.number).diagnosis()
    if found is None:
        raise Needs("diagnose", f"version {version.number} has not been diagnosed yet")
    one: Mapping[str, Any] | None = next((c for c in found["candidates"] if c["effect"] == key), None)
    if one is None:
        raise NotThere(f"the diagnosis of version {version.number} has no effect '{key}'")
    if one["answer"] == "not testable":
        raise NotThere(f"{key}: {one['why']}")
    effect = find_effect(key, study.effects(str(version.result["wheel_reference"])))
    return Trial(study, version, replace(effect, shape={**effect.shape, **one["shape"]}))


def prepare(cache: SessionCache, one: Trial, progress: Progress) -> Previewed:
    """Fit the model with the effect and compare it with the runs used; to be called while `computing`.

    Runs held out are not looked at: the effect is chosen by those used.
    """
    kept = cache.previewed(one.study, one.version, one.effect)
    if kept is not None:
        return kept
    session = cache.session(one.study, progress)
    with session.planned(("fit", one.version), ("fit", trial(one.version, one.effect))):
        now = session.values.comparisons(one.version, held=False)
        after, shares = session.values.with_effect(one.version, one.effect)
    row = own_row(now, after)
    worst = max((part for part in now if row in part.scores), key=lambda part: part.scores[row].ratio)
    found = Previewed(
        row, worst.name, tuple(now), tuple(after), _signature(session, one.effect, row, now, after, shares),
    )  # fmt: skip
    cache.keep_preview(one.study, one.version, one.effect, found)
    return found


def _signature(
    session: Session, effect: Effect, row: Row, now: list[Comparison], after: list[Comparison], shares: list[Shares]
) -> Signature | None:
    having = [k for k, part in enumerate(now) if row in part.measured]
    remaining = [after[k].residual(row) for k in having]
    # A sensor fault is no term of the prediction: what it does is what the residual loses.
    laws = [
        shares[k].effects[row].get(effect.key, now[k].residual(row) - remaining[n])
        for n, k in enumerate(having)
    ]  # fmt: skip
    return signature([session.runs.loaded.prepared[k] for k in having], row, laws, remaining)


def preview_body(cache: SessionCache, number: int, key: str) -> bytes:
    """Residual of the effect's own row in its worst run, now and with the effect, and its signature. Raises Needs."""
    one = candidate(cache, number, key)
    found = cache.previewed(one.study, one.version, one.effect)
    if found is None:
        raise Needs("preview", f"the model with {key} has not been fitted yet")
    row, place = found.row, next(k for k, part in enumerate(found.now) if part.name == found.run)
    now, after = found.now[place], found.after[place]
    before, then = (row_errors(scores(parts))[row] for parts in (found.now, found.after))
    score = now.scores[row]
    arrays = {"t": now.t[row], "now": now.residual(row), "after": after.residual(row)}
    head: dict[str, Any] = {
        "version": number, "effect": key, "label": effect_label(key), "run": found.run, "row": row, "unit": score.unit,
        "floor": score.floor, "rms_now": score.rms, "rms_after": after.scores[row].rms, "ratio_now": before.ratio,
        "ratio_after": then.ratio, "says": preview_sentence(row, found.run, score, after.scores[row], before, then),
        "about": one.effect.signature, "state": None,
    }  # fmt: skip
    if found.signature is not None:
        s = found.signature
        factor, unit = display_unit(s.partial.unit, float(abs(s.partial.centre).max()))
        head |= {"state": s.partial.state, "state_unit": unit, "part": s.part}
        arrays |= {
            "state": factor * s.partial.centre, "mean": s.partial.mean, "low": s.partial.low,
            "high": s.partial.high, "law_at": factor * s.law.centre, "law": s.law.mean,
        }  # fmt: skip
    return packed(arrays, **head)
