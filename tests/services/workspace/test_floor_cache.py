"""What a ranking simulates is kept in the study: used again while it holds, made anew when it does not."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lacet.services.workspace.session
from lacet.daq.formats.exchange import write_table
from lacet.identify.effects.base import Effect
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.regressor_noise import RegressorNoise
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.workspace.floor_cache import KEPT, floor_key, load_floor, load_noise, save_floor
from lacet.services.workspace.results import diagnosis_result
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study, Version
from tests.identify import cars

TRIED = ("anti_roll_bar.front", "coulomb.rear", "sensor_gain.hub.fl")
DRAWS = 19
_all_effects = Study.effects
_fits: list[Fit] = []


def few(study: Study, reference: str) -> dict[str, Effect]:
    """The base model and three candidates."""
    return {key: e for key, e in _all_effects(study, reference).items() if e.base or key in TRIED}


def fit_once(model: Model, drives: tuple[PreparedRun, ...], **_: Any) -> Fit:
    """Every study here has the same run and model: they are fitted once."""
    if not _fits:
        _fits.append(fit(model, drives, FitOptions(unbias=False)))
    return _fits[0]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How often a floor, and noise in columns, are simulated."""
    count = {"floor": 0, "noise": 0}
    of = RegressorNoise.of

    def floor(*args: Any, **more: Any) -> NoiseFloor:
        count["floor"] += 1
        return floor_of(*args, **more)

    def noise(*args: Any, **more: Any) -> RegressorNoise:
        count["noise"] += 1
        return of(*args, pairs=1, **more)

    monkeypatch.setattr(lacet.services.workspace.session, "floor_of", floor)
    monkeypatch.setattr(lacet.services.workspace.session, "fit", fit_once)
    monkeypatch.setattr(RegressorNoise, "of", noise)
    monkeypatch.setattr(Study, "effects", few)
    return count


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run and a study of it, never diagnosed."""
    folder = tmp_path_factory.mktemp("kept")
    write_table(cars.piece("rough", 0.0, 8.0), folder / "run.parquet")
    vehicle, rig = cars.reference_car()
    Study.create(folder / "study", [folder / "run.parquet"], [], rig, vehicle, draws=DRAWS).record({}, "base", {})
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(made, tmp_path / "copy") / "study"


def diagnosed(folder: Path) -> str:
    """The diagnosis of a fresh start, as JSON text."""
    return json.dumps(diagnosis_result(Session(Study.open(folder)).diagnose()), sort_keys=True)


def test_a_second_diagnosis_simulates_nothing_and_is_the_same(folder: Path, calls: dict[str, int]):
    first = diagnosed(folder)
    assert calls == {"floor": 1, "noise": 1}
    assert diagnosed(folder) == first
    assert calls == {"floor": 1, "noise": 1}
    assert (folder / ".cache" / ".gitignore").read_text() == "*\n"
    # Other candidates: the floor is used again, what was found of their columns is not.
    shutil.rmtree(folder / "diagnoses")
    (folder / "diagnoses").mkdir()
    study = Study.open(folder)
    key = floor_key(study, study.version())
    kept = load_noise(study, key)
    assert kept is not None
    np.savez(folder / ".cache" / f"noise-{key}.npz", **replace(kept, labels=("others", *kept.labels[1:])).arrays())
    assert diagnosed(folder) == first
    assert calls == {"floor": 1, "noise": 2}


def test_files_cut_off_are_made_anew(folder: Path, calls: dict[str, int]):
    first = diagnosed(folder)
    study = Study.open(folder)
    key = floor_key(study, study.version())
    whole = {file: file.read_bytes() for file in (folder / ".cache").glob("*.npz")}
    assert len(whole) == 2
    for part in (0.0, 0.0001, 0.003, 0.999, 0.5):
        for file, content in whole.items():
            file.write_bytes(content[: int(part * len(content))])
        assert load_floor(study, key) is None
        assert load_noise(study, key) is None
    for file, content in whole.items():
        damaged, middle = bytearray(content), len(content) // 2
        damaged[middle : middle + 64] = bytes(255 - b for b in content[middle : middle + 64])
        file.write_bytes(damaged)
        assert load_floor(study, key) is None or "floor" not in file.name
    assert load_noise(study, key) is None
    assert diagnosed(folder) == first
    assert calls == {"floor": 2, "noise": 2}


def test_a_folder_that_cannot_be_written_to_costs_only_time(folder: Path, calls: dict[str, int]):
    (folder / ".cache").write_text("a file where the folder should be")
    first = diagnosed(folder)
    assert diagnosed(folder) == first
    assert calls == {"floor": 2, "noise": 2}


def test_a_full_disk_leaves_nothing_half_written(folder: Path, calls: dict[str, int], monkeypatch: pytest.MonkeyPatch):
    def full(file: Path, **arrays: Any) -> None:
        Path(file).write_bytes(b"PK\x03\x04")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", full)
        first = diagnosed(folder)
    study = Study.open(folder)
    key = floor_key(study, study.version())
    assert load_floor(study, key) is None
    assert load_noise(study, key) is None
    assert diagnosed(folder) == first
    assert calls == {"floor": 2, "noise": 2}


def test_a_floor_is_read_as_it_was_used(folder: Path):
    study = Study.open(folder)
    rng = np.random.default_rng(0)
    draws = tuple({row: 20.0 * rng.standard_normal((4, 30)) for row in ("tyre.fl", "spin.rl")} for _ in range(3))
    used = save_floor(study, "some", NoiseFloor.of(draws))
    read = load_floor(study, "some")
    assert read is not None
    assert read.sigma == used.sigma
    assert read.by_run == used.by_run
    for a, b, c in zip(read.draws, used.draws, draws, strict=True):
        for row in a:
            np.testing.assert_array_equal(a[row], b[row])
            np.testing.assert_allclose(a[row], c[row], rtol=1e-6)
    for number in range(2 * KEPT):
        save_floor(study, f"{number:02d}", NoiseFloor.of(draws))
    assert len(list((folder / ".cache").glob("floor-*.npz"))) == KEPT
    assert load_floor(study, f"{2 * KEPT - 1:02d}") is not None


def edited(name: str, old: str, new: str) -> Callable[[Path], None]:
    """A change of a file's text."""

    def change(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def other_run(folder: Path) -> None:
    """Another second of the run under the same name."""
    write_table(cars.piece("rough", 0.0, 7.0), folder.parent / "run.parquet")


def own_effect(folder: Path) -> None:
    """An effect of the user's."""
    (folder / "effects" / "mine.py").write_text("# nothing yet\n", encoding="utf-8")


@pytest.mark.parametrize(
    "change",
    [
        edited("rig.toml", '"laser.hub" = 0.0003', '"laser.hub" = 0.0004'),
        edited("vehicle.toml", "0.316", "0.317"),
        edited("study.json", '"fit_cutoff": 6.0', '"fit_cutoff": 5.0'),
        edited("study.json", f'"draws": {DRAWS}', '"draws": 29'),
        other_run,
        own_effect,
    ],
)
def test_whatever_it_was_made_from_is_in_its_name(folder: Path, change: Callable[[Path], None]):
    study = Study.open(folder)
    before = floor_key(study, study.version())
    assert floor_key(study, replace(study.version(), note="another note")) == before
    change(folder)
    study = Study.open(folder)
    assert floor_key(study, study.version()) != before


def test_a_model_has_its_own_floor_and_a_moved_study_keeps_it(folder: Path):
    study = Study.open(folder)
    before = floor_key(study, study.version())
    more = Version(2, {"coulomb.rear": {"v0": 0.01}}, "")
    other = Version(2, {"coulomb.rear": {"v0": 0.02}}, "")
    assert len({before, floor_key(study, more), floor_key(study, other)}) == 3
    moved = shutil.move(folder.parent, folder.parent.with_name("elsewhere")) / "study"
    assert floor_key(Study.open(moved), Study.open(moved).version()) == before
