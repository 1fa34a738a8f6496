"""Runs that show too little for a verdict on the model: the car hardly moves, or the samples are too few.

A row's error ÷ floor is that of its samples. Where they are few, noise alone exceeds the floor by as much; where the
car hardly moves, the floor is of laws whose values the run does not determine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from lacet.daq.channels import CHANNELS
from lacet.daq.stuck import MOVING, SPEEDS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.score import FAILS, Comparison, fails
from lacet.identify.validation.whiteness import SIGNIFICANCE

_BODY = ("laser.hub", "damper.travel", "imu.accel", "imu.rate")
"""Families whose variation is that of the body: it heaves, pitches, rolls, turns, or is accelerated."""
_STILL = 2.0
"""Variation ÷ noise, both as the pre-filter passes them, up to which a column shows hardly any motion: noise is three
quarters of it in amplitude, and no law is determined by the rest. Source: a choice."""
_MOST = 10_000
"""Largest number of independent samples that is asked for."""


@dataclass(frozen=True)
class StillRun:
    """A run in which the car hardly moves.

    `variation` : of its columns of travel, accelerations and rates, the largest ÷ noise; `stands` : whether the wheels
    stand, or the car has no speed; `seconds` : its length.
    """

    run: str
    seconds: float
    variation: float
    stands: bool


@dataclass(frozen=True)
class FewSamples:
    """Rows that fail by no more than chance has it, as they have too few samples.

    `rows` : ``run: row``, with the largest error first; `samples` : the fewest of them; `p` : that noise alone is as
    far above the floor in any row, at the smallest; `seconds` : without faults, filters' transients at the ends
    included, with which an error of `FAILS` floors is none of chance.
    """

    rows: tuple[str, ...]
    samples: int
    p: float
    seconds: float


@dataclass(frozen=True)
class LittleShown:
    """What runs are too still or too short to show; `model_fails` : whether a row fails beside those."""

    still: tuple[StillRun, ...]
    few: FewSamples | None
    model_fails: bool


def little_shown(runs: Sequence[PreparedRun], used: Sequence[Comparison]) -> LittleShown:
    """What runs show too little of; `used` : a model's comparisons with those that are judged."""
    still = tuple(found for run in runs if (found := _still(run)) is not None)
    names = {one.run for one in still}
    count = sum(len(part.scores) for part in used)
    few: list[tuple[float, str, int, float]] = []
    model_fails = False
    by_name = {run.name: run for run in runs}
    for part in used:
        run = by_name[part.name]
        for row, score in part.scores.items():
            if not fails(score.ratio) or part.name in names:
                continue
            p = _by_chance(score.ratio, score.samples * _independent(run.recording), count)
            if p > SIGNIFICANCE:
                few.append((score.ratio, f"{part.name}: {row}", score.samples, p))
            else:
                model_fails = True
    if not few or model_fails:
        return LittleShown(still, None, model_fails)
    few.sort(reverse=True)
    samples, p = min(one[2] for one in few), min(one[3] for one in few)
    return LittleShown(still, FewSamples(tuple(one[1] for one in few), samples, p, _needed(runs[0], count)), False)


def _independent(recording: Recording) -> float:
    """Part of a row's samples that are independent: its filter passes fewer than are kept."""
    filters = recording.filters
    return min(1.0, 2.0 * filters.fit_cutoff * filters.step / filters.rate)


def _by_chance(ratio: float, freedom: float, count: int) -> float:
    """Probability that noise alone has any of `count` rows as far above its floor (χ², Bonferroni)."""
    return min(1.0, count * float(scipy.special.chdtrc(freedom, freedom * ratio**2)))


def _needed(run: PreparedRun, count: int) -> float:
    """Length of a run with which noise alone hardly makes any of `count` rows fail [s]."""
    freedom = np.arange(1.0, _MOST)
    sure = count * scipy.special.chdtrc(freedom, freedom * FAILS**2) <= SIGNIFICANCE
    filters = run.recording.filters
    return float(freedom[int(np.argmax(sure))]) / (2.0 * filters.fit_cutoff) + 2.0 * filters.edge


def _still(run: PreparedRun) -> StillRun | None:
    """A run in which the body hardly moves; None for one that moves, or that has no channel of the body."""
    recording = run.overview().recording
    cutoff, largest = recording.filters.pre_cutoff, 0.0
    body = [name for name in recording.signals.value if CHANNELS[name].family in _BODY]
    for name in body:
        values = recording.signals.value[name][:, recording.usable[name]]
        passed = 1.0 if cutoff is None else min(1.0, 2.0 * cutoff / recording.rates[name])
        if values.shape[1] > 1:
            spread = float(np.max(np.std(values, axis=1)))
            largest = max(largest, spread / (recording.rig.noise(name) * passed**0.5))
    if not 0.0 < largest < _STILL:
        return None
    return StillRun(run.name, float(np.ptp(recording.t)), largest, _stands(recording))


def _stands(recording: Recording) -> bool:
    """Whether every instrument of speed says that the car stands; False without any."""
    speeds = [
        SPEEDS[CHANNELS[name].family] * float(np.median(np.linalg.norm(values, axis=0)))
        for name, values in recording.signals.value.items()
        if CHANNELS[name].family in SPEEDS
    ]
    return bool(speeds) and max(speeds) < MOVING
