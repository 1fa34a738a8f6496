"""The reference car, made once for all tests that need it."""

from __future__ import annotations

import gc
import json
import os
import tempfile
from typing import Any, NamedTuple

import pytest
from hypothesis import settings

from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from tests.identify import cars
from tests.support.once import FOLDER, once

# The same examples in every run of `make test` and CI; `make test-slow` draws new ones (--hypothesis-profile=fresh).
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("fresh", derandomize=False, deadline=None, print_blob=True)
settings.load_profile("repeatable")

VEHICLE, RIG = cars.reference_car()


def pytest_configure(config: pytest.Config) -> None:
    """A folder for what the processes of one run share; the first of them makes it and takes it away."""
    if FOLDER not in os.environ:
        shared = tempfile.TemporaryDirectory(prefix="lacet-tests-")
        os.environ[FOLDER] = shared.name
        config.add_cleanup(shared.cleanup)
        config.add_cleanup(lambda: os.environ.pop(FOLDER))


def pytest_collection_finish() -> None:
    """What is loaded by now is not searched whenever a job or a reader collects garbage: 0.35 s each time."""
    gc.freeze()


class ReferenceCar(NamedTuple):
    """The four runs, the base model and the model with both bars, and the latter's fit to them."""

    runs: dict[str, PreparedRun]
    models: dict[str, Model]
    fitted: Fit


def made() -> ReferenceCar:
    """All of it from the tables: 15 s."""
    runs = {name: PreparedRun.of(open_run(cars.CAR / f"{name}.parquet"), VEHICLE, RIG) for name in cars.RUNS}
    known = catalogue(VEHICLE, "hub")
    base = Model.of(effect for effect in known.values() if effect.base)
    bars = base + known["anti_roll_bar.front"] + known["anti_roll_bar.rear"]
    return ReferenceCar(runs, {"base": base, "bars": bars}, fit(bars, list(runs.values())))


@pytest.fixture(scope="session")
def reference_car() -> ReferenceCar:
    """Made once, by whichever process of the run needs it first."""
    return once("reference_car", made)


@pytest.fixture(scope="session")
def drives(reference_car: ReferenceCar) -> dict[str, PreparedRun]:
    """The four runs, brought together once."""
    return reference_car.runs


@pytest.fixture(scope="session")
def models(reference_car: ReferenceCar) -> dict[str, Model]:
    """The base model, and the model with both bars."""
    return reference_car.models


@pytest.fixture(scope="session")
def fitted(reference_car: ReferenceCar) -> Fit:
    """Both bars in the model, all four runs."""
    return reference_car.fitted


@pytest.fixture(scope="session")
def truth() -> dict[str, Any]:
    """What the car is made of."""
    return json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def sine_only(drives: dict[str, PreparedRun], models: dict[str, Model]) -> Fit:
    """Both bars in the model, sinus steering alone: pitch is hardly excited."""
    return fit(models["bars"], [drives["sine"]])
