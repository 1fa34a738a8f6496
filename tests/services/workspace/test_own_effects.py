"""A study's own effects: one-line effects from the command line to the ranking and back; files that are not right."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.language.compiled import effect_class
from lacet.identify.effects.language.parser import read_line
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.commands.__main__ import main
from lacet.services.commands.effect import DESCRIPTION
from lacet.services.workspace.effect_files import load_file
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.commands.test_json import conforms
from tests.services.workbench.conftest import quick
from tests.support.candidates import few_candidates
from tests.support.places import HOME
from tests.support.tables import FILES, piece, without, written

BUMP = "bump = suspension: p * travel**2 * sign(rate/v0)*tanh(abs(rate)/v0), v0 = 0.01 0.02 m/s  # an odd bump"
RESULT = {"rows": {"used": {}, "held": {}}, "parameters": []}


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    """A study of ten seconds, its base model not fitted."""
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)
    run = written(piece(), tmp_path / "run.parquet")
    return Study.create(tmp_path / "study", [run], [], Rig.load(FILES[1]), Vehicle.load(FILES[3]), draws=19)


def effect(study: Study, *words: str) -> int:
    """``lacet effect`` on the study."""
    return main(["effect", str(study.folder), *words])


def test_a_line_is_kept_ranked_added_and_read_again(study: Study, monkeypatch: pytest.MonkeyPatch):
    """From the command line to a version, reopened with its law and its constants; a bar ranks as the catalogue's."""
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.fit", quick)
    few_candidates(monkeypatch, "bump", "mybar", "anti_roll_bar")
    assert effect(study, BUMP) == 0
    assert effect(study, "mybar = suspension: k * (travel - travel_other)") == 0
    own = {f"bump.{w}" for w in ("front", "rear", "fl", "fr", "rl", "rr")} | {"mybar.front", "mybar.rear"}
    assert own <= set(study.effects("hub"))
    session = Session(study)
    session.record({}, "base model")
    by_key = {c.key: c for c in session.diagnose().candidates}
    assert own <= set(by_key)
    for axle in ("front", "rear"):
        mine, known = by_key[f"mybar.{axle}"], by_key[f"anti_roll_bar.{axle}"]
        assert (mine.drop, mine.gain) == pytest.approx((known.drop, known.gain), rel=1e-9)
        # Sizes differ: that of one which is found is from a fit with all found, the other's from its test alone.
    version = session.add("bump.front", {"v0": 0.02})
    again = Study.open(study.folder)
    model = again.model(again.version(), "hub")
    found = next(e for e in model.effects if e.key == "bump.front")
    assert dict(found.shape) == {"v0": 0.02}
    names = {p["name"] for part in ("parameters", "not_identifiable") for p in version.result[part]}
    assert "bump.front.p" in names
    # What a version says must not change afterwards.
    assert effect(study, BUMP.replace("travel**2", "travel**3")) == 2
    assert effect(study, "--remove", "bump") == 2
    assert effect(study, BUMP) == 0
    assert effect(study, "--remove", "mybar") == 0
    assert "mybar.front" not in again.effects("hub")


