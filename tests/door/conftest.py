"""Short runs of the reference car, where the examples of docstrings and README look for the long ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import lacet
from tests.identify.cars import CAR, RUNS, piece
from tests.support.tables import written

SECONDS = 9.0


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like the checkout to an example: ``tests/data/car`` with runs of some seconds."""
    folder = tmp_path_factory.mktemp("checkout")
    car = folder / "tests" / "data" / "car"
    car.mkdir(parents=True)
    for name in ("rig.toml", "vehicle.toml"):
        shutil.copy(CAR / name, car)
    shutil.copytree(CAR.parent / "symoro", folder / "tests" / "data" / "symoro")
    for name in RUNS:
        written(piece(name, 4.0, 4.0 + SECONDS), car / f"{name}.parquet")
    return folder


@pytest.fixture(scope="session")
def runs(checkout: Path) -> lacet.Runs:
    """Two of them, loaded."""
    car = checkout / "tests" / "data" / "car"
    files = [car / f"{name}.parquet" for name in ("sine", "liftoff")]
    return lacet.load_runs(*files, rig=car / "rig.toml", vehicle=car / "vehicle.toml")


@pytest.fixture(scope="session")
def fitted(runs: lacet.Runs) -> lacet.Fit:
    """The base model on them."""
    return lacet.fit(lacet.base_model(runs), runs)


@pytest.fixture(scope="session")
def ranking(fitted: lacet.Fit) -> lacet.Ranking:
    """Three of the catalogue, ranked on it: the car has both bars."""
    known = lacet.catalogue(fitted.runs)
    tried = [known[key] for key in ("anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.rear")]
    return lacet.rank(fitted, tried, draws=19)
