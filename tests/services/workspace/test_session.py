"""Search in a study: what is found is added version by version, a law known as a sum over places as one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lacet.daq.formats.exchange import write_table
from lacet.identify.car.rows import Row
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.selection.candidate import Candidate
from lacet.services.workspace.kept.kept_values import KeptValues
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study, Version
from tests.identify import cars


@dataclass(frozen=True)
class Ranking:
    """What of a ranking is its version's."""

    ratios: Mapping[Row, float]


BARS = ("anti_roll_bar.rear", "anti_roll_bar.front")
TYRE = Row.parse("tyre.fl")
NO_ROWS: dict[str, Any] = {"rows": {"used": {}, "held": {}}}


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study of a short run with a base model."""
    write_table(cars.piece("rough", 0.0, 4.0), tmp_path / "run.parquet")
    vehicle, rig = cars.reference_car()
    return Study.create(tmp_path / "study", [tmp_path / "run.parquet"], [], rig, vehicle).record({}, "base", NO_ROWS)


def test_places_known_as_a_sum_are_one_step_of_the_search(study: Study, monkeypatch: pytest.MonkeyPatch):
    """Beside one of them the others would help no row, and the search would say: undo it."""
    total = SumOfPlaces(BARS, "k", "N/m", 20000.0, 400.0, 9000.0, inseparable=True)
    bars = [Candidate(key, {}, total=total) for key in BARS]
    found = (bars[0], Candidate("coulomb.front", {"v0": 0.01}), bars[1])
    first = SimpleNamespace(found=found, best=found[0])
    last = SimpleNamespace(found=(), best=None)
    monkeypatch.setattr(Session, "_diagnose", lambda self: last if self.study.version().effects else first)

    def record(self: Session, effects: Mapping[str, Mapping[str, float]], note: str) -> Version:
        self.study = self.study.record(effects, note, NO_ROWS)
        return self.study.version()

    monkeypatch.setattr(Session, "record", record)
    session = Session(study)
    session.add_missing()
    assert [(list(v.effects), v.note) for v in session.study.versions()[1:]] == [
        (list(BARS), "added anti_roll_bar.rear and anti_roll_bar.front"),
        ([*BARS, "coulomb.front"], "added coulomb.front"),
    ]
    assert session.study.version().effects["coulomb.front"] == {"v0": 0.01}


def test_a_ranking_has_the_error_of_its_version(study: Study, monkeypatch: pytest.MonkeyPatch):
    """Also where it was made on runs whose latencies are removed: one number, one meaning."""
    score = {"rms": 30.0, "floor": 10.0, "ratio": 3.0, "n": 100}
    result: dict[str, Any] = {"rows": {"used": {"run": {str(TYRE): score}}, "held": {}}}
    monkeypatch.setattr(KeptValues, "_diagnosis", lambda self, version: Ranking({TYRE: 1.01}))
    version = replace(study.version(), result=result)
    assert Session(study).values.diagnosis(version).ratios == {TYRE: 3.0}


def test_a_size_that_a_diagnosis_leaves_open_is_no_number_in_the_versions_made_after_it(
    study: Study, monkeypatch: pytest.MonkeyPatch
):
    """In tables, reports and exports, until a diagnosis names nothing unlisted."""
    parts = [(key, f"{key}.k") for key in BARS]

    def result(self: KeptValues, version: Version) -> dict[str, Any]:
        found = [{"name": name, "effect": key, "value": 9500.0, "half95": 1.0} for key, name in parts]
        derived = [
            {"name": name, "value": 1.0, "identifiable": True, "why": None, "effects": effects}
            for name, effects in (("roll_stiffness.rear", ["spring.rl", BARS[1]]), ("ride_rate.rl", ["spring.rl"]))
        ]
        curves = {"rl": {"effects": ["damper.rl", BARS[1]]}, "fl": {"effects": ["damper.fl"]}}
        return {
            **NO_ROWS, "parameters": [p for p in found if p["effect"] in version.effects], "not_identifiable": [],
            "derived": derived, "damper_curves": curves,
        }  # fmt: skip

    def diagnosed(unlisted: bool, *open_keys: str) -> None:
        session.study.record_diagnosis(
            {"unlisted": unlisted, "candidates": [{"effect": k, "open_at": ["rear"], "shape": {}} for k in open_keys]}
        )

    monkeypatch.setattr(KeptValues, "result", result)
    session = Session(study)
    diagnosed(True, *BARS)
    for key in BARS:
        now = session.record({**session.study.version().effects, key: {}}, "added").result
    assert now["parameters"] == []
    why = "its size is open: the bench table of the rear axle is not known, and something unlisted remains there"
    assert [(p["name"], p["why"]) for p in now["not_identifiable"]] == [(name, why) for _, name in parts]
    of_axle, of_wheel = now["derived"]
    assert (of_axle["identifiable"], of_axle["why"]) == (False, f"the size of {BARS[1]}{why.removeprefix('its size')}")
    assert of_wheel["identifiable"]
    assert list(now["damper_curves"]) == ["fl"]
    diagnosed(True)
    assert session.record(session.study.version().effects, "again").result["parameters"] == []
    diagnosed(False)
    assert len(session.record(session.study.version().effects, "again").result["parameters"]) == 2
