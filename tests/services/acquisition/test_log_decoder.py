"""Decoding a log window by window gives the bytes of decoding it as a whole, whatever happens at a window's border."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.frames import Frame, Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver
from lacet.services.acquisition import log_decoder
from lacet.services.acquisition.log_decoder import WINDOW_NS
from lacet.services.acquisition.stream_decoder import closing_record, decode_frames
from lacet.services.workspace.decode import _start, decode_log, open_decoder
from tests.drivers.driver_cases import spoil
from tests.support.rig import T0, rig_text, samples

SECONDS = 5.0
SCALE = 0.04
"""Rates as a fraction of the nominal ones: 240 frames a second on can0."""
WRAP_NS = 2**32 * 1000
BEGIN_NS = (T0 // WRAP_NS + 1) * WRAP_NS - 2_000_000_000
"""Begin of the run: the clock of the inertial unit wraps after two seconds, where a step of 20 windows ends."""
RIG = Rig.parse(rig_text())
BORDER_NS = BEGIN_NS + 2_000_000_000
FL = (272, 273, 274)
"""Messages of a sample of the front left wheel."""

Spoiler = Callable[[list[Frame]], list[Frame]]


def encoded() -> dict[str, list[Frame]]:
    """What each bus carries, in time order."""
    wires: dict[str, list[Frame]] = {}
    for sensor in RIG.sensors:
        assert sensor.driver is not None
        assert sensor.bus is not None
        driver = open_driver(sensor.driver, sensor.bus, sensor.options, RIG.folder)
        made = {name: samples(CHANNELS[name], SECONDS, SCALE * CHANNELS[name].rate) for name in driver.channels}
        blocks = {n: Block(n, b.t_ns - T0 + BEGIN_NS, b.values, b.flags) for n, b in made.items()}
        wires.setdefault(sensor.bus, []).extend(driver.encode(blocks, counter=5))
    return {bus: sorted(frames, key=lambda frame: frame.t_ns) for bus, frames in wires.items()}


def spoilt_near_borders(frames: list[Frame]) -> list[Frame]:
    """Frames lost, repeated, cut short and changed around every fifth window's border."""
    rng = np.random.default_rng(3)
    near = [abs((f.t_ns - BEGIN_NS + WINDOW_NS) % (5 * WINDOW_NS) - WINDOW_NS) < 20_000_000 for f in frames]
    out: list[Frame] = []
    for frame, is_near in zip(frames, near, strict=True):
        if is_near:
            out += list(spoil(Frames.from_iter(frame.source, [frame]), rng))
        else:
            out.append(frame)
    return [frame._replace(t_ns=max(frame.t_ns, BEGIN_NS)) for frame in out]


def begun(frames: list[Frame]) -> Frame:
    """The first message of the wheel's last sample before the border; any frame on another bus."""
    return [f for f in frames if f.ident in (FL[0], 0x210, 0) and f.t_ns < BORDER_NS][-1]


def silent(frames: list[Frame]) -> list[Frame]:
    """The front left wheel falls silent for good in the middle of a sample."""
    last = begun(frames)
    return [f for f in frames if f.ident not in FL or f.t_ns < last.t_ns or f is last]


def stalled(frames: list[Frame]) -> list[Frame]:
    """It stands still for a second and a half in the middle of a sample."""
    last = begun(frames)
    return [f for f in frames if f.ident not in FL or f is last or not 0 <= f.t_ns - last.t_ns < 1_500_000_000]


