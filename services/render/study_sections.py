"""Sections of a study's report as HTML with figures."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from lacet.identify.car.rows import Row
from lacet.identify.properties.derived import DamperCurve
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.score import Comparison, pooled_ratio
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render import tables
from lacet.services.render.failure_report import where_pieces
from lacet.services.render.figures import study_plots, validation_plots
from lacet.services.render.html import details, picture, pre, section
from lacet.services.render.identifiability import rows_not_judged


class Version(Protocol):
    """Properties of a version of a study's model that a report shows."""

    @property
    def number(self) -> int:
        """Number of the version, from 1."""
        ...

    @property
    def note(self) -> str:
        """Description of the change."""
        ...

    @property
    def effects(self) -> Mapping[str, Mapping[str, float]]:
        """Effects beyond the base model."""
        ...

    @property
    def result(self) -> Mapping[str, Any]:
        """Fit and scores as plain data."""
        ...


def head(base: Version, now: Version, used: int, held_out: int, diagnosis: Mapping[str, Any] | None) -> str:
    """Title, numbers of runs, and the fall of the error from the `base` model to the present one."""
    first = base.result["rows"]
    rows = now.result["rows"]
    added = ", ".join(now.effects) or "nothing"
    held = ""
    if rows["held"]:
        held = f", from {pooled_ratio(first['held']):.2f} to {pooled_ratio(rows['held']):.2f} on the runs held out"
    verdict = html.escape(str(diagnosis["says"])) if diagnosis else "This version has not been diagnosed."
    return (
        f"<h1>{html.escape(str(now.result['vehicle']))}</h1>"
        f'<p class="note">{used} runs used, {held_out} held out; version {now.number}; '
        f"{html.escape(str(now.result['wheel_reference']))} wheel loads; rig {html.escape(str(now.result['rig']))}</p>"
        f'<p class="big">Added to the base model: <b>{html.escape(added)}</b>. Error ÷ noise floor went from '
        f"{pooled_ratio(first['used']):.2f} to {pooled_ratio(rows['used']):.2f} on the runs used{held}.</p>"
        f"<p>{verdict}</p>"
    )


def error_falls(versions: Sequence[Version]) -> str:
    """Fall of the error, version by version."""
    return section("The error falls", picture(study_plots.fall_figure(versions)), pre(tables.history(versions)))


def base_model_fails(found: FailureAnalysis) -> list[str]:
    """Failure analysis of the base model."""
    return [f"<h3>The base model</h3>{''.join(where_pieces(found))}"]


def present_model_fails(
    now: Version, row: Row, before: Sequence[Comparison], after: Sequence[Comparison], found: FailureAnalysis
) -> list[str]:
    """A row before and after, in the run with its largest error, and the failure analysis of the present model."""
    having = [c for c in before if row in c.scores]
    old = max(having, key=lambda c: c.scores[row].ratio)
    new = next(c for c in after if c.name == old.name)
    return [
        f"<h3>Now, with {html.escape(', '.join(now.effects))}</h3>",
        f"<p>{html.escape(row)} of run {html.escape(old.name)} before and after:</p>",
        picture(study_plots.comparison_charts(old, [row])),
        picture(study_plots.comparison_charts(new, [row])),
        *where_pieces(found),
    ]


def where_it_fails(pieces: Sequence[str]) -> str:
    """The section of these pieces."""
    return section("Where it fails", *pieces)


def findings(versions: Sequence[Version], diagnoses: Mapping[int, Mapping[str, Any] | None]) -> str:
    """Diagnosis of each version that has one."""
    found_parts: list[str] = []
    for v in versions:
        found = diagnoses.get(v.number)
        if found is not None:
            title = f"Version {v.number} ({html.escape(v.note)})"
            found_parts.append(f"<h3>{title}</h3><p>{html.escape(found['says'])}</p>")
            reasons = "".join(
                f"<tr><td>{html.escape(c['effect'])}</td><td class=text>{html.escape(c['why'])}</td></tr>"
                for c in found["candidates"]
            )
            found_parts.append(details("the ranking", pre(tables.candidates(found, 20)), f"<table>{reasons}</table>"))
    return section("What is missing", *(found_parts or ["<p>Not diagnosed yet: lacet diagnose.</p>"]))


def against_measurement(after: Mapping[str, list[Comparison]], progress: Progress) -> str:
    """Measured and modelled rows of every run."""
    pieces: list[str] = []
    for title, kind in (("Run used", "used"), ("Run held out", "held")):
        for part in after[kind]:
            progress(ServiceStep(ServiceStage.DRAWING_RUN, subject=part.name))
            pieces.append(details(f"{title}: {part.name}", *_validation(part)))
    pieces += [f'<p class="fail">{html.escape(line)}.</p>' for part in after["held"] for line in rows_not_judged(part)]
    return section("Model against measurement", *pieces)


def _validation(part: Comparison) -> list[str]:
    """Measurement, model and error by kind of row, and the whiteness of the residual."""
    figures = [study_plots.comparison_charts(part, rows) for rows in validation_plots.kinds(part).values()]
    if part.whiteness:
        figures += [validation_plots.spectrum_charts(part), validation_plots.acf_charts(part)]
    return [picture(figure) for figure in figures]


def derived_values(now: Version, curves: Mapping[str, DamperCurve]) -> str:
    """Derived values, damper curves, and the ranges that all of it covers."""
    if not now.result.get("derived"):
        return ""
    pieces = [pre(tables.derived(now.result))]
    if lacking := tables.not_derived(now.result):
        pieces.append(details("not determined, and why", pre(lacking)))
    if curves:
        pieces.append(picture(validation_plots.damper_charts(curves)))
    return section("Derived values", *pieces, pre(tables.ranges(now.result)))


def parameters(now: Version) -> str:
    """Parameters with their intervals, and those that are not identified."""
    unknown = "".join(
        f"<tr><td>{html.escape(p['name'])}</td><td class=text>{html.escape(p['why'])}</td></tr>"
        for p in now.result["not_identifiable"]
    )
    return section(
        "Parameters",
        pre(tables.parameters(now.result)),
        details(
            f"{len(now.result['not_identifiable'])} that cannot be identified, and why", f"<table>{unknown}</table>"
        ),
    )


def rows(now: Version) -> str:
    """Scores of every row, and warnings."""
    scores = now.result["rows"]
    pieces = [f"<h3>Runs used</h3>{pre(tables.rows(scores['used']))}"]
    if scores["held"]:
        pieces.append(f"<h3>Runs held out</h3>{pre(tables.rows(scores['held']))}")
    warnings = "".join(f"<li>{html.escape(w)}</li>" for w in now.result["warnings"])
    if warnings:
        pieces.append(f"<h3>Warnings</h3><ul>{warnings}</ul>")
    return section("Errors by row", *(details("the table", piece) for piece in pieces))
