"""A study as one self-contained HTML file with pictures."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from identify.derived import damper_curves
from identify.score import Comparison
from identify.study import Study, Version
from services import plots, tables, validation_plots
from services.fitting import Tell, Work, overall, silent

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #8886; }
table { border-collapse: collapse; font-size: 0.9rem; } th, td { padding: 0.15rem 0.7rem; text-align: right; }
th:first-child, td:first-child, td.text, th.text { text-align: left; } tr:nth-child(even) { background: #8881; }
img { max-width: 100%; background: white; } .big { font-size: 1.25rem; } .note { opacity: 0.8; }
details { margin: 0.6rem 0; } summary { cursor: pointer; } .fail { color: #b3261e; font-weight: 600; }
@media (prefers-color-scheme: dark) { .fail { color: #ff8a80; } }
"""


def write_report(work: Work, file: Path, tell: Tell = silent) -> None:
    """Write the report of a study: how the error fell, where the model failed, what was missing, the parameters."""
    study = work.study
    versions = study.versions()
    now, first = study.version(), versions[0]
    tell("comparing for the report")
    after = {kind: work.comparisons(now, held=kind == "held") for kind in ("used", "held")}
    before = after if first.number == now.number else {
        kind: work.comparisons(first, held=kind == "held") for kind in ("used", "held")
    }  # fmt: skip
    tell("drawing the report")
    parts = [
        _head(study, versions, now),
        _section("The error falls", _picture(plots.fall_figure(versions)), _pre(tables.history(versions))),
        _failing(work, first, before, after),
        _findings(study, versions),
        _section(
            "Model against measurement",
            *(
                _details(f"{title}: {part.name}", *_validation(part))
                for title, kind in (("Run used", "used"), ("Run held out", "held"))
                for part in after[kind]
            ),
            *(f'<p class="fail">{html.escape(line)}.</p>' for part in after["held"] for line in part.not_judged),
        ),
        _derived(work, now),
        _parameters(now),
        _rows(now),
    ]
    body = "\n".join(parts)
    title = html.escape(f"lacet: {study.folder.name}")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head>\n'
        f"<body>\n{body}\n</body></html>\n",
        encoding="utf-8",
    )


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
    work: Work, first: Version, before: Mapping[str, list[Comparison]], after: Mapping[str, list[Comparison]]
) -> str:
    """Where the first model failed: the map, and the worst row before and after."""
    where, ratio = tables.worst({c.name: {r: {"ratio": s.ratio} for r, s in c.scores.items()} for c in before["used"]})
    run, row = where.rsplit(": ", 1)
    old = next(c for c in before["used"] if c.name == run)
    new = next(c for c in after["used"] if c.name == run)
    pieces = [
        f"<p>The base model fails most in <b>{row}</b> of run {html.escape(run)}: {ratio:.1f} times its floor.</p>",
        _picture(plots.map_figure(before["used"])),
    ]
    states = _states(work, run, row)
    if states:
        pieces.append(_picture(plots.against_figure(old, row, states)))
    if old is not new:
        pieces += [
            f"<p>The same row before and after ({html.escape(', '.join(work.study.version().effects))} added):</p>",
            _picture(plots.comparison_figure(old, [row])),
            _picture(plots.comparison_figure(new, [row])),
            "<p>The residual map of the present model:</p>",
            _picture(plots.map_figure(after["used"])),
        ]
    return _section("Where it fails", *pieces)


def _states(work: Work, run: str, row: str) -> dict[str, Any]:
    """States to see a row's error against: those of its own corner, and the difference across the axle."""
    drive = next(d for d in work.loaded.drives if d.name == run)
    corner = row.split(".")[1]
    if corner not in drive.motion.corners:
        series = {f"body rate about {a} [rad/s]": drive.motion.body.omega[k] for k, a in enumerate("xyz")}
    else:
        own, other = drive.motion.corners[corner], drive.motion.corners[corner[0] + ("r" if corner[1] == "l" else "l")]
        series = {
            "travel [mm]": 1e3 * own.travel,
            "travel rate [mm/s]": 1e3 * own.rate,
            "travel left − right [mm]": 1e3 * (own.travel - other.travel) * (1 if corner[1] == "l" else -1),
        }
    return {name: drive.decimated({row: values})[row] for name, values in series.items()}


def _findings(study: Study, versions: Sequence[Version]) -> str:
    pieces: list[str] = []
    for v in versions:
        file = study.folder / "diagnoses" / f"{v.number:03d}.json"
        if file.is_file():
            found = json.loads(file.read_text(encoding="utf-8"))
            pieces.append(f"<h3>Version {v.number} ({html.escape(v.note)})</h3><p>{html.escape(found['says'])}</p>")
            reasons = "".join(
                f"<tr><td>{html.escape(c['effect'])}</td><td class=text>{html.escape(c['why'])}</td></tr>"
                for c in found["candidates"]
            )
            pieces.append(_details("the ranking", _pre(tables.candidates(found, 20)), f"<table>{reasons}</table>"))
    return _section("What is missing", *(pieces or ["<p>Not diagnosed yet: lacet diagnose.</p>"]))


def _validation(part: Comparison) -> list[str]:
    """Measurement, model and error by kind of row, and the colour of what is left."""
    figures = [plots.comparison_figure(part, rows) for rows in validation_plots.kinds(part).values()]
    if part.whiteness:
        figures += [validation_plots.spectrum_figure(part), validation_plots.acf_figure(part)]
    return [_picture(figure) for figure in figures]


def _derived(work: Work, now: Version) -> str:
    """What an engineer thinks in, the damper curves, and the states that all of it covers."""
    if not now.result.get("derived"):
        return ""
    pieces = [_pre(tables.derived(now.result))]
    if lacking := tables.not_derived(now.result):
        pieces.append(_details("not determined, and why", _pre(lacking)))
    curves = damper_curves(work.fitted(now), work.knowledge(now))
    if curves:
        pieces.append(_picture(validation_plots.damper_figure(curves)))
    return _section("Derived values", *pieces, _pre(tables.ranges(now.result)))


def _parameters(now: Version) -> str:
    unknown = "".join(
        f"<tr><td>{html.escape(p['name'])}</td><td class=text>{html.escape(p['why'])}</td></tr>"
        for p in now.result["not_identifiable"]
    )
    return _section(
        "Parameters",
        _pre(tables.parameters(now.result)),
        _details(
            f"{len(now.result['not_identifiable'])} that cannot be identified, and why", f"<table>{unknown}</table>"
        ),
    )


def _rows(now: Version) -> str:
    rows = now.result["rows"]
    pieces = [f"<h3>Runs used</h3>{_pre(tables.rows(rows['used']))}"]
    if rows["held"]:
        pieces.append(f"<h3>Runs held out</h3>{_pre(tables.rows(rows['held']))}")
    warnings = "".join(f"<li>{html.escape(w)}</li>" for w in now.result["warnings"])
    if warnings:
        pieces.append(f"<h3>Warnings</h3><ul>{warnings}</ul>")
    return _section("Errors by row", *(_details("the table", piece) for piece in pieces))


def _section(title: str, *pieces: str) -> str:
    return f"<section><h2>{html.escape(title)}</h2>{''.join(pieces)}</section>"


def _details(title: str, *pieces: str) -> str:
    return f"<details><summary>{html.escape(title)}</summary>{''.join(pieces)}</details>"


def _pre(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"


def _picture(figure: Figure) -> str:
    data = base64.b64encode(plots.png(figure)).decode("ascii")
    return f'<p><img alt="" src="data:image/png;base64,{data}"></p>'
