"""Bus logs of other tools on the wires of a rig: replayed, recorded, decoded, they give an import's channels."""

from __future__ import annotations

import itertools
import json
import signal
import time
from pathlib import Path

import can
import numpy as np
import pytest

from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.frames import EXTENDED
from lacet.daq.rig import Rig
from lacet.daq.sources.bus_log import is_raw_log, read_bus_log
from lacet.services.acquisition.other_logs import frames_for
from lacet.services.commands.__main__ import main
from tests.support.places import HOME
from tests.support.processes import Command, commands
from tests.support.rig import free_port

CAN = HOME / "tests/data/can"
VEHICLE = HOME / "tests/data/car/vehicle.toml"
SIGNALS = """\
"car.yaw_rate" = "GYRO_YAW"
"steering.angle" = "-STEER_ANGLE"
"wheel.fl.speed" = "WS_FL / 0.31 m"
"correvit.speed.x" = "SPEED"
"correvit.speed.y" = "0.1 s * ACCEL_LAT"
"""
RIG = """\
format = "lacet-rig 1"
name = "road"
[bus.can0]
[[sensor]]
name = "car"
driver = "dbc"
bus = "can0"
dbc = "{dbc}"
[sensor.signals]
{signals}"""


def rig(folder: Path, dbc: Path = CAN / "road-car.dbc", signals: str = SIGNALS) -> Path:
    (folder / "rig.toml").write_text(RIG.format(dbc=dbc, signals=signals), encoding="utf-8")
    return folder / "rig.toml"


def imported(folder: Path, log: Path, dbc: Path, signals: str) -> LogReader:
    """The run that `lacet import` makes of a log by a map of the same signals."""
    (folder / "map.toml").write_text(f'format = "lacet-map 1"\n[channels]\n{signals}', encoding="utf-8")
    words = ["import", log, "--map", folder / "map.toml", "--dbc", dbc, "-o", folder / "imported.mcap"]
    assert main([str(word) for word in words]) in (0, 3)
    return LogReader(folder / "imported.mcap")


def test_what_is_replayed_and_recorded_has_the_channels_of_an_import(tmp_path):
    """From the candump to the log of a recorder and of a worker, on virtual CAN, at three times the speed."""
    log = CAN / "road-car.candump.log"
    rig(tmp_path)
    router, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    wires = ("--endpoints", "wires.json")
    with commands() as running:

        def start(name: str, *args: object) -> Command:
            running.append(Command(name, *args, cwd=tmp_path))
            return running[-1]

        to = ("--to", f"can0=multicast:{port}")
        replay = start("replay", log, "--rig", "rig.toml", *wires, "--wait", 60, "--speed", 3, *to)
        record = start(
            "record", "--rig", "rig.toml", "--vehicle", VEHICLE, "-o", "log.mcap", *wires, "--listen", router,
            "--json", "record.json",
        )  # fmt: skip
        worker = start("worker", "--connect", router, "--once", "--no-fit", "--name", "desk", "--out", "desk")
        assert replay.wait() == 0, replay.text()
        time.sleep(0.5)  # the last frames are read; no pause of the replay before ends the recording
        record.process.send_signal(signal.SIGINT)
        assert record.wait() == 0, record.text()
        assert worker.wait() == 0, worker.text()
    report = json.loads((tmp_path / "record.json").read_text())
    assert report["losses"] == {}
    recorded = LogReader(tmp_path / "log.mcap")
    sent, received = read_bus_log(log)["can0"], recorded.frames("can0")
    np.testing.assert_array_equal(received.data, sent.data)
    np.testing.assert_array_equal(received.ident, sent.ident)
    assert set(recorded.start.documents) == {str(CAN / "road-car.dbc")}
    wanted, ours = imported(tmp_path, log, CAN / "road-car.dbc", SIGNALS).blocks(), recorded.blocks()
    assert set(wanted) == set(ours) == {"car.yaw_rate", "steering.angle", "wheel.fl.speed", "correvit.speed"}
    for name, block in wanted.items():
        t, own = block.t_ns - sent.t_ns[0], 3 * (ours[name].t_ns - received.t_ns[0])
        assert len(ours[name]) == len(block)
        late = own - t  # [ns]; stamps are arrival times, also that of the first frame
        assert np.median(np.abs(late - np.median(late))) < 20e6
        assert abs(np.median(late)) < 1e9
        if name != "correvit.speed":
            np.testing.assert_array_equal(ours[name].values, block.values)
            np.testing.assert_array_equal(ours[name].flags, block.flags)
    # Between the samples of two messages the arrival decides: within one step of the slower one.
    good = (ours["correvit.speed"].flags == 0) & (wanted["correvit.speed"].flags == 0)
    assert good.mean() > 0.99
    np.testing.assert_allclose(ours["correvit.speed"].values[good], wanted["correvit.speed"].values[good], atol=0.1)
    (assembled,) = (tmp_path / "desk").glob("**/*.mcap")
    for name, block in LogReader(assembled).blocks().items():
        np.testing.assert_array_equal(block.values, ours[name].values)


