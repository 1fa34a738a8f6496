"""Load of a bus: the part of the time in which frames are on the wire."""

from __future__ import annotations

import numpy as np

from lacet.daq.frames import EXTENDED, STANDARD, Frames
from lacet.daq.rig import Bus

_CLASSIC = (
    8  # bytes; longer payloads are CAN FD, whose data may be sent at another bit rate, which the rig does not name
)
_STANDARD_BITS, _EXTENDED_BITS, _BYTE_BITS = 55, 80, 10
_SERIAL_BITS = 10


def wire_bits(bus: Bus, frames: Frames) -> int | None:
    """Bits that frames take on the wire, the gap between them included; None where the rig does not say.

    CAN: at most, with every bit stuffed that may be, 55 (identifiers of 29 bits: 80) and 10 for each byte, as
    `canbusload` of can-utils counts in the worst case; the true load is a fifth less as a rule. Serial: 10 a byte, 8N1.
    """
    if bus.kind == "serial":
        return _SERIAL_BITS * len(frames.data)
    if bus.kind != "can" or (len(frames) and int(frames.lengths.max()) > _CLASSIC):
        return None
    long = int(np.count_nonzero((frames.ident > STANDARD) | (frames.ident & np.uint32(EXTENDED) != 0)))
    return _STANDARD_BITS * (len(frames) - long) + _EXTENDED_BITS * long + _BYTE_BITS * len(frames.data)


class BusLoad:
    """Meter of the load of each bus of a rig whose bit rate is known."""

    def __init__(self, buses: dict[str, Bus]):
        self._rates = {name: rate for name, bus in buses.items() if (rate := bus.bitrate or bus.baud)}
        self._buses = buses
        self._bits = dict.fromkeys(self._rates, 0)

    def add(self, frames: Frames) -> None:
        """Count received frames."""
        if frames.source not in self._bits:
            return
        bits = wire_bits(self._buses[frames.source], frames)
        if bits is None:
            del self._bits[frames.source]
        else:
            self._bits[frames.source] += bits

    def take(self, seconds: float) -> dict[str, float]:
        """Load of each bus, 0 to 1, over the `seconds` since the last call."""
        found = {name: bits / (self._rates[name] * seconds) for name, bits in self._bits.items()}
        self._bits = dict.fromkeys(self._bits, 0)
        return found
