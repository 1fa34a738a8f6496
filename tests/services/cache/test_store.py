"""The folder of cached values: whole files or none, bounded, and never in the way."""

from __future__ import annotations

import multiprocessing
import os
import signal
import zipfile
from pathlib import Path

import numpy as np
import pytest

from lacet.services.cache.store import FOLDER, Store

VALUE = {"a": np.arange(2000.0).reshape(40, 50), "b": ("text", 1.5, None)}


def equal(found: object) -> bool:
    """Whether it is VALUE."""
    return isinstance(found, dict) and np.array_equal(found["a"], VALUE["a"]) and found["b"] == VALUE["b"]


def test_a_value_is_kept_by_kind_and_key(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.load("fit", "1") is None
    store.save("fit", "1", VALUE)
    assert equal(store.load("fit", "1"))
    assert store.load("fit", "2") is None
    assert store.load("floor", "1") is None
    assert (tmp_path / FOLDER / ".gitignore").read_text() == "*\n"
    assert store.clear() == 1
    assert store.load("fit", "1") is None


def test_a_damaged_file_counts_as_absent(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.save("fit", "1", VALUE)
    (file,) = (tmp_path / FOLDER).glob("fit-*")
    whole = file.read_bytes()
    for part in (0.0, 0.0001, 0.003, 0.5, 0.999):
        file.write_bytes(whole[: int(part * len(whole))])
        assert store.load("fit", "1") is None
    with zipfile.ZipFile(file, "w"):
        pass
    assert store.load("fit", "1") is None
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        found = store.load("fit", "1")
        assert found is None or equal(found)  # a bit that no reader looks at
    file.write_bytes(whole)
    assert equal(store.load("fit", "1"))


def test_what_was_not_used_for_longest_goes_first(tmp_path: Path) -> None:
    size = 8 * VALUE["a"].size
    store = Store(tmp_path, most=4 * size)
    for number in range(6):
        store.save("fit", str(number), VALUE)
        for k, file in enumerate(sorted((tmp_path / FOLDER).glob("fit-*"))):
            os.utime(file, (1000.0 + k, 1000.0 + k))
        assert equal(store.load("fit", "0")), "it was used a moment ago"
    kept = {number for number in range(6) if store.load("fit", str(number)) is not None}
    assert {0, 5} <= kept
    assert len(kept) == 3


def test_what_an_older_lacet_kept_is_removed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.save("fit", "1", VALUE)
    for name in ("noise-0123.npz", "runs.json", "paces.json"):
        (tmp_path / FOLDER / name).write_bytes(b"{}")
    store.save("fit", "2", VALUE)
    names = {file.name for file in (tmp_path / FOLDER).iterdir()}
    assert names == {".gitignore", "fit-1.zip", "fit-2.zip", "runs.json", "paces.json"}


def test_a_folder_that_cannot_be_written_to_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / FOLDER).write_text("a file where the folder should be")
    store = Store(tmp_path)
    store.save("fit", "1", VALUE)
    assert store.load("fit", "1") is None


def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(np.lib.format, "write_array", full)
        Store(tmp_path).save("fit", "1", VALUE)
    assert Store(tmp_path).load("fit", "1") is None
    assert [file.name for file in (tmp_path / FOLDER).iterdir()] == [".gitignore"]


def _writes_for_ever(folder: Path) -> None:
    store = Store(folder)
    while True:
        store.save("fit", "1", VALUE)


def test_two_writers_and_a_killed_one_leave_a_whole_value(tmp_path: Path) -> None:
    spawned = multiprocessing.get_context("spawn")
    writers = [spawned.Process(target=_writes_for_ever, args=(tmp_path,)) for _ in range(2)]
    for writer in writers:
        writer.start()
    store, seen = Store(tmp_path), 0
    try:
        while seen < 50:
            found = store.load("fit", "1")
            assert found is None or equal(found)
            seen += found is not None
            if seen == 25 and writers[0].is_alive():
                assert writers[0].pid is not None
                os.kill(writers[0].pid, signal.SIGKILL)
    finally:
        for writer in writers:
            writer.kill()
            writer.join()
    assert equal(store.load("fit", "1"))
