"""The study folder: text files that keep every version, move with their runs, and take a user's own effects."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.signals.filters import Filters
from lacet.services.commands.__main__ import main
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.workbench.conftest import quick
from tests.support.candidates import few_candidates
from tests.support.tables import CAR, FILES, piece, written

RESULT = {"rows": {"used": {}, "held": {}}, "parameters": []}
OWN = '''\
"""A user's own effect."""
from __future__ import annotations
from typing import ClassVar
import numpy as np
from lacet import SuspensionForce

class RollStop(SuspensionForce):
    """A force with the cube of travel, as nobody else has it."""
    name: ClassVar = "roll_stop"
    about: ClassVar = "a cubic force"
    signature: ClassVar = "follows the cube of travel"
    shown_by: ClassVar = "large roll"
    source: ClassVar = "this test"

    @property
    def parameters(self):
        return (self.named("k", "N/m³", 0.0, 5e6, "positive"),)

    def law(self, travel, rate):
        return travel**3
'''


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study of files that need not be runs yet."""
    rig, vehicle = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "a.parquet").touch()
    (runs / "b.parquet").touch()
    filters = Filters(fit_cutoff=4.0)
    return Study.create(
        tmp_path / "deep" / "study", [runs / "a.parquet"], [runs / "b.parquet"], rig, vehicle, filters, 39
    )


def test_what_is_written_is_read(study: Study):
    assert Study.open(study.folder) == study
    after = study.record({"bump_stop.front": {"gap": 0.02}}, "added", RESULT)
    again = Study.open(study.folder)
    assert again == after
    assert (again.filters.fit_cutoff, again.draws, again.current) == (4.0, 39, 1)
    version = again.version()
    assert (version.number, version.note, version.parent) == (1, "added", 0)
    assert version.effects == {"bump_stop.front": {"gap": 0.02}}
    assert version.result == RESULT
    assert (again.rig.text, again.vehicle.text) == (study.rig.text, study.vehicle.text)
    model = again.model(version, "hub")
    assert dict(next(e for e in model.effects if e.key == "bump_stop.front").shape) == {"gap": 0.02}


def test_whoever_reads_the_descriptions_while_a_study_is_made_reads_whole_ones(tmp_path: Path):
    """As the page does, whose study may lie in the folder of the files given to it."""
    rig, vehicle = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
    names = ("rig.toml", "vehicle.toml")
    for name in names:
        (tmp_path / name).write_text("# earlier\n" + (CAR / name).read_text(encoding="utf-8"), encoding="utf-8")
    before = [(tmp_path / name).open(encoding="utf-8") for name in names]
    Study.create(tmp_path, [tmp_path / "a.parquet"], [], rig, vehicle)
    for name, file in zip(names, before, strict=True):
        with file:
            assert file.read() == "# earlier\n" + (CAR / name).read_text(encoding="utf-8")
        assert (tmp_path / name).read_text(encoding="utf-8") == (CAR / name).read_text(encoding="utf-8")
    assert sorted(p.name for p in tmp_path.glob("*.tmp")) == []


def test_versions_are_never_overwritten_and_undo_goes_to_the_parent(study: Study, capsys: pytest.CaptureFixture[str]):
    one = study.record({}, "base", RESULT)
    two = one.record({"anti_roll_bar.front": {}}, "added", RESULT)
    kept = {file.name: file.read_bytes() for file in (study.folder / "versions").iterdir()}
    back = two.go_to(1)
    three = back.record({"anti_roll_bar.rear": {}}, "another way", RESULT)
    assert [v.number for v in three.versions()] == [1, 2, 3]
    assert [v.parent for v in three.versions()] == [0, 1, 1]
    for name, content in kept.items():
        assert (study.folder / "versions" / name).read_bytes() == content
    assert main(["undo", str(study.folder)]) == 0
    assert Study.open(study.folder).current == 1
    printed = capsys.readouterr().out
    assert "another way (from 1)" in printed  # the table of versions: not made from the one above it
    assert "added (from" not in printed
    assert len(Study.open(study.folder).versions()) == 3


def test_a_version_made_from_what_is_no_longer_present_is_refused(study: Study):
    first = study.record({}, "base", RESULT)
    first.record({"anti_roll_bar.front": {}}, "the other writer", RESULT)
    with pytest.raises(UsageError, match="another lacet went from version 1 to 2"):
        first.record({"anti_roll_bar.rear": {}}, "too late", RESULT)
    assert len(Study.open(study.folder).versions()) == 2
    assert not (study.folder / ".writing").exists()


def test_a_diagnosis_belongs_to_its_version(study: Study):
    one = study.record({}, "base", RESULT)
    assert one.diagnosis() is None
    one.record_diagnosis({"verdict": "missing", "best": "x"})
    two = one.record({}, "again", RESULT)
    assert two.diagnosis() is None
    found = two.go_to(1).diagnosis()
    assert found is not None
    assert found["best"] == "x"


def test_a_diagnosis_is_not_lost_for_a_folder_that_was_removed(study: Study):
    one = study.record({}, "base", RESULT)
    (study.folder / "diagnoses").rmdir()
    one.record_diagnosis({"verdict": "nothing missing"})
    assert (one.diagnosis() or {})["verdict"] == "nothing missing"


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"version": "x"}'])
def test_a_broken_version_file_is_named(study: Study, content: str):
    study = study.record({}, "base", RESULT)
    (study.folder / "versions" / "001.json").write_text(content, encoding="utf-8")
    with pytest.raises(UsageError, match=r"001\.json cannot be read"):
        study.version()


def test_folder_and_runs_move_together(study: Study, tmp_path: Path):
    study.record({}, "base", RESULT)
    stored = json.loads((study.folder / "study.json").read_text(encoding="utf-8"))
    assert not any(Path(name).is_absolute() for name in stored["used"] + stored["held"])
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.move(tmp_path / "runs", elsewhere / "runs")
    shutil.move(tmp_path / "deep", elsewhere / "deep")
    moved = Study.open(elsewhere / "deep" / "study")
    assert [path.resolve() for path in moved.paths()] == [(elsewhere / "runs" / "a.parquet").resolve()]
    assert [path.resolve() for path in moved.paths(held=True)] == [(elsewhere / "runs" / "b.parquet").resolve()]


@pytest.mark.parametrize(("text", "says"), [
    ("def broken(:", "mine.py: cannot be loaded: SyntaxError"),
    ("import nothing_of_this_name", "mine.py: cannot be loaded: ModuleNotFoundError"),
    (OWN.replace('"roll_stop"', '"anti_roll_bar"'), "two effects are called 'anti_roll_bar'"),
])  # fmt: skip
def test_a_broken_effect_file_is_named_with_its_fault(study: Study, text: str, says: str):
    (study.folder / "effects" / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=says):
        study.effects("hub")


def test_a_users_own_effect_is_found_ranked_added_and_taken_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.fit", quick)
    few_candidates(monkeypatch, "roll_stop", "anti_roll_bar")
    run = written(piece(), tmp_path / "run.parquet")
    folder = tmp_path / "study"
    assert main(["study", "new", str(folder), "--use", str(run), *FILES, "--draws", "19"]) == 0
    (folder / "effects" / "mine.py").write_text(OWN, encoding="utf-8")
    own = {"roll_stop.front", "roll_stop.rear", *(f"roll_stop.{c}" for c in ("fl", "fr", "rl", "rr"))}
    assert own <= set(Study.open(folder).effects("hub"))
    session = Session(Study.open(folder))
    assert own <= {c.key for c in session.diagnose().candidates}
    version = session.add("roll_stop.front")
    assert list(version.effects) == ["roll_stop.front"]
    names = {p["name"] for part in ("parameters", "not_identifiable") for p in version.result[part]}
    assert "roll_stop.front.k" in names
    assert session.remove("roll_stop.front").effects == {}
    with pytest.raises(UsageError, match="was not added"):
        session.remove("roll_stop.front")
    as_one = {"effects": ["roll_stop.front", "roll_stop.rear"]}
    session.study.record_diagnosis({"candidates": [{"effect": "roll_stop.front", "shape": {}, "sum": as_one}]})
    assert list(session.add("roll_stop.front").effects) == as_one["effects"]
