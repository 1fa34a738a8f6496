"""A small study behind the workbench's server: ten seconds of the reference car, three candidates, few draws."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import lacet.services.workspace.kept.kept_values
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.services.workbench.server import Settings, create_app
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.workbench.bench_page import Page
from tests.support.once import folder_once
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
    return fit(model, drives, FitOptions(unbias=False), **more)


def make_small(patch: pytest.MonkeyPatch) -> None:
    """Fits without the noise's bias, few candidates, few draws behind a score's floor."""
    patch.setattr(lacet.services.workspace.kept.kept_values, "fit", quick)
    patch.setattr(lacet.services.workspace.kept.kept_values, "SCORE_DRAWS", 3)
    patch.setattr(Study, "effects", few)


@pytest.fixture(scope="session", autouse=True)
def own_token(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The user's token of these tests is not that of whoever runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything here is small."""
    make_small(monkeypatch)


def study_of(folder: Path, seconds: float) -> Path:
    """A study with its base model on runs of some seconds, and a run nobody uses."""
    runs = folder / "runs"
    runs.mkdir(parents=True)
    for name, (run, start) in {"sine": ("sine", 5.0), "rough": ("rough", 4.0), "spare": ("liftoff", 3.0)}.items():
        written(piece(run, start, start + seconds), runs / f"{name}.parquet")
    rig, vehicle = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
    study = Study.create(folder, [runs / "sine.parquet"], [runs / "rough.parquet"], rig, vehicle, draws=DRAWS)
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        Session(study).record({}, "base model")
    return folder


def six_seconds() -> Path:
    """A study whose runs are six seconds long, made once; to be copied, not changed."""
    return folder_once("six_seconds", lambda folder: study_of(folder / "car", 6.0)) / "car"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study whose runs are six seconds long."""
    return Path(shutil.copytree(six_seconds(), tmp_path_factory.mktemp("study") / "car"))


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
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A server whose study tests only look at: compared, looked into and ranked, on runs long enough for spectra."""
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        folder = study_of(tmp_path_factory.mktemp("shared") / "car", 10.0)
        with TestClient(create_app(Settings(folder, draws=DRAWS)), base_url="http://127.0.0.1:8765") as client:
            found = Page(client)
            for job in ("where", "diagnose"):
                found.run(job)
            yield found
