"""Pauses of channels in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lacet.daq.pauses import Span, alike

_SHOWN = 3
"""Channels, and pauses, that a line names."""


def pause_lines(by_channel: Mapping[str, Sequence[Span]]) -> list[str]:
    """A line for all channels that pause alike: which, and when."""
    return [f"no samples of {_some(names)} {_when(spans)}" for spans, names in alike(by_channel).items()]


def _when(spans: Sequence[Span]) -> str:
    longest = sorted(sorted(spans, key=lambda one: one[0] - one[1])[:_SHOWN])
    more = f", and {len(spans) - _SHOWN} shorter times" if len(spans) > _SHOWN else ""
    return ", ".join(f"from {a:.2f} to {b:.2f} s" for a, b in longest) + more


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
