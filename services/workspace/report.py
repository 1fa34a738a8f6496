"""Reports as files: of a study (history, analyses, comparisons), of where a version fails, and single pictures."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from lacet.daq.errors import LacetError
from lacet.daq.formats.exchange import SUFFIXES, metadata_of
from lacet.daq.formats.log import LogReader
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.score import Comparison
from lacet.services.cache.keys import run_digests, text_digest
from lacet.services.progress import ServiceStage, ServiceStep
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Version

if TYPE_CHECKING:  # loaded where they are used: matplotlib takes half a second, and may not be installed
    from lacet.services.render.figures.panels import Panels
    from lacet.services.render.report_summary import RunAbout, Summary


def write_report(session: Session, file: Path) -> None:
    """Write the report of a study: a first page to be pasted, and the rest folded; as Markdown where `file` is one.

    Markdown has the first page and the tables; its picture stands beside it, as a PNG of the same name.
    """
    study = session.study
    plain = file.suffix.lower() in MARKDOWN
    files = [one for part in ("versions", "diagnoses") for one in sorted((study.folder / part).glob("*.json"))]
    content = [*map(text_digest, files), _software(), _script_digest()]
    name = file.with_suffix(".png").name if plain else ""
    text = session.values.page(
        "report-markdown" if plain else "report", study.version(), [*content, name] if plain else content,
        lambda: _planned(session, name if plain else None),
    )  # fmt: skip
    file.parent.mkdir(parents=True, exist_ok=True)
    if plain:
        picture = session.values.page("report-picture", study.version(), content, lambda: _picture(session))
        file.with_suffix(".png").write_bytes(base64.b64decode(picture))
    file.write_text(text, encoding="utf-8")


MARKDOWN = (".md", ".markdown")
"""Suffixes of a report in Markdown."""


def _planned(session: Session, markdown_picture: str | None) -> str:
    """The report's text, its making announced; `markdown_picture` : file of the picture in Markdown, None for HTML."""
    study = session.study
    now, first = study.version(), study.versions()[0]
    wanted: list[tuple[str, Version]] = [("compared", now), ("compared", first), ("where", first)]
    if markdown_picture is None:
        wanted.append(("first failure", first))
        if now.number != first.number:
            wanted += [("where", now), ("present failure", now)]
        wanted.append(("dampers", now))
    with session.planned(*wanted):
        return _report(session) if markdown_picture is None else _markdown(session, markdown_picture)


def write_where(session: Session, version: Version, found: FailureAnalysis, file: Path, asked: Sequence[str]) -> None:
    """Write a version's failure analysis with all its pictures; `asked` : the row and the run that were asked for."""
    text = session.values.page("where-page", version, list(asked), lambda: _where_page(session, version, found))
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


def _where_page(session: Session, version: Version, found: FailureAnalysis) -> str:
    # Only here: matplotlib takes half a second to load.
    from lacet.services.render.failure_report import where_page

    session.progress(ServiceStep(ServiceStage.DRAWING_PRESENT_FAILURE))
    return where_page(found, session.study.folder.name, version.number, list(version.effects))


