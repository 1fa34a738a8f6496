"""Progress of a long computation as a line of text: the sentence of each step that it reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lacet.identify.progress import Stage
from lacet.services.progress import TRIAL, AnyStage, AnyStep, Progress, ServiceStage, ServiceStep

_COUNTED: dict[AnyStage, str] = {
    Stage.NOISE_FLOOR: "simulating the noise floor",
    Stage.STATES_FOLLOWED: "what the residual follows",
    Stage.EXPLAINABLE_RESIDUAL: "what is left to explain",
}
"""Stages with the number of parts done, where these are counted."""

_PERCENT: dict[AnyStage, str] = {
    ServiceStage.READING_LOG: "reading",
    ServiceStage.DECODING_LOG: "decoding",
    ServiceStage.WRITING_LOG: "writing",
    ServiceStage.IMPORTING_LOG: "importing",
}
"""Stages with the per cent done, where these are counted."""

_PLAIN: dict[AnyStage, str] = {
    ServiceStage.PLANNED: "starting",
    ServiceStage.STRUCTURE: "grouping the parameters of the equations",
    ServiceStage.SCORING: "computing its error on the runs used and held out",
    ServiceStage.CONTRIBUTIONS: "what each effect brings",
    ServiceStage.MANOEUVRE_PHASES: "the phases of driving",
    ServiceStage.BODY_CONSISTENCY: "testing whether these bodies can exist",
    ServiceStage.INSTRUMENTS: "fitting again with instruments",
    ServiceStage.POSITION: "fitting again with the inertial unit's position",
    ServiceStage.CONSISTENT_FIT: "looking for the nearest bodies that can",
    Stage.RESIDUAL_SPECTRA: "the residual in frequency",
    Stage.RESTORING_FORCES: "restoring-force surfaces",
    Stage.SENSOR_TOLERANCES: "what the sensor sheet leaves open",
    Stage.SCORE_TESTS: "how far each reduces the error",
    Stage.FORWARD_SELECTION: "what the best explain together",
    Stage.LACK_OF_FIT: "what they leave",
    Stage.FLOOR_AT_TOLERANCES: "the noise floor at the parameters that the sensor sheet leads to",
    Stage.SYMBOLIC_LAWS: "simple laws that the residual follows",
    ServiceStage.PRESENT_INFORMATION: "the information of the present runs",
    ServiceStage.RANKING_RUNS: "ranking",
    ServiceStage.COMPARING_FOR_REPORT: "comparing for the report",
    ServiceStage.DRAWING_REPORT: "drawing the report",
    ServiceStage.DRAWING_FIRST_FAILURE: "drawing where the first model fails",
    ServiceStage.DRAWING_PRESENT_FAILURE: "drawing where the present model fails",
}
"""Stages with one sentence."""

_FILLED: dict[AnyStage, str] = {
    ServiceStage.CANDIDATES: "trying {total} effects",
    Stage.TRIAL_COLUMNS: "what {total} effects would do",
    Stage.SHAPE_CONSTANTS: "the constants of {subject}",
    Stage.ENCOMPASSING: "whether {subject} stands beside laws that are not listed: {done} of {total}",
    Stage.PARAMETER_CONSTANCY: "whether {subject} is the same in all runs",
    Stage.FIT_WITH_EFFECTS: "a fit with {subject}",
    Stage.FLOOR_BESIDE_EFFECT: "the noise floor beside {subject}",
    ServiceStage.CAMPAIGN_PASS: "{subject}: {done} of {total} runs",
    ServiceStage.SIMULATING_RUN: "simulating {done} of {total}: {subject}",
    ServiceStage.RUN_INFORMATION: "its information, {done} of {total}: {subject}",
    ServiceStage.DRIVING: "driving {subject}, {done} %",
    ServiceStage.MEASURING: "measuring {subject}",
    ServiceStage.WHEEL_FORCES: "wheel forces of {subject} without dynamometers",
    ServiceStage.DRAWING_RUN: "drawing {subject}",
}
"""Stages whose sentence holds the step's own numbers and names."""


