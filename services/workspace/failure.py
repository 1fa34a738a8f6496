"""Failure analysis of a version of a study's model, on the study's runs, and its result as plain data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.result import plain
from lacet.identify.car.manoeuvre_phases import phases_of
from lacet.identify.validation.failure_analysis import FailureAnalysis, analyse_failure
from lacet.services.progress import Progress
from lacet.services.render.failure_text import failure_sentences
from lacet.services.render.rows import explainable
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Version


def analyse_version(
    session: Session, version: Version, progress: Progress | None = None, row: str = "", run: str = ""
) -> FailureAnalysis:
    """The failure analysis of a version, in all rows and runs or in those asked for.

    Raises UsageError for an unknown row or run.
    """
    progress = progress or session.progress
    fitted = session.fitted(version)
    chosen = next((one for one in fitted.rows if one == row), None)
    if row and chosen is None:
        raise UsageError(f"no row {row} in these runs{nearest(row, fitted.rows)}: {', '.join(fitted.rows)}")
    pairs = session.pairs(version)
    if run:
        names = [part.name for part, _ in pairs]
        if run not in names:
            raise UsageError(f"no run {run} in this study{nearest(run, names)}: {', '.join(names)}")
        pairs = [(part, drive) for part, drive in pairs if part.name == run]
    parts = [part for part, _ in pairs]
    phases = [phases_of(drive.motion) for _, drive in pairs]
    floor = session.floor(version, progress)
    return analyse_failure(fitted, floor, parts, phases, chosen, progress)


def failure_result(version: Version, found: FailureAnalysis) -> dict[str, Any]:
    """The failure analysis of a version as plain data (``docs/json.md``, ``where``)."""
    return plain(
        {
            "version": version.number,
            "effects": version.effects,
            "fails": found.failing,
            "rows": dict(found.ratios),
            "worst": list(found.worst),
            "phases": {
                part.name: [asdict(interval) for interval in split.intervals]
                for part, split in zip(found.parts, found.phases, strict=True)
            },
            "by_phase": {phase: {r: asdict(x) for r, x in rows.items()} for phase, rows in found.in_phase.items()},
            "follows": {
                row: [
                    {"state": f.state, "unit": f.unit, "part": f.part, "p": f.p, "rms": f.rms, "row_unit": f.row_unit}
                    for f in states
                ]
                for row, states in found.follows.items()
            },
            "against": {
                row: {
                    name: {
                        "unit": a.mean.unit, "put_back": a.put_back, "state": a.mean.centre, "mean": a.mean.mean,
                        "low": a.mean.low, "high": a.mean.high, "count": a.mean.count,
                    }
                    for name, a in found.against(row).items()
                }
                for row in found.worst
            },
            "coherence": {
                row: {
                    "level": s.level, "segments": s.segments,
                    "above": [{"state": n, "squared": c, "frequency": f} for n, c, f in s.strongest],
                }
                for row, s in found.spectra.items()
            },
            "surfaces": {
                corner: {
                    "travel": s.travel, "rate": s.rate, "residual": s.residual, "force": s.force, "count": s.count,
                    "blocks": s.blocks, "scatter": s.scatter,
                }
                for corner, s in found.surfaces.items()
            },
            "left": {
                row: {
                    **asdict(x), "something": x.something, "depends_on_history": x.depends_on_history,
                    "says": explainable(x),
                }
                for row, x in found.explainable.items()
            },
            "says": failure_sentences(found),
        }
    )  # fmt: skip
