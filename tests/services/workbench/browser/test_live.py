"""The live page beside a real recording: fit, marker, and a fit that is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.services.render.terms import TERMS
from tests.services.workbench.browser.bench import opening, serving
from tests.support.captures import SINUS, cut
from tests.support.processes import Command, commands
from tests.support.rig import free_port


def fits_of(server: Command) -> list[int]:
    """Process ids of the fits that a server has begun."""
    found = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(server.process.pid)], capture_output=True, text=True
    )
    return [int(line.split()[0]) for line in found.stdout.splitlines() if " live " in line]


def test_fit_marker_and_a_killed_fit(browser: Any, tmp_path: Path) -> None:
    """All of the capture is replayed: on a busy machine the second fit begins late, and it needs sensors that send."""
    raw = cut(SINUS, tmp_path / "capture.mcap", 16.0)
    (tmp_path / "rig.toml").write_text(raw.start.rig_text, encoding="utf-8")
    (tmp_path / "vehicle.toml").write_text(raw.start.vehicle_text, encoding="utf-8")
    router = f"tcp/127.0.0.1:{free_port()}"
    to = [word for i in range(2) for word in ("--to", f"can{i}=multicast:{free_port()}")]
    to += ["--to", f"udp0=udp:127.0.0.1:{free_port()}"]
    with (
        commands() as running,
        serving(tmp_path / "none", tmp_path, more=("--connect", router)) as bench,
        opening(browser, bench.address) as opened,
    ):
        watch = opened()
        watch.go("live")
        replay = Command("replay", "capture.mcap", "--endpoints", "wires.json", "--wait", 30, *to, cwd=tmp_path)
        record = Command(
            "record", "--rig", "rig.toml", "--vehicle", "vehicle.toml", "-o", "log.mcap", "--endpoints",
            "wires.json", "--listen", router, "--until-idle", 1, "--brakes", "off", "--ack-wait", 0, cwd=tmp_path,
        )  # fmt: skip
        running += [replay, record]
        line, parameters = watch.at("live-fit-line"), watch.at("live-fit-parameters")
        watch.expect(parameters.locator("tr").filter(has_text="front left spring rate")).to_be_visible()
        watch.expect(line).to_contain_text("s behind")
        watch.expect(watch.at("live-sensors")).to_contain_text("imu: running")
        watch.page.fill("#live-mark", "gravel")
        watch.page.get_by_role("button", name="Mark now").click()
        (fit,) = fits_of(bench.server)
        os.kill(fit, signal.SIGKILL)
        watch.expect(line).to_contain_text("the recording is not affected")
        watch.expect(line).to_contain_text("s behind")
        (again,) = fits_of(bench.server)
        assert again != fit
        watch.expect(watch.at("live-fit-rows").locator("tr").filter(has_text="suspension.fl")).to_contain_text("fails")
        marks = watch.page.evaluate(
            "async () => (await import('./js/charts/linked_axes.js')).link('live').marks.map((m) => m.label)"
        )
        assert marks == ["gravel"]
        watch.expect(watch.at("live-marks")).to_contain_text("gravel at")
        ratios = [float(text) for text in watch.at("live-fit-rows").locator("td.num").all_inner_texts()]
        assert ratios == sorted(ratios, reverse=True)
        assert len(ratios) > 10
        watch.expect(watch.at("live-chart-correvit.speed").locator("canvas").first).to_be_visible()
        terms = watch.page.evaluate("[...document.querySelectorAll('.view .term')].map((e) => e.dataset.term)")
        assert set(terms) == {"sensor_state", "marker", "enough", "error", "interval", "flagged", "losses"}
        assert set(terms) <= set(TERMS)
        watch.picture("live-fit")
        assert replay.wait(60) == 0, replay.text()
        assert record.wait(60) == 0, record.text()
        watch.expect(line).to_contain_text("nothing more is heard")
        watch.expect(parameters.locator("tr").filter(has_text="front left spring rate")).to_be_visible()
        watch.clean()
    # The server was killed, too: its fit, which nobody reads, ends by itself.
    until = time.monotonic() + 20.0
    while Path(f"/proc/{again}").exists():
        assert time.monotonic() < until
        time.sleep(0.1)
    assert "Nothing was lost" in record.text()
    assert LogReader(tmp_path / "log.mcap").damage == []
    assert [mark.text for mark in open_run(tmp_path / "log.mcap").marks] == ["gravel"]
