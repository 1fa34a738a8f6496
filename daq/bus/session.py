"""Session and keys of the bus (Zenoh): a run's blocks are published live, and missed ones sent on request.

Keys, below ``lacet/<car>/<run>/``; the page ``docs/bus.md`` describes them:

==================== ============================================================= ==========
``start``            `StartRecord`: full texts of rig, vehicle and driver files   on request
``block/<channel>`` `DecodedBlock`, numbered per channel from 0                  on request
``ledger``          JSON, once a second: rates and losses so far
``manifest``        `Manifest`, at the end: count and checksum of every channel  on request
``ack/<worker>``    JSON, a worker has assembled the run
``result/<worker>`` JSON, a worker's result                                      on request
``mark``            JSON, a marker is set: asked for with its text, answered   on request
``alive``           liveliness token of the recorder
``claim/<worker>``  liveliness token of a worker that would work on the run
``working/<worker>`` liveliness token of the worker that does
==================== ============================================================= ==========

Completeness does not depend on the network: blocks are numbered, the manifest has their number, and missing ones are
requested. Live blocks are therefore sent with DROP, which cannot stall the recorder. Callbacks only fill a bounded
queue: with BLOCK, a callback that stalls for 5 s makes Zenoh close the transport and lose nearly everything silently.

`daq.bus.publisher` is the recorder's side, `daq.bus.listener` the receivers'.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import zenoh

from lacet.daq.bus.credentials import Credentials, check_endpoint
from lacet.daq.errors import UsageError

ROOT = "lacet"
PORT = 7447
ROUTER = f"tcp/127.0.0.1:{PORT}"
"""Default endpoint of a recorder's embedded router: this machine only."""
SEALED_ROUTER = f"tls/127.0.0.1:{PORT}"
"""The same with keys."""
REPLY = 256 << 10
"""Size of the blocks in one reply to a request [bytes]: what has come counts when a slow link is cut."""
SEQUENCE = struct.Struct("<Q")
"""Attachment of a block: its number; of a reply: the number of the first block in it."""
LENGTH = struct.Struct("<I")
"""Prefix of each block in a reply: its length [bytes], 0 for one that is not kept."""
QUEUE = 64 << 20
"""Largest size of blocks waiting to be sent, or to be processed [bytes]."""
LARGEST = 16 << 20
"""Largest message received [bytes]: four times a block of everything that waits in a recorder's full queue."""
NAME_BYTES = 80
"""Longest name of a car or a run in a key [bytes], so that it can be a file's name."""


def chunk(name: str) -> str:
    """`name` as one chunk of a key: reserved characters become ``_``, and it is cut off at `NAME_BYTES`."""
    safe = re.sub(r"[^\w.+-]", "_", name).lstrip(".") or "_"
    return safe.encode()[:NAME_BYTES].decode(errors="ignore")


@dataclass(frozen=True)
class Keys:
    """The keys of one run; ``Keys("*", "*")`` matches every run."""

    car: str
    run: str

    def key(self, *parts: str) -> str:
        """Key of a part of the run, ``lacet/<car>/<run>/<parts>``."""
        return "/".join((ROOT, self.car, self.run, *parts))


EVERY_RUN = Keys("*", "*")


def split_key(key: str) -> tuple[Keys, str, str] | None:
    """A run, the kind of a message and its name, from a key received; None when it is no key of a run."""
    root, *parts = key.split("/")
    if root != ROOT or len(parts) not in (3, 4) or any(part != chunk(part) for part in parts):
        return None
    return Keys(parts[0], parts[1]), parts[2], "".join(parts[3:])


def common_settings() -> dict[str, Any]:
    """Zenoh's settings of every session and router: nothing is looked for, and no message above `LARGEST` comes in."""
    limit = {"flows": ["ingress"], "messages": ["put", "query", "reply"], "key_exprs": ["**"], "size_limit": LARGEST}
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        # The filter counts exactly; this one, which does not, ends the collection of the pieces in memory.
        "transport/link/rx/max_message_size": LARGEST,
        "low_pass_filter": [limit],
        # A router that comes back is found within two seconds.
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 2000, "period_increase_factor": 2},
    }


def open_session(
    listen: tuple[str, ...] = (),
    connect: tuple[str, ...] = (),
    wait: float = 5.0,
    credentials: Credentials | None = None,
) -> zenoh.Session:
    """A Zenoh session: the embedded router when `listen` names endpoints, otherwise a client of those in `connect`.

    With neither it reaches nobody. It uses no multicast and listens on the given addresses only (Zenoh's defaults do
    otherwise). A client that loses its router reconnects by itself. Without credentials it stays on this machine.

    Parameters
    ----------
    wait : longest time for a client's first connection to the router [s].
    credentials : keys for mutual TLS and access control.

    Raises
    ------
    UsageError : an endpoint is malformed, in use, beyond this machine without credentials, or does not answer.
    """
    for endpoint in (*listen, *connect):
        check_endpoint(endpoint, credentials)
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "router" if listen else "client" if connect else "peer",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        **common_settings(),
        **(credentials.settings() if credentials is not None else {}),
    }
    if connect:
        settings["connect/timeout_ms"] = round(wait * 1000)
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise UsageError(_why_not(listen, connect, credentials, error)) from None


def _why_not(
    listen: tuple[str, ...], connect: tuple[str, ...], credentials: Credentials | None, error: Exception
) -> str:
    place = ", ".join(listen or connect)
    if listen:
        what = f"cannot listen on {place}: another recorder may be running; give another address with --listen"
    else:
        what = f"cannot reach a router at {place}: start the recorder or the router first, or give its address with "
        what += "--connect"
        if credentials is not None:
            what += f"; its keys and those of '{credentials.name}' have to be of one authority, and valid"
    return f"{what} (Zenoh: {short(error)})"


def short(error: Exception) -> str:
    """Message of a Zenoh error without its source location."""
    return str(error).split(" at /")[0]
