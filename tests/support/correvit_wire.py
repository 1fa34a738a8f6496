"""A bus with the frames of a Correvit, as a recorder reads one, and its sensor in a rig."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from tests.drivers.driver_cases import plausible_blocks

CORREVIT = """
[[sensor]]
name = "correvit"
driver = "correvit"
bus = "can0"
channels = ["correvit.speed"]
axes = "sensor"
position = [-3.2, 0.0, 0.01]
"""


class CorrevitWire:
    """A bus with the frames of a Correvit, so many (`batch`) every 20 ms; 5 are its rate.

    `act` is called before each read with the number of reads so far.
    """

    source = "can0"

    def __init__(self, batch: int = 5, act: Callable[[int], None] = lambda reads: None) -> None:
        self.warnings: list[str] = []
        driver = open_driver("correvit", "can0")
        self._frames = driver.encode(plausible_blocks(driver, 10_000, 1))
        self._batch, self._act = batch, act
        self.reads = self.sent = 0

    def open(self) -> None:
        pass

    def read(self, timeout: float) -> Frames:
        time.sleep(0.02)
        self._act(self.reads)
        self.reads += 1
        some = self._frames[self.sent : self.sent + self._batch]
        self.sent += len(some)
        return Frames(some.source, np.full(len(some), time.time_ns()), some.ident, some.offset, some.data)

    def losses(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        pass
