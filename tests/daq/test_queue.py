from __future__ import annotations

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.bus.queue import BoundedQueue


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(1, 5)), max_size=60), st.integers(1, 20))
def test_everything_is_delivered_in_order_or_counted_as_dropped(puts, capacity):
    queue: BoundedQueue[int] = BoundedQueue(capacity)
    kept = [i for i, (source, count) in enumerate(puts) if queue.put(i, source, count)]
    assert queue.high_water <= max(capacity, 5)
    assert queue.held == sum(puts[i][1] for i in kept)
    for source in "ab":
        lost = sum(count for i, (s, count) in enumerate(puts) if s == source and i not in kept)
        assert queue.dropped.get(source, 0) == lost
    assert queue.drain() == kept
    assert queue.held == 0


def test_a_producer_is_never_held_up_and_the_sums_agree():
    queue: BoundedQueue[int] = BoundedQueue(50)
    got: list[int] = []

    def consume() -> None:
        while (item := queue.get(1.0)) is not None:
            got.append(item)

    consumer = threading.Thread(target=consume)
    consumer.start()
    for i in range(20_000):
        queue.put(i, "can0")
    queue.close()
    consumer.join(5.0)
    assert got == sorted(got)
    assert len(got) + queue.dropped.get("can0", 0) == 20_000
    assert queue.high_water <= 50


def test_one_item_larger_than_the_queue_passes_when_it_is_empty():
    queue: BoundedQueue[str] = BoundedQueue(10)
    assert queue.put("large", count=100)
    assert not queue.put("next")
    assert queue.get(0.0) == "large"
    assert queue.put("next")


def test_a_closed_queue_gives_what_it_holds_and_takes_nothing():
    queue: BoundedQueue[int] = BoundedQueue(10)
    queue.put(1, "a")
    queue.close()
    assert not queue.put(2, "a")
    assert queue.dropped == {"a": 1}
    assert queue.get() == 1
    assert queue.get() is None


def test_capacity_has_to_make_sense():
    with pytest.raises(ValueError, match="at least 1"):
        BoundedQueue(0)
