"""Blocks of decoded samples of one channel, and the flags that a sample can carry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS


class Flag(IntFlag):
    """Fault bits of a sample; `GAP` alone leaves the value usable."""

    OK = 0
    CHECKSUM = 1  # checksum or CRC wrong: values are NaN
    GAP = 2  # by the counter, samples were lost just before this one
    STATUS = 4  # declared invalid by the sensor: values are NaN, or a sentinel that a table holds
    INCOMPLETE = 8  # one of the sample's frames was not received: values are NaN
    RANGE = 16  # at the end of the sensor's range (saturated)
    MISSING = 32  # no value (NaN in an exchange table)
    CLOCK = 64  # the time stamp jumped or went back
    STUCK = 128  # the value stands still in a moving car (found when a run is read)


UNUSABLE = Flag.CHECKSUM | Flag.STATUS | Flag.INCOMPLETE | Flag.RANGE | Flag.MISSING | Flag.CLOCK | Flag.STUCK
"""Flags of samples that the identification leaves out."""


@dataclass(frozen=True)
class Block:
    """Consecutive samples of one channel.

    Attributes
    ----------
    channel : name in the vocabulary.
    t_ns : (N,) int64, receipt stamp of the (first frame of the) sample [ns since the Unix epoch].
    values : (N, k) float64, SI units; NaN at samples with a `CHECKSUM`, `STATUS`, `INCOMPLETE` or `MISSING` flag.
    flags : (N,) uint8, `Flag` bits.
    device_ns : (N,) int64 or None, the sensor's own clock, unwrapped [ns from an arbitrary origin].
    """

    channel: str
    t_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    flags: NDArray[np.uint8]
    device_ns: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        width = CHANNELS[self.channel].width
        n = len(self.t_ns)
        if self.values.shape != (n, width) or self.flags.shape != (n,):
            raise ValueError(f"{self.channel}: {n} stamps, values {self.values.shape}, flags {self.flags.shape}")
        if self.device_ns is not None and self.device_ns.shape != (n,):
            raise ValueError(f"{self.channel}: {n} stamps, device stamps {self.device_ns.shape}")

    def __len__(self) -> int:
        return len(self.t_ns)

    @classmethod
    def concat(cls, blocks: Iterable[Block]) -> Block:
        """The blocks of one channel joined end to end, in the order given (at least one)."""
        items = list(blocks)
        device = None
        if all(block.device_ns is not None for block in items):
            device = np.concatenate([block.device_ns for block in items if block.device_ns is not None])
        return cls(
            items[0].channel,
            np.concatenate([block.t_ns for block in items]),
            np.concatenate([block.values for block in items]),
            np.concatenate([block.flags for block in items]),
            device,
        )
