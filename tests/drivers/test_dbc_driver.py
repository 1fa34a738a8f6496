"""The driver of any bus by its owner's DBC: the channels of an import, however frames are cut, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crccheck.crc import Crc8Autosar, Crc8SaeJ1850, Crc16CcittFalse
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.blocks import UNUSABLE, Flag
from lacet.daq.errors import RigError, UsageError
from lacet.daq.frames import EXTENDED, Frames
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.rig import Rig
from lacet.daq.sources.bus_log import read_bus_log
from lacet.drivers import open_driver
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from tests.drivers.driver_cases import decode_all, decode_split, same_blocks, spoil
from tests.support.places import HOME

CAN = HOME / "tests/data/can"
ROAD = {
    "car.yaw_rate": "GYRO_YAW",
    "steering.angle": "-STEER_ANGLE",
    "correvit.speed.x": "SPEED",  # components of two messages, 100 and 50 a second
    "correvit.speed.y": "0.1 s * ACCEL_LAT",
    "wheel.fl.speed": "WS_FL / 0.31 m",
    "engine.speed": {"from": "RPM", "delay": "30 ms"},
}
CANEDGE = {
    "imu.accel.x": "AccelerationX", "imu.accel.y": "AccelerationY", "imu.accel.z": "AccelerationZ",
    "gnss.speed": "Speed", "gnss.latitude": "Latitude", "car.speed": "gnss_speed.Speed * cos(gnss_attitude.Heading)",
}  # fmt: skip
LOGS = [
    ("road-car.candump.log", "road-car.dbc", "can0", ROAD),
    ("canedge-gps-imu.mf4", "canmod-gps.dbc", "2", CANEDGE),
]
MS = 1_000_000

DBC = """\
VERSION ""
BO_ 256 Esp: 8 X
 SG_ Lat : 0|16@1- (0.01,0) [0|0] "m/s^2" X
 SG_ Yaw : 16|16@1- (0.01,0) [0|0] "deg/s" X
 SG_ LatState : 32|2@1+ (1,0) [0|3] "" X
 SG_ Alive : 36|4@1+ (1,0) [0|15] "" X
 SG_ Crc : 56|8@1+ (1,0) [0|255] "" X
BO_ 257 Slow: 4 X
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "km/h" X
BO_ 258 Muxed: 8 X
 SG_ Which M : 0|8@1+ (1,0) [0|255] "" X
 SG_ Fl m0 : 8|16@1+ (0.1,0) [0|0] "rpm" X
 SG_ Fr m1 : 8|16@1+ (0.1,0) [0|0] "rpm" X
BO_ 259 Wide: 48 X
 SG_ Force : 320|32@1- (1,0) [0|0] "N" X
