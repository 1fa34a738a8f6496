"""Workers of a campaign: a local cluster or a scheduler elsewhere (Dask), maps over runs and merges in a fixed tree."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, cast

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.parts import from_part
from lacet.identify.progress import silent
from lacet.identify.regression.sums.tree import groups
from lacet.services.cache.keys import key_of
from lacet.services.campaign.run_reference import RunReference, Settings
from lacet.services.campaign.tasks import Broken, State, Survey, merge, reduce, survey
from lacet.services.progress import Progress, ServiceStage, ServiceStep

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")

CONNECTING = 10.0
"""Longest time to wait for the scheduler to answer, and for its first worker [s]."""
DEATHS = 3
"""A run whose task was lost with its worker so often is broken: Dask's own setting."""


class BrokenRuns(LacetError):
    """Runs that cannot be used, found in the middle of a campaign: name → reason in `runs`."""

    def __init__(self, runs: Mapping[str, str]):
        self.runs = dict(runs)
        super().__init__("\n".join(f"{name}: {why}" for name, why in runs.items()))


@contextmanager
def connected(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    """A client of a scheduler elsewhere, or of a local cluster with its own workers.

    Parameters
    ----------
    scheduler : address of a Dask scheduler, ``tcp://host:8786``; None: a local cluster.
    workers : number of local workers; by default one for each processor.

    Raises MissingPart when Dask is not installed, UsageError when no scheduler or worker answers or a worker has
    another lacet.
    """
    with from_part("campaign"):
        import dask.config
        import distributed
    settings = {
        "distributed.worker.multiprocessing-method": "spawn",  # a fork would inherit the threads' locks
        "distributed.worker.daemon": True,
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.admin.tick.limit": "10s",
    }
    with dask.config.set(settings):
        if scheduler is None:
            with (
                distributed.LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1",
                    dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL,
                ) as cluster,
                distributed.Client(cluster) as client,
            ):  # fmt: skip
                yield client
            return
        try:
            client = distributed.Client(scheduler, timeout=CONNECTING)
        except (OSError, ValueError) as cause:
            raise UsageError(f"no Dask scheduler answers at {scheduler}: {cause}") from None
        with client:
            _checked(client, scheduler)
            yield client


def _checked(client: Client, scheduler: str) -> None:
    """Raise UsageError when there is no worker, or one has no lacet or another."""
    try:
        client.wait_for_workers(1, timeout=CONNECTING)
    except TimeoutError:
        raise UsageError(
            f"the scheduler at {scheduler} has no worker: start some with `dask worker {scheduler}`"
        ) from None
    try:
        theirs = cast(Mapping[str, str], client.run(_sources))
    except (ImportError, RuntimeError) as cause:
        raise UsageError(f"a worker of {scheduler} cannot load lacet[campaign]: {cause}") from None
    if other := sorted(worker for worker, sources in theirs.items() if sources != _sources()):
        raise UsageError(f"these workers have another lacet, NumPy or SciPy than this process: {', '.join(other)}")


def _sources() -> str:
    """Digest of all that a result depends on beside its data."""
    return key_of("selection", None)


