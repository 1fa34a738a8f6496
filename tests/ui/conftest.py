"""A small study behind the workbench's server: ten seconds of the reference car, three candidates, few draws."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bench_page import Page
from fastapi.testclient import TestClient

import services.fitting
from daq.rig import Rig
from daq.vehicle import Vehicle
from identify.effect import Effect
from identify.fit import Fit, fit
from identify.study import Study
from services.fitting import Work
from services.ui.server import Settings, create_app
from tests.support.tables import CAR, piece, written

TRIED = ("anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.rear")
DRAWS = 19
_all_effects = Study.effects


def few(study: Study, reference: str) -> dict[str, Effect]:
    """The base model, three candidates, and the study's own lines."""
    return {
        key: e for key, e in _all_effects(study, reference).items()
        if e.base or key in TRIED or key.startswith("bump.")
    }  # fmt: skip


def quick(model: Any, drives: Any, **more: Any) -> Fit:
    """A fit without taking out the bias of noise, which costs most of its time."""
    return fit(model, drives, **{**more, "unbias": False})


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits without the noise's bias, few candidates."""
    monkeypatch.setattr(services.fitting, "fit", quick)
    monkeypatch.setattr(services.fitting, "FLOOR_DRAWS", 3)
    monkeypatch.setattr(Study, "effects", few)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with its base model, and a run nobody uses."""
    folder = tmp_path_factory.mktemp("study") / "car"
    runs = folder / "runs"
    runs.mkdir(parents=True)
    for name, run in {"sine": ("sine", 5.0), "rough": ("rough", 4.0), "spare": ("liftoff", 3.0)}.items():
        written(piece(run[0], run[1], run[1] + 10.0), runs / f"{name}.parquet")
    patch = pytest.MonkeyPatch()
    patch.setattr(services.fitting, "fit", quick)
    patch.setattr(services.fitting, "FLOOR_DRAWS", 3)
    patch.setattr(Study, "effects", few)
    rig, vehicle = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
    study = Study.create(folder, [runs / "sine.parquet"], [runs / "rough.parquet"], rig, vehicle, draws=DRAWS)
    Work(study).record({}, "base model")
    patch.undo()
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A study of one's own."""
    return Path(shutil.copytree(made, tmp_path / "car"))


@pytest.fixture
def page(folder: Path) -> Iterator[Page]:
    """The server on it, as a page speaks to it."""
    with TestClient(create_app(Settings(folder, draws=DRAWS)), base_url="http://127.0.0.1:8765") as client:
        yield Page(client)


@pytest.fixture(scope="module")
def shared(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A server whose study tests only look at: compared, looked into and ranked."""
    folder = Path(shutil.copytree(made, tmp_path_factory.mktemp("shared") / "car"))
    patch = pytest.MonkeyPatch()
    patch.setattr(services.fitting, "fit", quick)
    patch.setattr(services.fitting, "FLOOR_DRAWS", 3)
    patch.setattr(Study, "effects", few)
    with TestClient(create_app(Settings(folder, draws=DRAWS)), base_url="http://127.0.0.1:8765") as client:
        found = Page(client)
        for job in ("where", "diagnose"):
            found.run(job)
        yield found
    patch.undo()
