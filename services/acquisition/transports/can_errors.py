"""Error frames of SocketCAN: what the controller reports of its bus, by class, with the remedy."""

from __future__ import annotations

import struct
from enum import StrEnum

_HEAD = struct.Struct("=IB3x8s")  # struct can_frame
_ERROR = 0x2000_0000  # linux/can.h: CAN_ERR_FLAG
_CONTROLLER = 0x004  # linux/can/error.h: CAN_ERR_CRTL; data[1] says what
_OVERFLOW, _WARNING, _PASSIVE = 0x01 | 0x02, 0x04 | 0x08, 0x10 | 0x20


class BusError(StrEnum):
    """Class of an error frame, which is its cause in the ledger."""

    TIMEOUT = "tx_timeout"
    PROTOCOL = "protocol_error"
    TRANSCEIVER = "transceiver"
    NO_ACK = "no_ack"
    BUS_OFF = "bus_off"
    BUS_ERROR = "bus_error"
    RESTARTED = "restarted"
    OVERFLOW = "controller_overflow"
    WARNING = "error_warning"
    PASSIVE = "error_passive"


_CLASSES = {
    0x001: BusError.TIMEOUT,
    0x008: BusError.PROTOCOL,
    0x010: BusError.TRANSCEIVER,
    0x020: BusError.NO_ACK,
    0x040: BusError.BUS_OFF,
    0x080: BusError.BUS_ERROR,
    0x100: BusError.RESTARTED,
}
MASK = _CONTROLLER | sum(_CLASSES)
"""Classes that a socket asks for: all but lost arbitration, which is no error."""

SAYS = {
    BusError.TIMEOUT: "the controller could not send in time",
    BusError.PROTOCOL: "frames with errors on the bus: check bit rate, termination (60 Ω between the wires) and cables",
    BusError.TRANSCEIVER: "the transceiver reports a fault of the wires: check for a break or a short circuit",
    BusError.NO_ACK: "nobody acknowledges what is sent: no other station is on the bus, or at another bit rate",
    BusError.BUS_OFF: (
        "bus-off: after too many errors the controller has left the bus, and nothing comes until it is restarted: "
        "sudo ip link set {interface} type can restart; by itself with: "
        "sudo ip link set {interface} type can restart-ms 100"
    ),
    BusError.BUS_ERROR: "errors on the bus: check bit rate, termination (60 Ω between the wires) and cables",
    BusError.RESTARTED: "the controller was restarted",
    BusError.OVERFLOW: "frames are lost in the controller's buffer: the machine is too busy, or the adapter too slow",
    BusError.WARNING: "many errors on the bus (error warning): check bit rate, termination and cables",
    BusError.PASSIVE: "too many errors on the bus (error passive): bus-off is next; check bit rate and cables",
}  # fmt: skip
"""Class → sentence, with the remedy."""


def error_classes(data: bytes) -> tuple[BusError, ...]:
    """Classes of an error frame, a ``struct can_frame``; none for a frame that is not one."""
    if len(data) != _HEAD.size:
        return ()
    ident, _, content = _HEAD.unpack(data)
    if not ident & _ERROR:
        return ()
    found = [name for bit, name in _CLASSES.items() if ident & bit]
    if ident & _CONTROLLER:
        states = ((_OVERFLOW, BusError.OVERFLOW), (_WARNING, BusError.WARNING), (_PASSIVE, BusError.PASSIVE))
        found += [name for bits, name in states if content[1] & bits]
    return tuple(found)
