"""Samples of a run while it is recorded: its blocks from the bus, with those missed asked for."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import BusListener, Message, unpack_blocks
from lacet.daq.bus.marks import mark_text
from lacet.daq.bus.session import Keys
from lacet.daq.bus.spool import BLOCK_RATE, MOST_BLOCKS
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.wire import StartRecord, WireError, block_from_bytes, start_from_bytes
from lacet.daq.set_aside import DiskSpace, free_bytes
from lacet.services.acquisition.assembly import AHEAD, REQUEST, recorded_axes
from lacet.services.acquisition.block_store import BlockStore
from lacet.services.acquisition.log_medium import RESERVE_BYTES
from lacet.services.acquisition.sensor_monitor import SensorState

LEAST_FREE = 5 * RESERVE_BYTES
"""Least free space on the disk of temporary files at which samples are still put there [bytes]: a recorder that writes
to the same disk stops at `RESERVE_BYTES`."""
ATTEMPTS = 3
"""Answers in succession without a new block after which those that are missing are not there any more [count]."""
EVER = 2**63 - 1
"""Later than every stamp [ns]."""
_SOUND = (SensorState.RUNNING, SensorState.WAITING)


@dataclass(frozen=True)
class _Request:
    """Numbers of the blocks of a channel that are asked for.

    Attributes
    ----------
    came : those that came; `before` so many of them by earlier requests.
    vain : requests in succession that brought none.
    """

    channel: str
    first: int
    last: int
    came: set[int] = field(default_factory=set[int])
    before: int = 0
    vain: int = 0

    def take(self, channel: str, number: int) -> None:
        """Note that a block came."""
        if channel == self.channel and self.first <= number <= self.last:
            self.came.add(number)

    def again(self) -> _Request | None:
        """For what did not come, as on a busy machine an answer may be cut off; None where all came, or nothing will.

        What the recorder keeps no more comes in no answer, and is asked for `ATTEMPTS` times.
        """
        missing = [number for number in range(self.first, self.last + 1) if number not in self.came]
        vain = 0 if len(self.came) > self.before else self.vain + 1
        if not missing or vain == ATTEMPTS:
            return None
        return _Request(self.channel, missing[0], missing[-1], self.came, len(self.came), vain)


class LiveSamples:
    """The run that is recorded at present, as far as it has come over the bus; a later run takes its place.

    The last minute of each channel is in memory, what came before is on disk (`daq.set_aside`).

    Attributes
    ----------
    keys, start : of the run, and its start record; None before it came.
    latest_ns : stamp of its newest sample [ns].
    ledger : rates, losses and states of the sensors in the last second, as the recorder says.
    full : whether the disk has no room for more samples; those that come after `drop` are not stored.
    """

    def __init__(self, listener: BusListener):
        self._listener = listener
        self._alive: set[Keys] = set()
        self._take_run(None, None)

    def _take_run(self, keys: Keys | None, start: StartRecord | None) -> None:
        """Take this run, of which nothing is here yet."""
        self.keys, self.start = keys, start
        self.latest_ns = 0
        self.ledger: dict[str, Any] = {}
        self.full = self._dropped = False
        self._space = DiskSpace()
        self._channels: dict[str, BlockStore] = {}
        self._wanted: list[_Request] = []
        self._asked: _Request | None = None
        self._sought = False

    def blocks(self, from_ns: int = 0, to_ns: int = EVER) -> dict[str, Block]:
        """Channel → its samples in the order of their blocks, without blocks that end before or begin after [ns].

        The channels are in the order of their names, as those of a log: a fit draws their noise in this order.
        """
        found = {name: channel.read(from_ns, to_ns) for name, channel in sorted(self._channels.items())}
        return {name: block for name, block in found.items() if block is not None}

    def forget(self, before_ns: int) -> None:
        """Drop samples before a time [ns], which are not needed any more."""
        for channel in self._channels.values():
            channel.forget(before_ns)

    def drop(self) -> None:
        """Drop all samples, and store no more of this run."""
        self._dropped = True
        self._channels, self._wanted, self._space = {}, [], DiskSpace()

    def take(self, message: Message) -> None:
        """Process a message of the bus; what cannot be read, or is of another run than the present one, is left out."""
        try:
            if message.kind == "start":
                self._begin(message.keys, start_from_bytes(message.payload))
            elif message.kind == "alive":
                self._alive.add(message.keys)
            elif message.kind in ("gone", "manifest"):
                self._alive.discard(message.keys)
            if message.keys != self.keys:
                return
            if message.kind == "block":
                self._alive.add(message.keys)
                self._take_live(message)
            elif message.kind == "blocks":
                for number, body in unpack_blocks(message):
                    self._store(message.name, number, block_from_bytes(body)[0])
                    if self._asked is not None:
                        self._asked.take(message.name, number)
            elif message.kind == "answered":
                self._go_on()
            elif message.kind == "ledger":
                found = json.loads(message.payload)
                self.ledger = found if isinstance(found, dict) else {}
                self._seek()
        except (WireError, ValueError, RecursionError):
            pass
        self._ask()

    def _begin(self, keys: Keys, start: StartRecord) -> None:
        """Take a run that began later than the present one; earlier ones are offered while the next is recorded."""
        if self.start is None or (keys != self.keys and start.started_ns > self.start.started_ns):
            self._take_run(keys, start)

    def _take_live(self, message: Message) -> None:
        block, number = block_from_bytes(message.payload)
        if (block.channel, number) != (message.name, message.sequence) or not len(block) or self.start is None:
            return
        if number > AHEAD + BLOCK_RATE * 1e-9 * abs(int(block.t_ns[-1]) - self.start.started_ns):
            return
        if not self._dropped:
            end = self._channels.setdefault(message.name, BlockStore()).end
            for first in range(end, number, REQUEST):
                self._wanted.append(_Request(message.name, first, min(first + REQUEST, number) - 1))
        self._store(message.name, number, block)

    def _store(self, name: str, number: int, block: Block) -> None:
        if not (name in CHANNELS and block.channel == name and len(block) and 0 <= number < MOST_BLOCKS):
            return
        self.latest_ns = max(self.latest_ns, int(block.t_ns[-1]))
        if self._dropped:
            return
        try:
            if self._channels.setdefault(name, BlockStore()).add(number, block, self._space):
                self.full = self.full or free_bytes() < LEAST_FREE
        except OSError:
            self.full = True

    def _seek(self) -> None:
        """Ask for what the rig's sensors sent before, of a run whose sensors are all silent since this is here."""
        if self._channels or self._dropped or self._sought or self.start is None:
            return
        self._sought = True
        self._wanted += [_Request(name, 0, REQUEST - 1) for name in recorded_axes(self.start)]

    def _go_on(self) -> None:
        """After an answer, ask again for blocks that it had not; of sensors that are silent, for those after them."""
        asked, self._asked = self._asked, None
        if asked is None:
            return
        if (again := asked.again()) is not None:
            self._wanted.append(again)
        elif self._sought and asked.last in asked.came:
            self._wanted.append(_Request(asked.channel, asked.last + 1, asked.last + REQUEST))

    def _ask(self) -> None:
        """Ask for what was missed, one request at a time."""
        if self._asked is None and self._wanted and self.keys is not None:
            self._asked = asked = self._wanted.pop(0)
            self._listener.ask_blocks(self.keys, asked.channel, asked.first, asked.last)

    @property
    def recording(self) -> bool:
        """Whether the run's recorder is there."""
        return self.keys in self._alive

    @property
    def whole(self) -> bool:
        """Whether nothing that was missed is still being asked for."""
        return self._asked is None and not self._wanted


