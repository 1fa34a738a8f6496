"""Session of a study, behind identify, compare, diagnose and add: fits, scores, rankings, and results as plain data."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from lacet.daq.errors import UsageError, nearest
from lacet.identify.car.manoeuvre_phases import Phases, phases_of
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.catalogue import base_model, find_effect
from lacet.identify.progress import silent
from lacet.identify.properties.derived import DamperCurve, damper_curves
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.diagnose import Diagnosis, diagnose
from lacet.identify.selection.regressor_noise import RegressorNoise
from lacet.identify.validation.contributions import Shares, shares_of
from lacet.identify.validation.failure_analysis import FailureAnalysis, analyse_failure
from lacet.identify.validation.noise_floor import SCORE_DRAWS, NoiseFloor, floor_of
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison, compare
from lacet.services.cache.keys import service_sources
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.workspace.loading import Loaded, check_reference, load
from lacet.services.workspace.results import change_result, diagnosis_result, fit_result
from lacet.services.workspace.session_records import diagnosis_record, fit_record, restored_diagnosis, restored_fit
from lacet.services.workspace.study import Study, Version
from lacet.services.workspace.study_cache import StudyCache

MOST_EFFECTS = 10
"""Largest number of effects that a search for missing ones adds."""
VERSIONS_AT_HAND = 1
"""Number of versions whose fits, floors and scores a session holds in memory. Those of the others are read from the
study's cache again, in a tenth of a second; a fit's sensitivities are as large as the motions of all runs."""


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
        self.progress = progress
        self._study, self._cache = study, StudyCache(study)
        self._loaded: Loaded | None = None
        self._held: tuple[PreparedRun, ...] | None = None
        self._fits: OrderedDict[int, Fit] = OrderedDict()
        self._floors: OrderedDict[int, NoiseFloor] = OrderedDict()
        self._compared: OrderedDict[tuple[int, bool], list[Comparison]] = OrderedDict()

    @property
    def study(self) -> Study:
        """The study at work."""
        return self._study

    @study.setter
    def study(self, study: Study) -> None:
        self._study, self._cache = study, StudyCache(study)

    # -- runs ---------------------------------------------------------------------------------------------------------

    @property
    def loaded(self) -> Loaded:
        """The runs used, read when they are first asked for."""
        if self._loaded is None:
            self.progress(ServiceStep(ServiceStage.READING_RUNS, total=len(self.study.used), subject="used"))
            self._loaded = self._read(self.study.paths(), "used")
        return self._loaded

    def _read(self, paths: Sequence[Path], kind: str) -> Loaded:
        folder = self.study.folder
        return load(
            paths, folder / "rig.toml", folder / "vehicle.toml", self.study.filters,
            lambda step: self.progress(replace(step, subject=kind)),
        )  # fmt: skip

    @property
    def held(self) -> tuple[PreparedRun, ...]:
        """The runs held out, read when they are first asked for."""
        if self._held is None:
            self._held = ()
            if self.study.held:
                self.progress(ServiceStep(ServiceStage.READING_RUNS, total=len(self.study.held), subject="held out"))
                loaded = self._read(self.study.paths(held=True), "held out")
                check_reference(self.loaded.reference, loaded.reference)
                known = self.loaded.warnings
                warnings = (*known, *(w for w in loaded.warnings if w not in known))
                self._loaded = replace(self.loaded, warnings=warnings)
                self._held = loaded.prepared
        return self._held

    def reference(self, version: Version) -> str:
        """Wheel reference of the runs: as a version's result has it, or from the runs themselves."""
        return str(version.result.get("wheel_reference") or self.loaded.reference)

    # -- values of a version, kept in the study -----------------------------------------------------------------------

    def fitted(self, version: Version) -> Fit:
        """The fit of a version."""
        if version.number not in self._fits:
            _make_room(self._fits, VERSIONS_AT_HAND)
            reference = self.reference(version)
            key = self._cache.key("regression", version, reference)
            model, kept = self.study.model(version, reference), self._cache.store.load("fit", key)
            if kept is not None:
                self._fits[version.number] = restored_fit(kept, model, self.loaded.prepared)
            else:
                found = self._fit(version, model)
                self._cache.store.save("fit", key, fit_record(found))
                self._fits[version.number] = found
        self._fits.move_to_end(version.number)
        return self._fits[version.number]

    def _fit(self, version: Version, model: Model) -> Fit:
        self.progress(ServiceStep(ServiceStage.FITTING, effects=tuple(version.effects), version=version.number))
        return fit(
            model, self.loaded.prepared,
            progress=lambda step: self.progress(ServiceStep.of_version(step, version.number)),
        )  # fmt: skip

    def knowledge(self, version: Version) -> Knowledge:
        """The parameter knowledge of a version, from the runs used."""
        key = self._cache.key("validation", version, self.reference(version))
        return self._cache.kept("knowledge", key, lambda: Knowledge.of(self.fitted(version)))

    def damper_curves(self, version: Version) -> dict[str, DamperCurve]:
        """Corner → damper curve of a version."""
        key = self._cache.key("properties", version, self.reference(version))
        return self._cache.kept("dampers", key, lambda: damper_curves(self.fitted(version), self.knowledge(version)))

    def comparisons(self, version: Version, held: bool) -> list[Comparison]:
        """A version against the runs used, or held out."""
        place = (version.number, held)
        if place not in self._compared:
            _make_room(self._compared, 2 * VERSIONS_AT_HAND)
            key = self._key_with(version, held, SCORE_DRAWS)
            self._compared[place] = self._cache.kept("compared", key, lambda: self._compare(version, held))
        self._compared.move_to_end(place)
        return self._compared[place]

    def _compare(self, version: Version, held: bool) -> list[Comparison]:
        fitted = self.fitted(version)
        knowledge = self.knowledge(version) if held else None
        parts: list[Comparison] = []
        for run in self.held if held else self.loaded.prepared:
            self.progress(ServiceStep(ServiceStage.COMPARING, subject=run.name, version=version.number))
            parts.append(compare(fitted, run, SCORE_DRAWS, knowledge=knowledge))
        return parts

    def _key_with(self, version: Version, held: bool, *more: object) -> str:
        """Key of a value of the runs used, or held out, that validation makes."""
        runs = self._cache.runs_key(held=True) if held else []
        return self._cache.key("validation", version, self.reference(version), held, runs, *more)

    def every_comparison(self, version: Version) -> list[Comparison]:
        """A version against all runs, those used first."""
        return [*self.comparisons(version, held=False), *self.comparisons(version, held=True)]

    def shares(self, version: Version) -> list[Shares]:
        """Each effect's contribution to the prediction of all runs, those used first."""
        out: list[Shares] = []
        for held in (False, True):
            key = self._key_with(version, held)
            out += self._cache.kept("shares", key, lambda held=held: self._shares(version, held))
        return out

    def _shares(self, version: Version, held: bool) -> list[Shares]:
        self.progress(ServiceStep(ServiceStage.CONTRIBUTIONS))
        runs, fitted = self.held if held else self.loaded.prepared, self.fitted(version)
        return [shares_of(fitted, run, part) for run, part in zip(runs, self.comparisons(version, held), strict=True)]

    def phases(self, version: Version) -> list[Phases]:
        """The manoeuvre phases of all runs, those used first."""
        out: list[Phases] = []
        for held in (False, True):
            key = self._key_with(replace(version, effects={}), held)
            out += self._cache.kept("phases", key, lambda held=held: self._phases(held))
        return out

    def _phases(self, held: bool) -> list[Phases]:
        self.progress(ServiceStep(ServiceStage.MANOEUVRE_PHASES))
        return [phases_of(run.overview().motion) for run in (self.held if held else self.loaded.prepared)]

    def pictures(self, version: Version) -> dict[str, bytes]:
        """Pictures of a version against all runs and of its dampers: name → PNG."""
        held = self._cache.runs_key(held=True)
        key = self._cache.key("properties", version, self.reference(version), held, service_sources("render"))
        runs, dampers = self._cache.kept("pictures", key, lambda: self._drawn(version))
        out = {
            f"{run}-v{version.number}-{what}": png for run, pictures in runs.items() for what, png in pictures.items()
        }
        return out if dampers is None else {**out, f"dampers-v{version.number}": dampers}

    def _drawn(self, version: Version) -> tuple[dict[str, dict[str, bytes]], bytes | None]:
        # Only here: matplotlib takes half a second to load.
        from lacet.services.render.figures.validation_plots import comparison_pictures, damper_picture

        parts, curves = self.every_comparison(version), self.damper_curves(version)
        return {part.name: comparison_pictures(part) for part in parts}, damper_picture(curves)

    def page(self, kind: str, version: Version, content: object, write: Callable[[], str]) -> str:
        """An HTML page on a version, kept or as `write` gives it; `content` : what it shows beside its values."""
        sentences, held = service_sources("render", "workspace"), self._cache.runs_key(held=True)
        about = [self.study.folder.resolve().name, version.number, self.study.draws, held, content, sentences]
        key = self._cache.key("properties", version, self.reference(version), *about)
        return self._cache.kept(kind, key, write)

    def floor(self, version: Version, progress: Progress | None = None) -> NoiseFloor:
        """The noise floor of a version's fit on the runs used, in single precision."""
        if version.number not in self._floors:
            _make_room(self._floors, VERSIONS_AT_HAND)
            key = self._cache.key("validation", version, self.reference(version), self.study.draws)

            def simulated() -> tuple[dict[Row, NDArray[np.float32]], ...]:
                made = floor_of(self.fitted(version), self.study.draws, progress=progress or self.progress)
                return tuple({row: a.astype(np.float32) for row, a in part.items()} for part in made.draws)

            single = self._cache.kept("floor", key, simulated)
            draws = tuple({row: a.astype(float) for row, a in part.items()} for part in single)
            self._floors[version.number] = NoiseFloor.of(draws)
        self._floors.move_to_end(version.number)
        return self._floors[version.number]

    def failure(
        self, version: Version, row: str = "", run: str = "", progress: Progress | None = None
    ) -> FailureAnalysis:
        """The failure analysis of a version, in all rows and runs or in those asked for.

        Raises UsageError for an unknown row or run.
        """
        parts, phases = self.every_comparison(version), self.phases(version)
        names = [part.name for part in parts]
        if run and run not in names:
            raise UsageError(f"no run {run} in this study{nearest(run, names)}: {', '.join(names)}")
        rows = [one for one in ROWS if any(one in part.measured for part in parts if part.used)]
        if row and row not in rows:
            raise UsageError(f"no row {row} in these runs{nearest(row, rows)}: {', '.join(rows)}")
        chosen = [k for k, name in enumerate(names) if run in ("", name)]
        parts, phases = [parts[k] for k in chosen], [phases[k] for k in chosen]
        held = self._cache.runs_key(held=True)
        key = self._cache.key("validation", version, self.reference(version), self.study.draws, held, row, run)

        def analysed() -> FailureAnalysis:
            receiver = progress or self.progress
            fitted, floor = self.fitted(version), self.floor(version, receiver)
            found = analyse_failure(fitted, floor, parts, phases, Row.parse(row) if row else None, receiver)
            return replace(found, parts=(), phases=())  # these are kept already

        return replace(self._cache.kept("where", key, analysed), parts=tuple(parts), phases=tuple(phases))

    def diagnose(self, progress: Progress | None = None) -> Diagnosis:
        """Rank what is missing in the current version, and keep the finding."""
        version = self.study.version()
        reference = self.reference(version)
        key = self._cache.key("selection", version, reference, self.study.draws, catalogue=True)
        candidates = {k: e for k, e in self.study.effects(reference).items() if not e.base}
        noise = self._kept_noise(key)
        ranking = None if noise is None else self._cache.store.load("ranking", key)
        if noise is not None and ranking is not None:
            diagnosis = restored_diagnosis(ranking, candidates, noise)
        else:
            fitted, floor = self.fitted(version), self.floor(version, progress)
            self.progress(ServiceStep(ServiceStage.CANDIDATES, total=len(candidates)))
            diagnosis = diagnose(fitted, floor, list(candidates.values()), noise=noise, progress=self.progress)
            self._cache.store.save("noise", key, diagnosis.noise.arrays())
            self._cache.store.save("ranking", key, diagnosis_record(diagnosis))
        self.study.record_diagnosis(diagnosis_result(diagnosis))
        return diagnosis

    def _kept_noise(self, key: str) -> RegressorNoise | None:
        arrays = self._cache.store.load("noise", key)
        return None if arrays is None else RegressorNoise.from_arrays(arrays)

    # -- versions -----------------------------------------------------------------------------------------------------

    def record(self, effects: Mapping[str, Mapping[str, float]], note: str) -> Version:
        """Fit a model, score it on all runs and keep it as the study's new version; known results are used again."""
        number = max((v.number for v in self.study.versions()), default=0) + 1
        reference = self.reference(self.study.version()) if self.study.current else self.loaded.reference
        version = Version(number, effects, note, {"wheel_reference": reference})
        held, sentences = self._cache.runs_key(held=True), service_sources("render", "workspace")
        key = self._cache.key("properties", version, reference, held, SCORE_DRAWS, sentences)
        result = self._cache.kept("result", key, lambda: self._result(version))
        try:
            self.study = self.study.record(effects, note, result)
        finally:
            if self.study.current != number:  # another writer's version has this number now
                self.forget(number)
        return self.study.version()

    def _result(self, version: Version) -> dict[str, Any]:
        fitted = self.fitted(version)
        self.progress(ServiceStep(ServiceStage.SCORING))
        used, held = self.comparisons(version, held=False), self.comparisons(version, held=True)
        return fit_result(fitted, self.loaded, used, held, self.knowledge(version))

    def forget(self, number: int) -> None:
        """Let go of what was computed for a version's number."""
        for values in (self._fits, self._floors):
            values.pop(number, None)
        for held in (False, True):
            self._compared.pop((number, held), None)

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
        effect = find_effect(key, self.study.effects(self.reference(version)))
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


def _make_room(values: OrderedDict[Any, Any], most: int) -> None:
    """Let go of the values not used for longest, so that one more makes at most `most`."""
    while len(values) >= most:
        values.popitem(last=False)