CANEDGE = """\
"imu.accel.x" = "AccelerationX"
"imu.accel.y" = "AccelerationY"
"imu.accel.z" = "AccelerationZ"
"gnss.speed" = "Speed"
"""


@pytest.mark.parametrize(
    ("log", "dbc", "signals", "bus"),
    [
        ("road-car.candump.log", "road-car.dbc", SIGNALS, ()),
        ("canedge-gps-imu.mf4", "canmod-gps.dbc", CANEDGE, ("--as", "2=can0")),
    ],
    ids=["candump", "mdf"],
)  # fmt: skip
def test_decoded_with_the_logs_stamps_the_run_is_that_of_an_import(tmp_path, log, dbc, signals, bus):
    where = rig(tmp_path, CAN / dbc, signals)
    words = ["decode", str(CAN / log), "-o", str(tmp_path / "run.mcap"), "--rig", str(where), *bus]
    assert main(words) == 0
    ours, wanted = LogReader(tmp_path / "run.mcap"), imported(tmp_path, CAN / log, CAN / dbc, signals)
    assert set(ours.blocks()) == set(wanted.blocks())
    assert len(ours.frames("can0")) > 1000
    assert list(tmp_path.glob("*.capture")) == []
    for name, block in wanted.blocks().items():
        found = ours.blocks()[name]
        np.testing.assert_allclose(found.t_ns - block.t_ns, 0, atol=2)  # [ns]
        np.testing.assert_allclose(found.values, block.values, rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(found.flags, block.flags)
    # The rig and the DBC are in the log: it is decoded again without them.
    where.unlink()
    assert main(["decode", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "again.mcap")]) == 0
    again = LogReader(tmp_path / "again.mcap").blocks()
    for name, block in ours.blocks().items():
        np.testing.assert_array_equal(again[name].values, block.values)


MESSAGES = [
    can.Message(timestamp=1.6e9 + 0.25 * i, arbitration_id=ident, is_extended_id=extended, is_fd=len(data) > 8,
                data=data, channel=i % 2, is_rx=True)
    for i, (ident, extended, data) in enumerate([
        (0x123, False, b"\1\2\3"), (0x18F00400, True, bytes(8)), (5, True, b"a"), (5, False, b"b"), (0x7FF, False, b""),
        (0x18F00401, True, bytes(range(8))),
    ])
]  # fmt: skip


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_every_kind_of_log_gives_the_frames_bus_by_bus(tmp_path, suffix):
    wide = can.Message(timestamp=1.6e9 + 2, arbitration_id=9, is_extended_id=False, is_fd=True, data=bytes(range(48)))
    wide.channel = 0
    with can.Logger(str(tmp_path / f"log{suffix}")) as writer:
        for message in [*MESSAGES, wide]:
            writer(message)
    assert is_raw_log(tmp_path / f"log{suffix}")
    got = read_bus_log(tmp_path / f"log{suffix}")
    assert len(got) == 2
    first, second = got.values()
    rows = [(frame.ident, frame.payload) for frame in first]
    assert rows == [(0x123, b"\1\2\3"), (5 | EXTENDED, b"a"), (0x7FF, b""), (9, bytes(range(48)))]
    assert [frame.ident for frame in second] == [0x18F00400, 5, 0x18F00401]
    np.testing.assert_allclose(np.diff(first.t_ns), [5e8, 5e8, 1e9], atol=1e3)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc"])
