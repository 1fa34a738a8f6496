"""Report of a study as one HTML file: its history, analyses and comparisons."""

from __future__ import annotations

from pathlib import Path

from lacet.identify.progress import silent
from lacet.identify.properties.derived import damper_curves
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render import study_sections as sections
from lacet.services.render.html import page
from lacet.services.workspace.failure import analyse_version
from lacet.services.workspace.session import Session


def write_report(session: Session, file: Path, progress: Progress = silent) -> None:
    """Write the report of a study: fall of the error, failure analysis, missing effects, parameters."""
    study = session.study
    versions = study.versions()
    now, first = study.version(), versions[0]
    progress(ServiceStep(ServiceStage.COMPARING_FOR_REPORT))
    after = {kind: session.comparisons(now, held=kind == "held") for kind in ("used", "held")}
    before = after if first.number == now.number else {
        kind: session.comparisons(first, held=kind == "held") for kind in ("used", "held")
    }  # fmt: skip
    progress(ServiceStep(ServiceStage.DRAWING_REPORT))
    diagnosis = study.diagnosis()
    parts = [
        sections.head(versions[0], now, len(study.used), len(study.held), diagnosis),
        sections.error_falls(versions),
    ]
    failing = analyse_version(session, first, progress)
    progress(ServiceStep(ServiceStage.DRAWING_FIRST_FAILURE))
    pieces = sections.base_model_fails(failing)
    if now.number != first.number:
        later = analyse_version(session, now, progress)
        progress(ServiceStep(ServiceStage.DRAWING_PRESENT_FAILURE))
        pieces += sections.present_model_fails(now, failing.worst[0], before["used"], after["used"], later)
    curves = damper_curves(session.fitted(now), session.knowledge(now)) if now.result.get("derived") else {}
    found = {v.number: study.diagnosis(v.number) for v in versions}
    parts += [
        sections.where_it_fails(pieces),
        sections.findings(versions, found),
        sections.against_measurement(after, progress),
        sections.derived_values(now, curves),
        sections.parameters(now),
        sections.rows(now),
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(page(f"lacet: {study.folder.name}", "\n".join(parts)), encoding="utf-8")
