"""Live fit of a long run: memory and processor time by the length of the run, fed as fast as it takes the samples.

Run: ``python -m benchmarks.live_fit --minutes 20``. The samples of one capture come again and again, as blocks of 50 ms
as the recorder makes them; each second of them is fitted, and the fits from scratch beside the sums are waited for.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.decode_vs_cantools import CAPTURE, TILE_NS
from lacet.daq.blocks import Block
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import Keys
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.wire import block_to_bytes, start_to_bytes
from lacet.services.acquisition.live_samples import LiveSamples
from lacet.services.acquisition.stream_decoder import decode_frames
from lacet.services.workspace.decode import open_decoder
from lacet.services.workspace.live_fit import LiveFit
from lacet.services.workspace.live_follow import model_of_study

BATCH_NS = 50_000_000
"""Duration of a block [ns]."""
SHOWN = 60
"""Seconds of the run from line to line [s]."""
KEYS = Keys("car", "run")


class Unheard(BusListener):
    """A listener without a bus, of which nothing is asked."""

    def __init__(self) -> None:
        pass

    def ask_blocks(self, keys: Keys, channel: str, first: int, last: int) -> None:
        """Nothing: no block is missing."""


def main() -> None:
    """Measure and print a line each minute of the run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0, help="length of the run (20)")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond the base model")
    args = parser.parse_args()
    reader = LogReader(CAPTURE)
    decoder = open_decoder(reader, None, [])
    tile = {name: list(batches(block)) for name, block in decode_frames(
        decoder, [reader.frames(source) for source in reader.sources()]).items()}  # fmt: skip
    samples = LiveSamples(Unheard())
    for kind, payload in (("alive", b""), ("start", start_to_bytes(reader.start))):
        samples.take(Message(KEYS, kind, "", 0, payload))
    live = LiveFit(reader.start, model_of_study(None, tuple(args.add)), 0.02)
    begun, since, cpu = time.monotonic(), 0.0, time.process_time()
    numbers = dict.fromkeys(tile, 0)
    most, took, fitted = 0.0, 0.0, 0
    for second in range(1, round(60 * args.minutes) + 1):
        for name, blocks in tile.items():
            while True:
                number = numbers[name]
                again, place = divmod(number, len(blocks))
                block = shifted(blocks[place], again * TILE_NS)
                if int(block.t_ns[-1]) - reader.start.started_ns > 1e9 * (second + 0.06):
                    break
                samples.take(Message(KEYS, "block", name, number, block_to_bytes(block, number, "")))
                numbers[name] = number + 1
        if second < 5:
            continue
        found = live.update(samples, second)
        live.wait()
        took, fitted, since = took + found.took, fitted + 1, found.since
        most = max(most, found.took)
        if second % SHOWN == 0:
            now = time.process_time()
            print(
                f"{second:5d} s: {resident('VmRSS'):6.0f} MB, at most {resident('VmHWM'):6.0f}; a second's fit "
                f"{took / fitted:.3f} s of the processor, at most {most:.3f}; all together {(now - cpu) / SHOWN:.3f}; "
                f"from scratch at {since:.0f} s; {time.monotonic() - begun:.0f} s passed",
                flush=True,
            )
            most, took, fitted, cpu = 0.0, 0.0, 0, now


def batches(block: Block) -> Iterator[Block]:
    """A block in parts of `BATCH_NS`."""
    edges = np.flatnonzero(np.diff(block.t_ns // BATCH_NS, prepend=-1)).tolist()
    for a, b in zip(edges, [*edges[1:], len(block)], strict=True):
        device = None if block.device_ns is None else block.device_ns[a:b]
        yield Block(block.channel, block.t_ns[a:b], block.values[a:b], block.flags[a:b], device)


def shifted(block: Block, by_ns: int) -> Block:
    """A block so much later."""
    device = None if block.device_ns is None else block.device_ns + by_ns
    return Block(block.channel, block.t_ns + by_ns, block.values, block.flags, device)


def resident(name: str) -> float:
    """Memory of this process [MB] by its name in the kernel's table."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith(name))) / 1024.0


if __name__ == "__main__":
    main()
