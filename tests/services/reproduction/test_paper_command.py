"""``lacet paper`` from end to end, with short runs; the tables at their full length by ``pytest -m slow``."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from lacet.services.commands.__main__ import main
from lacet.services.one_thread import one_thread
from lacet.services.progress import ServiceStage, ServiceStep, planned
from lacet.services.reproduction.campaigns import (
    PAPER,
    Places,
    campaigns_of,
    experiment,
    identify,
    reproduction_plan,
    simulation,
)
from lacet.services.timing.job_time import JobTime
from lacet.simulate import engine
from lacet.simulate.known_cars import known_car
from lacet.simulate.linkage import SECOND_CARS
from lacet.simulate.manoeuvres import make_manoeuvre
from lacet.simulate.road import FLAT
from tests.services.commands.test_json import conforms


def paper(out: Path, *words: str) -> tuple[int, dict[str, Any]]:
    """The command's exit code and result."""
    file = out.with_suffix(".json")
    code = main(["paper", "--out", str(out), *words, "--json", str(file)])
    return code, conforms(file, "paper")


def test_tables_1_to_4_from_short_runs_and_what_is_there_is_used_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("lacet.services.commands.paper.QUICK", 5.0)
    monkeypatch.setattr("lacet.services.reproduction.campaigns.SCORE_DRAWS", 3)
    words = ("--tables", "simulation", "--quick")
    code, told = paper(tmp_path / "out", *words)
    printed = capsys.readouterr().out
    (campaign,) = told["campaigns"]
    lines = {line["parameter"]: line for line in campaign["lines"]}
    assert code == (3 if campaign["failed"] else 0)
    assert len(lines) == 30
    for name in (
        "XX6",
        "YY6",
        "ZZ6",
        "X_G",
        "Y_G",
        "Z_G",
        "ks9",
        "ks36",
        "hs9",
        "hs36",
        "ZZ14",
        "ZZ23",
        "ks15",
        "ks42",
    ):
        assert lines[name]["verdict"] == "met", lines[name]
        assert abs(lines[name]["error"]) <= 0.02 * abs(lines[name]["truth"]) + 0.5, lines[name]
    for name in ("ZZ32", "ZZ41"):
        assert lines[name]["verdict"] == "not identifiable"
        assert lines[name]["remark"].startswith("the drive torque of this wheel is not measured")
    assert "Table 4: the tyres, simulation" in printed
    assert "-51.72" in printed
    # what a fit may know holds nothing of what was put in
    folder = tmp_path / "out" / "simulation"
    assert {file.name for file in folder.iterdir()} == {
        "sinus.parquet", "liftoff.parquet", "spiral.parquet", "rig.toml", "vehicle.toml", "fit.json", "validation.html",
    }  # fmt: skip
    assert b"stiffness" not in (folder / "vehicle.toml").read_bytes()
    # every row of the runs used beside the same of the one held out
    fitted = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    (held,) = {key.partition(":")[0] for key in fitted["rows"]["held"]}
    assert held == "spiral"
    drawn = (folder / "validation.html").read_text(encoding="utf-8")
    for title in ("sinus and spiral", "liftoff and spiral"):
        assert title in drawn
    assert drawn.count("suspension.rl [N]") == 4
    # the fit made again without the truth in reach is the same
    monkeypatch.setattr("lacet.services.reproduction.campaigns.drive", None)
    first = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    (folder / "fit.json").unlink()
    hidden_away = shutil.move(tmp_path / "out" / "truth", tmp_path / "elsewhere")
    campaign_again = simulation().shortened(5.0)
    with one_thread():  # as the command line has it
        again = identify(campaign_again, Places.of(tmp_path / "out", campaign_again), lambda text: None)
    assert again == first
    shutil.move(hidden_away, tmp_path / "out" / "truth")
    # finished steps are kept: nothing is driven or fitted
    monkeypatch.setattr("lacet.services.reproduction.campaigns.fit", None)
    assert paper(tmp_path / "out", *words)[1]["campaigns"] == told["campaigns"]


