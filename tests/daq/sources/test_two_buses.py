"""Logs of two buses that send the same identifiers with different meanings: names and values are those of one bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from asammdf.blocks import v4_constants as v4
from asammdf.blocks.source_utils import Source as MdfOrigin

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.sources import frames as frame_readers
from lacet.daq.sources.bus_log import read_bus_log
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Reading, Source, read_all

MOTION = """VERSION ""
BU_: ESP
BO_ 256 DYN: 2 ESP
 SG_ YawRate : 0|16@1- (0.01,0) [0|0] "deg/s" X
BO_ 768 LONG: 12 ESP
 SG_ SteerAngle : 64|16@1- (0.1,0) [0|0] "deg" X
"""
SATELLITES = """VERSION ""
BU_: GPS
BO_ 256 GPS_VEL: 2 GPS
 SG_ GpsSpeed : 0|16@1+ (0.01,0) [0|0] "km/h" X
"""
COUNT = 300
YAW = np.arange(COUNT) - 100
SPEED = 7000 + np.arange(COUNT)
STEER = 5 * np.arange(COUNT) - 900
Frame = tuple[float, int, int, bytes]
"""Time [s], bus, identifier and data."""
GROUPS: dict[str, Callable[[int, int, int], tuple[int, ...]]] = {
    "one group": lambda k, bus, ident: (0,),
    "a group for each bus": lambda k, bus, ident: (bus,),
    "bus 2 before bus 1": lambda k, bus, ident: (-bus,),
    "several groups for each bus": lambda k, bus, ident: (bus, ident, k % 2),
}
"""Layout → what the frames of a group have in common, of the frame's number, bus and identifier."""


def drive() -> list[Frame]:
    """Yaw rates and steering angles on bus 1, speeds by the identifier of the yaw rates on bus 2."""
    out: list[Frame] = []
    for k in range(COUNT):
        out.append((0.010 * k + 0.001, 1, 0x100, int(YAW[k]).to_bytes(2, "little", signed=True)))
        out.append((0.010 * k + 0.004, 2, 0x100, int(SPEED[k]).to_bytes(2, "little")))
        out.append(
            (0.010 * k + 0.007, 1, 0x300, bytes(8) + int(STEER[k]).to_bytes(2, "little", signed=True) + bytes(2))
        )
    return out


def write_mf4(path: Path, groups: list[list[Frame]]) -> None:
    """An ASAM MDF bus log with these groups, by asammdf."""
    mdf = MDF(version="4.10")
    for frames in groups:
        longest = max(len(data) for *_, data in frames)
        kind = np.dtype([
            ("CAN_DataFrame.BusChannel", "u1"), ("CAN_DataFrame.ID", "<u4"), ("CAN_DataFrame.IDE", "u1"),
            ("CAN_DataFrame.DataLength", "u1"), ("CAN_DataFrame.DataBytes", f"({longest},)u1"),
        ])  # fmt: skip
        rows = [(bus, ident, 0, len(data), list(data.ljust(longest, b"\0"))) for _, bus, ident, data in frames]
        name = f"CAN{frames[0][1]}"
        origin = MdfOrigin(name, name, "", v4.SOURCE_BUS, v4.BUS_TYPE_CAN)
        times = np.array([t for t, *_ in frames])
        mdf.append([MdfSignal(np.array(rows, kind), times, name="CAN_DataFrame", source=origin)], acq_source=origin)
        mdf.groups[-1].channel_group.flags |= v4.FLAG_CG_BUS_EVENT | v4.FLAG_CG_PLAIN_BUS_EVENT
    mdf.save(path, overwrite=True)
    mdf.close()


