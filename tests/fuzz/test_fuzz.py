"""Whatever stands in an input, nothing but LacetError comes out of its reader, soon and in bounded memory.

`make test` tries 50 mutations of each target, `make fuzz` 2,000 others.
"""

from __future__ import annotations

import contextlib
import gc
import resource
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lacet.daq.errors import LacetError
from tests.fuzz.containers import Stored
from tests.fuzz.targets import TARGETS, mutated

FEW, MANY = 50, 2_000
"""Mutations of a target in `make test`, and further ones in `make fuzz`."""
MEMORY = 1 << 30
"""Most further address space for one input [bytes]; the inputs are below 1 MB."""
SECONDS = 20.0
"""Longest time for one input [s]; most take some ms."""


@contextmanager
def bounded() -> Iterator[None]:
    """The block may use `MEMORY` more address space, and `SECONDS`."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)

    def late(number: int, frame: Any) -> None:
        raise TimeoutError(f"not read in {SECONDS:g} s")

    before = signal.signal(signal.SIGALRM, late)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, hard))
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)


def use(name: str, data: Any) -> None:
    """Give an input to a target, in a folder of its own."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        TARGETS[name].use(data, Path(folder))


def attack(name: str, numbers: range) -> None:
    """Give mutations to a target after the whole input, which it must accept."""
    use(name, TARGETS[name].seed())
    gc.collect()
    gc.freeze()  # what this target loads is not searched either when a reader collects garbage; see tests/conftest.py
    failed: list[str] = []
    for number in numbers:
        data = mutated(name, number)
        try:
            with bounded():
                use(name, data)
        except LacetError:
            pass
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            failed.append(f"mutated({name!r}, {number}): {type(error).__name__}: {str(error)[:200]}")
    if failed:
        pytest.fail(f"{len(failed)} of {len(numbers)} raise:\n" + "\n".join(failed[:12]))


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_but_lacet_error_comes_out(name: str):
    attack(name, range(FEW))


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_nothing_but_lacet_error_comes_out_of_many(name: str):
    attack(name, range(FEW, FEW + MANY))


# ---- inputs that once cost 32 GiB, or raised


def messages_with(**changed: int) -> list[Stored]:
    """The messages of a whole log, the last block with another number or time."""
    messages = TARGETS["whole log"].seed()
    at = max(i for i, one in enumerate(messages) if one.topic.startswith("/decoded/"))
    return [*messages[:at], messages[at]._replace(**changed), *messages[at + 1 :]]


def table_with(header: str, encoding: str) -> bytes:
    return f"{header}\n0.0,1.0\n0.1,2.0\n".encode(encoding)


RIG, ROAD_DBC, IGEL_DBC = (TARGETS[name].seed() for name in ("rig with drivers", "DBC", "DBC of igel"))
SEEDS: dict[str, tuple[str, Any, str]] = {
    # the target, the input, and what is said of it; nothing where it is read
    "the highest sequence number": ("whole log", messages_with(sequence=2**32 - 1), ""),
    "the highest sequence number, as a run": ("whole log as a run", messages_with(sequence=2**32 - 1), ""),
    "a log time of 2^63": ("whole log recovered", messages_with(log_ns=2**63), ""),
    "the highest log time": ("whole log recovered", messages_with(log_ns=2**64 - 1), ""),
    "a list as a sensor's bus": ("rig", RIG.replace(b'bus = "can0"', b'bus = ["can0"]'), "must be a text"),
    "a table as a sensor's driver": ("rig", RIG.replace(b'"igel"', b"{ name = 1 }"), "must be a text"),
    "an infinite scale in a DBC": ("DBC", ROAD_DBC.replace(b"(0.1, 0)", b"(1e999, 0)"), "has factor inf"),
    "an infinite scale in an instrument's DBC": ("DBC of igel", IGEL_DBC.replace(b"(1,0)", b"(1e999,0)"), "factor inf"),
    "a start bit below zero in a DBC": ("DBC", ROAD_DBC.replace(b": 0|16@1", b": -1|16@1"), "starts at bit -1"),
    "a start bit below zero in an instrument's DBC": ("DBC of igel", IGEL_DBC.replace(b": 0|", b": -1|"), "at bit -1"),
    "a Latin-1 byte in a header": ("exchange table", table_with("t,Gierrate °/s", "latin-1"), "column"),
    "a Latin-1 byte in an import's header": ("import csv", table_with("t,Gierrate [°/s]", "latin-1"), "has Gierrate"),
}  # fmt: skip


@pytest.mark.parametrize("what", SEEDS)
def test_an_input_that_once_failed_does_not(what: str):
    name, data, says = SEEDS[what]
    assert data != TARGETS[name].seed()
    said = contextlib.nullcontext() if not says else pytest.raises(LacetError, match=says)
    with bounded(), said:
        use(name, data)
