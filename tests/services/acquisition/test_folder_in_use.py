"""A worker's folder is taken by one worker at a time, and free when that one has ended, however."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lacet.daq.errors import UsageError
from lacet.services.acquisition.folder_in_use import in_use
from lacet.services.commands.__main__ import main

HOLD = """
import sys, time
from pathlib import Path
from lacet.services.acquisition.folder_in_use import in_use
with in_use(Path(sys.argv[1]), "first"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_worker_is_refused_until_the_first_has_ended_even_by_a_kill(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    folder = tmp_path / "runs"
    with subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        with pytest.raises(UsageError, match=r"runs: worker first writes there; .*--out DIR"), in_use(folder, "second"):
            pass
        assert main(["worker", "--out", str(folder), "--connect", "tcp/127.0.0.1:1", "--wait", "0.1"]) == 2
        assert "worker first writes there" in capsys.readouterr().err
        os.kill(first.pid, signal.SIGKILL)
    with in_use(folder, "second"):
        pass


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file: no files can be written there"), in_use(tmp_path / "file", "one"):
        pass
