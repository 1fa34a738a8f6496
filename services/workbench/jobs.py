"""Jobs, the long computations: one thread runs one after the other, with progress, until done or cancelled."""

from __future__ import annotations

import ctypes
import gc
import itertools
import queue
import re
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow

from lacet.daq.errors import LacetError
from lacet.services.one_thread import one_thread
from lacet.services.progress import AnyStep, ServiceStage
from lacet.services.render.progress import sentence
from lacet.services.timing.job_time import JobTime
from lacet.services.workbench.events import Events
from lacet.services.workbench.job_record import JobRecord
from lacet.services.workspace.study import WRITING

PERIOD = 0.1
"""Least time between two progress events of a job [s]."""
PATIENCE = 0.5
"""Time that a cancelled job has to end at a report of its progress, before it is interrupted wherever it is [s]."""
KEPT = 50
"""Number of finished jobs kept."""
_OF = re.compile(r"(\d+) of (\d+)\b")


class Cancelled(BaseException):
    """Exception in a cancelled job; no handler of a computation's own errors catches it."""


@dataclass
class Job:
    """One long computation.

    `state` is ``waiting``, ``running``, ``done``, ``failed``, ``cancelled``, or ``lost`` when an earlier server ended
    before it; `text` its present step, `done` of `total` where parts are counted; `time` says the share of the whole
    job done and the time left; `began` the clock's time at its start [s], None before; `error` the reason of a failure;
    `result` its result as plain data.
    """

    id: int
    do: str
    args: Mapping[str, Any]
    state: str = "waiting"
    text: str = ""
    done: int | None = None
    total: int | None = None
    time: JobTime | None = field(default=None, repr=False)
    began: float | None = None
    error: str | None = None
    result: Any = None
    seconds: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event, repr=False)
    ended: threading.Event = field(default_factory=threading.Event, repr=False)

    def as_data(self, result: bool = False) -> dict[str, Any]:
        """The job as plain data for the page."""
        names = ("id", "do", "args", "state", "text", "done", "total", "error", "seconds")
        running = self.state == "running" and self.began is not None
        now = self.time.estimate() if running and self.time is not None else None
        clock = {
            "elapsed": time.monotonic() - self.began if running and self.began is not None else None,
            "share": now.share if now else None, "remaining": now.remaining if now else None,
            "overdue": bool(now and now.overdue),
        }  # fmt: skip
        return {name: getattr(self, name) for name in names} | clock | ({"result": self.result} if result else {})

    @property
    def over(self) -> bool:
        """Whether the job has ended."""
        return self.state in ("done", "failed", "cancelled", "lost")


class JobProgress:
    """Receiver of a job's progress, which ends a cancelled job."""

    def __init__(self, job: Job, publish: Callable[[Job], None]):
        self.job, self._publish, self._last = job, publish, 0.0
        self.time = job.time = JobTime()

    def report(self, text: str) -> None:
        """Set the text of the present step. Raises Cancelled."""
        found = _OF.search(text)
        self.job.text = text
        self.job.done, self.job.total = (int(found[1]), int(found[2])) if found else (None, None)
        self._say(found is None)

    def progress(self, step: AnyStep) -> None:
        """Set the text and the place in the plan from a step of a computation. Raises Cancelled."""
        self.time.step(step)
        if step.stage != ServiceStage.PLANNED:
            self.report(sentence(step))

    def check(self) -> None:
        """Raise Cancelled when the job was cancelled."""
        if self.job.stop.is_set():
            raise Cancelled

    def _say(self, now: bool) -> None:
        self.check()
        if now or time.monotonic() - self._last >= PERIOD:
            self._last = time.monotonic()
            self._publish(self.job)


Do = Callable[[Mapping[str, Any], JobProgress], Any]


