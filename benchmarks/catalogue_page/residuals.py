"""What the base model leaves of a simulated run whose car has what the model lacks."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.making import cropped, simulator_code
from benchmarks.catalogue_page.cases import AT_HUB, CAR, CASES, DURATION, RIG, SEED, Case
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.body.engine_mount import EngineMount
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.validation.score import Comparison, compare
from lacet.identify.validation.states import State, states_of
from lacet.simulate import Hidden, exchange_run, find_car, make_manoeuvre
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text

Array = NDArray[np.float64]
BUILD = Path(__file__).parents[2] / "build" / "catalogue_page"


def _speed_squared(motion: Motion, row: Row) -> State:
    assert motion.velocity is not None
    return State("speed squared", "m²/s²", 2, np.sum(motion.velocity[:2] ** 2, axis=0))


def _slipping(motion: Motion, row: Row) -> State:
    assert motion.velocity is not None
    forward, left = motion.velocity[0], motion.velocity[1]
    return State("speed × lateral speed", "m²/s²", 2, np.hypot(forward, left) * left)


def _stroke(motion: Motion, row: Row) -> State:
    corner = motion.corners[row.place]
    return State("travel × travel rate", "m²/s", 0, corner.travel * corner.rate)


def _wheel(motion: Motion, row: Row) -> State:
    return State("vertical wheel acceleration", "m/s²", 0, motion.corners[row.place].centre_accel[2])


def _mounted(motion: Motion, row: Row) -> State:
    mount = EngineMount(shape={"frequency": 7.0, "damping": 0.08})
    return State("7 Hz mass less body, acceleration", "m/s²", 2, mount.columns(motion)["chassis.fz"][0])


def _time(motion: Motion, row: Row) -> State:
    return State("time", "s", 2, np.asarray(motion.t, float))


FURTHER: dict[str, Callable[[Motion, Row], State]] = {
    "speed squared": _speed_squared,
    "speed × lateral speed": _slipping,
    "travel × travel rate": _stroke,
    "vertical wheel acceleration": _wheel,
    "7 Hz mass less body, acceleration": _mounted,
    "time": _time,
}
"""States beyond those of `validation.states`, by name."""


@dataclass(frozen=True)
class Signature:
    """Residual of a `row` in units of its noise `floor` [`row_unit`] over `t` [s], and `against` a `state` [`unit`].

    `ratio` is its root mean square.
    """

    row: Row
    row_unit: str
    floor: float
    t: Array
    residual: Array
    state: str
    unit: str
    against: Array

    @property
    def ratio(self) -> float:
        """Root mean square of the residual ÷ floor."""
        return float(np.sqrt(np.mean(self.residual**2)))


def _kept(name: str, words: str, make: Callable[[], Any]) -> Any:
    """What was made once by the same simulator from the same words, or make it."""
    key = hashlib.sha256(f"{simulator_code()} {words}".encode()).hexdigest()[:12]
    file = BUILD / f"{name}-{key}.pickle"
    if file.is_file():
        return pickle.loads(file.read_bytes())
    made = make()
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}")
    part.write_bytes(pickle.dumps(made))
    part.replace(file)
    return made


def driven(run: str, hidden: Sequence[Hidden], at: str) -> Run:
    """Table of a simulated run, loads measured `at` contact or hub, ordinary noise and zeros; kept in ``build/``."""
    name, *settings = run.split()
    words = f"{run} {DURATION} {SEED} {[(h.name, h.size, sorted(h.shape.items())) for h in hidden]}{_of(at)}"

    def make() -> Run:
        pairs = [setting.split("=") for setting in settings]
        chosen = {"duration": DURATION} | {key: value if key == "grade" else float(value) for key, value in pairs}
        manoeuvre = make_manoeuvre(name, **chosen)
        mechanical = [h for h in hidden if not h.of_sensor]
        motion = simulate_drive(find_car(CAR), manoeuvre, mechanical, SEED)
        return cropped(exchange_run(motion, car(at)[1], SEED, faults=list(hidden)), manoeuvre.duration)

    return _kept(name, words, make)


def reference(family: str) -> str:
    """Where the loads are measured for a family's picture: as the rig says, where it makes no difference."""
    return "hub" if family in AT_HUB else Rig.load(RIG).wheel_reference


def _of(at: str) -> str:
    return "" if at == Rig.load(RIG).wheel_reference else f" {at}"


