"""``lacet recover``: what is whole of a log that was cut off, for readers that need a finished file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from lacet.daq.formats.log_read import LogReader
from lacet.daq.formats.result import BAD_INPUT, DONE, WITH_LOSSES
from lacet.services.commands.__main__ import main
from tests.support.rig import make_capture


def finished(path: Path) -> bool:
    """Whether the stock reader opens a file."""
    try:
        with path.open("rb") as stream:
            return make_reader(stream).get_summary() is not None
    except McapError:
        return False


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    make_capture(tmp_path / "raw.mcap", 1.0, 47110)
    return tmp_path / "raw.mcap"


def test_a_log_cut_off_is_whole_again(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    cut, out, file = tmp_path / "cut.mcap", tmp_path / "whole.mcap", tmp_path / "result.json"
    data = capture.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    assert not finished(cut)
    assert main(["recover", str(cut), "-o", str(out), "--json", str(file)]) == WITH_LOSSES
    assert "lost: " in capsys.readouterr().out
    assert finished(out)
    before, after, result = LogReader(cut), LogReader(out), json.loads(file.read_text("utf-8"))
    assert result["damage"] == list(before.damage) == list(after.damage)
    for source in before.sources():
        assert result["counts"][source] == len(before.frames(source)) == len(after.frames(source)) > 0
    assert cut.read_bytes() == data[: len(data) * 2 // 3]


def test_a_log_damaged_in_the_middle_counts_what_is_in_it(capture: Path, tmp_path: Path):
    """Its stop record has counted what was recorded, which is more."""
    broken, out, file = tmp_path / "broken.mcap", tmp_path / "whole.mcap", tmp_path / "result.json"
    data = bytearray(capture.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(byte ^ 0xFF for byte in data[middle : middle + 64])
    broken.write_bytes(data)
    assert main(["recover", str(broken), "-o", str(out), "--json", str(file)]) == WITH_LOSSES
    counts, whole = json.loads(file.read_text("utf-8"))["counts"], LogReader(out)
    assert whole.stop is not None
    assert counts == {source: len(whole.frames(source)) for source in whole.sources()}
    assert sum(counts.values()) < sum(LogReader(capture).stop.counts.values())


def test_a_whole_log_loses_nothing_and_no_file_is_replaced_unasked(capture: Path, tmp_path: Path):
    out = tmp_path / "whole.mcap"
    assert main(["recover", str(capture), "-o", str(out)]) == DONE
    assert main(["recover", str(capture), "-o", str(out)]) == BAD_INPUT
    assert main(["recover", str(capture), "-o", str(out), "--force"]) == DONE
    assert main(["recover", str(capture), "-o", str(capture), "--force"]) == BAD_INPUT
    assert main(["recover", str(tmp_path / "none.mcap"), "-o", str(tmp_path / "x.mcap")]) == BAD_INPUT
    assert not (tmp_path / "x.mcap").exists()
