"""`lacet live` beside a recording: one that is killed changes nothing, one that comes late catches up."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.result import BAD_INPUT, DONE, WITH_LOSSES
from lacet.services.commands.__main__ import main
from lacet.services.render.live_fit import screen
from tests.services.commands.test_json import conforms
from tests.support.captures import SINUS, cut, replay_wires
from tests.support.processes import Command, commands
from tests.support.rig import free_port

SECONDS = 12.0


def seen(live: Command) -> list[dict[str, Any]]:
    """What it has said, second by second."""
    return [json.loads(line) for line in live.text().splitlines() if line.startswith('{"run_id"')]


def fitted_to(seconds: float, live: Command) -> None:
    """Wait until it has fitted so many seconds."""
    until = time.monotonic() + 60.0
    while not any((one["seconds"] or 0.0) >= seconds for one in seen(live)):
        assert live.process.poll() is None, live.text()
        assert time.monotonic() < until, live.text()
        time.sleep(0.05)


def test_a_killed_fit_leaves_the_recording_whole_and_a_late_one_has_it_all(tmp_path: Path):
    raw = cut(SINUS, tmp_path / "capture.mcap", SECONDS)
    router, to = replay_wires(tmp_path, raw)
    with commands() as running:
        first = Command("live", "--connect", router, "--lines", cwd=tmp_path)
        replay = Command("replay", "capture.mcap", "--endpoints", "wires.json", "--wait", 30, *to, cwd=tmp_path)
        record = Command(
            "record", "--rig", "rig.toml", "--vehicle", "vehicle.toml", "-o", "log.mcap", "--endpoints", "wires.json",
            "--listen", router, "--brakes", "off", "--ack-wait", 0, "--json", "record.json", cwd=tmp_path,
        )  # fmt: skip
        running += [first, replay, record]
        fitted_to(1.0, first)
        first.process.kill()  # as kill -9: no word of farewell
        late = Command("live", "--connect", router, "--once", "--lines", "--json", "live.json", cwd=tmp_path)
        running.append(late)
        assert main(["mark", "slalom begins", "--connect", router]) == 0
        assert replay.wait(60) == 0, replay.text()
        fitted_to(SECONDS - 1.5, late)
        record.process.send_signal(signal.SIGINT)
        assert record.wait(60) in (DONE, WITH_LOSSES), record.text()
        assert late.wait(30) == 0, late.text()
    losses = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))["losses"]
    assert {cause for own in losses.values() for cause in own} <= {"link_down"}  # the serial line ends with the replay
    recorded, sent = LogReader(tmp_path / "log.mcap"), LogReader(tmp_path / "capture.mcap")
    assert recorded.damage == []
    for source in sent.sources():
        np.testing.assert_array_equal(recorded.frames(source).data, sent.frames(source).data)
    assert [mark.text for mark in open_run(tmp_path / "log.mcap").marks] == ["slalom begins"]
    found = conforms(tmp_path / "live.json", "live")
    assert found["seconds"] >= SECONDS - 1.5
    assert [mark["text"] for mark in found["marks"]] == ["slalom begins"]
    assert {one["name"] for one in found["sensors"]} == {"wheels", "lasers", "imu", "cameras", "correvit"}
    assert {one["row"] for one in found["rows"] if one["fails"]} >= {"suspension.fl", "suspension.rr"}
    shown = screen(found)
    assert re.search(r"error ÷ floor: [\w.]+ \d+\.\d+ FAILS", shown)
    assert re.search(r"spring\.rr\.k +enough", shown)
    assert "markers: slalom begins at" in shown
    assert max(map(len, shown.splitlines()[1:])) <= 120
    # When the run is over it is the fit of its log.
    last = seen(late)[-1]
    assert (last["recording"], last["from_scratch"]) == (False, True)
    until = str(int(last["seconds"]))
    assert f"as lacet identify --to {until}" in last["line"]
    # 3 on a busy machine, where a sensor's samples came late
    words = ["identify", str(tmp_path / "log.mcap"), "--to", until, "--json", str(tmp_path / "fit.json")]
    assert main(words) in (DONE, WITH_LOSSES)
    fitted = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    same = {one["name"]: one for one in fitted["parameters"]}
    assert {one["name"] for one in last["parameters"]} == set(same)
    for one in last["parameters"]:
        wanted = same[one["name"]]
        assert abs(one["value"] - wanted["value"]) < 1e-6 * wanted["half95_sheet"], one["name"]
        assert one["half95_sheet"] == pytest.approx(wanted["half95_sheet"], rel=1e-6), one["name"]
        assert (one["answer"] == "enough") == (one["half95_sheet"] <= 0.02 * abs(one["value"])), one["name"]
    assert last["enough"] >= 4
    ratios = {one["row"]: one["ratio"] for one in last["rows"]}
    assert ratios == pytest.approx(
        {row: score["ratio"] for row, score in fitted["rows"]["used"]["log"].items()}, rel=1e-6
    )


def test_it_ends_when_nobody_reads_it_though_nothing_is_recorded():
    """Without a word to write it sees that the other end of its pipe is gone: no process stays behind."""
    reader = subprocess.Popen(
        [sys.executable, "-m", "lacet", "live", "--connect", f"tcp/127.0.0.1:{free_port()}"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert reader.stdout is not None
        assert reader.stderr is not None
        assert "trying every" in reader.stderr.readline()
        reader.stdout.close()
        assert reader.wait(20.0) == BAD_INPUT
    finally:
        reader.kill()


def test_what_cannot_be_followed_is_said(capsys: pytest.CaptureFixture[str]):
    assert main(["live", "--target", "0"]) == 2
    assert main(["live", "no such study"]) == 2
    assert main(["live", "--connect", "tls/10.0.0.7:7447"]) == 2
    text = capsys.readouterr().err
    for part in ("--target 0", "no such study", "keys"):
        assert part in text
