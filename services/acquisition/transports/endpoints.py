"""Endpoints of a rig's buses: their notation, the defaults, and the file that passes them from process to process.

======================== ===========================================================================
``socketcan:vcan0``      a SocketCAN interface
``multicast:PORT``       CAN frames as python-can's udp_multicast, on this machine's loopback
``multicast:GROUP:PORT`` the same in another group
``serial:/dev/ttyUSB0``  a serial device (also the far end of a pseudo-terminal)
``pty`` ``pty:LINK``     a new pseudo-terminal (sending only), with a link to it at LINK
``udp:HOST:PORT``        datagrams; for receiving, HOST is the address of this machine to listen at
======================== ===========================================================================
"""

from __future__ import annotations

import ipaddress
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from lacet.daq.errors import FileFault, UsageError, nearest
from lacet.services.acquisition.transports.base import Receiver, Sender
from lacet.services.acquisition.transports.can import (
    GROUP,
    MulticastSender,
    SocketCanSender,
    has_socketcan,
    multicast_receiver,
    socketcan_receiver,
)
from lacet.services.acquisition.transports.serial import PtySender, SerialReceiver, SerialSender
from lacet.services.acquisition.transports.udp import UdpSender, udp_receiver

FORMAT = "lacet-endpoints 1"
FIRST_PORT = 43113
"""Port of a rig's first CAN bus over multicast (python-can's default); further buses have the following ports."""
_DEFAULT_BAUD = 115_200
_KINDS = {"can": ("socketcan", "multicast"), "serial": ("serial", "pty"), "udp": ("udp",)}


class BusLike(Protocol):
    """Properties of a bus that its endpoint depends on (see `daq.rig.Bus`)."""

    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def baud(self) -> int | None: ...
    @property
    def device(self) -> str | None: ...
    @property
    def port(self) -> int | None: ...


def default_endpoint(buses: Mapping[str, BusLike], name: str, sending: bool) -> str:
    """The default endpoint of a bus.

    CAN: the SocketCAN interface of that name (or ``v`` + that name, when sending) where there is one, otherwise
    multicast; serial: the rig's device (sending: a new pseudo-terminal); UDP: the rig's port on loopback.
    """
    bus = buses[name]
    if bus.kind == "can":
        # A replay must not send on a real bus unless that is asked for.
        for interface in [f"v{name}"] if sending else [name, f"v{name}"]:
            if has_socketcan(interface):
                return f"socketcan:{interface}"
        index = [bus.name for bus in buses.values() if bus.kind == "can"].index(name)
        return f"multicast:{GROUP}:{FIRST_PORT + index}"
    if bus.kind == "serial":
        return "pty" if sending else f"serial:{bus.device}"
    return f"udp:127.0.0.1:{bus.port}"


def parse_assignments(words: list[str], buses: Mapping[str, BusLike], option: str) -> dict[str, str]:
    """Bus → endpoint of the ``BUS=ENDPOINT`` arguments of a command line. Raises UsageError for an unknown bus."""
    out: dict[str, str] = {}
    for word in words:
        name, mark, endpoint = word.partition("=")
        if not mark:
            raise UsageError(f"{option} {word}: write BUS=ENDPOINT, e.g. can0=socketcan:vcan0")
        if name not in buses:
            raise UsageError(f"{option} {word}: no bus '{name}' (the rig has {', '.join(buses)}){nearest(name, buses)}")
        out[name] = endpoint
    return out


def _parts(endpoint: str, bus: BusLike) -> tuple[str, str]:
    kind, _, rest = endpoint.partition(":")
    allowed = _KINDS[bus.kind]
    if kind not in allowed:
        raise UsageError(
            f"{bus.name} is a {bus.kind} bus: '{endpoint}' is not an endpoint for it; it takes "
            f"{' or '.join(allowed)}{nearest(kind, allowed)}"
        )
    if kind != "pty" and not rest:
        raise UsageError(f"{bus.name}: '{endpoint}' says no place; write e.g. socketcan:vcan0, udp:127.0.0.1:47110")
    return kind, rest


def _host_port(rest: str, default_host: str, endpoint: str, multicast: bool = False) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    host = host or default_host
    try:
        address = ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host)
        number = int(port)
        if not 0 < number < 65_536 or (multicast and not address.is_multicast):
            raise ValueError
    except ValueError:
        what = "a multicast group (224.0.0.0 to 239.255.255.255)" if multicast else "an IPv4 address"
        raise UsageError(f"'{endpoint}': needs {what} and a port from 1 to 65535, e.g. {default_host}:47110") from None
    return str(address), number


def open_receiver(bus: BusLike, endpoint: str) -> Receiver:
    """A receiver (not opened yet) for a bus at an endpoint. Raises UsageError for an invalid endpoint."""
    kind, rest = _parts(endpoint, bus)
    if kind == "socketcan":
        return socketcan_receiver(bus.name, rest)
    if kind == "multicast":
        return multicast_receiver(bus.name, *_host_port(rest, GROUP, endpoint, multicast=True))
    if kind == "serial":
        return SerialReceiver(bus.name, rest, bus.baud or _DEFAULT_BAUD)
    if kind == "udp":
        return udp_receiver(bus.name, *_host_port(rest, "127.0.0.1", endpoint))
    raise UsageError(f"{bus.name}: '{endpoint}' is made by the sender; receive from serial:DEVICE")


def open_sender(bus: BusLike, endpoint: str) -> Sender:
    """A sender (not opened yet) for a bus at an endpoint. Raises UsageError for an invalid endpoint."""
    kind, rest = _parts(endpoint, bus)
    if kind == "socketcan":
        return SocketCanSender(bus.name, rest)
    if kind == "multicast":
        return MulticastSender(bus.name, *_host_port(rest, GROUP, endpoint, multicast=True))
    if kind == "serial":
        return SerialSender(bus.name, rest, bus.baud or _DEFAULT_BAUD)
    if kind == "pty":
        return PtySender(bus.name, rest or None)
    return UdpSender(bus.name, *_host_port(rest, "127.0.0.1", endpoint))


def write_endpoints(path: Path, endpoints: Mapping[str, str]) -> None:
    """Write the endpoints, ``{"format": "lacet-endpoints 1", "buses": {bus: endpoint}}``: a complete file or none."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(json.dumps({"format": FORMAT, "buses": dict(endpoints)}, indent=2) + "\n")
    os.replace(draft, path)


def ready_file(path: Path) -> Path:
    """The file beside `path` that a recorder writes once it listens on every wire named in `path`."""
    return path.with_name(path.name + ".ready")


def read_endpoints(path: Path) -> dict[str, str]:
    """The endpoints that `write_endpoints` wrote. Raises FileFault for any other file."""
    try:
        content = json.loads(path.read_text())
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}, not {FORMAT!r}")
        return {str(bus): str(endpoint) for bus, endpoint in content["buses"].items()}
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
        raise FileFault(path, [f"not an endpoints file as `lacet replay --endpoints` writes it: {error}"]) from None
