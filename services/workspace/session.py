"""Session of a study, behind identify, compare, diagnose and add: fits, scores, rankings, and results as plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from lacet.daq.errors import UsageError
from lacet.identify.effects.catalogue import base_model, find_effect
from lacet.identify.progress import silent
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.diagnose import Diagnosis, diagnose
from lacet.identify.validation.noise_floor import SCORE_DRAWS, NoiseFloor, floor_of
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison, compare
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.workspace.floor_cache import floor_key, load_floor, load_noise, save_floor, save_noise
from lacet.services.workspace.loading import Loaded, check_reference, load
from lacet.services.workspace.results import change_result, diagnosis_result, fit_result
from lacet.services.workspace.study import Study, Version

MOST_EFFECTS = 10
"""Largest number of effects that a search for missing ones adds."""


def fit_run(path: str | Path) -> dict[str, Any]:
    """A fit of the base model to one run that holds its rig and vehicle (a log), as a worker makes it: plain data."""
    # On one thread, as on the command line, so that a log gives the same digits everywhere.
    with threadpool_limits(1):
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
    """A session on a study: its runs, loaded once, and the fits of its versions, made when first used and kept.

    Examples
    --------
    >>> study = lacet.Study.create(Path("work"), [Path("tests/data/car/sine.parquet")], [], runs.rig, runs.vehicle)
    >>> lacet.Session(study).record({}, "base model").number
    1
    """

    def __init__(self, study: Study, progress: Progress = silent):
        self.study, self.progress = study, progress
        progress(ServiceStep(ServiceStage.READING_RUNS, total=len(study.used), subject="used"))
        self.loaded = self._read(study.paths(), "used")
        self._held: tuple[PreparedRun, ...] | None = None
        self._fits: dict[int, Fit] = {}
        self._knowledge: dict[int, Knowledge] = {}
        self._floors: dict[int, NoiseFloor] = {}
        self._compared: dict[tuple[int, bool], list[Comparison]] = {}

    def _read(self, paths: Sequence[Path], kind: str) -> Loaded:
        folder = self.study.folder
        return load(
            paths, folder / "rig.toml", folder / "vehicle.toml", self.study.filters,
            lambda step: self.progress(replace(step, subject=kind)),
        )  # fmt: skip

    @property
    def held(self) -> tuple[PreparedRun, ...]:
        """The runs held out."""
        if self._held is None:
            self._held = ()
            if self.study.held:
                self.progress(ServiceStep(ServiceStage.READING_RUNS, total=len(self.study.held), subject="held out"))
                loaded = self._read(self.study.paths(held=True), "held out")
                check_reference(self.loaded.reference, loaded.reference)
                known = self.loaded.warnings
                self.loaded = replace(self.loaded, warnings=(*known, *(w for w in loaded.warnings if w not in known)))
                self._held = loaded.prepared
        return self._held

    def fitted(self, version: Version) -> Fit:
        """The fit of a version."""
        if version.number not in self._fits:
            self.progress(ServiceStep(ServiceStage.FITTING, effects=tuple(version.effects), version=version.number))
            model = self.study.model(version, self.loaded.reference)
            self._fits[version.number] = fit(
                model,
                self.loaded.prepared,
                progress=lambda step: self.progress(ServiceStep.of_version(step, version.number)),
            )
        return self._fits[version.number]

    def knowledge(self, version: Version) -> Knowledge:
        """Uncertainty of a version's parameters, from the runs used."""
        if version.number not in self._knowledge:
            self._knowledge[version.number] = Knowledge.of(self.fitted(version))
        return self._knowledge[version.number]

    def record(self, effects: Mapping[str, Mapping[str, float]], note: str) -> Version:
        """Fit a model, score it on all runs and store it as the study's new version."""
        number = max((v.number for v in self.study.versions()), default=0) + 1
        version = Version(number, effects, note)
        fitted = self.fitted(version)
        self.progress(ServiceStep(ServiceStage.SCORING))
        used, held = self.comparisons(version, held=False), self.comparisons(version, held=True)
        result = fit_result(fitted, self.loaded, used, held, self.knowledge(version))
        try:
            self.study = self.study.record(effects, note, result)
        finally:
            if self.study.current != number:  # another writer's version has taken this number
                self.forget(number)
        return self.study.version()

    def forget(self, number: int) -> None:
        """Remove the cached computations of a version's number."""
        for kept in (self._fits, self._knowledge, self._floors):
            kept.pop(number, None)
        self._compared = {key: parts for key, parts in self._compared.items() if key[0] != number}

    def comparisons(self, version: Version, held: bool) -> list[Comparison]:
        """Comparisons of a version with the runs used, or with those held out."""
        key = (version.number, held)
        if key not in self._compared:
            fitted = self.fitted(version)
            knowledge = self.knowledge(version) if held else None
            runs = self.held if held else self.loaded.prepared
            parts: list[Comparison] = []
            for run in runs:
                self.progress(ServiceStep(ServiceStage.COMPARING, subject=run.name, version=version.number))
                parts.append(compare(fitted, run, SCORE_DRAWS, knowledge=knowledge))
            self._compared[key] = parts
        return self._compared[key]

    def pairs(self, version: Version) -> list[tuple[Comparison, PreparedRun]]:
        """Every run of a version with its comparison, runs used first."""
        used = zip(self.comparisons(version, held=False), self.loaded.prepared, strict=True)
        return [*used, *zip(self.comparisons(version, held=True), self.held, strict=True)]

    def floor(self, version: Version, progress: Progress | None = None) -> NoiseFloor:
        """The noise floor of a version's fit on the runs used, simulated once and stored in the study."""
        if version.number not in self._floors:
            key = floor_key(self.study, version)
            found = load_floor(self.study, key)
            if found is None:
                made = floor_of(self.fitted(version), self.study.draws, progress=progress or self.progress)
                found = save_floor(self.study, key, made)
            self._floors[version.number] = found
        return self._floors[version.number]

    def diagnose(self, progress: Progress | None = None) -> Diagnosis:
        """Rank what is missing in the current version, and store the diagnosis."""
        version = self.study.version()
        fitted = self.fitted(version)
        floor = self.floor(version, progress)
        key = floor_key(self.study, version)
        kept = load_noise(self.study, key)
        candidates = [e for e in self.study.effects(self.loaded.reference).values() if not e.base]
        self.progress(ServiceStep(ServiceStage.CANDIDATES, total=len(candidates)))
        diagnosis = diagnose(fitted, floor, candidates, noise=kept, progress=self.progress)
        if diagnosis.noise is not kept:
            save_noise(self.study, key, diagnosis.noise)
        self.study.record_diagnosis(diagnosis_result(diagnosis))
        return diagnosis

    def add_missing(
        self, most: int = MOST_EFFECTS,
        diagnosed: Callable[[Diagnosis], None] = lambda _: None,
        added: Callable[[Mapping[str, Any]], None] = lambda _: None,
    ) -> Search:  # fmt: skip
        """Rank what is missing and add the best effect, repeatedly until none is missing.

        Parameters
        ----------
        most : largest number of effects added; 0 ranks once and adds nothing.
        diagnosed, added : called after each ranking, and after each effect with the change of the error as plain data.
        """
        diagnoses: list[Diagnosis] = []
        changes: list[dict[str, Any]] = []
        while True:
            diagnosis = self.diagnose()
            diagnoses.append(diagnosis)
            diagnosed(diagnosis)
            if diagnosis.best is None or len(changes) >= most:
                return Search(tuple(diagnoses), tuple(changes))
            before = self.study.version()
            after = self.add(diagnosis.best.key, diagnosis.best.shape)
            changes.append(change_result(diagnosis.best.key, before.result["rows"], after.result["rows"]))
            added(changes[-1])

    def add(self, key: str, shape: Mapping[str, float] | None = None) -> Version:
        """Add an effect to the current version, with these shape constants or those found by the last diagnosis."""
        version = self.study.version()
        if key in version.effects:
            raise UsageError(f"{key} is in the model already (version {version.number})")
        effect = find_effect(key, self.study.effects(self.loaded.reference))
        if shape is None:
            found = (self.study.diagnosis() or {}).get("candidates", [])
            shape = next((c["shape"] for c in found if c["effect"] == key), {})
        return self.record({**version.effects, key: {**effect.shape, **(shape or {})}}, f"added {key}")

    def remove(self, key: str) -> Version:
        """Remove an effect: a new version without it. Raises UsageError when it is not in the model."""
        version = self.study.version()
        if key not in version.effects:
            raise UsageError(f"{key} was not added to version {version.number}")
        return self.record({k: s for k, s in version.effects.items() if k != key}, f"removed {key}")
