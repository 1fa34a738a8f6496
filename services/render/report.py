"""A study as one self-contained HTML file with pictures."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.properties.derived import damper_curves
from lacet.identify.validation.score import Comparison
from lacet.services.render import plots, tables, validation_plots
from lacet.services.render.failure_report import where_pieces
from lacet.services.render.html import details, page, picture, pre, section
from lacet.services.workspace.failure import find_where
from lacet.services.workspace.session import Work, overall
from lacet.services.workspace.study import Study, Version


def write_report(work: Work, file: Path, progress: Progress = silent) -> None:
    """Write the report of a study: how the error fell, where the model failed, what was missing, the parameters."""
    study = work.study
    versions = study.versions()
    now, first = study.version(), versions[0]
    progress(Step(Stage.COMPARING_FOR_REPORT))
    after = {kind: work.comparisons(now, held=kind == "held") for kind in ("used", "held")}
    before = after if first.number == now.number else {
        kind: work.comparisons(first, held=kind == "held") for kind in ("used", "held")
    }  # fmt: skip
    progress(Step(Stage.DRAWING_REPORT))
    parts = [
        _head(study, versions, now),
        section("The error falls", picture(plots.fall_figure(versions)), pre(tables.history(versions))),
        _failing(work, first, now, before, after, progress),
        _findings(study, versions),
        _against_measurement(after, progress),
        _derived(work, now),
        _parameters(now),
        _rows(now),
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(page(f"lacet: {study.folder.name}", "\n".join(parts)), encoding="utf-8")


def _head(study: Study, versions: Sequence[Version], now: Version) -> str:
    first = versions[0].result["rows"]
    rows = now.result["rows"]
    added = ", ".join(now.effects) or "nothing"
    held = ""
    if rows["held"]:
        held = f", from {overall(first['held']):.2f} to {overall(rows['held']):.2f} on the runs held out"
    diagnosis = study.diagnosis()
    verdict = html.escape(str(diagnosis["says"])) if diagnosis else "This version has not been diagnosed."
    return (
        f"<h1>{html.escape(str(now.result['vehicle']))}</h1>"
        f'<p class="note">{len(study.used)} runs used, {len(study.held)} held out; version {now.number}; '
        f"{html.escape(str(now.result['wheel_reference']))} wheel loads; rig {html.escape(str(now.result['rig']))}</p>"
        f'<p class="big">Added to the base model: <b>{html.escape(added)}</b>. Error ÷ noise floor went from '
        f"{overall(first['used']):.2f} to {overall(rows['used']):.2f} on the runs used{held}.</p><p>{verdict}</p>"
    )


def _failing(
    work: Work, first: Version, now: Version, before: Mapping[str, list[Comparison]],
    after: Mapping[str, list[Comparison]], progress: Progress,
) -> str:  # fmt: skip
    """Where the first model failed, its worst row before and after, and what is left to explain now."""
    found = find_where(work, first, progress)
    progress(Step(Stage.DRAWING_FIRST_FAILURE))
    out = [f"<h3>The base model</h3>{''.join(where_pieces(found))}"]
    if now.number != first.number:
        row = found.worst[0]
        having = [c for c in before["used"] if row in c.scores]
        old = max(having, key=lambda c: c.scores[row].ratio)
        new = next(c for c in after["used"] if c.name == old.name)
        later = find_where(work, now, progress)
        progress(Step(Stage.DRAWING_PRESENT_FAILURE))
        out += [
            f"<h3>Now, with {html.escape(', '.join(now.effects))}</h3>",
            f"<p>{html.escape(row)} of run {html.escape(old.name)} before and after:</p>",
            picture(plots.comparison_figure(old, [row])),
            picture(plots.comparison_figure(new, [row])),
            *where_pieces(later),
        ]
    return section("Where it fails", *out)


def _findings(study: Study, versions: Sequence[Version]) -> str:
    found_parts: list[str] = []
    for v in versions:
        file = study.folder / "diagnoses" / f"{v.number:03d}.json"
        if file.is_file():
            found = json.loads(file.read_text(encoding="utf-8"))
            title = f"Version {v.number} ({html.escape(v.note)})"
            found_parts.append(f"<h3>{title}</h3><p>{html.escape(found['says'])}</p>")
            reasons = "".join(
                f"<tr><td>{html.escape(c['effect'])}</td><td class=text>{html.escape(c['why'])}</td></tr>"
                for c in found["candidates"]
            )
            found_parts.append(details("the ranking", pre(tables.candidates(found, 20)), f"<table>{reasons}</table>"))
    return section("What is missing", *(found_parts or ["<p>Not diagnosed yet: lacet diagnose.</p>"]))


def _against_measurement(after: Mapping[str, list[Comparison]], progress: Progress) -> str:
    """Every run, measured and modelled."""
    pieces: list[str] = []
    for title, kind in (("Run used", "used"), ("Run held out", "held")):
        for part in after[kind]:
            progress(Step(Stage.DRAWING_RUN, subject=part.name))
            pieces.append(details(f"{title}: {part.name}", *_validation(part)))
    pieces += [f'<p class="fail">{html.escape(line)}.</p>' for part in after["held"] for line in part.not_judged]
    return section("Model against measurement", *pieces)


def _validation(part: Comparison) -> list[str]:
    """Measurement, model and error by kind of row, and the colour of what is left."""
    figures = [plots.comparison_figure(part, rows) for rows in validation_plots.kinds(part).values()]
    if part.whiteness:
        figures += [validation_plots.spectrum_figure(part), validation_plots.acf_figure(part)]
    return [picture(figure) for figure in figures]


def _derived(work: Work, now: Version) -> str:
    """What an engineer thinks in, the damper curves, and the states that all of it covers."""
    if not now.result.get("derived"):
        return ""
    pieces = [pre(tables.derived(now.result))]
    if lacking := tables.not_derived(now.result):
        pieces.append(details("not determined, and why", pre(lacking)))
    curves = damper_curves(work.fitted(now), work.knowledge(now))
    if curves:
        pieces.append(picture(validation_plots.damper_figure(curves)))
    return section("Derived values", *pieces, pre(tables.ranges(now.result)))


def _parameters(now: Version) -> str:
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


def _rows(now: Version) -> str:
    rows = now.result["rows"]
    pieces = [f"<h3>Runs used</h3>{pre(tables.rows(rows['used']))}"]
    if rows["held"]:
        pieces.append(f"<h3>Runs held out</h3>{pre(tables.rows(rows['held']))}")
    warnings = "".join(f"<li>{html.escape(w)}</li>" for w in now.result["warnings"])
    if warnings:
        pieces.append(f"<h3>Warnings</h3><ul>{warnings}</ul>")
    return section("Errors by row", *(details("the table", piece) for piece in pieces))
