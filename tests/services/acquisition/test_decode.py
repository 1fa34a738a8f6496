"""From captures to decoded logs and viewer files: the same samples whichever way, the same bytes each time."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from lacet.daq.blocks import Block, Flag
from lacet.daq.channels import CHANNELS, CORNERS, STANDARD
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord, StopRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from lacet.services.commands.__main__ import main

T0 = 1_700_000_000 * 10**9
SECONDS = 2.0
RIG = """
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[bus.can0]
kind = "can"
[bus.can1]
kind = "can"
[bus.serial0]
kind = "serial"
device = "/dev/ttyUSB0"
[bus.udp0]
kind = "udp"
port = 47110
[[sensor]]
name = "wheels"
driver = "igel"
bus = "can0"
channels = ["wheel.*"]
axes = "tydex_c"
[[sensor]]
name = "imu"
driver = "sagem"
bus = "serial0"
channels = ["imu.*"]
position = [0.0, 0.0, 0.0]
[[sensor]]
name = "lasers"
driver = "lasers"
bus = "can1"
channels = ["laser.*"]
position_from_wheel_centre = [0.0, 0.0, 0.3]
[[sensor]]
name = "correvit"
driver = "correvit"
bus = "can1"
channels = ["correvit.speed"]
position = [-3.2, 0.0, 0.0]
[[sensor]]
name = "cameras"
driver = "zimmer"
bus = "udp0"
channels = ["camera.*"]
"""


def measured(channel: str) -> Block:
    """Slow motion of a size any sensor can send."""
    about = CHANNELS[channel]
    n = int(SECONDS * about.rate)
    t = T0 + np.rint(np.arange(n) / about.rate * 1e9).astype(np.int64)
    wave = 20 * about.noise * (1.5 + np.sin((t - T0)[:, None] / 3e8 + np.arange(about.width)))
    return Block(channel, t, wave, np.zeros(n, np.uint8), t - T0 if about.rate in (100.0, 200.0) else None)


def wires(rig: Rig) -> list[Frames]:
    """What each bus carries, in time order."""
    by_bus: dict[str, list[Frames]] = {}
    for sensor in rig.sensors:
        assert sensor.driver is not None
        assert sensor.bus is not None
        driver = open_driver(sensor.driver, sensor.bus, sensor.options, rig.folder)
        sent = driver.encode({channel: measured(channel) for channel in driver.channels})
        by_bus.setdefault(sensor.bus, []).append(sent)
    return [sort(Frames.concat(source, parts)) for source, parts in by_bus.items()]


def sort(frames: Frames) -> Frames:
    rows = sorted(frames, key=lambda frame: frame.t_ns)
    return Frames.from_iter(frames.source, rows)


@pytest.fixture(scope="module")
def frames() -> list[Frames]:
    return wires(Rig.parse(RIG))


@pytest.fixture
def capture(tmp_path: Path, frames: list[Frames]) -> Path:
    return record(tmp_path / "raw.mcap", frames)


def record(path: Path, frames: list[Frames], **extra: str) -> Path:
    start = StartRecord("run-7", T0, rig_text=RIG, vehicle="406", manoeuvre="slalom", wheel_reference="hub", **extra)
    with LogWriter(path, start) as writer:
        for k in range(0, max(map(len, frames)), 40):
            for batch in frames:
                writer.write_frames(batch[k : k + 40])
        writer.close(StopRecord(T0 + int(SECONDS * 1e9), "stopped", {}, {"can0": {"kernel": 0}}))
    return path


def test_decode_gives_what_was_sent(capture: Path, tmp_path: Path, frames: list[Frames]):
    out = tmp_path / "run.mcap"
    assert main(["decode", str(capture), "-o", str(out), "--json", str(tmp_path / "r.json")]) == 0
    reader = LogReader(out)
    assert reader.damage == []
    blocks = reader.blocks()
    assert set(blocks) == set(STANDARD)
    for channel, block in blocks.items():
        sent = measured(channel)
        assert (block.flags == 0).all(), channel
        np.testing.assert_array_equal(block.t_ns, sent.t_ns)
        assert np.abs(block.values - sent.values).max() <= max(3 * CHANNELS[channel].noise, 1e-3), channel
    for batch in frames:
        raw = reader.frames(batch.source)
        np.testing.assert_array_equal(raw.data, batch.data)
        np.testing.assert_array_equal(raw.t_ns, batch.t_ns)
    assert reader.stop is not None
    assert reader.stop.reason == "stopped"
    assert "igel.dbc" in reader.start.documents
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["command"] == "decode"
    assert result["samples"]["imu.rate"] == 400
    assert result["losses"] == {}
    assert result["ledger"]["can0"]["received"] == len(next(f for f in frames if f.source == "can0"))


def test_the_folder_of_the_log_is_made_when_it_is_missing(capture: Path, tmp_path: Path):
    assert main(["decode", str(capture), "-o", str(tmp_path / "new" / "folder" / "run.mcap")]) == 0
    assert [file.name for file in (tmp_path / "new" / "folder").iterdir()] == ["run.mcap"]


def test_axes_are_those_of_the_rig(capture: Path, tmp_path: Path):
    out = tmp_path / "run.mcap"
    main(["decode", str(capture), "-o", str(out)])
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        force = next(reader.iter_decoded_messages(topics=["/decoded/wheel/fl/force"]))[3]
    assert force.axes == "tydex_c"


def test_decoding_twice_and_again_gives_the_same_bytes(capture: Path, tmp_path: Path):
    one, two, again = (tmp_path / name for name in ("one.mcap", "two.mcap", "again.mcap"))
    for source, target in ((capture, one), (capture, two), (one, again)):
        assert main(["decode", str(source), "-o", str(target)]) == 0
    assert one.read_bytes() == two.read_bytes() == again.read_bytes()


@pytest.mark.parametrize("size", [1, 7, 64])
def test_any_batches_give_the_same_samples(frames: list[Frames], size: int):
    short = [batch[:300] for batch in frames]
    rig = Rig.parse(RIG)
    whole = decode_frames(Decoder(rig), short)
    pieces = decode_frames(
        decoder := Decoder(rig), [batch[k : k + size] for batch in short for k in range(0, 300, size)]
    )
    assert set(whole) == set(pieces)
    for channel, block in whole.items():
        np.testing.assert_array_equal(block.values, pieces[channel].values)
        np.testing.assert_array_equal(block.t_ns, pieces[channel].t_ns)
        np.testing.assert_array_equal(block.flags, pieces[channel].flags)
    assert decoder.ledger()["can0"]["received"] == 300


def without(frames: Frames, keep: Callable[[int], bool]) -> Frames:
    return Frames.from_iter(frames.source, [frame for i, frame in enumerate(frames) if keep(i)])


def test_losses_are_named_and_exit_with_3(tmp_path: Path, frames: list[Frames], capsys: pytest.CaptureFixture[str]):
    broken = [without(batch, lambda i: i % 100 != 50) if batch.source == "can0" else batch for batch in frames]
    path = record(tmp_path / "raw.mcap", broken)
    out = tmp_path / "run.mcap"
    assert main(["decode", str(path), "-o", str(out)]) == 3
    stop = LogReader(out).stop
    assert stop is not None
    assert sum(stop.losses["can0"].values()) > 0
    assert "lost" in capsys.readouterr().out


def test_a_sample_cut_off_by_the_end_is_flagged(tmp_path: Path, frames: list[Frames]):
    path = record(tmp_path / "raw.mcap", [batch[:-1] if batch.source == "can0" else batch for batch in frames])
    out = tmp_path / "run.mcap"
    assert main(["decode", str(path), "-o", str(out)]) == 3
    blocks = LogReader(out).blocks()
    flags = np.array([blocks[f"wheel.{c}.force"].flags for c in CORNERS])
    assert flags.shape == (4, 1000)
    assert np.count_nonzero(flags & Flag.INCOMPLETE) == 1
    assert flags[:, -1].any()


def test_a_stamp_that_goes_back_does_not_change_the_order(tmp_path: Path, frames: list[Frames]):
    def late(batch: Frames) -> Frames:
        t_ns = batch.t_ns.copy()
        t_ns[len(t_ns) // 2] -= 10**9
        return Frames(batch.source, t_ns, batch.ident, batch.offset, batch.data)

    backwards = [late(batch) for batch in frames]
    path = record(tmp_path / "raw.mcap", backwards)
    main(["decode", str(path), "-o", str(tmp_path / "run.mcap")])
    reader = LogReader(tmp_path / "run.mcap")
    for batch in backwards:
        np.testing.assert_array_equal(reader.frames(batch.source).t_ns, batch.t_ns)
        np.testing.assert_array_equal(reader.frames(batch.source).data, batch.data)


def test_unknown_ids_are_counted_and_cost_nothing(tmp_path: Path, frames: list[Frames]):
    rig = Rig.parse(RIG)
    known = next(batch for batch in frames if batch.source == "can1")
    foreign = Frames.from_iter("can1", [("can1", T0 + i, 0x7E0, b"\x02\x10\x03") for i in range(11)])
    decoder = Decoder(rig)
    decode_frames(decoder, [Frames.concat("can1", [known, foreign]), foreign[:0]])
    ledger = decoder.ledger()["can1"]
    assert ledger["unknown_ident"] == 11
    assert ledger["received"] == len(known) + 11
    assert "can1" not in decoder.losses()
    lonely = Frames.from_iter("can7", [("can7", T0, 1, b"x")])
    assert decoder.feed(lonely) == []
    assert decoder.ledger()["can7"] == {"received": 1, "no_driver": 1}


def test_a_channel_that_never_came_is_said(tmp_path: Path, frames: list[Frames], capsys: pytest.CaptureFixture[str]):
    path = record(tmp_path / "raw.mcap", [batch for batch in frames if batch.source != "udp0"])
    assert main(["decode", str(path), "-o", str(tmp_path / "run.mcap")]) == 3
    assert "camera.fl.steer: no samples came" in capsys.readouterr().out


def test_a_bus_without_frames_for_a_while_is_said(
    tmp_path: Path, frames: list[Frames], capsys: pytest.CaptureFixture[str]
):
    """A cable that was loose from 0.8 to 1.2 s: the bus's channels alone, and those of one pause together."""
    around = [f if f.source != "udp0" else Frames.concat("udp0", [f[:80], f[120:]]) for f in frames]
    raw, result = record(tmp_path / "raw.mcap", around), tmp_path / "r.json"
    main(["decode", str(raw), "-o", str(tmp_path / "run.mcap"), "--json", str(result)])
    (note,) = json.loads(result.read_text(encoding="utf-8"))["notes"]
    assert re.fullmatch(r"no samples of (camera\.\S+,? ){3}and \d+ more from 0\.\d+ to 1\.\d+ s", note)
    assert note in capsys.readouterr().out


