"""How certain, and how large, a channel's fault is that the car's equations show."""

from __future__ import annotations

from typing import Final

import scipy

CHANCE: Final = 1e-4
"""Probability that an interval of the estimates misses the true value."""
USUAL: Final = 2.4
"""Half of a 95 % interval ÷ spread, by Student's t of the blocks."""
NOISY: Final = 0.1
"""Largest part of noise in the variance of what an estimate is made with: it is low by no more than that."""
EXPLAINS: Final = 0.8
"""Least part of all excess over the floor that another unit takes away, or a delay."""
MUCH: Final = 3.0
"""Fall of weighted squares ÷ samples of another unit, and of a delay that explains a part only: errors within a sensor
sheet are worth less than 1, a column in thousandths has a thousandfold noise."""
PART: Final = 0.02
"""Least part of all excess over the floor that a wrong sign, or another place, takes away: what else is wrong may take
the rest. A law that the model lacks moves a place too, and explains nearly nothing by it."""
SHOWS: Final = 0.03
"""Least fall of weighted squares ÷ samples for a delay, or for a length of the car: the floors of the rows are known to
some percent."""
LATE_PART: Final = 0.2
"""Least part of the excess that a delay takes away, to first order and again when it is removed."""


def is_large(fall: float, misfit: float) -> bool:
    """Whether a delay explains all that the laws leave, or so much that a missing effect may hold the rest.

    `fall`, `misfit` : weighted squares ÷ samples that it takes away, and before.
    """
    return fall > EXPLAINS * (misfit - 1.0) or fall > max(MUCH, LATE_PART * (misfit - 1.0))


def reach(blocks: int) -> float:
    """Half of an interval that misses with probability `CHANCE` ÷ spread, of a jackknife over so many blocks."""
    return float(scipy.special.stdtrit(blocks - 1, 1.0 - 0.5 * CHANCE))
