"""Cache of the server between requests: sessions of the study, and the results computed for each version.

The study's folder is authoritative: it is read again for every request. Cached results belong to one state of the files
(`Stamp`), and are dropped when these have changed.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.formats.result import plain
from lacet.daq.formats.run_files import further_files
from lacet.identify.car.manoeuvre_phases import Phases
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.contributions import Shares
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.signature import Signature
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render.identifiability import rows_not_judged
from lacet.services.render.rows import with_verdict
from lacet.services.workbench.refusals import Busy, Needs
from lacet.services.workspace.failure import failure_result
from lacet.services.workspace.results import scores
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study, Version

WAIT = 2.0
"""Longest time that a short request waits for a job to end [s]."""
SESSIONS = 2
"""Number of sessions, one for each choice of runs, whose motions are kept in memory."""
PREVIEWS = 20
"""Number of previews held in memory; fits and comparisons of others are on disk."""
VERSIONS = 8
"""Number of versions whose series are kept in memory."""
RANKINGS = 1
"""Number of rankings, each with the noise in all candidates' columns, held in memory; others are on disk."""

Stamp = tuple[tuple[str, int, int], ...]
"""State of the files that a result was computed from: path, time of change [ns] and size of each."""


@dataclass(frozen=True)
class Compared:
    """Comparison of a version with all its runs, those used first, with each effect's contribution and the phases."""

    version: Version
    stamp: Stamp
    parts: tuple[Comparison, ...]
    shares: tuple[Shares, ...]
    phases: tuple[Phases, ...]
    payload: Mapping[str, Any]

    def part(self, run: str) -> tuple[Comparison, Shares]:
        """Comparison and contributions of one run. Raises UsageError for an unknown run."""
        for part, shares in zip(self.parts, self.shares, strict=True):
            if part.name == run:
                return part, shares
        raise UsageError(f"no run {run} in version {self.version.number}: {', '.join(p.name for p in self.parts)}")


@dataclass(frozen=True)
class Previewed:
    """A model with one more effect against the runs used.

    `row` and `run` : where the effect does most, and the run in which that row is worst; `now` and `after` : the
    comparisons without and with the effect; `signature` : its law in that row, over a state.
    """

    row: Row
    run: str
    now: tuple[Comparison, ...]
    after: tuple[Comparison, ...]
    signature: Signature | None