def test_the_command_says_how_a_line_was_read(study: Study, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """Rows, variants, parameters with units, constants; replaced, listed, taken out; every JSON as documented."""
    file = tmp_path / "result.json"

    def run(*words: str) -> dict[str, Any]:
        assert effect(study, *words, "--json", str(file)) == 0
        return conforms(file, "effect")

    made = run(BUMP)
    out = capsys.readouterr().out
    for part in ("row suspension [N]", "parameter p [N/m²]", "constant v0 [m/s], tried: 0.01, 0.02", "lacet diagnose"):
        assert part in out
    assert made["kept"]
    assert {(p["name"], p["unit"]) for p in made["parameters"]} == {("p", "N/m²")}
    assert all(t["acts_on"] and not t["why_not"] for t in made["tried"])
    tried = run("--try", "suspension.front: p * abs(rate)")
    assert (tried["effect"], tried["kept"]) == ("own1", False)
    assert [one["effect"] for one in run()["lines"]] == ["bump"]
    run("suspension.front: p * abs(rate)")
    run("suspension.rear: p * abs(rate)")
    assert [one["effect"] for one in run()["lines"]] == ["bump", "own1", "own2"]
    run("bump = tyre: p * deflection**3")
    assert "Replaced" in capsys.readouterr().out
    lines = {one["effect"]: one["line"] for one in run()["lines"]}
    assert lines["bump"] == "bump = tyre: p * deflection**3"
    assert run("--remove", "bump")["removed"] == "bump"
    assert set(study.effects("hub")) & {"bump.front"} == set()
    assert main(["effect", "--states", "--json", str(file)]) == 0
    states = conforms(file, "effect")
    assert {"travel", "speed"} <= {s["name"] for s in states["all_states"]}


@pytest.mark.parametrize(("line", "says"), [
    ("x = suspension: p * travell", "did you mean 'travel'"),
    ("x = suspension: p * travle", "Is 'travle' the state 'travel'?"),
    ("spring = suspension: p * travel", "there is another effect 'spring'"),
    ("x = suspension: p * log(travel/1 m)", "no finite value in suspension.fl at t = "),
])  # fmt: skip
def test_a_line_that_cannot_be_used_is_not_kept(study: Study, capsys: pytest.CaptureFixture[str], line: str, says: str):
    assert effect(study, line) == 2
    assert says in capsys.readouterr().err
    assert not (study.folder / "effects" / "lines.txt").exists()


def test_a_law_whose_channel_is_missing_is_said_not_to_be_testable(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run = written(without(piece(), "correvit"), tmp_path / "run.parquet")
    study = Study.create(tmp_path / "study", [run], [], Rig.load(FILES[1]), Vehicle.load(FILES[3]))
    assert effect(study, "x = chassis.fx: d * speed**2") == 0
    assert "x cannot be tested (correvit.speed not measured" in capsys.readouterr().out


def test_a_line_changed_by_hand_is_read_or_named(study: Study):
    """The file is the user's; a fault in it has its place."""
    file = study.folder / "effects" / "lines.txt"
    file.write_text("# mine\nx = suspension: p * travel**2 # a\n", encoding="utf-8")
    assert "x.rl" in study.effects("hub")
    for text, says in (
        ("x = suspension: p * tavel", r"lines\.txt, line 1: there is no state 'tavel'"),
        ("anti_roll_bar = suspension: p * travel**2", r"lines\.txt: there is another effect 'anti_roll_bar'"),
        ("x = suspension: p*max(0, travel - 9 m)", r"lines\.txt: no plausible size of p"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(UsageError, match=says):
            study.effects("hub")
    file.write_bytes(b"x = \xff")
    with pytest.raises(UsageError, match=r"lines\.txt"):
        study.effects("hub")


# ---- Python files

OWN = """
from __future__ import annotations
from dataclasses import dataclass
import numpy as np
from lacet import SuspensionForce, Effect

@dataclass(frozen=True)
class Mine(SuspensionForce):
    name = "mine"
    about = signature = shown_by = source = "a test"

    @property
    def parameters(self):
        return (self.named("k", "N", -1.0, 1.0),)

    def law(self, travel, rate):
        return np.sign(rate)
"""


@pytest.fixture(scope="module")
def drive() -> PreparedRun:
    """Some seconds brought together once."""
    return PreparedRun.of(piece(), Vehicle.load(FILES[3]), Rig.load(FILES[1]))


def columns_of(study: Study, drive: PreparedRun) -> None:
    """The user's effect on a run."""
    PreparedRun(drive.recording).matrix([study.effects("hub")["mine.front"]], "suspension.fl")


@pytest.mark.parametrize(("old", "new", "says"), [
    ("np.sign(rate)", "np.sgn(rate)", r"mine\.py: Mine\.columns fails: line 17: AttributeError"),
    ("np.sign(rate)", "np.sign(rate)[:-1]", r"mine\.py: Mine\.columns: suspension\.fl has shape \(1, \d+\), expected"),
    ("np.sign(rate)", "np.log(rate)", r"mine\.py: Mine\.columns: suspension\.fl has no finite value at t = "),
    ("def law", "def columns(self, motion): return []\n    def law", r"Mine\.columns must give a dictionary"),
    ("def law", "def columns(self, motion): return {'axle.fl': 1}\n    def law", r"there is no row 'axle\.fl'"),
    ("def law", "def columns(self, motion): return {'tyre.fl': 'x'}\n    def law", r"Mine\.columns of tyre\.fl fails"),
    ("def law", "def low", r"mine\.py: Mine must also define law"),
    ("= shown_by", "= unknown", r"mine\.py: Mine must say its shown_by"),
    ('(self.named("k", "N", -1.0, 1.0),)', "()", r"Mine\.parameters must be one Parameter or more"),
    ('(self.named("k", "N", -1.0, 1.0),)', "1/0", r"Mine\.parameters fails: line 14: ZeroDivisionError"),
    ("-1.0, 1.0", "1.0, 1.0", r"mine\.front\.k needs finite bounds"),
])  # fmt: skip
def test_a_users_file_that_is_not_right_is_named(study: Study, drive: PreparedRun, old: str, new: str, says: str):
    file = study.folder / "effects" / "mine.py"
    file.write_text(OWN, encoding="utf-8")
    columns_of(study, drive)
    file.write_text(OWN.replace(old, new), encoding="utf-8")
    with pytest.raises(UsageError, match=says):
        columns_of(study, drive)


def test_the_present_lines_are_plain_text(study: Study):
    """What is stored is what was typed, with a name."""
    assert effect(study, "suspension.front: p * abs(rate)  # both ways") == 0
    stored = (study.folder / "effects" / "lines.txt").read_text(encoding="utf-8").splitlines()
    assert stored[-1] == "own1 = suspension.front: p * abs(rate)  # both ways"
    assert all(line.startswith("#") for line in stored[:-1])
    study.record({"own1.front": {}}, "added", RESULT)
    version = json.loads((study.folder / "versions" / "001.json").read_text(encoding="utf-8"))
    assert version["effects"] == {"own1.front": {}}


def test_the_lines_of_page_and_help_are_laws():
    """Every line shown can be read."""
    page = (HOME / "docs" / "effects.md").read_text(encoding="utf-8")
    for text, least in ((page, 7), (DESCRIPTION, 6)):
        lines = re.findall(r'lacet effect \w+ (?:--try )?"([^"]+)"', text)
        assert len(lines) >= least
        for line in lines:
            assert effect_class(read_line(line)).name


def test_the_pages_first_line_is_read_as_shown(study: Study, capsys: pytest.CaptureFixture[str]):
    page = (HOME / "docs" / "effects.md").read_text(encoding="utf-8")
    line = re.findall(r'lacet effect STUDY "([^"]+)"', page)[0]
    (shown,) = re.findall(r"^```\n(bump:.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert effect(study, line) == 0
    assert shown.replace("rough.parquet", "run.parquet") in capsys.readouterr().out


def test_the_pages_file_is_an_effect(study: Study, drive: PreparedRun):
    """The class of the page is found in the study, and gives columns."""
    page = (HOME / "docs" / "effects.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (study.folder / "effects" / "bench.py").write_text(code, encoding="utf-8")
    found = study.effects("hub")["bench_curve.front"].shapes()
    assert len(found) == 3
    for one in found:
        PreparedRun(drive.recording).columns(one)


def test_an_edit_within_the_same_second_is_seen(tmp_path: Path) -> None:
    """Python's bytecode is kept by a file's second and size, and lacet's reading of effect files must not be."""
    file = tmp_path / "mine.py"
    for value in ("1", "2"):
        file.write_text(f"VALUE = {value}\n", encoding="utf-8")
        os.utime(file, (1e9, 1e9))
        assert vars(load_file(file))["VALUE"] == int(value)
