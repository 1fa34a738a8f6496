"""Candidates of a ranking, with what their tests found and the answer to each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, StrEnum, auto

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.selection.settings import SELECTION


class Answer(StrEnum):
    """Answer of a ranking to one candidate: whether the model lacks it."""

    MISSING = "missing"
    """It is found to be missing."""
    UNDECIDED = "undecided"
    """It could be in the place of one found (`Candidate.stands_for`); or it is not judged yet."""
    STANDS_IN = "stands in"
    """It stands out alone, and not beside the effects found: it looks like one of them (`Candidate.stands_for`)."""
    IMPLAUSIBLE = "implausible size"
    SMALL = "smaller than asked for"
    """It is there, and takes away less than asked for, or than the laws found may be inexact."""
    NOT_NEEDED = "not needed"
    NOT_TESTABLE = "not testable"


class Reason(Enum):
    """Reason for a candidate's answer."""

    NOT_COMPUTABLE = auto()
    """A run lacks what it needs (`Candidate.lacks`)."""
    NEVER_ACTS = auto()
    ROWS_ABSENT = auto()
    """The runs form none of the rows that it acts on (`Candidate.lacks`)."""
    NOT_RECORDED = auto()
    """It is a fault of channels that no run has."""
    IN_THE_MODEL = auto()
    """The model explains its columns on these runs."""
    FEW_BLOCKS = auto()
    """Its `coverage` is below `least_coverage`."""
    SMALL = auto()
    """Its `size` is below `least_size`; `absorbed` names what explains its columns."""
    NOISE = auto()
    """More than `most_noise_in_candidate` of its columns is noise, which is their own (`noise_part`)."""
    CHANCE = auto()
    """Its `p` is above `significance`."""
    LITTLE = auto()
    """Its `gain` and `most` are below `least_gain`."""
    IMPLAUSIBLE = auto()
    """A parameter is outside what is plausible on any car."""
    INEXACT = auto()
    """It takes away no more than the laws found may be inexact (`law_inexactness`)."""
    STANDS_IN = auto()
    """Beside the effects found it takes nothing away that chance does not."""
    PART_OF_REST = auto()
    """It was in the set found and explains no more than remains unlisted in its rows."""
    ASSUMED = auto()
    """It was in the set found, and errors of assumed channels may stand for it."""
    TIED = auto()
    """It was in the set found, something unlisted remains, and its `ties` are not rejected in its place."""
    CONFOUNDED = auto()
    """A bench table whose error could be a part of one found (`Candidate.confounded`)."""
    NO_TABLE = auto()
    """It was in the set found, and not beside the terms of a bench table that its axle lacks."""
    PASSES = auto()
    """It passes every bar."""


@dataclass(frozen=True)
class Confounded:
    """A table that could be wrong in place of a part of a law.

    Attributes
    ----------
    key : of the table's effect.
    low, high : 95 % interval of how far it is off, ÷ what it says, by the same runs; at most `SELECTION.table_error`.
    share : largest change of a parameter of the law in that range, ÷ its size.
    """

    key: str
    low: float
    high: float
    share: float


@dataclass(frozen=True)
class Candidate:
    """Effect tested as an addition to the model.

    Attributes
    ----------
    key : key of the effect; `shape` the shape constants that fit best.
    answer : whether it is missing, with its `reason`.
    stands_for : effect found that it looks like; empty without one.
    gain : fall of the weighted squares of its rows in blocked cross-validation, as a share, at most 1; `total_gain`
        the fall of the weighted squares of all rows.
    most : largest such share in a single row.
    gain_rms : that fall as RMS of the residual over its `rows` of one unit [N or N·m].
    drop : fall of the weighted sum of squares on all data; `p` family-wise probability of such a fall by chance.
    coverage : effective number of blocks it acts in.
    size : √λ of the effect at its largest plausible size, nuisance parameters removed [noise σ].
    absorbed : effects and tolerances that explain its columns where it cannot be tested, largest share first.
    noise_part : largest share of noise in its columns, where it cannot be tested for that.
    lacks : channels that it needs and a run lacks, where it cannot be computed, or for the first of the rows that it
        acts on, where the runs form none of them.
    values : estimates of its parameters [SI], and `interval`, half of their 95 % intervals (independent residuals).
    ties : candidates that could be in its place on these runs (not rejected by Cox's test), with their correlation.
    confounded : bench tables of which an error could be a part of it, of an effect found.
    open_at : axles whose bench table is not known and beside which something unlisted remains, of an effect found that
        acts there: its size is open, and it has no `values` and no `interval`; empty where the size is known.
    total : sum of its size and those of the same law at other places, where these runs show only that; else None.
    margin : weighted squares that an effect found explains more than its best `rival` in its place; None without one.
    block_gain : (B,) fall of the weighted squares in each block.

    Examples
    --------
    >>> best = ranking.best
    >>> best.key, best.rows
    ('anti_roll_bar.front', ('suspension.fl', 'suspension.fr'))
    """

    key: str
    shape: Mapping[str, float]
    answer: Answer = Answer.UNDECIDED
    reason: Reason | None = None
    stands_for: str = ""
    rows: tuple[Row, ...] = ()
    gain: float = 0.0
    most: float = 0.0
    gain_rms: float = 0.0
    total_gain: float = 0.0
    drop: float = 0.0
    p: float = 1.0
    coverage: float = 0.0
    size: float = 0.0
    absorbed: tuple[tuple[str, float], ...] = ()
    noise_part: float = 0.0
    lacks: Unmeasured | None = None
    values: tuple[float, ...] = ()
    interval: tuple[float, ...] = ()
    ties: tuple[tuple[str, float], ...] = ()
    confounded: tuple[Confounded, ...] = ()
    open_at: tuple[str, ...] = ()
    total: SumOfPlaces | None = None
    margin: float | None = None
    rival: str = ""
    block_gain: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def tested(self) -> bool:
        """Whether the runs could show it."""
        return self.answer is not Answer.NOT_TESTABLE


def judged(c: Candidate, effect: Effect, draws: int) -> Candidate:
    """A tested candidate by itself with its answer and the reason; p is from `draws` simulated runs."""
    if c.p > SELECTION.level(draws):
        return replace(c, answer=Answer.NOT_NEEDED, reason=Reason.CHANCE)
    if c.gain <= 0.0 or max(c.gain, c.most) < SELECTION.least_gain:
        return replace(c, answer=Answer.SMALL, reason=Reason.LITTLE)
    if effect.implausible(c.values, c.interval) is not None:
        return replace(c, answer=Answer.IMPLAUSIBLE, reason=Reason.IMPLAUSIBLE)
    return replace(c, answer=Answer.MISSING, reason=Reason.PASSES)


def is_significant(c: Candidate, effect: Effect, draws: int) -> bool:
    """Whether a candidate is significant and of plausible size, whatever its gain."""
    return c.p <= SELECTION.level(draws) and c.gain > 0.0 and effect.implausible(c.values, c.interval) is None
