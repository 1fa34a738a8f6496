"""Store of a channel's blocks: those on disk are read as they were put, those not needed are dropped."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.set_aside import DiskSpace
from lacet.services.acquisition.block_store import HELD, STRETCH, BlockStore

BEGIN = 1_790_000_000_123_456_789
COUNT = (HELD + 4) * STRETCH


def block(number: int) -> Block:
    """Two samples of a channel."""
    t_ns = BEGIN + 50_000_000 * number + np.array([0, 25_000_001], np.int64)
    values = np.array([[1.0, np.nan, number], [2.0, -0.0, -number]])
    return Block("imu.accel", t_ns, values, np.array([0, number % 256], np.uint8), t_ns + 7)


@pytest.fixture
def store() -> BlockStore:
    out, space = BlockStore(), DiskSpace()
    numbers = [number for number in range(COUNT) if number != STRETCH + 3]
    assert sum(out.add(number, block(number), space) for number in numbers) == 2
    # One that was missed comes last: its stretch goes to disk with it.
    assert out.add(STRETCH + 3, block(STRETCH + 3), space)
    return out


def test_what_is_on_disk_is_read_as_it_was_put(store: BlockStore):
    found, wanted = store.read(0, 2**63 - 1), Block.concat(map(block, range(COUNT)))
    assert found is not None
    assert store.end == COUNT
    assert found.device_ns is not None
    for name in ("t_ns", "values", "flags", "device_ns"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
        assert getattr(found, name).dtype == getattr(wanted, name).dtype


def test_a_part_has_the_blocks_asked_for(store: BlockStore):
    first, last = 2 * STRETCH + 5, COUNT - 9
    found = store.read(int(block(first).t_ns[0]), int(block(last).t_ns[-1]))
    assert found is not None
    # Stretches on disk are read whole.
    assert (found.t_ns[0], found.t_ns[-1]) == (block(2 * STRETCH).t_ns[0], block(last).t_ns[-1])
    assert store.read(int(block(COUNT).t_ns[0]), 2**63 - 1) is None


def test_what_is_not_needed_is_dropped_and_stays_so(store: BlockStore):
    store.forget(int(block(4 * STRETCH + 1).t_ns[0]))
    store.add(3, block(3), DiskSpace())
    found = store.read(0, 2**63 - 1)
    assert found is not None
    assert found.t_ns[0] == block(4 * STRETCH).t_ns[0]
    store.forget(2**63 - 1)
    found = store.read(0, 2**63 - 1)
    assert found is not None
    assert len(found) == 2 * STRETCH


def test_a_full_disk_loses_no_block():
    class Full(DiskSpace):
        def _write(self, array: np.ndarray) -> None:
            raise OSError(28, "no space left")

    store, failed = BlockStore(), 0
    for number in range(COUNT):
        try:
            store.add(number, block(number), Full())
        except OSError:
            failed += 1
    assert failed
    found = store.read(0, 2**63 - 1)
    assert found is not None
    assert len(found) == 2 * COUNT
