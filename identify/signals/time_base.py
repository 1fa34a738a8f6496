"""Latencies of instruments as first-order changes of their channels, relative to one instrument, the time base.

The equations of motion do not depend on absolute time: a latency that all instruments share does not change the
residual. Its column would consist of little but noise, because columns built from measured rates do not cancel
exactly. So one instrument is the time base, and its latency is expressed as the opposite latency of all others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.reconstruct import Recording


def is_load(channel: str) -> bool:
    """Whether a channel is a load that every row of the equations needs."""
    return channel.startswith("wheel.") and channel.endswith(".force")


def base_channel(channels: Iterable[str]) -> str:
    """A channel of the time base: the first load, else the first channel."""
    names = list(channels)
    return next(filter(is_load, names), names[0])


def late(members: Collection[str], recording: Recording) -> dict[str, Array]:
    """Change of channels per second of latency of the channels `members`, to first order: channel → (k, N) [unit/s].

    −ẋ of each of them that the run has; for the time base ẋ of all others.
    """
    values, rate = recording.signals.value, recording.filters.rate
    early = base_channel(values) in members
    sign = 1.0 if early else -1.0
    return {name: sign * derivative(a, rate) for name, a in values.items() if (name in members) != early}
