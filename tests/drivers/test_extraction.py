"""Values of all channels extracted together are those of one signal after the other, bit for bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.can_signal import Signal
from lacet.drivers.framework import extraction
from lacet.drivers.framework.can_layout import Component, Reading
from lacet.drivers.framework.can_messages import TABLE, Numbering
from lacet.drivers.framework.extraction import Extraction

STATUS = Signal("status", 0, 4, False, False, 1.0, 0.0, "", 0, 15)


@st.composite
def components(draw: st.DrawFn) -> Component:
    """A signal anywhere in one of three messages of 8 bytes; every second one is a whole number in memory."""
    if draw(st.booleans()):
        bits = draw(st.sampled_from([8, 16, 32]))
        first = bits * draw(st.integers(0, 64 // bits - 1))
    else:
        bits = draw(st.integers(1, 64))
        first = draw(st.integers(0, 64 - bits))
    big, signed = draw(st.booleans()), draw(st.booleans())
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    factor, offset = draw(st.sampled_from([1.0, 0.25, 0.036, -0.01])), draw(st.sampled_from([0.0, 0.0, -40.0]))
    start = first // 8 * 8 + 7 - first % 8 if big else first
    signal = Signal("s", start, bits, big, signed, factor, offset, "", low, high)
    return Component(draw(st.integers(0, 2)), signal, draw(st.sampled_from([1.0, 1.0, 1e-3, np.pi / 180])))


READINGS = st.lists(
    st.builds(
        Reading, st.just("c"), st.lists(components(), min_size=1, max_size=3).map(tuple), st.just(STATUS), st.booleans()
    ),
    min_size=1,
    max_size=5,
)


@settings(deadline=None)
@given(readings=READINGS, seed=st.integers(0, 99), n=st.integers(0, 5))
def test_together_is_one_by_one(readings: list[Reading], seed: int, n: int):
    samples = np.random.default_rng(seed).choice(np.array([0, 0x7F, 0x80, 0xFF, 3], np.uint8), (n, 3, 8))
    values, saturated = Extraction(readings, 8).values(samples)
    before = extraction.CHUNK
    extraction.CHUNK = 2
    try:
        parts, ends = Extraction(readings, 8).values(samples)
    finally:
        extraction.CHUNK = before
    for reading, own, of_parts, flags, flags_of_parts in zip(readings, values, parts, saturated, ends, strict=True):
        at_end = np.zeros(n, bool)
        for k, component in enumerate(reading.components):
            raw = component.signal.raw(samples[:, component.part])
            expected = component.signal.physical(raw) * component.si
            assert expected.tobytes() == own[:, k].tobytes() == of_parts[:, k].tobytes()
            if not reading.cyclic:
                at_end |= (raw <= component.signal.low) | (raw >= component.signal.high)
        np.testing.assert_array_equal(flags, at_end)
        np.testing.assert_array_equal(flags_of_parts, at_end)


@given(st.lists(st.integers(0, 2**29), min_size=1, max_size=9, unique=True), st.lists(st.integers(0, 2**32 - 1)))
def test_every_id_has_its_number(idents: list[int], others: list[int]):
    for known in (idents, [ident % TABLE for ident in idents]):
        known = list(dict.fromkeys(known))
        asked = [*known, *others, *(ident + 1 for ident in known)]
        expected = [known.index(ident) if ident in known else -1 for ident in asked]
        assert Numbering(known).of(np.array(asked, np.uint32)).tolist() == expected