def test_tables_5_to_7_from_short_runs_over_the_wires(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lacet.services.commands.paper.QUICK", 3.0)
    monkeypatch.setattr("lacet.services.reproduction.campaigns.SCORE_DRAWS", 3)
    _, told = paper(tmp_path / "out", "--tables", "experiment", "--quick")
    (campaign,) = told["campaigns"]
    assert len(campaign["lines"]) == 29
    assert all(line["estimate"] is not None for line in campaign["lines"])
    drawn = (tmp_path / "out" / "experiment" / "validation.html").read_text(encoding="utf-8")
    assert all(title in drawn for title in ("sinus and liftoff", "spiral and liftoff"))


def test_the_experiment_hides_what_table_6_adds_and_fits_the_same_effects() -> None:
    campaign = experiment()
    assert {(h.name, h.size) for h in campaign.hidden} == {
        ("coulomb.rl", 19.80), ("coulomb.rr", 44.91), ("coulomb.fl", 32.94), ("coulomb.fr", 50.35),
        ("anti_roll_bar.front", 18394.90), ("anti_roll_bar.rear", 24785.43),
    }  # fmt: skip
    assert set(campaign.effects) == {h.name for h in campaign.hidden}
    assert campaign.wires


@pytest.mark.parametrize("car", [PAPER, *SECOND_CARS])
def test_every_run_of_both_campaigns_can_be_driven_and_the_experiments_are_on_a_road(car: str) -> None:
    """The run held out, too."""
    for campaign in campaigns_of(car):
        for name, settings in campaign.driven:
            road = make_manoeuvre(name, **settings).road(known_car(campaign.car), 1, 1.0)
            assert (road is FLAT) == (campaign.name == "simulation")


def test_the_run_held_out_is_read_in_its_own_campaigns_time(tmp_path: Path) -> None:
    """The second campaign's driving is still ahead."""
    now = [0.0]
    time = JobTime(lambda: now[0])
    both = [
        one for campaign in campaigns_of(PAPER) for one in reproduction_plan(campaign, Places.of(tmp_path, campaign))
    ]
    time.step(planned(both))
    first = reproduction_plan(simulation(), Places.of(tmp_path, simulation()))
    driven = [one for one in first if one.stage in (ServiceStage.DRIVING, ServiceStage.MEASURING)]
    stages = (ServiceStage.READING_RUN, ServiceStage.FITTING, ServiceStage.READING_RUN, ServiceStage.COMPARING)
    for stage, subject in [*((one.stage, one.subject) for one in driven), *((stage, "") for stage in stages)]:
        time.step(ServiceStep(stage, subject=subject))
        now[0] += 1.0
    left = time.estimate()
    assert left is not None
    assert left.share < 0.6, "the minutes of the experiment"


def test_a_folder_that_is_not_ours_or_of_other_runs_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["paper", "--out", str(tmp_path)]) == 2
    assert "--out" in capsys.readouterr().err
    other = tmp_path / "other"
    other.mkdir()
    (other / ".lacet-paper").write_text('{"seed": 1, "quick": true}')
    assert main(["paper", "--out", str(other), "--seed", "2"]) == 2
    told = capsys.readouterr().err
    assert "seed 1 and --quick" in told
    assert "--force" in told


def test_without_mujoco_the_remedy_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there = engine.importlib.import_module

    def missing(name: str, package: str | None = None) -> ModuleType:
        if name == "mujoco":
            raise ImportError(name)
        return there(name, package)

    monkeypatch.setattr(engine.importlib, "import_module", missing)
    assert main(["paper", "--out", str(tmp_path / "out")]) == 2
    assert "lacet[sim]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow  # four minutes
def test_all_tables_at_full_length(tmp_path: Path) -> None:
    _, told = paper(tmp_path / "out")
    simulated, measured = told["campaigns"]
    assert not simulated["failed"], simulated["says"]
    assert len(measured["lines"]) == 29
    assert [line["parameter"] for line in measured["lines"] if line["verdict"] == "not identifiable"] == []
