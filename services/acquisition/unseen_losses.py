"""Samples lost in a hole of a damaged log that counters do not show, by the time that the hole lasts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.clock import UNSEEN
from lacet.daq.formats.log import LogReader
from lacet.daq.stuck import instrument
from lacet.services.acquisition.stream_decoder import Decoder


class UnseenLosses:
    """Count of the samples that whole turns of counters hide where raw frames of a log are missing.

    It is added to `Decoder.unseen`. Only sensors of a constant rate (``clock = "steady"``) are counted, one channel of
    each instrument: its samples are lost together.
    """

    def __init__(self, reader: LogReader, decoder: Decoder):
        self._holes, self._decoder = reader.holes, decoder
        self._rates: dict[str, dict[str, float]] = {}
        self._last: dict[str, int] = {}
        self._done: set[tuple[str, int]] = set()
        for one in decoder.watched:
            firsts = {instrument(name): (name, rate) for name, rate in list(one.rates.items())[::-1] if rate}
            if one.numbered:
                self._rates.setdefault(one.bus, {}).update(dict(firsts.values()))

    def may_be(self, source: str) -> bool:
        """Whether frames of a bus with such sensors are missing, in what was read so far."""
        return bool(self._holes.get(source)) and source in self._rates

    def note(self, blocks: Sequence[Block], source: str, shown: int) -> None:
        """Follow the samples decoded next of a bus, of which counters show so many to be lost before or between."""
        rates = self._rates.get(source, {})
        expected: list[float] = []
        for block in blocks:
            if block.channel not in rates or not len(block):
                continue
            last = self._last.get(block.channel)
            t_ns = block.t_ns if last is None else np.concatenate(([last], block.t_ns))
            self._last[block.channel] = int(t_ns[-1])
            for begin in self._holes.get(source, {}):
                at = int(np.searchsorted(t_ns, begin, "right"))
                if 0 < at < len(t_ns) and (block.channel, begin) not in self._done:
                    self._done.add((block.channel, begin))
                    expected.append((t_ns[at] - t_ns[at - 1]) / 1e9 * rates[block.channel] - 1.0)
        # The instruments of one bus lose alike: a part of what their counters show is of each.
        seen = shown / max(1, len(expected))
        self._decoder.unseen[source] += sum(UNSEEN * max(0, round((one - seen) / UNSEEN)) for one in expected)
