"""The reference car, made once for all tests that need it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import settings

from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from tests.identify import cars

# The same examples in every run of `make test` and CI; `make test-slow` draws new ones (--hypothesis-profile=fresh).
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("fresh", derandomize=False, deadline=None, print_blob=True)
settings.load_profile("repeatable")

VEHICLE, RIG = cars.reference_car()


@pytest.fixture(scope="session")
def drives() -> dict[str, PreparedRun]:
    """The four runs, brought together once."""
    return {name: PreparedRun.of(open_run(cars.CAR / f"{name}.parquet"), VEHICLE, RIG) for name in cars.RUNS}


@pytest.fixture(scope="session")
def models() -> dict[str, Model]:
    """The base model, and the model with both bars."""
    known = catalogue(VEHICLE, "hub")
    base = Model.of(effect for effect in known.values() if effect.base)
    return {"base": base, "bars": base + known["anti_roll_bar.front"] + known["anti_roll_bar.rear"]}


@pytest.fixture(scope="session")
def fitted(drives: dict[str, PreparedRun], models: dict[str, Model]) -> Fit:
    """Both bars in the model, all four runs."""
    return fit(models["bars"], list(drives.values()))


@pytest.fixture(scope="session")
def truth() -> dict[str, Any]:
    """What the car is made of."""
    return json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def sine_only(drives: dict[str, PreparedRun], models: dict[str, Model]) -> Fit:
    """Both bars in the model, sinus steering alone: pitch is hardly excited."""
    return fit(models["bars"], [drives["sine"]])
