"""Bus logs with lines that are no frames, error frames, stamps of other kinds, or without a message of the map."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.run import Run
from lacet.daq.sources import frames as frame_readers
from lacet.daq.sources.bus_log import is_raw_log, read_bus_log
from lacet.daq.sources.frames import Beside
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Reading

DBC = """VERSION ""
BU_: ECU
BO_ 256 DYN: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "m/s" X
BO_ 512 STEER: 8 ECU
 SG_ Angle : 0|16@1- (0.1,0) [0|0] "deg" X
"""
COUNT = 400
SPEEDS = 0.01 * (1000 + np.arange(COUNT))
MAP = """format = "lacet-map 1"
[read]
dbc = ["car.dbc"]
[channels]
"car.speed" = "Speed"
"steering.angle" = "Angle"
"""


def drive() -> list[str]:
    """Lines of both messages, one after the other, every 10 ms each."""
    out: list[str] = []
    for k in range(COUNT):
        out.append(f"({1.7e9 + 0.01 * k:.6f}) can0 100#{(1000 + k).to_bytes(2, 'little').hex()}000000000000")
        out.append(f"({1.7e9 + 0.01 * k + 0.003:.6f}) can0 200#{k.to_bytes(2, 'little').hex()}000000000000 R")
    return out


def imported(folder: Path, lines: list[str], dbc: str = DBC) -> Run:
    (folder / "car.dbc").write_text(dbc, encoding="utf-8")
    (folder / "drive.log").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return open_run(folder / "drive.log", ChannelMap.parse(MAP, "map", folder))


def test_lines_that_are_no_frames_are_left_out_with_number_and_text(tmp_path: Path) -> None:
    lines = drive()
    lines.insert(21, "nonsense")
    lines.insert(41, "(1700000000.2) can0 100#GG")
    lines.insert(61, "(1700000000.3) can0 100#123")
    lines.insert(81, "")
    run = imported(tmp_path, lines)
    np.testing.assert_allclose(run.signals["car.speed"].values[:, 0], SPEEDS, atol=1e-9)
    (said,) = [one for one in run.problems if "no frame" in one]
    assert said == "drive.log: 3 lines are no frames and are left out, the first: line 22, 'nonsense'"
    damage: list[str] = []
    frames = read_bus_log(tmp_path / "drive.log", damage)
    assert len(frames["can0"]) == 2 * COUNT
    assert said in damage


def test_a_line_that_is_cut_off_is_told_once(tmp_path: Path) -> None:
    """Wherever it is cut: in its data, or before there are any."""
    whole = "\n".join(drive())
    for cut in (3, 20, 30):
        (tmp_path / "drive.log").write_text(whole[: whole.rindex("\n") + 1 + cut], encoding="utf-8")
        damage: list[str] = []
        assert len(read_bus_log(tmp_path / "drive.log", damage)["can0"]) == 2 * COUNT - 1
        assert damage == ["drive.log: its last line is not whole (cut short?), and its frame is left out"]


def test_a_multiplexed_signal_that_was_never_sent_is_named(tmp_path: Path) -> None:
    """Frames of its message come, with other values of the multiplexer."""
    run = imported(
        tmp_path, drive(), DBC.replace(" SG_ Angle :", ' SG_ Which M : 16|8@1+ (1,0) [0|0] "" X\n SG_ Angle m7 :')
    )
    assert list(run.signals) == ["car.speed"]
    assert run.problems == ("steering.angle was left out: no sample of STEER.Angle is in the log",)


def test_error_frames_are_no_message(tmp_path: Path) -> None:
    """Of any class: here of a lost arbitration, and of a bus error."""
    lines = drive()
    for k, ident in enumerate(("20000002", "20000088", "20000004")):
        lines.insert(11 + 20 * k, f"({1.7e9 + 0.05:.6f}) can0 {ident}#0000000000000000")
    run = imported(tmp_path, lines)
    assert run.problems == ()
    assert len(run.signals["car.speed"].t) == COUNT


@pytest.mark.parametrize("at_a_time", [11, 1 << 17])
@pytest.mark.parametrize("back", [0.25, 1.5, 2.5, 3600.0])
def test_a_log_whose_clock_was_put_back_keeps_its_order_and_its_frames(
    back: float, at_a_time: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stamps go on with the usual interval, to the microsecond; the step is said with when and by how much."""
    monkeypatch.setattr(frame_readers, "FRAMES", at_a_time)
    lines = [later(line, -back if k >= 600 else 0.0) for k, line in enumerate(drive())]
    run = imported(tmp_path, lines)
    (said,) = run.problems
    assert f"its clock is put back by {back:.3f} s after 3.00 s" in said
    np.testing.assert_allclose(run.signals["car.speed"].t, 0.01 * np.arange(COUNT), atol=2e-6)
    np.testing.assert_allclose(run.signals["car.speed"].values[:, 0], SPEEDS, atol=1e-9)
    damage: list[str] = []
    frames = read_bus_log(tmp_path / "drive.log", damage)["can0"]
    assert damage == [said]
    assert (np.diff(frames.t_ns) > 0).all()
    assert frames.data[::8].tolist() == [int(line.split("#")[1][:2], 16) for line in lines]


