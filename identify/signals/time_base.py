"""What instruments that are read late do to the equations of motion.

The equations do not know what time it is: all instruments late alike are the same motion, told later. Columns made of
measured rates do not add up to nothing, though: their noise stays, and in what is hardly seen (all clocks together) it
would be nearly all there is. So one instrument is the time base, and its being late is written as all others being
early.
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
    """The channel whose instrument is the time base: the first load, or the first there is."""
    names = list(channels)
    return next(filter(is_load, names), names[0])


def late(members: Collection[str], recording: Recording) -> dict[str, Array]:
    """Change of channels (k, N) per second that the instrument of the channels `members` is late, to first order.

    −ẋ of each of them that the run has; of the time base ẋ of all others.
    """
    values, rate = recording.signals.value, recording.filters.rate
    early = base_channel(values) in members
    sign = 1.0 if early else -1.0
    return {name: sign * derivative(a, rate) for name, a in values.items() if (name in members) != early}