@dataclass
class Cluster:
    """Maps over runs and merges of their sums, on the workers of a client.

    Attributes
    ----------
    client : of the scheduler.
    progress : receives how many runs a pass has done.
    passes : number of passes over the samples of the runs so far; `sums` of those over their equations alone.
    deaths : number of workers that were lost.
    """

    client: Client
    progress: Progress = silent
    passes: int = 0
    sums: int = 0
    deaths: int = 0
    _workers: set[str] = field(default_factory=set[str])

    def survey(self, runs: Sequence[RunReference], settings: Settings) -> list[Survey | Broken]:
        """Every run looked at."""
        futures = self._leaves(survey, runs, settings)
        self._wait(futures, runs, "reading", keep=True)
        return cast(list[Survey | Broken], self.client.gather(futures))

    def hold(self, runs: Sequence[RunReference], settings: Settings, state: State, what: str) -> list[Future]:
        """The sums of every run, held where they were made. Raises BrokenRuns."""
        futures = self._leaves(reduce, runs, settings, state)
        self._wait(futures, runs, what, keep=True)
        return futures

    def reduce(
        self, runs: Sequence[RunReference], settings: Settings, state: State, how: Callable[[Sequence[T]], T], what: str
    ) -> T:
        """The sums of all runs, merged. Raises BrokenRuns."""
        futures = self._leaves(reduce, runs, settings, state)
        root = self._tree(futures, how)
        self._wait(futures, runs, what, keep=len(futures) == 1)
        return self._value(root)

    def over(
        self, held: Sequence[Future], function: Callable[..., Any], values: Sequence[Any],
        how: Callable[[Sequence[T]], T], first: T | None = None,
    ) -> T:  # fmt: skip
        """A function of each run's held sums, with common values, merged; `first` : a part before those of the runs."""
        self.sums += 1
        tag = uuid.uuid4().hex
        shared = [self._shared(value) for value in values]
        futures = self.client.map(
            function, held, *([value] * len(held) for value in shared),
            key=[f"{function.__name__}-{tag}-{i}" for i in range(len(held))],
        )  # fmt: skip
        return self._value(self._tree([*([] if first is None else [first]), *futures], how))

    def _leaves(
        self, function: Callable[..., Any], runs: Sequence[RunReference], settings: Settings, *values: Any
    ) -> list[Future]:
        """A pass over the samples: one task for each run."""
        self.passes += 1
        tag = uuid.uuid4().hex
        shared = [self._shared(value) for value in (settings, *values)]
        self._count_workers()
        return self.client.map(
            function, runs, *([value] * len(runs) for value in shared),
            key=[f"{function.__name__}-{tag}-{i}" for i in range(len(runs))],
        )  # fmt: skip

    def _shared(self, value: Any) -> Future:
        """A value that many tasks need, sent once to each worker, and again to one that comes later."""
        return self.client.submit(_same, value, key=f"value-{uuid.uuid4().hex}")

    def _tree(self, parts: Sequence[Any], how: Callable[[Sequence[T]], T]) -> Any:
        """The root of the tree of merges over parts, of which some may be values; to merge comes before to read."""
        level, height, tag = list(parts), 0, uuid.uuid4().hex
        while len(level) > 1:
            height += 1
            level = [
                level[group[0]]
                if len(group) == 1
                else self.client.submit(
                    merge, [level[i] for i in group], how, key=f"merge-{tag}-{height}-{number}", priority=height
                )
                for number, group in enumerate(groups(len(level)))
            ]
        return level[0]

    def _wait(self, futures: list[Future], runs: Sequence[RunReference], what: str, keep: bool) -> None:
        """Wait for the tasks of runs, reporting how many are done. Raises BrokenRuns where workers die of a run.

        `keep` : whether their results are wanted here; else they go as soon as they are merged.
        """
        from distributed import as_completed

        names = {future.key: run.name for future, run in zip(futures, runs, strict=True)}
        broken: dict[str, str] = {}
        total = len(futures)
        waiting = as_completed(list(futures))
        if not keep:
            futures.clear()
        for done, future in enumerate(waiting, start=1):
            if future.status == "error":
                error = future.exception()
                why = f"{type(error).__name__}: {error}"
                if type(error).__name__ == "KilledWorker":
                    why = f"its worker died {DEATHS + 1} times while it was at it: too little memory?"
                broken[names[future.key]] = why
            if not keep:
                future.release()
            self.progress(ServiceStep(ServiceStage.CAMPAIGN_PASS, done, total, what))
        self._count_workers()
        if broken:
            raise BrokenRuns(broken)

    def _value(self, root: Any) -> Any:
        """The value of a future or of a part that is one already. Raises BrokenRuns."""
        value = root.result() if hasattr(root, "result") else root
        if isinstance(value, Broken):
            raise BrokenRuns(value.runs)
        return value

    def _count_workers(self) -> None:
        """Count the workers that are gone since they were counted last."""
        present = set(self.client.scheduler_info(n_workers=-1)["workers"])
        self.deaths += len(self._workers - present)
        self._workers = present


def _same(value: T) -> T:
    return value
