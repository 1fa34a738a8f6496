"""Receiving side of the bus: subscription to what is published, and requests for what was missed."""

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
    keys : of the run it belongs to.
    kind : ``start``, ``block``, ``ledger``, ``manifest``, ``result``, ``alive`` or ``gone`` (the recorder's presence).
    name : the channel of a block, the worker of a result, otherwise empty.
    sequence : number of a block within its channel, otherwise 0.
    payload : the message's bytes.
    """

    keys: Keys
    kind: str
    name: str
    sequence: int
    payload: bytes


class BusListener:
    """A subscriber to the runs that `keys` matches: messages in a bounded queue, and requests for what was missed."""

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
        """Bytes of blocks that found the queue full."""
        return sum(self._queue.dropped.values())

    def fetch(self, keys: Keys, name: str, timeout: float = 5.0) -> bytes | None:
        """Ask for ``start`` or ``manifest`` of a run; None when nobody has it."""
        for reply in self._session.get(keys.key(name), timeout=timeout):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        return None

    def fetch_blocks(
        self, keys: Keys, channel: str, first: int, last: int, timeout: float = 10.0
    ) -> Iterator[tuple[int, bytes]]:
        """Ask for blocks `first` to `last` of a channel; (sequence, `DecodedBlock` message) of those that are kept."""
        replies = self._session.get(
            f"{keys.key('block', channel)}?first={first};last={last}",
            consolidation=zenoh.ConsolidationMode.NONE,  # every reply has the same key, and all of them count
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
        """Send the recorder the acknowledgement that the run is assembled."""
        self._session.put(
            keys.key("ack", chunk(worker)),
            json.dumps(what),
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def publish_result(self, keys: Keys, worker: str, text: str) -> None:
        """Publish what was made of the run (JSON); who comes later still gets it while this listener is open."""
        publisher = state_publisher(self._session, keys.key("result", chunk(worker)))
        publisher.put(text)
        self._handles.append(publisher)

    def close(self) -> None:
        """Take back what was declared. The session stays open."""
        self._queue.close()
        for handle in self._handles:
            handle.undeclare()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        _, rig, run, kind, *rest = str(sample.key_expr).split("/")
        payload = sample.payload.to_bytes()
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
        sequence = SEQUENCE.unpack(attachment)[0] if len(attachment) == SEQUENCE.size else 0
        # Only blocks can be dropped: they can be asked for, and nothing else is large.
        size = len(payload) if kind == "block" else 0
        self._queue.put(Message(Keys(rig, run), kind, "/".join(rest), sequence, payload), kind, size)

    def _on_presence(self, sample: zenoh.Sample) -> None:
        _, rig, run, _ = str(sample.key_expr).split("/")
        kind = "alive" if sample.kind == zenoh.SampleKind.PUT else "gone"
        self._queue.put(Message(Keys(rig, run), kind, "", 0, b""), kind, 0)
