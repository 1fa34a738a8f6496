"""Bits extracted and inserted by NumPy against cantools, for random layouts."""

from __future__ import annotations

import logging

import cantools.database
import numpy as np
from cantools.database.can import Message as OracleMessage
from cantools.database.can import Signal as OracleSignal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.can_signal import row_width
from lacet.drivers.framework import dbc

logging.getLogger("cantools").setLevel(logging.ERROR)


@st.composite
def layouts(draw):
    """One message of 1 to 64 bytes with up to 8 signals that may overlap (each is checked on its own)."""
    length = draw(st.one_of(st.integers(1, 8), st.integers(9, 64)))
    signals = []
    for i in range(draw(st.integers(1, 8))):
        bits = draw(st.integers(1, min(64, 8 * length)))
        first = draw(st.integers(0, 8 * length - bits))
        big = draw(st.booleans())
        start = first // 8 * 8 + 7 - first % 8 if big else first
        factor = draw(st.sampled_from([1, 0.5, 0.036, -0.01, 3]))
        offset = draw(st.sampled_from([0, -40, 12.5]))
        signals.append((f"s{i}", start, bits, big, draw(st.booleans()), factor, offset))
    return length, signals


def text_of(length, signals):
    """Each signal in a message of its own, of the signal's name: cantools does not decode overlapping signals."""
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: A"]
    for name, start, bits, big, signed, factor, offset in signals:
        order = f"@{0 if big else 1}{'-' if signed else '+'}"
        lines.append(f"BO_ {5 + int(name[1:])} {name}: {length} A")
        lines.append(f' SG_ {name} : {start}|{bits}{order} ({factor},{offset}) [0|0] "" A')
    return "\n".join(lines) + "\n"


def rows_of(payloads, length):
    rows = np.random.default_rng(0).integers(0, 256, (len(payloads), row_width(length)), dtype=np.uint8)
    rows[:, :length] = np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), length)
    return rows


@settings(deadline=None)
@given(layout=layouts(), data=st.data())
def test_extraction_is_that_of_cantools(layout, data):
    length, signals = layout
    payloads = data.draw(st.lists(st.binary(min_size=length, max_size=length), min_size=1, max_size=6))
    text = text_of(length, signals)
    oracle = cantools.database.load_string(text, "dbc", strict=False)
    ours = dbc.parse(text, "x.dbc")
    assert not ours.faults
    rows = rows_of(payloads, length)
    for name, message in ours.messages.items():
        signal = message.signals[name]
        raw = [oracle.decode_message(name, payload, scaling=False)[name] for payload in payloads]
        assert [int(value) for value in signal.raw(rows)] == raw
        expected = [float(oracle.decode_message(name, payload)[name]) for payload in payloads]
        np.testing.assert_allclose(signal.physical(signal.raw(rows)), expected, rtol=1e-12, atol=1e-9)


@settings(deadline=None)
@given(layout=layouts(), data=st.data())
def test_insertion_is_that_of_cantools_and_leaves_other_bits_alone(layout, data):
    length, signals = layout
    name, start, bits, big, signed, _, _ = data.draw(st.sampled_from(signals))
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    value = data.draw(st.integers(low, high))
    conversion = BaseConversion.factory()
    oracle = OracleMessage(
        5, "m", length,
        [OracleSignal(name, start, bits, "big_endian" if big else "little_endian", signed, conversion=conversion)],
    )  # fmt: skip
    ours = dbc.parse(text_of(length, signals), "x.dbc").messages[name].signals[name]
    zeros = np.zeros((2, row_width(length)), np.uint8)
    full = np.full_like(zeros, 255)
    dtype = np.int64 if signed else np.uint64
    for rows in (zeros, full):
        ours.put(rows, np.full(2, value, dtype))
        assert [int(raw) for raw in ours.raw(rows)] == [value, value]
    assert zeros[0, :length].tobytes() == oracle.encode({name: value})
    untouched = np.unpackbits(zeros[0], bitorder="little") ^ np.unpackbits(full[0], bitorder="little")
    assert set(np.flatnonzero(untouched == 0).tolist()) == set(ours.bits)


def test_the_reference_dbc_files_decode_as_cantools_does():
    rng = np.random.default_rng(1)
    for name in ("igel", "lasers", "correvit"):
        text = (dbc_folder() / f"{name}.dbc").read_text(encoding="utf-8")
        database = dbc.parse(text, name)
        assert not database.faults
        oracle = cantools.database.load_string(text, "dbc")
        for message in database.messages.values():
            payloads = [rng.bytes(message.length) for _ in range(50)]
            rows = rows_of(payloads, message.length)
            expected = [oracle.decode_message(message.ident, payload) for payload in payloads]
            for signal in message.signals.values():
                values = [float(row[signal.name]) for row in expected]
                np.testing.assert_allclose(signal.physical(signal.raw(rows)), values, rtol=1e-12)


def dbc_folder():
    from lacet.drivers.framework.can_layout import FOLDER

    return FOLDER
