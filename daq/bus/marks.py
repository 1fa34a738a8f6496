"""Markers over the bus: a request to the recorders, each of which answers with the marker that it has set."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import zenoh

from lacet.daq.bus.session import Keys

MOST_REQUEST = 4 << 10
"""Largest request for a marker [bytes]."""
MOST_TEXT = 120
"""Longest text of a marker [characters]; the rest is cut off."""
WAIT = 2.0
"""Longest time in which recorders answer [s]."""


def mark_text(text: str) -> str:
    """The text of a marker as it is kept: one line, without what a terminal would obey, `MOST_TEXT` long."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:MOST_TEXT]


def requested_text(query: zenoh.Query) -> str | None:
    """The text in a request for a marker, None when it is none."""
    payload = query.payload
    if payload is None or len(payload) > MOST_REQUEST:
        return None
    with contextlib.suppress(ValueError, RecursionError):
        asked = json.loads(payload.to_bytes())
        if isinstance(asked, dict) and isinstance(text := asked.get("text"), str):
            return mark_text(text)
    return None


def set_mark(session: zenoh.Session, text: str, car: str = "*", run: str = "*") -> list[dict[str, Any]]:
    """Set a marker, now, in every recording that a session reaches, or that of a car and run; what each has answered.

    An answer has `run_id`, `text` and `seconds` since the start of the recording.
    """
    found: list[dict[str, Any]] = []
    replies = session.get(
        Keys(car, run).key("mark"),
        payload=json.dumps({"text": mark_text(text)}),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=WAIT,
    )
    for reply in replies:
        if reply.ok is None or len(reply.ok.payload) > MOST_REQUEST:
            continue
        with contextlib.suppress(ValueError, RecursionError, LookupError, TypeError):
            answer = json.loads(reply.ok.payload.to_bytes())
            found.append(
                {
                    "run_id": mark_text(str(answer["run_id"])),
                    "text": mark_text(str(answer["text"])),
                    "seconds": float(answer["seconds"]),
                }
            )
    return found
