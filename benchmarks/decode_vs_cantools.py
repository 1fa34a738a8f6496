"""Decoding wheel dynamometer frames: this project's driver against cantools, in one run on one machine.

Run: ``python benchmarks/decode_vs_cantools.py``. Absolute figures vary with the machine; the ratio holds.
cantools only decodes here; the driver also checks checksum, counter and status and converts to SI units.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cantools.database
import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.frames import Frames
from lacet.drivers import open_driver

SAMPLES = 50_000
"""Samples a wheel: 600,000 frames, 100 s."""


def best_of(repeats: int, work: Callable[[], object]) -> float:
    """Shortest of several runs [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Print frames per second of cantools and of the driver, on whole arrays and in live batches."""
    driver = open_driver("igel", "can0")
    rng = np.random.default_rng(0)
    t_ns = np.arange(SAMPLES, dtype=np.int64) * 2_000_000
    flags = np.zeros(SAMPLES, np.uint8)
    blocks = {c: Block(c, t_ns, rng.normal(size=(SAMPLES, CHANNELS[c].width)), flags) for c in driver.channels}
    frames = driver.encode(blocks)

    database = cantools.database.load_string(next(iter(driver.documents.values())), "dbc")
    assert isinstance(database, cantools.database.Database)
    few = [(frame.ident, frame.payload) for frame in frames[:20_000]]
    rate = {"cantools": len(few) / best_of(3, lambda: [database.decode_message(*frame) for frame in few])}
    rate["driver, whole array"] = len(frames) / best_of(5, lambda: driver.decode(frames, driver.start()))
    for ms in (100, 20):
        n = 6 * ms
        batches = [frames[i : i + n] for i in range(0, 60_000, n)]
        rate[f"driver, batches of {ms} ms"] = 60_000 / best_of(3, lambda batches=batches: _live(driver, batches))
    for what, value in rate.items():
        print(f"{what:26s} {value / 1e6:8.3f} M frames/s  {value / rate['cantools']:6.1f} × cantools")


def _live(driver, batches: list[Frames]) -> None:
    state = driver.start()
    for batch in batches:
        _, state = driver.decode(batch, state)


if __name__ == "__main__":
    main()
