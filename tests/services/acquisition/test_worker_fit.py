"""The worker alone, in an empty folder, over a bus that loses blocks, fits the same as the recorder's own log."""

from __future__ import annotations

import json
from pathlib import Path

from lacet.services.commands.__main__ import main
from tests.support.captures import SINUS, cut, replay_wires
from tests.support.processes import commands

SECONDS = 8.0


def test_a_worker_in_an_empty_folder_gets_the_same_fit_though_5_percent_of_the_live_blocks_never_came(tmp_path: Path):
    raw = cut(SINUS, tmp_path / "capture.mcap", SECONDS)
    router, to = replay_wires(tmp_path, raw)
    empty = tmp_path / "empty"
    empty.mkdir()
    from tests.support.processes import Command

    with commands() as running:
        replay = Command("replay", "capture.mcap", "--endpoints", "wires.json", "--wait", 30, *to, cwd=tmp_path)
        record = Command(
            "record", "--rig", "rig.toml", "--vehicle", "vehicle.toml", "-o", "log.mcap", "--endpoints", "wires.json",
            "--listen", router, "--until-idle", 1, "--drop-live", 0.05, "--brakes", "off", "--ack-wait", 60,
            cwd=tmp_path,
        )  # fmt: skip
        worker = Command("worker", "--connect", router, "--once", cwd=empty)
        running += [replay, record, worker]
        assert replay.wait(60) == 0, replay.text()
        assert record.wait(60) == 0, record.text()
        assert worker.wait(90) == 0, worker.text()
        said = worker.text()
    assert int(said.split("complete, ")[1].split(" blocks fetched")[0]) > 0  # otherwise nothing was dropped
    remote = json.loads(next(empty.glob("*.result.json")).read_text(encoding="utf-8"))
    assert remote["complete"]
    assert main(["identify", str(tmp_path / "log.mcap"), "--json", str(tmp_path / "local.json")]) == 0
    local = json.loads((tmp_path / "local.json").read_text(encoding="utf-8"))
    for key in ("parameters", "not_identifiable", "whole_vehicle", "base_rank"):
        assert remote["result"][key] == local[key], key
    assert len(local["parameters"]) > 20
