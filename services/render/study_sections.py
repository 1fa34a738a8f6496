"""Sections of a study's report as HTML with figures."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from lacet.identify.properties.derived import DamperCurve
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.score import Comparison
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render import tables
from lacet.services.render.failure_report import where_pieces
from lacet.services.render.figures import curves, study_plots, validation_plots
from lacet.services.render.html import details, folded, picture, table_html
from lacet.services.render.identifiability import rows_not_judged
from lacet.services.render.row_sources import ASSUMPTIONS_HEAD, assumptions_lines
from lacet.services.render.rows import said_of_runs
from lacet.services.render.study_version import Version
from lacet.services.render.tables import Table

_ASSUMED = "Given or assumed, not measured"


def error_falls(versions: Sequence[Version]) -> str:
    """Fall of the error, version by version."""
    return folded(
        "The error falls", picture(study_plots.fall_figure(versions)), table_html(tables.history_table(versions))
    )


def base_model_fails(found: FailureAnalysis) -> list[str]:
    """Failure analysis of the base model."""
    return [f"<h3>The base model</h3>{''.join(where_pieces(found))}"]


def present_model_fails(now: Version, found: FailureAnalysis) -> list[str]:
    """Failure analysis of the present model."""
    return [f"<h3>Now, with {html.escape(', '.join(now.effects))}</h3>", *where_pieces(found)]


def where_it_fails(pieces: Sequence[str]) -> str:
    """The section of these pieces."""
    return folded("Where it fails", *pieces)


def findings(versions: Sequence[Version], diagnoses: Mapping[int, Mapping[str, Any] | None]) -> str:
    """Diagnosis of each version that has one."""
    found_parts: list[str] = []
    for v in versions:
        found = diagnoses.get(v.number)
        if found is not None:
            title = f"Version {v.number} ({html.escape(v.note)})"
            found_parts.append(f"<h3>{title}</h3><p>{html.escape(found['says'])}</p>")
            reasons = Table(["effect", "why"], [[c["effect"], c["why"]] for c in found["candidates"]], text_columns=2)
            ranking = table_html(tables.candidate_table(found, 20))
            found_parts.append(details("the ranking", ranking, table_html(reasons)))
    return folded("What is missing", *(found_parts or ["<p>Not diagnosed yet: lacet diagnose.</p>"]))


def against_measurement(after: Mapping[str, list[Comparison]], progress: Progress) -> str:
    """Measured and modelled rows of every run."""
    pieces = ["<noscript><p>The curves are drawn by a script of this file, which is switched off here.</p></noscript>"]
    room = curves.room_of([part for parts in after.values() for part in parts])
    for title, kind in (("Run used", "used"), ("Run held out", "held")):
        for part in after[kind]:
            progress(ServiceStep(ServiceStage.DRAWING_RUN, subject=part.name))
            drawn = [curves.curves_html(part, room), *_whiteness(part)]
            pieces.append(details(f"{title}: {part.name}", _HOW, *drawn))
    pieces += [f'<p class="fail">{html.escape(line)}.</p>' for part in after["held"] for line in rows_not_judged(part)]
    return folded("Model against measurement", *pieces)


_HOW = (
    '<p class="note">Measured <b>━</b>, modelled <b class="model">━</b>, error about the mean <b class="error">━</b>. '
    "Drag across a curve to look closer; double click, or 0, for the whole run.</p>"
)


def _whiteness(part: Comparison) -> list[str]:
    """Spectrum and autocorrelation of the residual, folded."""
    if not part.whiteness:
        return []
    figures = [validation_plots.spectrum_charts(part), validation_plots.acf_charts(part)]
    return [details("Is the residual noise?", *map(picture, figures))]


def derived_values(now: Version, curves: Mapping[str, DamperCurve]) -> str:
    """Derived values, damper curves, and the ranges that all of it covers."""
    if not now.result.get("derived"):
        return ""
    pieces = [table_html(tables.derived_table(now.result))]
    if lacking := [[d["name"], d["why"]] for d in now.result["derived"] if not d["identifiable"]]:
        why = table_html(Table(["derived value", "why"], lacking, text_columns=2))
        pieces.append(details("not determined, and why", why))
    if curves:
        pieces.append(picture(validation_plots.damper_charts(curves)))
    return folded("Derived values", *pieces, table_html(tables.ranges_table(now.result)))


def parameters(now: Version) -> str:
    """Parameters with their intervals, and those that are not identified."""
    unknown = [[p["name"], p["why"]] for p in now.result["not_identifiable"]]
    pieces = [table_html(tables.parameter_table(now.result))]
    if now.result["whole_vehicle"]:
        title, whole = tables.whole_vehicle_table(now.result)
        pieces.append(f"<h3>{html.escape(title)}</h3>{table_html(whole)}")
    if assumed := _assumed(now):
        pieces.append(f"<h3>{_ASSUMED}</h3>{table_html(assumed)}")
    title = f"{len(unknown)} that cannot be identified, and why"
    why = table_html(Table(["parameter", "why"], unknown, text_columns=2))
    return folded("Parameters", *pieces, details(title, why))


def _assumed(now: Version) -> Table | None:
    """What the vehicle file gives, or is assumed, in place of what no channel measures; None where that is nothing."""
    lines = assumptions_lines(now.result.get("row_sources") or ())
    return Table(ASSUMPTIONS_HEAD, lines, text_columns=len(ASSUMPTIONS_HEAD)) if lines else None


def rows(now: Version) -> str:
    """Scores of every row, and warnings."""
    scores = now.result["rows"]
    pieces = [f"<h3>Runs used</h3>{table_html(tables.rows_table(scores['used']))}"]
    if scores["held"]:
        pieces.append(f"<h3>Runs held out</h3>{table_html(tables.rows_table(scores['held']))}")
    warnings = "".join(f"<li>{html.escape(w)}</li>" for w in said_of_runs(now.result))
    if warnings:
        pieces.append(f"<h3>Warnings</h3><ul>{warnings}</ul>")
    return folded("Errors by row", *pieces)


def further_tables(now: Version, versions: Sequence[Version]) -> list[tuple[str, Table]]:
    """What a report in Markdown has beside its first page: titles and tables."""
    out = [("The error by version", tables.history_table(versions))]
    if now.result.get("derived"):
        out.append(("Derived values", tables.derived_table(now.result)))
    out.append(("Parameters", tables.parameter_table(now.result)))
    if now.result["whole_vehicle"]:
        out.append(tables.whole_vehicle_table(now.result))
    if assumed := _assumed(now):
        out.append((_ASSUMED, assumed))
    out += [
        (f"Errors by row, runs {title}", tables.rows_table(now.result["rows"][kind]))
        for title, kind in (("used", "used"), ("held out", "held"))
        if now.result["rows"][kind]
    ]
    return out