def write_pictures(pictures: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write pictures, name → PNG, into a folder; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    for name, content in pictures.items():
        files.append(folder / f"{name}.png")
        files[-1].write_bytes(content)
    return files


@dataclass(frozen=True)
class _Compared:
    """The versions whose errors a report compares, base and present, against the runs, and where the base fails."""

    first: Version
    now: Version
    before: Mapping[str, list[Comparison]]
    after: Mapping[str, list[Comparison]]
    failing: FailureAnalysis


def _compared(session: Session) -> _Compared:
    study = session.study
    now, first = study.version(), study.versions()[0]
    session.progress(ServiceStep(ServiceStage.COMPARING_FOR_REPORT))
    after = {kind: session.values.comparisons(now, held=kind == "held") for kind in ("used", "held")}
    before = after if first.number == now.number else {
        kind: session.values.comparisons(first, held=kind == "held") for kind in ("used", "held")
    }  # fmt: skip
    return _Compared(first, now, before, after, session.values.failure(first))


def _first_page(session: Session, found: _Compared) -> Summary:
    """The first page: of its row, the worst of the base model, it draws the run where that fails most."""
    from lacet.services.render.report_summary import summary

    study = session.study
    about = [
        ("study", study.folder.resolve().name),
        ("date", datetime.now(UTC).strftime("%Y-%m-%d")),
        ("lacet", _software()),
    ]
    chart = _before_after(found)
    return summary(found.first, found.now, study.diagnosis(), _runs(session, found.after), about, chart)


def _before_after(found: _Compared) -> Panels:
    from lacet.services.render.figures.study_plots import before_after_charts

    row = found.failing.worst[0]
    old = max((part for part in found.before["used"] if row in part.scores), key=lambda part: part.scores[row].ratio)
    new = next((part for part in found.after["used"] if part.name == old.name), None)
    if new is None or row not in new.scores:  # runs chosen anew since: only the present model has these
        new = old = max((c for c in found.after["used"]), key=lambda part: max(s.ratio for s in part.scores.values()))
        row = max(new.scores, key=lambda one: new.scores[one].ratio)
    return before_after_charts(old, new, row)


def _runs(session: Session, after: Mapping[str, list[Comparison]]) -> list[RunAbout]:
    """The study's runs: role, manoeuvre, date, seconds and digest of each."""
    from lacet.services.render.report_summary import RunAbout

    study = session.study
    out: list[RunAbout] = []
    for kind, role in (("used", "used for the fit"), ("held", "held out")):
        paths = study.paths(held=kind == "held")
        for path, digest, part in zip(paths, run_digests(study.folder, paths), after[kind], strict=True):
            manoeuvre, date = _recorded(path)
            out.append(RunAbout(part.name, role, manoeuvre, date, part.seconds, digest))
    return out


def _recorded(run: Path) -> tuple[str, str]:
    """Manoeuvre of a run, and when its recording began; empty where its file does not say it."""
    try:
        if run.suffix.lower() in SUFFIXES:
            return str(metadata_of(run).get("manoeuvre", "")), ""
        if run.suffix.lower() != ".mcap":
            return "", ""
        start = LogReader(run).start
        date = datetime.fromtimestamp(1e-9 * start.started_ns, UTC).strftime("%Y-%m-%d %H:%M")
        return start.manoeuvre, date if start.started_ns > 0 else ""
    except (LacetError, OverflowError, ValueError, OSError):
        return "", ""


def _script_digest() -> str:
    """Digest of what draws the curves: a text that no digest of sources counts."""
    from lacet.services.render.figures.curves import SCRIPT_HASH

    return SCRIPT_HASH


def _software() -> str:
    """Version of lacet."""
    try:
        return metadata.version("lacet")
    except metadata.PackageNotFoundError:
        return "from a folder, not installed"


def _picture(session: Session) -> str:
    """The picture of the first page as PNG, in base 64."""
    from lacet.services.render.figures.png import charts_png

    return base64.b64encode(charts_png(_before_after(_compared(session)))).decode()


def _markdown(session: Session, picture_file: str) -> str:
    """The report's text in Markdown."""
    from lacet.services.render import study_sections as sections
    from lacet.services.render.report_page import markdown

    found = _compared(session)
    parts = sections.further_tables(found.now, session.study.versions())
    return markdown(_first_page(session, found), picture_file, parts)


def _report(session: Session) -> str:
    """The report's HTML text."""
    # Only here: matplotlib takes half a second to load.
    from lacet.services.render import study_sections as sections
    from lacet.services.render.figures.curves import SCRIPT, STYLE
    from lacet.services.render.html import page
    from lacet.services.render.report_page import first_page

    study, progress = session.study, session.progress
    versions = study.versions()
    found = _compared(session)
    now, first = found.now, found.first
    progress(ServiceStep(ServiceStage.DRAWING_REPORT))
    parts = [first_page(_first_page(session, found)), sections.error_falls(versions)]
    progress(ServiceStep(ServiceStage.DRAWING_FIRST_FAILURE))
    pieces = sections.base_model_fails(found.failing)
    if now.number != first.number:
        later = session.values.failure(now)
        progress(ServiceStep(ServiceStage.DRAWING_PRESENT_FAILURE))
        pieces += sections.present_model_fails(now, later)
    curves = session.values.damper_curves(now) if now.result.get("derived") else {}
    curves = {corner: curve for corner, curve in curves.items() if corner in now.result["damper_curves"]}
    parts += [
        sections.where_it_fails(pieces),
        sections.findings(versions, {v.number: study.diagnosis(v.number) for v in versions}),
        sections.against_measurement(found.after, progress),
        sections.derived_values(now, curves),
        sections.parameters(now),
        sections.rows(now),
    ]
    return page(f"lacet: {study.folder.name}", "\n".join(parts), SCRIPT, STYLE)