def sensor_states(ledger: dict[str, Any]) -> list[dict[str, str]]:
    """Name, state and detail of each sensor in a recorder's ledger; what is not in that form is left out."""
    found = ledger.get("sensors")
    if not isinstance(found, dict):
        return []
    return [
        {"name": str(name)[:80], "state": str(one.get("state", ""))[:20], "detail": str(one.get("detail", ""))[:200]}
        for name, one in found.items()
        if isinstance(one, dict)
    ]


def channel_faults(ledger: dict[str, Any]) -> dict[str, str]:
    """Channel → state of its sensor, of the channels at fault in a recorder's ledger; empty where all run."""
    found = ledger.get("sensors")
    return {
        str(channel): str(one.get("state", ""))[:20]
        for one in (found.values() if isinstance(found, dict) else [])
        if isinstance(one, dict) and isinstance(one.get("channels"), list) and one.get("state") not in _SOUND
        for channel in one["channels"]
    }


def marks_set(ledger: dict[str, Any], started_ns: int) -> list[dict[str, Any]]:
    """Text and seconds since the run's start of each marker in a recorder's ledger; invalid ones are left out."""
    found = ledger.get("marks")
    return [
        {"text": mark_text(str(one["text"])), "seconds": 1e-9 * (one["t_ns"] - started_ns)}
        for one in (found if isinstance(found, list) else [])
        if isinstance(one, dict) and "text" in one and isinstance(one.get("t_ns"), int)
    ]
