"""The side that does not know: tables, rig and vehicle in a folder go in, verdicts come out.

Nothing here imports the simulator or the cases. What depends on the motion and hardly on the noise (sensitivities,
noise moments, noise floor) is taken from a *reference*: the very tables, as a user has it, or for many trials tables of
the same drive measured once more, those of another trial. The noise in the columns is always found on the very tables.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.wls import Fit, corrected_run, fit
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of, simulate_floor
from lacet.identify.validation.score import profile_zeros

Added = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
"""Effects on top of the base model: key and shape constants of each, in the order they were added."""
DRAWS = 199
MOST = 4
"""No more effects are added one after the other."""


@dataclass
class Answer:
    """What was concluded from the tables.

    `steps` one diagnosis after the other, each on top of what the one before proposed; `added` what they proposed;
    `parameters` value and half of the 95 % interval (sheet included) of what was added; `seconds` of
    processor time by stage.
    """

    steps: list[dict[str, Any]] = field(default_factory=list)
    added: Added = ()
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def timed(self, stage: str, begin: float) -> None:
        """Count the time since `begin` to a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.process_time() - begin


@dataclass(frozen=True)
class Tables:
    """The runs of one folder, brought together."""

    rig: Rig
    vehicle: Vehicle
    used: tuple[PreparedRun, ...]
    held: tuple[PreparedRun, ...]

    @property
    def known(self) -> dict[str, Effect]:
        """The catalogue for this car."""
        return catalogue(self.vehicle, self.rig.wheel_reference)

    def model(self, added: Added) -> Model:
        """The base model with effects on top."""
        out = Model.of(base_model(self.vehicle, self.rig.wheel_reference))
        for key, shape in added:
            effect = self.known[key]
            out += replace(effect, shape={**effect.shape, **dict(shape)})
        return out


@lru_cache(maxsize=3)
def tables(folder: Path) -> Tables:
    """Read a folder."""
    rig, vehicle = Rig.load(folder / "rig.toml"), Vehicle.load(folder / "vehicle.toml")
    used, held = (
        tuple(PreparedRun.of(open_run(file), vehicle, rig) for file in sorted((folder / part).glob("*.parquet")))
        for part in ("used", "held")
    )
    return Tables(rig, vehicle, used, held)


@lru_cache(maxsize=8)
def reference(folder: Path, added: Added) -> Fit:
    """A model fitted to the reference: its `stored` is what fits to the same motion have in common."""
    found = tables(folder)
    return fit(found.model(added), found.used)


@lru_cache(maxsize=8)
def floor(folder: Path, added: Added, draws: int) -> NoiseFloor:
    """The noise floor of a model on the reference."""
    return floor_of(reference(folder, added), draws)


def at_reference(folder: Path, known: Path, added: Added) -> Added:
    """Effects as the reference has them: shape constants between two values of the grid are many, and as well there."""
    if folder == known:
        return added
    grids = {key: tables(known).known[key].grids for key, _ in added}
    return tuple(
        (key, tuple((name, min(grids[key].get(name, (x,)), key=lambda at, x=x: abs(at - x))) for name, x in shape))
        for key, shape in added
    )


def candidates(found: Tables, without: Sequence[str]) -> list[Effect]:
    """The catalogue beyond the base model, some families left out."""
    return [e for e in found.known.values() if not e.base and e.name not in without]


@lru_cache(maxsize=2)
def held_reference(folder: Path) -> tuple[tuple[Sensitivity, ...], tuple[Mapping[str, float], ...]]:
    """Sensitivities and noise floor of the runs held out, under the base model."""
    found = tables(folder)
    fitted = reference(folder, ())
    effects, theta = fitted.model.physics, fitted.physics
    sensitivities = tuple(Sensitivity.of(run.recording, effects, theta) for run in found.held)
    floor = simulate_floor(found.held, lambda run: [(found.held[run], sensitivities[run])], 20, 1)
    return sensitivities, floor.by_run


@lru_cache(maxsize=8)
def fitted_model(folder: Path, known: Path, added: Added) -> Fit:
    """A model fitted to the runs used."""
    if folder == known:
        return reference(folder, added)
    found, alike = tables(folder), at_reference(folder, known, added)
    # What is stored is of the very model; columns of a gap that is passed here may be empty at the next.
    return fit(found.model(added), found.used, stored=reference(known, added).stored if alike == added else None)


def identify(folder: Path, known: Path, without: Sequence[str] = (), draws: int = DRAWS, again: bool = True) -> Answer:
    """Diagnose a folder's runs used, adding what is proposed until nothing is.

    `known` : folder of the reference, or the same; `without` : families left out of the candidates; `again` : diagnose
    once more when something was added.
    """
    out = Answer()
    begin = time.process_time()
    found = tables(folder)
    out.timed("read", begin)
    tried = candidates(found, without)
    while True:
        begin = time.process_time()
        fitted = fitted_model(folder, known, out.added)
        out.timed("fit", begin)
        if len(out.added) == MOST or (out.added and not again):
            break
        begin = time.process_time()
        noise = floor(known, at_reference(folder, known, out.added), draws)
        out.timed("floor", begin)
        begin = time.process_time()
        diagnosis = diagnose(fitted, noise, tried)
        out.timed("diagnose", begin)
        out.steps.append(step_of(diagnosis))
        if diagnosis.best is None:
            break
        out.added = (*out.added, (diagnosis.best.key, tuple(sorted(diagnosis.best.shape.items()))))
    wide = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance + fitted.covariance_sheet)))
    ours = {key for key, _ in out.added}
    effects = (*fitted.model.physics, *fitted.model.faults)
    owners = [effect.key for effect in effects for _ in effect.parameters]
    for i, (name, owner) in enumerate(zip(fitted.model.names, owners, strict=True)):
        if owner in ours:
            out.parameters[name] = (float(fitted.theta[i]), TWO_SIDED_95 * float(wide[i]))
    return out


def step_of(d: Diagnosis) -> dict[str, Any]:
    """A diagnosis as plain data."""
    worst = max(d.ratios, key=lambda row: d.ratios[row])
    return {
        "verdict": d.verdict.value,
        "best": d.best.key if d.best else None,
        "shape": dict(d.best.shape) if d.best else {},
        "ties": [key for key, _ in d.best.ties] if d.best else [],
        "worst": [worst, d.ratios[worst]],
        "excess": d.excess,
        "explained": d.explained,
        "candidates": [
            {"key": c.key, "answer": c.answer.value, "p": c.p, "gain": c.gain, "total": c.total_gain, "drop": c.drop,
             "size": c.size, "coverage": c.coverage}
            for c in d.candidates
        ],
    }  # fmt: skip


def held_out(folder: Path, known: Path, added: Added) -> float:
    """Residual ÷ floor of a model on the runs held out, root mean square over their rows."""
    fitted, found = fitted_model(folder, known, added), tables(folder)
    sensitivities, floors = held_reference(known)
    squares: list[float] = []
    for run, sensitivity, floor in zip(found.held, sensitivities, floors, strict=True):
        right = corrected_run(run, fitted)
        zeros = zeros_of(right, sensitivity)
        left = {r: right.measured[r] - right.matrix(fitted.model.physics, r) @ fitted.physics for r in right.rows}
        values = profile_zeros(right, zeros, left, floor)
        squares += [float(np.mean((left[r] - zeros.columns[r] @ values) ** 2)) / floor[r] ** 2 for r in right.rows]
    return float(np.sqrt(np.mean(squares)))
