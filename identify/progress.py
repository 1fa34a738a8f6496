"""Progress of a long computation: the steps it reports, and the one callback that receives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto


class Stage(Enum):
    """What is being computed; `lacet.services.render.progress` has the sentence of each."""

    # Runs read, fitted, scored
    READING_RUNS = auto()
    READING_RUN = auto()
    FITTING = auto()
    NOISE_CORRECTION = auto()
    LATENCIES = auto()
    STRUCTURE = auto()
    SCORING = auto()
    COMPARING = auto()
    CONTRIBUTIONS = auto()
    MANOEUVRE_PHASES = auto()
    BODY_CONSISTENCY = auto()
    CONSISTENT_FIT = auto()
    # Where a model fails
    NOISE_FLOOR = auto()
    STATES_FOLLOWED = auto()
    RESIDUAL_SPECTRA = auto()
    EXPLAINABLE_RESIDUAL = auto()
    RESTORING_FORCES = auto()
    # Which effect is missing
    CANDIDATES = auto()
    SENSOR_TOLERANCES = auto()
    TRIAL_COLUMNS = auto()
    REGRESSOR_NOISE = auto()
    SCORE_TESTS = auto()
    TIES = auto()
    FORWARD_SELECTION = auto()
    SHAPE_CONSTANTS = auto()
    LACK_OF_FIT = auto()
    PARAMETER_CONSTANCY = auto()
    REGRESSOR_NOISE_OF_EFFECT = auto()
    RELINEARISATION = auto()
    FLOOR_AT_LATENCIES = auto()
    FLOOR_AT_TOLERANCES = auto()
    EFFECT_REMOVED = auto()
    FLOOR_BESIDE_EFFECT = auto()
    SYMBOLIC_LAWS = auto()
    # Which run to drive next
    PRESENT_INFORMATION = auto()
    SIMULATING_RUN = auto()
    RUN_INFORMATION = auto()
    RANKING_RUNS = auto()
    # A log decoded, a campaign driven, a report drawn
    READING_LOG = auto()
    DECODING_LOG = auto()
    WRITING_LOG = auto()
    DRIVING = auto()
    MEASURING = auto()
    COMPARING_FOR_REPORT = auto()
    DRAWING_REPORT = auto()
    DRAWING_FIRST_FAILURE = auto()
    DRAWING_PRESENT_FAILURE = auto()
    DRAWING_RUN = auto()


@dataclass(frozen=True)
class Step:
    """One report of a long computation.

    Attributes
    ----------
    stage : what is being computed.
    done, total : how many parts are done, and of how many; total is 0 where parts are not counted.
    subject : the run, effect or kind of runs that is worked on.
    names : effects of the model that is fitted.
    values : numbers by name, in SI units: latencies by channel or sensor [s], constants of an effect's shape.
    version : number of the study's version, 0 for one not recorded yet; None outside a study.
    campaign : the campaign of reproduced runs, where there is one.
    """

    stage: Stage
    done: int = 0
    total: int = 0
    subject: str = ""
    names: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    version: int | None = None
    campaign: str = ""


Progress = Callable[[Step], None]
"""Receives each step of a long computation; may raise, which ends the computation there."""


def silent(_: object) -> None:
    """Progress nobody wants to see."""
