"""Measured channels of a run for the page: an overview of each, stored when the run is first listed, and all samples.

The overview is what a picture of the whole run shows: the lowest and the highest of each block of samples. With it the
page draws before the file, of which every reader reads the whole, has been read again.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.daq.formats import mf4
from lacet.daq.formats.open_run import is_own, open_run
from lacet.daq.formats.run_files import further_files
from lacet.daq.maps.mapped_run import map_beside
from lacet.daq.run import Run, Signal
from lacet.services.cache.store import Store
from lacet.services.render.figures.envelope import block_extremes
from lacet.services.workbench.jobs import give_back
from lacet.services.workbench.packed_arrays import packed, unpacked
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.session_cache import one_stamp

BLOCKS = 8192
"""Most blocks of an overview: two to a column of pixels on the widest screens; a channel with no more than twice as
many samples is sent whole instead."""
LEAST_BLOCK = 8
"""Samples of the smallest block; larger ones are this times a power of two, as in the page's own pyramid."""
_LAYOUT = 1
"""Version of what is stored; another one makes it anew."""


class RunChannels:
    """Overviews and samples of runs; the overviews are among the study's cached values, one a run."""

    def __init__(self, folder: Path):
        self._store = Store(folder)
        self._reading = threading.Lock()

    def overview(self, path: Path, names: Sequence[str]) -> bytes:
        """Overview of some channels of a run: a binary answer. Raises NotThere for a channel that it lacks."""
        body = self._store.load("overview", _key(path)) or self.keep(path, self._read(path))
        head, arrays = unpacked(body)
        about = _chosen(head["run"], head["channels"], names)
        wanted = {array for one in about.values() for array in (one["t"], *one["parts"].values())}
        return packed({k: v for k, v in arrays.items() if k in wanted}, run=head["run"], channels=about)

    def samples(self, path: Path, names: Sequence[str]) -> bytes:
        """All samples of some channels of a run, NaN where they cannot be used. Raises NotThere like `overview`."""
        run = self._read(path)
        body = _body(run, _chosen(run.name, run.signals, names), whole=True)
        del run
        give_back()
        return body

    def keep(self, path: Path, run: Run) -> bytes:
        """Store the overview of a run's channels, and return it."""
        body = _body(run, run.signals, whole=False)
        self._store.save("overview", _key(path), body)
        return body

    def _read(self, path: Path) -> Run:
        """The run; one file is read at a time, for each takes the memory of all its samples."""
        with self._reading:
            return open_run(path)


def state_key(path: Path) -> str:
    """State of a run's file and of the files that it is read with: name, time of change and size of each."""
    stamps = [one_stamp(file) for file in (path, *beside(path))]
    return "|".join(f"{Path(place).name}|{changed}|{size}" for place, changed, size in stamps)


def beside(path: Path) -> list[Path]:
    """Further files that a run is read with: those it goes on in, an MDF file's channel map, a CSV table's metadata."""
    if path.suffix.lower() == ".mcap" and (further := further_files(path)):
        return further
    if path.suffix.lower() in mf4.SUFFIXES:
        found = mf4.map_beside(path)
        if found:
            return [found]
    by = map_beside(path)
    if by is not None and not is_own(path):
        return [by, *sorted(path.parent.glob("*.dbc"))]
    metadata = path.with_suffix(".json")
    return [metadata] if path.suffix.lower() == ".csv" and metadata.is_file() else []


def _key(path: Path) -> str:
    return hashlib.sha256(f"{_LAYOUT}|{state_key(path)}".encode()).hexdigest()[:32]


def _chosen(run: str, channels: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    for name in names:
        if name not in channels:
            raise NotThere(f"run {run} has no channel {name}: {', '.join(channels)}")
    return {name: channels[name] for name in names}


def _body(run: Run, signals: Mapping[str, Signal], whole: bool) -> bytes:
    """A binary answer: arrays of times, which channels of one instrument or table share, and of each component."""
    arrays: dict[str, NDArray[np.float32]] = {}
    channels: dict[str, Any] = {}
    times: dict[tuple[int, int], str] = {}
    for name, signal in signals.items():
        block = 1 if whole else block_of(len(signal.t))
        t = times.setdefault((id(signal.t), block), f"t{len(times)}")
        if t not in arrays:
            arrays[t] = signal.t.astype(np.float32) if block == 1 else _block_times(signal.t, block)
        parts = {part: f"{name}.{part}" for part in CHANNELS[name].components or ("value",)}
        for k, array in enumerate(parts.values()):
            arrays[array] = _component(signal, k, block)
        channels[name] = {"unit": CHANNELS[name].unit, "block": block, "t": t, "parts": parts}
    return packed(arrays, run=run.name, channels=channels)


def block_of(samples: int) -> int:
    """Samples of a block of the overview of so many samples; 1 where they are sent themselves."""
    if samples <= 2 * BLOCKS:
        return 1
    block = LEAST_BLOCK
    while block * BLOCKS < samples:
        block *= 2
    return block


def _component(signal: Signal, k: int, block: int) -> NDArray[np.float32]:
    """A component's samples, or the lowest and the highest of each block in turn; NaN where it cannot be used."""
    values = signal.values[:, k].astype(np.float32)
    values[~signal.usable] = np.nan
    return values if block == 1 else np.stack(block_extremes(values, block), axis=1).ravel()


def _block_times(t: NDArray[np.float64], block: int) -> NDArray[np.float32]:
    """Times of the two extremes of each block: of its first sample and of that in its middle; the last is the run's."""
    first = np.arange(0, t.size, block)
    found = t[np.stack([first, np.minimum(first + block // 2, t.size - 1)], axis=1).ravel()]
    found[-1] = t[-1]
    return found.astype(np.float32)
