"""The live page beside a real recording: how to begin one, fit and marker, a fit and a server that are killed."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.bus.session import ROUTER
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.services.render.terms import TERMS
from tests.services.workbench.browser.bench import LONG, Watch, opening, serving
from tests.support.captures import SINUS
from tests.support.processes import Command, commands
from tests.support.rig import free_port


def fits_of(server: Command) -> list[int]:
    """Process ids of the fits that a server has begun."""
    found = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(server.process.pid)], capture_output=True, text=True
    )
    return [int(line.split()[0]) for line in found.stdout.splitlines() if " live " in line]


def _said(watch: Watch, router: str) -> list[list[str]]:
    """The commands that the page gives to try it without a car, as words."""
    watch.expect(watch.page.locator(".live-head")).to_have_text("No recording is heard")
    watch.picture("live-steps")
    assert ROUTER not in watch.at("live-steps").inner_text(), "it listens elsewhere"
    replay, record = watch.page.locator(".live-steps pre").all_inner_texts()[-2:]
    assert record.endswith(f"--listen {router}")
    return [shlex.split(one)[1:] for one in (replay, record)]


def test_what_the_page_says_is_done_and_a_fit_and_the_server_are_killed(browser: Any, tmp_path: Path) -> None:
    """From the commands of the empty page to the last fit; the recording is whole, whoever listens to it dies.

    The fit leaves the processor to all others, so that a busy machine waits for it: how late it is, benchmarks/live.py
    measures.
    """
    router = f"tcp/127.0.0.1:{free_port()}"
    to = [word for i in range(2) for word in ("--to", f"can{i}=multicast:{free_port()}")]
    to += ["--to", f"udp0=udp:127.0.0.1:{free_port()}"]
    folder, more = tmp_path / "none", ("--connect", router)
    with (
        commands() as running,
        serving(folder, tmp_path, more=more) as first,
        opening(browser, first.address) as opened,
    ):
        watch = opened()
        watch.go("live")
        played, recorded = _said(watch, router)
        replay = Command(*played, *to, cwd=tmp_path)
        # Sensors that are silent at last are those of a slow machine: the recording goes on meanwhile.
        words = ("--until-idle", 600, "--brakes", "off", "--ack-wait", 0, "--json", "record.json")
        record = Command(*recorded, *words, cwd=tmp_path)
        running += [replay, record]
        line, parameters = watch.at("live-fit-line"), watch.at("live-fit-parameters")
        watch.expect(watch.at("live-sensors")).to_contain_text("imu: running")
        watch.expect(watch.at("live-steps")).to_be_hidden()
        watch.expect(parameters.locator("tr").filter(has_text="front left spring rate")).to_be_visible(timeout=LONG)
        watch.expect(line).to_contain_text("s behind", timeout=LONG)
        watch.page.fill("#live-mark", "gravel")
        watch.page.get_by_role("button", name="Mark now").click()
        (fit,) = fits_of(first.server)
        os.kill(fit, signal.SIGKILL)
        watch.expect(line).to_contain_text("the recording is not affected")
        watch.expect(line).to_contain_text("s behind", timeout=LONG)
        (again,) = fits_of(first.server)
        assert again != fit
        first.server.process.kill()
        watch.expect(watch.at("job-bar")).to_have_attribute("data-state", "down")
        _until(lambda: not Path(f"/proc/{again}").exists())  # nobody reads what it says
        with serving(folder, tmp_path, int(first.address.rpartition(":")[2]), more) as bench:
            watch.expect(watch.at("job-bar")).to_have_attribute("data-state", "idle")
            _until(lambda: bool(fits_of(bench.server)))
            watch.expect(line).to_contain_text("s behind", timeout=LONG)
            _shown(watch)
            watch.expect(watch.at("live-channels")).to_contain_text(" channels, ")
            assert replay.wait(60) == 0, replay.text()
            watch.expect(watch.at("live-sensors")).to_contain_text("imu: silent")
            record.process.send_signal(signal.SIGINT)
            record.wait(60)
            watch.expect(watch.page.locator(".live-head")).to_contain_text("The run is over")
            watch.expect(watch.at("live-channels")).to_contain_text("silent at the end")
            watch.expect(watch.at("live-imu.accel")).to_contain_text("silent at the end")
            watch.picture("live-over")
            watch.expect(line).to_contain_text("nothing more is heard")
            watch.expect(line).to_contain_text("from scratch, as lacet identify --to", timeout=LONG)
            watch.expect(parameters.locator("tr").filter(has_text="front left spring rate")).to_be_visible()
        watch.errors[:] = [e for e in watch.errors if "ERR_" not in e]
        watch.clean()
    losses = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))["losses"]
    assert {cause for own in losses.values() for cause in own} <= {"link_down"}  # the serial line ends with the replay
    log, sent = LogReader(tmp_path / "example.mcap"), LogReader(SINUS)
    assert log.damage == []
    for source in sent.sources():
        np.testing.assert_array_equal(log.frames(source).data, sent.frames(source).data)
    assert [mark.text for mark in open_run(tmp_path / "example.mcap").marks] == ["gravel"]


def _shown(watch: Watch) -> None:
    """Rows, markers, curves and terms of a recording that is followed."""
    watch.expect(watch.at("live-fit-rows").locator("tr").filter(has_text="suspension.fl")).to_contain_text("fails")
    watch.expect(watch.at("live-marks")).to_contain_text("gravel at")
    marks = watch.page.evaluate(
        "async () => (await import('./js/charts/linked_axes.js')).link('live').marks.map((m) => m.label)"
    )
    assert marks == ["gravel"]
    ratios = [float(text) for text in watch.at("live-fit-rows").locator("td.num").all_inner_texts()]
    assert ratios == sorted(ratios, reverse=True)
    assert len(ratios) > 10
    watch.expect(watch.at("live-chart-correvit.speed").locator("canvas").first).to_be_visible()
    terms = watch.page.evaluate("[...document.querySelectorAll('.view .term')].map((e) => e.dataset.term)")
    assert set(terms) == {"sensor_state", "marker", "enough", "error", "interval", "flagged", "losses"}
    assert set(terms) <= set(TERMS)
    watch.picture("live-fit")


def _until(true: Callable[[], bool]) -> None:
    until = time.monotonic() + 1e-3 * LONG
    while not true():
        assert time.monotonic() < until
        time.sleep(0.1)