BO_ 2364540158 Eec1: 8 X
 SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" X
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG","StandardCAN_FD";
BA_DEF_ SG_ "SystemSignalLongSymbol" STRING;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2364540158 3;
BA_ "VFrameFormat" BO_ 259 4;
SIG_VALTYPE_ 259 Force : 1;
VAL_ 257 Speed 65535 "SNA" ;
"""


def driver(signals: dict[str, object], **options: object):
    return open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": signals, **options}, None, {"my.dbc": DBC})


def frames(*rows: tuple[int, int, bytes]) -> Frames:
    """Frames of (time [ms], identifier, payload)."""
    return Frames.from_iter("can0", [("can0", 10**18 + t * MS, ident, payload) for t, ident, payload in rows])


def esp(lat: float, yaw: float = 0.0, state: int = 0, alive: int = 0) -> bytes:
    raw = round(lat / 0.01).to_bytes(2, "little", signed=True) + round(yaw / 0.01).to_bytes(2, "little", signed=True)
    return raw + bytes([state | alive << 4, 0, 0, 0])


def case(log: str, dbc: str, bus: str, signals: dict):
    """The frames of a log, the driver for them, and the run of the same signals by a map."""
    batch = read_bus_log(CAN / log)[bus]
    lines = "".join(
        f'"{column}" = "{entry}"\n'
        if isinstance(entry, str)
        else f'"{column}" = {{ from = "{entry["from"]}", delay = "{entry["delay"]}" }}\n'
        for column, entry in signals.items()
    )
    map_ = ChannelMap.parse(f'format = "lacet-map 1"\n[read]\ndbc = "{CAN / dbc}"\n[channels]\n{lines}')
    own = open_driver("dbc", "can0", {"dbc": dbc, "signals": signals}, CAN)
    return replace(batch, source="can0"), own, mapped_run([CAN / log], map_)


@pytest.mark.parametrize(("log", "dbc", "bus", "signals"), LOGS, ids=["road", "canedge"])
def test_the_channels_are_those_of_an_import_by_a_map_of_the_same_signals(log, dbc, bus, signals):
    batch, own, run = case(log, dbc, bus, signals)
    got, counts = decode_split(own, batch, range(0, len(batch), 17))
    assert set(got) == set(run.signals) == set(own.channels)
    start = min(int(block.t_ns[0]) for block in got.values())
    for name, signal in run.signals.items():
        block = got[name]
        # Stamps are the log's, to the rounding of the map's seconds; so are values between the samples of two messages.
        np.testing.assert_allclose((block.t_ns - start) / 1e9, signal.t, rtol=0, atol=2e-9)
        np.testing.assert_allclose(block.values, signal.values, rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(block.flags, signal.flags)
        if len(own._channels[own.channels.index(name)].series) == 1:
            np.testing.assert_array_equal(block.values, signal.values)
        assert np.count_nonzero(block.flags) <= 1 + 0.02 * len(block)
    assert counts["received"] > 1000
    assert counts["lost"] == counts["bad_checksum"] == counts["incomplete"] == counts["out_of_order"] == 0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(0, 700), max_size=20))
def test_any_split_gives_the_same_samples(seed, cuts):
    signals = {
        "correvit.speed.x": "Speed", "correvit.speed.y": "Lat * 1 s", "wheel.fl.speed": "Fl",
        "wheel.fr.speed": "Fr - Fl",
        "engine.speed": "EngineSpeed", "car.yaw_rate": {"from": "Yaw", "delay": "7 ms"},
    }  # fmt: skip
    own = driver(signals, counter="Alive", checksum={"Crc": "sum"}, status={"LatState": {"valid": [0], "of": ["Lat"]}})
    rng = np.random.default_rng(seed)
    sent = [(10 * i, 256, esp(i % 90, alive=i % 16)) for i in range(100)]
    sent += [(25 * i + 3, 257, (i * 7 % 65536).to_bytes(2, "little") + b"\0\0") for i in range(45) if not 15 < i < 30]
    sent += [(20 * i + 1, 258, bytes([i % 2, i % 256, 1, 0, 0, 0, 0, 0])) for i in range(50)]
    sent += [(5000 + 7 * i, 0x18F00400, bytes(range(8))) for i in range(20)]  # past the patience for Speed
    stream = spoil(frames(*sorted(sent)), rng, [256, 257, 258])
    whole, counts = decode_all(own, stream)
    assert counts["samples"] > 0
    for split in (cuts, range(1, len(stream)), range(0, len(stream), 50)):
        other, split_counts = decode_split(own, stream, split)
        same_blocks(whole, other)
        assert split_counts == counts


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_bytes_raise(data):
    own = driver(
        {"car.lateral_accel": "Lat", "wheel.fl.speed": "Fl", "damper.fl.force": "Force", "engine.speed": "EngineSpeed"},
        counter="Alive", checksum={"Crc": "crc8-autosar"}, status={"LatState": 0},
    )  # fmt: skip
    idents = [256, 257, 258, 259, 0x18F00400, 0, 2**29, 2**31]
    rows = data.draw(
        st.lists(st.tuples(st.integers(0, 10**5), st.sampled_from(idents), st.binary(max_size=70)), max_size=20)
    )
    blocks, counts = decode_all(own, frames(*rows))
    for block in blocks.values():
        without = (block.flags & np.uint8(UNUSABLE)) != 0
        assert np.isnan(block.values[without]).all()
        assert np.isfinite(block.values[~without]).all()
    assert all(count >= 0 for count in counts.values())


def test_nothing_is_asked_of_a_bus_that_has_no_counter_checksum_or_status():
    got, counts = decode_all(
        driver({"car.lateral_accel": "Lat"}), frames(*[(i, 256, esp(i, state=3)) for i in range(9)])
    )
    np.testing.assert_allclose(got["car.lateral_accel"].values[:, 0], np.arange(9.0))
    assert not got["car.lateral_accel"].flags.any()
    assert counts["samples"] == counts["received"] == 9


def test_a_counter_that_the_rig_names_marks_what_was_lost():
    sent = [(10 * i, 256, esp(i, alive=i % 16)) for i in range(60) if not 20 <= i < 25]
    got, counts = decode_all(driver({"car.lateral_accel": "Lat"}, counter=["Esp.Alive"]), frames(*sent))
    assert counts["lost"] == 5
    flags = got["car.lateral_accel"].flags
    assert np.flatnonzero(flags).tolist() == [20]
    assert flags[20] == Flag.GAP


def test_frames_that_end_before_their_counter_are_incomplete_and_hide_no_loss():
    """Each accounts for one step of the counter; what a longer one could not be is found beside them."""
    sent = [(10 * i, 256, esp(i, alive=i % 16)) for i in range(60) if i != 40]
    sent = [(t, ident, data[:4] if 10 <= k < 22 else data[:2] if k == 30 else data)
            for k, (t, ident, data) in enumerate(sent)]  # fmt: skip
    one = driver({"car.lateral_accel": "Lat", "car.yaw_rate": "Yaw"}, counter=["Esp.Alive"])
    got, counts = decode_all(one, frames(*sent))
    assert (counts["lost"], counts["incomplete"]) == (1, 1)
    assert got["car.lateral_accel"].flags.tolist() == [0] * 40 + [int(Flag.GAP)] + [0] * 18
    assert np.flatnonzero(got["car.yaw_rate"].flags & int(Flag.INCOMPLETE)).tolist() == [30]
    split, split_counts = decode_split(one, frames(*sent), range(1, len(sent)))
    same_blocks(got, split)
    assert counts == split_counts


@pytest.mark.parametrize("back", [1, 3])
def test_a_frame_that_comes_again_is_used_once(back):
    sent = [(10 * n, 256, esp(n, alive=n % 16)) for n in range(40)]
    rows = [*sent[:20], (sent[19][0] + 1, 256, sent[20 - back][2]), *sent[20:]]
    one = driver({"car.lateral_accel": "Lat"}, counter=["Esp.Alive"])
    got, counts = decode_all(one, frames(*rows))
    same_blocks(got, decode_all(one, frames(*sent))[0])
    assert (counts["repeated"], counts["lost"], counts["samples"]) == (1, 0, 40)
    split, split_counts = decode_split(one, frames(*rows), range(1, len(rows)))
    same_blocks(got, split)
    assert counts == split_counts


@pytest.mark.parametrize("counter", [{}, {"counter": "Alive"}])
@pytest.mark.parametrize("period", [2, 10])
def test_frames_stamped_by_their_transfer_are_all_used(counter, period):
    """An adapter that stamps what came in 16 ms alike; also of a channel of two messages, whose values go together."""
    sent = [(-(-period * n // 16) * 16, 256, esp(n, alive=n % 16)) for n in range(300)]
    sent += [(t, 257, (36 * k).to_bytes(2, "little") + b"\0\0") for k, (t, _, _) in enumerate(sent)]
    stream = frames(*sorted(sent, key=lambda row: row[0]))
    one = driver({"car.lateral_accel": "Lat", "correvit.speed.x": "Lat * 1 s", "correvit.speed.y": "Speed"}, **counter)
    got, counts = decode_all(one, stream)
    np.testing.assert_array_equal(got["car.lateral_accel"].values[:, 0], np.arange(300.0))
    np.testing.assert_allclose(got["correvit.speed"].values, np.arange(300.0)[:, None] * [1.0, 0.1], atol=1e-9)
    assert not got["car.lateral_accel"].flags.any()
    assert not got["correvit.speed"].flags.any()
    assert counts["out_of_order"] == counts["lost"] == counts["repeated"] == 0
    for cuts in (range(1, len(stream)), range(0, len(stream), 7)):
        split, split_counts = decode_split(one, stream, cuts)
        same_blocks(got, split)
        assert split_counts == counts


def test_a_frame_written_twice_with_one_stamp_is_used_once_where_a_counter_says_so():
    rows = [row for n, row in enumerate(alive(range(60))) for _ in range(1 + (n % 20 == 7))]
    values, flagged, counts = by_counter(rows)
    np.testing.assert_array_equal(values, np.arange(60.0))
    assert flagged == []
    assert (counts["repeated"], counts["lost"], counts["out_of_order"]) == (3, 0, 0)


def alive(numbers, at=lambda n: 10 * n) -> list[tuple[int, int, bytes]]:
    """Messages of these numbers at 100 Hz, each with its number as the value and in the counter."""
    return [(at(n), 256, esp(n % 300, alive=n % 16)) for n in numbers]


def by_counter(rows) -> tuple[np.ndarray, list[int], dict[str, int]]:
    """Values and indices of the flagged samples, and the ledger; in any split the same."""
    one, stream = driver({"car.lateral_accel": "Lat"}, counter="Alive"), frames(*rows)
    got, counts = decode_all(one, stream)
    for cuts in (range(1, len(stream)), range(0, len(stream), 7)):
        split, split_counts = decode_split(one, stream, cuts)
        same_blocks(got, split)
        assert counts == split_counts
    block = got["car.lateral_accel"]
    assert (np.diff(block.t_ns) > 0).all()
    return block.values[:, 0], np.flatnonzero(block.flags).tolist(), counts


@pytest.mark.parametrize("by", [1, 2, 3])
@pytest.mark.parametrize("period", [10, 200])
def test_a_late_frame_is_put_in_its_place(by, period):
    numbers = list(range(40))
    numbers.insert(20 + by, numbers.pop(20))
    came = alive(numbers, lambda n: period * n + (period * by + 1 if n == 20 else 0))
    values, flagged, counts = by_counter(came)
    np.testing.assert_array_equal(values, np.arange(40.0))
    assert flagged == []
    assert (counts["reordered"], counts["lost"], counts["samples"], counts["out_of_order"]) == (1, 0, 40, 0)


@pytest.mark.parametrize("lost", [1, 14, 15, 16, 17, 32, 100])
@pytest.mark.parametrize("jitter", [0, 4])
def test_a_loss_is_counted_in_whole_turns_of_the_counter_by_the_time_that_passed(lost, jitter):
    rng = np.random.default_rng(lost)
    _, flagged, counts = by_counter(
        alive([n for n in range(200) if not 60 <= n < 60 + lost], lambda n: 10 * n + int(rng.integers(0, 1 + jitter)))
    )
    assert counts["lost"] == lost
    assert flagged == [60]


@pytest.mark.parametrize("pause", [30, 100, 400])
def test_a_pause_of_the_arrivals_is_no_loss(pause):
    """Frames that wait for a reader come at once behind it."""
    _, flagged, counts = by_counter(alive(range(200), lambda n: 10 * n + max(0, pause - 9 * (n % 50))))
    assert (counts["lost"], flagged) == (0, [])


@pytest.mark.parametrize("period", ["none", "not known yet"])
def test_without_a_known_period_a_loss_is_known_by_the_counter_only(period):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.choice([10, 40, 160, 640], 400))  # sent on a change
    at = (lambda n: int(times[n])) if period == "none" else (lambda n: 10 * n)
    rows = alive([n for n in range(200) if not 20 <= n < 39], at)
    assert by_counter(rows)[2]["lost"] == 3


def test_a_counter_that_stands_still_is_no_loss():
    rows = alive(range(60)) + [(10 * n, 256, esp(n, alive=59 % 16)) for n in range(60, 80)] + alive(range(80, 120))
    _, flagged, counts = by_counter(rows)
    assert counts["restarts"] == 20
    assert flagged == list(range(60, 81))
    assert counts["lost"] == (80 - 60) % 16


@pytest.mark.parametrize("bits", [4, 16])
def test_a_counter_that_never_counts_is_said_once_and_hides_nothing(bits):
    text = DBC.replace("SG_ Alive : 36|4@1+", f"SG_ Alive : 40|{bits}@1+")
    options = {"dbc": "my.dbc", "signals": {"car.lateral_accel": "Lat"}, "counter": "Alive"}
    own, rows = open_driver("dbc", "can0", options, None, {"my.dbc": text}), [(10 * n, 256, esp(n)) for n in range(90)]
    got, counts = decode_all(own, frames(*rows))
    np.testing.assert_array_equal(got["car.lateral_accel"].values[:, 0], np.arange(90.0))
    assert not got["car.lateral_accel"].flags.any()
    assert (counts["lost"], counts["restarts"]) == (0, 89)
    for cuts in (range(1, 90), range(0, 90, 7)):
        split, split_counts = decode_split(own, frames(*rows), cuts)
        same_blocks(got, split)
        assert split_counts == counts
    _, state = own.decode(frames(*rows), own.start())
    assert own.remarks(own.finish(state)[1]) == (
        "counter Alive of message Esp stands at 0 in all 90 frames: it does not count and shows no loss; correct "
        "'counter' in the rig",
    )
    assert driver(options["signals"], counter="Alive").remarks(own.start()) == ()


def test_a_sender_that_was_off_has_lost_what_its_counter_shows():
    rows = alive(range(60)) + [(t + 3000, ident, data) for t, ident, data in alive(range(64, 100))]
    _, flagged, counts = by_counter(rows)
    assert (counts["lost"], flagged) == (4, [60])


def test_frames_held_back_are_delivered_when_their_message_falls_silent():
    own = driver({"car.lateral_accel": "Lat"}, counter="Alive")
    _, state = own.decode(frames(*alive(range(20))), own.start())
    held, state = own.decode(frames(*alive([22, 23])), state)
    assert held == []
    none, state = own.decode(frames((1200, 257, bytes(4))), state)
    assert none == []
    (block,), state = own.decode(frames((1235, 257, bytes(4))), state)
    np.testing.assert_allclose(block.values[:, 0], [22.0, 23.0])


def test_a_status_that_the_rig_names_is_asked_of_its_signals_only():
    sent = frames(*[(i, 256, esp(i, yaw=1.0, state=int(i == 4))) for i in range(9)])
    signals = {"car.lateral_accel": "Lat", "car.yaw_rate": "Yaw"}
    of = driver(signals, status={"LatState": {"valid": [0, 2], "of": ["Lat"]}})
    got, counts = decode_all(of, sent)
    assert got["car.lateral_accel"].flags.tolist() == [0] * 4 + [int(Flag.STATUS)] + [0] * 4
    assert np.isnan(got["car.lateral_accel"].values[4])
    assert not got["car.yaw_rate"].flags.any()
    assert counts["bad_status"] == 1
    got, _ = decode_all(driver(signals, status={"LatState": 0}), sent)
    assert got["car.yaw_rate"].flags[4] == Flag.STATUS


@pytest.mark.parametrize(
    ("kind", "by"),
    [
        ("crc8-sae-j1850", Crc8SaeJ1850.calc),
        ("crc8-autosar", Crc8Autosar.calc),
        ("crc16-ccitt-false", lambda data: Crc16CcittFalse.calc(data) & 0xFF),
        ("sum", lambda data: sum(data) & 0xFF),
        ("xor", lambda data: int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))),
    ],
)
def test_a_checksum_that_the_rig_names_is_computed_over_the_rest_of_the_message(kind, by):
    payloads = [esp(1.5 * i)[:7] for i in range(20)]
    sent = [(i, 256, body + bytes([by(b"\x12" + body + b"\x34")])) for i, body in enumerate(payloads)]
    sent[7] = (7, 256, sent[7][2][:7] + bytes([sent[7][2][7] ^ 1]))
    named = {"Crc": {"kind": kind, "before": [0x12], "after": [0x34]}}
    got, counts = decode_all(driver({"car.lateral_accel": "Lat"}, checksum=named), frames(*sent))
    block = got["car.lateral_accel"]
    assert block.flags.tolist() == [int(Flag.CHECKSUM) * (i == 7) for i in range(20)]
    assert np.isnan(block.values[7])
    assert counts["bad_checksum"] == 1


def test_multiplexed_signals_can_fd_and_j1939():
    sent = [(10 * i, 258, bytes([i % 2]) + (100 * i).to_bytes(2, "little") + bytes(5)) for i in range(10)]
    sent += [(10 * i + 1, 259, bytes(40) + np.float32(1.5 * i).tobytes() + bytes(4)) for i in range(10)]
    # With another priority; a standard identifier of the same low bits is another message.
    sent += [(10 * i + 2, ident, bytes(3) + (800 * i).to_bytes(2, "little") + bytes(3))
             for i in range(10) for ident in ([0x0CF00400, 0x18F00400][i % 2],)]  # fmt: skip
    sent += [(95, 0x400, bytes(8))]
    signals = {
        "wheel.fl.speed": "Fl", "wheel.fr.speed": "Fr", "damper.fl.force": "Wide.Force", "engine.speed": "EngineSpeed",
    }  # fmt: skip
    got, counts = decode_all(driver(signals), frames(*sorted(sent)))
    rpm = np.pi / 30
    np.testing.assert_allclose(got["wheel.fl.speed"].values[:, 0], rpm * 10 * np.arange(0, 10, 2))
    np.testing.assert_allclose(got["wheel.fr.speed"].values[:, 0], rpm * 10 * np.arange(1, 10, 2))
    np.testing.assert_allclose(got["damper.fl.force"].values[:, 0], 1.5 * np.arange(10))
    np.testing.assert_allclose(got["engine.speed"].values[:, 0], rpm * 100 * np.arange(10))
    assert counts["received"] == 30


@pytest.mark.parametrize(("named", "used"), [(0xFE, 0x03), (0x00, 0x00)], ids=["first", "named"])
def test_of_two_senders_of_a_j1939_message_one_is_used_and_the_other_said(tmp_path: Path, named: int, used: int):
    """The one that the DBC names once it is there, else the first one; by a rig and by a map."""
    text = DBC.replace("2364540158", str(0x8CF00400 | named))
    rows = [(10 * i + address // 2, 0x0CF00400 | address, bytes(3) + (800 * i + address).to_bytes(2, "little"))
            for i in range(40) for address in (0x00, 0x03) if i or address]  # fmt: skip
    own = open_driver(
        "dbc", "can0", {"dbc": "m.dbc", "signals": {"engine.speed": "EngineSpeed"}}, None, {"m.dbc": text}
    )
    stream = frames(*rows)
    got, counts = decode_all(own, stream)
    raw = np.rint(got["engine.speed"].values[:, 0] / (np.pi / 30) / 0.125)
    np.testing.assert_array_equal(raw[1:] % 800, used)
    assert len(raw) == 40
    assert (counts["received"], counts["other_sender"], counts["lost"]) == (79, 39, 0)
    for cuts in (range(1, len(stream)), range(0, len(stream), 7)):
        split, split_counts = decode_split(own, stream, cuts)
        same_blocks(got, split)
        assert split_counts == counts
    _, state = own.decode(stream, own.start())
    (said,) = own.remarks(state)
    assert f"those of {used:#04x} are used" in said
    assert f"not used are {3 - used:#04x} (39 frames)" in said
    (tmp_path / "m.dbc").write_text(text)
    lines = [f"({1.7e9 + t / 1e3:.6f}) can0 {ident:08X}#{data.hex()}\n" for t, ident, data in rows]
    (tmp_path / "a.log").write_text("".join(lines))
    map_ = ChannelMap.parse(
        'format = "lacet-map 1"\n[read]\ndbc = "m.dbc"\n[channels]\n"engine.speed" = "EngineSpeed"', "m", tmp_path
    )
    run = mapped_run([tmp_path / "a.log"], map_)
    np.testing.assert_allclose(run.signals["engine.speed"].values, got["engine.speed"].values)
    assert said in run.problems


def test_two_messages_of_one_parameter_group_have_each_its_own_sender():
    second = DBC[DBC.index("BO_ 2364540158") : DBC.index("BA_DEF_ BO_")].replace(
        "2364540158 Eec1", "2364539907 Retarder"
    )
    text = DBC.replace("2364540158", "2364539904").replace("BA_DEF_ BO_", second + "BA_DEF_ BO_", 1)
    text = text.replace(
        'BA_ "VFrameFormat" BO_ 259 4', 'BA_ "VFrameFormat" BO_ 2364539907 3;\nBA_ "VFrameFormat" BO_ 259 4'
    )
    signals = {"engine.speed": "Eec1.EngineSpeed", "wheel.fl.speed": "Retarder.EngineSpeed"}
    own = open_driver("dbc", "can0", {"dbc": "m.dbc", "signals": signals}, None, {"m.dbc": text})
    rows = [
        (10 * i + a, 0x0CF00400 | a, bytes(3) + (80 * a + 8).to_bytes(2, "little")) for i in range(9) for a in (3, 0)
    ]
    got, _ = decode_all(own, frames(*sorted(rows)))
    rpm = np.pi / 30
    np.testing.assert_allclose(got["engine.speed"].values[:, 0], np.full(9, 1.0 * rpm))
    np.testing.assert_allclose(got["wheel.fl.speed"].values[:, 0], np.full(9, 31.0 * rpm))


def test_a_value_that_the_dbc_names_as_none_and_a_frame_cut_short_are_missing():
    sent = [(i, 257, raw.to_bytes(2, "little") + b"\0\0") for i, raw in enumerate([360, 65535, 720])]
    got, counts = decode_all(driver({"car.speed": "Speed"}), frames(*sent, (5, 257, b"\1")))
    np.testing.assert_allclose(got["car.speed"].values[:, 0], [1.0, np.nan, 2.0, np.nan])
    assert got["car.speed"].flags.tolist() == [0, int(Flag.STATUS), 0, int(Flag.INCOMPLETE)]
    assert counts["incomplete"] == 1


def test_a_29_bit_identifier_is_told_from_an_11_bit_one_of_the_same_number():
    text = DBC.replace("BO_ 256 Esp", "BO_ 2147483904 Esp")  # 0x100 of 29 bits
    own = open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": {"car.lateral_accel": "Lat"}}, None, {"my.dbc": text})
    got, _ = decode_all(own, frames((0, 256, esp(1.0)), (1, 256 | EXTENDED, esp(2.0))))
    assert got["car.lateral_accel"].values.tolist() == [[2.0]]


def test_a_message_that_falls_silent_does_not_hold_the_others_up():
    own = driver({"correvit.speed.x": "Lat * 1 s", "correvit.speed.y": "Speed"})
    state = own.start()
    slow = [(50 * i, 257, (360).to_bytes(2, "little") + b"\0\0") for i in range(40)]
    first, state = own.decode(frames(*sorted([(10 * i, 256, esp(i)) for i in range(200)] + slow)), state)
    assert len(first[0]) == 196  # up to the last of Speed
    held, state = own.decode(frames(*[(10 * i, 256, esp(1)) for i in range(200, 300)]), state)
    assert held == []
    waited, state = own.decode(frames(*[(10 * i, 256, esp(1)) for i in range(300, 700)], (6995, 256, esp(1))), state)
    assert len(waited[0]) == 104  # but for the last four seconds
    assert (waited[0].flags == Flag.INCOMPLETE).all()
    assert own.counts(state)["no_neighbour"] == 104


def test_a_clock_that_is_put_back_does_not_silence_the_bus():
    sent = [(10_000 + i, 256, esp(1.0)) for i in range(5)] + [(i, 256, esp(2.0)) for i in range(5)]
    got, counts = decode_all(driver({"car.lateral_accel": "Lat"}), frames(*sent))
    assert got["car.lateral_accel"].values[:, 0].tolist() == [1.0] * 5 + [2.0] * 5
    assert counts["out_of_order"] == 0
    _, counts = decode_all(driver({"car.lateral_accel": "Lat"}), frames(*sent[:5], (10_001, 256, esp(3.0))))
    assert counts["out_of_order"] == 1


def test_a_lookup_table_is_recorded_and_used_from_the_record(tmp_path: Path):
    (tmp_path / "my.dbc").write_text(DBC)
    (tmp_path / "table.csv").write_text("Lat [m/s²],speed [m/s]\n0,10\n10,30\n")
    signals = {"car.speed": {"from": "Lat", "table": "table.csv"}}
    own = open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": signals}, tmp_path)
    assert set(own.documents) == {"my.dbc", "table.csv"}
    again = open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": signals}, None, own.documents)
    got, _ = decode_all(again, frames((0, 256, esp(5.0)), (1, 256, esp(11.0))))
    np.testing.assert_allclose(got["car.speed"].values[:, 0], [20.0, np.nan])
    assert got["car.speed"].flags.tolist() == [0, int(Flag.MISSING)]


def test_it_only_reads():
    with pytest.raises(UsageError, match="only reads"):
        driver({"car.lateral_accel": "Lat"}).encode({})


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            {"signals": {"car.lateral_accel": "Latt"}},
            r"there is no 'Latt'; did you mean 'Lat'\?; my.dbc has Esp.Lat, Esp",
        ),
        ({"signals": {"car.yaw_rate": "Lat"}}, "this is in m/s², and car.yaw_rate is in rad/s"),
        ({"signals": {"car.speed": "Speed + Lat"}}, r"different units(.|\n)*\^"),
        (
            {"signals": {"car.speed": {"from": "Speed", "unti": "m/s"}}},
            r"signals.car.speed.unti: .*did you mean 'unit'",
        ),
        (
            {"signals": {"car.speed": {"from": "Speed", "table": "t.csv"}}},
            "signals.car.speed.table: t.csv: cannot be read",
        ),
        ({"sources": {"Speed": {"time": "t"}}}, "sources.Speed.time: the frames of a bus have their own stamps"),
        ({"sources": {"Speed": "kmm/h"}}, r"sources.Speed.unit: unit 'kmm/h' is not known"),
        ({"counter": "Aliv"}, r"counter: there is no 'Aliv'; did you mean 'Esp.Alive'\?; my.dbc has"),
        ({"checksum": {"Crc": "crc8-autosr"}}, "checksum.Crc: must be one of .*did you mean 'crc8-autosar'"),
        (
            {"checksum": {"Crc": {"kind": "sum", "befor": [1]}}},
            "checksum.Crc.befor: unknown key; did you mean 'before'",
        ),
        ({"checksum": {"Crc": {"kind": "sum", "before": [300]}}}, r"checksum.Crc.before: must be bytes"),
        ({"status": {"LatState": "ok"}}, "status.LatState: must be the raw values that mean valid"),
        ({"status": {"LatState": {"valid": 0, "of": ["Speed"]}}}, "Esp has no signal 'Speed'.*: Lat, Yaw"),
        ({"dbc": "my.db"}, r"no such file in .*did you mean 'my.dbc'"),
        ({"singals": {}}, r"'singals' is not an option.*did you mean 'signals'"),
    ],
)
def test_what_is_refused_says_where_what_and_what_is_there(options, says):
    from lacet.daq.errors import FileFault

    with pytest.raises(FileFault, match=says):
        driver(**{"signals": {"car.speed": "Speed"}, **options})


RIG = """\
format = "lacet-rig 1"
name = "r"
[bus.can0]
[[sensor]]
name = "car"
driver = "dbc"
bus = "can0"
dbc = "road-car.dbc"
[sensor.signals]
"""


def test_a_row_of_the_rig_needs_no_list_of_channels():
    rig = Rig.parse(RIG + 'car.yaw_rate = "GYRO_YAW"\n"steering.angle" = { from = "STEER_ANGLE" }', "rig.toml", CAN)
    (sensor,) = rig.sensors
    assert sensor.channels == ("car.yaw_rate", "steering.angle")
    batch = replace(read_bus_log(CAN / "road-car.candump.log")["can0"], source="can0")
    decoder = Decoder(rig)
    assert set(decode_frames(decoder, [batch])) == set(sensor.channels)
    assert set(decoder.documents) == {"road-car.dbc"}
    assert decoder.losses() == {}


@pytest.mark.parametrize(
    ("signals", "says"),
    [
        ('"imu.acel.x" = "X"', "sensor car.signals.imu.acel.x: is not a channel; did you mean 'imu.accel.x'"),
        (
            '"imu.accel.y" = "X"',
            "sensor car.signals: imu.accel needs all its components: imu.accel.x, imu.accel.z is missing",
        ),
        ('"imu.accel" = "X"', "has components: write imu.accel.x, imu.accel.y"),
        ("", "sensor car.signals: must say where channels come from"),
    ],
)
def test_a_row_with_wrong_channels_is_refused_at_load(signals, says):
    with pytest.raises(RigError, match=says):
        Rig.parse(RIG + signals, "rig.toml")


def test_a_fault_behind_the_row_names_rig_and_sensor():
    rig = Rig.parse(RIG + '"car.yaw_rate" = "GYRO_YAWW"', "rig.toml", CAN)
    with pytest.raises(RigError, match=r"^rig.toml:\n  - sensor car.signals: .*did you mean 'ID_D0.GYRO_YAW'"):
        Decoder(rig)
    text = RIG.replace('"dbc"\nbus', '"igel"\nbus')
    with pytest.raises(RigError, match=r'sensor car.dbc: is for driver = "dbc"'):
        Rig.parse(text + '"car.yaw_rate" = "A"', "rig.toml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_degree_sign_is_read_in_every_usual_encoding(tmp_path: Path, encoding: str):
    """Live and of a log alike."""
    (tmp_path / "my.dbc").write_bytes(DBC.replace('"deg/s"', '"°/s"').encode(encoding))
    own = open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": {"car.yaw_rate": "Yaw"}}, tmp_path)
    got, _ = decode_all(own, frames((0, 256, esp(0.0, yaw=90.0))))
    assert got["car.yaw_rate"].values[0, 0] == pytest.approx(np.pi / 2)
    (tmp_path / "a.log").write_text("(1600000000.000000) can0 100#" + esp(0.0, yaw=90.0).hex().upper() + "\n" * 2)
    map_ = ChannelMap.parse(
        'format = "lacet-map 1"\n[read]\ndbc = "my.dbc"\n[channels]\n"car.yaw_rate" = "Yaw"', "m", tmp_path
    )
    run = mapped_run([tmp_path / "a.log"], map_)
    assert run.signals["car.yaw_rate"].values[0, 0] == pytest.approx(np.pi / 2)


def test_signals_that_share_bits_are_said_where_one_is_used():
    """Not those of different values of a multiplexer, nor of messages that are not used."""
    assert driver({"wheel.fl.speed": "Fl", "wheel.fr.speed": "Fr", "car.lateral_accel": "Lat"}).notes == ()
    shared = DBC.replace("SG_ Yaw : 16|16@1-", "SG_ Yaw : 12|16@1-")
    made = {
        name: open_driver("dbc", "can0", {"dbc": "my.dbc", "signals": {name: signal}}, None, {"my.dbc": shared})
        for name, signal in (("car.lateral_accel", "Lat"), ("car.speed", "Speed"))
    }
    said = "signals Lat and Yaw of message Esp share bits in its DBC: the values of one are wrong"
    assert {name: one.notes for name, one in made.items()} == {"car.lateral_accel": (said,), "car.speed": ()}
