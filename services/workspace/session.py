"""The work behind identify, compare, diagnose and add: fit, score, rank, and the results as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import plain
from lacet.identify.effects.catalogue import base_model, find_effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.properties.derived import damper_curves, derived_values, ranges
from lacet.identify.properties.whole_vehicle import NAMES, UNITS, whole_vehicle
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.diagnose import Candidate, Diagnosis, diagnose
from lacet.identify.signals.filters import Filters
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.identify.validation.parameter_estimates import estimates
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison, compare
from lacet.services.workspace.floor_cache import floor_key, load_floor, load_noise, save_floor, save_noise
from lacet.services.workspace.loading import Loaded, load
from lacet.services.workspace.study import Study, Version

LEAST_DRAWS = 19
"""Noise-floor simulations a diagnosis needs: with fewer, no p can be as low as 0.05."""
FLOOR_DRAWS = 20
"""Noise-floor simulations behind the floor of a score: its RMS is then known to about 1 %."""


def fit_run(path: str | Path) -> dict[str, Any]:
    """Fit the base model to one run that carries its rig and vehicle (a log): what a worker does with it."""
    # On one thread, as the command line has it: the same log then gives the same digits everywhere.
    with threadpool_limits(1):
        return _fit_run(path)


def _fit_run(path: str | Path) -> dict[str, Any]:
    loaded = load([path])
    fitted = fit(Model.of(base_model(loaded.vehicle, loaded.reference)), loaded.drives)
    parts = [compare(fitted, drive, FLOOR_DRAWS) for drive in fitted.drives]
    return fit_result(fitted, loaded, parts, drawn=fitted.bootstrap())


def fit_result(
    fitted: Fit, loaded: Loaded, used: Sequence[Comparison], held: Sequence[Comparison] = (),
    knowledge: Knowledge | None = None, drawn: Array | None = None,
) -> dict[str, Any]:  # fmt: skip
    """A fit as plain data (``docs/json.md``, ``identify``); `drawn` as `Fit.bootstrap` gives it."""
    knowledge = knowledge or Knowledge.of(fitted)
    found = estimates(fitted, drawn)
    whole = whole_vehicle(fitted, loaded.vehicle)
    left_out: dict[str, str] = {}
    for drive in fitted.drives:
        left_out |= {f"{drive.name}: {row}": why for row, why in drive.motion.left_out.items()}
    return plain(
        {
            "vehicle": loaded.vehicle.name,
            "rig": loaded.rig.name,
            "wheel_reference": loaded.reference,
            "effects": [effect.key for effect in fitted.model.effects],
            "parameters": [
                {
                    "name": e.name,
                    "effect": e.effect,
                    "value": e.value,
                    "unit": e.unit,
                    "interval95": [e.value - e.half, e.value + e.half],
                    "half95": e.half,
                    "half95_sheet": e.half_sheet,
                    "half95_bootstrap": e.half_bootstrap,
                    "sxr_percent": e.sxr,
                    "group": e.group,
                }
                for e in found
                if e.identifiable
            ],
            "not_identifiable": [
                {"name": e.name, "effect": e.effect, "why": e.why} for e in found if not e.identifiable
            ],
            "whole_vehicle": None
            if whole is None
            else [
                {"name": n, "value": v, "unit": u, "half95": h, "half95_sheet": s, "identifiable": d}
                for n, v, u, h, s, d in zip(
                    NAMES, whole.values, UNITS, whole.interval, whole.interval_sheet, whole.determined, strict=True
                )
            ],
            "derived": [
                {
                    "name": d.name,
                    "value": d.value,
                    "unit": d.unit,
                    "half95": d.half,
                    "identifiable": d.determined,
                    "why": d.why,
                }
                for d in derived_values(fitted, loaded.vehicle, knowledge)
            ],
            "damper_curves": {
                corner: {"travel": c.travel, "rate": c.rate, "force": c.force, "half95": c.half}
                for corner, c in damper_curves(fitted, knowledge).items()
            },
            "ranges": {r.name: {"low": r.low, "high": r.high, "unit": r.unit} for r in ranges(fitted)},
            "rows": {"used": scores(used), "held": scores(held)},
            "not_judged": [line for part in held for line in part.not_judged],
            "rows_left_out": left_out,
            "bad_seconds": [asdict(bad) for bad in fitted.bad_seconds()],
            "base_rank": fitted.base.rank,
            "singular_gap": fitted.base.gap,
            "warnings": list(loaded.warnings),
        }
    )


def scores(comparisons: Sequence[Comparison]) -> dict[str, dict[str, Any]]:
    """Scores by run and row."""
    return {c.name: {row: asdict(score) for row, score in c.scores.items()} for c in comparisons}


def overall(rows: Mapping[str, Mapping[str, Any]]) -> float:
    """Root mean square of residual ÷ floor over the rows of all runs: 1 is the noise floor."""
    ratios = [score["ratio"] for run in rows.values() for score in run.values()]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else float("nan")


class Work:
    """A study at work: its runs are loaded once, and fits are made when asked for.

    Examples
    --------
    >>> study = lacet.Study.create(Path("work"), [Path("tests/data/car/sine.parquet")], [], runs.rig, runs.vehicle)
    >>> lacet.Work(study).record({}, "base model").number
    1
    """

    def __init__(self, study: Study, progress: Progress = silent):
        self.study, self.progress = study, progress
        progress(Step(Stage.READING_RUNS, total=len(study.used), subject="used"))
        self.loaded = self._read(study.paths(), "used")
        self._held: tuple[Drive, ...] | None = None
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
    def held(self) -> tuple[Drive, ...]:
        """The runs held out."""
        if self._held is None:
            self._held = ()
            if self.study.held:
                self.progress(Step(Stage.READING_RUNS, total=len(self.study.held), subject="held out"))
                loaded = self._read(self.study.paths(held=True), "held out")
                if loaded.reference != self.loaded.reference:
                    raise UsageError(
                        f"the runs held out have {loaded.reference} wheel loads, those used {self.loaded.reference}"
                    )
                known = self.loaded.warnings
                self.loaded = replace(self.loaded, warnings=(*known, *(w for w in loaded.warnings if w not in known)))
                self._held = loaded.drives
        return self._held

    def fitted(self, version: Version) -> Fit:
        """The fit of a version."""
        if version.number not in self._fits:
            self.progress(Step(Stage.FITTING, names=tuple(version.effects), version=version.number))
            model = self.study.model(version, self.loaded.reference)
            self._fits[version.number] = fit(
                model, self.loaded.drives, progress=lambda step: self.progress(replace(step, version=version.number))
            )
        return self._fits[version.number]

    def knowledge(self, version: Version) -> Knowledge:
        """What the runs used tell of a version's parameters."""
        if version.number not in self._knowledge:
            self._knowledge[version.number] = Knowledge.of(self.fitted(version))
        return self._knowledge[version.number]

    def record(self, effects: Mapping[str, Mapping[str, float]], note: str) -> Version:
        """Fit a model, score it on all runs and keep it as the study's new version."""
        number = max((v.number for v in self.study.versions()), default=0) + 1
        version = Version(number, effects, note)
        fitted = self.fitted(version)
        self.progress(Step(Stage.SCORING))
        used, held = self.comparisons(version, held=False), self.comparisons(version, held=True)
        result = fit_result(fitted, self.loaded, used, held, self.knowledge(version))
        try:
            self.study = self.study.record(effects, note, result)
        finally:
            if self.study.current != number:  # another writer's version has this number now
                self.forget(number)
        return self.study.version()

    def forget(self, number: int) -> None:
        """Let go of what was computed for a version's number."""
        for kept in (self._fits, self._knowledge, self._floors):
            kept.pop(number, None)
        self._compared = {key: parts for key, parts in self._compared.items() if key[0] != number}

    def comparisons(self, version: Version, held: bool) -> list[Comparison]:
        """A version against the runs used, or held out."""
        key = (version.number, held)
        if key not in self._compared:
            fitted = self.fitted(version)
            knowledge = self.knowledge(version) if held else None
            drives = self.held if held else self.loaded.drives
            parts: list[Comparison] = []
            for drive in drives:
                self.progress(Step(Stage.COMPARING, subject=drive.name, version=version.number))
                parts.append(compare(fitted, drive, FLOOR_DRAWS, knowledge=knowledge))
            self._compared[key] = parts
        return self._compared[key]

    def floor(self, version: Version, progress: Progress | None = None) -> NoiseFloor:
        """The noise floor of a version's fit on the runs used, simulated once and kept in the study."""
        if version.number not in self._floors:
            key = floor_key(self.study, version)
            found = load_floor(self.study, key)
            if found is None:
                made = floor_of(self.fitted(version), self.study.draws, progress=progress or self.progress)
                found = save_floor(self.study, key, made)
            self._floors[version.number] = found
        return self._floors[version.number]

    def diagnose(self, progress: Progress | None = None) -> Diagnosis:
        """Rank what is missing in the current version, and keep the finding."""
        version = self.study.version()
        fitted = self.fitted(version)
        floor = self.floor(version, progress)
        key = floor_key(self.study, version)
        kept = load_noise(self.study, key)
        candidates = [e for e in self.study.effects(self.loaded.reference).values() if not e.base]
        self.progress(Step(Stage.CANDIDATES, total=len(candidates)))
        diagnosis = diagnose(fitted, floor, candidates, noise=kept, tell=self._in_selection)
        if diagnosis.noise is not kept:
            save_noise(self.study, key, diagnosis.noise)
        self.study.record_diagnosis(diagnosis_result(diagnosis))
        return diagnosis

    def _in_selection(self, text: str) -> None:
        self.progress(Step(Stage.SELECTION, subject=text))

    def add(self, key: str, shape: Mapping[str, float] | None = None) -> Version:
        """Add an effect to the current version, with the shape constants the last diagnosis found unless given."""
        version = self.study.version()
        if key in version.effects:
            raise UsageError(f"{key} is in the model already (version {version.number})")
        effect = find_effect(key, self.study.effects(self.loaded.reference))
        if shape is None:
            found = (self.study.diagnosis() or {}).get("candidates", [])
            shape = next((c["shape"] for c in found if c["effect"] == key), {})
        return self.record({**version.effects, key: {**effect.shape, **(shape or {})}}, f"added {key}")

    def remove(self, key: str) -> Version:
        """Take an effect out again: a new version without it. Raises UsageError when it is not in the model."""
        version = self.study.version()
        if key not in version.effects:
            raise UsageError(f"{key} was not added to version {version.number}")
        return self.record({k: s for k, s in version.effects.items() if k != key}, f"removed {key}")


