"""Run: the measured channels of one drive as arrays, from any file format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.angles import ContinuousAngle
from lacet.daq.blocks import UNUSABLE, Flag
from lacet.daq.channels import CHANNELS, STANDARD
from lacet.daq.set_aside import DiskSpace

METADATA_KEYS = ("vehicle", "manoeuvre", "rig", "wheel_reference", "brakes", "notes")
"""What is declared of a run beside its channels."""
UNWRAPPED = ("wheel.angle", "imu.attitude", "gnss.course")
"""Families of angles that are made continuous on reading (`daq.angles`)."""
BRAKES = ("off", "used", "unknown")
HELD = 50_000_000
"""Largest size of a run's values that are held in memory while its equations are formed [bytes]: about ten minutes
of the paper's channels."""


@dataclass(frozen=True)
class Signal:
    """One channel of a run as a time series.

    `t` (N,) s since the run's start, as stamped (no latency removed), strictly increasing; `values` (N, k) SI;
    `flags` (N,) uint8, `daq.blocks.Flag` bits.
    """

    t: NDArray[np.float64]
    values: NDArray[np.float64]
    flags: NDArray[np.uint8]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N,) samples that the identification may use."""
        return (self.flags & int(UNUSABLE)) == 0


def signal_of(
    channel: str, t: NDArray[np.float64], values: NDArray[np.float64], flags: NDArray[np.uint8] | None = None
) -> Signal:
    """A signal from raw values (N, k): NaN and infinities flagged as missing, angles continuous over usable samples."""
    flags = np.zeros(len(t), np.uint8) if flags is None else flags.copy()
    bad = ~np.all(np.isfinite(values), axis=1)
    flags[bad & (flags == 0)] |= np.uint8(Flag.MISSING)
    out = Signal(t, values, flags)
    if CHANNELS[channel].family in UNWRAPPED and np.any(out.usable):
        values = values.copy()
        values[out.usable] = ContinuousAngle().add(values[out.usable])
        out = Signal(t, values, flags)
    return out


class SignalsOnDisk(Mapping[str, Signal]):
    """Signals of a long run on disk, each read whenever it is asked for; their flags stay in memory.

    Raises OSError when the disk is full.
    """

    def __init__(self, signals: Mapping[str, Signal]):
        # The columns of a table share their stamps, which are written once.
        self._stamps = {name: f"stamps {id(signal.t)}" for name, signal in signals.items()}
        stamps = {self._stamps[name]: signal.t for name, signal in signals.items()}
        each = chain(stamps.items(), ((name, signal.values) for name, signal in signals.items()))
        self._arrays = DiskSpace().put_each(each)
        self._flags = {name: signal.flags.copy() for name, signal in signals.items()}

    def __getitem__(self, name: str) -> Signal:
        return Signal(self._arrays[self._stamps[name]], self._arrays[name], self._flags[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._stamps)

    def __len__(self) -> int:
        return len(self._stamps)

    def __contains__(self, name: object) -> bool:
        return name in self._stamps


class ChosenSignals(Mapping[str, Signal]):
    """Some signals of a run and others beside them; none of the run's is read before it is asked for."""

    def __init__(self, signals: Mapping[str, Signal], names: Sequence[str], beside: Mapping[str, Signal]):
        self._signals, self._beside = signals, beside
        self._names = dict.fromkeys([*names, *beside])

    def __getitem__(self, name: str) -> Signal:
        if name not in self._names:
            raise KeyError(name)
        return self._beside[name] if name in self._beside else self._signals[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names


class Mark(NamedTuple):
    """A marker that was set while a run was recorded: when, in seconds since the run's start, and its text."""

    t: float
    text: str


@dataclass(frozen=True)
class Run:
    """Measured channels of one drive.

    Attributes
    ----------
    name : short name, the file's stem.
    signals : by channel name; a channel that was not measured is absent.
    vehicle, manoeuvre, rig, notes : as declared, or empty.
    wheel_reference : ``contact`` or ``hub``; empty where the rig's is valid.
    brakes : ``off``, ``used`` or ``unknown``: determines which rows of driven and braked wheels hold.
    vehicle_text, rig_text : full text of the files, where the log holds them.
    problems : faults of the file, one line each.
    marks : markers that were set while it was recorded, in their order.

    Examples
    --------
    >>> run = lacet.open_run("tests/data/car/sine.parquet")
    >>> run.signals["laser.fl.hub"].values.shape[1]
    1
    >>> run.missing
    ()
    """

    name: str
    signals: Mapping[str, Signal]
    vehicle: str = ""
    manoeuvre: str = ""
    rig: str = ""
    wheel_reference: str = ""
    brakes: str = "unknown"
    notes: str = ""
    vehicle_text: str = ""
    rig_text: str = ""
    problems: tuple[str, ...] = field(default=())
    marks: tuple[Mark, ...] = ()

    @property
    def duration(self) -> float:
        """Time covered by the longest channel [s]."""
        return max((float(s.t[-1] - s.t[0]) for s in self.signals.values() if len(s.t)), default=0.0)

    @property
    def missing(self) -> tuple[str, ...]:
        """Channels of the paper's instruments that this run lacks."""
        return tuple(name for name in STANDARD if name not in self.signals)

    def on_disk(self) -> Run:
        """The run with its signals on disk where they take much memory, and the disk has room for them."""
        size = sum(signal.values.nbytes for signal in self.signals.values())
        if size <= HELD:
            return self
        try:
            return replace(self, signals=SignalsOnDisk(self.signals))
        except OSError:
            return self

    def with_values(self, values: Mapping[str, NDArray[np.float64]]) -> Run:
        """The run with other values in some channels (for simulated noise and sensor faults)."""
        signals = dict(self.signals)
        for name, array in values.items():
            signals[name] = replace(signals[name], values=array)
        return replace(self, signals=signals)
