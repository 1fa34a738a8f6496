"""The report of a study: one small file that needs nothing else, drawn once."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
import shutil
from dataclasses import replace
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import lacet.services.workspace.report
from lacet.daq.formats.arrow_tables import write_columns
from lacet.identify.car.rows import Row
from lacet.identify.validation.score import pooled_ratio
from lacet.services.render import study_sections
from lacet.services.render.failure_report import where_pieces
from lacet.services.render.figures.curves import ROOM, SCRIPT, SCRIPT_HASH, curves_html, room_of
from lacet.services.render.figures.study_plots import fall_figure
from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.report_summary import _constant
from lacet.services.workbench.exports import report_policy
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.report import write_report
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.workbench.conftest import make_small, six_seconds

MOST = 2_000_000
"""Largest size of a report [bytes]."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study whose report was written."""
    folder = Path(shutil.copytree(six_seconds(), tmp_path_factory.mktemp("study") / "car"))
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        write_report(Session(Study.open(folder)), folder / "report.html")
    return folder


def _curves(text: str) -> dict[str, dict[str, Any]]:
    """Curves of the rows of each run, by the title of its part."""
    found = re.findall(
        r"<summary>(Run [^<]*)</summary>.*?<script type=\"application/json\">(.*?)</script>", text, re.DOTALL
    )
    return {title: {row["row"]: row for row in json.loads(body)} for title, body in found}


def _values(curve: dict[str, Any]) -> NDArray[np.float64]:
    codes = np.frombuffer(base64.b64decode(curve["data"]), "<u2")
    return np.where(codes == 65535, np.nan, curve["low"] + curve["step"] * codes.astype(float))