def candidate_result(c: Candidate) -> dict[str, Any]:
    """A candidate as plain data."""
    return {
        "effect": c.key,
        "answer": c.answer,
        "why": c.why,
        "gain": c.gain,
        "gain_rms": c.gain_rms,
        "p": c.p,
        "coverage": c.coverage,
        "size": c.size,
        "shape": dict(c.shape),
        "values": list(c.values),
        "half95": list(c.interval),
        "rows": list(c.rows),
        "drop": c.drop,
        "absorbed": [{"by": name, "share": share} for name, share in c.absorbed],
        "ties": [{"effect": key, "correlation": r} for key, r in c.ties],
    }


def diagnosis_result(d: Diagnosis) -> dict[str, Any]:
    """A diagnosis as plain data (``docs/json.md``, ``diagnose``)."""
    return plain(
        {
            "verdict": d.verdict,
            "says": d.says,
            "best": d.best.key if d.best else None,
            "candidates": [candidate_result(c) for c in d.candidates],
            "rows": dict(d.ratios),
            "excess": d.excess,
            "explained": d.explained,
            "draws": d.draws,
            "louder": dict(d.louder),
            "failing": list(d.failing),
            "together": list(d.together),
            "formulas": [asdict(formula) for formula in d.formulas],
        }
    )


def default_filters(cutoff: float | None) -> Filters:
    """Filters with another cut-off of the fit [Hz]. Raises UsageError when it is out of range."""
    if cutoff is None:
        return Filters()
    if not cutoff > 0.0:
        raise UsageError(f"--cutoff {cutoff:g}: a frequency above 0 Hz (the paper says 3 to 7)")
    try:
        return Filters(fit_cutoff=cutoff, pre_cutoff=max(20.0, 3.0 * cutoff))
    except ValueError as cause:
        raise UsageError(str(cause)) from None
