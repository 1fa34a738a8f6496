"""Lines of progress where the output is not a terminal."""

from __future__ import annotations

from itertools import pairwise

import pytest

from lacet.identify.progress import Stage, Step
from lacet.services.commands.progress import PERIOD, Line
from lacet.services.progress import ServiceStage, ServiceStep, Stretch, planned


def run(seconds: float, capsys: pytest.CaptureFixture[str]) -> list[float]:
    """A job of so many seconds with ten steps a second: when lines came."""
    now = [0.0]
    times: list[float] = []
    with Line("diagnose", clock=lambda: now[0]) as line:
        line.progress(planned([Stretch(ServiceStage.COMPARING, 60.0)]))
        parts = round(10 * seconds)
        for k in range(parts):
            line.progress(ServiceStep(ServiceStage.COMPARING, k, parts, "rough"))
            times += [now[0]] * (capsys.readouterr().err.count("\n"))
            now[0] += 0.1
    return times


def test_at_most_one_line_in_five_seconds(capsys: pytest.CaptureFixture[str]):
    times = run(60.0, capsys)
    assert len(times) >= 10
    assert times[0] >= PERIOD
    assert all(b - a >= PERIOD - 1e-9 for a, b in pairwise(times))


def test_a_short_job_says_nothing(capsys: pytest.CaptureFixture[str]):
    assert run(0.9 * PERIOD, capsys) == []


def test_a_line_names_the_job_its_share_the_time_left_and_the_step(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    with Line("diagnose", clock=lambda: now[0]) as line:
        line.progress(planned([Stretch(ServiceStage.COMPARING, 20.0)]))
        for k in range(6):
            line.progress(ServiceStep(ServiceStage.COMPARING, k, 10, "rough"))
            now[0] += 2.0
    (first,) = capsys.readouterr().err.splitlines()
    assert first == "diagnose: 30 %, about 14 s left: comparing rough with the model"
    assert "\x1b" not in first


def test_a_job_that_takes_longer_than_planned_says_how_long_and_no_share(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    fit, test = Stage.FIT_WITH_EFFECTS, Stage.SCORE_TESTS
    rounds = (Stretch(fit, 50.0), Stretch(test, 50.0))
    with Line("diagnose", period=700.0, clock=lambda: now[0]) as line:
        line.progress(planned(rounds, further={fit: rounds}))
        for k in range(15):
            line.progress(Step(test if k % 2 else fit, subject=f"law {k}"))
            now[0] += 50.0
    (told,) = capsys.readouterr().err.splitlines()
    assert told == "diagnose: 12 min so far, longer than planned: a fit with law 14"
