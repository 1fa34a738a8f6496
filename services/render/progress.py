"""Progress of a long computation as a line of text: the sentence of each step that it reports."""

from __future__ import annotations

from collections.abc import Callable

from lacet.identify.progress import Progress, Stage, Step

_COUNTED = {
    Stage.NOISE_FLOOR: "simulating the noise floor",
    Stage.STATES_FOLLOWED: "what the residual follows",
    Stage.EXPLAINABLE_RESIDUAL: "what is left to explain",
}
"""Stages with the number of parts done, where these are counted."""

_PERCENT = {Stage.READING_LOG: "reading", Stage.DECODING_LOG: "decoding", Stage.WRITING_LOG: "writing"}
"""Stages with the per cent done, where these are counted."""

_PLAIN = {
    Stage.STRUCTURE: "looking at the structure of the equations",
    Stage.SCORING: "scoring it on the runs used and held out",
    Stage.CONTRIBUTIONS: "what each effect brings",
    Stage.MANOEUVRE_PHASES: "the phases of driving",
    Stage.BODY_CONSISTENCY: "testing whether these bodies can exist",
    Stage.CONSISTENT_FIT: "looking for the nearest bodies that can",
    Stage.RESIDUAL_SPECTRA: "the residual in frequency",
    Stage.RESTORING_FORCES: "restoring-force surfaces",
    Stage.SENSOR_TOLERANCES: "what the sensor sheet leaves open",
    Stage.SCORE_TESTS: "how far each takes the error down",
    Stage.TIES: "which cannot be told apart",
    Stage.FORWARD_SELECTION: "what the best explain together",
    Stage.LACK_OF_FIT: "what they leave",
    Stage.FLOOR_AT_TOLERANCES: "the noise floor at the parameters that the sensor sheet leads to",
    Stage.SYMBOLIC_LAWS: "simple laws that the residual follows",
    Stage.PRESENT_INFORMATION: "the information of the present runs",
    Stage.RANKING_RUNS: "ranking",
    Stage.COMPARING_FOR_REPORT: "comparing for the report",
    Stage.DRAWING_REPORT: "drawing the report",
    Stage.DRAWING_FIRST_FAILURE: "drawing where the first model fails",
    Stage.DRAWING_PRESENT_FAILURE: "drawing where the present model fails",
}
"""Stages with one sentence."""

_FILLED: dict[Stage, str] = {
    Stage.READING_RUN: "reading runs {subject}: {done} of {total}",
    Stage.CANDIDATES: "trying {total} effects",
    Stage.TRIAL_COLUMNS: "what {total} effects would do",
    Stage.SHAPE_CONSTANTS: "the constants of {subject}",
    Stage.PARAMETER_CONSTANCY: "whether {subject} is the same in all runs",
    Stage.REGRESSOR_NOISE_OF_EFFECT: "what noise does through {subject}",
    Stage.EFFECT_REMOVED: "the runs read again with {subject} removed",
    Stage.FLOOR_BESIDE_EFFECT: "the noise floor beside {subject}",
    Stage.SIMULATING_RUN: "simulating {done} of {total}: {subject}",
    Stage.RUN_INFORMATION: "its information, {done} of {total}: {subject}",
    Stage.DRIVING: "driving {subject}, {done} %",
    Stage.MEASURING: "measuring {subject}",
    Stage.DRAWING_RUN: "drawing {subject}",
}
"""Stages whose sentence holds the step's own numbers and names."""


def sentence(step: Step) -> str:
    """A step in words, without a full stop."""
    text = _sentence(step)
    return f"{step.campaign}: {text}" if step.campaign else text


def in_words(show: Callable[[str], object]) -> Progress:
    """A progress callback that passes each step's sentence to `show`."""

    def progress(step: Step) -> None:
        show(sentence(step))

    return progress


def _sentence(step: Step) -> str:
    match step.stage:
        case Stage.READING_RUNS:
            return f"reading {step.total} runs {step.subject}".rstrip() if step.total else "reading the runs"
        case Stage.FITTING:
            return _fitting(step)
        case Stage.NOISE_CORRECTION:
            what = "fitting" if step.version is None else f"fitting version {_version(step)}"
            return f"{what}: {step.done} of {step.total} runs"
        case Stage.COMPARING:
            beside = f" with {step.subject}" if step.subject else ""
            return f"comparing version {_version(step)}{beside}"
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


def _fitting(step: Step) -> str:
    if step.version is not None:
        return f"fitting version {_version(step)}: {', '.join(step.names) or 'the base model alone'}"
    constants = ", ".join(f"{name} = {value:g}" for name, value in step.values.items())
    return f"fitting with {constants}" if constants else "fitting"


def _version(step: Step) -> str:
    return str(step.version or "new")


def _latencies(step: Step) -> str:
    return ", ".join(f"{name} {1e3 * x:+.1f} ms" for name, x in step.values.items())
