"""Samples lost in a hole of a damaged log by the time that it lasts, where whole turns of a counter hide them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.services.workspace.decode import decode_log
from tests.support.rig import RIG, T0, make_frames

SECONDS, CHUNKS = 2.0, 20
WHEELS = RIG.split("[bus.can1]")[0] + '[[sensor]]\nname = "wheels"\ndriver = "igel"\nbus = "can0"\n'
WHEELS += 'channels = ["wheel.*"]\naxes = "carrier"\nclock = "steady"\n'


@pytest.mark.parametrize("without", [[7], [7, 8], [4, 12, 13, 14]])
def test_turns_of_a_counter_of_four_bits_are_counted_where_frames_are_missing(tmp_path: Path, without: list[int]):
    """Batches are numbered: those that are not written are known to be missing."""
    rig = Rig.parse(WHEELS)
    (frames,) = make_frames(rig, SECONDS).values()
    edges = np.linspace(0, len(frames), CHUNKS + 1).astype(int)
    raw, lost = tmp_path / "raw.mcap", 0
    with LogWriter(raw, StartRecord("r", T0, "", rig.text)) as log:
        for k in range(CHUNKS):
            batch = frames[int(edges[k]) : int(edges[k + 1])]
            if k in without:
                tally = log._sources["can0"]
                log._sources["can0"] = tally.add(b"", len(batch))  # numbered, and not in the file
                lost += len(batch)
            else:
                log.write_frames(batch)
    found = decode_log(raw, tmp_path / "run.mcap")
    (sent,) = make_frames(rig, SECONDS).values()
    assert len(LogReader(raw).frames("can0")) == len(sent) - lost
    ledger = found["ledger"]["can0"]
    per_sample = len(sent) / (ledger["samples"] + ledger["lost"] + ledger["lost_unseen"])
    assert per_sample == pytest.approx(3.0, abs=0.02)
    assert found["losses"]["can0"]["lost_unseen"] % 16 == 0
    assert found["losses"]["can0"]["lost_unseen"] > 0


def test_a_whole_log_has_none(tmp_path: Path):
    rig = Rig.parse(WHEELS)
    (frames,) = make_frames(rig, 0.5).values()
    kept = [frames[:200], frames[500:]]  # lost on the wire, not in the log
    with LogWriter(tmp_path / "raw.mcap", StartRecord("r", T0, "", rig.text)) as log:
        log.write_frames(Frames.concat("can0", kept))
    assert "lost_unseen" not in decode_log(tmp_path / "raw.mcap", tmp_path / "run.mcap")["ledger"]["can0"]
