"""Exports of a study as files: the report, parameters and versions as tables, the study as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from lacet.daq.formats.result import FORMAT, plain
from lacet.identify.validation.score import pooled_ratio
from lacet.services.exports.tables import csv_text
from lacet.services.workbench.refusals import NotWritten
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workbench.study_views import parameters_payload
from lacet.services.workbench.tasks import MARKDOWN, PICTURE, REPORT
from lacet.services.workspace.results import study_result


@dataclass(frozen=True)
class File:
    """An exported file: name, kind (MIME), body, and content security policy where it is a page."""

    name: str
    kind: str
    body: bytes
    policy: str = ""


def report(cache: SessionCache) -> File:
    """The last report written. Raises NotWritten when there is none newer than the study's last change."""
    return File(f"{_name(cache)}-report.html", "text/html", _written(cache, REPORT), report_policy())


def report_policy() -> str:
    """Content security policy of the report: one file with its styles, its pictures and the script of its curves."""
    from lacet.services.render.figures.curves import SCRIPT_HASH  # only here: matplotlib takes half a second to load

    return (
        f"default-src 'none'; style-src 'unsafe-inline'; script-src '{SCRIPT_HASH}'; img-src data:; "
        "sandbox allow-scripts"
    )


def markdown(cache: SessionCache) -> File:
    """The same in Markdown: first page and tables."""
    return File(f"{_name(cache)}-report.md", "text/markdown; charset=utf-8", _written(cache, MARKDOWN))


def picture(cache: SessionCache) -> File:
    """The picture of the first page, under the name that the Markdown has for it."""
    return File(PICTURE, "image/png", _written(cache, PICTURE))


def _written(cache: SessionCache, name: str) -> bytes:
    """A file of the last report. Raises NotWritten when there is none newer than the study's last change."""
    file = cache.folder / name
    if not file.is_file() or file.stat().st_mtime < (cache.folder / "study.json").stat().st_mtime:
        raise NotWritten("report", "the report of the present version has not been written yet")
    return file.read_bytes()


def parameters(cache: SessionCache) -> File:
    """Table of the present version's parameters."""
    found = parameters_payload(cache.study, None)
    head = ["parameter", "effect", "value", "unit", "half95", "half95_sheet", "sxr_percent", "a_priori", "why_not"]
    rows = [
        [p["name"], p["effect"], p["value"], p["unit"], p["half95"], p["half95_sheet"], p["sxr_percent"], p["apriori"],
         ""]
        for p in found["parameters"]
    ]  # fmt: skip
    rows += [[p["name"], p["effect"], *[""] * 6, p["why"]] for p in found["not_identifiable"]]
    return _table(f"{_name(cache)}-parameters-v{found['version']}.csv", head, rows)


def versions(cache: SessionCache) -> File:
    """Table of every version's errors, by run and row."""
    head = ["version", "parent", "note", "effects", "kind", "run", "row", "unit", "rms", "floor", "error_in_floors",
            "nrmse_percent", "vaf_percent", "judged"]  # fmt: skip
    rows: list[list[Any]] = []
    for v in cache.study.versions():
        about = [v.number, v.parent, v.note, " ".join(v.effects)]
        for kind in ("used", "held"):
            parts = v.result["rows"][kind]
            if parts:
                rows.append([*about, kind, "all", "all", "", "", "", pooled_ratio(parts), "", "", ""])
            rows += [
                [*about, kind, run, row, s["unit"], s["rms"], s["floor"], s["ratio"], s["nrmse"], s["vaf"],
                 s.get("judged", True)]
                for run, scores in parts.items() for row, s in scores.items()
            ]  # fmt: skip
    return _table(f"{_name(cache)}-versions.csv", head, rows)


def study(cache: SessionCache) -> File:
    """The study as ``lacet study --json`` writes it, with the present version's whole result and diagnosis."""
    found = cache.study
    body = {
        "format": FORMAT, "command": "study", **study_result(found), "result": found.version().result,
        "diagnosis": found.diagnosis(),
    }  # fmt: skip
    text = json.dumps(plain(body), indent=1, ensure_ascii=False) + "\n"
    return File(f"{_name(cache)}-study.json", "application/json", text.encode())


MAKERS: dict[str, Callable[[SessionCache], File]] = {
    REPORT: report,
    MARKDOWN: markdown,
    PICTURE: picture,
    "parameters.csv": parameters,
    "versions.csv": versions,
    "study.json": study,
}


def _table(name: str, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> File:
    return File(name, "text/csv; charset=utf-8", csv_text(head, rows).encode())


def _name(cache: SessionCache) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in cache.folder.resolve().name) or "study"