def jumping(frames: list[Frame]) -> list[Frame]:
    """A stamp is 2 s ahead, another 1 s behind; the bus is silent for a while."""
    out = list(frames)
    out[len(out) // 4] = out[len(out) // 4]._replace(t_ns=out[len(out) // 4].t_ns + 2_000_000_000)
    out[len(out) // 2] = out[len(out) // 2]._replace(t_ns=out[len(out) // 2].t_ns - 1_000_000_000)
    return [f for f in out if not 0 < f.t_ns - BORDER_NS < 350_000_000]


def cut_in_messages(frames: list[Frame]) -> list[Frame]:
    """Bytes of the serial line in reads of 7 bytes, the rest unchanged."""
    if not frames or frames[0].source != "serial0":
        return frames
    return [f._replace(payload=f.payload[i : i + 7]) for f in frames for i in range(0, len(f.payload), 7)]


def record(path: Path, wires: dict[str, list[Frame]], apart: bool = False) -> None:
    """Write a capture, in batches of 40 ms, or bus after bus."""
    with LogWriter(path, StartRecord("run-7", BEGIN_NS, rig_text=RIG.text), chunk_seconds=0.04) as log:
        batches = [
            (0 if apart else min(f.t_ns for f in batch), bus, batch)
            for bus, frames in wires.items()
            for batch in (frames[i : i + 24] for i in range(0, len(frames), 24))
        ]
        for _, bus, batch in sorted(batches, key=lambda entry: entry[:2] if apart else entry[0]):
            log.write_frames(Frames.from_iter(bus, batch))


def decode_whole(raw: Path, out: Path) -> None:
    """All frames of a log in one piece, then all of the messages in the order of their windows."""
    reader = LogReader(raw)
    decoder = open_decoder(reader, None, [])
    frames = [reader.frames(source) for source in reader.sources()]
    blocks = decode_frames(decoder, frames)
    items = [item for item in (*frames, *(blocks[channel] for channel in sorted(blocks))) if len(item)]
    pieces = []
    for row, item in enumerate(items):
        window = np.maximum.accumulate(item.t_ns) // WINDOW_NS
        starts = np.flatnonzero(np.diff(window, prepend=window[0] - 1))
        pieces += [(window[a], row, a, b) for a, b in zip(starts, [*starts[1:], len(window)], strict=True)]
    axes = {name: sensor.axes for sensor in decoder.rig.sensors for name in sensor.channels}
    with LogWriter(out, _start(reader, decoder), axes=axes) as writer:
        for _, row, a, b in sorted(pieces):
            item = items[row]
            if isinstance(item, Frames):
                writer.write_frames(item[a:b])
            else:
                device = None if item.device_ns is None else item.device_ns[a:b]
                writer.write_block(Block(item.channel, item.t_ns[a:b], item.values[a:b], item.flags[a:b], device))
        writer.close(closing_record(reader, decoder, max(int(batch.t_ns.max()) for batch in frames if len(batch))))


@pytest.fixture(scope="module")
def wires() -> dict[str, list[Frame]]:
    return encoded()


@pytest.fixture(params=[(20, 10), (1, 0)], ids=lambda p: f"{p[0]} windows, {p[1]} held")
def windows(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_decoder, "STEP", request.param[0])
    monkeypatch.setattr(log_decoder, "HOLD", request.param[1])


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("spoiler", [list, spoilt_near_borders, silent, stalled, jumping, cut_in_messages])
def test_windows_give_the_bytes_of_the_whole(tmp_path: Path, wires: dict[str, list[Frame]], spoiler: Spoiler):
    raw, whole, windowed = (tmp_path / f"{name}.mcap" for name in ("raw", "whole", "windowed"))
    record(raw, {bus: spoiler(frames) for bus, frames in wires.items()})
    decode_whole(raw, whole)
    found = decode_log(raw, windowed)
    assert windowed.read_bytes() == whole.read_bytes()
    assert found["damage"] == []
    assert found["samples"] == {name: len(block) for name, block in LogReader(whole).blocks().items()}


def test_the_order_of_buses_in_the_file_does_not_matter(tmp_path: Path, wires: dict[str, list[Frame]]):
    raw, apart, whole, windowed = (tmp_path / f"{name}.mcap" for name in ("raw", "apart", "whole", "windowed"))
    record(raw, wires)
    record(apart, wires, apart=True)
    decode_whole(raw, whole)
    decode_log(apart, windowed)
    assert windowed.read_bytes() == whole.read_bytes()


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("place", [0.4, 0.41, 0.8])
def test_damage_gives_the_bytes_of_the_whole(tmp_path: Path, wires: dict[str, list[Frame]], place: float):
    raw, whole, windowed = (tmp_path / f"{name}.mcap" for name in ("raw", "whole", "windowed"))
    record(raw, {bus: silent(frames) for bus, frames in wires.items()})
    data = bytearray(raw.read_bytes())
    at = int(place * len(data))
    data[at : at + 40] = bytes(40)
    raw.write_bytes(data[: int(0.95 * len(data))])  # and killed before it was closed
    decode_whole(raw, whole)
    found = decode_log(raw, windowed)
    assert len(found["damage"]) >= 2
    assert windowed.read_bytes() == whole.read_bytes()


def test_a_message_that_cannot_be_read_is_in_the_start_record(tmp_path: Path, wires: dict[str, list[Frame]]):
    raw, whole, windowed = (tmp_path / f"{name}.mcap" for name in ("raw", "whole", "windowed"))
    with LogWriter(raw, StartRecord("run-7", BEGIN_NS, rig_text=RIG.text)) as log:
        for bus, frames in wires.items():
            for i in range(0, len(frames), 24):
                batch = log.messages(Frames.from_iter(bus, frames[i : i + 24]), (0, len(frames[i : i + 24])))[0]
                bad = bus in ("udp0", "can1") and i == 0
                log.write(batch._replace(data=b"\xff" * 30) if bad else batch)
    decode_whole(raw, whole)
    found = decode_log(raw, windowed)
    assert [line.split(":")[0] for line in found["damage"]] == ["/raw/can1", "/raw/udp0"]
    assert windowed.read_bytes() == whole.read_bytes()
    assert "cannot be used" in LogReader(windowed).start.extra["damage"]


def test_stamps_far_ahead_cost_no_frame_and_no_sample(
    tmp_path: Path, wires: dict[str, list[Frame]], monkeypatch: pytest.MonkeyPatch
):
    """The rest of the run is in one window then, of more frames than are taken at a time: it is written in parts."""
    monkeypatch.setattr(log_decoder, "LARGEST", 100)
    raw, whole, windowed = (tmp_path / f"{name}.mcap" for name in ("raw", "whole", "windowed"))
    far = {
        bus: [*frames[:400], frames[400]._replace(t_ns=BEGIN_NS + 10**13), *frames[401:]] if bus == "can0" else frames
        for bus, frames in wires.items()
    }
    record(raw, far)
    decode_whole(raw, whole)
    decode_log(raw, windowed)
    one, other = LogReader(whole), LogReader(windowed)
    for source in one.sources():
        np.testing.assert_array_equal(one.frames(source).t_ns, other.frames(source).t_ns)
        np.testing.assert_array_equal(one.frames(source).data, other.frames(source).data)
    blocks, others = one.blocks(), other.blocks()
    assert set(blocks) == set(others)
    for name, block in blocks.items():
        np.testing.assert_array_equal(block.values, others[name].values)
        np.testing.assert_array_equal(block.t_ns, others[name].t_ns)
        np.testing.assert_array_equal(block.flags, others[name].flags)
    assert other.damage == []