class SessionCache:
    """Cache of the sessions of one folder's study, which may not exist yet, and of their results.

    `compute` is the lock of every computation on motions, held by the running job.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._compute = threading.Lock()
        self._sessions: OrderedDict[tuple[object, ...], Session] = OrderedDict()
        self._compared: OrderedDict[int, Compared] = OrderedDict()
        self._where: OrderedDict[int, tuple[Stamp, FailureAnalysis, Mapping[str, Any]]] = OrderedDict()
        self._previews: OrderedDict[tuple[object, ...], Previewed] = OrderedDict()
        self._diagnosed: OrderedDict[int, tuple[Stamp, Diagnosis]] = OrderedDict()

    # -- the folder ---------------------------------------------------------------------------------------------------

    @property
    def exists(self) -> bool:
        """Whether the folder has a study with at least one version."""
        return (self.folder / "study.json").is_file() and any((self.folder / "versions").glob("[0-9]*.json"))

    @property
    def study(self) -> Study:
        """The study as it is on disk. Raises UsageError when there is none yet."""
        if not self.exists:
            raise UsageError("there is no study here yet: choose runs to identify with, and make one")
        return Study.open(self.folder)

    def version(self, number: int | None = None) -> tuple[Study, Version]:
        """The study with the runs of a version (by default the present one), and the version."""
        study = self.study
        version = study.version(number)
        return study.at(version), version

    # -- computations -------------------------------------------------------------------------------------------------

    @contextmanager
    def computing(self, wait: float = -1.0) -> Generator[None]:
        """Hold the lock of computations. Raises Busy when it is not free within `wait` [s]; −1 waits for ever."""
        if not self._compute.acquire(timeout=wait):
            raise Busy("lacet is at work on something else: look again when that is done, or cancel it")
        try:
            yield
        finally:
            self._compute.release()

    def session(self, study: Study, progress: Progress) -> Session:
        """The session of the study; a new one when a run, the rig or the vehicle has changed on disk."""
        key = (study.used, study.held, study.filters, study.draws, stamp_of(study))
        session = self._sessions.pop(key, None)
        if session is None:
            session = Session(study, progress)
        # After another writer's changes results stay valid: they are by version, and versions never change.
        if session.study.current != study.current or session.study.before != study.before:
            session.study = study
        session.progress = progress
        session.after = ("shares", "phases")
        self._sessions[key] = session
        while len(self._sessions) > SESSIONS:
            self._sessions.popitem(last=False)
        return session

    def drop(self, session: Session) -> None:
        """Drop a session that may be in an inconsistent state."""
        self._sessions = OrderedDict((key, one) for key, one in self._sessions.items() if one is not session)

    def compare(self, number: int | None, progress: Progress) -> Compared:
        """Comparison of a version with its runs, computed and cached."""
        study, version = self.version(number)
        kept = self._compared.get(version.number)
        stamp = stamp_of(study)
        if kept is None or kept.stamp != stamp:
            session = self.session(study, progress)
            with session.planned(*((kind, version) for kind in ("compared", *session.after))):
                progress(ServiceStep(ServiceStage.COMPARING, version=version.number))
                parts = tuple(session.values.every_comparison(version))
                shares, phases = tuple(session.values.shares(version)), tuple(session.values.phases(version))
            kept = Compared(version, stamp, parts, shares, phases, compare_payload(version, parts))
        _keep(self._compared, version.number, kept)
        return kept

    def where(self, number: int | None, progress: Progress) -> FailureAnalysis:
        """Failure analysis of a version, computed and cached."""
        study, version = self.version(number)
        stamp = stamp_of(study)
        kept = self._where.get(version.number)
        if kept is None or kept[0] != stamp:
            session = self.session(study, progress)
            with session.planned(("where", version)):
                found = session.values.failure(version)
            kept = stamp, found, failure_result(version, found)
        _keep(self._where, version.number, kept)
        return kept[1]

    def keep_preview(self, study: Study, version: Version, effect: Effect, found: Previewed) -> None:
        """Cache a preview."""
        _keep(self._previews, _place(study, version, effect), found, PREVIEWS)

    def keep_diagnosis(self, number: int, study: Study, diagnosis: Diagnosis) -> None:
        """Cache a ranking, on which the recommendation of the next run is based."""
        _keep(self._diagnosed, number, (stamp_of(study), diagnosis), RANKINGS)

    # -- cached results -----------------------------------------------------------------------------------------------

    def compared(self, number: int) -> Compared:
        """The cached comparison of a version. Raises Needs when there is none, or the runs have changed."""
        study, version = self.version(number)
        kept = self._compared.get(version.number)
        if kept is None or kept.stamp != stamp_of(study):
            raise Needs("compare", f"version {version.number} has not been compared with its runs yet")
        return kept

    def found_where(self, number: int) -> tuple[FailureAnalysis, Mapping[str, Any]]:
        """The cached failure analysis of a version, and its plain data as of ``lacet where --json``. Raises Needs."""
        study, version = self.version(number)
        kept = self._where.get(version.number)
        if kept is None or kept[0] != stamp_of(study):
            raise Needs("where", f"where version {version.number} fails has not been analysed yet")
        return kept[1:]

    def previewed(self, study: Study, version: Version, effect: Effect) -> Previewed | None:
        """The cached preview of a version's model with one more effect, or None."""
        return self._previews.get(_place(study, version, effect))

    def diagnosis(self, number: int) -> Diagnosis | None:
        """The cached ranking of a version, or None."""
        study, version = self.version(number)
        kept = self._diagnosed.get(version.number)
        return kept[1] if kept and kept[0] == stamp_of(study) else None


def compare_payload(version: Version, parts: tuple[Comparison, ...]) -> dict[str, Any]:
    """Scores of every row of every run, as in the result of ``lacet compare``."""
    used, held = scores([p for p in parts if p.used]), scores([p for p in parts if not p.used])
    return plain(
        {
            "version": version.number,
            "effects": version.effects,
            "used": used,
            "held": held,
            "runs": [
                {
                    "name": part.name, "used": part.used, "seconds": part.seconds,
                    "rows": [{"row": row, **with_verdict(score)} for row, score in (used | held)[part.name].items()],
                    "not_judged": rows_not_judged(part),
                }
                for part in parts
            ],
            "not_judged": [line for part in parts for line in rows_not_judged(part)],
        }
    )  # fmt: skip


def stamp_of(study: Study) -> Stamp:
    """State of the study's runs, rig and vehicle on disk. Raises LacetError for a missing run."""
    files = [*study.paths(), *study.paths(held=True), study.folder / "rig.toml", study.folder / "vehicle.toml"]
    return tuple(one_stamp(file) for path in files for file in (path, *further_files(path)))


def one_stamp(file: Path) -> tuple[str, int, int]:
    """Path, time of change and size of a file. Raises LacetError when it is missing."""
    try:
        found = os.stat(file)
    except OSError as error:
        raise LacetError(f"{file}: {error.strerror}; put it back, or choose the runs anew") from None
    return str(file), found.st_mtime_ns, found.st_size


def _place(study: Study, version: Version, effect: Effect) -> tuple[object, ...]:
    """What a preview depends on."""
    return version.number, stamp_of(study), effect.key, tuple(sorted(effect.shape.items()))


def _keep(kept: OrderedDict[Any, Any], number: object, value: Any, most: int = VERSIONS) -> None:
    kept[number] = value
    kept.move_to_end(number)
    while len(kept) > most:
        kept.popitem(last=False)
