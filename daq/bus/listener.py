"""Receiving side of the bus: a subscriber to published runs, with requests for missed messages."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import zenoh

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.bus.session import EVERY_RUN, LARGEST, LENGTH, QUEUE, SEQUENCE, Keys, chunk, split_key

_PRESENCE = {"alive": ("alive", "gone"), "claim": ("claimed", "unclaimed"), "working": ("working", "idle")}
"""Liveliness token → kinds of the messages that say that it is there, or no more."""
RESERVE = 32 << 20
"""Room in the queue for messages other than blocks, which blocks must not displace [bytes]."""
ANSWER = 20.0
"""Longest time for all replies to a request [s]; what came until then counts."""
MOST_ASKED = 100
"""Most recorders whose start records are waited for, the first ones of more left out [count]: a stranger may claim to
be many."""
OVERHEAD = 512
"""Size of a message in the queue besides its payload [bytes]."""


@dataclass(frozen=True)
class Message:
    """A message received over the bus.

    Attributes
    ----------
    keys : keys of its run.
    kind : ``start``, ``block``, ``ledger``, ``manifest``, ``result``, ``alive`` or ``gone`` (the recorder's presence);
        ``blocks`` with several that were requested, ``answered`` at the end of them; ``claimed``, ``unclaimed``,
        ``working`` and ``idle`` (other workers' claims).
    name : channel of a block, worker of a result or a claim, otherwise empty.
    sequence : number of a block within its channel, of the first of several, otherwise 0.
    payload : the message's bytes.
    requested : whether it is an answer to a request, and so from who holds the run.
    """

    keys: Keys
    kind: str
    name: str
    sequence: int
    payload: bytes
    requested: bool = False


class BusListener:
    """A subscriber to the runs that match `keys`: messages in a bounded queue, and requests for missed ones.

    Results of earlier runs, and the start record of every recorder that appears, are asked for by itself; the latter
    again while the recorder is heard and no answer comes.

    Attributes
    ----------
    refused : kind of a message → number of those that were no message of a run, or too large.
    """

    def __init__(self, session: zenoh.Session, keys: Keys = EVERY_RUN, capacity: int = QUEUE):
        self.refused: Counter[str] = Counter()
        self._session = session
        self._queue: BoundedQueue[Message] = BoundedQueue(capacity)
        self._results: dict[str, bytes] = {}
        self._asked: dict[Keys, int] = {}
        self._lock = threading.Lock()
        kinds = (("block", "*"), ("manifest",), ("ledger",), ("result", "*"))
        self._handles: list[Any] = [session.declare_subscriber(keys.key(*parts), self._on_sample) for parts in kinds]
        self._handles.append(
            session.liveliness().declare_subscriber(keys.key("alive"), self._on_presence, history=True)
        )
        self.ask(keys, "result", "*")

    def get(self, timeout: float) -> Message | None:
        """The next message, waiting up to `timeout` [s]."""
        message = self._queue.get(timeout)
        if message is not None:
            self._ask_start(message)
        return message

    def _ask_start(self, message: Message) -> None:
        """Ask for the start record of a recorder that appears; again where its answer was lost, or came too late.

        The recorder's ledger comes each second.
        """
        keys, kind = message.keys, message.kind
        if kind in ("start", "gone", "manifest"):
            self._asked.pop(keys, None)
        elif kind == "ledger" and keys in self._asked:
            self._asked[keys] += 1
        if kind == "alive" or self._asked.get(keys, 0) > ANSWER:
            if keys not in self._asked and len(self._asked) == MOST_ASKED:
                del self._asked[next(iter(self._asked))]
            self._asked[keys] = 0
            self.ask(keys, "start")

    def watch_claims(self) -> None:
        """Receive the claims of workers on runs, too."""
        for kind in ("claim", "working"):
            key = EVERY_RUN.key(kind, "*")
            self._handles.append(self._session.liveliness().declare_subscriber(key, self._on_presence, history=True))

    def declare_token(self, keys: Keys, *parts: str) -> zenoh.LivelinessToken:
        """A token that others see until it is undeclared, or this worker is gone."""
        return self._session.liveliness().declare_token(keys.key(*parts))

    @property
    def dropped(self) -> int:
        """Bytes of messages dropped because the queue was full."""
        return sum(self._queue.dropped.values())

    @property
    def connected(self) -> bool:
        """Whether a router can be reached at present."""
        return bool(self._session.info.routers_zid())

    def ask(self, keys: Keys, *parts: str) -> None:
        """Request a message without waiting: the answer comes by `get`, as any other message."""
        self._session.get(keys.key(*parts), self._on_reply, timeout=ANSWER)

    def ask_blocks(self, keys: Keys, channel: str, first: int, last: int) -> None:
        """Request blocks `first` to `last` of a channel without waiting: ``blocks`` messages, at the end ``answered``.

        `unpack_blocks` gives the blocks of a message.
        """
        self._session.get(
            f"{keys.key('block', channel)}?first={first};last={last}",
            zenoh.handlers.Callback(
                self._on_reply,
                lambda: self._queue.put(Message(keys, "answered", channel, first, b"", True), "", OVERHEAD, RESERVE),
            ),
            consolidation=zenoh.ConsolidationMode.NONE,  # replies share one key, and every one counts
            timeout=ANSWER,
        )

    def acknowledge(self, keys: Keys, worker: str, what: dict[str, Any]) -> None:
        """Acknowledge to the recorder that the run is assembled."""
        self._session.put(
            keys.key("ack", chunk(worker)),
            json.dumps(what),
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def publish_result(self, keys: Keys, worker: str, text: str) -> None:
        """Publish a worker's result of the run (JSON); while this listener is open, it is given to who asks, too."""
        key = keys.key("result", chunk(worker))
        with self._lock:
            new = key not in self._results
            self._results[key] = text.encode()
        if new:
            self._handles.append(self._session.declare_queryable(key, self._on_query))
        self._session.put(key, text, congestion_control=zenoh.CongestionControl.BLOCK)

    def close(self) -> None:
        """Undeclare subscribers and publishers. The session stays open."""
        self._queue.close()
        for handle in self._handles:
            handle.undeclare()

    def _on_query(self, query: zenoh.Query) -> None:
        with self._lock:
            found = [
                (key, text) for key, text in self._results.items() if query.key_expr.intersects(zenoh.KeyExpr(key))
            ]
        for key, text in found:
            query.reply(key, text)
        query.drop()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        self._put(sample, requested=False)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._put(reply.ok, requested=True)

    def _on_presence(self, sample: zenoh.Sample) -> None:
        if (parts := split_key(str(sample.key_expr))) is not None and parts[1] in _PRESENCE:
            there, gone = _PRESENCE[parts[1]]
            kind = there if sample.kind == zenoh.SampleKind.PUT else gone
            self._queue.put(Message(parts[0], kind, parts[2], 0, b""), kind, OVERHEAD, RESERVE)

    def _put(self, sample: zenoh.Sample, requested: bool) -> None:
        parts, sequence = split_key(str(sample.key_expr)), _number(sample)
        payload = sample.payload.to_bytes()
        if parts is None or len(payload) > LARGEST or (parts[1] == "block" and sequence is None):
            self.refused["" if parts is None else parts[1]] += 1
            return
        keys, kind, name = parts
        if kind == "block" and requested:
            kind = "blocks"
        # Blocks make room for the others: they can be requested again, and are many.
        reserve = 0 if kind in ("block", "blocks") else RESERVE
        message = Message(keys, kind, name, sequence or 0, payload, requested)
        self._queue.put(message, kind, len(payload) + OVERHEAD, reserve)


def unpack_blocks(message: Message) -> Iterator[tuple[int, bytes]]:
    """The blocks in a ``blocks`` message that the recorder still keeps: (number, `DecodedBlock` message)."""
    sequence, body, at = message.sequence, message.payload, 0
    while at + LENGTH.size <= len(body):
        (length,) = LENGTH.unpack_from(body, at)
        at += LENGTH.size
        if length:
            yield sequence, body[at : at + length]
        at += length
        sequence += 1


def _number(sample: zenoh.Sample) -> int | None:
    """Number of a block, or of the first one in a reply; None when the message has none."""
    attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
    return SEQUENCE.unpack(attachment)[0] if len(attachment) == SEQUENCE.size else None
