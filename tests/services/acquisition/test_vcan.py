"""Real SocketCAN, in a User-Mode-Linux guest: `make test-vcan`. One boot for all: it is slow there.

vcan has no controller: its error frames are sent by a raw socket, as the kernel would hand them over. That a bus-off
ends all traffic until the restart, bit errors and lost arbitration cannot be had on it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import ROOT
from tests.support.rig import make_capture

CHECKS = (
    "there is a vcan",
    "standard and extended ids",
    "overflow is counted",
    "link down and up",
    "vcan is chosen by itself",
    "replay into record",
    "channels are decoded",
    "bus-off is said, and the data beside it is whole",
    "a link that is down for 3 s costs only its own frames",
)


@pytest.mark.slow
def test_socketcan_from_replay_to_log(tmp_path):
    make_capture(tmp_path / "capture.mcap", 2.0, scale=0.04)
    guest = [str(Path(__file__).with_name("vcan_in_uml.sh")), "-n", "2", "-t", "240", "--"]
    command = [*guest, sys.executable, "-m", "tests.support.vcan_scenario", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    results = {row["check"]: row for row in map(json.loads, done.stdout.splitlines())}
    assert tuple(results) == CHECKS
    failed = [row for row in results.values() if not row["ok"]]
    assert not failed, done.stderr
