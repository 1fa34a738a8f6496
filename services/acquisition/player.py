"""Replay of a capture: its raw frames sent on the wires, in their own time or faster."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import count
from threading import Event

import numpy as np

from lacet.daq.frames import Frames
from lacet.services.acquisition.transports.base import Sender

TICK = 0.005
"""Period of sending [s]: frames due within it are sent together.

Sleeping for each frame would cost more than sending it. Arrival stamps at the receiver are late by at most this."""
_WINDOW_NS = 10_000_000  # capture time sent at once at full speed [ns]
_CAN_CEILING = 8_000  # frames/s; a 1 Mbit/s bus carries no more 8-byte frames, and SocketCAN shows no receiver's queue
_ROOM_PATIENCE = 2.0  # s; longest wait for a receiver that does not read


@dataclass
class Progress:
    """Progress of a replay.

    Attributes
    ----------
    sent, total : frames per pass.
    capture_seconds : position in the capture [s]; `capture_length`: its duration [s].
    late : delay of the last frames sent [s].
    rounds : passes completed.
    """

    sent: int = 0
    total: int = 0
    capture_seconds: float = 0.0
    capture_length: float = 0.0
    late: float = 0.0
    rounds: int = 0


def replay(
    frames: Mapping[str, Frames],
    senders: Mapping[str, Sender],
    speed: float | None = 1.0,
    loop: bool = False,
    stop: Event | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Send frames on open senders, each source in its own order, the sources synchronised.

    Parameters
    ----------
    frames, senders : by bus name; every source has a sender.
    speed : factor on the capture's own time; None for the highest speed without loss at receivers on this machine.
    loop : begin again at the end until `stop` is set.
    stop : ends the replay when set.
    report : called about four times a second.
    """
    stop = stop or Event()
    frames = {source: batch for source, batch in frames.items() if len(batch)}
    progress = Progress(total=sum(map(len, frames.values())))
    if not frames:
        return progress
    # A frame whose stamp steps back is sent with the one before it: the order on the wire is that in the capture.
    due = {source: np.maximum.accumulate(batch.t_ns) for source, batch in frames.items()}
    first_ns = min(int(times[0]) for times in due.values())
    last_ns = max(int(times[-1]) for times in due.values())
    progress.capture_length = (last_ns - first_ns) / 1e9
    report = _now_and_then(report)
    for rounds in count(1):
        _one_pass(frames, due, senders, (first_ns, last_ns), speed, stop, progress, report)
        if stop.is_set():
            break
        progress.rounds = rounds
        if not loop:
            break
        progress.sent = 0
    return progress


def _now_and_then(report: Callable[[Progress], None]) -> Callable[[Progress], None]:
    """`report`, called at most four times a second."""
    reported = time.monotonic()

    def seldom(progress: Progress) -> None:
        nonlocal reported
        now = time.monotonic()
        if now - reported >= 0.25:
            reported = now
            report(progress)

    return seldom


def _one_pass(
    frames: Mapping[str, Frames],
    due: Mapping[str, np.ndarray],
    senders: Mapping[str, Sender],
    span: tuple[int, int],
    speed: float | None,
    stop: Event,
    progress: Progress,
    report: Callable[[Progress], None],
) -> None:
    first_ns, last_ns = span
    position = dict.fromkeys(frames, 0)
    started = time.monotonic()
    now_ns = first_ns - 1
    while not stop.is_set():
        now = time.monotonic()
        if speed is None:
            _wait_for_room(senders, stop)
            now_ns += _WINDOW_NS
        else:
            now_ns = first_ns + int((now - started) * speed * 1e9)
        sent = progress.sent
        for source, batch in frames.items():
            begin = position[source]
            end = int(np.searchsorted(due[source], now_ns, side="right"))
            if end > begin:
                senders[source].send(batch[begin:end])
                if speed is not None:
                    progress.late = (now_ns - int(due[source][begin])) / 1e9 / speed
                position[source] = end
                progress.sent += end - begin
        progress.capture_seconds = (min(now_ns, last_ns) - first_ns) / 1e9
        report(progress)
        if now_ns >= last_ns:
            return
        if speed is not None:
            stop.wait(max(0.0, now + TICK - time.monotonic()))
        elif not all(sender.sees_receivers for sender in senders.values()):
            stop.wait(max(0.0, now + (progress.sent - sent) / _CAN_CEILING - time.monotonic()))


def _wait_for_room(senders: Mapping[str, Sender], stop: Event) -> None:
    until = time.monotonic() + _ROOM_PATIENCE
    while not all(sender.has_room() for sender in senders.values()):
        if stop.wait(0.001) or time.monotonic() > until:
            return
