"""Jobs end when they are cancelled, whatever they are at, and the next one runs."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.services.workbench.events import Events
from lacet.services.workbench.job_record import JobRecord
from lacet.services.workbench.jobs import Cancelled, Do, JobProgress, Jobs
from lacet.services.workspace.study import Study
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
LONG = 30.0
"""Time after which a test gives up [s]."""


@pytest.fixture
def started() -> threading.Event:
    """Set by a job that is at work."""
    return threading.Event()


@pytest.fixture
def jobs(started: threading.Event, tmp_path: Path) -> Iterator[Jobs]:
    """A queue with tasks that never end, each of another kind, and one that does."""

    def computing(_: Mapping[str, Any], __: JobProgress) -> None:
        started.set()
        a = np.eye(200)
        while True:
            try:
                a = a @ a
            except Exception as cause:  # as a user's effect is called: its faults are reported in other words
                raise UsageError(str(cause)) from cause

    def writing(args: Mapping[str, Any], _: JobProgress) -> None:
        study = Study.create(tmp_path / args.get("name", "study"), [cars.CAR / "sine.parquet"], [], RIG, VEHICLE)
        while True:
            study = study.record({}, "again", {"rows": {}})
            started.set()

    def reporting(_: Mapping[str, Any], progress: JobProgress) -> None:
        while True:
            progress.report("1 of 2")
            started.set()

    tasks: dict[str, Do] = {
        "computing": computing, "writing": writing, "reporting": reporting, "short": lambda _, __: 7
    }  # fmt: skip
    out = Jobs(tasks, Events())
    yield out
    out.close()


@pytest.mark.parametrize("what", ["computing", "writing", "reporting"])
def test_a_cancelled_job_ends_and_the_next_one_runs(jobs: Jobs, started: threading.Event, what: str) -> None:
    """Also one that reports no progress, and one that catches the errors of what it calls."""
    job = jobs.submit(what, {})
    assert started.wait(LONG)
    jobs.cancel(job)
    assert job.ended.wait(LONG)
    assert (job.state, job.error, job.result) == ("cancelled", None, None)
    after = jobs.submit("short", {})
    assert after.ended.wait(LONG)
    assert (after.state, after.result) == ("done", 7)


def test_a_study_is_whole_after_its_job_was_interrupted(
    jobs: Jobs, started: threading.Event, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted at many places, writing leaves no lock, and every version in order."""
    monkeypatch.setattr("lacet.services.workbench.jobs.PATIENCE", 0.003)
    for k in range(6):
        started.clear()
        folder = tmp_path / f"study{k}"
        job = jobs.submit("writing", {"name": folder.name})
        assert started.wait(LONG)
        jobs.cancel(job)
        assert job.ended.wait(LONG)
        assert not (folder / ".writing").exists()
        found = [json.loads(file.read_text())["version"] for file in sorted((folder / "versions").glob("*.json"))]
        assert found == list(range(1, len(found) + 1))
        study = Study.open(folder)
        assert study.current in (len(found), len(found) - 1)
        study.record({}, "afterwards", {"rows": {}})


def test_a_job_that_ends_while_it_is_interrupted_is_one_or_the_other(
    jobs: Jobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many races between the end of a job and its interruption: the thread survives them all."""
    monkeypatch.setattr("lacet.services.workbench.jobs.PATIENCE", 0.0002)

    def brief(args: Mapping[str, Any], _: JobProgress) -> str:
        end = time.monotonic() + 0.0005 * (args["k"] % 8)
        while time.monotonic() < end:
            pass
        return "result"

    jobs.tasks["brief"] = brief
    for k in range(100):
        job = jobs.submit("brief", {"k": k})
        jobs.cancel(job)
        assert job.ended.wait(LONG)
        assert (job.state, job.result) in (("done", "result"), ("cancelled", None))
    last = jobs.submit("short", {})
    assert last.ended.wait(LONG)
    assert last.result == 7


def test_what_was_not_over_is_lost_with_the_server_and_can_be_started_again(tmp_path: Path) -> None:
    """A running and a waiting job; the jobs of another living server are not."""
    hold, started = threading.Event(), threading.Event()

    def slow(_: Mapping[str, Any], progress: JobProgress) -> None:
        started.set()
        while not hold.wait(0.01):
            progress.check()

    tasks: dict[str, Do] = {"slow": slow, "short": lambda args, __: args["k"]}
    first = Jobs(tasks, Events(), JobRecord(tmp_path))
    assert first.submit("short", {"k": 1}).ended.wait(LONG)
    first.submit("slow", {})
    first.submit("short", {"k": 2})
    assert started.wait(LONG)
    beside = JobRecord(tmp_path)
    assert beside.unfinished() == []
    beside.keep([("short", {"k": 3})])
    first.close()
    record = JobRecord(tmp_path)
    second = Jobs(tasks, Events(), record)
    second.restore(record.unfinished())
    lost = second.open()
    assert [(job.do, job.args, job.state) for job in lost] == [("slow", {}, "lost"), ("short", {"k": 2}, "lost")]
    second.cancel(lost[0])
    again = second.submit("short", {"k": 2})
    assert again.ended.wait(LONG)
    assert again.result == 2
    assert [job.state for job in lost] == ["cancelled", "cancelled"]
    second.close()
    assert JobRecord(tmp_path).unfinished() == []


def test_cancelled_is_no_error_of_a_computation() -> None:
    """A handler of errors does not swallow it."""
    assert not issubclass(Cancelled, Exception)
