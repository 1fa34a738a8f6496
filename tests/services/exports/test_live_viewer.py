"""Live channels in Foxglove and Lichtblick: a real websocket client of their protocol receives them."""

from __future__ import annotations

import base64
import importlib
import json
import re
import struct
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from websockets.sync.client import ClientConnection, connect

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import Message
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import Keys, open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import UsageError
from lacet.daq.formats.wire import StartRecord, block_to_bytes
from lacet.services.commands import foxglove
from lacet.services.commands.__main__ import main
from lacet.services.exports.live_viewer import LAYOUT, LEDGER, SAMPLES_PER_SECOND, LiveViewer
from tests.support.processes import PATIENCE, Command, commands
from tests.support.rig import T0, free_port, rig_text, samples

SDK = importlib.import_module("foxglove")
PROTOCOL = "foxglove.sdk.v1"


def client(port: int) -> ClientConnection:
    return connect(
        f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], proxy=None, open_timeout=PATIENCE, close_timeout=1.0,  # type: ignore[list-item]
    )  # fmt: skip


def channels(ws: ClientConnection, *topics: str) -> dict[str, dict[str, Any]]:
    """The advertised channels, once all of some topics are among them."""
    found: dict[str, dict[str, Any]] = {}
    while not set(topics) <= set(found):
        message = ws.recv(timeout=PATIENCE)
        if isinstance(message, str) and (said := json.loads(message))["op"] == "advertise":
            found |= {channel["topic"]: channel for channel in said["channels"]}
    return found


def subscribe(ws: ClientConnection, *of: dict[str, Any]) -> None:
    wanted = [{"id": 100 + n, "channelId": channel["id"]} for n, channel in enumerate(of)]
    ws.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def data(ws: ClientConnection) -> Iterator[tuple[int, int, bytes]]:
    """Subscription, log time [ns] and message of what comes."""
    while True:
        message = ws.recv(timeout=PATIENCE)
        if isinstance(message, bytes) and message[0] == 1:
            number, log_ns = struct.unpack_from("<IQ", message, 1)
            yield number, log_ns, message[13:]


def block_message(block: Block, number: int) -> Message:
    return Message(Keys("bench", "r"), "block", block.channel, number, block_to_bytes(block, number, None), False)


def part(block: Block, begin: int, end: int) -> Block:
    return Block(block.channel, block.t_ns[begin:end], block.values[begin:end], block.flags[begin:end])


@pytest.fixture
def viewer() -> Iterator[LiveViewer]:
    found = LiveViewer("127.0.0.1", 0, SDK)
    yield found
    found.close()


def test_a_channel_s_samples_arrive_and_can_be_read_by_their_own_description(viewer: LiveViewer):
    whole = samples(CHANNELS["imu.accel"], 1.0, 100.0)
    viewer.take(block_message(part(whole, 0, 10), 0))  # nobody is there yet
    viewer.take(Message(Keys("bench", "r"), "block", "imu.accel", 1, b"no block", False))
    viewer.take(Message(Keys("bench", "r"), "ledger", "", 0, b'{"losses": {"can0": {"queue": 3}}}', False))
    with client(viewer.port) as ws:
        found = channels(ws, "/imu/accel", LEDGER)
        accel = found["/imu/accel"]
        assert (accel["encoding"], accel["schemaEncoding"]) == ("protobuf", "protobuf")
        subscribe(ws, accel, found[LEDGER])
        step = round(CHANNELS["imu.accel"].rate / SAMPLES_PER_SECOND)
        until = time.monotonic() + PATIENCE
        while not viewer._channels["/imu/accel"].has_sinks():  # the subscription has arrived
            assert time.monotonic() < until
            time.sleep(0.005)
        for number, begin in enumerate(range(10, 100, 9), start=1):  # blocks of any length
            viewer.take(block_message(part(whole, begin, min(100, begin + 9)), number))
        viewer.take(Message(Keys("bench", "r"), "ledger", "", 0, b'{"losses": {"can0": {"queue": 4}}}', False))
        expected = [k for k in range(100) if k % step == 0 and k >= 10]
        pool = DescriptorPool()
        for file in FileDescriptorSet.FromString(base64.b64decode(accel["schema"])).file:
            pool.Add(file)
        kind = GetMessageClass(pool.FindMessageTypeByName(accel["schemaName"]))
        got = dict[int, list[tuple[int, bytes]]]()
        for number, log_ns, message in data(ws):
            got.setdefault(number, []).append((log_ns, message))
            if len(got.get(100, ())) == len(expected) and 101 in got:
                break
        assert [log_ns for log_ns, _ in got[100]] == whole.t_ns[expected].tolist()
        read = [kind.FromString(message) for _, message in got[100]]
        np.testing.assert_array_equal([[m.x, m.y, m.z] for m in read], whole.values[expected])
        assert json.loads(got[101][-1][1])["losses"]["can0"]["queue"] == 4


