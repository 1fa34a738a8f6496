"""Rig file text with other latencies; comments, order and spelling are unchanged."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping

_TABLE = re.compile(r"^\s*\[")
_ROW = re.compile(r"^\s*\[\[\s*sensor\s*\]\]")
_NAME = re.compile(r"""^\s*name\s*=\s*(["'])(.*?)\1""")
_LATENCY = re.compile(r"^(\s*latency\s*=\s*)[^#\s]+(.*)$")


def with_latencies(text: str, latencies: Mapping[str, float]) -> str:
    """The text of a rig file with these latencies [s] by sensor name, to a hundredth of a millisecond.

    A sensor without a latency gets one after its name.
    """
    lines = text.splitlines()
    heads = [i for i, line in enumerate(lines) if _TABLE.match(line)] + [len(lines)]
    for start, stop in reversed(list(itertools.pairwise(heads))):
        if not _ROW.match(lines[start]):
            continue
        named = {m.group(2): i for i in range(start, stop) if (m := _NAME.match(lines[i]))}
        for name, place in named.items():
            if name not in latencies:
                continue
            value = f"{latencies[name]:.5f}"
            there = [i for i in range(start, stop) if _LATENCY.match(lines[i])]
            if there:
                lines[there[0]] = _LATENCY.sub(lambda m, value=value: m.group(1) + value + m.group(2), lines[there[0]])
            else:
                lines.insert(place + 1, f"latency = {value}")
    return "\n".join(lines) + "\n"
