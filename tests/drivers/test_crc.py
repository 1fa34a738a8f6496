"""CRCs over many messages against crccheck, zlib and the catalogue's check values."""

from __future__ import annotations

import zlib

import crccheck.crc
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.drivers.framework.crc import CRC8_J1850, CRC16_CCITT_FALSE, CRC32, RowCrc

ORACLES = {
    "CRC-8/SAE-J1850": crccheck.crc.Crc8SaeJ1850.calc,
    "CRC-16/CCITT-FALSE": crccheck.crc.Crc16CcittFalse.calc,
    "CRC-32/ISO-HDLC": zlib.crc32,
}
CHECK = {"CRC-8/SAE-J1850": 0x4B, "CRC-16/CCITT-FALSE": 0x29B1, "CRC-32/ISO-HDLC": 0xCBF43926}
every_crc = pytest.mark.parametrize("crc", [CRC8_J1850, CRC16_CCITT_FALSE, CRC32], ids=lambda crc: crc.name)


@every_crc
def test_check_value(crc):
    assert crc.over(np.frombuffer(b"123456789", np.uint8)[None])[0] == CHECK[crc.name]


@every_crc
@given(data=st.data(), length=st.integers(0, 40), n=st.integers(0, 5))
def test_same_as_the_oracle(crc, data, length, n):
    messages = data.draw(st.lists(st.binary(min_size=length, max_size=length), min_size=n, max_size=n))
    rows = np.frombuffer(b"".join(messages), np.uint8).reshape(n, length)
    assert crc.over(rows).tolist() == [ORACLES[crc.name](message) for message in messages]


@every_crc
@given(data=st.data())
def test_by_tables_is_byte_by_byte(crc, data):
    """Some columns of rows in any order, some of their bits, the rest taken as 0."""
    width = 2 * data.draw(st.integers(1, 6))
    columns = data.draw(st.lists(st.integers(0, width - 1), min_size=1, max_size=width, unique=True))
    masks = data.draw(st.lists(st.integers(0, 255), min_size=len(columns), max_size=len(columns)))
    rows = np.frombuffer(data.draw(st.binary(min_size=3 * width, max_size=3 * width)), np.uint8).reshape(3, width)
    message = rows[:, columns] & np.array(masks, np.uint8)
    by_tables = RowCrc(crc, width, list(zip(columns, masks, strict=True)))
    assert by_tables.over(rows).tolist() == crc.over(message).tolist()
    assert by_tables.over(rows[:0]).tolist() == []
