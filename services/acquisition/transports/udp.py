"""UDP transports over IPv4: one datagram is one frame."""

from __future__ import annotations

import socket
from itertools import pairwise

from lacet.daq.frames import Frames
from lacet.services.acquisition.transports.sockets import SocketReceiver, waiting_bytes

_ROOM = 256 << 10  # bytes waiting at a receiver up to which a sender at full speed continues


def udp_receiver(source: str, host: str, port: int) -> SocketReceiver:
    """Receiver of the datagrams sent to `port` at the address `host` of this machine (0.0.0.0: at any)."""

    def connect() -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.bind((host, port))
        except OSError as error:
            sock.close()
            raise OSError(error.errno, f"UDP {host}:{port}: {error.strerror}") from error
        return sock

    return SocketReceiver(source, connect, lambda data: (0, data))


class UdpSender:
    """Sender of each frame as one datagram to `host`:`port`; datagrams refused for want of a receiver are `unsent`."""

    def __init__(self, source: str, host: str, port: int):
        self.source = source
        self.unsent = 0
        self.sees_receivers = True
        self.endpoint = f"udp:{host}:{port}"
        self._to = (host, port)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Open the socket."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(self._to)

    def send(self, frames: Frames) -> None:
        """Send the frames, in order."""
        assert self._socket is not None
        data, offset = frames.data.tobytes(), frames.offset.tolist()
        for first, last in pairwise(offset):
            try:
                self._socket.send(data[first:last])
            except OSError:  # "port unreachable", in reply to an earlier datagram: that one is lost, this one unsent
                self.unsent += 1

    def has_room(self) -> bool:
        """Whether a receiver on this machine has read nearly everything so far."""
        return (waiting_bytes(self._to[1]) or 0) < _ROOM

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
