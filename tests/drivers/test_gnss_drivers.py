"""GNSS receivers on a serial line: messages found among anything, in any pieces, over midnight and the week's end."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyubx2 import GET, UBXMessage

from lacet.daq.blocks import UNUSABLE, Flag
from lacet.daq.errors import RigError, UsageError
from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from tests.drivers.driver_cases import decode_all, decode_split, same_blocks

NAMES = ("nmea", "ubx")


def sentence(body: str) -> bytes:
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def rmc(time: str, speed: str = "19.44", course: str = "53.13", status: str = "A") -> bytes:
    return sentence(f"GNRMC,{time},{status},4845.92593,N,00906.11111,W,{speed},{course},241126,,,A")


def gga(time: str, quality: int = 1) -> bytes:
    return sentence(f"GPGGA,{time},4845.92593,S,00906.11111,E,{quality},12,0.8,301.2,M,47.9,M,,")


def pvt(itow: int, **fields: object) -> bytes:
    """A message as another library writes it."""
    usual: dict[str, object] = dict(  # noqa: C408 - as the library is called
        iTOW=itow, year=2026, month=11, day=24, hour=1, min=2, second=3, validDate=1, validTime=1, tAcc=10, nano=-5,
        fixType=3, gnssFixOk=1, numSV=12, lon=-9.25, lat=48.75, height=349100, hMSL=-1200, hAcc=500, vAcc=600,
        velN=6000, velE=8000, velD=10, gSpeed=10000, headMot=53.125, sAcc=10, headAcc=1.0, pDOP=1.2, headVeh=0,
        magDec=0, magAcc=0,
    )  # fmt: skip
    return UBXMessage("NAV", "NAV-PVT", GET, **{**usual, **fields}).serialize()


def reads(data: bytes, size: int = 1) -> Frames:
    parts = [data[i : i + size] for i in range(0, len(data), size)]
    return Frames.from_iter("s", [("s", 10**18 + i, 0, part) for i, part in enumerate(parts)])


def decoded(name: str, data: bytes, **options: object):
    return decode_all(open_driver(name, "s", options), reads(data, 13))


NMEA_STREAM = b"".join(
    [b"\0\xb5\x62noise", rmc("120000.00"), gga("120000.00")[:30], b"\xff\n", rmc("120000.10")[5:], b"$GP",
     rmc("120000.20"), sentence("GPGSV,3,1,11,03,03,111,00"), rmc("120000.30").replace(b"19", b"18"), gga("120000.30"),
     rmc("120000.30")[:-4]]
)  # fmt: skip
UBX_STREAM = b"".join(
    [b"\xb5\x62\x01", pvt(1000), b"$GPRMC", pvt(1100)[:60], pvt(1200), UBXMessage("NAV", "NAV-EOE", GET).serialize(),
     b"\xb5\x62\x01\x07\x5c\0", pvt(1300)[:-1] + b"\xee", pvt(1400), pvt(1500)[:99]]
)  # fmt: skip


@pytest.mark.parametrize(("name", "data"), [("nmea", NMEA_STREAM), ("ubx", UBX_STREAM)], ids=NAMES)
def test_any_split_gives_the_same_samples(name, data):
    driver, single = open_driver(name, "s"), reads(data)
    whole, counts = decode_all(driver, single)
    assert len(whole["gnss.speed"]) == (2 if name == "nmea" else 3)
    assert counts["bad_checksum"] == (2 if name == "nmea" else 3)
    for size in (2, 7, 64, 1000):
        other, split_counts = decode_split(driver, single, range(0, len(single), size))
        same_blocks(whole, other)
        assert split_counts == counts
    start = data.index(rmc("120000.20") if name == "nmea" else pvt(1200))
    assert whole["gnss.speed"].t_ns[1] == 10**18 + start


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=50, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([
    rmc("120000.00"), gga("120000.00"), pvt(1000), b"$", b"*", b"\r\n", b"\xb5\x62\x01\x07\x5c\x00", b"$GNRMC,", b",,,",
    sentence("GNRMC"), sentence("GNRMC,,,,,,,,,,"), sentence("GNRMC,x,A,y,N,z,E,v,w,u,,,A"),
    sentence("GNRMC,120000.00,A,nan,N"),
    sentence("GPGGA,996199,9999.9,N,99999.9,E,1,12,inf,inf,M,47.9,M,,"), sentence("PUBX,00"),
])), max_size=20))  # fmt: skip
def test_no_bytes_raise(name, parts):
    blocks, counts = decoded(name, b"".join(parts))
    for block in blocks.values():
        without = (block.flags & np.uint8(UNUSABLE & ~Flag.CLOCK)) != 0
        assert np.isnan(block.values[without]).all()
        assert np.isfinite(block.values[~without]).all()
    assert all(count >= 0 for count in counts.values())
    assert counts["skipped_bytes"] <= counts["received"]


def test_sentences_have_signs_units_and_status():
    blocks, counts = decoded("nmea", rmc("120000.00") + gga("120000.00") + rmc("120001.00", course="", status="V"))
    degree = np.pi / 180
    assert blocks["gnss.speed"].values[0, 0] == pytest.approx(10.0009, abs=1e-4)
    assert blocks["gnss.course"].values[0, 0] == pytest.approx(53.13 * degree)
    assert blocks["gnss.latitude"].values[0, 0] == pytest.approx(-(48 + 45.92593 / 60) * degree, abs=1e-11)
    assert blocks["gnss.longitude"].values[0, 0] == pytest.approx((9 + 6.11111 / 60) * degree, abs=1e-11)
    assert blocks["gnss.altitude"].values[0, 0] == 301.2
    assert blocks["gnss.speed"].flags.tolist() == [0, int(Flag.STATUS)]
    assert counts["bad_status"] == 1


def test_which_sentence_is_used_is_the_rigs_choice():
    vtg = sentence("GPVTG,10.0,T,,M,19.44,N,36.0,K,A")
    gns = sentence("GNGNS,120000.00,4730.0,N,00906.0,E,AN,08,0.9,545.4,46.9,,")
    gll = sentence("GPGLL,4630.0,N,00906.0,E,120000.00,A,A")
    stream = rmc("120000.00") + vtg + gga("120000.00") + gns + gll
    blocks, _ = decoded("nmea", stream, speed_from="VTG", position_from="GNS")
    assert blocks["gnss.speed"].values.tolist() == [[10.0]]
    assert blocks["gnss.speed"].device_ns is None  # VTG has no time
    assert np.rad2deg(blocks["gnss.latitude"].values[0, 0]) == pytest.approx(47.5)
    assert blocks["gnss.altitude"].values.tolist() == [[545.4]]
    blocks, _ = decoded("nmea", stream, position_from="GLL")
    assert np.rad2deg(blocks["gnss.latitude"].values[0, 0]) == pytest.approx(46.5)
    assert blocks["gnss.altitude"].values.tolist() == [[301.2]]
    with pytest.raises(RigError, match=r"speed_from: must be one of RMC, VTG, found 'VTC'; did you mean 'VTG'"):
        open_driver("nmea", "s", {"speed_from": "VTC"})
    with pytest.raises(RigError, match="'speed' is not an option"):
        open_driver("nmea", "s", {"speed": "VTG"})


@given(st.integers(0, 86_399), st.lists(st.sampled_from([100, 200, 40_000, 30_000_000]), min_size=1, max_size=12))
@example(86_399, [100, 100, 100, 900, 100])
@settings(max_examples=25, deadline=None)
def test_the_clock_goes_on_over_midnight_and_the_weeks_end(second, steps_ms):
    times = 1000 * second + np.concatenate([[0], np.cumsum(steps_ms)])
    clock = [f"{t // 3_600_000 % 24:02}{t // 60_000 % 60:02}{t // 1000 % 60:02}.{t % 1000:03}" for t in times.tolist()]
    nmea, _ = decoded("nmea", b"".join(map(rmc, clock)) + gga(clock[-1]))
    ubx, _ = decoded("ubx", b"".join(pvt((604_700_000 + int(t)) % 604_800_000) for t in times))
    for blocks in (nmea, ubx):
        np.testing.assert_array_equal(np.diff(blocks["gnss.speed"].device_ns), 10**6 * np.array(steps_ms))
        assert not blocks["gnss.speed"].flags.any()
    assert nmea["gnss.altitude"].device_ns[0] == nmea["gnss.speed"].device_ns[-1]


def test_a_time_that_stands_still_or_goes_back_is_marked():
    nmea, _ = decoded("nmea", rmc("120000.00") + rmc("120000.00") + rmc("115959.00") + rmc("120001.00"))
    ubx, _ = decoded("ubx", pvt(1000) + pvt(1000) + pvt(900) + pvt(1100))
    for blocks in (nmea, ubx):
        assert blocks["gnss.speed"].flags.tolist() == [0, int(Flag.CLOCK), int(Flag.CLOCK), 0]
    leap, counts = decoded("nmea", rmc("235959.00") + rmc("235960.00") + rmc("000000.00"))
    assert leap["gnss.speed"].flags.tolist() == [0, int(Flag.CLOCK), 0]
    assert counts["bad_field"] == 0


def test_messages_are_those_of_another_library():
    blocks, _ = decoded("ubx", pvt(1000) + pvt(1100, fixType=2) + pvt(1200, invalidLlh=1) + pvt(1300, gnssFixOk=0))
    degree = np.pi / 180
    for channel, value in {
        "gnss.speed": 10.0, "gnss.course": 53.125 * degree, "gnss.latitude": 48.75 * degree,
        "gnss.longitude": -9.25 * degree, "gnss.altitude": -1.2,
    }.items():  # fmt: skip
        assert blocks[channel].values[0, 0] == pytest.approx(value, abs=1e-9)
    status = int(Flag.STATUS)
    assert blocks["gnss.altitude"].flags.tolist() == [0, status, status, status]
    assert blocks["gnss.latitude"].flags.tolist() == [0, 0, status, status]
    assert blocks["gnss.speed"].flags.tolist() == [0, 0, 0, status]


@pytest.mark.parametrize("name", NAMES)
def test_they_only_read(name):
    with pytest.raises(UsageError, match="only reads"):
        open_driver(name, "s").encode({})


@pytest.mark.parametrize("module", ["services.commands.record", "services.commands.replay", "drivers.nmea"])
def test_libraries_of_single_drivers_are_loaded_when_they_are_used(module):
    asked = (
        "[name for name in ('pynmeagps', 'cantools', 'asammdf', 'can', 'pint', 'pyarrow.csv') if name in sys.modules]"
    )
    code = f"import sys, lacet.{module}; print({asked})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"
