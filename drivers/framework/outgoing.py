"""Common parts of the encoders: the channels of one message, and the samples to be sent as not valid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import UNUSABLE, Block, Flag
from lacet.daq.errors import UsageError


def together(blocks: Mapping[str, Block], channels: tuple[str, ...]) -> list[Block]:
    """Blocks of the channels that share one message, in that order; none when none of them is given.

    Raises
    ------
    UsageError : some are missing, or have other stamps.
    """
    given = [channel for channel in channels if channel in blocks]
    if not given:
        return []
    missing = [channel for channel in channels if channel not in blocks]
    if missing:
        raise UsageError(
            f"{', '.join(given)} cannot be encoded without {', '.join(missing)}: they travel in one message. "
            "Give NaN where there is no value."
        )
    first = blocks[channels[0]]
    for channel in channels[1:]:
        if not np.array_equal(first.t_ns, blocks[channel].t_ns):
            raise UsageError(f"{channels[0]} and {channel} travel in one message but have different stamps")
    return [blocks[channel] for channel in channels]


def not_valid(block: Block, saturated: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) samples to be sent as not valid: NaN, or flagged unusable and not shown as such by a saturated value."""
    flagged = (block.flags & np.uint8(UNUSABLE & ~Flag.RANGE)) != 0
    hidden_range = ((block.flags & np.uint8(Flag.RANGE)) != 0) & ~saturated
    return flagged | hidden_range | np.isnan(block.values).any(axis=1)
