"""What is said of one candidate for what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of the model.

    Attributes
    ----------
    key : the effect, with `shape` the constants that fit best.
    answer : ``missing`` (the one proposed, and those tied with it), ``undecided`` (it helps now, and is judged again
        once that one is added), ``not needed`` or ``not testable``.
    why : two plain sentences with numbers.
    gain : what it takes away in blocked cross-validation, as part of the weighted residual of its rows, at most 1;
        `total_gain` the same in weighted squares, of all rows.
    most : part of the weighted residual of one row that it takes away, in the row where that is most.
    gain_rms : the residual it takes away, as RMS over its `rows` of one unit [N or N·m].
    drop : fall of the weighted sum of squares on all data; `p` family-wise probability of such a fall by chance.
    coverage : effective number of blocks it acts in.
    size : √λ of the largest plausible effect after everything else is partialled out.
    absorbed : what takes it up where it cannot be tested, largest share first.
    values : estimates of its parameters [SI], and `interval`, half of their 95 % intervals (independent residuals).
    ties : candidates that cannot be told apart from it on these runs, with their correlation.
    block_gain : (B,) weighted squares it takes away, block by block.

    Examples
    --------
    >>> best = ranking.best
    >>> best.key, best.rows
    ('anti_roll_bar.front', ('suspension.fl', 'suspension.fr'))
    """

    key: str
    shape: Mapping[str, float]
    answer: str = ""
    why: str = ""
    rows: tuple[str, ...] = ()
    gain: float = 0.0
    most: float = 0.0
    gain_rms: float = 0.0
    total_gain: float = 0.0
    drop: float = 0.0
    p: float = 1.0
    coverage: float = 0.0
    size: float = 0.0
    absorbed: tuple[tuple[str, float], ...] = ()
    values: tuple[float, ...] = ()
    interval: tuple[float, ...] = ()
    ties: tuple[tuple[str, float], ...] = ()
    block_gain: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def tested(self) -> bool:
        """Whether the runs could show it."""
        return self.answer != "not testable"