def test_it_is_small_and_the_curves_of_every_row_have_its_error(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert 100_000 < len(text.encode()) < MOST
    scores = Study.open(written).version().result["rows"]
    curves = _curves(text)
    for title, scored in (("Run used: sine", scores["used"]["sine"]), ("Run held out: rough", scores["held"]["rough"])):
        assert set(curves[title]) == set(scored)
        for row, score in scored.items():
            measured, modelled, error = map(_values, curves[title][row]["series"])
            rms = float(np.sqrt(np.nanmean((measured - modelled) ** 2)))
            assert rms == pytest.approx(score["rms"], rel=0.02, abs=1e-3 * np.nanstd(measured))
            assert np.nanstd(error) == pytest.approx(np.nanstd(measured - modelled), rel=0.02)


def test_long_curves_are_extremes_of_blocks_and_lose_no_peak(written: Path, monkeypatch: pytest.MonkeyPatch):
    make_small(monkeypatch)
    session = Session(Study.open(written))
    part = session.values.comparisons(session.study.version(), held=False)[0]
    rows = json.loads(curves_html(part, 60).partition('json">')[2].partition("<")[0])
    for row in rows:
        own = part.measured[Row.parse(row["row"])]
        drawn = _values(row["series"][0])
        assert 30 < drawn.size <= 60
        assert (np.nanmin(drawn), np.nanmax(drawn)) == pytest.approx(
            (own.min(), own.max()), abs=2 * row["series"][0]["step"]
        )
        t = part.t[Row.parse(row["row"])]
        assert row["t0"] + row["dt"] * (row["n"] - 1) == pytest.approx(t[-1], abs=row["dt"] * 2.5)


def test_many_long_runs_have_room(written: Path, monkeypatch: pytest.MonkeyPatch):
    """Four runs of 600 s, each row at the fit's rate: the curves stay within their room, with a peak in one column."""
    make_small(monkeypatch)
    session = Session(Study.open(written))
    part = session.values.comparisons(session.study.version(), held=False)[0]
    rate = 1.0 / float(np.median(np.diff(next(iter(part.t.values())))))
    t = np.arange(int(600.0 * rate)) / rate
    series = np.random.default_rng(0).normal(size=t.size)
    series[1234] = 99.0
    rows = dict.fromkeys(part.measured, series)
    long = replace(part, t=dict.fromkeys(part.measured, t), measured=rows, modelled=dict.fromkeys(rows, 0.5 * series))
    room = room_of([long] * 4)
    assert 200 < room < 2000
    text = curves_html(long, room)
    assert 0.5 * ROOM < 4 * len(text) < 1.1 * ROOM
    assert np.nanmax(
        _values(json.loads(text.partition('json">')[2].partition("<")[0])[0]["series"][0])
    ) == pytest.approx(99.0)


def test_the_first_page_says_what_of_which_runs_and_by_which_lacet(written: Path, monkeypatch: pytest.MonkeyPatch):
    make_small(monkeypatch)
    folder = Path(shutil.copytree(written, written.parent / "added"))
    session = Session(Study.open(folder))
    session.add("anti_roll_bar.front")
    result = session.study.version().result
    for name in ("report.html", "report.md"):
        write_report(session, folder / name)
        text = html.unescape((folder / name).read_text(encoding="utf-8"))
        first = (
            text.partition('<details class="part">')[0] if name.endswith("html") else text.partition("## Parameters")[0]
        )
        bar = next(p for p in result["parameters"] if p["name"] == "anti_roll_bar.front.k")
        plain = first.replace("\\", "")
        assert to_interval(bar["value"], bar["half95_sheet"]) in plain
        assert half_width(bar["half95_sheet"]) in plain
        assert metadata.version("lacet") in plain
        assert result["vehicle"] in plain
        for run in ("sine", "rough"):
            digest = hashlib.sha256((folder / "runs" / f"{run}.parquet").read_bytes()).hexdigest()
            assert digest[:16] in plain
        for ratio in (pooled_ratio(result["rows"]["used"]), pooled_ratio(result["rows"]["held"])):
            assert f"{ratio:.2f}" in plain
        assert f"{len(result['not_identifiable'])} parameters are not identified" in plain
    assert (folder / "report.png").read_bytes().startswith(b"\x89PNG")
    lines = (folder / "report.md").read_text(encoding="utf-8").splitlines()
    tables = [lines[k - 1 : k + 2] for k, line in enumerate(lines) if line.startswith("| ---")]
    assert len(tables) >= 6
    for rows in tables:
        assert len({re.sub(r"\\\\.", "", row).count("|") for row in rows}) == 1, rows


def test_tables_are_tables(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "<pre" not in text
    parameters = text.partition("<summary>Parameters</summary>")[2].partition("</table>")[0]
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", parameters)[1:]]
    result = Study.open(written).version().result
    assert [row[0] for row in cells] == [p["name"] for p in result["parameters"]]
    for column, half in ((2, "half95_sheet"), (3, "half95")):
        shown = [float(row[column]) for row in cells]
        assert shown == pytest.approx([p[half] for p in result["parameters"]], rel=0.1)


def test_what_is_given_or_assumed_stands_beside_the_parameters(written: Path):
    """Without wheel loads every size is in proportion to a mass that the vehicle file gives."""
    now = Study.open(written).version()
    mass = {"name": "sprung_mass", "value": 2200.0, "tolerance": 20.0, "unit": "kg", "given": True, "source": "scales"}
    given = replace(
        now, result={**now.result, "row_sources": [{"row": "body.heave", "add": "", "assumptions": [mass]}]}
    )
    text = html.unescape(study_sections.parameters(given))
    assert "Given or assumed, not measured" in text
    assert all(cell in text for cell in ("sprung_mass", "2200", "kg", "scales"))
    assert "Given or assumed, not measured" in dict(study_sections.further_tables(given, [now]))
    without = replace(now, result={**now.result, "row_sources": []})
    assert "Given or assumed" not in study_sections.parameters(without)


def test_a_model_that_does_not_fail_takes_one_line(written: Path, monkeypatch: pytest.MonkeyPatch):
    make_small(monkeypatch)
    session = Session(Study.open(written))
    found = session.values.failure(session.study.version())
    assert len(where_pieces(found)) > 5
    fine = replace(found, explainable={}, follows={}, ratios=dict.fromkeys(found.ratios, 1.0))
    assert len(where_pieces(fine)) == 1
    assert "No row fails" in where_pieces(fine)[0]


def test_it_needs_nothing_else(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    asked = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]{1,12})|url\(\s*["']?(.{1,12})""", text)
    assert asked
    assert all(one.startswith(("#", "data:")) for pair in asked for one in pair if one)
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert script == [SCRIPT]
    assert text.count("<script") == 1 + text.count('<script type="application/json">')
    assert SCRIPT_HASH in report_policy()
    assert "@import" not in text
    assert "@font-face" not in text


def test_a_second_request_draws_nothing(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    make_small(monkeypatch)

    def drawn(*_: object) -> str:
        raise AssertionError("drawn again")

    monkeypatch.setattr(lacet.services.workspace.report, "_report", drawn)
    first = (written / "report.html").read_bytes()
    write_report(Session(Study.open(written)), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == first
    cache = SessionCache(written)  # as the page's button does
    session = cache.session(cache.study, lambda _: None)
    write_report(session, tmp_path / "page.html")
    assert (tmp_path / "page.html").read_bytes() == first
    assert not any(session.runs.present), "and no run is read"
    text = (written / "study.json").read_text(encoding="utf-8")
    assert '"draws": 19' in text
    (written / "study.json").write_text(text.replace('"draws": 19', '"draws": 29'), encoding="utf-8")
    with pytest.raises(AssertionError, match="drawn again"):
        write_report(Session(Study.open(written)), tmp_path / "other.html")


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_the_manoeuvre_of_a_table_is_what_its_metadata_say(tmp_path: Path, suffix: str):
    file = tmp_path / f"run{suffix}"
    write_columns(file, {"t": np.arange(3.0)}, {"manoeuvre": "slalom", "vehicle": "a.toml"})
    assert lacet.services.workspace.report._recorded(file) == ("slalom", "")
    file.write_bytes(b"PAR1 cut off")
    file.with_suffix(".json").write_text("no JSON", encoding="utf-8")
    assert lacet.services.workspace.report._recorded(file) == ("", "")


@pytest.mark.parametrize(("key", "name", "value", "line"), [
    ("bump_stop.rear", "gap", 0.01734, ["mm", "17.34"]), ("bump_stop.rear", "n", 2.016, ["-", "2.016"]),
    ("coulomb.front", "v0", 0.008, ["mm/s", "8"]), ("own.front", "x0", 0.5, ["SI", "0.5"]),
])  # fmt: skip
def test_constants_have_the_unit_people_read(key: str, name: str, value: float, line: list[str]):
    assert _constant("label", key, name, value) == ["label", f"{key}: {name}", *line, ""]


@pytest.mark.parametrize("count", [2, 4, 5, 6, 8, 12])
def test_versions_do_not_run_into_each_other(count: int):
    """With long notes no label is wider than its share of the picture."""
    rows = {"used": {"a": {"chassis.fx": {"rms": 30.0, "floor": 20.0, "ratio": 1.5}}}, "held": {}}
    note = "added damper_asymmetry.rear and anti_roll_bar.front"
    versions = [SimpleNamespace(number=n, note=note, result={"rows": rows}) for n in range(1, count + 1)]
    figure = fall_figure(versions)
    figure.canvas.draw()
    boxes = [label.get_window_extent() for label in figure.axes[0].get_xticklabels()]
    assert len(boxes) == count
    assert all(left.x1 <= right.x0 for left, right in pairwise(boxes))
