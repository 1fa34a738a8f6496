"""Mutations of whole inputs: bytes, texts, TOML, JSON, frames and arrays, each by a generator with a fixed seed."""

from __future__ import annotations

import copy
import json
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random
from typing import Any, TypeVar

import numpy as np

from lacet.daq.frames import Frames

T = TypeVar("T")

INTEGERS = (0, 1, -1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31, 2**32 - 1, 2**32, 2**53 + 1, 2**62, 2**63 - 1, -(2**63))
NUMBERS = (
    "0", "-1", "1", "0.5", "nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "1e999", "9223372036854775808",
    "99999999999999999999", "0x7fffffff", "1_000", "1,5", "1e", "--1", "2**31",
)  # fmt: skip
TOML_VALUES = (
    *NUMBERS[:10], "[]", "{}", "[[]]", '["a", "b"]', "{ value = 1 }", '""', '"\\u0000"', '"../../x"', '"é"', "true",
    "false", "1979-05-27", "07:32:00", "[1, 2, 3]", "[nan, nan, nan]", '"imu"', '["can0"]', "9223372036854775807",
    '{ value = [], unit = "kg", source = "x" }', '{ value = 1e308, unit = "kg", source = "x" }', '"°"', '"m/s/0"',
)  # fmt: skip
"""Right-hand sides, of which most are of another kind than the file's."""
JSON_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1.5, 2**63, 10**30, float("nan"), float("inf"), "", "x", "\u0000", "../..", [], {}, [[]],
    [None], {"": 0}, ["a", 1], {"a": {}},
)  # fmt: skip
TEXTS = (
    b"", b"\x00", b"\xe9", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n", b"\r\n", b"\t", b";", b",", b'"', b"'", b"#",
    b"[", b"]", b"{", b"}", b"=", b"\\", b"%", b"  ", b"\xc2\x85", "\u2028".encode(), b"(" * 300, b"A" * 5000,
)  # fmt: skip


def bytes_changed(random: Random, data: bytes) -> bytes:
    """A file with some bytes flipped, replaced, cut out, repeated, inserted, or cut off."""
    out = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 4, 16))):
        at = random.randrange(len(out) + 1)
        length = min(random.choice((1, 2, 4, 8, 40, 400)), len(out) - at)
        match random.randrange(8):
            case 0 if length:
                out[at] ^= 1 << random.randrange(8)
            case 1 if length:
                out[at] = random.choice((0, 1, 0x7F, 0x80, 0xFE, 0xFF, random.randrange(256)))
            case 2:
                size = random.choice((2, 4, 8))
                value = random.choice(INTEGERS) % (1 << 8 * size)
                packed = value.to_bytes(size, random.choice(("little", "big")))
                out[at : at + size] = packed
            case 3:
                out[at : at + 8] = struct.pack("<d", random.choice((np.nan, np.inf, -np.inf, 1e308, -0.0, 1e-310)))
            case 4:
                del out[at : at + length]
            case 5:
                out[at:at] = out[at : at + length]
            case 6:
                out[at:at] = random.randbytes(random.choice((1, 4, 30)))
            case _:
                if random.random() < 0.3:
                    del out[at:]
    return bytes(out)


def text_changed(random: Random, data: bytes) -> bytes:
    """A text with numbers, marks, words and lines replaced, repeated, exchanged or lost, some in no encoding."""
    out = data
    for _ in range(random.choice((1, 1, 2, 4))):
        lines = out.split(b"\n")
        at = random.randrange(len(lines))
        match random.randrange(8):
            case 0 | 1:
                out = _one_replaced(random, out, rb"-?\d+(\.\d+)?(e-?\d+)?", random.choice(NUMBERS).encode())
            case 2:
                out = _one_replaced(random, out, rb"\w+", random.choice(TEXTS))
            case 3:
                out = _one_replaced(random, out, rb"[^\w\s]", random.choice(TEXTS))
            case 4:
                lines[at : at + 1] = [] if random.random() < 0.5 else [lines[at]] * 2
                out = b"\n".join(lines)
            case 5:
                other = random.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
                out = b"\n".join(lines)
            case 6:
                place = random.randrange(len(out) + 1)
                out = out[:place] + random.choice(TEXTS) + out[place:]
            case _:
                out = bytes_changed(random, out)
    return out


def toml_changed(random: Random, data: bytes) -> bytes:
    """A TOML text with values replaced by those of other kinds, keys renamed, tables lost; or any text's changes."""
    if random.random() < 0.3:
        return text_changed(random, data)
    lines = data.decode().split("\n")
    for _ in range(random.choice((1, 1, 2, 3))):
        keyed = [i for i, line in enumerate(lines) if " = " in line]
        at = random.choice(keyed) if keyed else 0
        key, _, value = lines[at].partition(" = ")
        match random.randrange(6):
            case 0 | 1 | 2:
                lines[at] = f"{key} = {random.choice(TOML_VALUES)}"
            case 3:
                inner = random.choice(TOML_VALUES).replace("\\", "\\\\")
                lines[at] = f"{key} = " + re.sub(r"-?\d+(\.\d+)?|\"[^\"]*\"", inner, value, count=1)
            case 4:
                lines[at] = f"{random.choice(('x', key + '_x', 'bus', 'driver', 'value'))} = {value}"
            case _:
                del lines[random.randrange(len(lines))]
                lines = lines or [""]
    return "\n".join(lines).encode()


