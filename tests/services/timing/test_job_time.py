"""Share of a job and time left, with a clock of the tests' own."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from lacet.identify.progress import Stage
from lacet.services.progress import AnyStage, ServiceStage, ServiceStep, Stretch, planned
from lacet.services.timing.job_time import JobTime

FIFTH = 0.2
WITHIN = 0.3
"""Largest error of the time left after a fifth of a job, relative to the truth."""

PARTS: tuple[tuple[AnyStage, float, int], ...] = (
    (ServiceStage.READING_RUN, 2.0, 3),
    (ServiceStage.FITTING, 3.0, 0),
    (Stage.NOISE_CORRECTION, 4.0, 3),
    (Stage.NOISE_FLOOR, 11.0, 597),
    (Stage.STATES_FOLLOWED, 0.5, 0),
    (Stage.EXPLAINABLE_RESIDUAL, 6.0, 16),
    (Stage.RESTORING_FORCES, 0.4, 0),
)
"""Stages of unequal length: time [s] and number of parts counted."""
PLAN = [Stretch(stage, seconds) for stage, seconds, _ in PARTS]


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def drive(
    time: JobTime, clock: Clock, pace: Callable[[AnyStage], float], see: Callable[[], None],
    left_out: tuple[AnyStage, ...] = (),
) -> None:  # fmt: skip
    """The job, each stage at a pace of its own; `see` is called ten times a second."""
    for stage, seconds, parts in PARTS:
        if stage in left_out:
            continue
        whole = seconds * pace(stage)
        for part in range(max(parts, 1)):
            time.step(ServiceStep(stage, part, parts))
            end = clock.now + whole / max(parts, 1)
            while clock.now < end:
                clock.now = min(end, clock.now + 0.1)
                see()


def seen(pace: Callable[[AnyStage], float], **more: tuple[AnyStage, ...]) -> tuple[list[float], float, float]:
    """Shares told, and the time left after a fifth: as told, and the truth."""
    clock = Clock()
    time = JobTime(clock)
    time.step(planned(PLAN))
    told: list[tuple[float, float, float | None]] = []

    def see() -> None:
        now = time.estimate()
        assert now is not None
        told.append((clock.now, now.share, now.remaining))

    drive(time, clock, pace, see, **more)
    at, _, left = next(one for one in told if one[0] >= FIFTH * clock.now)
    assert left is not None
    return [share for _, share, _ in told], left, clock.now - at


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_after_a_fifth_the_time_left_is_right_on_any_machine(factor: float):
    shares, left, truth = seen(lambda _: factor)
    assert left == pytest.approx(truth, rel=WITHIN)
    assert shares == sorted(shares)
    assert 0.9 < shares[-1] < 1.0


@pytest.mark.parametrize("seed", range(20))
def test_stages_a_fifth_longer_or_shorter_than_usual_leave_it_right(seed: int):
    draw = random.Random(seed)
    paces = {stage: draw.uniform(0.8, 1.25) for stage, _, _ in PARTS}
    shares, left, truth = seen(lambda stage: paces[stage])
    assert left == pytest.approx(truth, rel=WITHIN)
    assert shares == sorted(shares)


def test_what_is_known_is_passed_over_and_does_not_count_for_the_pace():
    shares, left, truth = seen(lambda _: 2.0, left_out=(ServiceStage.FITTING, Stage.NOISE_CORRECTION))
    assert left == pytest.approx(truth, rel=WITHIN)
    assert shares == sorted(shares)


def test_a_share_never_falls_however_wrong_the_plan_was():
    draw = random.Random(3)
    paces = {stage: 10.0 ** draw.uniform(-1.5, 1.5) for stage, _, _ in PARTS}
    shares, _, _ = seen(lambda stage: paces[stage])
    assert shares == sorted(shares)
    assert shares[-1] < 1.0


def test_counted_parts_say_how_long_their_own_stage_takes():
    """Ten times longer than usual, and seen after a fifth of it."""
    clock = Clock()
    time = JobTime(clock)
    time.step(planned([Stretch(Stage.NOISE_FLOOR, 1.0)]))
    for part in range(21):
        clock.now = 0.1 * part
        time.step(ServiceStep(Stage.NOISE_FLOOR, part, 100))
    now = time.estimate()
    assert now is not None
    assert now.remaining == pytest.approx(8.0, rel=WITHIN)


def test_a_plan_told_later_replaces_what_is_ahead_alone():
    clock = Clock()
    time = JobTime(clock)
    time.step(planned([Stretch(ServiceStage.FITTING, 10.0), Stretch(ServiceStage.COMPARING, 10.0)]))
    time.step(ServiceStep(ServiceStage.FITTING))
    clock.now = 20.0
    time.step(planned([Stretch(Stage.NOISE_FLOOR, 5.0)]))
    time.step(ServiceStep(Stage.NOISE_FLOOR))
    now = time.estimate()
    assert now is not None
    assert now.remaining == pytest.approx(10.0, rel=0.1), "at half the usual pace"


def test_a_job_that_has_just_begun_is_not_overdue():
    """What it does first may not be planned."""
    clock = Clock()
    time = JobTime(clock)
    time.step(planned([Stretch(ServiceStage.FITTING, 100.0)]))
    time.step(ServiceStep(ServiceStage.READING_RUNS))
    clock.now = 2.0
    now = time.estimate()
    assert now is not None
    assert (now.remaining, now.overdue) == (None, False)


def test_no_time_left_is_shown_while_a_search_goes_on_beyond_its_plan():
    clock = Clock()
    time = JobTime(clock)
    time.step(planned([Stretch(ServiceStage.FITTING, 10.0), Stretch(Stage.LACK_OF_FIT, 1.0)]))
    time.step(ServiceStep(ServiceStage.FITTING))
    left: list[float | None] = []
    for now, stage in ((10.0, Stage.FORWARD_SELECTION), (12.0, Stage.FORWARD_SELECTION), (40.0, Stage.LACK_OF_FIT)):
        clock.now = now
        time.step(ServiceStep(stage))
        estimate = time.estimate()
        assert estimate is not None
        left.append(estimate.remaining)
    assert left[:2] == [pytest.approx(1.0)] * 2
    assert left[2] is None, "thirty seconds of forty were not planned"


def test_a_pass_over_the_runs_that_begins_once_more_was_not_planned():
    """A search of a campaign makes its last pass again as often as it finds something."""
    clock = Clock()
    time = JobTime(clock)
    stage = ServiceStage.CAMPAIGN_PASS
    time.step(planned([Stretch(stage, 10.0, "products", once=True), Stretch(stage, 10.0, "tests", once=True)]))
    overdue: list[bool] = []
    for subject in ("products", "tests", "tests", "tests"):
        for run in range(10):
            time.step(ServiceStep(stage, run, 10, subject))
            clock.now += 1.0
        estimate = time.estimate()
        assert estimate is not None
        overdue.append(estimate.overdue)
    assert overdue == [False, False, True, True]


def test_a_plan_goes_on_where_a_search_does():
    """A second round of a search is not planned, but what follows its first stage is known."""
    clock = Clock()
    time = JobTime(clock)
    fit, test = Stage.FIT_WITH_EFFECTS, Stage.SCORE_TESTS
    rounds = (Stretch(fit, 10.0), Stretch(test, 30.0))
    time.step(planned(rounds, further={fit: rounds}))
    for seconds, stage in ((10.0, fit), (30.0, test)):
        time.step(ServiceStep(stage))
        clock.now += seconds
    time.step(ServiceStep(fit))  # the second round
    clock.now += 4.0
    now = time.estimate()
    assert now is not None
    assert now.remaining == pytest.approx(36.0, rel=0.05)
    assert (now.passed, now.overdue) == (44.0, False)
    clock.now += 10.0
    now = time.estimate()
    assert now is not None
    assert now.remaining is None, "fourteen seconds of fifty-four were not planned, and others may follow"
    assert (now.passed, now.overdue) == (54.0, True)
    time.step(planned([Stretch(ServiceStage.COMPARING, 20.0)]))
    time.step(ServiceStep(ServiceStage.COMPARING))
    now = time.estimate()
    assert now is not None
    assert now.remaining == pytest.approx(20.0, rel=0.1), "what follows the search is known"


def test_a_stage_reported_within_another_takes_none_of_the_plan_ahead():
    clock = Clock()
    time = JobTime(clock)
    search, columns = Stage.FORWARD_SELECTION, Stage.TRIAL_COLUMNS
    time.step(planned([Stretch(search, 20.0, within=frozenset({columns})), Stretch(columns, 30.0)]))
    for stage in (search, columns, search):
        time.step(ServiceStep(stage))
        clock.now += 5.0
    now = time.estimate()
    assert now is not None
    assert now.remaining == pytest.approx(35.0, rel=0.05)


def test_a_job_without_a_plan_has_no_share():
    time = JobTime(Clock())
    time.step(ServiceStep(ServiceStage.FITTING))
    assert time.estimate() is None


def test_paces_are_remembered(tmp_path: Path):
    """A stage that takes three times as long as usual in this study is expected to do so the next time."""
    memory = tmp_path / "paces.json"
    plan = [Stretch(ServiceStage.FITTING, 2.0), Stretch(Stage.NOISE_FLOOR, 10.0), Stretch(Stage.SCORE_TESTS, 1.0)]
    lefts: list[float | None] = []
    for _ in range(6):
        clock = Clock()
        time = JobTime(clock)
        time.step(planned(plan, memory))
        time.step(ServiceStep(ServiceStage.FITTING))
        clock.now = 4.0
        time.step(ServiceStep(Stage.NOISE_FLOOR))
        now = time.estimate()
        lefts.append(now and now.remaining)
        clock.now = 34.0
        time.step(ServiceStep(Stage.SCORE_TESTS))
        time.end(done=False)
    assert lefts[0] == pytest.approx(21.0, rel=0.2), "twice as slow as usual, as the first stage was"
    assert lefts[-1] == pytest.approx(32.0, rel=0.1)
    assert set(json.loads(memory.read_text())) == {"FITTING", "NOISE_FLOOR"}


def test_a_memory_that_cannot_be_read_is_none(tmp_path: Path):
    memory = tmp_path / "paces.json"
    memory.write_text("{")
    time = JobTime(Clock())
    time.step(planned(PLAN, memory))
    time.step(planned(PLAN, tmp_path / "missing" / "paces.json"))
    time.end()
    assert time.estimate() is not None
