"""Usual time of each stage of a job, which the first job of a study is planned with.

Processor time on one machine for three runs of 30 s (`docs/decisions/page.md`), divided by what it grows
with. Ratios matter, not seconds: the stages behind say how fast this machine is with these runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lacet.identify.progress import Stage
from lacet.services.progress import AnyStage, ServiceStage, Stretch

USUAL: Mapping[AnyStage, float] = {
    # for each run
    ServiceStage.READING_RUN: 1.0,
    ServiceStage.STRUCTURE: 0.5,
    ServiceStage.FITTING: 0.9,
    Stage.NOISE_CORRECTION: 1.15,
    Stage.LATENCIES: 4.0,
    ServiceStage.INSTRUMENTS: 1.0,
    ServiceStage.POSITION: 1.5,
    ServiceStage.BODY_CONSISTENCY: 0.3,
    ServiceStage.CONSISTENT_FIT: 1.0,
    ServiceStage.COMPARING: 0.7,
    ServiceStage.WHEEL_FORCES: 1.0,
    ServiceStage.CONTRIBUTIONS: 0.15,
    ServiceStage.MANOEUVRE_PHASES: 0.1,
    Stage.NOISE_FLOOR: 3.5,
    Stage.STATES_FOLLOWED: 0.19,
    Stage.RESIDUAL_SPECTRA: 0.07,
    Stage.EXPLAINABLE_RESIDUAL: 2.1,
    Stage.RESTORING_FORCES: 0.13,
    Stage.SENSOR_TOLERANCES: 0.5,
    Stage.TRIAL_COLUMNS: 0.32,
    Stage.REGRESSOR_NOISE: 1.8,
    Stage.SCORE_TESTS: 0.15,
    Stage.RELINEARISATION: 2.5,
    Stage.FLOOR_AT_LATENCIES: 2.0,
    Stage.FLOOR_AT_TOLERANCES: 2.0,
    Stage.FORWARD_SELECTION: 0.85,
    Stage.FIT_WITH_EFFECTS: 0.45,
    Stage.FLOOR_BESIDE_EFFECT: 0.45,
    Stage.ENCOMPASSING: 2.0,
    Stage.SYMBOLIC_LAWS: 6.0,
    Stage.LACK_OF_FIT: 0.28,
    Stage.PARAMETER_CONSTANCY: 0.82,
    ServiceStage.PRESENT_INFORMATION: 0.7,
    ServiceStage.DRAWING_RUN: 2.3,
    # for each planned run
    ServiceStage.SIMULATING_RUN: 0.85,
    ServiceStage.RUN_INFORMATION: 0.4,
    # for each log
    ServiceStage.READING_LOG: 0.1,
    ServiceStage.DECODING_LOG: 1.5,
    ServiceStage.WRITING_LOG: 0.05,
    ServiceStage.IMPORTING_LOG: 1.0,
    # for each simulated run
    ServiceStage.DRIVING: 3.5,
    ServiceStage.MEASURING: 1.0,
    # for each report
    ServiceStage.DRAWING_FIRST_FAILURE: 2.3,
    ServiceStage.DRAWING_PRESENT_FAILURE: 1.9,
}
"""Stage → time [s]."""
WITHIN: Mapping[AnyStage, frozenset[AnyStage]] = {
    Stage.FORWARD_SELECTION: frozenset({Stage.SHAPE_CONSTANTS, Stage.TRIAL_COLUMNS})
}
"""Stage → stages that are reported within its time."""
PLANNED_RUNS = 23
"""Number of runs in the library of manoeuvres."""


def drives_plan(drives: Iterable[tuple[str, float]]) -> list[Stretch]:
    """Stretches of simulating and measuring runs, each of a name and a duration [s]."""
    stages = (ServiceStage.DRIVING, ServiceStage.MEASURING)
    return [stretch(stage, duration / 30.0, name) for name, duration in drives for stage in stages]


def stretch(stage: AnyStage, parts: float = 1.0, subject: str = "", likely: float = 1.0) -> Stretch:
    """A stretch of a plan of so many parts: runs, or whatever its stage's time is of."""
    return Stretch(stage, USUAL[stage] * parts, subject, likely, WITHIN.get(stage, frozenset()))
