"""Storage form of fits and rankings, without what a study makes anew (runs, model, effects), and the way back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from lacet.identify.effects.base import Effect
from lacet.identify.regression.assembly import Assembly
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.sums.prepared_runs import without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.diagnosis import Diagnosis

_LIVE = ("model", "runs", "assembly")
"""What a fit holds beside its values: it is made again from the study."""


def fit_record(fitted: Fit) -> dict[str, Any]:
    """Values of a fit by name, with where its sensitivities were taken (`at`) and the samples' `weights`."""
    values = {f.name: getattr(fitted, f.name) for f in fields(Fit) if f.name not in _LIVE}
    at = fitted.assembly.at
    return {**values, "at": None if at is None else at.values, "weights": fitted.assembly.weights}


def restored_fit(record: Mapping[str, Any], model: Model, runs: Sequence[PreparedRun]) -> Fit:
    """The fit of a record, of the same model on the same runs."""
    values = dict(record)
    at, weights = values.pop("at"), values.pop("weights")
    removed, base, options = values["removed"], values["base"], values["options"]
    if model.faults:
        runs = [without_faults(run, model.faults, removed) for run in runs]
    assembly = Assembly(
        model.physics, base.independent, model.faults, runs, None if at is None else ExpansionPoint(at), options.zeros,
        seeds=options.seeds, payload=options.payload,
    )  # fmt: skip
    return Fit(model=model, runs=tuple(runs), assembly=assembly.weighted(weights), **values)


def diagnosis_record(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of a ranking by name, of its effects the keys; without the noise in the columns and what is after it."""
    values = {f.name: getattr(diagnosis, f.name) for f in fields(Diagnosis) if f.name not in ("noise", "after")}
    return {**values, "effects": list(diagnosis.effects)}


def restored_diagnosis(record: Mapping[str, Any], effects: Mapping[str, Effect], noise: RegressorNoise) -> Diagnosis:
    """The ranking of a record; `effects` by key, those that can be computed among them."""
    values = dict(record) | {"effects": {key: effects[key] for key in record["effects"]}, "noise": noise}
    return Diagnosis(**values)
