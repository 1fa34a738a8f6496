"""What `docker-compose.yml` runs, run without containers: the same commands, an embedded router for `eclipse/zenoh`."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
import zenoh

from lacet.daq.formats.log import LogReader
from lacet.daq.rig import Rig
from tests.support.compose import compose_file
from tests.support.places import HOME
from tests.support.rig import free_port, make_frames, write_capture


@pytest.fixture
def machine(tmp_path):
    """A command ``lacet`` on the path, a router, a capture of the shipped rig, and how to start a service."""
    port = free_port()
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "lacet").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m lacet "$@"\n', encoding="utf-8")
    (folder / "lacet").chmod(0o755)
    rig = Rig.load("peugeot-406")
    write_capture(tmp_path / "capture.mcap", rig, make_frames(rig, 2.0, 0.2))
    started: list[subprocess.Popen[bytes]] = []

    def start(name: str, runs: str) -> subprocess.Popen[bytes]:
        (tmp_path / runs).mkdir()
        words = compose_file()["services"][name]["command"]
        for place, here in (
            ("tls/router:7447", f"tls/127.0.0.1:{port}"),
            ("/keys", str(tmp_path / "keys")),
            ("--router router", f"--router router --router-listen tls/127.0.0.1:{port}"),
            ("chown -R lacet", "ls"),
            ("/runs", str(tmp_path / runs)),
            ("/capture.mcap", str(tmp_path / "capture.mcap")),
            ("/tmp/wires.json", str(tmp_path / "wires.json")),
        ):
            words = [word.replace(place, here) for word in words]
        environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "PYTHONPATH": str(HOME)}
        with (tmp_path / f"{name}.txt").open("wb") as out:
            process = subprocess.Popen(words, cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT)
        started.append(process)
        return process

    made = start("keys", "keys-runs")
    assert made.wait(30.0) == 0, (tmp_path / "keys.txt").read_text()
    words = compose_file()["services"]["router"]["command"]
    assert words[0] == "--config"
    router = zenoh.open(zenoh.Config.from_file(words[1].replace("/keys", str(tmp_path / "keys"))))
    try:
        yield tmp_path, start
    finally:
        for process in started:
            if process.poll() is None:
                process.terminate()
        for process in started:
            process.wait(20.0)
        router.close()


def test_the_bench_brings_a_run_from_the_capture_to_the_worker(machine):
    folder, start = machine
    start("worker", "worker-runs")
    recorder = start("recorder", "recorder-runs")
    assert recorder.wait(90.0) == 0, (folder / "recorder.txt").read_text()
    assert "worker worker has the run" in (folder / "recorder.txt").read_text()
    until = time.monotonic() + 10.0
    while not list((folder / "worker-runs").glob("*.mcap")) and time.monotonic() < until:
        time.sleep(0.1)
    (path,) = (folder / "worker-runs").glob("*.mcap")
    (log,) = (folder / "recorder-runs").glob("*.mcap")
    assembled, recorded = LogReader(path).blocks(), LogReader(log).blocks()
    assert len(assembled) == 36
    assert {name: len(block) for name, block in assembled.items()} == {n: len(b) for n, b in recorded.items()}
