"""What is computed for a study is kept in it: used again while it holds, made anew when it does not."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lacet.services.workspace.kept.kept_values
import lacet.services.workspace.kept.study_runs
from lacet.daq.formats.exchange import write_table
from lacet.identify.effects.base import Effect
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.cache.records import to_record
from lacet.services.workspace.kept import run_records
from lacet.services.workspace.kept.kept_values import VERSIONS_AT_HAND
from lacet.services.workspace.kept.study_cache import StudyCache
from lacet.services.workspace.kept.study_runs import StudyRuns
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
    """How often a fit is made, a floor and the noise in columns simulated."""
    count = {"fit": 0, "floor": 0, "noise": 0}
    of = RegressorNoise.of

    def floor(*args: Any, **more: Any) -> NoiseFloor:
        count["floor"] += 1
        return floor_of(*args, **more)

    def noise(*args: Any, **more: Any) -> RegressorNoise:
        count["noise"] += 1
        return of(*args, **more)

    def fitted(*args: Any, **more: Any) -> Fit:
        count["fit"] += 1
        return fit_once(*args, **more)

    monkeypatch.setattr(lacet.services.workspace.kept.kept_values, "floor_of", floor)
    monkeypatch.setattr(lacet.services.workspace.kept.kept_values, "fit", fitted)
    monkeypatch.setattr(RegressorNoise, "of", noise)
    monkeypatch.setattr("lacet.identify.selection.columns.regressor_noise.pairs_drawn", lambda _: 1)
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


# Noise in the columns: of the first ranking, of formulas and beside their description.
ONCE = {"fit": 1, "floor": 1, "noise": 3}
TWICE = {name: 2 * count for name, count in ONCE.items()}


def test_a_second_diagnosis_computes_nothing_and_is_the_same(folder: Path, calls: dict[str, int]):
    first = diagnosed(folder)
    assert calls == ONCE
    assert diagnosed(folder) == first
    assert calls == ONCE


def kept(folder: Path) -> dict[str, list[Path]]:
    """Files of cached values by kind."""
    out: dict[str, list[Path]] = {}
    for file in sorted((folder / ".cache").glob("*.zip")):
        out.setdefault(file.name.partition("-")[0], []).append(file)
    return out


def test_each_value_is_made_anew_alone(folder: Path, calls: dict[str, int]):
    first = diagnosed(folder)
    assert set(kept(folder)) == {"fit", "floor", "noise", "ranking", "runs"}
    for file in kept(folder)["ranking"]:
        file.unlink()
    assert diagnosed(folder) == first
    assert calls == {**ONCE, "noise": 5}, "the ranking alone, and what its further fits need"
    for name, after in (("noise", {"fit": 1, "floor": 1, "noise": 8}), ("floor", {"fit": 1, "floor": 2, "noise": 10})):
        for one in (*kept(folder)[name], *kept(folder)["ranking"]):
            one.write_bytes(one.read_bytes()[:-40])  # damaged counts as gone
        assert diagnosed(folder) == first
        assert calls == after


def test_a_folder_that_cannot_be_written_to_costs_only_time(folder: Path, calls: dict[str, int]):
    (folder / ".cache").write_text("a file where the folder should be")
    first = diagnosed(folder)
    assert diagnosed(folder) == first
    assert calls == TWICE


def test_a_fit_read_again_is_the_fit(folder: Path, calls: dict[str, int]):
    version = Study.open(folder).version()
    first, again = (Session(Study.open(folder)).values.fitted(version) for _ in range(2))
    assert calls["fit"] == 1
    np.testing.assert_array_equal(again.theta, first.theta)
    np.testing.assert_array_equal(again.covariance, first.covariance)
    np.testing.assert_array_equal(again.bootstrap(20), first.bootstrap(20))
    assert again.sheet_entries == first.sheet_entries
    for piece, other in zip(again.assembly.pieces(), first.assembly.pieces(), strict=True):
        for row in piece.blocks:
            np.testing.assert_array_equal(piece.blocks[row], other.blocks[row])


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


def own_effect(text: str) -> Callable[[Path], None]:
    """An effect of the user's, or another one."""

    def change(folder: Path) -> None:
        (folder / "effects" / "lines.txt").write_text(text, encoding="utf-8")

    return change


