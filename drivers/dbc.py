"""Driver of any CAN bus by its owner's DBC: channels as expressions over its signals. Format: ``docs/rig.md``.

Nothing is asked of the bus that it need not have: a counter, a checksum or a status is used where the rig names it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import UNUSABLE, Block, Flag
from lacet.daq.can_signal import WORD
from lacet.daq.errors import RigError
from lacet.daq.frames import PUT_BACK, Frames, full_idents
from lacet.daq.maps.assembly import Assembly, ChannelPiece
from lacet.daq.maps.channel_map import ChannelMap, MapError
from lacet.daq.maps.resolution import Key, in_si, resolved
from lacet.daq.shared_stamps import one_by_one
from lacet.daq.sources.dbc_messages import BusMessage, BusSignal, Senders, parse_dbc
from lacet.daq.sources.source import Series
from lacet.daq.text_source import is_file
from lacet.drivers.framework.base import Reader
from lacet.drivers.framework.can_layout import read_layout
from lacet.drivers.framework.counters import add
from lacet.drivers.framework.message_checks import MessageChecks, Signals, read_checks
from lacet.drivers.framework.message_order import MessageFrames, MessageState, followed
from lacet.drivers.framework.options import check_options
from lacet.drivers.framework.turns import Pace

PATIENCE = 2.0
"""Longest distance of the next sample of a component in another message [s], by which a channel may be late."""
OPTIONS = ("dbc", "signals", "sources", "counter", "checksum", "status")
_COUNTS = (
    "received", "samples", "lost", "bad_checksum", "incomplete", "bad_status", "repeated", "reordered", "restarts",
    "out_of_order", "other_sender", "no_neighbour",
)  # fmt: skip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Used:
    """A message in use: what is asked of it, and its signals in use, each with the series made of it."""

    message: BusMessage
    checks: MessageChecks
    signals: tuple[tuple[BusSignal, tuple[Key, ...]], ...]

    def too_short(self, lengths: NDArray[np.int64]) -> int:
        """How many frames end before a signal; of a multiplexed message it is not known which signals each has."""
        if any(one.needs for one, _ in self.signals):
            return 0
        return int(np.count_nonzero(lengths < max(one.bytes_needed for one, _ in self.signals)))


_NEVER = int(np.iinfo(np.int64).min)


@dataclass(frozen=True)
class DbcState:
    """State between batches: stamp that is time 0, and the latest one [ns], incomplete samples by channel, last stamp
    of each message, as received and behind those it shares, its frames and senders, and ledger."""

    origin_ns: int | None
    front_ns: int | None
    channels: tuple[Assembly, ...]
    last_ns: tuple[tuple[int, int], ...]
    messages: tuple[MessageState, ...]
    senders: tuple[Senders, ...]
    ledger: Mapping[str, int]


class Dbc(Reader):
    """Decoder of the messages of a DBC file; it sends nothing.

    Raises
    ------
    DbcError : the DBC file is missing or cannot be read.
    RigError : with every fault of the row's ``signals``, ``sources``, ``counter``, ``checksum`` and ``status``.
    """

    name: str = "dbc"

    def __init__(
        self,
        bus: str,
        options: Mapping[str, Any] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        options = options or {}
        check_options(self.name, options, OPTIONS)
        lacking = [key for key in ("dbc", "signals") if not options.get(key)]
        if lacking:
            form = 'dbc = "car.dbc", signals = { "imu.accel.y" = "LatAcc" }'
            raise RigError(f"driver '{self.name}'", [f"{key}: is missing ({form})" for key in lacking])
        self.bus = bus
        file, text = read_layout(options["dbc"], folder, documents or {})
        self.documents: dict[str, str] = {file: text} | _tables(options["signals"], folder, documents or {})
        signals: Signals = {
            f"{message.name}.{signal.name}": (message, signal)
            for message in parse_dbc(text, file)
            for signal in message.signals
        }
        self._channels = self._recipes(options, signals, folder, file)
        faults: list[str] = []
        checks = read_checks(options, signals, faults)
        if faults:
            raise RigError(f"driver '{self.name}'", [fault.replace("the file has", f"{file} has") for fault in faults])
        self.channels: tuple[str, ...] = tuple(one.channel.name for one in self._channels)
        keys: dict[str, dict[str, dict[Key, None]]] = {}
        for one in self._channels:
            for key in one.series:
                message, _ = signals[key.name]
                keys.setdefault(message.name, {}).setdefault(key.name, {})[key] = None
        self._used = tuple(
            _Used(
                next(signals[name][0] for name in named), checks.get(message, MessageChecks()),
                tuple((signals[name][1], tuple(those)) for name, those in named.items()),
            )
            for message, named in keys.items()
        )  # fmt: skip

        self.notes: tuple[str, ...] = tuple(
            note for one in self._used for note in one.message.overlapping({signal.name for signal, _ in one.signals})
        )

    def _recipes(
        self, options: Mapping[str, Any], signals: Signals, folder: Path | None, file: str
    ) -> tuple[Assembly, ...]:
        """The channels to be made. Raises RigError with every fault."""
        place = f"driver '{self.name}'"
        files = {name: text.encode() for name, text in self.documents.items()}
        try:
            map_ = ChannelMap.of_tables(options, place, folder, files)
        except MapError as cause:
            raise RigError(place, cause.faults) from None
        timed = [name for name, said in map_.sources.items() if said.time]
        found = resolved(map_, {name: signal.signal.unit for name, (_, signal) in signals.items()})
        faults = [f"sources.{name}.time: the frames of a bus have their own stamps; remove it" for name in timed]
        faults += [f"signals: {why}".replace("the file has", f"{file} has") for why in found.lacking.values()]
        if faults:
            raise RigError(place, faults)
        return tuple(Assembly(*one, patience=PATIENCE) for one in found.recipes)

    def start(self) -> DbcState:
        """State before the first frame."""
        n, channels = len(self._used), tuple(one.copy() for one in self._channels)
        last, ledger = ((_NEVER, _NEVER),) * n, dict.fromkeys(_COUNTS, 0)
        return DbcState(None, None, channels, last, (MessageState(),) * n, (Senders(),) * n, ledger)

    def decode(self, frames: Frames, state: DbcState) -> tuple[list[Block], DbcState]:
        """Blocks of a batch, without the frames of other messages, and the state after it.

        A sample has the stamp of its first component's frame; one whose other components come in other messages waits
        for those.
        """
        blocks: dict[str, list[Block]] = {}
        while len(frames):
            front = frames.t_ns[0] if state.front_ns is None else state.front_ns
            latest = np.maximum(np.maximum.accumulate(frames.t_ns), front)
            back = np.flatnonzero(frames.t_ns < latest - np.int64(PUT_BACK * 1e9))
            end = int(back[0]) if len(back) else len(frames)
            if end:
                made, state = self._decoded(frames[:end], state, np.append(latest[:end], latest[end - 1]))
                _collect(blocks, made)
            if len(back):  # the clock was put back
                made, state = self.finish(state)
                _collect(blocks, made)
                again = tuple(replace(one, pace=Pace()) for one in state.messages)
                state = replace(self.start(), messages=again, senders=state.senders, ledger=state.ledger)
            frames = frames[end:]
        return [Block.concat(parts) for parts in blocks.values()], state

    def finish(self, state: DbcState) -> tuple[list[Block], DbcState]:
        """Blocks at the end of the stream: what was held back, and samples that still lack components, which have no
        value."""
        front = np.array([_NEVER if state.front_ns is None else state.front_ns])
        held, state = self._decoded(Frames.empty(self.bus), state, front, ended=True)
        channels = tuple(one.copy() for one in state.channels)
        rest, state = self._made([one.feed({}, last=True) for one in channels], replace(state, channels=channels))
        blocks: dict[str, list[Block]] = {}
        _collect(blocks, held)
        _collect(blocks, rest)
        return [Block.concat(parts) for parts in blocks.values()], state

    def counts(self, state: DbcState) -> dict[str, int]:
        """The ledger. ``received``, ``lost``, ``bad_checksum``, ``incomplete`` (too short), ``repeated`` and
        ``reordered`` (by a counter), ``restarts`` (of a counter, or it stands still), ``out_of_order`` (by stamps) and
        ``other_sender`` (of a J1939 message, not used) count frames; ``bad_status`` samples, and ``no_neighbour`` those
        around which another component has none."""
        return dict(state.ledger)

    def remarks(self, state: DbcState) -> tuple[str, ...]:
        """J1939 messages that come from several senders, and counters that do not count."""
        notes = [one.note(used.message) for used, one in zip(self._used, state.senders, strict=True)]
        for used, one in zip(self._used, state.messages, strict=True):
            if used.checks.counter is not None and one.stood is not None and one.stood > 1:
                name, value = used.checks.counter.name, one.counter.last
                notes.append(
                    f"counter {name} of message {used.message.name} stands at {value} in all {one.stood:,} frames: it "
                    "does not count and shows no loss; correct 'counter' in the rig"
                )
        return tuple(note for note in notes if note)

    def _decoded(
        self, frames: Frames, state: DbcState, latest: NDArray[np.int64], ended: bool = False
    ) -> tuple[list[Block], DbcState]:
        """Blocks of frames, and of those held back; `latest` (N + 1,): latest stamp up to each and to the end [ns]."""
        origin = state.origin_ns if state.origin_ns is not None or not len(frames) else int(frames.t_ns[0])
        idents = full_idents(frames.ident)
        last, messages, senders, ledger = list(state.last_ns), list(state.messages), list(state.senders), state.ledger
        pieces: dict[Key, Series] = {}
        for i, used in enumerate(self._used):
            mine = np.flatnonzero(used.message.of(idents))
            if not len(mine) and messages[i].waits_from is None:
                continue
            ours, senders[i] = state.senders[i].then(used.message, idents[mine])
            ledger = add(ledger, received=len(mine), other_sender=np.count_nonzero(~ours))
            mine = mine[ours]
            t_ns = frames.t_ns[mine]
            # Adapters stamp what came in one transfer alike.
            later = t_ns >= np.maximum.accumulate(np.concatenate(([last[i][0]], t_ns)))[:-1]
            ledger = add(ledger, out_of_order=np.count_nonzero(~later))
            mine, received_ns = mine[later], t_ns[later]
            t_ns = one_by_one(received_ns, last[i][1])
            last[i] = (int(received_ns[-1]), int(t_ns[-1])) if len(mine) else last[i]
            payload = used.message.fitted(_rows(frames, mine, used.message.width))
            received = MessageFrames(payload, frames.lengths[mine], t_ns)
            front = latest[np.append(mine, len(latest) - 1)]
            made, flags, messages[i], ledger = followed(received, front, ended, used.checks, messages[i], ledger)
            if len(flags):
                ledger = add(ledger, incomplete=used.too_short(made.lengths))
                pieces |= _series(used, made.payload, made.lengths, (made.t_ns - (origin or 0)) / 1e9, flags)
        channels = tuple(one.copy() for one in state.channels)
        # Frames held back are still to come.
        front_ns = min([int(latest[-1]), *(one.waits_from for one in messages if one.waits_from is not None)])
        made = [one.feed(pieces, front=(front_ns - (origin or 0)) / 1e9) for one in channels]
        state = DbcState(origin, int(latest[-1]), channels, tuple(last), tuple(messages), tuple(senders), ledger)
        return self._made(made, state)

    @staticmethod
    def _made(pieces: list[ChannelPiece | None], state: DbcState) -> tuple[list[Block], DbcState]:
        blocks = [
            Block(one.channel, (state.origin_ns or 0) + np.rint(one.t * 1e9).astype(np.int64), one.values, one.flags)
            for one in pieces
            if one is not None and len(one.t)
        ]
        flags = np.concatenate([np.zeros(0, np.uint8), *(block.flags for block in blocks)])
        alone, status = (np.count_nonzero(flags & np.uint8(flag)) for flag in (Flag.INCOMPLETE, Flag.STATUS))
        return blocks, replace(
            state, ledger=add(state.ledger, samples=len(flags), no_neighbour=alone, bad_status=status)
        )


def _collect(blocks: dict[str, list[Block]], made: list[Block]) -> None:
    for block in made:
        blocks.setdefault(block.channel, []).append(block)


def _tables(signals: Any, folder: Path | None, documents: Mapping[str, str]) -> dict[str, str]:
    """Lookup tables that the signals name: as recorded, else beside the rig file; a missing one is a fault later."""
    out: dict[str, str] = {}
    todo = [signals]
    while todo:
        entry = todo.pop()
        if not isinstance(entry, dict):
            continue
        name = entry.get("table")
        if not isinstance(name, str):
            todo += entry.values()
        elif name in documents:
            out[name] = documents[name]
        elif folder is not None and is_file(folder / name):
            out[name] = (folder / name).read_bytes().decode("utf-8", "replace")
    return out


def _rows(frames: Frames, mine: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """Payloads of some frames in rows (N, width), filled with zeros."""
    starts, lengths = frames.offset[mine], frames.lengths[mine]
    padded = np.concatenate((frames.data, np.zeros(width + WORD, np.uint8)))
    anywhere = np.ndarray((len(padded) - WORD + 1,), "<u8", padded, strides=(1,))
    rows = np.stack([anywhere[starts + at] for at in range(0, width, WORD)], axis=1).astype("<u8", copy=False)
    payload = rows.view(np.uint8)
    if (lengths < width).any():
        payload[np.arange(width) >= lengths[:, None]] = 0
    return payload


def _series(
    used: _Used, payload: NDArray[np.uint8], lengths: NDArray[np.int64], t: Array, flags: NDArray[np.uint8]
) -> dict[Key, Series]:
    """The series made of a message's frames, in SI, delays removed; those sampled together share their times."""
    out: dict[Key, Series] = {}
    times: dict[float, Array] = {}
    for signal, keys in used.signals:
        found = signal.values(payload, lengths)
        own = flags[found.rows] | found.flags
        for status in used.checks.status:
            if not status.of or signal.name in status.of:
                invalid = ~np.isin(status.signal.raw(payload[found.rows]), status.valid)
                own |= np.where(invalid & ((own & np.uint8(Flag.CHECKSUM)) == 0), np.uint8(Flag.STATUS), np.uint8(0))
        values = np.where((own & np.uint8(UNUSABLE)) != 0, np.nan, found.values)
        for key in keys:
            if key.delay not in times:
                times[key.delay] = t - key.delay
            stamps = times[key.delay]
            stamps = stamps if len(found.rows) == len(t) else stamps[found.rows]
            out[key] = Series(stamps, in_si(values, key.unit), own)
    return out