def test_the_layout_shows_channels_that_there_are():
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    paths = [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())]
    assert len(paths) > 10
    for path in paths:
        topic, component = re.fullmatch(r"/(.+)\.(\w+)", path).groups()  # type: ignore[union-attr]
        assert component in (CHANNELS[topic.replace("/", ".")].components or ("value",)), path
    assert layout["configById"]["RawMessages!ledger"]["topicPath"] == LEDGER

    def names(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else names(node["first"]) + names(node["second"])

    assert sorted(names(layout["layout"])) == sorted(layout["configById"])


def test_a_taken_address_is_told(viewer: LiveViewer):
    with pytest.raises(UsageError, match="give another with --listen"):
        LiveViewer("127.0.0.1", viewer.port, SDK)


def test_without_the_package_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    assert main(["foxglove"]) == 2
    assert "pip install 'lacet[foxglove]'" in capsys.readouterr().err


def test_it_listens_on_this_machine_alone_unless_told_otherwise():
    assert foxglove.HERE == "127.0.0.1:8765"


def test_the_command_brings_the_bus_to_the_viewer(tmp_path):
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    router, spool = open_session(listen=(endpoint,)), Spool()
    publisher = RunPublisher(router, "bench", StartRecord("r", T0, "", rig_text()), spool)
    whole = samples(CHANNELS["correvit.speed"], 1.0, 100.0)
    with commands() as running:
        words = ("--connect", endpoint, "--listen", f"127.0.0.1:{port}", "--layout", "layout.json")
        command = Command("foxglove", *words, cwd=tmp_path)
        running.append(command)
        command.wait_for("viewers connect to")
        try:
            with client(port) as ws:
                publisher.put_block("correvit.speed", block_to_bytes(whole, 0, None), 100)
                until = time.monotonic() + PATIENCE
                while publisher.listened is not True:  # what is sent before is not shown
                    assert time.monotonic() < until
                    time.sleep(0.02)
                publisher.put_block("correvit.speed", block_to_bytes(whole, 1, None), 100)
                speed = channels(ws, "/correvit/speed")["/correvit/speed"]
                subscribe(ws, speed)
                sent = 2
                while True:  # the subscription takes a moment
                    publisher.put_block("correvit.speed", block_to_bytes(part(whole, 0, 5), sent, None), 5)
                    sent += 1
                    try:
                        message = ws.recv(timeout=0.1)
                    except TimeoutError:
                        assert time.monotonic() < until
                        continue
                    if isinstance(message, bytes):
                        break
                    if "Unknown channel" in message:  # the SDK advertises a channel before it can be subscribed to
                        subscribe(ws, speed)
                number, log_ns = struct.unpack_from("<IQ", message, 1)
                assert number == 100
                assert log_ns in whole.t_ns  # the first block may still be on its way when the subscription arrives
                command.process.terminate()
                assert command.wait() == 0
        finally:
            publisher.close()
            router.close()
            spool.close()
    assert json.loads((tmp_path / "layout.json").read_text()) == json.loads(LAYOUT.read_text())
