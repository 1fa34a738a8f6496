"""Live state of the recording, channel by channel, from the bus."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from lacet.daq.bus.credentials import Credentials
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.marks import set_mark
from lacet.daq.bus.session import open_session
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError, UsageError, nearest
from lacet.daq.formats.result import plain
from lacet.daq.formats.wire import StartRecord, WireError, block_from_bytes, start_from_bytes
from lacet.daq.rig import Rig
from lacet.services.acquisition.live_samples import channel_faults, marks_set, sensor_states
from lacet.services.render.live_page import channel_state, channels_text, first_steps
from lacet.services.workbench.events import Events
from lacet.services.workbench.help_pages import CAPTURES
from lacet.services.workbench.live_curves import LiveCurve
from lacet.services.workbench.packed_arrays import packed

PERIOD = 1.0
"""Period of the events to the pages [s]."""
WINDOW = 5.0
"""Duration over which rates are measured [s]."""
GONE = 30.0
"""Silence after which a run is no longer shown as recording [s]."""
AGAIN = 2.0
"""Time between attempts to reach the router [s]."""


@dataclass
class _Heard:
    """Counts of one channel: blocks of the last `WINDOW` as (stamp of their end [ns], samples, flagged)."""

    blocks: deque[tuple[int, int, int]] = field(default_factory=deque[tuple[int, int, int]])
    samples: int = 0
    flagged: int = 0
    next: int = 0
    missed: int = 0
    at: float = 0.0
    curve: LiveCurve = field(default_factory=LiveCurve)


class Live:
    """Listener to a router, if given, in a thread of its own; `endpoint` like ``tls/10.0.0.7:7447``."""

    def __init__(self, endpoint: str | None, events: Events, credentials: Credentials | None = None):
        self._credentials = credentials
        self.endpoint, self._events = endpoint, events
        self._stop, self._lock = threading.Event(), threading.Lock()
        self._connected, self._why = False, ""
        self._run, self._car, self._about = "", "", dict[str, Any]()
        self._recording, self._last = False, 0.0
        self._heard: dict[str, _Heard] = {}
        self._ledger: dict[str, Any] = {}
        self._session: zenoh.Session | None = None
        self._thread = None
        if endpoint:
            self._thread = threading.Thread(target=self._listen, name="lacet-live", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        if self._thread:
            self._thread.join(5.0)

    def payload(self) -> dict[str, Any]:
        """The present state as plain data."""
        now = time.monotonic()
        with self._lock:
            recording = self._recording and now - self._last < GONE
            faults = channel_faults(self._ledger)
            channels = [
                self._channel(name, heard, now, recording, faults.get(name, ""))
                for name, heard in sorted(self._heard.items())
            ]
            return plain(
                {
                    "connected": self._connected, "endpoint": self.endpoint, "why": self._why,
                    "run": self._run or None, "rig": self._car or None, "recording": recording, **self._about,
                    "channels": channels,
                    "channels_text": channels_text([one["state"] for one in channels], recording),
                    "steps": [] if self._run else first_steps(self.endpoint, _example(), self._why),
                    "losses": self._ledger.get("losses", {}), "down": self._ledger.get("down", []),
                    "seconds": self._ledger.get("seconds"), "sensors": sensor_states(self._ledger),
                    "marks": marks_set(self._ledger, int(self._about.get("started_ns") or 0)),
                }
            )  # fmt: skip

    def curves(self, names: Sequence[str]) -> bytes:
        """The last seconds of some channels as a binary answer; what has not been heard is empty."""
        arrays: dict[str, NDArray[np.float64]] = {}
        channels: dict[str, Any] = {}
        with self._lock:
            start = int(self._about.get("started_ns") or 0)
            for name in names:
                about = CHANNELS.get(name)
                if about is None:
                    raise UsageError(f"there is no channel '{name}'{nearest(name, CHANNELS)}")
                heard = self._heard.get(name)
                parts = about.components or ("value",)
                t, series = (heard.curve if heard else LiveCurve()).series(start, parts)
                arrays |= {f"{name} t": t} | {f"{name}.{part}": one for part, one in zip(parts, series, strict=True)}
                channels[name] = {
                    "unit": about.unit,
                    "t": f"{name} t",
                    "parts": {part: f"{name}.{part}" for part in parts},
                }
            return packed(arrays, run=self._run, channels=channels)

    def mark(self, text: str) -> dict[str, Any]:
        """Set a marker, now, in the recording shown; its run, text and time. Raises UsageError when none has it."""
        with self._lock:
            session, car, run = self._session, self._car, self._run
        if session is None or not run:
            raise UsageError("no recording is heard: start lacet record, and lacet ui with its address (--connect)")
        found = set_mark(session, text, car, run)
        if not found:
            raise UsageError("the recorder did not answer: the run is over, or its link is cut; set the marker again")
        return found[0]

    def _channel(self, name: str, heard: _Heard, now: float, recording: bool, fault: str) -> dict[str, Any]:
        about = CHANNELS.get(name)
        span = 1e-9 * (heard.blocks[-1][0] - heard.blocks[0][0]) if len(heard.blocks) > 1 else 0.0
        counted = sum(n for _, n, _ in list(heard.blocks)[1:])
        rate = counted / span if span > 0.0 else None
        expected = about.rate if about else None
        age = now - heard.at if heard.samples else None
        return {
            "name": name, "unit": about.unit if about else "", "rate": rate, "expected": expected, "age": age,
            "samples": heard.samples, "flagged": heard.flagged, "losses": heard.missed,
            "state": channel_state(age, rate, expected, heard.flagged, heard.missed, recording, fault),
        }  # fmt: skip

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        assert self.endpoint is not None
        while not self._stop.is_set():
            try:
                session = open_session((), (self.endpoint,), 1.0, self._credentials)
            except UsageError as error:
                with self._lock:
                    self._connected, self._why = False, str(error)
                self._stop.wait(AGAIN)
                continue
            try:
                listener = BusListener(session)
                with self._lock:
                    self._connected, self._why, self._session = True, "", session
                self._follow(listener)
                listener.close()
            finally:
                with self._lock:
                    self._session = None
                session.close()

    def _follow(self, listener: BusListener) -> None:
        sent = 0.0
        while not self._stop.is_set():
            message = listener.get(0.1)
            if message is not None:
                with self._lock:
                    self.take(message)
            if time.monotonic() - sent >= PERIOD and self._last:
                sent = time.monotonic()
                self._events.publish("live", self.payload())

    def take(self, message: Message) -> None:
        """Process a message of the bus; those of a run older than the present one are ignored."""
        if message.kind == "result":
            return
        if message.keys.run != self._run:
            heard = self._recording and time.monotonic() - self._last < GONE
            # While one is heard, only another that sends blocks takes its place: earlier runs are offered meanwhile.
            if message.kind not in (("block",) if heard else ("start", "alive", "block")):
                return
            self._run, self._car = message.keys.run, message.keys.car
            self._heard, self._ledger, self._about = {}, {}, {}
        self._last = time.monotonic()
        try:
            if message.kind == "block":
                self._block(message)
                self._recording = True
            elif message.kind == "start":
                start = start_from_bytes(message.payload)
                self._about = {"vehicle": start.vehicle, "manoeuvre": start.manoeuvre, "started_ns": start.started_ns}
                for name in _promised(start):
                    self._heard.setdefault(name, _Heard())
            elif message.kind == "ledger":
                ledger = json.loads(message.payload)
                self._ledger = ledger if isinstance(ledger, dict) else {}
            elif message.kind == "alive":
                self._recording = True
            elif message.kind in ("gone", "manifest"):
                self._recording = False
        except (
            WireError,
            ValueError,
            RecursionError,
        ):  # messages that cannot be read are not shown; the recorder's log is complete
            pass

    def _block(self, message: Message) -> None:
        block, _ = block_from_bytes(message.payload)
        heard = self._heard.setdefault(block.channel, _Heard())
        if not heard.samples:  # blocks before the first one received do not count as missed
            heard.next = message.sequence
        heard.missed += max(0, message.sequence - heard.next)
        heard.next = max(heard.next, message.sequence + 1)
        flagged = int(np.count_nonzero(block.flags))
        heard.samples += len(block)
        heard.curve.take(block)
        heard.flagged += flagged
        heard.at = time.monotonic()
        end = int(block.t_ns[-1]) if len(block) else 0
        heard.blocks.append((end, len(block), flagged))
        while heard.blocks and end - heard.blocks[0][0] > WINDOW * 1e9:
            heard.blocks.popleft()


def _example() -> Path | None:
    """A capture that can be played; None in an installation without."""
    found = CAPTURES / "sinus.mcap"
    return found if found.is_file() else None


def _promised(start: StartRecord) -> list[str]:
    """Channels of the sensors in the rig of a run, so that one without samples is shown as silent."""
    try:
        rig = Rig.parse(start.rig_text, "rig of the run")
    except (LacetError, RecursionError):
        return []
    return [name for sensor in rig.sensors if sensor.driver and sensor.bus for name in sensor.channels]
