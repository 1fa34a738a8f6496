"""Receiving side of the bus: a subscriber to published runs, with requests for missed messages."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh import ext

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.bus.session import EVERY_RUN, LENGTH, QUEUE, SEQUENCE, Keys, chunk, state_publisher


@dataclass(frozen=True)
class Message:
    """A message received over the bus.

    Attributes
    ----------
    keys : keys of its run.
    kind : ``start``, ``block``, ``ledger``, ``manifest``, ``result``, ``alive`` or ``gone`` (the recorder's presence).
    name : channel of a block, worker of a result, otherwise empty.
    sequence : number of a block within its channel, otherwise 0.
    payload : the message's bytes.
    """

    keys: Keys
    kind: str
    name: str
    sequence: int
    payload: bytes


class BusListener:
    """A subscriber to the runs that match `keys`: messages in a bounded queue, and requests for missed ones."""

    def __init__(self, session: zenoh.Session, keys: Keys = EVERY_RUN, capacity: int = QUEUE):
        self._session = session
        self._queue: BoundedQueue[Message] = BoundedQueue(capacity)
        self._handles: list[Any] = [session.declare_subscriber(keys.key("block", "*"), self._on_sample)]
        for parts in (("start",), ("manifest",), ("ledger",), ("result", "*")):
            self._handles.append(
                ext.declare_advanced_subscriber(
                    session,
                    keys.key(*parts),
                    self._on_sample,
                    history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                    recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
            )
        self._handles.append(
            session.liveliness().declare_subscriber(keys.key("alive"), self._on_presence, history=True)
        )

    def get(self, timeout: float) -> Message | None:
        """The next message, waiting up to `timeout` [s]."""
        return self._queue.get(timeout)

    @property
    def dropped(self) -> int:
        """Bytes of blocks dropped because the queue was full."""
        return sum(self._queue.dropped.values())

    def fetch(self, keys: Keys, name: str, timeout: float = 5.0) -> bytes | None:
        """The ``start`` or ``manifest`` message of a run, requested from its holder; None without an answer."""
        for reply in self._session.get(keys.key(name), timeout=timeout):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        return None

    def fetch_blocks(
        self, keys: Keys, channel: str, first: int, last: int, timeout: float = 10.0
    ) -> Iterator[tuple[int, bytes]]:
        """Blocks `first` to `last` of a channel, requested: (sequence, `DecodedBlock` message) of those still kept."""
        replies = self._session.get(
            f"{keys.key('block', channel)}?first={first};last={last}",
            consolidation=zenoh.ConsolidationMode.NONE,  # replies share one key, and every one counts
            timeout=timeout,
        )
        for reply in replies:
            if reply.ok is None or reply.ok.attachment is None:
                continue
            (sequence,) = SEQUENCE.unpack(reply.ok.attachment.to_bytes())
            body = reply.ok.payload.to_bytes()
            at = 0
            while at + LENGTH.size <= len(body):
                (length,) = LENGTH.unpack_from(body, at)
                at += LENGTH.size
                if length:
                    yield sequence, body[at : at + length]
                at += length
                sequence += 1

    def acknowledge(self, keys: Keys, worker: str, what: dict[str, Any]) -> None:
        """Acknowledge to the recorder that the run is assembled."""
        self._session.put(
            keys.key("ack", chunk(worker)),
            json.dumps(what),
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def publish_result(self, keys: Keys, worker: str, text: str) -> None:
        """Publish a worker's result of the run (JSON); later subscribers receive it too while this listener is open."""
        publisher = state_publisher(self._session, keys.key("result", chunk(worker)))
        publisher.put(text)
        self._handles.append(publisher)

    def close(self) -> None:
        """Undeclare subscribers and publishers. The session stays open."""
        self._queue.close()
        for handle in self._handles:
            handle.undeclare()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        _, rig, run, kind, *rest = str(sample.key_expr).split("/")
        payload = sample.payload.to_bytes()
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
        sequence = SEQUENCE.unpack(attachment)[0] if len(attachment) == SEQUENCE.size else 0
        # Only blocks may be dropped: they can be requested again, and no other message is large.
        size = len(payload) if kind == "block" else 0
        self._queue.put(Message(Keys(rig, run), kind, "/".join(rest), sequence, payload), kind, size)

    def _on_presence(self, sample: zenoh.Sample) -> None:
        _, rig, run, _ = str(sample.key_expr).split("/")
        kind = "alive" if sample.kind == zenoh.SampleKind.PUT else "gone"
        self._queue.put(Message(Keys(rig, run), kind, "", 0, b""), kind, 0)
