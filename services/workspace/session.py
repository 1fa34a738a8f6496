"""Session of a study, behind study, compare, diagnose and add: new versions, and the search for missing effects."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.identify.effects.catalogue import base_model, find_effect
from lacet.identify.progress import silent
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.shape_constants import constants_by_runs
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.identify.validation.score import compare
from lacet.services.cache.store import FOLDER
from lacet.services.one_thread import one_thread
from lacet.services.progress import Progress, planned
from lacet.services.timing.memory import FILE
from lacet.services.workspace.kept.kept_values import KeptValues
from lacet.services.workspace.kept.study_plans import EXPECTED_EFFECTS, StudyPlan, Wanted
from lacet.services.workspace.kept.study_runs import StudyRuns
from lacet.services.workspace.loading import load
from lacet.services.workspace.results import change_result, diagnosis_result, fit_result, open_sizes, without_open_sizes
from lacet.services.workspace.study import Study, Version

MOST_EFFECTS = 40
"""Largest number of effects that a search for missing ones adds: one that would add more follows something else."""


def fit_run(path: str | Path) -> dict[str, Any]:
    """A fit of the base model to one run that holds its rig and vehicle (a log), as a worker makes it: plain data."""
    # On one thread, as on the command line, so that a log gives the same digits everywhere.
    with one_thread():
        return _fit_run(path)


def _fit_run(path: str | Path) -> dict[str, Any]:
    loaded = load([path])
    fitted = fit(Model.of(base_model(loaded.vehicle, loaded.reference)), loaded.prepared)
    parts = [compare(fitted, run, SCORE_DRAWS) for run in fitted.runs]
    return fit_result(fitted, loaded, parts, drawn=fitted.bootstrap())


@dataclass(frozen=True)
class Search:
    """Result of a search for missing effects.

    Attributes
    ----------
    diagnoses : all rankings, in order.
    changes : error ÷ noise floor before and after each effect that was added, as plain data.
    """

    diagnoses: tuple[Diagnosis, ...]
    changes: tuple[Mapping[str, Any], ...]

    @property
    def last(self) -> Diagnosis:
        """The ranking of the model that the search ended with."""
        return self.diagnoses[-1]


class Session:
    """A session on a study: its runs, the values of its versions, and new versions.

    Attributes
    ----------
    runs : the study's runs.
    values : what is known of each version: fits, scores, noise floors, analyses, pictures.
    after : kinds of values that are asked for after each new version, for the plan of the job that makes it.

    Examples
    --------
    >>> study = lacet.Study.create(Path("work"), [Path("tests/data/car/sine.parquet")], [], runs.rig, runs.vehicle)
    >>> lacet.Session(study).record({}, "base model").number
    1
    """

    def __init__(self, study: Study, progress: Progress = silent):
        self.runs = StudyRuns(study, progress)
        self.values = KeptValues(self.runs)
        self.after: tuple[str, ...] = ()
        self._announced = False

    @property
    def study(self) -> Study:
        """The study at work."""
        return self.runs.study

    @study.setter
    def study(self, study: Study) -> None:
        self.values.use(study)

    @property
    def progress(self) -> Progress:
        """Receiver of the steps of whatever is computed."""
        return self.runs.progress

    @progress.setter
    def progress(self, progress: Progress) -> None:
        self.runs.progress = progress

    @contextmanager
    def planned(self, *wanted: Wanted) -> Generator[None]:
        """Announce the plan of a job that makes these values; a job inside another announces none."""
        with self._announcing(lambda: StudyPlan(self.values).want(wanted)):
            yield

    @contextmanager
    def _announcing(self, plan: Callable[[], StudyPlan]) -> Generator[None]:
        if self._announced:
            yield
            return
        self._announced = True
        try:
            self._announce(plan())
            yield
        finally:
            self._announced = False

    def _announce(self, plan: StudyPlan) -> None:
        self.progress(planned(plan.stretches, self.study.folder / FOLDER / FILE, plan.further))

    def diagnose(self) -> Diagnosis:
        """Rank what is missing in the current version, and keep the finding."""
        with self.planned(("ranking", self.study.version())):
            return self._diagnose()

    def _diagnose(self) -> Diagnosis:
        diagnosis = self.values.diagnosis(self.study.version())
        self.study.record_diagnosis(diagnosis_result(diagnosis))
        return diagnosis

    # -- versions -----------------------------------------------------------------------------------------------------

    def record(self, effects: Mapping[str, Mapping[str, float]], note: str) -> Version:
        """Fit a model, score it on all runs and keep it as the study's new version; known results are used again."""
        number = max((v.number for v in self.study.versions()), default=0) + 1
        reference = self.runs.reference(self.study.version()) if self.study.current else self.runs.loaded.reference
        version = Version(number, effects, note, {"wheel_reference": reference})
        with self.planned(("result", version), *((kind, version) for kind in self.after)):
            result = without_open_sizes(self.values.result(version), self._open_sizes())
        try:
            self.study = self.study.record(effects, note, result)
        finally:
            if self.study.current != number:  # another writer's version has this number now
                self.values.forget(number)
        return self.study.version()

    def _open_sizes(self) -> Mapping[str, Sequence[str]]:
        """Effects whose size is open in a version that is made from the current one, with the axles that leave it."""
        return open_sizes(self.study.version().result, self.study.diagnosis()) if self.study.current else {}

    def add_missing(
        self, most: int = MOST_EFFECTS,
        diagnosed: Callable[[Diagnosis], None] = lambda _: None,
        added: Callable[[Mapping[str, Any]], None] = lambda _: None,
    ) -> Search:  # fmt: skip
        """Rank what is missing and add what is found, the best first, repeatedly until nothing is missing.

        Parameters
        ----------
        most : largest number of effects added; 0 ranks once and adds nothing.
        diagnosed, added : called after each ranking, and after each effect with the change of the error as plain data.
        """
        with self._announcing(lambda: StudyPlan(self.values).search(self.study.version(), min(most, EXPECTED_EFFECTS))):
            return self._search(most, diagnosed, added)

    def _search(
        self, most: int, diagnosed: Callable[[Diagnosis], None], added: Callable[[Mapping[str, Any]], None]
    ) -> Search:
        diagnoses: list[Diagnosis] = []
        changes: list[dict[str, Any]] = []
        while True:
            diagnosis = self._diagnose()
            diagnoses.append(diagnosis)
            diagnosed(diagnosis)
            if diagnosis.best is None or len(changes) >= most:
                return Search(tuple(diagnoses), tuple(changes))
            expected = min(len(diagnosis.found), most - len(changes))
            self._announce(StudyPlan(self.values).search(self.study.version(), expected))
            for found in diagnosis.found[: most - len(changes)]:
                if found.key in self.study.version().effects:
                    continue  # added with another of which it is known as a sum
                before = self.study.version()
                after = self._add_together(found.total.keys if found.total else (found.key,), found.shape)
                changes.append(self.change(found.key, before, after))
                added(changes[-1])

    def change(self, key: str, before: Version, after: Version) -> dict[str, Any]:
        """What an effect changed that was added or removed between two versions, as plain data."""
        known = self.study.effects(self.runs.reference(before))
        return change_result(key, known.get(key), before.result["rows"], after.result["rows"])

    def add(self, key: str, shape: Mapping[str, float] | None = None) -> Version:
        """Add an effect to the current version, with these shape constants.

        Without them they are those of the version's diagnosis, or where there is none, those at which the effect
        explains most on the runs used. With an effect of which that diagnosis knows the sum with others, these are
        added as well.
        """
        version = self.study.version()
        if key in version.effects:
            raise UsageError(f"{key} is in the model already (version {version.number})")
        effect = find_effect(key, self.study.effects(self.runs.reference(version)))
        if shape is None:
            found = (self.study.diagnosis() or {}).get("candidates", [])
            shape = next((c["shape"] for c in found if c["effect"] == key and c["shape"]), None)
        if shape is None and effect.grids:
            with one_thread():
                fitted, floor = self.values.fitted(version), self.values.floor(version)
                (effect,) = constants_by_runs(fitted, floor, [effect], self.progress)
        found = next((c for c in (self.study.diagnosis() or {}).get("candidates", []) if c["effect"] == key), {})
        return self._add_together((found.get("sum") or {}).get("effects", [key]), {**effect.shape, **(shape or {})})

    def _add_together(self, keys: Sequence[str], shape: Mapping[str, float]) -> Version:
        """Add effects with the same shape constants to the current version."""
        shapes = {key: dict(shape) for key in keys}
        return self.record({**self.study.version().effects, **shapes}, f"added {' and '.join(keys)}")

    def remove(self, key: str) -> Version:
        """Remove an effect: a new version without it. Raises UsageError when it is not in the model."""
        version = self.study.version()
        if key not in version.effects:
            raise UsageError(f"{key} was not added to version {version.number}")
        return self.record({k: s for k, s in version.effects.items() if k != key}, f"removed {key}")
