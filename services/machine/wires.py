"""The wires of this computer: CAN interfaces, serial ports and the buffer of its sockets; and those a rig names."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping
from pathlib import Path

from serial.tools.list_ports import comports

from lacet.daq.rig import Bus
from lacet.services.acquisition.transports.sockets import RECEIVE_BUFFER
from lacet.services.machine.finding import Finding, State

ARPHRD_CAN = 280  # linux/if_arp.h: the type of a network interface that is a CAN bus
BITRATE = 500_000
"""Bit rate in a remedy where no rig names one [bit/s]."""


def can_interfaces(networks: Path = Path("/sys/class/net")) -> dict[str, bool]:
    """The CAN interfaces of this computer by name, and whether each is up. Empty where the system has no SocketCAN."""
    out: dict[str, bool] = {}
    for folder in sorted(networks.iterdir()) if networks.is_dir() else []:
        try:
            if int((folder / "type").read_text()) == ARPHRD_CAN:
                out[folder.name] = bool(int((folder / "flags").read_text(), 16) & 1)  # IFF_UP
        except (OSError, ValueError):
            continue
    return out


def can_findings(found: Mapping[str, bool], asked: Mapping[str, int], kernel_has_it: bool) -> list[Finding]:
    """Findings on CAN.

    Parameters
    ----------
    found : interface → whether it is up.
    asked : interfaces that a rig names → bit rate [bit/s].
    kernel_has_it : whether this system has SocketCAN at all.
    """
    out = [
        Finding(f"CAN {name}", State.OK, "is up")
        if up
        else Finding(f"CAN {name}", State.WARNING, "is down", _up(name, asked.get(name, BITRATE)))
        for name, up in found.items()
    ]
    for name in asked.keys() - found.keys():
        remedy = (
            f"plug the adapter in, then {_up(name, asked[name])}; on the bench lacet replay needs none"
            if kernel_has_it
            else "record on Linux: lacet reads CAN through its SocketCAN; on the bench lacet replay needs none"
        )
        out.append(Finding(f"CAN {name}", State.WARNING, "the rig names it, and it is not there", remedy))
    if not out and kernel_has_it:
        says = "no interface: needed to record a bus, not for replays and logs"
        out.append(Finding("CAN", State.ABSENT, says, f"plug an adapter in, then {_up('can0', BITRATE)}"))
    elif not out:
        says = "no SocketCAN on this system: needed to record a bus, not for replays and logs"
        out.append(Finding("CAN", State.ABSENT, says, "record on a Linux computer"))
    return sorted(out, key=lambda one: one.name)


def _up(name: str, bitrate: int) -> str:
    """The command that brings an interface up."""
    if name.startswith("vcan"):
        return f"sudo ip link set {name} up"
    return f"sudo ip link set {name} up type can bitrate {bitrate}"


def serial_findings(
    ports: Mapping[str, str], asked: Mapping[str, str], may_use: Callable[[str], bool], group_of: Callable[[str], str]
) -> list[Finding]:
    """Findings on serial ports.

    Parameters
    ----------
    ports : device → what is plugged in.
    asked : devices that a rig names → the bus.
    may_use : whether this user may read and write a device.
    group_of : the group that may; empty where the system has none.
    """
    out: list[Finding] = []
    for device, about in {**dict.fromkeys(asked, ""), **ports}.items():
        name = f"serial {device}"
        if device not in ports and not Path(device).exists():
            says = f"bus {asked[device]} of the rig names it, and it is not there"
            remedy = "plug the instrument in, or name its device: lacet record --from BUS=serial:DEVICE"
            out.append(Finding(name, State.WARNING, says, remedy))
        elif may_use(device):
            out.append(Finding(name, State.OK, about or "there"))
        else:
            group = group_of(device)
            remedy = f"sudo usermod -aG {group} $USER, then log in again" if group not in ("", "root") else "use sudo"
            out.append(Finding(name, State.WARNING, "this user may not read and write it", remedy))
    if not out:
        says = "no port: needed to record a serial instrument"
        out.append(Finding("serial", State.ABSENT, says, "plug its adapter in"))
    return out


def udp_findings(asked: Mapping[str, int]) -> list[Finding]:
    """Findings on the UDP ports that a rig names (bus → port): whether each is free to listen at."""
    out: list[Finding] = []
    for bus, port in asked.items():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
                out.append(Finding(f"UDP {port}", State.OK, f"is free for bus {bus}"))
            except OSError as error:
                remedy = f"end the other program, or take another: lacet record --from {bus}=udp:HOST:PORT"
                out.append(Finding(f"UDP {port}", State.WARNING, f"bus {bus}: {error.strerror}", remedy))
    return out


def receive_buffer(limit: Path = Path("/proc/sys/net/core/rmem_max")) -> list[Finding]:
    """Finding on the largest buffer a socket may have; none where the system does not say."""
    try:
        most = int(limit.read_text())
    except (OSError, ValueError):
        return []
    if most >= RECEIVE_BUFFER:
        return [Finding("large socket buffer", State.OK, f"up to {most >> 10} KiB")]
    says = f"at most {most >> 10} KiB: a recording of more than 10,000 frames/s loses some when the machine is busy"
    return [Finding("large socket buffer", State.ABSENT, says, f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER}")]


def wires(buses: Mapping[str, Bus]) -> list[Finding]:
    """All findings on wires; `buses` : those of a rig, or none."""
    can = {bus.name: bus.bitrate or BITRATE for bus in buses.values() if bus.kind == "can"}
    serial = {bus.device: bus.name for bus in buses.values() if bus.kind == "serial" and bus.device}
    udp = {bus.name: bus.port for bus in buses.values() if bus.kind == "udp" and bus.port}
    ports = {port.device: port.description.replace("n/a", "") for port in comports()}
    return [
        *can_findings(can_interfaces(), can, hasattr(socket, "AF_CAN")),
        *serial_findings(ports, serial, lambda device: os.access(device, os.R_OK | os.W_OK), _group_of),
        *udp_findings(udp),
        *receive_buffer(),
    ]


def _group_of(device: str) -> str:
    """The group of a device; empty on a system without groups, or where there is none of that number."""
    try:
        return Path(device).group()
    except (NotImplementedError, KeyError, OSError):
        return ""
