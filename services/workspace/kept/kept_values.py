"""Values of a study's versions (fits, scores, noise floors, analyses, pictures), made when first used and kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lacet.daq.errors import UsageError, nearest
from lacet.identify.car.manoeuvre_phases import Phases, phases_of
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Step
from lacet.identify.properties.derived import DamperCurve, damper_curves
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.contributions import Shares, shares_of
from lacet.identify.validation.failure_analysis import FailureAnalysis, analyse_failure
from lacet.identify.validation.noise_floor import SCORE_DRAWS, NoiseFloor, RunDraws, floor_of
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison, compare, row_ratios
from lacet.identify.wheel_loads.known_car import KnownCar
from lacet.identify.wheel_loads.lack_of_fit import known_car
from lacet.identify.wheel_loads.measured_forces import ComparedForces, compare_forces
from lacet.services.cache.keys import service_sources
from lacet.services.progress import TRIAL, AnyStep, ServiceStage, ServiceStep
from lacet.services.workspace.kept.session_records import diagnosis_record, fit_record, restored_diagnosis, restored_fit
from lacet.services.workspace.kept.study_cache import StudyCache
from lacet.services.workspace.kept.study_runs import StudyRuns
from lacet.services.workspace.results import fit_result
from lacet.services.workspace.study import Study, Version

VERSIONS_AT_HAND = 1
"""Number of versions whose fits, floors and scores are held in memory. Those of the others are read from the study's
cache again, in a tenth of a second; a fit's sensitivities are as large as the motions of all runs."""


