"""The bus (Zenoh): a run's blocks to whoever listens, and everything that was missed on request.

Keys, below ``lacet/<rig>/<run>/``; the page ``docs/bus.md`` describes them:

=================== ============================================================ ==========
``start``           `StartRecord`: full texts of rig, vehicle and driver files   also asked
``block/<channel>`` `DecodedBlock`, numbered per channel from 0                  also asked
``ledger``          JSON, once a second: rates and losses so far
``manifest``        `Manifest`, at the end: count and checksum of every channel  also asked
``ack/<worker>``    JSON, a worker has assembled the run
``result/<worker>`` JSON, what a worker made of it
``alive``           liveliness token of the recorder
=================== ============================================================ ==========

Completeness does not rest on the network: blocks are numbered, the manifest says how many there are, and what is
missing is asked for. Live blocks are therefore sent with DROP, which cannot stall the recorder. Nothing works inside
a Zenoh callback: with BLOCK, a callback that stalls for 5 s makes Zenoh close the transport and lose nearly everything
silently. Callbacks only fill a bounded queue.

This file has the keys and the session; `daq.bus.publisher` is the recorder's side, `daq.bus.listener` the others'.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh import ext

from lacet.daq.errors import UsageError

ROOT = "lacet"
ROUTER = "tcp/127.0.0.1:7447"
"""Where a recorder's embedded router listens by default: this machine only."""
REPLY = 1 << 20
"""Most bytes of blocks in one reply to a request."""
SEQUENCE = struct.Struct("<Q")
"""Attachment of a block: its number; of a reply: the number of the first block in it."""
LENGTH = struct.Struct("<I")
"""Before each block in a reply: its length [bytes], 0 for one that is not kept."""
QUEUE = 64 << 20
"""Most bytes of blocks waiting to be sent, or to be worked on."""


def chunk(name: str) -> str:
    """`name` as one chunk of a key: characters that Zenoh reserves or splits at become ``_``."""
    return re.sub(r"[\s/*$#?]", "_", name) or "_"


@dataclass(frozen=True)
class Keys:
    """The keys of one run; ``Keys("*", "*")`` matches every run."""

    rig: str
    run: str

    def key(self, *parts: str) -> str:
        """``lacet/<rig>/<run>/<parts>``."""
        return "/".join((ROOT, self.rig, self.run, *parts))


EVERY_RUN = Keys("*", "*")


def open_session(listen: tuple[str, ...] = (), connect: tuple[str, ...] = (), wait: float = 5.0) -> zenoh.Session:
    """A Zenoh session: the embedded router when `listen` names endpoints, otherwise a client of those in `connect`.

    Nothing is looked for by multicast and nothing listens on other addresses than those given (Zenoh's defaults do).
    A client that loses its router connects again by itself.

    Parameters
    ----------
    wait : how long a client tries to reach the router at first [s].

    Raises
    ------
    UsageError : an endpoint that makes no sense, is taken, or does not answer.
    """
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "router" if listen else "client",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    if not listen:
        settings["connect/timeout_ms"] = round(wait * 1000)
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        what = "cannot listen on" if listen else "cannot reach a router at"
        remedy = (
            "another recorder may be running; give another address with --listen tcp/127.0.0.1:PORT"
            if listen
            else "start the recorder or the router first, or give its address with --connect tcp/HOST:PORT"
        )
        raise UsageError(f"{what} {', '.join(listen or connect)}: {remedy} (Zenoh: {short(error)})") from None


def short(error: Exception) -> str:
    """Message of a Zenoh error without the place in its source."""
    return str(error).split(" at /")[0]


def state_publisher(session: zenoh.Session, key: str) -> Any:
    """A publisher of state: whoever comes later, or lost the connection, still gets the last value."""
    return ext.declare_advanced_publisher(
        session,
        key,
        cache=ext.CacheConfig(1),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
        publisher_detection=True,
    )
