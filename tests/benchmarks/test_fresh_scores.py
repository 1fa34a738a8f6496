"""The fresh benchmark's scores and page, on results that were made up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import pytest

from benchmarks.fresh import page, running, scoring
from benchmarks.fresh.identifying import Failed, Verdict, read
from benchmarks.fresh.laws import CLASSES


def part(name: str, *families: str, law: str = "", size: float = 10.0, **values: float) -> dict[str, Any]:
    """A hidden part, of a law with these families; `values` : the first family's parameters per unit of size."""
    of_it = {families[0]: values} if families and values else {}
    return {"law": law or name.partition(".")[0], "name": name, "size": size, "shape": {}, "root_lambda": 20.0,
            "families": list(families), "values": of_it, "tolerance": 0.0}  # fmt: skip


def record(
    kind: str, parts: list[dict[str, Any]], *effects: str, unlisted: bool = False, **more: Any
) -> dict[str, Any]:
    """A trial's record with a verdict of these keys."""
    verdict = {"effects": {key: {} for key in effects}, "ties": {}, "parameters": {}, "unlisted": unlisted,
               "rows": ["suspension.fl"] if unlisted else [], "held": {"kerb": {"chassis.fx": 1.1}}, "base": {},
               "steps": [{"verdict": "unlisted cause" if unlisted else "nothing missing", "best": None}],
               "seconds": 100.0, **more}  # fmt: skip
    return {"set": "development", "trial": 3, "class": kind, "sizes": "usual", "measured": [], "parts": parts,
            "code": "abc", "verdict": verdict, "true_held": {"kerb": {"chassis.fx": 1.0}}}  # fmt: skip


FRICTION = [part(f"coulomb.{axle}", "coulomb", f=1.0) for axle in ("front", "rear")]
STOP = part("bump_stop_quadratic.rear", "bump_stop", "helper_spring", k=0.01, size=2e6)
FAULT = part("sensor_gain.hub.fl", "sensor_gain.hub.fl", g=1.0)
DRAG = part("aero_drag", "aero_drag", d=1.0)


@pytest.mark.parametrize(
    ("parts", "said", "ties", "found", "wrong"),
    [
        (FRICTION, ["coulomb.front", "coulomb.rear"], {}, (True, True), ()),
        (FRICTION, ["coulomb.front"], {}, (True, False), ()),
        (FRICTION, ["coulomb.all"], {}, (True, True), ()),
        (FRICTION[:1], ["coulomb.fl", "coulomb.fr"], {}, (True,), ()),
        (FRICTION[:1], ["coulomb.fl"], {}, (False,), ()),
        (FRICTION[:1], ["coulomb.rear"], {}, (False,), ("coulomb.rear",)),
        (FRICTION[:1], ["coulomb.all"], {}, (False,), ("coulomb.all",)),
        (FRICTION[:1], ["damper_saturation.front"], {}, (False,), ("damper_saturation.front",)),
        (FRICTION[:1], ["damper_saturation.front"], {"damper_saturation.front": ["coulomb.front"]}, (True,), ()),
        (  # one name is enough: a second one that is tied with it is too much
            FRICTION[:1], ["damper_saturation.front", "coulomb.front"],
            {"damper_saturation.front": ["coulomb.front"]}, (True,), ("damper_saturation.front",),
        ),
        ([STOP], ["helper_spring.rear"], {}, (True,), ()),
        ([STOP], ["bump_stop.front"], {}, (False,), ("bump_stop.front",)),
        ([FAULT, DRAG], ["aero_drag", "sensor_gain.hub.fl"], {}, (True, True), ()),
        ([FAULT], ["sensor_gain.hub.fr"], {}, (False,), ("sensor_gain.hub.fr",)),
        ([FAULT], ["sensor_gain.force.fl"], {"sensor_gain.force.fl": ["sensor_gain.hub.fl"]}, (True,), ()),
    ],
)  # fmt: skip
def test_a_key_names_what_is_hidden_at_its_wheels(parts, said, ties, found, wrong) -> None:
    result = scoring.score(parts, said, ties)
    assert (result.found, result.wrong) == (found, wrong)


def test_a_trial_is_exact_when_all_is_named_nothing_else_and_the_search_is_over() -> None:
    keys = ("coulomb.front", "coulomb.rear")
    assert scoring.exact(record("single", FRICTION, *keys))
    assert not scoring.exact(record("single", FRICTION, "coulomb.front"))
    assert not scoring.exact(record("single", FRICTION, *keys, "aero_drag"))
    assert not scoring.exact(record("single", FRICTION, *keys, unlisted=True))
    assert not scoring.exact(record("single", FRICTION, *keys, steps=[{"verdict": "missing", "best": "aero_drag"}]))


