"""Events of a recording: what changed, when, and of which sensor, bus or clock."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum

from lacet.daq.formats.wire import Document, WireError, document_from_bytes, document_to_bytes

KIND = "event"
"""Kind of the documents that are events."""


class EventKind(StrEnum):
    """What an event is about."""

    SENSOR = "sensor"
    BUS = "bus"
    HOST_CLOCK = "host_clock"
    LOG = "log"
    MARK = "mark"


@dataclass(frozen=True)
class RunEvent:
    """One event.

    Attributes
    ----------
    t_ns : when, on the scale of the stamps [ns].
    kind : what it is about.
    name : sensor or bus; empty for the machine's clock, the log and a marker. Of a bus log's clock its bus.
    state : the new state in one word; for the clock ``stepped``, ``start`` or ``stop``; for a marker where it was set:
        ``bus`` or ``terminal``.
    text : a sentence for people, or the marker's own text.
    """

    t_ns: int
    kind: EventKind
    name: str
    state: str
    text: str


def event_to_bytes(event: RunEvent, run_id: str, sequence: int) -> bytes:
    """The `Document` message of an event."""
    text = json.dumps({**vars(event), "kind": event.kind.value}, ensure_ascii=False, sort_keys=True)
    return document_to_bytes(Document(KIND, run_id, text, sequence))


def event_from_bytes(data: bytes) -> RunEvent:
    """The event of a `Document` message. Raises WireError when it is none."""
    try:
        fields = json.loads(document_from_bytes(data).json)
        return RunEvent(
            int(fields["t_ns"]), EventKind(fields["kind"]), str(fields["name"]), str(fields["state"]),
            str(fields["text"]),
        )  # fmt: skip
    except (ValueError, LookupError, TypeError) as error:
        raise WireError(f"not an event: {error}") from error
