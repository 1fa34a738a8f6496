"""Reports as files: of a study (history, analyses, comparisons), of where a version fails, and single pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.services.cache.keys import text_digest
from lacet.services.progress import ServiceStage, ServiceStep
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Version


def write_report(session: Session, file: Path) -> None:
    """Write the report of a study: fall of the error, failure analysis, missing effects, parameters."""
    study = session.study
    files = [one for part in ("versions", "diagnoses") for one in sorted((study.folder / part).glob("*.json"))]
    content = [text_digest(one) for one in files]

    def write() -> str:
        now, first = study.version(), study.versions()[0]
        wanted = [("compared", now), ("compared", first), ("where", first), ("first failure", first)]
        if now.number != first.number:
            wanted += [("where", now), ("present failure", now)]
        wanted.append(("dampers", now))
        with session.planned(*wanted):
            return _report(session)

    text = session.values.page("report", study.version(), content, write)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


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


def _report(session: Session) -> str:
    """The report's HTML text."""
    # Only here: matplotlib takes half a second to load.
    from lacet.services.render import study_sections as sections
    from lacet.services.render.html import page

    study, progress = session.study, session.progress
    versions = study.versions()
    now, first = study.version(), versions[0]
    progress(ServiceStep(ServiceStage.COMPARING_FOR_REPORT))
    after = {kind: session.values.comparisons(now, held=kind == "held") for kind in ("used", "held")}
    before = after if first.number == now.number else {
        kind: session.values.comparisons(first, held=kind == "held") for kind in ("used", "held")
    }  # fmt: skip
    progress(ServiceStep(ServiceStage.DRAWING_REPORT))
    diagnosis = study.diagnosis()
    parts = [
        sections.head(versions[0], now, len(study.used), len(study.held), diagnosis),
        sections.error_falls(versions),
    ]
    failing = session.values.failure(first)
    progress(ServiceStep(ServiceStage.DRAWING_FIRST_FAILURE))
    pieces = sections.base_model_fails(failing)
    if now.number != first.number:
        later = session.values.failure(now)
        progress(ServiceStep(ServiceStage.DRAWING_PRESENT_FAILURE))
        pieces += sections.present_model_fails(now, failing.worst[0], before["used"], after["used"], later)
    curves = session.values.damper_curves(now) if now.result.get("derived") else {}
    found = {v.number: study.diagnosis(v.number) for v in versions}
    parts += [
        sections.where_it_fails(pieces),
        sections.findings(versions, found),
        sections.against_measurement(after, progress),
        sections.derived_values(now, curves),
        sections.parameters(now),
        sections.rows(now),
    ]
    return page(f"lacet: {study.folder.name}", "\n".join(parts))