class Jobs:
    """Queue of jobs, with the thread that runs them.

    `tasks` : name → function of the arguments and a `JobProgress`, whose value is the job's result; `record` : place
    where jobs that are not over are written down.
    """

    def __init__(self, tasks: Mapping[str, Do], events: Events, record: JobRecord | None = None):
        self.tasks, self.events, self._record = dict(tasks), events, record
        self._ends = False
        self._unfinished: dict[int, Job] = {}
        # Numbers do not begin at 1: a page must not confuse a job of an earlier server with a new one.
        self._numbers = itertools.count(int(time.time()))
        self._jobs: dict[int, Job] = {}
        self._queue: queue.Queue[Job | None] = queue.Queue()
        self._ending, self._writing = threading.Lock(), threading.Lock()
        self._thread = threading.Thread(target=self._work, name="lacet-jobs", daemon=True)
        self._thread.start()

    def submit(self, do: str, args: Mapping[str, Any]) -> Job:
        """Append a job to the queue; the waiting job with the same arguments, where there is one.

        A lost job with the same arguments is lost no longer.
        """
        for job in list(self._jobs.values()):
            if (job.do, job.args) == (do, args):
                if job.state == "waiting":
                    return job
                if job.state == "lost":
                    self.cancel(job)
        job = Job(next(self._numbers), do, dict(args), text="waiting")
        self._jobs[job.id] = job
        self._unfinished[job.id] = job
        for old in [j.id for j in list(self._jobs.values()) if j.over][:-KEPT]:
            self._jobs.pop(old, None)
        self._say(job)
        self._write()
        self._queue.put(job)
        return job

    def restore(self, unfinished: Sequence[Mapping[str, Any]]) -> None:
        """Show the jobs that an earlier server did not finish, `do` and `args` of each, as lost.

        They are not started by themselves: whether one had changed the study before its end is for the user to see.
        """
        for one in unfinished:
            job = Job(next(self._numbers), one["do"], one["args"], "lost", "lost when the server ended")
            job.ended.set()
            self._jobs[job.id] = self._unfinished[job.id] = job

    def cancel(self, job: Job) -> None:
        """Cancel a job: at once while it waits, within seconds while it runs; a lost one is dismissed."""
        job.stop.set()
        if job.state in ("waiting", "lost"):
            job.state, job.text = "cancelled", "cancelled"
            self._over(job)
            job.ended.set()
            self._say(job)
        elif job.state == "running" and job.text != "stopping":
            job.text = "stopping"
            self._say(job)
            threading.Thread(target=self._interrupt, args=(job,), name="lacet-cancel", daemon=True).start()

    def _interrupt(self, job: Job) -> None:
        """Raise Cancelled in the thread of a job that reports no progress, but not while it writes a study."""
        while not job.ended.wait(PATIENCE):
            with WRITING, self._ending:
                if job.state == "running":
                    _raise_in(self._thread, Cancelled)

    def get(self, number: int) -> Job | None:
        """A job by its number."""
        return self._jobs.get(number)

    def all(self) -> list[Job]:
        """All jobs kept, in order."""
        return list(self._jobs.values())

    @property
    def busy(self) -> Job | None:
        """The running job."""
        return next((job for job in list(self._jobs.values()) if job.state == "running"), None)

    def open(self) -> list[Job]:
        """Jobs that wait, run or were lost, in order: what a page shows."""
        return [job for job in list(self._jobs.values()) if job.state in ("waiting", "running", "lost")]

    def stop(self) -> None:
        """Ask all jobs to end with the server; those that are not over remain on the record."""
        self._ends = True
        for job in list(self._jobs.values()):
            job.stop.set()

    def close(self, wait: float = 10.0) -> None:
        """Cancel all jobs and end the thread."""
        self._ends = True
        for job in list(self._jobs.values()):
            if not job.over:
                self.cancel(job)
        self._queue.put(None)
        self._thread.join(wait)
        if self._record is not None:
            self._record.close()

    def _over(self, job: Job) -> None:
        """Take a job off the record, unless the server's end has cancelled it: then it is lost."""
        if not (self._ends and job.state == "cancelled"):
            self._unfinished.pop(job.id, None)
            self._write()

    def _write(self) -> None:
        """Record the jobs that are not over."""
        if self._record is not None:
            with self._writing:
                self._record.keep([(job.do, job.args) for job in list(self._unfinished.values())])

    def _say(self, job: Job) -> None:
        self.events.publish("job", job.as_data())

    def _work(self) -> None:
        # One thread for linear algebra, as on the command line, so that a study gives the same digits.
        with one_thread():
            while (job := self._queue.get()) is not None:
                if job.state == "waiting":
                    self._one(job)

    def _one(self, job: Job) -> None:
        job.began = time.monotonic()
        job.state, job.text = "running", "starting"
        self._say(job)
        teller = JobProgress(job, self._say)
        try:
            state = self._result(job, teller)
            with self._ending:
                job.state = state
        except Cancelled:
            with self._ending:
                job.state, job.result, job.error = "cancelled", None, None
        _raise_in(self._thread, None)  # an interruption that came too late
        job.text = job.state
        teller.time.end(done=job.state == "done")
        self._over(job)
        job.ended.set()
        gc.collect()
        give_back()
        job.seconds = time.monotonic() - job.began
        self._say(job)

    def _result(self, job: Job, teller: JobProgress) -> str:
        """State in which a job ends. Raises Cancelled."""
        try:
            teller.check()
            job.result = self.tasks[job.do](job.args, teller)
            return "done"
        except LacetError as error:
            job.error = str(error)
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            job.error = f"{where}{error.strerror or error}"
        except Exception as error:  # a bug: reported to the page, with traceback on the terminal; the next job runs
            traceback.print_exc()
            job.error = f"an error of lacet itself: {type(error).__name__}: {error}"
        return "failed"


def _raise_in(thread: threading.Thread, exception: type[BaseException] | None) -> None:
    """Raise an exception in a thread at its next step in Python; None withdraws one that was not raised yet."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(
        ctypes.c_ulong(thread.ident or 0), None if exception is None else ctypes.py_object(exception)
    )


def give_back() -> None:
    """Give memory that is no longer needed back to the system; glibc and Arrow keep more of it than is in use."""
    pyarrow.default_memory_pool().release_unused()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None  # musl has none
    if trim is not None:
        trim(0)
