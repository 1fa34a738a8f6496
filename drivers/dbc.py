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
from lacet.daq.sources.dbc_messages import BusMessage, BusSignal, parse_dbc
from lacet.daq.sources.source import Series
from lacet.daq.text_source import is_file
from lacet.drivers.framework.base import Reader
from lacet.drivers.framework.can_layout import read_layout
from lacet.drivers.framework.counters import CounterState, add, follow_counter
from lacet.drivers.framework.message_checks import MessageChecks, Signals, read_checks
from lacet.drivers.framework.options import check_options
from lacet.drivers.framework.sequence import Recent, repeats

PATIENCE = 2.0
"""Longest distance of the next sample of a component in another message [s], by which a channel may be late."""
OPTIONS = ("dbc", "signals", "sources", "counter", "checksum", "status")
_COUNTS = (
    "received", "samples", "lost", "bad_checksum", "incomplete", "bad_status", "repeated", "out_of_order",
    "no_neighbour",
)  # fmt: skip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Used:
    """A message in use: what is asked of it, and its signals in use, each with the series made of it."""

    message: BusMessage
    checks: MessageChecks
    signals: tuple[tuple[BusSignal, tuple[Key, ...]], ...]


@dataclass(frozen=True)
class DbcState:
    """State between batches: stamp that is time 0, and the latest one [ns], incomplete samples by channel, last stamp,
    counter and last frames of each message, and ledger."""

    origin_ns: int | None
    front_ns: int | None
    channels: tuple[Assembly, ...]
    last_ns: tuple[int, ...]
    counters: tuple[CounterState, ...]
    recent: tuple[Recent, ...]
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
        ledger: dict[str, int] = dict.fromkeys(_COUNTS, 0)
        n = len(self._used)
        never = int(np.iinfo(np.int64).min)
        return DbcState(
            None, None, tuple(one.copy() for one in self._channels), (never,) * n, (CounterState(),) * n,
            (Recent(),) * n, ledger,
        )  # fmt: skip

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
                made, state = self._decoded(frames[:end], state, int(latest[end - 1]))
                _collect(blocks, made)
            if len(back):  # the clock was put back
                made, state = self.finish(state)
                _collect(blocks, made)
                state = replace(self.start(), counters=state.counters, recent=state.recent, ledger=state.ledger)
            frames = frames[end:]
        return [Block.concat(parts) for parts in blocks.values()], state

    def finish(self, state: DbcState) -> tuple[list[Block], DbcState]:
        """Blocks at the end of the stream: samples that still lack components have no value."""
        channels = tuple(one.copy() for one in state.channels)
        return self._made([one.feed({}, last=True) for one in channels], replace(state, channels=channels))

    def counts(self, state: DbcState) -> dict[str, int]:
        """The ledger. ``received``, ``lost``, ``bad_checksum``, ``incomplete`` (too short), ``repeated`` (by a counter)
        and ``out_of_order`` count frames; ``bad_status`` samples, and ``no_neighbour`` those around which another
        component has none."""
        return dict(state.ledger)

    def _decoded(self, frames: Frames, state: DbcState, front_ns: int) -> tuple[list[Block], DbcState]:
        origin = int(frames.t_ns[0]) if state.origin_ns is None else state.origin_ns
        idents = full_idents(frames.ident)
        last, counters, recent, ledger = list(state.last_ns), list(state.counters), list(state.recent), state.ledger
        pieces: dict[Key, Series] = {}
        for i, used in enumerate(self._used):
            mine = np.flatnonzero(used.message.of(idents))
            if not len(mine):
                continue
            t_ns = frames.t_ns[mine]
            later = t_ns > np.maximum.accumulate(np.concatenate(([last[i]], t_ns)))[:-1]
            ledger = add(ledger, received=len(mine), out_of_order=np.count_nonzero(~later))
            mine, t_ns = mine[later], t_ns[later]
            if not len(mine):
                continue
            last[i] = int(t_ns[-1])
            payload, lengths = used.message.fitted(_rows(frames, mine, used.message.width)), frames.lengths[mine]
            flags, new, counters[i], recent[i], ledger = _checked(
                used, payload, lengths, counters[i], recent[i], ledger
            )
            if new is not None:
                payload, lengths, t_ns = payload[new], lengths[new], t_ns[new]
            pieces |= _series(used, payload, lengths, (t_ns - origin) / 1e9, flags)
        channels = tuple(one.copy() for one in state.channels)
        front = (front_ns - origin) / 1e9
        made = [one.feed(pieces, front=front) for one in channels]
        state = DbcState(origin, front_ns, channels, tuple(last), tuple(counters), tuple(recent), ledger)
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


def _checked(
    used: _Used, payload: NDArray[np.uint8], lengths: NDArray[np.int64], counter: CounterState, recent: Recent,
    ledger: Mapping[str, int],
) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None, CounterState, Recent, dict[str, int]]:  # fmt: skip
    """Flags of a message's frames by its checksum and counter, which frames are not repeated (None: all, and the flags
    are of these), the counter and last frames after them, and the ledger."""
    flags = np.zeros(len(lengths), np.uint8)
    needed = max(one.bytes_needed for one, _ in used.signals)
    multiplexed = any(one.needs for one, _ in used.signals)
    if used.checks.checksum is not None:
        flags[~used.checks.checksum.right(payload)] = np.uint8(Flag.CHECKSUM)
    lost, new = 0, None
    if used.checks.counter is not None:
        count = used.checks.counter.raw(payload).astype(np.int64)
        trusted = (flags == 0) & (lengths > max(used.checks.counter.bits) // 8)  # a frame may end before its counter
        again, recent = repeats(payload, count, trusted, used.checks.counter.length, recent)
        if again.any():
            new = ~again
            count, flags, lengths, trusted = count[new], flags[new], lengths[new], trusted[new]
            ledger = add(ledger, repeated=np.count_nonzero(again))
        jumps, counter = follow_counter(count, trusted, used.checks.counter.length, counter)
        flags[jumps.gap] |= np.uint8(Flag.GAP)
        lost = int(jumps.lost.sum())
    short = 0 if multiplexed else np.count_nonzero(lengths < needed)
    wrong = np.count_nonzero(flags & np.uint8(Flag.CHECKSUM))
    return flags, new, counter, recent, add(ledger, incomplete=short, bad_checksum=wrong, lost=lost)


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
