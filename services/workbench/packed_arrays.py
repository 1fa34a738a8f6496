"""Binary answers with arrays: a head in JSON, then single-precision arrays (``docs/workbench-api.md``)."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.formats.result import plain

MEDIA_TYPE = "application/octet-stream"


def packed(arrays: Mapping[str, NDArray[Any]], **about: Any) -> bytes:
    """Length of the head (4 bytes), the head padded to four bytes, then every array as float32, little-endian."""
    head = {"arrays": [{"name": name, "n": int(np.size(a))} for name, a in arrays.items()], **plain(about)}
    text = json.dumps(head, ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    body = [np.ascontiguousarray(a, "<f4").data for a in arrays.values()]
    return b"".join([struct.pack("<I", len(text)), text, *body])


def unpacked(body: bytes) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    """The head and the arrays of a binary answer."""
    (length,) = struct.unpack_from("<I", body)
    head: dict[str, Any] = json.loads(body[4 : 4 + length])
    arrays: dict[str, NDArray[np.float32]] = {}
    at = 4 + length
    for entry in head["arrays"]:
        arrays[entry["name"]] = np.frombuffer(body, "<f4", entry["n"], at)
        at += 4 * entry["n"]
    return head, arrays
