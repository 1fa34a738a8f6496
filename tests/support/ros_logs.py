"""Logs of ROS 2 messages, and bag folders of them, written by rosbags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

START = 1_780_000_000
"""Time of the first message [s since the Unix epoch]."""
Messages = Sequence[tuple[str, str, float, dict[str, Any]]]
"""Topic, type, time [s], and the message's fields; what is not in them is zero, or empty."""


def write_ros2(path: Path, messages: Messages) -> None:
    """An MCAP file of messages in CDR, as `ros2 bag record` writes one."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schemas: dict[str, int] = {}
        topics: dict[str, int] = {}
        for topic, kind, t, fields in messages:
            if kind not in schemas:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_schema(kind, "ros2msg", text.encode())
            if topic not in topics:
                topics[topic] = writer.register_channel(topic, "cdr", schemas[kind])
            second, nano = divmod(round((START + t) * 1e9), 10**9)
            stamped = fields | {"header": {"stamp": {"sec": second, "nanosec": nano}}}
            data = bytes(store.serialize_cdr(_made(store, kind, stamped), kind))
            at = round((START + t + 0.003) * 1e9)
            writer.add_message(topics[topic], at, data, at)
        writer.finish()


def _made(store: Any, kind: str, fields: dict[str, Any]) -> Any:
    """A message of a type, with nested messages made of dictionaries."""
    made = {}
    for name, (what, about) in store.fielddefs[kind][1]:
        value = fields.get(name)
        if what.name == "NAME":
            made[name] = _made(store, about, value or {})
        elif what.name == "BASE":
            made[name] = value if value is not None else "" if about[0] == "string" else 0
        elif about[0][1][0] == "string":
            made[name] = list(value or [])
        else:
            size = about[1] if what.name == "ARRAY" else 0
            made[name] = np.asarray(value if value is not None else np.zeros(size), about[0][1][0])
    return store.types[kind](**made)


def vector(x: float, y: float, z: float) -> dict[str, float]:
    """Fields of a Vector3."""
    return {"x": x, "y": y, "z": z}