def test_a_cut_capture_is_decoded_as_far_as_it_goes(capture: Path, tmp_path: Path):
    data = capture.read_bytes()
    capture.write_bytes(data[: len(data) // 2])
    assert main(["decode", str(capture), "-o", str(tmp_path / "run.mcap")]) == 3
    reader = LogReader(tmp_path / "run.mcap")
    assert reader.damage == []
    assert "cut off" in reader.start.extra["damage"]
    assert 100 < len(reader.blocks()["wheel.fl.force"]) < 1000


def test_a_mended_dbc_and_rig_are_used(capture: Path, tmp_path: Path):
    folder = tmp_path / "mended"
    folder.mkdir()
    original = Decoder(Rig.parse(RIG)).documents["correvit.dbc"]
    lines = [line.replace("(0.036,0)", "(0.072,0)") for line in original.splitlines()]
    mended = "\n".join(lines) + "\n"
    assert mended.strip() != original.strip()
    (folder / "correvit.dbc").write_text(mended)
    plain, by_dbc, by_rig, kept = (tmp_path / f"{k}.mcap" for k in range(4))
    assert main(["decode", str(capture), "-o", str(plain)]) == 0
    assert main(["decode", str(capture), "-o", str(by_dbc), "--dbc", str(folder / "correvit.dbc")]) == 0
    speed = LogReader(plain).blocks()["correvit.speed"].values
    np.testing.assert_allclose(LogReader(by_dbc).blocks()["correvit.speed"].values, 2 * speed)
    assert LogReader(by_dbc).start.documents["correvit.dbc"] == mended
    # Recorded with the log, the document is used the next time by itself.
    assert main(["decode", str(by_dbc), "-o", str(kept)]) == 0
    assert kept.read_bytes() == by_dbc.read_bytes()
    rig = RIG.replace('driver = "correvit"', 'driver = "correvit"\noptions = { dbc = "correvit.dbc" }')
    (folder / "rig.toml").write_text(rig)
    assert main(["decode", str(plain), "-o", str(by_rig), "--rig", str(folder / "rig.toml")]) == 0
    np.testing.assert_allclose(LogReader(by_rig).blocks()["correvit.speed"].values, 2 * speed)
    assert LogReader(by_rig).start.rig_text == rig


def test_info_says_what_a_log_without_channels_holds(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Raw frames, which are to be decoded, or nothing at all, as after a disk that was full from the start."""
    empty = tmp_path / "empty.mcap"
    LogWriter(empty, StartRecord("r", T0, rig_text=RIG)).close()
    for path, says in ((capture, "Only raw frames: lacet decode makes"), (empty, "nothing was recorded in it.")):
        capsys.readouterr()
        main(["info", str(path)])
        assert says in capsys.readouterr().out


def test_what_cannot_be_decoded_is_refused(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = str(tmp_path / "run.mcap")
    odd = tmp_path / "igle.dbc"
    odd.write_text("")
    empty = tmp_path / "empty.mcap"
    LogWriter(empty, StartRecord("r", T0, rig_text=RIG)).close()
    for arguments, message in (
        ([str(tmp_path / "nowhere.mcap"), "-o", out], "no such file"),
        ([str(empty), "-o", out], "nothing to decode"),
        ([str(capture), "-o", str(capture)], "exists"),
        ([str(capture), "-o", str(capture), "--force"], "exists"),
        ([str(capture), "-o", out, "--dbc", str(odd)], "did you mean 'igel.dbc'"),
    ):
        assert main(["decode", *arguments]) == 2
        assert message in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty.mcap", "igle.dbc", "raw.mcap"]


def test_rows_for_viewers(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    log, rows = tmp_path / "run.mcap", tmp_path / "rows.mcap"
    main(["decode", str(capture), "-o", str(log)])
    assert main(["export", "--rows", str(log), "-o", str(rows), "--channels", "imu.rate", "laser.*.hub"]) == 0
    with rows.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(log_time_order=False))
    blocks = LogReader(log).blocks(["imu.rate", "laser.fl.hub"])
    times = [message.log_time for _, _, message, _ in found]
    assert times == sorted(times)
    rates = [row for _, channel, _, row in found if channel.topic == "/imu/rate"]
    np.testing.assert_array_equal([[row.x, row.y, row.z] for row in rates], blocks["imu.rate"].values)
    stamps = [row.timestamp.seconds * 10**9 + row.timestamp.nanos for row in rates]
    assert stamps == blocks["imu.rate"].t_ns.tolist()
    hub = [row for _, channel, _, row in found if channel.topic == "/laser/fl/hub"]
    assert [row.value for row in hub] == blocks["laser.fl.hub"].values[:, 0].tolist()
    assert not hub[0].HasField("x")
    assert len({channel.topic for _, channel, _, _ in found}) == 5
    assert main(["export", "--rows", str(capture), "-o", str(tmp_path / "no.mcap")]) == 2
    assert "lacet decode" in capsys.readouterr().err
    assert main(["export", "--rows", str(log), "-o", str(tmp_path / "no.mcap"), "--channels", "imu.rates"]) == 2
    assert "did you mean 'imu.rate'" in capsys.readouterr().err