def test_a_log_cut_short_is_told_by_import_and_decode(tmp_path, suffix, capsys):
    """What is whole is kept, with exit code 3; a whole log says nothing."""
    log, whole = tmp_path / f"drive{suffix}", tmp_path / f"whole{suffix}"
    with can.LogReader(str(CAN / "road-car.candump.log")) as frames, can.Logger(str(whole)) as writer:
        for message in itertools.islice(frames, 4000):
            message.channel = 0 if suffix in (".blf", ".asc", ".trc") else message.channel
            writer(message)
    content = whole.read_bytes()
    log.write_bytes(content[: content.rindex(b"\n", 0, 6 * len(content) // 10) - 6])  # in the data of a text log's line
    damage: list[str] = []
    (kept,), (every,) = read_bus_log(log, damage).values(), read_bus_log(whole, none := []).values()
    assert 0 < len(kept) < len(every)
    assert not none
    assert all((a.ident, a.payload) == (b.ident, b.payload) for a, b in zip(kept, every, strict=False))
    assert damage
    assert all(line.startswith(log.name) for line in damage)
    words = ["import", log, "--map", tmp_path / "map.toml", "--dbc", CAN / "road-car.dbc", "-o", tmp_path / "run.mcap"]
    (tmp_path / "map.toml").write_text(f'format = "lacet-map 1"\n[channels]\n{SIGNALS}', encoding="utf-8")
    capsys.readouterr()
    assert main([str(word) for word in words]) == 3
    said = capsys.readouterr()
    assert damage[0] in said.out
    assert "TRCReader" not in said.err
    words = ["decode", log, "--rig", rig(tmp_path), "-o", tmp_path / "decoded.mcap"]
    assert main([str(word) for word in words]) == 3
    assert f"damaged: {damage[0]}" in capsys.readouterr().out
    assert any(damage[0] in problem for problem in open_run(tmp_path / "decoded.mcap").problems)


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc"])
def test_buses_and_frames_of_a_log_that_are_not_used_are_said(tmp_path, capsys, suffix):
    """With their number; the exit code is that of the samples."""
    log = tmp_path / f"drive{suffix}"
    with can.LogReader(str(CAN / "road-car.candump.log")) as frames, can.Logger(str(log)) as writer:
        for k, message in enumerate(itertools.islice(frames, 1500)):
            message.channel = "can0" if suffix == ".log" else 0
            writer(message)
            if k % 3 == 0:
                message.channel = "can1" if suffix == ".log" else 1
                writer(message)
            if k in (10, 20, 30):
                error = k != 20
                kind = {"is_error_frame": error, "is_remote_frame": not error, "is_extended_id": error}
                writer(can.Message(message.timestamp, 0 if error else 256, channel=message.channel, **kind))
    words = ["decode", str(log), "--rig", str(rig(tmp_path)), "-o", str(tmp_path / "run.mcap")]
    name = "can1" if suffix == ".log" else "1"
    assert main(words + (["--as", "0=can0"] if suffix != ".log" else [])) == 0
    said = capsys.readouterr().out
    assert "2 error frames and 1 remote frame of the log are not used" in said
    assert f"bus {name} of the log is none of the rig's: 500 frames are not used (with --as {name}=BUS" in said


def test_a_clock_put_back_in_a_log_is_an_event_and_damage_of_the_run(tmp_path, capsys):
    """Every sample is there, in the order of the drive."""
    lines = (CAN / "road-car.candump.log").read_text().splitlines(keepends=True)[:4000]
    whole, log = tmp_path / "whole.log", tmp_path / "drive.log"
    whole.write_text("".join(lines))
    for k in range(2000, len(lines)):
        stamp, _, rest = lines[k].partition(") ")
        lines[k] = f"({float(stamp.lstrip('(')) - 2.0:.6f}) {rest}"
    log.write_text("".join(lines))
    where = rig(tmp_path)
    for path, code in ((whole, 0), (log, 3)):
        assert main(["decode", str(path), "--rig", str(where), "-o", str(path.with_suffix(".mcap"))]) == code
    assert "damaged: drive.log: its clock is put back by 2.00" in capsys.readouterr().out
    wanted, found = LogReader(tmp_path / "whole.mcap"), LogReader(tmp_path / "drive.mcap")
    (event,) = found.events()
    assert (event.kind, event.name, event.state) == ("host_clock", "can0", "stepped")
    assert abs(event.t_ns - wanted.frames("can0").t_ns[2000]) < 2e6
    for name, block in wanted.blocks().items():
        ours = found.blocks()[name]
        np.testing.assert_allclose(ours.t_ns, block.t_ns, atol=2e6)  # [ns]; as evenly as the messages of this car come
        if name != "correvit.speed":  # of two messages
            np.testing.assert_array_equal(ours.values, block.values)


def test_what_cannot_be_read_within_a_log_is_told_with_its_place(tmp_path):
    """Of a log that is cut short as well, what stands before it is kept; of one that has its end, it is an error."""
    lines = (CAN / "road-car.candump.log").read_text().splitlines(keepends=True)[:40]
    lines[30] = "(99999999999.0) can0 123#00\n"  # a frame, at no time
    log = tmp_path / "drive.log"
    log.write_text("".join(lines)[:-5])
    damage: list[str] = []
    assert len(read_bus_log(log, damage)["can0"]) == 30
    assert "its last line is not whole" in damage[0]
    assert "frame 31 of this candump log cannot be read" in damage[1]
    log.write_text("".join(lines))
    with pytest.raises(LacetError, match="frame 31 of this candump log cannot be read"):
        read_bus_log(log)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            [],
            r"which of its buses is which of the rig's \(can0\)\? It has '1' \(4,298 .*, '2' \(1,290 .*--as 1=can0",
        ),
        (["3=can0"], r"--as 3=can0: the log has no bus '3': '1' \(4,298"),
        (["2=can1"], r"--as 2=can1: no CAN bus 'can1' in the rig; did you mean 'can0'\? \(can0\)"),
        (["2"], "write LOGBUS=BUS, e.g. --as 1=can0"),
        (["1=can0", "2=can0"], "can0 is given twice"),
    ],
)
def test_which_bus_is_which_is_asked_and_not_guessed(tmp_path, words, says):
    with pytest.raises(LacetError, match=says):
        frames_for(CAN / "canedge-gps-imu.mf4", Rig.load(rig(tmp_path)), words)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["replay", CAN / "road-car.candump.log"], "give the rig they are in: --rig FILE"),
        (["decode", CAN / "road-car.candump.log", "-o", "x.mcap"], "give the rig that describes them: --rig FILE"),
        (["replay", HOME / "tests/data/car/sine.parquet", "--rig", "rig.toml"], "no raw frames of a bus: give candump"),
        (["replay", HOME / "tests/data/car/sine.parquet"], "no raw frames of a bus: give candump"),
        (["decode", HOME / "tests/data/car/sine.parquet", "-o", "x.mcap"], "sine.parquet"),
        (["replay", "nothing.blf", "--rig", "rig.toml"], "nothing.blf"),
        (["replay", CAN / "road-car.candump.log", "--rig", "rig.toml", "--bus", "can1"], "did you mean 'can0'"),
        (["replay", CAN / "road-car.candump.log", "--rig", "rig.toml", "--as", "can1=can0"], "did you mean 'can0'"),
    ],
)  # fmt: skip
def test_what_cannot_be_played_is_refused_with_the_remedy(tmp_path, capsys, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    rig(tmp_path)
    assert main([str(word) for word in words]) == 2
    assert says in capsys.readouterr().err


def test_info_checks_what_a_rig_says_of_signals(tmp_path, capsys):
    assert main(["info", str(rig(tmp_path))]) == 0
    assert "dbc" in capsys.readouterr().out
    wrong = rig(tmp_path, signals='"car.yaw_rate" = "GYRO_YAW + SPEED"\n"car.speed" = "SPED"\n')
    assert main(["info", str(wrong)]) == 2
    said = capsys.readouterr().err
    assert (
        f"{wrong}:\n  - sensor car.signals: car.yaw_rate: GYRO_YAW [1/s] and SPEED [m/s] have different units" in said
    )
    assert "did you mean 'SPEED'" in said
