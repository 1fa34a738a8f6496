"""``lacet info --model``: the tree, the parameters, and what structure and runs can tell."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.identify.effects.catalogue import base_model
from lacet.identify.properties.structural_identifiability import car_tree, structure
from lacet.services.commands.__main__ import main
from lacet.services.render.identifiability import joint_position
from lacet.services.workspace.study import Study
from tests.identify import cars
from tests.services.commands.test_json import conforms
from tests.support.places import HOME
from tests.support.tables import CAR, FILES, piece, written


def told(tmp_path: Path, *argv: object) -> tuple[int, dict[str, Any]]:
    """Exit code and the result, which is as documented."""
    file = tmp_path / "result.json"
    code = main(["info", "--model", *map(str, argv), "--json", str(file)])
    return code, conforms(file, "info")["model"]


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_a_vehicle_alone(tmp_path: Path, reference: str, capsys: pytest.CaptureFixture[str]) -> None:
    """42 joints, every parameter once, lines of at most 120 characters, groups that name what is counted elsewhere."""
    code, model = told(tmp_path, CAR / "vehicle.toml", "--reference", reference)
    assert code == 0
    assert [joint["number"] for joint in model["tree"]] == list(range(1, 43))
    assert {j["body"] for j in model["tree"]} - {""} == {
        "chassis", *(f"{kind} {c}" for kind in ("axle", "wheel") for c in ("fl", "fr", "rl", "rr"))
    }  # fmt: skip
    states = [p["in_principle"] for p in model["parameters"]]
    assert model["base_rank"] == sum(state != "no" for state in states)
    assert {p["with_runs"] for p in model["parameters"]} == {None}
    for p in model["parameters"]:
        assert bool(p["group"]) == (p["in_principle"] != "no")
        assert bool(p["why"]) == (p["in_principle"] == "no")
    groups = " ".join(p["group"] for p in model["parameters"])
    for p in model["parameters"]:
        if p["in_principle"] == "no":
            assert re.search(rf"\b{p['name']}\b", groups), p
    assert any(p["name"].startswith("outboard_mass") for p in model["parameters"]) == (reference == "hub")
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 120
    assert "No value of their own, whatever the runs:" in text
    assert "Not with these runs" not in text


def test_runs_tell_less_than_the_structure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is told by runs that the structure forbids; what they leave open has a reason with a remedy."""
    run = written(piece("sine", 5.0, 12.0), tmp_path / "run.parquet")
    code, model = told(tmp_path, run, *FILES)
    assert code == 0
    assert model["runs"] == ["run"]
    by_name = {p["name"]: p for p in model["parameters"]}
    assert by_name["spring.fl.k"]["with_runs"] == "alone"
    assert all(p["with_runs"] == "no" for p in model["parameters"] if p["in_principle"] == "no")
    lacking = [p for p in model["parameters"] if p["in_principle"] != "no" and p["with_runs"] == "no"]
    assert lacking
    assert all(p["why"] for p in lacking)
    text = capsys.readouterr().out
    assert "Not with these runs:" in text
    assert max(map(len, text.splitlines())) <= 120


def test_a_study_shows_its_present_version(tmp_path: Path) -> None:
    """With the effects that were added, on the study's own runs."""
    run = written(piece("sine", 5.0, 12.0), tmp_path / "run.parquet")
    study = tmp_path / "study"
    vehicle, rig = cars.reference_car()
    made = Study.create(study, [run], [], rig, vehicle)
    assert main(["info", "--model", str(study)]) == 2  # no version yet
    made.record({"anti_roll_bar.front": {}}, "the front bar", {})
    code, model = told(tmp_path, study)
    assert code == 0
    assert "anti_roll_bar.front" in model["effects"]
    assert any(p["effect"] == "anti_roll_bar.front" for p in model["parameters"])
    assert main(["info", "--model", str(study), str(run)]) == 2


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (("nowhere.toml",), "nowhere.toml"),
        ((CAR / "vehicle.toml", "--vehicle", "peugeot-406"), "two vehicles"),
        ((CAR / "sine.parquet", *FILES, "--reference", "contact"), "the runs have hub wheel loads"),
        ((CAR,), "is no study"),
    ],
)
def test_what_cannot_be_told(argv: tuple[object, ...], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A clear error and exit code 2."""
    assert main(["info", "--model", *map(str, argv)]) == 2
    assert says in capsys.readouterr().err


def test_one_file_without_model(capsys: pytest.CaptureFixture[str]) -> None:
    """Several files are for --model only."""
    assert main(["info", str(CAR / "rig.toml"), str(CAR / "vehicle.toml")]) == 2
    assert "--model" in capsys.readouterr().err


def test_structure_follows_the_vehicle() -> None:
    """Bench tables, driven wheels and brakes change what joints follow, the rows formed and the groups."""
    plain, _ = cars.reference_car()
    tabled = cars.with_tables(plain)
    follows = {j.number: joint_position(j.follows) for j in car_tree(tabled)}
    assert "bench table half_track" in follows[7]
    assert "bench table pitch" in follows[12]
    assert follows[10] == "camera.rl.steer (slope: bench table toe)"
    effects = base_model(tabled, "contact")
    free, braked = structure(tabled, "contact", effects), structure(tabled, "contact", effects, brakes="on")
    assert {f"spin.{c}" for c in ("fl", "fr", "rl", "rr")} <= set(free.rows)
    assert {f"spin.{c}" for c in ("fl", "fr", "rl", "rr")} <= set(braked.left_out)
    assert structure(plain, "contact", base_model(plain, "contact")).left_out.keys() == {"spin.fl", "spin.fr"}
    assert free.base.gap > 1e6
    again = structure(tabled, "contact", effects, seed=3)
    np.testing.assert_array_equal(free.base.independent, again.base.independent)
    np.testing.assert_allclose(free.base.relations, again.base.relations, atol=1e-8)


def test_examples_of_the_page_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/chain.md: every Python block."""
    monkeypatch.chdir(HOME)
    page = (HOME / "docs" / "chain.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(examples) == 5
    for example in examples:
        exec(compile(example, "docs/chain.md", "exec"), {})
