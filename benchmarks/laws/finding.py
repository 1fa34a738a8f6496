"""The side that does not know: a folder of tables goes in, formulae come out, and how they do on the run held out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.identifying import DRAWS, candidates, tables
from lacet.identify.car.rows import Row
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.laws.formulas import propose
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import floor_of, simulate_floor
from lacet.identify.validation.score import profile_zeros


def find(folder: Path) -> dict[str, Any]:
    """Formulae for what the base model lacks on a folder's runs used, as plain data.

    Each has `held`, the part of the excess above the floor of its rows that it explains on the run held out once it is
    added to the model. `seconds` : processor time of the search alone.
    """
    found = tables(folder)
    base = fit(found.model(()), found.used)
    physics = [effect for effect in candidates(found, ()) if effect.as_physics is not None]
    space = ScoreTests.of(Linearisation.of(base, floor_of(base, DRAWS)), physics, 0)
    failing = space.residual_beside([]).above
    begin = time.process_time()
    formulas = propose(space, failing)
    seconds = time.process_time() - begin
    before = _above(base, found.held) if formulas else {}
    out: list[dict[str, Any]] = []
    for i, formula in enumerate(formulas):
        model = found.model(())
        for effect in one_line_effects(f"found{i} = {formula.text}", found.vehicle, found.rig.wheel_reference):
            model += effect
        after = _above(fit(model, found.used), found.held)
        taken = 1.0 - sum(after[row] for row in formula.rows) / sum(before[row] for row in formula.rows)
        out.append({**asdict(formula), "rows": list(map(str, formula.rows)), "held": taken})
    return {"failing": list(map(str, failing)), "formulas": out, "seconds": seconds}


def _above(fitted: Fit, held: Sequence[PreparedRun]) -> dict[Row, float]:
    """Row → (residual ÷ floor)² − 1 on the runs held out."""
    effects, theta = fitted.model.physics, fitted.physics
    sensitivities = [Sensitivity.of(run.recording, effects, theta) for run in held]
    floors = simulate_floor(held, lambda run: [(held[run], sensitivities[run])], 20, 1).by_run
    out: dict[Row, float] = {}
    for run, sensitivity, floor in zip(held, sensitivities, floors, strict=True):
        zeros = zeros_of(run, sensitivity)
        left = {row: run.measured[row] - run.matrix(effects, row) @ theta for row in run.rows}
        values = profile_zeros(run, zeros, left, floor)
        for row in run.rows:
            squares = (left[row] - zeros.columns[row] @ values) ** 2
            out[row] = out.get(row, 0.0) + float(np.mean(squares)) / floor[row] ** 2 - 1.0
    return out