def test_clocks_are_put_back_more_than_once_and_on_each_bus_by_itself(tmp_path: Path) -> None:
    """Of a logger that writes the frames of a bus late, so that the step comes later in the file."""
    lines = [later(line, -9.0 * (k >= 300) - 0.5 * (k >= 500)) for k, line in enumerate(drive())]
    other = [line.replace("can0", "can1") for line in lines]
    mixed = [*lines[:400], *other[:350], *lines[400:], *other[350:]]
    (tmp_path / "drive.log").write_text("\n".join(mixed) + "\n", encoding="utf-8")
    damage: list[str] = []
    beside = Beside()
    buses = read_bus_log(tmp_path / "drive.log", damage, beside)
    for frames in buses.values():
        expected = 0.01 * (np.arange(2 * COUNT) // 2) + 0.003 * (np.arange(2 * COUNT) % 2)
        np.testing.assert_allclose((frames.t_ns - frames.t_ns[0]) / 1e9, expected, atol=3e-6)
    assert damage == [
        f"drive.log: bus {bus}: its clock is put back by 9.000 s after 1.50 s, by 0.500 s after 2.50 s; the stamps go "
        "on as if it had not been"
        for bus in ("can0", "can1")
    ]
    assert [(one.bus, round(beside.zero_ns / 1e9 + one.t - 1.7e9, 3), round(one.size, 3)) for one in beside.steps] == [
        (bus, t, size) for bus in ("can0", "can1") for t, size in ((1.5, 9.0), (2.5, 0.5))
    ]


@pytest.mark.parametrize(
    "out_of_order",
    [
        lambda lines: [later(line, -0.5 if k % 100 == 0 else 0.0) for k, line in enumerate(lines)],
        lambda lines: [line for k in range(0, len(lines), 100) for line in sorted(lines[k : k + 100], key=by_ident)],
        lambda lines: [later(line, 5.0 if k == 300 else 0.0) for k, line in enumerate(lines)],
        lambda lines: [one for k in range(0, len(lines), 4) for one in (*lines[k + 3 : k : -1], lines[k])],
        lambda lines: [*lines[:300], *lines[350:500], *lines[300:350], *lines[500:]],
    ],
    ids=["late", "by message", "one early", "turned", "many late"],
)
def test_frames_out_of_order_are_no_clock_put_back(out_of_order: Callable, tmp_path: Path) -> None:
    (tmp_path / "drive.log").write_text("\n".join(out_of_order(drive())) + "\n", encoding="utf-8")
    damage: list[str] = []
    assert len(read_bus_log(tmp_path / "drive.log", damage)["can0"]) == 2 * COUNT
    assert damage == []


def test_a_clock_that_is_put_forward_for_a_while_loses_no_frame(tmp_path: Path) -> None:
    """A gap, and from there on stamps that go on: the frames between are fewer than those that would be late."""
    run = imported(tmp_path, [later(line, 1.0 if 300 <= k < 340 else 0.0) for k, line in enumerate(drive())])
    np.testing.assert_allclose(run.signals["car.speed"].values[:, 0], SPEEDS, atol=1e-9)
    assert any("its clock is put back by 1.000 s after 2.70 s" in problem for problem in run.problems)


def by_ident(line: str) -> str:
    """Its identifier, so that the lines of a message stand together."""
    return line.split()[2][:3]


def later(line: str, seconds: float) -> str:
    """The line with another stamp."""
    stamp, _, rest = line.partition(") ")
    return f"({float(stamp[1:]) + seconds:.6f}) {rest}"


def test_signals_of_a_dbc_that_share_bits_are_said(tmp_path: Path) -> None:
    """Where the map uses one of them."""
    other = ' SG_ Other : 8|16@1+ (1,0) [0|0] "" X\n'
    run = imported(tmp_path, drive(), DBC.replace("BO_ 512", other + "BO_ 512"))
    assert run.problems == (
        "signals Speed and Other of message DYN share bits in its DBC: the values of one are wrong",
    )


def test_a_channel_whose_message_never_came_is_named(tmp_path: Path) -> None:
    """Its message is in the DBC, so that its name is known."""
    run = imported(tmp_path, [line for line in drive() if " 200#" not in line])
    assert list(run.signals) == ["car.speed"]
    assert run.problems == ("steering.angle was left out: no sample of STEER.Angle is in the log",)


@pytest.mark.parametrize("base", ["hex", "dec"])
def test_stamps_of_an_asc_log_may_be_from_the_line_before(base: str, tmp_path: Path) -> None:
    """As its header says; lines of other events count, too."""
    ids = {"hex": ("100", "200"), "dec": ("256", "512")}[base]
    lines = ["date Sat Jul 25 05:20:00.000 pm 2026", f"base {base}  timestamps relative", "internal events logged",
             "   0.000000 Start of measurement"]  # fmt: skip
    for k in range(COUNT):
        payload = " ".join(f"{byte:02X}" if base == "hex" else str(byte) for byte in (1000 + k).to_bytes(2, "little"))
        lines.append(f"   {0.007 if k else 0.5:.6f} 1  {ids[0]}             Rx   d 2 {payload}")
        lines.append(f"   0.001000 1  Statistic: D {k} R 0 XD 0 XR 0 E 0 O 0 B 0.00%")
        lines.append(f"   0.002000 1  {ids[1]}             Rx   d 2 00 00")
    (tmp_path / "car.dbc").write_text(DBC, encoding="utf-8")
    (tmp_path / "drive.asc").write_text("\n".join(lines) + "\nEnd TriggerBlock\n", encoding="utf-8")
    run = open_run(tmp_path / "drive.asc", ChannelMap.parse(MAP, "map", tmp_path))
    speed = run.signals["car.speed"]
    np.testing.assert_allclose(np.diff(speed.t), 0.010, atol=1e-7)
    np.testing.assert_allclose(speed.values[:, 0], SPEEDS, atol=1e-9)
    assert run.problems == ()


def test_identifiers_that_the_dbc_lacks_are_named_with_their_length_where_the_number_does_not_show_it(
    tmp_path: Path,
) -> None:
    lines = [line.replace(" 100#", " 00000100#") for line in drive()]
    run = imported(tmp_path, lines)
    assert "1 identifier is not in the DBC: 0x100 (29 bits)" in run.problems
    lines = [line.replace(" 200#", " 18FEF200#") for line in lines]
    with pytest.raises(RunError, match=r"it has 0x100 \(29 bits\), 0x18fef200$"):
        imported(tmp_path, lines)


def asc(folder: Path, header: str, first: float = 0.0, name: str = "drive.asc", decimal: bool = False) -> Path:
    """An ASC log of the drive with this header, its first frame stamped so [s]."""
    ids, form = (("256", "512"), "03d") if decimal else (("100", "200"), "02X")
    lines = header.splitlines()
    for k in range(COUNT):
        low, high = (1000 + k).to_bytes(2, "little")
        lines.append(f"   {first + 0.01 * k:.6f} 1  {ids[0]}             Rx   d 2 {low:{form}} {high:{form}}")
        lines.append(f"   {first + 0.01 * k + 0.003:.6f} 1  {ids[1]}             Tx   d 2 00 00  Length = 244 ID = 9")
    (folder / "car.dbc").write_text(DBC, encoding="utf-8")
    (folder / name).write_text("\n".join(lines) + "\nEnd TriggerBlock\n", encoding="utf-8")
    return folder / name


HEADER = "date Sun Jun 15 03:06:44.001 pm 2025\nbase hex  timestamps absolute\ninternal events logged\n"


@pytest.mark.parametrize("kind", ["hex", "dec"])
def test_lines_of_an_asc_log_that_are_no_frames_are_left_out_with_number_and_text(kind: str, tmp_path: Path) -> None:
    """Events of other kinds are known, and no damage."""
    log = asc(tmp_path, HEADER.replace("hex", kind), decimal=kind == "dec")
    lines = log.read_text().splitlines()
    whole = len(read_bus_log(log)["0"])
    for at, line in {
        20: "   0.07 1  garbage", 30: "nonsense", 40: "   0.12 1  100  Rx   d 2 00",
        50: "   0.17 1  100  Rx   d 2 0G 00",
        60: "   0.21 1  Statistic: D 3 R 0 XD 0 XR 0 E 0 O 0 B 0.00%", 70: "   0.25 1  ErrorFrame", 80: "",
        90: "   0.3 CAN 1 Status:chip status error active", 100: "// a remark", 110: "   0.4 CANFD 1 Rx 99 1 0 2 2 00",
        120: "   0.45 1  123             Rx   r", 130: "   0.5 SV: 2 0 1 ::Door = 1",
    }.items():  # fmt: skip
        lines.insert(at, line)
    log.write_text("\n".join(lines) + "\n")
    damage: list[str] = []
    assert len(read_bus_log(log, damage)["0"]) == whole
    assert damage == [
        "drive.asc: 5 lines are no frames and are left out, the first: line 21, '0.07 1  garbage'"
    ]  # fmt: skip
    assert len(open_run(log, ChannelMap.parse(MAP, "map", tmp_path)).signals["car.speed"].t) == COUNT


BEGAN = 1_750_000_004_001_000_000
"""The date of `HEADER`, 2025-06-15 15:06:44.001 UTC [ns]."""


@pytest.mark.parametrize(
    ("header", "first", "start_ns"),
    [
        (HEADER, 0.0, BEGAN),
        (HEADER, 7.5, BEGAN + 7_500_000_000),
        (HEADER + "Begin Triggerblock Sun Jun 15 03:06:44.000 pm 2025", 0.0, BEGAN),
        (HEADER + "Begin Triggerblock Sun Jun 15 03:06:51.000 pm 2025", 7.5, BEGAN + 7_500_000_000),
        (HEADER.replace("03:06:44.001 pm", "15:06:44.001"), 0.0, BEGAN),
        (HEADER.replace("Sun Jun", "Son Jun").replace("03:06:44.001 pm", "15:06:44.001"), 0.0, BEGAN),
        (HEADER.replace("2025", "2026") + "Begin Triggerblock Sun Jun 15 15:06:44.1 2025", 0.0, BEGAN),  # python-can
        (HEADER.replace("Jun 15", "Junk 99"), 2.0, 2_000_000_000),
    ],
)
def test_an_asc_log_begins_at_the_date_of_its_header(header: str, first: float, start_ns: int, tmp_path: Path) -> None:
    log = asc(tmp_path, header, first)
    (frames,) = read_bus_log(log).values()
    assert frames.t_ns[0] == start_ns
    np.testing.assert_allclose(np.diff(frames.t_ns[::2]), 1e7, atol=2)
    source = open_source(log, Reading(dbc=(tmp_path / "car.dbc",)))
    assert source.start_ns == (start_ns if start_ns > 1e18 else None)


def test_asc_logs_of_one_drive_are_on_one_clock_by_their_headers(tmp_path: Path) -> None:
    """A file with a time zone hours away is said."""
    first, second = asc(tmp_path, HEADER), asc(tmp_path, HEADER.replace("44.001", "48.002"), name="second.asc")
    text = MAP.replace('"Speed"', '"drive.DYN.Speed"').replace('"Angle"', '"second.STEER.Angle"')
    run = mapped_run([first, second], ChannelMap.parse(text, "map", tmp_path))
    assert run.problems == ()
    assert run.signals["steering.angle"].t[0] - run.signals["car.speed"].t[0] == pytest.approx(4.004)
    (tmp_path / "second.log").write_text("\n".join(later(line, 7200.0 + 5e7) for line in drive()))
    run = mapped_run([first, tmp_path / "second.log"], ChannelMap.parse(text, "map", tmp_path))
    assert any("drive.asc begins -2.00 h from the other files" in problem for problem in run.problems)


@pytest.mark.parametrize("at", [0.1, 0.5, 0.97])
@pytest.mark.parametrize("damage", ["a byte", "the head of a container", "zeros"])
def test_what_is_whole_before_and_behind_a_damaged_container_of_a_blf_log_is_read(
    damage: str, at: float, tmp_path: Path
) -> None:
    """No frame is made of the halves of two; where bytes are missing is said."""
    sent = []
    with can.BLFWriter(tmp_path / "drive.blf", max_container_size=2000) as writer:  # objects go over their ends
        for k in range(2000):
            sent.append(hashlib.sha256(k.to_bytes(2, "little")).digest()[: 1 + k % 8])
            writer.on_message_received(can.Message(timestamp=1.7e9 + 0.01 * k, arbitration_id=k % 9, data=sent[-1]))
    content = bytearray((tmp_path / "drive.blf").read_bytes())
    place = int(at * len(content))
    if damage == "a byte":
        content[place] ^= 0x55
    elif damage == "zeros":
        content[place : place + 700] = bytes(len(content[place : place + 700]))
    else:
        head = content.rfind(b"LOBJ", 0, place)
        content[head : head + 12] = b"\xff" * 12
    (tmp_path / "drive.blf").write_bytes(content)
    lost: list[str] = []
    (frames,) = read_bus_log(tmp_path / "drive.blf", lost).values()
    assert 1700 < len(frames) < 2000
    numbers = np.rint((frames.t_ns - 17 * 10**17) / 1e7).astype(int)
    assert [frame.payload for frame in frames] == [sent[k] for k in numbers]
    steps = np.diff(np.concatenate(([-1], numbers, [2000])))
    assert np.count_nonzero(steps > 1) == 1
    (said,) = lost
    begin = 0.01 * (int(np.argmax(steps > 1)) - 1)
    assert re.fullmatch(
        rf"drive.blf: bytes [\d,]+ to [\d,]+ of {len(content):,} cannot be read, after {max(0.0, begin):.2f} s: "
        "the frames in them are missing", said,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (" (1750000000.000000)  can0  100   [8]  00 00 14 74 CC 00 00 00", r"candump prints on a screen; .*candump -L"),
        (" (2025-06-15 15:06:40.000000)  can0  RX - -  0CF00400   [3]  0a ff 20", r"screen; .*candump -L"),
        ("  vcan1  100  [12]  00 00 14 74 CC 00 00 00 00 00 00 00", r"without stamps, which cannot be had.*candump -L"),
        (
            "timestamp,arbitration_id,extended,remote,error,dlc,data",
            r"CSV of frames by python-can; .*can.logconvert a.log",
        ),
    ],
)
def test_frames_in_a_form_that_is_not_read_are_refused_with_the_remedy(tmp_path: Path, line: str, says: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(f"{line}\n{line}\n", encoding="utf-8")
    assert is_raw_log(path)
    with pytest.raises(RunError, match=says):
        read_bus_log(path)
    with pytest.raises(RunError, match=says):
        open_source(path, Reading())


def test_a_table_whose_header_looks_like_hexadecimal_is_none_of_these_forms(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("time acc [1] bed\n0.0 1 2 3\n0.1 1 2 3\n", encoding="utf-8")
    assert not is_raw_log(path)


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ([], r'is missing; say it in the map, \[read\] dbc = \["my-car.dbc"\]'),
        (["a.dbc"], r'beside it is a.dbc; say it in the map, \[read\] dbc = \["a.dbc"\], or on a command line'),
        (["b.dbc", "a.dbc"], r"beside it are a.dbc, b.dbc; say it"),
    ],
)
def test_a_bus_log_without_its_dbc_names_those_beside_it(tmp_path: Path, files: list[str], says: str) -> None:
    (tmp_path / "drive.log").write_text("\n".join(drive()[:4]) + "\n", encoding="utf-8")
    for name in files:
        (tmp_path / name).write_text(DBC, encoding="utf-8")
    with pytest.raises(RunError, match=says):
        open_source(tmp_path / "drive.log", Reading())
