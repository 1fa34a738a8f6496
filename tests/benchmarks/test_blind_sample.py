"""A small sample of the blind benchmark: two drives, a trial each, and what the page makes of them.

The full one is ``make blind``; here the runs are short and the sizes what a car has, so that each verdict is clear.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.blind import identifying, making, page, scoring
from benchmarks.blind.__main__ import append, results
from benchmarks.blind.cases import SINGLES, Campaign, Cell, cells
from lacet.identify.effects.catalogue import catalogue
from tests.identify import cars

pytest.importorskip("mujoco")
SHORT = Campaign(used=("sinus", "rough"), held=("liftoff",), duration=4.0)
DRAWS = {"null": 199, "bar": 39}
"""As many as a study has, where nothing may be named: from 39, a candidate's mean by chance is known to a quarter."""


def _single(key: str, size: float) -> Cell:
    part = SINGLES[key]
    return Cell(f"{key}/sample", "single", "large", 2, (part,), (part.of_size(size),), (100.0,), campaign=SHORT)


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """A null and a bar, one trial each."""
    build = tmp_path_factory.mktemp("blind")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(making, "BUILD", build)
        chosen = {
            "null": Cell("null/sample", "null", "ordinary noise", 1, campaign=SHORT),
            "bar": _single("anti_roll_bar.front", 19780.0),
        }
        # The bar's noise floor is shared, as that of most trials is.
        return {
            name: scoring.trial(cell, seed, build, DRAWS[name]) for seed, (name, cell) in enumerate(chosen.items(), 1)
        }


@pytest.mark.slow  # two trials, a minute
def test_nothing_is_named_when_nothing_is_missing(records: dict[str, dict]) -> None:
    assert not page.alarm(records["null"]), records["null"]["steps"]


@pytest.mark.slow  # two trials, a minute
def test_a_bar_is_named_and_its_stiffness_held(records: dict[str, dict]) -> None:
    record = records["bar"]
    assert page.hit(record), record["steps"]
    assert page.inside(record, (SINGLES["anti_roll_bar.front"],))
    assert record["held"]["found"] < 0.5 * record["held"]["base"]
    assert page.held_right(record)


def test_what_is_given_away_does_not_tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "BUILD", tmp_path / "build")
    cell = replace(_single("sensor_gain.hub.fl", 0.06), campaign=replace(SHORT, duration=2.0))
    folder = making.write_trial(tmp_path / "trial", cell, 1)
    for file in folder.rglob("*"):
        if file.is_file():
            data = file.read_bytes()
            assert b"sensor_gain" not in data, file
            assert b"hidden" not in data, file
    source = (Path(scoring.__file__).with_name("identifying.py")).read_text(encoding="utf-8")
    assert "simulate import" not in source
    assert "benchmarks" not in source


def test_shapes_are_those_of_the_grid_at_a_reference_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle, _ = cars.reference_car()
    known = SimpleNamespace(known=catalogue(vehicle, "hub"))
    monkeypatch.setattr(identifying, "tables", lambda _: known)
    grid = known.known["coulomb.front"].grids["v0"]
    added = (("anti_roll_bar.front", ()), ("coulomb.front", (("v0", grid[1] + 0.3 * (grid[2] - grid[1])),)))
    here, there = Path("a"), Path("b")
    assert identifying.at_reference(here, here, added) == added
    assert identifying.at_reference(here, there, added) == (added[0], ("coulomb.front", (("v0", grid[1]),)))


@pytest.mark.slow  # two trials, a minute
def test_trials_with_a_floor_of_their_own_are_counted_apart(records: dict[str, dict]) -> None:
    assert records["bar"]["shared"]
    assert not records["null"]["shared"]
    assert page.sharing([records["bar"]]) == ""
    lost = {**records["bar"], "seed": 1, "shared": False, "steps": [{**records["bar"]["steps"][0], "best": None}]}
    assert "in 0 of 1 with a floor of their own and in 1 of 1 that share one" in page.sharing(
        [records["bar"], lost, records["null"]]
    )


def test_words_do_not_make_other_code() -> None:
    plain = "def f(x):\n    return x + 1\n\nclass A:\n    pass\n"
    said = '"""A module."""\n\ndef f(x):\n    """One more."""\n    return x + 1  # so\n\nclass A:\n    """Empty."""\n'
    assert making.without_words(said) == making.without_words(plain)
    assert making.without_words(said.replace("+ 1", "+ 2")) != making.without_words(plain)


def test_a_run_that_was_cut_off_goes_on(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    append(file, {"code": "a", "cell": "x/just", "seed": 1})
    append(file, {"code": "b", "cell": "x/just", "seed": 2})
    with file.open("a", encoding="utf-8") as out:
        out.write(json.dumps({"code": "a", "cell": "x/just", "seed": 3})[:-9])
    append(file, {"code": "a", "cell": "x/just", "seed": 4})
    assert set(results(file, "a")) == {("x/just", 1), ("x/just", 4)}
    assert set(results(file, "any")) == {("x/just", 1), ("x/just", 2), ("x/just", 4)}


def test_bounds_are_clopper_and_pearsons() -> None:
    low, high = page.bounds(0, 59)
    assert low == 0.0
    assert high == pytest.approx(1.0 - 0.05 ** (1.0 / 59.0))
    assert page.bounds(59, 59) == (pytest.approx(0.05 ** (1.0 / 59.0)), 1.0)


def _record(cell: str, kind: str, keys: list[str], *steps: tuple[str | None, list[str], str]) -> dict:
    told = [{"best": best, "ties": ties, "verdict": verdict, "candidates": []} for best, ties, verdict in steps]
    return {"cell": cell, "kind": kind, "band": "just", "seed": 1, "keys": keys, "steps": told}


def test_hits_are_counted_as_said() -> None:
    assert page.hit(_record("a/just", "single", ["a"], ("b", ["a"], "missing")))
    assert not page.hit(_record("a/just", "single", ["a"], ("b", [], "missing"), ("a", [], "missing")))
    assert not page.hit(_record("a/just", "single", ["a"], (None, [], "nothing missing")))
    pair = ["a", "b"]
    assert page.both(_record("a+b/just", "pair", pair, ("b", [], "missing"), ("a", [], "missing")))
    assert not page.both(_record("a+b/just", "pair", pair, ("b", ["a"], "missing"), ("c", [], "missing")))
    cause = _record("c/large", "unlisted", [], ("a", [], "missing"), (None, [], "unlisted cause"))
    assert page.unlisted(cause)
    assert not page.declared(cause)


def test_an_alarm_is_whatever_is_told_where_nothing_is_missing() -> None:
    assert page.alarm(_record("n.0", "null", [], ("a", [], "missing")))
    assert page.alarm(_record("n.0", "null", [], (None, [], "unlisted cause")))
    assert not page.alarm(_record("n.0", "null", [], (None, [], "nothing missing")))


def test_the_table_counts_what_is_wanted() -> None:
    found = cells()
    singles = {c.name.rpartition("/")[0] for c in found.values() if c.kind == "single"}
    assert len(singles) >= 20
    assert sum(c.seeds for c in found.values() if c.kind == "null") >= 300
    assert len({c.name.rpartition("/")[0] for c in found.values() if c.kind == "pair"}) == 6
    assert len({c.name.rpartition("/")[0] for c in found.values() if c.kind == "unlisted"}) == 5
    assert "0 of" in page.page({})
