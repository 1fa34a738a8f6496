"""A study made by an earlier lacet, before its parts became one package, opens, shows and is fitted as it was.

`tests/data/old_study` was written by commit f0e8420: `lacet study new`, `effect`, `diagnose`, `add`; its runs are those
of the reference car. Only what can be made anew is left out of it (``.cache``).
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from lacet.daq.errors import UsageError
from lacet.services.commands.__main__ import main
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workbench.study_views import study_payload
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.support.tables import CAR


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the old study beside the runs it names."""
    shutil.copytree(CAR.parent / "old_study", tmp_path / "old_study")
    (tmp_path / "car").symlink_to(CAR)
    return tmp_path / "old_study"


def test_it_opens_and_its_fit_is_the_same(folder: Path):
    study = Study.open(folder)
    assert [(v.number, v.note, list(v.effects)) for v in study.versions()] == [
        (1, "base model", []),
        (2, "added anti_roll_bar.front", ["anti_roll_bar.front"]),
    ]
    assert (study.diagnosis(1) or {})["best"] == "mybar.front"
    session = Session(study)
    version = study.version()
    fitted = session.values.fitted(version)
    stored = {p["name"]: p for p in version.result["parameters"]}
    bar = "anti_roll_bar.front.k"
    values = dict(zip((q.name for q in fitted.model.parameters), fitted.theta, strict=True))
    # Noise is drawn in another way since, and so is the correction for it.
    assert values[bar] == pytest.approx(stored[bar]["value"], abs=0.25 * stored[bar]["half95"])
    assert "mybar.front" in study.effects("hub")


def test_the_commands_and_the_page_show_it(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["study", str(folder)]) == 0
    assert "added anti_roll_bar.front" in capsys.readouterr().out
    found = study_payload(SessionCache(folder), None)
    assert [v["version"] for v in found["versions"]] == [1, 2]
    rows = found["versions"][0]["rows"]["used"]["sine"]
    assert any(score["fails"] for score in rows.values())


def test_its_effect_files_are_refused_naming_the_new_line(folder: Path):
    mine = folder / "effects" / "mine.py"
    mine.write_text("from identify.effect import SuspensionForce\n", encoding="utf-8")
    with pytest.raises(UsageError, match="Write: from lacet import SuspensionForce"):
        Study.open(folder).effects("hub")
