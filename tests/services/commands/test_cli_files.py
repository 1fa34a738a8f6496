"""Files and folders that cannot be written: one line and exit code 2, no traceback."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import pytest

from lacet.services.commands.__main__ import main
from tests.support.captures import SINUS


def test_a_folder_that_cannot_be_made_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `lacet identify --pictures` does with a folder below a file."""
    (tmp_path / "file").write_text("", encoding="utf-8")

    def run(_: argparse.Namespace) -> int:
        (tmp_path / "file" / "pictures").mkdir(parents=True)
        return 0

    parsed = argparse.Namespace(command="identify", json=None, run=run)
    parser = SimpleNamespace(parse_known_args=lambda _: (parsed, []))
    monkeypatch.setattr("lacet.services.commands.__main__.build_parser", lambda _: parser)
    assert main(["identify"]) == 2
    assert capsys.readouterr().err == f"lacet identify: {tmp_path / 'file'} is a file: name a folder in its place\n"


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As in `lacet decode -o`, whose folder is made."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert main(["decode", str(SINUS), "-o", str(tmp_path / "file" / "run.mcap")]) == 2
    assert capsys.readouterr().err == f"lacet decode: {tmp_path / 'file'} is a file: name a folder in its place\n"
