"""``lacet plan``: limits are kept, the planned car is the user's, motions are kept, and what is said is true."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.errors import UsageError
from lacet.daq.toml_reader import Quantity
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import fit
from lacet.services.commands.__main__ import main
from lacet.services.planning.manoeuvre_library import KMH, LOCK, Limits, kinds, library, steering
from lacet.services.planning.nominal_car import known_values, planned_car
from lacet.simulate import MANOEUVRES, find_car
from lacet.simulate.vehicle_file import vehicle_text
from tests.identify import cars
from tests.services.commands.test_json import conforms
from tests.support.foreign_logs import MAP_HEAD, foreign, write_csv
from tests.support.tables import FILES, piece, written

CAR = find_car("peugeot-406")
SHIPPED = ("--vehicle", "peugeot-406", "--rig", "peugeot-406")


@given(
    st.floats(15, 250), st.floats(0.5, 9), st.floats(0.5, 9), st.floats(0.002, 0.1), st.sampled_from("ABC"),
    st.sampled_from(sorted(MANOEUVRES)),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_every_plan_keeps_the_limits(speed: float, lateral: float, braking: float, bump: float, road: str, name: str):
    limits = Limits(speed * KMH, lateral, braking, 30.0, bump, road)
    plans = library(CAR, limits, [name], 12.0)
    assert plans
    assert len({plan.label for plan in plans}) == len(plans)
    for plan in plans:
        made = plan.manoeuvre
        assert made.name == name
        assert made.duration == 12.0
        assert made.speed <= limits.speed * (1 + 1e-12)
        assert getattr(made, "deceleration", 0.0) <= limits.braking
        assert getattr(made, "grade", "A") <= road
        assert getattr(made, "height", 0.0) <= bump
        if plan.lateral:
            most = steering(CAR, limits.lateral, made.speed)
            assert most <= LOCK
            assert abs(made.amplitude) <= most * (1 + 1e-12)  # type: ignore[attr-defined]


def test_steering_is_that_of_a_steady_turn():
    """A neutral car at low speed turns about a circle that the wheelbase and the angle give."""
    neutral = replace(CAR, rear=replace(CAR.rear, cornering=CAR.front.cornering))
    assert 5.0**2 / (CAR.wheelbase / steering(neutral, 1.3, 5.0)) == pytest.approx(1.3)
    assert steering(CAR, 1.3, 30.0) > steering(neutral, 1.3, 30.0)


def test_the_planned_car_is_the_one_that_is_known():
    shipped = planned_car(Vehicle.load("peugeot-406"), known_values(Vehicle.load("peugeot-406"), None, "contact"))
    assert shipped.assumed == ()
    assert [bar.name for bar in shipped.bars] == ["anti_roll_bar.front", "anti_roll_bar.rear"]
    found, true = shipped.car, CAR
    assert found.total.mass == pytest.approx(true.total.mass, rel=0.01)
    assert np.diag(found.total.tensor) == pytest.approx(np.diag(true.total.tensor), rel=0.05)
    assert found.total.com == pytest.approx(true.total.com, abs=0.01)
    for axle in ("front", "rear"):
        for key in ("stiffness", "damping", "track", "tyre_stiffness", "radius", "camber", "caster", "driven"):
            assert getattr(getattr(found, axle), key) == pytest.approx(getattr(getattr(true, axle), key), rel=0.05)
    assert found.static_loads == pytest.approx(true.static_loads, rel=0.02)


@pytest.mark.parametrize("mass", [None, 650.0, 2600.0])
def test_a_car_of_which_little_is_known_can_exist(mass: float | None):
    vehicle = Vehicle.parse(vehicle_text(CAR))
    known = {} if mass is None else {"mass": mass}
    planned = planned_car(vehicle, known)
    assert any(text.startswith("mass") for text in planned.assumed) == (mass is None)
    assert any(text.startswith("spring.f") for text in planned.assumed)
    car = planned.car
    moments = np.linalg.eigvalsh(np.asarray(car.chassis.tensor))
    assert moments[0] > 0.0
    assert moments[0] + moments[1] > moments[2]
    assert np.all(car.offsets > 0.0)
    assert car.total.mass == pytest.approx(mass or 1500.0, rel=0.01)


def test_moments_that_no_body_has_are_not_simulated():
    vehicle = Vehicle.parse(vehicle_text(CAR))
    planned = planned_car(vehicle, {"mass": 1500.0, "Ixx": 3000.0, "Iyy": 800.0, "Izz": 900.0})
    assert any("no possible chassis" in text for text in planned.assumed)
    assert planned.car.total.tensor[1][1] > 1500.0


def test_values_of_the_fit_come_before_those_of_the_file():
    vehicle = Vehicle.parse(vehicle_text(CAR))
    vehicle = replace(vehicle, apriori={"mass": Quantity(1300.0, "kg", "scales")})
    assert known_values(vehicle, None, "contact") == {"mass": 1300.0}
    assert planned_car(vehicle, known_values(vehicle, None, "contact")).car.total.mass == 1300.0


def test_a_car_known_from_hub_loads_is_planned_with_its_wheels():
    """What the file says comes first; else what is outboard of the dynamometers is added to what they carry."""
    vehicle, rig = cars.reference_car()
    truth = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))
    inboard, wheel = truth["inboard_at_design"], truth["wheel_rim_and_tyre"]["mass"]
    runs = [PreparedRun.of(cars.piece(name, 2.0, 16.0), vehicle, rig) for name in ("sine", "rough")]
    effects = catalogue(vehicle, "hub")
    bars = (effects["anti_roll_bar.front"], effects["anti_roll_bar.rear"])
    fitted = fit(Model.of((*(e for e in effects.values() if e.base), *bars)), runs)
    known = known_values(vehicle, fitted, "hub")
    mass = inboard["mass_kg"] + 4 * wheel
    x = (inboard["mass_kg"] * inboard["cog_m"][0] + wheel * sum(c.position[0] for c in vehicle.corners.values())) / mass
    assert known["mass"] == pytest.approx(mass, rel=0.005)
    assert known["cog.x"] == pytest.approx(x, abs=0.01)
    arms = [sum((np.array(c.position) - [x, 0.0, 0.0])[[0, 1]] ** 2) for c in vehicle.corners.values()]
    assert known["Izz"] == pytest.approx(inboard["inertia_about_cog_kg_m2"][2][2] + wheel * sum(arms), rel=0.02)
    assert not {"mass", "cog.x"} & {text.partition(" ")[0] for text in planned_car(vehicle, known).assumed}
    weighed = replace(vehicle, apriori={"mass": Quantity(1500.0, "kg", "scales")})
    assert known_values(weighed, fitted, "hub")["mass"] == 1500.0


def test_before_the_first_run_and_again_from_what_was_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("mujoco")
    monkeypatch.setattr("lacet.services.commands.plan.SECONDS", 5.0)
    file, kept = tmp_path / "plan.json", tmp_path / "kept"
    limits = ("--only", "liftoff,sinus", "--max-speed", "50", "--max-duration", "20", "--keep", kept, "--json", file)
    argv = [str(word) for word in ("plan", *SHIPPED, *limits, "--runs", "2")]
    assert main(argv) == 0
    first = conforms(file, "plan")
    out = capsys.readouterr().out
    assert first["says"] in out
    assert first["best"] == first["ranking"][0] == first["next"][0]
    assert {one["manoeuvre"] for one in first["ranking"]} == {"sinus", "liftoff"}
    assert first["best"]["manoeuvre"] == "sinus"  # one run of steering tells more than one of lift-off
    assert [one["factor"] for one in first["ranking"]] == sorted((o["factor"] for o in first["ranking"]), reverse=True)
    for one in first["ranking"]:
        assert one["lateral"] <= 1.1 * 0.5 * 9.81
        assert one["duration"] <= 20.0
        assert all(s["after"] <= s["before"] * (1 + 1e-9) for s in one["shrinks"])
    assert len(list(kept.glob("*.parquet"))) == 3

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr("lacet.services.planning.simulated_plans.drive_car", refuse)
    assert main(argv) == 0
    again = conforms(file, "plan")
    assert again["ranking"] == first["ranking"]


def test_on_top_of_runs_with_runs_like_others_and_no_simulator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def missing() -> None:
        raise UsageError("the simulated car needs MuJoCo: install it")

    monkeypatch.setattr("lacet.services.commands.plan.engine_library", missing)
    t, columns, channels = foreign(piece("sine", 5.0, 11.0))  # a spreadsheet and its map
    write_csv(tmp_path / "used.csv", t, columns)
    (tmp_path / "car.toml").write_text(MAP_HEAD + channels)
    used = str(tmp_path / "used.csv")
    like = str(written(piece("liftoff", 5.0, 11.0), tmp_path / "off.parquet"))
    file = tmp_path / "plan.json"
    assert main(["plan", used, *FILES]) == 2
    assert "--map" in capsys.readouterr().err
    argv = ["plan", used, "--map", str(tmp_path / "car.toml"), *FILES, "--want", "YY6", "Iyy", "--json", str(file)]
    assert main(argv) == 2
    assert "--like" in capsys.readouterr().err
    assert main([*argv, "--like", like, used]) == 0
    result = conforms(file, "plan")
    assert result["runs"] == ["used"]
    assert result["best"]["run"] == "another run like off"
    assert result["best"]["speed"] is None
    assert [w["name"] for w in result["wanted"]] == ["YY6", "Iyy"]
    by_sheet, of_whole = (w["sheet95"] for w in result["wanted"])
    assert by_sheet > 0.0
    assert of_whole is None
    assert "± by sheet" in capsys.readouterr().out
    assert "YY6 ±" in result["says"]
    used = str(written(piece("sine", 5.0, 11.0), tmp_path / "used.parquet"))
    assert main(["plan", used, *FILES, "--like", like, "--want", "YY7"]) == 2
    assert "YY6" in capsys.readouterr().err
    assert main(["plan", used, *FILES, "--want", "YY7"]) == 2  # before anything is simulated
    assert "YY6" in capsys.readouterr().err
    assert main(["plan", used, *FILES, "--only", "nosuch"]) == 2
    assert "'nosuch'. Known: straight" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "--vehicle FILE and --rig FILE"),
        ((*SHIPPED, "--only", "sinsu"), "sinus"),
        ((*SHIPPED, "--only", "rough", "--without", "rough"), "exclude all"),
        ((*SHIPPED, "--max-speed", "5"), "at least 15 km/h"),
        ((*SHIPPED, "--goal", "-1"), "percentage"),
        ((*SHIPPED, "--runs", "0"), "at least 1"),
    ],
)
def test_bad_words_are_answered_with_the_remedy(words: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture):
    assert main(["plan", *words]) == 2
    assert expected in capsys.readouterr().err


def test_known_names_of_manoeuvres():
    assert kinds() == list(MANOEUVRES)
    assert kinds(["rough", "sinus"], ["rough"]) == ["sinus"]