def keys(folder: Path, version: Version | None = None) -> tuple[str, str, str]:
    """Keys of a fit, a noise floor and a ranking of a version."""
    study = Study.open(folder)
    of, cache = version or study.version(), StudyCache(study)
    return (
        cache.key("regression", of, "hub"), cache.key("validation", of, "hub", study.draws),
        cache.key("selection", of, "hub", study.draws, catalogue=True),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "same"),
    [
        (edited("rig.toml", '"laser.hub" = 0.0003', '"laser.hub" = 0.0004'), (False, False, False)),
        (edited("vehicle.toml", "0.316", "0.317"), (False, False, False)),
        (edited("study.json", '"fit_cutoff": 6.0', '"fit_cutoff": 5.0'), (False, False, False)),
        (edited("study.json", f'"draws": {DRAWS}', '"draws": 29'), (True, False, False)),
        (other_run, (False, False, False)),
        (own_effect("mine = suspension: c * travel**3\n"), (True, True, False)),
    ],
)  # fmt: skip
def test_what_a_value_is_made_of_is_in_its_key(folder: Path, change: Callable[[Path], None], same: tuple[bool, ...]):
    before = keys(folder)
    assert keys(folder, replace(Study.open(folder).version(), note="another note")) == before
    change(folder)
    assert tuple(a == b for a, b in zip(keys(folder), before, strict=True)) == same


def test_a_model_has_its_own_keys_and_a_moved_study_keeps_them(folder: Path):
    before = keys(folder)
    more = Version(2, {"coulomb.rear": {"v0": 0.01}}, "")
    other = Version(2, {"coulomb.rear": {"v0": 0.02}}, "")
    assert len({before, keys(folder, more), keys(folder, other)}) == 3
    moved = shutil.move(folder.parent, folder.parent.with_name("elsewhere")) / "study"
    assert keys(moved) == before


def test_an_effect_of_the_user_in_the_model_is_in_its_key_with_its_law(folder: Path):
    own_effect("mine = suspension: c * travel**3\nother = suspension: c * travel**2 * sign(travel)\n")(folder)
    version = Version(2, {"mine.front": {}}, "")
    before = keys(folder, version)
    own_effect("mine = suspension: c * travel**3\n")(folder)
    assert [a == b for a, b in zip(keys(folder, version), before, strict=True)] == [True, True, False]
    own_effect("mine = suspension: c * travel**5\n")(folder)
    assert not set(keys(folder, version)) & set(before)


def test_a_session_holds_few_versions_and_reads_the_others_again(folder: Path, calls: dict[str, int]):
    session = Session(Study.open(folder))
    version = session.study.version()
    versions = [replace(version, number=number) for number in range(1, 5)]
    first = [session.values.fitted(one).theta for one in versions]
    assert calls["fit"] == 1
    assert len(session.values._fits) == VERSIONS_AT_HAND
    for one, theta in zip(versions, first, strict=True):
        np.testing.assert_array_equal(session.values.fitted(one).theta, theta)
    assert calls["fit"] == 1, "read, not fitted again"


def test_notes_on_how_runs_were_read_are_kept_and_those_of_runs_held_out_join_them(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    runs = StudyRuns(Study.open(folder))
    loaded = runs.loaded
    noted = replace(loaded, notes=("one: a flat road",), warnings=("one: a doubt",))
    again = run_records.restored_runs(run_records.runs_record(noted), loaded.rig, loaded.vehicle)
    assert (again.notes, again.warnings) == (noted.notes, noted.warnings)
    other = replace(noted, notes=("two: a flat road",), warnings=("one: a doubt", "two: a doubt"))
    of = {"used": noted, "held out": other}
    monkeypatch.setattr(StudyRuns, "_kept", lambda self, kind: of.get(kind, noted))
    joined = StudyRuns(replace(Study.open(folder), held=Study.open(folder).used))
    assert joined.held == other.prepared
    assert joined.loaded.notes == ("one: a flat road", "two: a flat road")
    assert joined.loaded.warnings == ("one: a doubt", "two: a doubt")


def test_runs_kept_in_the_study_are_the_runs_to_the_last_bit(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """They are read anew when the rig says something else, and where they are too long to be kept."""
    reading = lacet.services.workspace.kept.study_runs
    read, count = reading.load, []
    monkeypatch.setattr(reading, "load", lambda *args: (count.append(1), read(*args))[1])
    first, again = (StudyRuns(Study.open(folder)).loaded for _ in range(2))
    assert len(count) == 1
    assert (again.vehicle, again.rig, again.warnings, again.sheet, again.notes) == (
        first.vehicle, first.rig, first.warnings, first.sheet, first.notes,
    )  # fmt: skip
    for one, other in zip(again.prepared, first.prepared, strict=True):
        assert one.recording.rig == other.recording.rig
        kept, made = (
            to_record(vars(replace(drive.recording, rig=replace(first.rig, folder=None)))) for drive in (one, other)
        )
        assert kept.tree == made.tree
        for array, expected in zip(kept.arrays, made.arrays, strict=True):
            np.testing.assert_array_equal(array, expected)
    rig = folder / "rig.toml"
    rig.write_text(rig.read_text(encoding="utf-8") + "\n# another\n", encoding="utf-8")
    monkeypatch.setattr(run_records, "LONGEST", 1.0)
    for _ in range(2):
        assert StudyRuns(Study.open(folder)).loaded.rig.sensors == first.rig.sensors
    assert len(count) == 3