@pytest.mark.parametrize(
    ("hidden", "alone", "wrong"),
    [
        ("aero_lift.rear", [], ()),
        ("aero_lift.rear", ["aero_lift.front"], ("aero_lift.front",)),
        ("aero_lift.rear", ["aero_lift.rear"], ("aero_lift.front",)),
        ("aero_drag", [], ("aero_lift.front", "aero_lift.rear")),
    ],
)
def test_a_sum_of_laws_is_one_name(hidden: str, alone: list[str], wrong: tuple[str, ...]) -> None:
    """Only what is known alone has parameters of its own."""
    keys, hides = ("aero_lift.front", "aero_lift.rear"), [part(hidden, hidden.partition(".")[0])]
    own = {key: {f"{key}.l": [0.3, 0.1]} for key in alone}
    found = record("single", hides, *keys, parameters=own)
    assert scoring.scored(found).wrong == wrong
    assert scoring.exact(found) == (not wrong)


def test_unlisted_causes_and_nulls() -> None:
    trailer = part("trailer")
    assert scoring.declared(record("unlisted", [trailer], unlisted=True))
    assert not scoring.declared(record("unlisted", [trailer]))
    assert not scoring.declared(record("unlisted", [trailer], "aero_drag", unlisted=True))
    mixed = record("listed+unlisted", [DRAG, trailer], "aero_drag", unlisted=True)
    assert page.right(mixed)
    assert scoring.scored(mixed).found == (True,)
    assert not page.right(record("listed+unlisted", [DRAG, trailer], "aero_drag"))
    assert not scoring.alarm(record("none", []))
    assert scoring.alarm(record("none", [], unlisted=True))
    assert scoring.alarm(record("none", [], "aero_drag"))
    assert scoring.true_model([DRAG, trailer]) is None


def test_intervals_hold_the_true_value_of_the_law_itself_and_of_no_synonym() -> None:
    def told(one: dict[str, Any], key: str, name: str, value: float, half: float) -> list[bool]:
        return scoring.intervals(record("single", [one], key, parameters={key: {f"{key}.{name}": [value, half]}}))

    assert told(STOP, "bump_stop.rear", "k", 2.1e4, 1.1e3) == [True]
    assert told(STOP, "bump_stop.rear", "k", 2.1e4, 0.9e3) == [False]
    assert told(STOP, "helper_spring.rear", "k", 2.1e4, 0.9e3) == []
    assert told(STOP, "bump_stop.front", "k", 2.0e4, 0.9e3) == []
    corner = record("single", FRICTION[:1], "coulomb.fl", "coulomb.fr",
                    parameters={"coulomb.fl": {"coulomb.fl.f": [10.5, 1.0]}})  # fmt: skip
    assert scoring.intervals(corner) == [True]
    fault = {**FAULT, "size": 0.03, "tolerance": 0.002}
    assert told(fault, "sensor_gain.hub.fl", "g", 0.034, 0.001) == [True]  # the sheet's share is in the instrument
    assert told({**fault, "tolerance": 0.0}, "sensor_gain.hub.fl", "g", 0.034, 0.001) == [False]


def test_the_true_model_has_the_catalogues_keys_and_constants() -> None:
    stop = {**STOP, "shape": {"gap": 0.012, "n": 2.0}}
    assert scoring.true_model([stop, FAULT, DRAG]) == {
        "bump_stop.rear": {"gap": 0.012, "n": 2.0}, "sensor_gain.hub.fl": {}, "aero_drag": {},
    }  # fmt: skip
    assert scoring.held_ratio(record("single", [DRAG], "aero_drag")) == pytest.approx(1.1)


def test_goals_are_counted_by_class_and_missed_ones_are_told() -> None:
    keys = ("coulomb.front", "coulomb.rear")
    records = [record("single", FRICTION, *keys) for _ in range(24)]
    records += [record("single", FRICTION, "coulomb.front", "aero_drag")]
    records += [record("none", []) for _ in range(59)]
    lines = {goal.text.partition(" (")[0]: goal.line() for goal in page.goals(records)}
    assert "| 24 of 25, 96.0 | ≥ 82.4 | met |" in lines["single: exactly right"]
    assert "| 49 of 50, 98.0 | ≥ 90.9 | met |" in lines["each effect, at each axle, named"]
    assert "| 49 of 50, 98.0 | ≥ 90.9 | **missed** |" in lines["names that are of something hidden"]
    assert "| 0 of 59, 0.0 | ≤ 5.0 | met |" in lines["nothing hidden: false alarms"]
    assert "not run" in lines["eight: exactly right"]
    few = page.goals([*records, record("none", [], "aero_drag")])
    alarms = next(goal for goal in few if goal.upper).line()
    assert "too few trials to tell" in alarms  # 1 of 60: below 5 %, its bound above