@cache
def car(at: str) -> tuple[Vehicle, Rig]:
    """The car to identify with, as `lacet simulate` writes it, and the rig, its loads measured `at` contact or hub."""
    BUILD.mkdir(parents=True, exist_ok=True)
    file = BUILD / "vehicle.toml"
    file.write_text(vehicle_text(find_car(CAR)), encoding="utf-8")
    return Vehicle.load(file), replace(Rig.load(RIG), wheel_reference=at)


def _fitted(runs: Sequence[Run], at: str) -> tuple[Fit, Comparison]:
    """The base model fitted to the runs, and what it makes of the first."""
    vehicle, rig = car(at)
    fitted = fit(Model.of(base_model(vehicle, rig.wheel_reference)), [PreparedRun.of(r, vehicle, rig) for r in runs])
    return fitted, compare(fitted, fitted.runs[0])


_fits: dict[tuple[tuple[str, ...], str], tuple[Fit, Comparison]] = {}


def fitted_plain(runs: tuple[str, ...], at: str) -> tuple[Fit, Comparison]:
    """Runs in which nothing is hidden, fitted once for all families that share them."""
    if (runs, at) not in _fits:
        _fits[runs, at] = _fitted([driven(run, (), at) for run in runs], at)
    return _fits[runs, at]


def signature(family: str) -> Signature:
    """The signature of a family's case."""
    case = CASES[family]
    return _kept(f"signature-{family}", case.digest + _of(reference(family)), lambda: _signature(family, case))


def _signature(family: str, case: Case) -> Signature:
    at = reference(family)
    if case.effects:
        beside = () if case.only_there else case.effects
        hidden = {case.beside: beside, case.run: case.effects}
        fitted, part = _fitted([driven(run, hidden[run], at) for run in case.runs], at)
    else:
        fitted, part = fitted_plain(case.runs, at)
    left = {row: part.residual(row) for row in map(Row.parse, part.measured) if fnmatch(row, case.rows)}
    if case.how == "share":
        drive, known = fitted.runs[0], fitted.model.physics
        own = [effect.name == family for effect in known for _ in effect.parameters]
        left = {row: series + drive.matrix(known, row) @ (fitted.physics * own) for row, series in left.items()}
    elif case.how == "law":
        added = _left_of_law(fitted, case)
        left = {row: series + added.get(row, 0.0) for row, series in left.items()}
    ratio = {row: float(np.mean(series**2)) / part.scores[row].floor ** 2 for row, series in left.items()}
    row = max(ratio, key=lambda one: ratio[one])
    drive, score = fitted.runs[0], part.scores[row]
    state = state_of(drive.motion, row, case.state)
    against = drive.decimated({row: state.series})[row]
    return Signature(
        row, score.unit, score.floor, part.t[row], left[row] / score.floor, state.name, state.unit, against
    )


def state_of(motion: Motion, row: Row, name: str) -> State:
    """A state by name. Raises KeyError with those there are."""
    if name in FURTHER:
        return FURTHER[name](motion, row)
    known = states_of(motion, row)
    if name not in known:
        raise KeyError(f"{row} has no state '{name}': {', '.join(known)}")
    return known[name]


def _left_of_law(fitted: Fit, case: Case) -> dict[str, Array]:
    """What the base model leaves of a law of the catalogue that it lacks, on the first run: row → (n,).

    The law's force joins what was measured; the model, fitted again with the same weights, takes what part of it can.
    """
    vehicle, rig = car(Rig.load(RIG).wheel_reference)
    effect = catalogue(vehicle, rig.wheel_reference)[case.hidden]
    effect = replace(effect, shape={**effect.shape, **case.shape})
    pieces: list[tuple[int, str, Array, Array]] = []
    for number, run in enumerate(fitted.runs):
        force = {row: case.size * columns.sum(axis=0) for row, columns in run.effect_columns(effect, None).items()}
        pieces += [
            (number, row, run.matrix(fitted.model.physics, row), force.get(row, np.zeros(len(run.index[row]))))
            for row in run.rows
        ]
    matrix = np.concatenate([W / fitted.sigma[row] for _, row, W, _ in pieces])
    right = np.concatenate([y / fitted.sigma[row] for _, row, _, y in pieces])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    x = np.linalg.lstsq(matrix / size, right, rcond=1e-9)[0] / size
    return {row: y - W @ x for number, row, W, y in pieces if number == 0}
