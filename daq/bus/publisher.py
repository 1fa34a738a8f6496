"""Sending side of the bus: a recorder's publisher, which keeps the run and answers requests for any part of it."""

from __future__ import annotations

import contextlib
import json
import random
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import zenoh

from lacet.daq.bus.digest import RunDigest
from lacet.daq.bus.marks import requested_text
from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.bus.session import LENGTH, QUEUE, REPLY, SEQUENCE, Keys, chunk, short
from lacet.daq.bus.spool import Spool
from lacet.daq.formats.wire import Losses, Manifest, StartRecord, Tally, manifest_to_bytes, start_to_bytes

OTHERS = 1.0
"""Longest time from an acknowledgement to the last request of another worker [s]."""
MOST_ACK = 64 << 10
"""Largest acknowledgement [bytes]."""
MOST_WORKERS = 100
"""Most workers whose acknowledgements are kept."""


class RunPublisher:
    """Publisher of one run, which answers requests for any part of it until it is closed.

    No method waits for the network.

    Parameters
    ----------
    car : the car's name in keys.
    spool : store of the blocks for requests; closed by the caller.
    drop_live : fraction of live blocks not sent, at random with a fixed seed, to simulate a lossy network in tests.

    Attributes
    ----------
    session : the session at present.
    keys : keys of the run.
    manifest : the manifest, set by `finish`.
    on_mark : sets a marker of a text in the recording and returns its answer; None where there is none.
    """

    def __init__(
        self,
        session: zenoh.Session,
        car: str,
        start: StartRecord,
        spool: Spool,
        drop_live: float = 0.0,
        notify: Callable[[str], None] = lambda text: None,
    ):
        self.keys = Keys(chunk(car), chunk(start.run_id))
        self.manifest: Manifest | None = None
        self.last_request = time.monotonic()
        """Time of the last request [s, monotonic]."""
        self.session = session
        self._start = start_to_bytes(start)
        self._run_id = start.run_id
        self._spool = spool
        self._tallies: dict[str, Tally] = {}
        self._digest = RunDigest()
        self._drop_live = drop_live
        self._random = random.Random(0)
        self._notify = notify
        self._blocks: BoundedQueue[tuple[str, int, bytes]] = BoundedQueue(QUEUE)
        self._requests: BoundedQueue[tuple[zenoh.Query, dict[str, Any] | None]] = BoundedQueue(1000)
        self.on_mark: Callable[[str], dict[str, Any] | None] | None = None
        self._acks: dict[str, dict[str, Any]] = {}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._lock = threading.Lock()
        self._handles: list[Any] = []
        self._declare()
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for name, work in (("bus-sender", self._send_blocks), ("bus-answers", self._answer_requests))
        ]
        for thread in self._threads:
            thread.start()

    def move(self, session: zenoh.Session) -> None:
        """Go on at another session: the router has gone, or another one is to be had. The old one stays open."""
        old, self.session = self._handles, session
        self._declare()
        for handle in old:
            with contextlib.suppress(zenoh.ZError):
                handle.undeclare()

    def _declare(self) -> None:
        session = self.session
        with self._lock:
            self._handles = [
                session.declare_queryable(self.keys.key(name), self._on_request, complete=True)
                for name in ("start", "manifest", "block/*")
            ]
            self._handles.append(session.declare_queryable(self.keys.key("mark"), self._on_mark))
            self._handles.append(session.declare_subscriber(self.keys.key("ack", "*"), self._on_ack))
            self._handles.append(
                session.liveliness().declare_token(self.keys.key("alive"))
            )  # last: now it can be asked

    def put_block(self, channel: str, message: bytes, samples: int) -> None:
        """Send the next block of a channel: its `DecodedBlock` message, numbered by the caller from 0."""
        number = self.keep_block(channel, message, samples)
        if self._drop_live and self._random.random() < self._drop_live:
            return
        self._blocks.put((channel, number, message), channel, len(message))

    def keep_block(self, channel: str, message: bytes, samples: int) -> int:
        """Keep the next block of a channel for who asks for it; returns its number."""
        tally = self._tallies.get(channel, Tally())
        self._tallies[channel] = tally.add(message, samples)
        self._digest.add(channel, message)
        self._spool.add(channel, tally.messages, message)
        return tally.messages

    def put_ledger(self, ledger: dict[str, Any]) -> None:
        """Publish rates and losses so far."""
        self.session.put(self.keys.key("ledger"), json.dumps(ledger))

    def finish(self, losses: Losses, frames: dict[str, Tally]) -> Manifest:
        """End the run: publish its manifest, blocks by channel and `frames` by source."""
        until = time.monotonic() + 5.0
        while len(self._blocks) and self._threads[0].is_alive() and time.monotonic() < until:
            time.sleep(0.005)  # live blocks are sent before the manifest
        self.manifest = Manifest(self._run_id, dict(self._tallies), frames, losses)
        with contextlib.suppress(zenoh.ZError):  # it can be asked for
            self.session.put(self.keys.key("manifest"), manifest_to_bytes(self.manifest))
        return self.manifest

    def wait_for_ack(self, timeout: float, cancelled: Callable[[], bool] = lambda: False) -> dict[str, Any]:
        """Wait until a worker has acknowledged the run, or no request came for `timeout` [s].

        Only an acknowledgement with the digest of all blocks counts: its worker has the run. After it the wait goes on
        while other workers send requests. Returns the acknowledgements by worker, empty when none came.
        """
        self.last_request = time.monotonic()
        while not cancelled():
            quiet = time.monotonic() - self.last_request
            if quiet > (min(OTHERS, timeout) if self._acks else timeout):
                break
            time.sleep(0.05)
        return dict(self._acks)

    @property
    def listened(self) -> bool | None:
        """Whether anybody, a worker or a page, receives the blocks; None before the first one is sent."""
        with contextlib.suppress(zenoh.ZError):
            for publisher in list(self._publishers.values()):
                status: Any = publisher.matching_status  # an object, whatever its stub says
                return bool(status.matching)
        return None

    @property
    def acknowledged(self) -> dict[str, Any]:
        """Acknowledgements so far, by worker."""
        return dict(self._acks)

    @property
    def unsent(self) -> int:
        """Bytes of live blocks not sent because the queue was full; they are still available for requests."""
        return sum(self._blocks.dropped.values())

    def close(self) -> None:
        """Stop sending and answering, and undeclare publishers. The session stays open."""
        self._blocks.close()
        self._requests.close()
        for thread in self._threads:
            thread.join(2.0)
        for handle in self._handles:
            handle.undeclare()

    def _on_request(self, query: zenoh.Query) -> None:
        self._requests.put((query, None))

    def _on_mark(self, query: zenoh.Query) -> None:
        """Set a marker at once, since its time is now; the answer waits its turn."""
        text = requested_text(query)
        if text is None or self.on_mark is None or self.manifest is not None:
            query.drop()
        elif (answer := self.on_mark(text)) is not None:
            self._requests.put((query, answer))

    def _on_ack(self, sample: zenoh.Sample) -> None:
        if self.manifest is None or len(sample.payload) > MOST_ACK:
            return
        # What is none is not answered: whoever sent it does not have the run.
        with contextlib.suppress(ValueError, RecursionError):
            ack = json.loads(sample.payload.to_bytes())
            if not isinstance(ack, dict) or ack.get("complete") is not True:
                return
            if ack.get("digest") == self._digest.hexdigest() and len(self._acks) < MOST_WORKERS:
                self._acks[str(sample.key_expr).rpartition("/")[2]] = ack

    def _send_blocks(self) -> None:
        session, publishers = self.session, self._publishers
        complained = False
        while True:
            item = self._blocks.get()
            if item is None:
                break
            channel, sequence, message = item
            if session is not self.session:
                session, publishers = self.session, dict[str, zenoh.Publisher]()
                self._publishers = publishers
            try:
                if channel not in publishers:
                    publishers[channel] = session.declare_publisher(
                        self.keys.key("block", channel), congestion_control=zenoh.CongestionControl.DROP
                    )
                publishers[channel].put(message, attachment=SEQUENCE.pack(sequence))
            except zenoh.ZError as error:  # recording goes on; the block stays available on request
                if not complained:
                    self._notify(f"bus: a live block was not sent ({short(error)}); recording goes on")
                complained = True

    def _answer_requests(self) -> None:
        while True:
            item = self._requests.get()
            if item is None:
                break
            query, mark = item
            self.last_request = time.monotonic()
            try:
                if mark is not None:
                    query.reply(self.keys.key("mark"), json.dumps({"run_id": self._run_id, **mark}))
                else:
                    self._answer(query)
            except zenoh.ZError as error:  # the requester is gone
                self._notify(f"bus: a request could not be answered ({short(error)})")
            finally:
                query.drop()

    def _answer(self, query: zenoh.Query) -> None:
        asked = zenoh.KeyExpr(str(query.key_expr))
        if asked.intersects(zenoh.KeyExpr(self.keys.key("start"))):
            query.reply(self.keys.key("start"), self._start)
        if self.manifest is not None and asked.intersects(zenoh.KeyExpr(self.keys.key("manifest"))):
            query.reply(self.keys.key("manifest"), manifest_to_bytes(self.manifest))
        try:
            first, last = int(query.parameters.get("first") or ""), int(query.parameters.get("last") or "")
        except ValueError:
            return
        for channel in self._spool.names():
            key = self.keys.key("block", channel)
            if asked.intersects(zenoh.KeyExpr(key)):
                for begin, body in _bodies(self._spool, channel, first, last):
                    query.reply(key, body, attachment=SEQUENCE.pack(begin))
                    self.last_request = time.monotonic()


def _bodies(spool: Spool, channel: str, first: int, last: int) -> Iterator[tuple[int, bytes]]:
    """Blocks `first` to `last` packed into replies: (sequence of the first in it, [length, block] …)."""
    begin, parts, size = first, [], 0
    for sequence in range(max(0, first), min(last + 1, spool.end(channel))):
        message = spool.read(channel, sequence) or b""  # length 0: not kept
        if not parts:
            begin = sequence
        parts += [LENGTH.pack(len(message)), message]
        size += len(message)
        if size >= REPLY:
            yield begin, b"".join(parts)
            parts, size = [], 0
    if parts:
        yield begin, b"".join(parts)
