"""A replayed capture is the capture: order and values over the wires, stamps too when decoded as stored."""

from __future__ import annotations

import time
from threading import Event

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.blocks import Block
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.services.acquisition.player import Progress, replay
from lacet.services.acquisition.recorder import Recorder
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from lacet.services.acquisition.transports.endpoints import open_receiver, open_sender
from tests.support.rig import T0, free_port, make_frames, rig_text


class FakeWire:
    """A sender that keeps what it was given and when; a receiver that gives frames as they are stored."""

    warnings: list[str] = []  # noqa: RUF012 (never written)
    sees_receivers = True
    endpoint = "fake"

    def __init__(self, source: str, stored: Frames | None = None, batch: int = 300):
        self.source = source
        self.unsent = 0
        self.sent: list[tuple[float, Frames]] = []
        self._stored = stored
        self._at = 0
        self._batch = batch

    def open(self) -> None: ...

    def close(self) -> None: ...

    def has_room(self) -> bool:
        return True

    def losses(self) -> dict[str, int]:
        return {}

    def send(self, frames: Frames) -> None:
        self.sent.append((time.monotonic(), frames))

    def read(self, timeout: float) -> Frames:
        assert self._stored is not None
        part = self._stored[self._at : self._at + self._batch]
        self._at += len(part)
        if not len(part):
            time.sleep(timeout)
        return part


def frames_of(source: str, t_ns: list[int]) -> Frames:
    return Frames.from_iter(source, [(source, t, i, bytes([i % 256])) for i, t in enumerate(t_ns)])


def assert_same(a: dict[str, Block], b: dict[str, Block], stamps: bool) -> None:
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=name)
        np.testing.assert_array_equal(a[name].flags, b[name].flags, err_msg=name)
        if stamps:
            np.testing.assert_array_equal(a[name].t_ns, b[name].t_ns, err_msg=name)


@settings(deadline=None, max_examples=20)
@given(
    st.lists(st.integers(0, 40_000_000), min_size=1, max_size=50),
    st.lists(st.integers(0, 40_000_000), max_size=50),
    st.booleans(),
)
def test_every_frame_is_sent_once_in_the_order_recorded(a, b, unpaced):
    frames = {"a": frames_of("a", a), "b": frames_of("b", b)}  # stamps may even go back
    senders = {name: FakeWire(name) for name in frames}
    progress = replay(frames, senders, None if unpaced else 20.0)
    for name, sender in senders.items():
        got = Frames.concat(name, [part for _, part in sender.sent])
        np.testing.assert_array_equal(got.ident, frames[name].ident)
        np.testing.assert_array_equal(got.data, frames[name].data)
    assert progress.sent == progress.total == len(a) + len(b)


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_frames_go_out_when_they_are_due(speed):
    frames = {"a": frames_of("a", [T0 + i * 2_000_000 for i in range(200)])}
    sender = FakeWire("a")
    started = time.monotonic()
    replay(frames, {"a": sender}, speed)
    late = [at - started - (part.t_ns[-1] - T0) / 1e9 / speed for at, part in sender.sent]
    assert min(late) > -0.001
    assert np.median(late) < 0.012
    assert len(sender.sent) < 120  # in batches, not one by one


def test_a_loop_goes_on_until_it_is_stopped():
    stop = Event()
    sender = FakeWire("a")

    def report(progress: Progress) -> None:
        if progress.rounds >= 2:
            stop.set()

    progress = replay({"a": frames_of("a", [0, 30_000_000])}, {"a": sender}, None, True, stop, report)
    assert progress.rounds >= 2
    sent = sum(len(part) for _, part in sender.sent)
    assert 2 * progress.rounds <= sent <= 2 * progress.rounds + 2


def test_over_the_wires_values_counters_and_order_are_the_captures():
    port = free_port()
    rig = Rig.parse(rig_text(port))
    stored = make_frames(rig, 1.0, scale=0.3)
    offline = decode_frames(Decoder(rig), list(stored.values()))
    multicast = {"can0": f"multicast:{free_port()}", "can1": f"multicast:{free_port()}"}
    places = {**multicast, "serial0": "pty", "udp0": f"udp:127.0.0.1:{port}"}
    senders = {name: open_sender(rig.buses[name], place) for name, place in places.items()}
    for sender in senders.values():
        sender.open()
    receivers = [open_receiver(rig.buses[name], sender.endpoint) for name, sender in senders.items()]
    for receiver in receivers:
        receiver.open()
    before = time.time_ns()
    replay(stored, senders, 4.0)
    parts: dict[str, list[Frames]] = {receiver.source: [] for receiver in receivers}
    until = time.monotonic() + 2.0
    while time.monotonic() < until:
        new = [receiver.read(0.05) for receiver in receivers]
        for part in new:
            parts[part.source].append(part)
        if not any(map(len, new)):
            break
    got = {name: Frames.concat(name, items) for name, items in parts.items()}
    for receiver in receivers:
        assert receiver.losses() == {}
        receiver.close()
    for sender in senders.values():
        assert sender.unsent == 0
        sender.close()
    for name, frames in stored.items():
        np.testing.assert_array_equal(got[name].data, frames.data)
        if name != "serial0":  # where a frame is whatever piece a read returned
            np.testing.assert_array_equal(got[name].ident, frames.ident)
            np.testing.assert_array_equal(got[name].lengths, frames.lengths)
        assert np.all(got[name].t_ns >= before)  # arrival times, not those of the capture
    assert_same(decode_frames(Decoder(rig), list(got.values())), offline, stamps=False)


@pytest.mark.parametrize("batch", [1000, 37])
def test_stored_frames_through_the_live_loop_give_the_blocks_of_decoding_stamps_included(tmp_path, batch):
    rig = Rig.parse(rig_text())
    stored = make_frames(rig, 1.0, scale=0.3)
    stored["can0"] = stored["can0"][:-1]  # a sample that is never finished
    offline = decode_frames(Decoder(rig), list(stored.values()))
    path = tmp_path / "live.mcap"
    wires = [FakeWire(name, frames, batch) for name, frames in stored.items()]
    recorder = Recorder(wires, Decoder(rig), LogWriter(path, StartRecord("r", T0, "", rig.text)), notify=lambda _: None)
    summary = recorder.run(Event(), until_idle=0.3)
    assert summary.losses == {"can0": {"incomplete": 1}}
    log = LogReader(path)
    assert log.damage == []
    assert_same(log.blocks(), offline, stamps=True)
    for name, frames in stored.items():
        again = log.frames(name)
        np.testing.assert_array_equal(again.t_ns, frames.t_ns)
        np.testing.assert_array_equal(again.data, frames.data)
