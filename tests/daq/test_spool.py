from __future__ import annotations

import errno
import os
import zlib

from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.bus.spool import Spool


@given(st.lists(st.tuples(st.sampled_from(["a", "b"]), st.integers(0, 30), st.binary(min_size=1, max_size=9))))
def test_every_message_can_be_had_again_and_the_gaps_are_the_rest(adds):
    spool = Spool()
    kept: dict[str, dict[int, bytes]] = {"a": {}, "b": {}}
    for name, sequence, message in adds:
        spool.add(name, sequence, message)
        kept[name].setdefault(sequence, message)  # what is here stays as it is
    for name, messages in kept.items():
        assert dict(spool.messages(name)) == messages
        assert spool.end(name) == max(messages, default=-1) + 1
        absent = {i for first, last in spool.gaps(name, 40) for i in range(first, last + 1)}
        assert absent == set(range(40)) - set(messages)
        assert spool.checksum(name) == zlib.crc32(b"".join(messages[i] for i in sorted(messages)))
        spool.discard(name)
        assert spool.gaps(name, 40) == [(0, 39)]
    spool.close()


def test_a_full_disk_is_made_up_for_by_memory(monkeypatch):
    spool = Spool()
    spool.add("a", 0, b"zero")

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    spool.add("a", 2, b"two")
    assert [spool.read("a", i) for i in range(3)] == [b"zero", None, b"two"]
    assert spool.gaps("a", 4) == [(1, 1), (3, 3)]
    assert spool.end("a") == 3
    spool.close()