class KeptValues:
    """Values of the versions of one study, each as it is kept in the study's folder, or made of the runs and kept.

    Parameters
    ----------
    runs : the study's runs, which are read only when a value has to be made.
    """

    def __init__(self, runs: StudyRuns):
        self.runs = runs
        self._cache = StudyCache(runs.study)
        self._fits: OrderedDict[int, Fit] = OrderedDict()
        self._floors: OrderedDict[int, NoiseFloor] = OrderedDict()
        self._compared: OrderedDict[tuple[int, bool], list[Comparison]] = OrderedDict()

    def use(self, study: Study) -> None:
        """Go on with the same study in another state."""
        self.runs.study, self._cache = study, StudyCache(study)

    def forget(self, number: int) -> None:
        """Drop the values of a version's number from memory; those on disk stay."""
        for values in (self._fits, self._floors):
            values.pop(number, None)
        for held in (False, True):
            self._compared.pop((number, held), None)

    def has(self, kind: str, version: Version, held: bool = False) -> bool:
        """Whether a value is kept: a fit, knowledge, comparison, floor, ranking … (the kinds of `_key`)."""
        if not version.result.get("wheel_reference") and not self.runs.present[0]:
            return False  # nothing was ever made of these runs, and a key would read them
        return self._cache.store.has(kind, self._key(kind, version, held))

    def _key(self, kind: str, version: Version, held: bool = False, *more: object) -> str:
        """Key of a version's value of one kind; `held` : of the runs held out; `more` : what else it depends on."""
        draws, reference = self.runs.study.draws, self.runs.reference(version)
        some = self._cache.runs_key(held=True) if held else []
        every = self._cache.runs_key(held=True)
        match kind:
            case "fit":
                room, about = "regression", ()
            case "knowledge":
                room, about = "validation", ()
            case "dampers":
                room, about = "properties", ()
            case "compared":
                room, about = "validation", (held, some, SCORE_DRAWS)
            case "forces":
                room, about = "wheel_loads", (some, SCORE_DRAWS)
            case "shares":
                room, about = "validation", (held, some)
            case "phases":
                room, about, version = "validation", (held, some), replace(version, effects={})
            case "floor":
                room, about = "validation", (draws,)
            case "where":
                room, about = "validation", (draws, every, *(more or ("", "")))
            case "noise" | "ranking":
                return self._cache.key("selection", version, reference, draws, catalogue=True)
            case "pictures":
                room, about = "wheel_loads", (every, service_sources("render"))
            case "result":
                room, about = "properties", (every, SCORE_DRAWS, service_sources("render", "workspace"))
            case _:  # a page
                sentences = service_sources("render", "workspace")
                name = self.runs.study.folder.resolve().name
                room, about = "properties", (name, version.number, draws, every, *more, sentences)
        return self._cache.key(room, version, reference, *about)

    # -- the fit ------------------------------------------------------------------------------------------------------

    def fitted(self, version: Version) -> Fit:
        """The fit of a version."""
        if version.number not in self._fits:
            _make_room(self._fits, VERSIONS_AT_HAND)
            key = self._key("fit", version)
            model, kept = (
                self.runs.study.model(version, self.runs.reference(version)), self._cache.store.load("fit", key)
            )  # fmt: skip
            if kept is not None:
                self._fits[version.number] = restored_fit(kept, model, self.runs.loaded.prepared)
            else:
                found = self._fit(version, model)
                self._cache.store.save("fit", key, fit_record(found))
                self._fits[version.number] = found
        self._fits.move_to_end(version.number)
        return self._fits[version.number]

    def _fit(self, version: Version, model: Model) -> Fit:
        def progress(step: AnyStep) -> None:
            self.runs.progress(ServiceStep.of_version(step, version.number, version.effects))

        progress(Step(ServiceStage.FITTING))
        return fit(model, self.runs.loaded.prepared, progress=progress)

    def knowledge(self, version: Version) -> Knowledge:
        """The parameter knowledge of a version, from the runs used."""
        key = self._key("knowledge", version)
        return self._cache.kept("knowledge", key, lambda: Knowledge.of(self.fitted(version)))

    def damper_curves(self, version: Version) -> dict[str, DamperCurve]:
        """Corner → damper curve of a version."""
        key = self._key("dampers", version)
        return self._cache.kept("dampers", key, lambda: damper_curves(self.fitted(version), self.knowledge(version)))

    # -- model and measurement ----------------------------------------------------------------------------------------

    def comparisons(self, version: Version, held: bool) -> list[Comparison]:
        """A version against the runs used, or held out."""
        place = (version.number, held)
        if place not in self._compared:
            _make_room(self._compared, 2 * VERSIONS_AT_HAND)
            key = self._key("compared", version, held)
            self._compared[place] = self._cache.kept("compared", key, lambda: self._compare(version, held))
        self._compared.move_to_end(place)
        return self._compared[place]

    def _compare(self, version: Version, held: bool) -> list[Comparison]:
        fitted = self.fitted(version)
        knowledge = self.knowledge(version) if held else None
        parts: list[Comparison] = []
        runs = self.runs.prepared(held)
        for done, run in enumerate(runs):
            step = Step(ServiceStage.COMPARING, done, len(runs), run.name)
            self.runs.progress(ServiceStep.of_version(step, version.number, version.effects))
            parts.append(compare(fitted, run, SCORE_DRAWS, knowledge=knowledge))
        return parts

    def every_comparison(self, version: Version) -> list[Comparison]:
        """A version against all runs, those used first."""
        return [*self.comparisons(version, held=False), *self.comparisons(version, held=True)]

    def known_car(self, version: Version) -> KnownCar:
        """The car as a version knows it, for the wheel forces of runs without dynamometers.

        Its lack of fit is that of the runs held out, where there are any.
        """
        held = bool(self.comparisons(version, held=True))
        compared = zip(self.runs.prepared(held), self.comparisons(version, held), strict=True)
        return known_car(self.fitted(version), self.knowledge(version), compared)

    def forces(self, version: Version) -> list[ComparedForces]:
        """Wheel forces of the runs held out, estimated as if without dynamometers, beside what these measured."""
        return self._cache.kept("forces", self._key("forces", version, held=True), lambda: self._forces(version))

    def _forces(self, version: Version) -> list[ComparedForces]:
        runs = self.runs.prepared(held=True)
        car = self.known_car(version) if runs else None
        found: list[ComparedForces] = []
        for done, run in enumerate(runs):
            self.runs.progress(ServiceStep(ServiceStage.WHEEL_FORCES, done, len(runs), run.name))
            if car is not None and (part := compare_forces(car, run)) is not None:
                found.append(part)
        return found

    def shares(self, version: Version) -> list[Shares]:
        """Each effect's contribution to the prediction of all runs, those used first."""
        return [*self._kept_shares(version, False), *self._kept_shares(version, True)]

    def _kept_shares(self, version: Version, held: bool) -> list[Shares]:
        return self._cache.kept("shares", self._key("shares", version, held), lambda: self._shares(version, held))

    def _shares(self, version: Version, held: bool) -> list[Shares]:
        runs, fitted, parts = self.runs.prepared(held), self.fitted(version), self.comparisons(version, held)
        self.runs.progress(ServiceStep(ServiceStage.CONTRIBUTIONS))
        return [shares_of(fitted, run, part) for run, part in zip(runs, parts, strict=True)]

    def phases(self, version: Version) -> list[Phases]:
        """The manoeuvre phases of all runs, those used first."""
        out: list[Phases] = []
        for held in (False, True):
            key = self._key("phases", version, held)
            out += self._cache.kept("phases", key, lambda held=held: self._phases(held))
        return out

    def _phases(self, held: bool) -> list[Phases]:
        runs = self.runs.prepared(held)
        self.runs.progress(ServiceStep(ServiceStage.MANOEUVRE_PHASES))
        return [phases_of(run.overview().outline) for run in runs]

    # -- where it fails, and what is missing --------------------------------------------------------------------------

    def floor(self, version: Version) -> NoiseFloor:
        """The noise floor of a version's fit on the runs used, in single precision."""
        if version.number not in self._floors:
            _make_room(self._floors, VERSIONS_AT_HAND)

            def simulated() -> tuple[RunDraws, ...]:
                made = floor_of(self.fitted(version), self.runs.study.draws, progress=self.runs.progress)
                return tuple(run.of_type(np.float32) for run in made.draws)

            single = self._cache.kept("floor", self._key("floor", version), simulated)
            self._floors[version.number] = NoiseFloor.of([run.of_type(np.float64).set_aside() for run in single])
        self._floors.move_to_end(version.number)
        return self._floors[version.number]

    def failure(self, version: Version, row: str = "", run: str = "") -> FailureAnalysis:
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

        def analysed() -> FailureAnalysis:
            fitted, floor = self.fitted(version), self.floor(version)
            only = Row.parse(row) if row else None
            found = analyse_failure(fitted, floor, parts, phases, only, self.runs.progress)
            return replace(found, parts=(), phases=())  # these are kept already

        kept = self._cache.kept("where", self._key("where", version, False, row, run), analysed)
        return replace(kept, parts=tuple(parts), phases=tuple(phases))

    def diagnosis(self, version: Version) -> Diagnosis:
        """The ranking of what is missing in a version; the error ÷ floor in it is that of the version's result."""
        found = self._diagnosis(version)
        if not version.result:
            return found
        rows = row_ratios(version.result["rows"]["used"])
        return replace(found, ratios={Row.parse(row): ratio for row, ratio in rows.items()})

    def _diagnosis(self, version: Version) -> Diagnosis:
        key = self._key("ranking", version)
        known = self.runs.study.effects(self.runs.reference(version))
        candidates = {k: e for k, e in known.items() if not e.base}
        arrays = self._cache.store.load("noise", key)
        noise = None if arrays is None else RegressorNoise.from_arrays(arrays)
        ranking = None if noise is None else self._cache.store.load("ranking", key)
        if noise is not None and ranking is not None:
            return restored_diagnosis(ranking, candidates, noise)
        fitted, floor = self.fitted(version), self.floor(version)
        self.runs.progress(ServiceStep(ServiceStage.CANDIDATES, total=len(candidates)))
        found = diagnose(fitted, floor, list(candidates.values()), noise=noise, progress=self.runs.progress)
        self._keep(key, found)
        if found.after is not None:
            # What remains beside all of them was tested already: no second ranking of the model with them.
            added = {c.key: dict(c.shape) for c in found.found}
            self._keep(self._key("ranking", replace(version, effects={**version.effects, **added})), found.after)
        return found

    def _keep(self, key: str, found: Diagnosis) -> None:
        self._cache.store.save("noise", key, found.noise.arrays())
        self._cache.store.save("ranking", key, diagnosis_record(found))

    def with_effect(self, version: Version, effect: Effect) -> tuple[list[Comparison], list[Shares]]:
        """A version's model with one more effect, fitted anew: against the runs used, and its effects' contributions.

        All is kept under the model's own key: a version that has the effect starts from it.
        """
        self.forget(TRIAL)
        try:
            return self.comparisons(trial(version, effect), held=False), self._kept_shares(
                trial(version, effect), False
            )
        finally:
            self.forget(TRIAL)

    def next_run(
        self, version: Version, about: object, compute: Callable[[], tuple[dict[str, Any], bool]]
    ) -> dict[str, Any]:
        """What to drive next, as plain data: kept, or computed, and kept where `compute` says that it is complete.

        `about` : what was asked for, and whose sources.
        """
        draws, reference = self.runs.study.draws, self.runs.reference(version)
        key = self._cache.key("design", version, reference, draws, about, catalogue=True)
        kept: dict[str, Any] | None = self._cache.store.load("next", key)
        if kept is not None:
            return kept
        found, complete = compute()
        if complete:
            self._cache.store.save("next", key, found)
        return found

    # -- results, pictures and pages ----------------------------------------------------------------------------------

    def result(self, version: Version) -> dict[str, Any]:
        """A version's fit and scores as plain data."""
        return self._cache.kept("result", self._key("result", version), lambda: self._result(version))

    def _result(self, version: Version) -> dict[str, Any]:
        fitted = self.fitted(version)
        self.runs.progress(ServiceStep(ServiceStage.SCORING))
        used, held = self.comparisons(version, held=False), self.comparisons(version, held=True)
        return fit_result(fitted, self.runs.loaded, used, held, self.knowledge(version))

    def pictures(self, version: Version) -> dict[str, bytes]:
        """Pictures of a version against all runs and of its dampers: name → PNG."""
        key = self._key("pictures", version)
        runs, dampers = self._cache.kept("pictures", key, lambda: self._drawn(version))
        out = {
            f"{run}-v{version.number}-{what}": png for run, pictures in runs.items() for what, png in pictures.items()
        }
        return out if dampers is None else {**out, f"dampers-v{version.number}": dampers}

    def _drawn(self, version: Version) -> tuple[dict[str, dict[str, bytes]], bytes | None]:
        # Only here: matplotlib takes half a second to load.
        from lacet.services.render.figures.force_plots import forces_picture
        from lacet.services.render.figures.validation_plots import comparison_pictures, damper_picture

        parts, curves = self.every_comparison(version), self.damper_curves(version)
        drawn: dict[str, dict[str, bytes]] = {}
        for done, part in enumerate(parts):
            self.runs.progress(ServiceStep(ServiceStage.DRAWING_RUN, done, len(parts), part.name))
            drawn[part.name] = comparison_pictures(part)
        for found in self.forces(version):
            drawn[found.estimated.run]["forces"] = forces_picture(found.estimated, found.errors)
        return drawn, damper_picture(curves)

    def page(self, kind: str, version: Version, content: object, write: Callable[[], str]) -> str:
        """An HTML page on a version, kept or as `write` gives it; `content` : what it shows beside its values."""
        return self._cache.kept(kind, self._key(kind, version, False, content), write)


def trial(version: Version, effect: Effect) -> Version:
    """A version's model with one more effect, as a version that is not recorded: its number is `TRIAL`."""
    return replace(version, number=TRIAL, effects={**version.effects, effect.key: dict(effect.shape)})


def _make_room(values: OrderedDict[Any, Any], most: int) -> None:
    """Let go of the values not used for longest, so that one more makes at most `most`."""
    while len(values) >= most:
        values.popitem(last=False)