def json_changed(random: Random, data: bytes) -> bytes:
    """A JSON text with some values replaced, lost or renamed; or any text's changes."""
    if random.random() < 0.3:
        return text_changed(random, data)
    root: list[Any] = [json.loads(data)]
    for _ in range(random.choice((1, 1, 2))):
        holder: Any = root
        while True:
            keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
            if not keys:
                break
            key = random.choice(keys)
            if isinstance(holder[key], dict | list) and holder[key] and random.random() < 0.8:
                holder = holder[key]
                continue
            if random.random() < 0.2 and holder is not root:
                del holder[key]
            else:
                holder[key] = copy.deepcopy(random.choice(JSON_VALUES))
            break
    return json.dumps(root[0]).encode()


def frames_changed(random: Random, frames: Frames) -> Frames:
    """Frames with some lost, repeated, exchanged, shortened, of other identifiers, bytes or stamps."""
    rows = list(frames)
    for _ in range(random.choice((1, 3, 10, 40))):
        if not rows:
            break
        at = random.randrange(len(rows))
        frame = rows[at]
        match random.randrange(8):
            case 0:
                rows[at] = frame._replace(payload=bytes_changed(random, frame.payload)[:2000])
            case 1:
                rows[at] = frame._replace(payload=random.randbytes(len(frame.payload)))
            case 2:
                rows[at] = frame._replace(payload=bytes([random.choice((0, 0x7F, 0x80, 0xFF))]) * len(frame.payload))
            case 3:
                rows[at] = frame._replace(ident=random.choice(INTEGERS) % 2**32)
            case 4:
                rows[at] = frame._replace(t_ns=random.choice((*INTEGERS[:10], 2**62, -(2**62), frame.t_ns + 10**12)))
            case 5:
                del rows[at : at + random.choice((1, 5, 50))]
            case 6:
                rows[at:at] = rows[at : at + random.choice((1, 5))]
            case _:
                other = random.randrange(len(rows))
                rows[at], rows[other] = rows[other], rows[at]
    return Frames.from_iter(frames.source, rows)


def columns_changed(random: Random, columns: dict[str, tuple[str, Any]]) -> dict[str, tuple[str, Any]]:
    """Columns of a table (name → unit, values (N,)) with other values, types, names and units."""
    out = dict(columns)
    for _ in range(random.choice((1, 1, 2, 4))):
        name = random.choice(list(out))
        unit, values = out[name]
        values = np.array(values)
        at = random.randrange(len(values)) if len(values) else 0
        match random.randrange(9):
            case 0 if len(values) and values.dtype.kind == "f":
                values[at:] = random.choice((np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324))
            case 1 if len(values) and values.dtype.kind == "f":
                values[at] = random.choice((np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0))
            case 2:
                values = values[::-1]
            case 3:
                values = np.zeros(len(values), random.choice((np.int8, np.uint64, np.float32, np.bool_)))
            case 4:
                values = np.full(len(values), random.choice(INTEGERS) % 2**62, np.int64)
            case 5 if len(values):
                values = np.full(len(values), values[at])
            case 6:
                unit = random.choice(("", "°", "kN", "m/s/s/", "\x00", "1/0", "%", "degC", "m^^2", "?" * 300))
            case 7:
                others = ("", "t", "time", "a/b", "x.y", "é", name.upper(), name + " [kN]", "\n", "x" * 300)
                other = random.choice(others)
                out = {other if key == name else key: value for key, value in out.items()}
                name = other
            case _:
                if len(out) > 1:
                    del out[name]
                continue
        out[name] = (unit, values)
    return out


def one_changed(random: Random, items: Sequence[T], changed: Callable[[Random, T], T]) -> list[T]:
    """A list with one of its items changed, lost, repeated or moved."""
    out = list(items)
    at = random.randrange(len(out))
    match random.randrange(6):
        case 0:
            del out[at]
        case 1:
            out.insert(random.randrange(len(out)), out[at])
        case 2:
            other = random.randrange(len(out))
            out[at], out[other] = out[other], out[at]
        case _:
            out[at] = changed(random, out[at])
    return out


def renamed(frames: Frames, source: str) -> Frames:
    """The frames of another bus."""
    return replace(frames, source=source)


def _one_replaced(random: Random, text: bytes, pattern: bytes, by: bytes) -> bytes:
    found = list(re.finditer(pattern, text))
    if not found:
        return text
    hit = random.choice(found)
    return text[: hit.start()] + by + text[hit.end() :]
