"""First page of a study's report as values: what was found, how sure it is, what stays open, and from which runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.validation.score import failing_rows, pooled_ratio, worst_row
from lacet.services.render.effect_text import effect_label
from lacet.services.render.figures.panels import Panels
from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.rows import said_of_runs
from lacet.services.render.shape_constants import readable
from lacet.services.render.study_version import Version
from lacet.services.render.tables import Table

MOST_OPEN = 4
"""Rows not judged and warnings that the first page names; the others are only counted."""


@dataclass(frozen=True)
class RunAbout:
    """A run as the report names it: `role` in the study, `date` of its recording, `digest` of its file (SHA-256)."""

    name: str
    role: str
    manoeuvre: str
    date: str
    seconds: float
    digest: str


@dataclass(frozen=True)
class Summary:
    """The first page.

    `about` : what it is of, label and text; `verdict` : sentences; `errors`, `sizes`, `runs` : tables, `sizes` None
    where nothing was added; `open` : what these runs do not show, a sentence each; `picture` : a row before and after.
    """

    title: str
    about: Sequence[tuple[str, str]]
    verdict: str
    fall: str
    errors: Table
    sizes: Table | None
    open: Sequence[str]
    runs: Table
    picture: Panels


def summary(
    base: Version, now: Version, diagnosis: Mapping[str, Any] | None, runs: Sequence[RunAbout],
    about: Sequence[tuple[str, str]], picture: Panels,
) -> Summary:  # fmt: skip
    """The first page of a report on the version `now`, whose errors are compared with those of the `base` model."""
    result = now.result
    details = [
        *about,
        ("vehicle", str(result["vehicle"])),
        ("instruments", f"{result['rig']}; {result['wheel_reference']} wheel loads"),
        ("model", f"version {now.number}: base model{''.join(f' + {effect_label(key)}' for key in now.effects)}"),
    ]
    return Summary(
        str(result["vehicle"]),
        details,
        str(diagnosis["says"])
        if diagnosis
        else "This version has not been diagnosed: what it lacks was not looked for.",
        _fall(base, now),
        _errors(base, now, runs),
        _sizes(now) if now.effects else None,
        _open(now, diagnosis),
        _runs(runs),
        picture,
    )


def _fall(base: Version, now: Version) -> str:
    """Error ÷ noise floor with the base model and now, in a sentence."""
    first, rows = base.result["rows"], now.result["rows"]
    if base.number == now.number:
        held = f", {pooled_ratio(rows['held']):.2f} on the runs held out" if rows["held"] else ""
        return f"Error ÷ noise floor is {pooled_ratio(rows['used']):.2f} on the runs used{held}; 1 is the floor."
    held = ""
    if rows["held"]:
        held = f", from {pooled_ratio(first['held']):.2f} to {pooled_ratio(rows['held']):.2f} on the runs held out"
    return (
        f"Error ÷ noise floor went from {pooled_ratio(first['used']):.2f} to {pooled_ratio(rows['used']):.2f} on the "
        f"runs used{held}; 1 is the floor."
    )


def _errors(base: Version, now: Version, runs: Sequence[RunAbout]) -> Table:
    """Error ÷ noise floor of each run, and of all of one kind."""
    lines: list[list[str]] = []
    changed = base.number != now.number
    for kind, title in (("used", "used for the fit"), ("held", "held out")):
        before, after = base.result["rows"][kind], now.result["rows"][kind]
        groups = [({name: part}, name) for name, part in after.items()]
        if len(after) > 1:
            groups.append((after, f"all {len(after)}"))
        for part, name in groups:
            own = {run: before[run] for run in part if run in before}
            first = [f"{pooled_ratio(own):.2f}" if own else "-"] if changed else []
            worst, ratio = worst_row(part)
            failing = len(failing_rows(part))
            place = worst if len(part) > 1 else worst.partition(": ")[2]
            lines.append([name, title, place, *first, f"{pooled_ratio(part):.2f}", f"{ratio:.2f}", str(failing)])
    head = [
        "run",
        "role",
        "worst row",
        *(["base model"] if changed else []),
        "this model",
        "worst row's",
        "rows that fail",
    ]
    return Table(head, lines, text_columns=3, note="Residual ÷ noise floor, root mean square over rows.")


def _sizes(now: Version) -> Table:
    """Parameters of the effects that were added, with the sensor sheet in their intervals."""
    lines: list[list[str]] = []
    for key, shape in now.effects.items():
        label = effect_label(key)
        for p in now.result["parameters"]:
            if p["effect"] == key:
                half = p["half95_sheet"]
                lines.append([label, p["name"], p["unit"], to_interval(p["value"], half), f"± {half_width(half)}"])
        open_ = [p["name"] for p in now.result["not_identifiable"] if p["effect"] == key]
        lines += [[label, name, "", "not identified", ""] for name in open_]
        lines += [_constant(label, key, name, value) for name, value in shape.items()]
    return Table(["effect added", "parameter", "unit", "value", "95 % with the sheet"], lines, text_columns=3)


def _constant(label: str, key: str, name: str, value: float) -> list[str]:
    """The line of a shape constant; of an effect of the user's own it is in SI units."""
    family = effect_classes().get(key.partition(".")[0])
    shown, unit = (value, "SI") if family is None else readable(family, name, value)
    return [label, f"{key}: {name}", unit or "-", f"{shown:.4g}", ""]


def _open(now: Version, diagnosis: Mapping[str, Any] | None) -> list[str]:
    """What these runs do not show, a sentence each."""
    out: list[str] = []
    if diagnosis is not None:
        tied = {
            c["effect"]: [t["effect"] for t in c["ties"]] for c in diagnosis["candidates"] if c["answer"] == "missing"
        }
        out += [f"{effect} cannot be told apart from {', '.join(ties)}." for effect, ties in tied.items() if ties]
        untested = [c["effect"].partition(".")[0] for c in diagnosis["candidates"] if c["answer"] == "not testable"]
        if untested:
            families = [f"{effect_label(one)}{f' ({n})' if n > 1 else ''}" for one, n in Counter(untested).items()]
            out.append(f"{len(untested)} effects cannot be tested with these runs: {', '.join(families)}.")
    unknown = now.result["not_identifiable"]
    if unknown:
        out.append(f"{len(unknown)} parameters are not identified ({_few([p['name'] for p in unknown])}).")
    judged = [f"{line}." for line in now.result.get("not_judged", [])]
    warnings = [f"{line.rstrip('.')}." for line in said_of_runs(now.result)]
    for lines in (judged, warnings):
        out += lines[:MOST_OPEN]
        if len(lines) > MOST_OPEN:
            out.append(f"And {len(lines) - MOST_OPEN} more of this kind, below.")
    return out or ["Nothing: every effect of the catalogue could be tested, and every parameter is identified."]


def _few(names: Sequence[str], most: int = 8) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _runs(runs: Sequence[RunAbout]) -> Table:
    lines = [
        [run.name, run.role, run.manoeuvre or "-", run.date or "-", run.digest[:16] or "-", f"{run.seconds:.1f}"]
        for run in runs
    ]
    head = ["run", "role", "manoeuvre", "recorded (UTC)", "SHA-256, first 16 digits", "seconds"]
    return Table(head, lines, text_columns=5)
