"""The server as it is started: its address, news over a real connection, the live car, and its end by Ctrl-C."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient

from lacet.daq.blocks import Block, Flag
from lacet.daq.bus.listener import Message
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import ROUTER, Keys, open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.wire import StartRecord, block_to_bytes
from lacet.identify.validation.noise_floor import LEAST_DRAWS
from lacet.services.commands.__main__ import main
from lacet.services.workbench.events import WAITING, Events
from lacet.services.workbench.live import Live
from lacet.services.workbench.live_curves import SPAN, LiveCurve
from lacet.services.workbench.packed_arrays import unpacked
from lacet.services.workbench.server import Settings, address, create_app, is_loopback
from tests.support.processes import Command, commands
from tests.support.rig import T0, free_port, rig_text, samples

HERE = "http://127.0.0.1:8765"


def news(lines: Iterator[str], event: str) -> dict[str, object]:
    """The next news of a kind."""
    for line in lines:
        if line == f"event: {event}":
            return json.loads(next(lines).removeprefix("data: "))
    raise AssertionError(f"no news of {event}")


def test_started_heard_and_ended(made: Path):
    with commands() as running:
        server = Command("ui", made, "--port", "0", cwd=made)
        running.append(server)
        server.wait_for("Ctrl-C ends it", 120.0)
        printed = server.text().split("open ")[1].split()[0]
        url, _, token = printed.partition("?token=")
        assert url.startswith("http://127.0.0.1:")
        assert len(token) >= 32
        with (
            httpx.Client(base_url=url, trust_env=False, timeout=60.0, follow_redirects=True) as client,
            client.stream("GET", printed) as entry,
            client.stream("GET", "/api/events") as stream,
        ):
            assert entry.status_code == 200
            assert stream.headers["content-type"].startswith("text/event-stream")
            lines = stream.iter_lines()
            assert news(lines, "hello") == {"pages": 1, "jobs": []}
            assert client.get("/api/live").json()["endpoint"] == ROUTER  # where lacet record is by default
            number = client.post("/api/jobs", json={"do": "undo", "args": {}}).json()["id"]
            found = news(lines, "job")
            while found["state"] != "failed":
                found = news(lines, "job")
            assert (found["id"], "nothing to undo" in str(found["error"])) == (number, True)
            (made / "effects" / "lines.txt").write_text("# nothing yet\n", encoding="utf-8")
            assert news(lines, "study") == {"changed": ["effects"]}
            (made / "effects" / "lines.txt").unlink()
            # Ended while a page listens: its stream ends, and the server does not wait for it.
            began = time.monotonic()
            server.process.send_signal(signal.SIGINT)
            for _ in lines:
                pass
        assert server.wait(20.0) == 0
        assert time.monotonic() - began < 15.0
        assert "Traceback" not in server.text()


def test_the_live_car(tmp_path: Path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router, spool = open_session(listen=(endpoint,)), Spool()
    publisher = RunPublisher(router, "my rig", StartRecord("run-1", T0, "", rig_text(), manoeuvre="sinus"), spool)
    try:
        app = create_app(Settings(tmp_path / "new", connect=endpoint))
        with TestClient(app, base_url=HERE) as client:
            until(lambda: client.get("/api/live").json()["connected"])
            whole = samples(CHANNELS["imu.accel"], 4.0, 100.0)
            for i in range(40):
                part = slice(10 * i, 10 * i + 10)
                block = Block("imu.accel", whole.t_ns[part], whole.values[part], whole.flags[part])
                publisher.put_block("imu.accel", block_to_bytes(block, i, "sensor"), 10)
                time.sleep(0.005)
            until(lambda: sum(c["samples"] for c in client.get("/api/live").json()["channels"]) == 400)
            sensors = {"imu": {"state": "running", "channels": ["imu.accel"]}, "laser": {"state": "stuck"}, "x": 7}
            marks = [{"t_ns": T0 + 2_500_000_000, "text": "gravel"}, {"text": "no time"}]
            publisher.put_ledger(
                {"losses": {"can0": {"bus": 2}}, "down": ["udp0"], "seconds": 4.0, "sensors": sensors, "marks": marks}
            )
            until(lambda: client.get("/api/live").json()["losses"] == {"can0": {"bus": 2}})
            found = client.get("/api/live").json()
            assert found["down"] == ["udp0"]
            assert (found["run"], found["rig"], found["recording"]) == ("run-1", "my_rig", True)
            assert found["manoeuvre"] == "sinus"
            assert found["marks"] == [{"text": "gravel", "seconds": 2.5}]
            assert [(one["name"], one["state"]) for one in found["sensors"]] == [("imu", "running"), ("laser", "stuck")]
            head, curves = unpacked(client.get("/api/live/curves?names=imu.accel,wheel.fl.force").content)
            assert head["channels"]["imu.accel"]["unit"] == "m/s²"
            assert not curves["wheel.fl.force t"].size
            for k, part in enumerate("xyz"):
                drawn = curves[f"imu.accel.{part}"]
                assert np.nanmin(drawn) == pytest.approx(whole.values[:, k].min(), rel=1e-5)
                assert np.nanmax(drawn) == pytest.approx(whole.values[:, k].max(), rel=1e-5)
            assert np.all(np.diff(curves["imu.accel t"]) > 0.0)
            assert np.ptp(curves["imu.accel t"]) == pytest.approx(4.0, abs=0.11)
            assert client.get("/api/live/curves?names=imu.accl").status_code == 400
            channel = next(c for c in found["channels"] if c["samples"])
            silent = next(c for c in found["channels"] if c["name"] == "wheel.fl.force")  # promised by the rig
            assert (silent["age"], silent["rate"], silent["samples"]) == (None, None, 0)
            assert channel["rate"] == pytest.approx(100.0, rel=0.05)
            assert (channel["name"], channel["unit"], channel["expected"]) == ("imu.accel", "m/s²", 200.0)
            assert (channel["losses"], channel["flagged"]) == (0, 0)
            assert (channel["state"]["text"], silent["state"]["text"]) == ("slow", "never heard")
            assert found["steps"] == []
            assert channel["age"] < 10.0
            assert "did not answer" in client.post("/api/live/mark", json={"text": "x"}).json()["error"]
            publisher.on_mark = lambda text: {"text": text, "seconds": 4.0}
            marked = client.post("/api/live/mark", json={"text": "gravel\x1b[31m"}).json()
            assert marked == {"run_id": "run-1", "text": "gravel [31m", "seconds": 4.0}
            assert client.post("/api/live/mark", json={"text": 1}).status_code == 400
    finally:
        publisher.close()
        router.close()
        spool.close()


def test_a_live_curve_has_its_peaks_its_holes_and_an_end():
    """Extremes of each bin over blocks; flagged samples are holes, late ones are not drawn, only the last 30 s stay."""
    curve = LiveCurve()
    whole = samples(CHANNELS["correvit.speed"], 60.0, 100.0)
    values = np.zeros_like(whole.values)
    values[4321] = 99.0
    flags = whole.flags.copy()
    flags[5000:5050] = int(Flag.STATUS)
    for k in range(0, 6000, 7):
        part = slice(k, k + 7)
        curve.take(Block("correvit.speed", whole.t_ns[part], values[part], flags[part]))
    curve.take(Block("correvit.speed", whole.t_ns[:7], values[:7] + 500.0, whole.flags[:7]))
    t, parts = curve.series(int(whole.t_ns[0]), CHANNELS["correvit.speed"].components or ("value",))
    assert np.ptp(t) == pytest.approx(SPAN, abs=0.1)
    assert np.nanmax(parts[0]) == 99.0
    assert t[int(np.nanargmax(parts[0]))] == pytest.approx(43.21, abs=0.06)
    assert 8 <= np.isnan(parts[0]).sum() / 2 <= 10
    assert t[np.isnan(parts[0])].min() == pytest.approx(50.0, abs=0.1)


def test_an_earlier_run_that_is_offered_is_not_shown():
    live, block = Live(None, Events()), samples(CHANNELS["imu.accel"], 1.0, 100.0)
    first, other = Keys("car", "run-1"), Keys("car", "run-0")
    live.take(Message(first, "block", "imu.accel", 0, block_to_bytes(block, 0, "sensor")))
    for kind in ("alive", "start"):
        live.take(Message(other, kind, "", 0, b""))
    assert live.payload()["run"] == "run-1"
    assert live.payload()["channels"][0]["samples"] == 100
    live.take(Message(first, "gone", "", 0, b""))
    live.take(Message(other, "alive", "", 0, b""))
    assert live.payload()["run"] == "run-0"


def test_after_a_run_its_channels_agree_with_its_sensors():
    live, keys = Live(None, Events()), Keys("car", "run-1")
    for name in ("imu.accel", "laser.fl.ground"):
        live.take(Message(keys, "block", name, 0, block_to_bytes(samples(CHANNELS[name], 1.0, 100.0), 0, "sensor")))
    sensors = {
        "imu": {"state": "silent", "detail": "nothing for 1.2 s", "channels": ["imu.accel"]},
        "laser": {"state": "running", "detail": "", "channels": []},
    }
    live.take(Message(keys, "ledger", "", 0, json.dumps({"sensors": sensors}).encode()))
    live.take(Message(keys, "gone", "", 0, b""))
    found = live.payload()
    assert not found["recording"]
    assert {one["name"]: one["state"]["text"] for one in found["channels"]} == {
        "imu.accel": "silent at the end", "laser.fl.ground": "was good",
    }  # fmt: skip
    assert found["channels_text"] == "2 channels, 1 silent at the end"


def test_without_a_recorder_it_says_so(tmp_path: Path):
    app = create_app(Settings(tmp_path / "new", connect=f"tcp/127.0.0.1:{free_port()}"))
    with TestClient(app, base_url=HERE) as client:
        until(lambda: client.get("/api/live").json()["why"])
        found = client.get("/api/live").json()
        assert found["connected"] is False
        assert [len(step["commands"]) for step in found["steps"]] == [1, 2, 2]
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        assert client.get("/api/live").json()["endpoint"] is None


def test_a_target_that_is_none_is_refused(tmp_path: Path):
    for connect, target, said in ((None, 2, "--connect"), ("tcp/127.0.0.1:1", 0, "per cent"), (None, "x", "per cent")):
        with TestClient(create_app(Settings(tmp_path / "new", connect=connect)), base_url=HERE) as client:
            answer = client.post("/api/live/fit", json={"target": target})
        assert answer.status_code == 400
        assert said in answer.json()["error"]


def until(true: object, seconds: float = 20.0) -> None:
    """Wait for something to come true."""
    assert callable(true)
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_slow_page_loses_old_news_and_is_told():
    # On a thread of its own: the browser's tests leave a loop running on the main one.
    with ThreadPoolExecutor(1) as own:
        own.submit(asyncio.run, _slow_page()).result()


async def _slow_page() -> None:
    events = Events()
    stream = events.stream(lambda: {"pages": events.listening})
    assert await anext(stream) == 'retry: 1000\nevent: hello\ndata: {"pages": 1}\n\n'
    for number in range(WAITING + 20):
        events.publish("job", number)
    await asyncio.sleep(0.05)
    found = [await anext(stream) for _ in range(WAITING)]
    assert any('"missed": true' in text for text in found)
    events.close()
    assert [text async for text in stream] == []


def test_addresses():
    folder = Path("x")
    assert address(Settings(folder), 80) == "http://127.0.0.1:80/"
    assert address(Settings(folder, host="::1"), 80) == "http://[::1]:80/"
    assert address(Settings(folder, host="0.0.0.0", token="abc"), 80).endswith(":80/?token=abc")
    assert [is_loopback(h) for h in ("127.0.0.1", "127.0.0.9", "::1", "localhost", "0.0.0.0", "10.0.0.1")] == [
        True, True, True, True, False, False,
    ]  # fmt: skip


def test_what_cannot_be_served_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "file"
    file.touch()
    assert main(["ui", str(file)]) == 2
    assert main(["ui", str(tmp_path), "--port", "70000"]) == 2
    assert main(["ui", str(tmp_path), "--draws", str(LEAST_DRAWS - 1)]) == 2
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert main(["ui", str(tmp_path / "new"), "--port", str(taken.getsockname()[1])]) == 2
    text = capsys.readouterr().err
    for part in ("is a file", "0 to 65535", "--port 0"):
        assert part in text


@pytest.mark.parametrize("kind", ["start", "block", "ledger", "manifest", "alive", "gone", "result"])
@pytest.mark.parametrize("payload", [b"", b"\xff{", b"[" * 100_000, b"[]", b"7", b"\x00" * 100])
def test_a_message_that_is_none_does_not_end_the_live_car(kind: str, payload: bytes):
    live = Live(None, Events())
    keys = Keys("car", "run-1")
    live.take(Message(keys, "alive", "", 0, b""))
    live.take(Message(keys, kind, "imu.accel", 0, payload))
    assert live.payload()["run"] == "run-1"
    assert live.payload()["losses"] == {}
