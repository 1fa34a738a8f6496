"""docs/own-log.md: its commands run, in order, and print what it shows."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from benchmarks.stories.page import STORIES, not_printed, play, steps
from lacet.daq.formats.open_run import open_run
from tests.support.foreign_logs import foreign, write_csv, write_mf4
from tests.support.places import HOME
from tests.support.tables import CAR, piece

PAGE = STORIES.parent / "own-log.md"
CAN = HOME / "tests" / "data" / "can"


def test_the_commands_of_the_page_print_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    t, columns, _ = foreign(piece("sine", 3.0, 23.0))
    write_csv(tmp_path / "lap.csv", t, columns)
    write_mf4(tmp_path / "lap.mf4", t, columns)
    shutil.copy(CAN / "road-car.candump.log", tmp_path / "drive.log")
    shutil.copy(CAN / "road-car.dbc", tmp_path)
    for name in ("rig.toml", "vehicle.toml"):
        shutil.copy(CAR / name, tmp_path / name)
    (written,) = re.findall(
        r"^```toml car\.toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    (tmp_path / "car.toml").write_text(all_corners(written), encoding="utf-8")
    blocks = steps("../own-log.md")
    assert len(blocks) == 4
    for step in blocks:
        printed = play(step)
        assert not_printed(step.shown, printed) is None, printed
    for log in ("lap.mcap", "lap-mf4.mcap"):
        assert set(open_run(tmp_path / log).signals) == set(piece("sine", 3.0, 23.0).signals)


def all_corners(text: str) -> str:
    """The map with the lines of the front left corner for the other three, where its comment says so."""
    front_left = [line for line in text.splitlines(keepends=True) if ".fl." in line]
    assert len(front_left) == 12
    others = [
        line.replace(".fl.", f".{c}.").replace("_FL", f"_{c.upper()}")
        for c in ("fr", "rl", "rr")
        for line in front_left
    ]
    (comment,) = re.findall(r"^# these twelve .*\n", text, re.MULTILINE)
    return text.replace(comment, "".join(others))
