"""The page: what was hidden, what was found for it, and how much of the excess that explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.making import HOME
from benchmarks.laws.forms import SETS

PAGE = HOME / "docs" / "benchmarks" / "laws.md"
ENOUGH, GOAL = 0.85, 0.80
INTRODUCTION = """\
An unlisted law of the suspension (a function of travel and rate of the wheel or of both wheels of the axle, or with a
state of its own) acts in the simulator at an axle or a wheel of a car that no other trial has (`benchmarks/fresh`),
with 60 to 180 N RMS on the run on which it is largest, spring and damper apart. lacet gets tables of three runs of 12
to 16 s (sinus, braking, rough), rig and vehicle file, and looks for a formula in the rows that fail.

*blocks*: part of what is above the noise floor in its rows that the formula printed first explains in blocks of the
runs that were not fitted to (cross-validation; constants and terms were chosen on all of them). *run*: the same on
another run, held out altogether, the formula added to the model and fitted. Another place than the law's counts as 0.
Development and test set have no form in common; the grammar and the settings of the search were fixed before the test
set was run, once. Names in brackets: effects of the catalogue that the formula, or a term of it, is on these runs.
Written by `make laws`."""


def share(record: Mapping[str, Any]) -> float:
    """Part of the excess that the first formula explains in held-out blocks; 0 where it acts elsewhere."""
    formulas = record["formulas"]
    where = record["truth"]["where"]
    return float(formulas[0]["law"]["explained"]) if formulas and formulas[0]["place"] == where else 0.0


def page(records: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """The page's text, from the results of each set."""
    parts = ["# Laws nobody listed", INTRODUCTION]
    for name in reversed(tuple(SETS)):
        of_set = sorted(records[name], key=lambda one: one["trial"])
        if of_set:
            parts += [f"## The {name} set", _goal(name, of_set), _table(of_set)]
    return "\n\n".join(parts) + "\n"


def _goal(name: str, records: Sequence[Mapping[str, Any]]) -> str:
    shares = np.array([share(one) for one in records])
    held = np.array([one["formulas"][0]["held"] if one["formulas"] else 0.0 for one in records])
    enough, seconds = int(np.count_nonzero(shares >= ENOUGH)), np.array([one["seconds"] for one in records])
    met = "met" if enough >= GOAL * len(records) else "**missed**"
    if len(records) < len(SETS[name]):
        met = "open, as not all are run"
    many = len(records)
    return (
        f"**{many} of {len(SETS[name])} laws run.** At least {100 * ENOUGH:.0f} % explained on held-out blocks: "
        f"{enough} of {many} ({100 * enough / many:.0f} %; goal {100 * GOAL:.0f} %: {met}); median "
        f"{100 * np.median(shares):.0f} %. On the run held out: {np.count_nonzero(held >= ENOUGH)} of {many}, median "
        f"{100 * np.median(held):.0f} %. The search takes {np.median(seconds):.1f} s of processor time (median; "
        f"at most {np.max(seconds):.1f})."
    )


def _table(records: Sequence[Mapping[str, Any]]) -> str:
    lines = ["| hidden | at | found | blocks, % | run, % |", "|---|---|---|---:|---:|"]
    for one in records:
        truth = one["truth"]
        constants = ", ".join(f"{name} {value:g}" for name, value in truth["constants"].items())
        hidden = f"{truth['law']}{f' ({constants})' if constants else ''}".replace("|", "\\|")
        if not one["formulas"]:
            lines.append(f"| {hidden} | {truth['where']} | nothing: no row fails by more than chance | 0 | 0 |")
            continue
        best = one["formulas"][0]
        names = f" ({', '.join(best['law']['listed'])})" if best["law"]["listed"] else ""
        text = f"`{best['text'].replace('|', chr(92) + '|')}`{names}"
        lines.append(f"| {hidden} | {truth['where']} | {text} | {100 * share(one):.0f} | {100 * best['held']:.0f} |")
    return "\n".join(lines)


def write_page(records: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Write the page."""
    PAGE.write_text(page(records), encoding="utf-8")
    print(f"wrote {PAGE}")
