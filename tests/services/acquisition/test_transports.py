from __future__ import annotations

import json

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame, dissect_can_frame
from can.interfaces.udp_multicast.utils import pack_message, unpack_message
from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.errors import FileFault, UsageError
from lacet.daq.rig import Bus
from lacet.services.acquisition.transports import can as wire
from lacet.services.acquisition.transports.endpoints import (
    default_endpoint,
    open_receiver,
    open_sender,
    parse_assignments,
    read_endpoints,
    write_endpoints,
)

BUSES = {
    "can0": Bus("can0", "can", bitrate=1_000_000),
    "can1": Bus("can1", "can"),
    "serial0": Bus("serial0", "serial", baud=460_800, device="/dev/ttyUSB0"),
    "udp0": Bus("udp0", "udp", port=47110),
}
idents = st.integers(0, 0x1FFF_FFFF)
payloads = st.binary(max_size=8)


@given(idents, payloads)
def test_multicast_frames_are_those_of_python_can(ident, payload):
    message = unpack_message(wire.pack_multicast(ident, payload), check=True)
    assert (message.arbitration_id, bytes(message.data)) == (ident, payload)
    assert message.is_extended_id == (ident > 0x7FF)
    theirs = can.Message(arbitration_id=ident, data=payload, is_extended_id=ident > 0x7FF)
    assert wire.unpack_multicast(pack_message(theirs)) == (ident, payload)


@given(idents, payloads)
def test_socketcan_frames_are_those_of_python_can(ident, payload):
    theirs = build_can_frame(can.Message(arbitration_id=ident, data=payload, is_extended_id=ident > 0x7FF))
    assert wire.unpack_socketcan(bytes(theirs)) == (ident, payload)
    word = ident | (0x8000_0000 if ident > 0x7FF else 0)
    read_id, length, _, read = dissect_can_frame(wire.pack_socketcan(ident, payload))
    assert (read_id, length, bytes(read)) == (word, len(payload), payload)


@given(idents, st.sampled_from([12, 16, 24, 48, 64]))
def test_can_fd_frames_are_those_of_python_can(ident, length):
    payload = bytes(range(length))
    theirs = can.Message(arbitration_id=ident, data=payload, is_extended_id=ident > 0x7FF, is_fd=True)
    assert wire.unpack_socketcan(bytes(build_can_frame(theirs))) == (ident, payload)
    assert wire.unpack_multicast(pack_message(theirs)) == (ident, payload)
    read_id, read_length, flags, read = dissect_can_frame(wire.pack_socketcan(ident, payload))
    assert (read_id & 0x1FFF_FFFF, read_length, bytes(read), flags) == (ident, length, payload, 4)
    message = unpack_message(wire.pack_multicast(ident, payload), check=True)
    assert (message.is_fd, bytes(message.data)) == (True, payload)


def test_a_29_bit_identifier_that_is_a_small_number_stays_one():
    theirs = can.Message(arbitration_id=5, data=b"a", is_extended_id=True)
    for unpack, packed in (
        (wire.unpack_socketcan, bytes(build_can_frame(theirs))),
        (wire.unpack_multicast, pack_message(theirs)),
    ):
        ident, payload = unpack(packed)
        assert (ident, payload) == (5 | 0x8000_0000, b"a")
    assert unpack_message(wire.pack_multicast(ident, b"a"), check=True).is_extended_id
    assert dissect_can_frame(wire.pack_socketcan(ident, b"a"))[0] == 5 | 0x8000_0000


def test_error_and_remote_frames_are_no_data():
    for message in (can.Message(is_error_frame=True), can.Message(arbitration_id=1, is_remote_frame=True, dlc=4)):
        assert wire.unpack_multicast(pack_message(message)) is None
        assert wire.unpack_socketcan(bytes(build_can_frame(message))) is None


@given(st.binary(max_size=200))
def test_bytes_that_are_no_frame_are_refused_and_nothing_else_happens(data):
    for unpack in (wire.unpack_multicast, wire.unpack_socketcan):
        try:
            content = unpack(data)
        except ValueError:
            continue
        assert content is None or (0 <= content[0] & 0x7FFF_FFFF <= 0x1FFF_FFFF and len(content[1]) <= 64)


def test_every_can_bus_has_a_port_of_its_own():
    if wire.has_socketcan("can0") or wire.has_socketcan("vcan0"):
        pytest.skip("this machine has SocketCAN, which comes first")  # the other branch: test_vcan
    places = [default_endpoint(BUSES, name, sending) for name in ("can0", "can1") for sending in (True, False)]
    assert places == ["multicast:239.74.163.2:43113"] * 2 + ["multicast:239.74.163.2:43114"] * 2


def test_socketcan_is_preferred_and_a_replay_keeps_off_real_buses(monkeypatch):
    monkeypatch.setattr(
        "lacet.services.acquisition.transports.endpoints.has_socketcan", lambda name: name in ("can0", "vcan0", "can1")
    )
    assert default_endpoint(BUSES, "can0", sending=False) == "socketcan:can0"
    assert default_endpoint(BUSES, "can0", sending=True) == "socketcan:vcan0"
    assert default_endpoint(BUSES, "can1", sending=True).startswith("multicast:")


@pytest.mark.parametrize(
    ("bus", "endpoint", "says"),
    [
        ("can0", "serial:/dev/ttyS0", "socketcan or multicast"),
        ("can0", "sockectan:can0", "did you mean 'socketcan'"),
        ("can0", "socketcan:", "no place"),
        ("can0", "multicast:10.0.0.1:4000", "multicast group"),
        ("can0", "multicast:239.0.0.1:x", "port"),
        ("udp0", "udp:127.0.0.1:99999", "port"),
        ("udp0", "udp:nowhere:1", "IPv4"),
    ],
)
def test_an_endpoint_that_makes_no_sense_is_refused_with_the_remedy(bus, endpoint, says):
    for opener in (open_receiver, open_sender):
        with pytest.raises(UsageError, match=says):
            opener(BUSES[bus], endpoint)


def test_assignments_name_buses_of_the_rig():
    assert parse_assignments(["can0=socketcan:can3"], BUSES, "--to") == {"can0": "socketcan:can3"}
    with pytest.raises(UsageError, match="did you mean 'can0'"):
        parse_assignments(["cann0=socketcan:can3"], BUSES, "--to")
    with pytest.raises(UsageError, match="BUS=ENDPOINT"):
        parse_assignments(["can0"], BUSES, "--to")


def test_the_endpoints_file_comes_back_and_anything_else_is_refused(tmp_path):
    path = tmp_path / "wires.json"
    write_endpoints(path, {"can0": "socketcan:vcan0"})
    assert read_endpoints(path) == {"can0": "socketcan:vcan0"}
    for text in ("", "[]", json.dumps({"format": "x", "buses": {}}), json.dumps({"format": "lacet-endpoints 1"})):
        path.write_text(text)
        with pytest.raises(FileFault, match="endpoints file"):
            read_endpoints(path)