def sentence(step: AnyStep) -> str:
    """A step in words, without a full stop."""
    if isinstance(step, ServiceStep):
        text = _sentence(step, step.version, step.effects)
        return f"{step.campaign}: {text}" if step.campaign else text
    return _sentence(step)


def with_time(text: str, share: float, remaining: float | None) -> str:
    """A sentence after the share of the job done (0 to 1) and the remaining time [s], if that is known."""
    about = "" if remaining is None else f", about {_duration(remaining)} left"
    return f"{100.0 * share:.0f} %{about}: {text}"


def overdue(text: str, passed: float) -> str:
    """A sentence of a job that takes longer than was planned, after the time since it began [s]."""
    return f"{_duration(passed)} so far, longer than planned: {text}"


def _duration(seconds: float) -> str:
    """A time in words, no finer than it is known."""
    if seconds < 100.0:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 600.0 else f"{seconds / 60.0:.0f} min"


def in_words(show: Callable[[str], object]) -> Progress:
    """A progress callback that passes each step's sentence to `show`."""

    def progress(step: AnyStep) -> None:
        if step.stage != ServiceStage.PLANNED:
            show(sentence(step))

    return progress


def _sentence(step: AnyStep, version: int | None = None, effects: Sequence[str] = ()) -> str:
    """A step in words; `version`, `effects` : of the model of a study that is fitted or compared."""
    match step.stage:
        case ServiceStage.READING_RUNS:
            return f"reading {step.total} runs {step.subject}".rstrip() if step.total else "reading the runs"
        case ServiceStage.READING_RUN:
            return f"{f'reading runs {step.subject}'.rstrip()}: {step.done} of {step.total}"
        case ServiceStage.FITTING if version is None:
            constants = ", ".join(f"{name} = {value:g}" for name, value in step.values.items())
            return f"fitting with {constants}" if constants else "fitting"
        case ServiceStage.FITTING:
            added = "" if version == TRIAL else f" ({', '.join(effects) or 'the base model alone'})"
            return f"fitting {_model(version, effects)}{added}"
        case Stage.NOISE_CORRECTION:
            what = "fitting" if version is None else f"fitting {_model(version, effects)}"
            return f"{what}: {step.done} of {step.total} runs"
        case ServiceStage.COMPARING:
            return f"comparing {step.subject or 'the runs'} with {_model(version, effects)}"
        case Stage.LATENCIES:
            return f"reading the runs with {_latencies(step)}"
        case Stage.FLOOR_AT_LATENCIES:
            return f"the noise floor of the runs read with {_latencies(step)}"
        case Stage.RELINEARISATION:
            largest = max(map(abs, step.values.values()), default=0.0)
            return f"the runs read again, latencies up to {1e3 * largest:.1f} ms removed ({step.done})"
        case Stage.REGRESSOR_NOISE:
            counted = f": {step.done} of {step.total} draws" if step.total else ""
            return f"the noise in what they follow{counted}"
        case _ if step.stage in _PERCENT:
            return _PERCENT[step.stage] + (f", {step.done} of {step.total} %" if step.total else "")
        case _ if step.stage in _COUNTED:
            return _COUNTED[step.stage] + (f": {step.done} of {step.total}" if step.total else "")
        case _ if step.stage in _PLAIN:
            return _PLAIN[step.stage]
        case _:
            return _FILLED[step.stage].format(subject=step.subject, done=step.done, total=step.total)


def _model(version: int | None, effects: Sequence[str]) -> str:
    """Name of a study's model: of a trial the effect that it adds, which is its last."""
    if version is None:
        return "the model"
    return f"version {version}" if version != TRIAL else f"the model with {', '.join(effects[-1:])} added"


def _latencies(step: AnyStep) -> str:
    return ", ".join(f"{name} {1e3 * x:+.1f} ms" for name, x in step.values.items())