def test_the_page_has_every_class_law_and_failure() -> None:
    good, bad = (
        record("single", FRICTION, "coulomb.front", "coulomb.rear"),
        record("pair", [DRAG, STOP], "aero_lift.rear"),
    )
    broken = {key: value for key, value in record("eight", [DRAG]).items() if key != "verdict"}
    found = {1: good, 2: {**bad, "trial": 2}, 4: {**broken, "trial": 4, "failed": "no rows"}}
    text = page.page({"development": found})
    assert "3 trials, of which 1 failed (4)" in text
    assert "- 2 (pair): not named: aero_drag, bump_stop_quadratic.rear; named and not hidden: aero_lift.rear." in text
    assert "| coulomb | 2 of 2 | 0 of 0 |" in text
    assert text.index("## Test set\n\nNot run.") < text.index("## Development set")


def test_a_development_trial_is_run_for_each_version_of_the_sources_and_a_test_trial_once(tmp_path: Path) -> None:
    file = tmp_path / "trials.jsonl"
    lines = [{"trial": 1, "code": "old"}, {"trial": 2, "code": "new"}]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines) + '{"trial": 3, "co', encoding="utf-8")
    assert running.to_run("development", range(4), file, "new") == [0, 1, 3]
    assert running.to_run("test", range(4), file, "new") == [0, 3]


def test_a_trials_record_is_one_line_and_what_failed_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Trial:
        used: ClassVar = {"kerb": None}
        held: ClassVar = {"kerb": None}

        def truth(self) -> dict[str, Any]:
            return {"set": "development", "trial": 5, "class": "six", "sizes": "usual", "measured": [], "parts": [DRAG]}

    def verdict(folder: Path, study: Path) -> Verdict:
        assert not list(folder.parent.rglob("*truth*"))
        if not file.is_file():
            raise Failed("lacet study ended with 2: no rows")
        held = {"kerb": {"chassis.fx": 1.23456789}}
        return Verdict({"aero_drag": {}}, {}, {}, False, [], held, {}, [{"verdict": "nothing missing"}], 7.0)

    file = tmp_path / "trials.jsonl"
    monkeypatch.setattr(running, "make", lambda name, number: Trial())
    monkeypatch.setattr(running, "write", lambda trial, folder: folder)
    monkeypatch.setattr(running, "diagnosed", verdict)
    monkeypatch.setattr(running, "held_of", lambda folder, study, model: {"kerb": {"chassis.fx": 1.0}})
    assert "failed: lacet study ended with 2" in running.run_trial("development", 5, file, "abc")
    assert "aero_drag → aero_drag (7 s)" in running.run_trial("development", 5, file, "abc")
    first, second = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    assert "no rows" in first["failed"]
    assert second["verdict"]["held"]["kerb"]["chassis.fx"] == 1.23457
    assert scoring.exact(second)
    assert scoring.held_ratio(second) == pytest.approx(1.23457)


def test_what_lacet_wrote_is_read(tmp_path: Path) -> None:
    def version(number: int, effects: dict[str, Any], ratio: float) -> None:
        parameters = [
            {"effect": effect, "name": name, "group": group, "value": value, "half95_sheet": half}
            for effect, name, group, value, half in (
                ("coulomb.front", "coulomb.front.f", "coulomb.front.f", 40.0, 2.0),
                ("coulomb.front", "coulomb.front.g", "coulomb.front.g + coulomb.rear.g", 50.0, 3.0),
                ("spring.fl", "spring.fl.k", "spring.fl.k", 2e4, 9.0),
            )
        ]
        result = {"parameters": parameters, "rows": {"held": {"kerb": {"chassis.fx": {"ratio": ratio}}}}}
        text = json.dumps({"effects": effects, "result": result})
        (tmp_path / "versions" / f"{number:03d}.json").write_text(text, encoding="utf-8")

    (tmp_path / "versions").mkdir()
    (tmp_path / "study.json").write_text('{"current": 2}', encoding="utf-8")
    version(1, {}, 3.0)
    version(2, {"coulomb.front": {"v0": 0.01}}, 1.5)
    ties = [{"effect": "damper_saturation.front"}]
    steps = [
        {"verdict": "missing", "found": ["coulomb.front"], "best": "coulomb.front", "explained": 0.9, "failing": [],
         "candidates": [{"effect": "coulomb.front", "ties": ties}, {"effect": "aero_drag", "ties": []}]},
        {"verdict": "unlisted cause", "found": [], "best": None, "explained": 0.1, "unlisted": True,
         "unlisted_rows": ["tyre.fl"], "candidates": []},
    ]  # fmt: skip
    found = read(tmp_path, {**steps[-1], "steps": steps})
    assert found.effects == {"coulomb.front": {"v0": 0.01}}
    assert found.ties == {"coulomb.front": ["damper_saturation.front"]}
    assert found.parameters == {"coulomb.front": {"coulomb.front.f": (40.0, 2.0)}}
    assert (found.unlisted, found.rows) == (True, ["tyre.fl"])
    assert (found.held["kerb"]["chassis.fx"], found.base["kerb"]["chassis.fx"]) == (1.5, 3.0)


def test_every_class_has_a_goal() -> None:
    assert {*page.EXACT, "none", "unlisted", "listed+unlisted"} == set(CLASSES)
