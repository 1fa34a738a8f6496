"""What a verdict has of what was hidden: names, sizes, and the error on the run held out.

A key names an effect at an axle when it is of one of the law's families and at that axle, or when such keys at both of
its corners do. An effect tied with a key in print counts as that key's name, where nothing else names it. Laws of one
family of which only the sum is known are printed as one name: none of them is wrong where one of them is hidden.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.identify.intervals import TWO_SIDED_95

_PLACES = {
    "front": {"fl", "fr"},
    "rear": {"rl", "rr"},
    "all": set(CORNERS),
    **{corner: {corner} for corner in CORNERS},
}
CLEAN = "nothing missing"
"""Verdict of a ranking that ends a search."""
Record = Mapping[str, Any]


def wheels(key: str) -> set[str]:
    """Corners that a key is for; none for one of the whole car or of an instrument."""
    return set(_PLACES.get(key.partition(".")[2], ()))


def names(key: str, part: Record) -> bool:
    """Whether a key is a name of a hidden part, at all or at some of its wheels."""
    if key in part["families"]:  # a fault of an instrument, an effect on the whole car
        return True
    there = wheels(key)
    return key.partition(".")[0] in part["families"] and bool(there & wheels(part["name"]))


@dataclass(frozen=True)
class Score:
    """What a verdict has right.

    Attributes
    ----------
    found : by part, whether it is named; parts without a family never are.
    by : by part, the key of the final set that names it first.
    wrong : keys of the final set that are no name of anything hidden.
    """

    found: tuple[bool, ...]
    by: tuple[str | None, ...]
    wrong: tuple[str, ...]


def score(parts: Sequence[Record], effects: Iterable[str], ties: Mapping[str, Sequence[str]]) -> Score:
    """Hidden parts compared with the keys of a final set and what is tied with each."""
    covered: list[set[str]] = [set() for _ in parts]
    by: list[str | None] = [None] * len(parts)
    rest = [key for key in effects if not _take(key, key, parts, covered, by)]
    wrong: list[str] = []
    for key in rest:
        open_ = [part if not _is_covered(part, covered[i]) else {"families": ()} for i, part in enumerate(parts)]
        if not any(_take(other, key, open_, covered, by) for other in ties.get(key, ())):
            wrong.append(key)
    found = tuple(_is_covered(part, there) for part, there in zip(parts, covered, strict=True))
    return Score(found, tuple(by), tuple(wrong))


_WHOLE = "whole"


def _take(key: str, said: str, parts: Sequence[Record], covered: list[set[str]], by: list[str | None]) -> bool:
    """Count a name for the parts it is of; not when it is for wheels at which nothing of the kind is hidden."""
    of = [i for i, part in enumerate(parts) if part["families"] and names(key, part)]
    there = wheels(key) if any(wheels(parts[i]["name"]) for i in of) else set[str]()
    if not of or not there <= set[str]().union(*(wheels(parts[i]["name"]) for i in of)):
        return False
    for i in of:
        covered[i] |= (there & wheels(parts[i]["name"])) or {_WHOLE}
        by[i] = by[i] or said
    return True


def _is_covered(part: Record, there: set[str]) -> bool:
    return bool(there) and wheels(part["name"]) <= there


def listed(record: Record) -> list[Record]:
    """Hidden parts that the catalogue has a family for."""
    return [part for part in record["parts"] if part["families"]]


def scored(record: Record) -> Score:
    """The score of a trial's record, listed parts alone."""
    verdict = record["verdict"]
    result = score(listed(record), verdict["effects"], verdict["ties"])
    wrong = (
        key
        for key in result.wrong
        if not any(other in result.by for other in _summed_with(key, verdict)) and not of_mechanism(key, record)
    )
    return replace(result, wrong=tuple(wrong))


def of_mechanism(key: str, record: Record) -> bool:
    """Whether a key of the final set, or one tied with it, is what a car on linkages has besides what is hidden."""
    own = record.get("mechanism", ())
    said = (key, *record["verdict"]["ties"].get(key, ()))
    return any(
        one.partition(".")[0] == there.partition(".")[0] and wheels(one) <= wheels(there)
        for one in said
        for there in own
    )


def _summed_with(key: str, verdict: Mapping[str, Any]) -> list[str]:
    """Keys of the family of an effect that is known in a sum with them only: none has parameters of its own."""
    family = [k for k in verdict["effects"] if k.partition(".")[0] == key.partition(".")[0]]
    alone = verdict["parameters"]
    return [] if key in alone else [other for other in family if other != key and other not in alone]


def exact(record: Record) -> bool:
    """Whether all that is hidden is named and nothing else, and the verdict says that this is all."""
    result = scored(record)
    return all(result.found) and not result.wrong and finished(record)


def finished(record: Record) -> bool:
    """Whether the search ended because nothing is missing any more."""
    steps = record["verdict"]["steps"]
    return bool(steps) and steps[-1]["verdict"] == CLEAN and not record["verdict"]["unlisted"]


def alarm(record: Record) -> bool:
    """With nothing hidden: anything named, or a cause declared that is not listed."""
    return bool(scored(record).wrong) or record["verdict"]["unlisted"]


def declared(record: Record) -> bool:
    """With an unlisted effect alone hidden: declared so, and nothing named."""
    return record["verdict"]["unlisted"] and not record["verdict"]["effects"]


def intervals(record: Record) -> list[bool]:
    """Of every part named by its own law: whether the printed intervals hold the true values.

    What the sensor sheet allows of a fault is in the instrument on top of what was hidden.
    """
    out: list[bool] = []
    for part, key in zip(listed(record), scored(record).by, strict=True):
        if key is None or not names(key, part):
            continue
        family = key if key in part["values"] else key.partition(".")[0]
        for name, factor in part["values"].get(family, {}).items():
            printed = record["verdict"]["parameters"].get(key, {}).get(f"{key}.{name}")
            if printed is not None:
                half = float(np.hypot(printed[1], TWO_SIDED_95 * part["tolerance"]))
                out.append(abs(printed[0] - factor * part["size"]) <= half)
    return out


def pooled(held: Mapping[str, Mapping[str, float]]) -> float:
    """Residual ÷ floor on the runs held out, root mean square over their rows."""
    ratios = [ratio for rows in held.values() for ratio in rows.values()]
    return float(np.sqrt(np.mean(np.square(ratios))))


def held_ratio(record: Record) -> float | None:
    """Error of the final model on the run held out ÷ that of the true one; None where that is not known."""
    true = record["true_held"]
    return None if true is None else pooled(record["verdict"]["held"]) / pooled(true)


def true_model(parts: Sequence[Record]) -> dict[str, dict[str, float]] | None:
    """Keys and constants of the true model; None where something hidden is no law of the catalogue."""
    if any(not part["families"] for part in parts):
        return None
    out: dict[str, dict[str, float]] = {}
    for part in parts:
        family, place = part["families"][0], part["name"].partition(".")[2]
        whole = family == part["name"] or not place
        out[family if whole else f"{family}.{place}"] = dict(part["shape"])
    return out