def in_layout(folder: Path, layout: str) -> Path:
    """The drive's frames in a layout of groups."""
    groups: dict[tuple[int, ...], list[Frame]] = {}
    for k, frame in enumerate(drive()):
        groups.setdefault(GROUPS[layout](k // 3, frame[1], frame[2]), []).append(frame)
    write_mf4(folder / "drive.mf4", [groups[key] for key in sorted(groups)])
    return folder / "drive.mf4"


def described(folder: Path) -> tuple[Path, Path]:
    """The files that describe both buses."""
    (folder / "motion.dbc").write_text(MOTION, encoding="utf-8")
    (folder / "satellites.dbc").write_text(SATELLITES, encoding="utf-8")
    return folder / "motion.dbc", folder / "satellites.dbc"


def opened(folder: Path, log: Path) -> Source:
    return open_source(log, Reading(dbc=described(folder)))


@pytest.mark.parametrize("at_a_time", [7, 1 << 17])
@pytest.mark.parametrize("layout", list(GROUPS))
def test_frames_of_two_buses_are_told_apart_in_any_layout_of_groups(
    layout: str, at_a_time: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_readers, "FRAMES", at_a_time)
    source = opened(tmp_path, in_layout(tmp_path, layout))
    both = {f"{bus}.{name}" for bus in (1, 2) for name in ("DYN.YawRate", "GPS_VEL.GpsSpeed")}
    assert set(source.listed) == both | {"LONG.SteerAngle"}
    with pytest.raises(KeyError, match=r"'YawRate' could be 1\.DYN\.YawRate, 2\.DYN\.YawRate"):
        source.resolve("YawRate")
    found = read_all(source, list(source.listed))
    written = {
        "1.DYN.YawRate": (0.001, 0.01 * YAW), "2.GPS_VEL.GpsSpeed": (0.004, 0.01 * SPEED),
        "LONG.SteerAngle": (0.007, 0.1 * STEER),
    }  # fmt: skip
    for name, (first, values) in written.items():
        np.testing.assert_allclose(found[name].t, 0.010 * np.arange(COUNT) + first, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(found[name].values, values, atol=1e-9, err_msg=name)
    source.close()


def test_series_of_all_groups_go_on_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a name of one group is never read to its end before the others begin."""
    monkeypatch.setattr(frame_readers, "FRAMES", 20)
    source = opened(tmp_path, in_layout(tmp_path, "several groups for each bus"))
    ends = 0.0
    for piece in source.pieces(list(source.listed)):
        assert all(one.t[0] >= ends for one in piece.values())
        ends = max(one.t[-1] for one in piece.values())
    assert ends == pytest.approx(0.010 * COUNT - 0.003)
    source.close()


@pytest.mark.parametrize("layout", list(GROUPS))
def test_a_run_has_the_channels_of_the_buses_that_its_map_names(layout: str, tmp_path: Path) -> None:
    """A name that may be of either bus is refused with those to be written."""
    log = in_layout(tmp_path, layout)
    described(tmp_path)
    text = 'format = "lacet-map 1"\n[read]\ndbc = ["motion.dbc", "satellites.dbc"]\n[channels]\n'
    named = '"car.yaw_rate" = "`1.DYN.YawRate`"\n"gnss.speed" = "`2.GPS_VEL.GpsSpeed`"\n"steering.angle" = "SteerAngle"'
    run = open_run(log, ChannelMap.parse(text + named, "map", tmp_path))
    np.testing.assert_allclose(run.signals["car.yaw_rate"].values[:, 0], np.deg2rad(0.01 * YAW), atol=1e-12)
    np.testing.assert_allclose(run.signals["gnss.speed"].values[:, 0], 0.01 * SPEED / 3.6, atol=1e-9)
    np.testing.assert_allclose(run.signals["steering.angle"].values[:, 0], np.deg2rad(0.1 * STEER), atol=1e-12)
    assert not any("does not increase" in problem for problem in run.problems)
    with pytest.raises(RunError, match=r"'GpsSpeed' could be `1\.GPS_VEL\.GpsSpeed`, `2\.GPS_VEL\.GpsSpeed`"):
        open_run(log, ChannelMap.parse(text + '"gnss.speed" = "GpsSpeed"', "map", tmp_path))


@pytest.mark.parametrize("at_a_time", [50, 1 << 17])
def test_a_clock_put_back_in_groups_changes_no_order(
    at_a_time: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_readers, "FRAMES", at_a_time)
    put_back = [(t - 1.0 * (t > 1.5), *rest) for t, *rest in drive()]
    write_mf4(tmp_path / "drive.mf4", [[frame for frame in put_back if frame[1] == bus] for bus in (1, 2)])
    source = opened(tmp_path, tmp_path / "drive.mf4")
    found = read_all(source, ["1.DYN.YawRate", "2.GPS_VEL.GpsSpeed"])
    for values, expected in zip(found.values(), (0.01 * YAW, 0.01 * SPEED), strict=True):
        np.testing.assert_allclose(values.values, expected, atol=1e-9)
        np.testing.assert_allclose(np.diff(values.t), 0.010, atol=1e-6)
    assert sum("its clock is put back by 1.000 s after 1.5" in note for note in source.notes) == 1
    source.close()


def test_frames_of_all_groups_are_replayed_by_bus(tmp_path: Path) -> None:
    buses = read_bus_log(in_layout(tmp_path, "several groups for each bus"))
    expected = {"1": drive_of(1), "2": drive_of(2)}
    assert {name: list(np.diff(frames.offset)) for name, frames in buses.items()} == {
        name: [len(data) for *_, data in frames] for name, frames in expected.items()
    }
    for name, frames in expected.items():
        assert buses[name].data.tobytes() == b"".join(data for *_, data in frames)


def drive_of(bus: int) -> list[Frame]:
    """The drive's frames of one bus."""
    return [frame for frame in drive() if frame[1] == bus]


@pytest.mark.parametrize("kind", ["candump", "mf4"])
def test_a_bus_that_begins_late_is_not_mixed_with_the_first(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names are told by the first frames: what comes on another bus later is left out, and said."""
    monkeypatch.setattr(frame_readers, "FRAMES", 50)
    frames = [frame for frame in drive() if frame[1] == 1 or frame[0] > 2.0]
    log = tmp_path / ("drive.log" if kind == "candump" else "drive.mf4")
    if kind == "mf4":
        write_mf4(log, [[frame for frame in frames if frame[1] == bus] for bus in (1, 2)])
    else:
        log.write_text("".join(f"({t:.6f}) {bus} {ident:03X}#{data.hex()}\n" for t, bus, ident, data in frames))
    source = opened(tmp_path, log)
    found = read_all(source, ["DYN.YawRate"])["DYN.YawRate"]
    np.testing.assert_allclose(found.values, 0.01 * YAW, atol=1e-9)
    (note,) = [one for one in source.notes if "left out" in one]
    assert "DYN" in note
    assert "bus 2" in note
    source.close()


@pytest.mark.parametrize("bus", [1, 2])
def test_a_map_of_two_buses_fits_a_log_of_the_one_that_it_names(bus: int, tmp_path: Path) -> None:
    """A message on one bus has its name alone, which may be written with that bus before it, with no other."""
    described(tmp_path)
    log = tmp_path / "drive.log"
    log.write_text("".join(f"({t:.6f}) {b} {ident:03X}#{d.hex()}\n" for t, b, ident, d in drive_of(bus)))
    text = 'format = "lacet-map 1"\n[read]\ndbc = ["motion.dbc"]\n[channels]\n"car.yaw_rate" = "`1.DYN.YawRate`"'
    channel_map = ChannelMap.parse(text, "map", tmp_path)
    if bus == 1:
        values = open_run(log, channel_map).signals["car.yaw_rate"].values[:, 0]
        np.testing.assert_allclose(values, np.deg2rad(0.01 * YAW), atol=1e-12)
    else:
        with pytest.raises(RunError, match=r"there is no '1\.DYN\.YawRate'"):
            open_run(log, channel_map)


def test_of_a_message_in_one_of_two_logs_the_name_need_not_say_which(tmp_path: Path) -> None:
    """With one DBC for both, also where another file stands first; in full it can be written, too."""
    described(tmp_path)
    for name, ident in (("turn", 0x100), ("wheel", 0x300)):
        frames = [frame for frame in drive_of(1) if frame[2] == ident]
        (tmp_path / f"{name}.log").write_text("".join(f"({t:.6f}) 1 {i:03X}#{d.hex()}\n" for t, _, i, d in frames))
    text = 'format = "lacet-map 1"\n[read]\ndbc = ["motion.dbc"]\n[channels]\n"car.yaw_rate" = "YawRate"\n'
    logs = [tmp_path / "wheel.log", tmp_path / "turn.log"]
    run = mapped_run(logs, ChannelMap.parse(text + '"steering.angle" = "wheel.LONG.SteerAngle"', "map", tmp_path))
    np.testing.assert_allclose(run.signals["car.yaw_rate"].values[:, 0], np.deg2rad(0.01 * YAW), atol=1e-12)
    np.testing.assert_allclose(run.signals["steering.angle"].values[:, 0], np.deg2rad(0.1 * STEER), atol=1e-12)
    with pytest.raises(RunError, match=r"no sample of wheel\.DYN\.YawRate is in the log"):
        mapped_run(logs, ChannelMap.parse(text.replace('"YawRate"', '"wheel.DYN.YawRate"'), "map", tmp_path))


def test_a_signal_of_another_message_is_not_taken_for_the_one_named(tmp_path: Path) -> None:
    source = opened(tmp_path, in_layout(tmp_path, "one group"))
    assert source.resolve("long.steerangle") == source.resolve("SteerAngle") == "LONG.SteerAngle"
    with pytest.raises(KeyError, match=r"there is no 'DYN\.SteerAngle'"):
        source.resolve("DYN.SteerAngle")
    source.close()


def test_a_message_that_two_files_describe_in_two_ways_is_named_with_its_file(tmp_path: Path) -> None:
    """What they describe alike is one message; neither file's values take the place of the other's."""
    both = described(tmp_path)
    (tmp_path / "other.dbc").write_text(MOTION.replace("256 DYN", "512 DYN").replace("(0.01,0)", "(0.5,0)"))
    log = tmp_path / "drive.log"
    ids = {1: 0x100, 2: 0x200}  # the second bus' frames have the identifier that the other file gives
    log.write_text("".join(f"({t:.6f}) 1 {ids[b]:03X}#{d.hex()}\n" for t, b, i, d in drive() if i == 0x100))
    source = open_source(log, Reading(dbc=(*both, tmp_path / "other.dbc")))
    assert set(source.listed) == {
        "motion.DYN.YawRate", "other.DYN.YawRate", "LONG.SteerAngle", "GPS_VEL.GpsSpeed"
    }  # fmt: skip
    found = read_all(source, list(source.listed))
    np.testing.assert_allclose(found["motion.DYN.YawRate"].values, 0.01 * YAW, atol=1e-9)
    np.testing.assert_allclose(found["other.DYN.YawRate"].values, 0.5 * SPEED, atol=1e-9)
    source.close()
