"""The lines that a recording shows each second."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.frames import Frame, Frames
from lacet.daq.rig import Bus, Rig
from lacet.services.acquisition.bus_load import BusLoad, wire_bits
from lacet.services.acquisition.host_clock import describe_synchronisation, short_synchronisation
from lacet.services.acquisition.recorder import Health
from lacet.services.acquisition.sensor_monitor import SensorState, SensorStatus
from lacet.services.render.live_line import COLUMNS, doubtful_counter_text, live_text

RIG = Rig.load("peugeot-406")


def full(**changes: object) -> Health:
    """The shipped rig at its rates."""
    sensors = {one.name: SensorStatus(SensorState.RUNNING) for one in RIG.sensors if one.driver}
    known: dict[str, object] = {
        "seconds": 754.3,
        "frames": {"can0": 6000.0, "can1": 1250.0, "serial0": 200.0, "udp0": 100.0},
        "samples": {},
        "losses": {},
        "down": [],
        "waiting": 0,
        "sensors": sensors,
        "disk_seconds": 41.4 * 60,
        "rates": dict.fromkeys(sensors, (500.2, 500.0)),
        "load": {"can0": 0.814, "can1": 0.17, "serial0": 0.4},
        "clock": "synchronised",
        "listened": True,
    }
    return Health(**(known | changes))  # type: ignore[arg-type]


def test_a_full_rig_takes_three_lines_of_100_columns():
    text = live_text(full())
    first, sensors, rest = text.splitlines()
    assert first == "754 s: can0 6000/s 81 %, can1 1250/s 17 %, serial0 200/s 40 %, udp0 100/s; nothing lost"
    assert sensors.count(" 500/500") == len(full().sensors)
    assert rest == "  41 min left; clock synchronised; heard on the bus"
    assert max(map(len, text.splitlines())) <= COLUMNS == 100


def test_what_is_wrong_is_said_and_stays_within_the_columns():
    names = list(full().sensors)
    sensors = {name: SensorStatus(SensorState.SILENT) for name in names} | {names[1]: SensorStatus(SensorState.SLOW)}
    losses = {bus: {"kernel": 12, "queue": 3, "link_down": 1} for bus in ("can0", "can1", "serial0")}
    rates: dict[str, tuple[float, float | None]] = dict.fromkeys(names, (0.0, None))
    text = live_text(
        full(sensors=sensors, losses=losses, down=["can1"], rates=rates | {names[1]: (200.0, 250.0)}, listened=False)
    )
    assert f"{names[1]} SLOW 200/250" in text
    assert all(f"{name} SILENT 0" in text for name in names if name != names[1])  # no line is broken within one
    assert "DOWN: can1; LOST can0 kernel 12, can1 kernel 12" in " ".join(text.split())
    assert "nobody listens on the bus" in text
    assert max(map(len, text.splitlines())) <= COLUMNS


@pytest.mark.parametrize(
    ("status", "text"), [(0, "synchronised"), (0x40, "NOT SYNCHRONISED")], ids=["synchronised", "free"]
)
def test_the_clock_in_a_word(status: int, text: str):
    assert short_synchronisation(describe_synchronisation(status, 10, 20, 30)) == text


def frames(ident: int, size: int, number: int) -> Frames:
    return Frames.from_iter("can0", [Frame("can0", 0, ident, bytes(size))] * number)


@pytest.mark.parametrize(("ident", "size"), [(0x123, 8), (0x123, 0), (0x18FEF100, 8), (0x18FEF100, 3)])
def test_the_bits_of_a_can_frame_are_those_without_stuffing_and_a_quarter_more_at_most(ident: int, size: int):
    bare = 47 + 8 * size + (20 if ident > 0x7FF else 0)  # ISO 11898-1, with the gap of 3 bits
    found = wire_bits(Bus("can0", "can", bitrate=500_000), frames(ident, size, 7))
    assert found is not None
    assert 7 * bare < found <= 7 * bare * 1.25


def test_the_load_of_a_second():
    meter = BusLoad({"can0": Bus("can0", "can", bitrate=1_000_000), "udp0": Bus("udp0", "udp", port=1)})
    for _ in range(2):
        meter.add(frames(0x123, 8, 3000))
        assert meter.take(1.0) == {"can0": pytest.approx(3000 * 135 / 1e6)}
    assert meter.take(1.0) == {"can0": 0.0}
    meter.add(frames(0x123, 64, 1))  # CAN FD: its bit rate is not known
    assert meter.take(1.0) == {}
    serial = Frames("s", np.zeros(1, np.int64), np.zeros(1, np.uint32), np.array([0, 46]), np.zeros(46, np.uint8))
    assert wire_bits(Bus("s", "serial", baud=115_200), serial) == 460


def test_more_frames_lost_than_came_are_no_broken_cable() -> None:
    losses = {"can0": {"lost": 831}, "can1": {"lost": 4}, "serial0": {"lost": 1}}
    said = doubtful_counter_text(losses, {"can0": 200, "can1": 5})
    assert said.startswith("Of can0 more frames count as lost than came: two senders")
    assert doubtful_counter_text(losses, {"can0": 900, "can1": 5}) == ""
