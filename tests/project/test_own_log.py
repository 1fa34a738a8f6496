"""docs/own-log.md: its commands run, in order, and print what it shows."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from benchmarks.stories.page import STORIES, not_printed, play, steps
from lacet.daq.formats.open_run import open_run
from tests.support.foreign_logs import foreign, write_csv
from tests.support.tables import CAR, piece

PAGE = STORIES.parent / "own-log.md"


def test_the_commands_of_the_page_print_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    t, columns, _ = foreign(piece("sine", 3.0, 23.0))
    write_csv(tmp_path / "lap.csv", t, columns)
    for name in ("rig.toml", "vehicle.toml"):
        shutil.copy(CAR / name, tmp_path / name)
    (written,) = re.findall(
        r"^```toml car\.toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    (tmp_path / "car.toml").write_text(written, encoding="utf-8")
    blocks = steps("../own-log.md")
    assert len(blocks) == 2
    for step in blocks:
        printed = play(step)
        assert not_printed(step.shown, printed) is None, printed
    assert set(open_run(tmp_path / "lap.mcap").signals) == set(piece("sine", 3.0, 23.0).signals)
