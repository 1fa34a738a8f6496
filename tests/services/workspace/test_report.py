"""The report of a study: one small file that needs nothing else, drawn once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import lacet.services.workspace.report
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.report import write_report
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.workbench.conftest import make_small, study_of

MOST = 2_000_000
"""Largest size of a report [bytes]."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study whose report was written."""
    folder = study_of(tmp_path_factory.mktemp("study") / "car", 6.0)
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        write_report(Session(Study.open(folder)), folder / "report.html")
    return folder


def test_it_is_small_and_has_a_picture_of_every_row(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert 100_000 < len(text.encode()) < MOST
    study = Study.open(written)
    pictures = re.findall(r"<figure>(.*?)</figure>", text, re.DOTALL)
    for kind, name in (("used", "sine"), ("held", "rough")):
        own = [one for one in pictures if f"<title>{name}: run {kind}" in one]
        for row in study.version().result["rows"][kind][name]:
            assert any(f">{row} [" in one for one in own), (name, row)


def test_it_needs_nothing_else(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    asked = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]{1,12})|url\(\s*["']?(.{1,12})""", text)
    assert asked
    assert all(one.startswith(("#", "data:")) for pair in asked for one in pair if one)
    assert "<script" not in text
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
