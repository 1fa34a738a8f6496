"""Progress of a long computation: the steps it reports, and the one callback that receives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Generic, TypeVar


class Stage(Enum):
    """A stage of a computation of identify; `lacet.services.render.progress` has the sentence of each."""

    # Fit
    NOISE_CORRECTION = auto()
    LATENCIES = auto()
    # Validation
    NOISE_FLOOR = auto()
    STATES_FOLLOWED = auto()
    RESIDUAL_SPECTRA = auto()
    EXPLAINABLE_RESIDUAL = auto()
    RESTORING_FORCES = auto()
    # Selection
    SENSOR_TOLERANCES = auto()
    TRIAL_COLUMNS = auto()
    REGRESSOR_NOISE = auto()
    SCORE_TESTS = auto()
    FORWARD_SELECTION = auto()
    SHAPE_CONSTANTS = auto()
    LACK_OF_FIT = auto()
    PARAMETER_CONSTANCY = auto()
    RELINEARISATION = auto()
    FLOOR_AT_LATENCIES = auto()
    FLOOR_AT_TOLERANCES = auto()
    FIT_WITH_EFFECTS = auto()
    FLOOR_BESIDE_EFFECT = auto()
    ENCOMPASSING = auto()
    SYMBOLIC_LAWS = auto()


S_co = TypeVar("S_co", bound=Enum, covariant=True)


@dataclass(frozen=True)
class Step(Generic[S_co]):
    """One report of a long computation; callers of identify have stages of their own.

    Attributes
    ----------
    stage : the present stage.
    done, total : number of parts done, and of all parts; total is 0 where parts are not counted.
    subject : the run, effect or kind of runs being processed.
    values : numbers by name, in SI units: latencies by channel or sensor [s], constants of an effect's shape.
    """

    stage: S_co
    done: int = 0
    total: int = 0
    subject: str = ""
    values: Mapping[str, float] = field(default_factory=dict[str, float])


Progress = Callable[[Step[Stage]], None]
"""Receiver of the steps of a long computation; an exception that it raises ends the computation there."""


def silent(_: object) -> None:
    """The callback that ignores every step."""
