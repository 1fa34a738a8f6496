"""The failure analysis of a study's version as plain data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from lacet.daq.formats.result import plain
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.services.render.failure_text import failure_sentences
from lacet.services.render.rows import explainable
from lacet.services.workspace.study import Version


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
                    for name, a in found.against[row].items()
                }
                for row in found.worst
            },
            "coherence": {
                row: {
                    "level": s.level, "segments": s.segments,
                    "above": [
                        {"state": n, "squared": c, "frequency": f, "explains": s.explained[n]}
                        for n, c, f in s.strongest
                    ],
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
