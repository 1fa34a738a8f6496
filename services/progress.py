"""Progress of the services: their stages around the computations of identify, and the callback that receives both."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path

from lacet.identify.progress import Stage, Step


class ServiceStage(Enum):
    """A stage of a service; `lacet.services.render.progress` has the sentence of each."""

    # What the job will do, announced before it does it
    PLANNED = auto()
    # Runs and fits of a study
    READING_RUNS = auto()
    READING_RUN = auto()
    STRUCTURE = auto()
    FITTING = auto()
    SCORING = auto()
    COMPARING = auto()
    WHEEL_FORCES = auto()
    CONTRIBUTIONS = auto()
    MANOEUVRE_PHASES = auto()
    BODY_CONSISTENCY = auto()
    CONSISTENT_FIT = auto()
    INSTRUMENTS = auto()
    POSITION = auto()
    CANDIDATES = auto()
    # Campaign
    CAMPAIGN_PASS = auto()
    # Planning
    PRESENT_INFORMATION = auto()
    SIMULATING_RUN = auto()
    RUN_INFORMATION = auto()
    RANKING_RUNS = auto()
    # Decoding of a log
    READING_LOG = auto()
    DECODING_LOG = auto()
    WRITING_LOG = auto()
    # Import of another system's log
    IMPORTING_LOG = auto()
    # Reproduction
    DRIVING = auto()
    MEASURING = auto()
    # Report
    COMPARING_FOR_REPORT = auto()
    DRAWING_REPORT = auto()
    DRAWING_FIRST_FAILURE = auto()
    DRAWING_PRESENT_FAILURE = auto()
    DRAWING_RUN = auto()


AnyStage = Stage | ServiceStage
"""A stage of identify or of a service."""
AnyStep = Step[AnyStage]
"""A step of identify or of a service."""


@dataclass(frozen=True)
class Stretch:
    """A part of a job.

    Attributes
    ----------
    stage : its stage.
    usual : usual time [s] on the machine and runs of `lacet.services.timing.usual`; ratios matter more than seconds.
    subject : the step's subject, where the stage is for several of them ("used", "held out"); empty for any.
    likely : part of its time that is planned for: below 1 for a stage that only some jobs go through.
    within : stages that are reported in between, within its time.
    once : whether its parts are counted once in it; where counting begins anew, that is no longer this stretch.
    """

    stage: AnyStage
    usual: float
    subject: str = ""
    likely: float = 1.0
    within: frozenset[AnyStage] = frozenset()
    once: bool = False

    @property
    def name(self) -> str:
        """Name under which its pace is remembered."""
        return f"{self.stage.name} {self.subject}".rstrip()


@dataclass(frozen=True)
class JobPlan:
    """What a job will do, in order.

    Attributes
    ----------
    memory : file of the paces that its stages had the last time, if any.
    further : stage → stretches that are ahead when the job comes to it and no such stage is planned ahead: a search
        goes on as long as it finds effects.
    """

    stretches: tuple[Stretch, ...]
    memory: Path | None = None
    further: Mapping[AnyStage, tuple[Stretch, ...]] = field(default_factory=dict[AnyStage, tuple[Stretch, ...]])


TRIAL = 0
"""Number of a version that is fitted to see what one more effect does, and is not recorded."""


@dataclass(frozen=True)
class ServiceStep(AnyStep):
    """A step with its place in a study or a reproduction.

    Attributes
    ----------
    effects : effects of the model that is fitted or compared, beyond the base model, in the order they were added.
    version : number of the study's version, `TRIAL` for one that is not recorded; None outside a study.
    campaign : name of the campaign being reproduced, or empty.
    plan : of the stage `PLANNED`, what the job will do from here on.
    """

    effects: tuple[str, ...] = ()
    version: int | None = None
    campaign: str = ""
    plan: JobPlan | None = None

    @classmethod
    def of_version(cls, step: AnyStep, version: int, effects: Iterable[str]) -> ServiceStep:
        """A step of a computation for a version of a study."""
        return cls(step.stage, step.done, step.total, step.subject, step.values, tuple(effects), version)


def planned(
    stretches: Iterable[Stretch], memory: Path | None = None,
    further: Mapping[AnyStage, tuple[Stretch, ...]] | None = None,
) -> ServiceStep:  # fmt: skip
    """The step that says what a job will do from here on."""
    return ServiceStep(ServiceStage.PLANNED, plan=JobPlan(tuple(stretches), memory, further or {}))


Progress = Callable[[AnyStep], None]
"""Receiver of the steps of services and of identify; an exception that it raises ends the computation there."""
