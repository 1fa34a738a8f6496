"""What is missing on the reference car: first one bar, then the other, then nothing; and a cause nobody has listed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.run import Run
from lacet.identify.car.rows import Row
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.candidate import Answer
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.commands.__main__ import main
from lacet.services.render.candidate_reasons import why
from lacet.services.render.verdicts import says
from tests.identify import cars

pytestmark = pytest.mark.slow  # a minute and a half; the stories and the page's test go the same way in make test
VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
CANDIDATES = [effect for effect in KNOWN.values() if not effect.base]
DRAWS = 39
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")


def model(*added: str) -> Model:
    """The base model and some effects."""
    return Model.of([*(e for e in KNOWN.values() if e.base), *(KNOWN[key] for key in added)])


def drives(runs: list[Run]) -> list[PreparedRun]:
    """The runs, brought together."""
    return [PreparedRun.of(run, VEHICLE, RIG) for run in runs]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Roll and heave: parts of two of the four runs."""
    return [cars.piece(name, 2.0, 18.0) for name in ("sine", "rough")]


@pytest.fixture(scope="module")
def fits(runs: list[Run]) -> list[tuple[Fit, NoiseFloor]]:
    """Without bars, with one, with both: fit and floor."""
    found = [fit(model(*BARS[:n]), drives(runs)) for n in range(3)]
    return [(fitted, floor_of(fitted, DRAWS)) for fitted in found]


@pytest.fixture(scope="module")
def steps(fits: list[tuple[Fit, NoiseFloor]]) -> list[Diagnosis]:
    """What is missing in each."""
    return [diagnose(fitted, floor, CANDIDATES) for fitted, floor in fits]


def test_first_one_bar_then_the_other_then_nothing(steps: list[Diagnosis]):
    assert [step.verdict for step in steps] == ["missing", "missing", "nothing missing"]
    assert [step.best.key if step.best else None for step in steps] == [*BARS, None]


def test_the_rows_of_which_effects_explain_a_part_are_those_they_act_in(steps: list[Diagnosis]):
    """Bars act between body and wheels, and not in the rows of the whole car."""
    several = next(step for step in steps if len(step.found) > 1)
    failing = replace(several, failing=(Row.parse("chassis.fx"), *several.failing))
    assert "of what is above the noise floor in suspension" in says(failing)
    assert "chassis.fx" not in says(failing)


def test_every_answer_has_its_reason(steps: list[Diagnosis]):
    for step in steps:
        for c in step.candidates:
            assert why(step, c), c.key
            assert 1.0 / (DRAWS + 1) <= c.p <= 1.0
            if c.answer == Answer.MISSING:
                assert c.p <= SELECTION.level(DRAWS)
                assert max(c.gain, c.most) >= SELECTION.least_gain
            assert (c.answer == Answer.NOT_TESTABLE) == why(step, c).startswith("Cannot be tested"), c.key
        assert len({c.key for c in step.candidates}) == len(step.candidates)


def test_what_is_in_the_model_is_not_tried_and_everything_else_is(steps: list[Diagnosis]):
    every = {effect.key for effect in CANDIDATES}
    for n, step in enumerate(steps):
        assert {c.key for c in step.candidates} == every - set(BARS[:n])


def test_ties_are_alike_and_do_not_name_themselves(steps: list[Diagnosis]):
    for step in steps:
        by_key = {c.key: c for c in step.candidates}
        for c in step.candidates:
            for key, correlation in c.ties:
                assert key != c.key
                assert 0.0 <= correlation <= 1.0 + 1e-9
                mutual = dict(by_key[key].ties)
                assert mutual.get(c.key, correlation) == pytest.approx(correlation)


def test_the_bar_is_found_with_its_size(steps: list[Diagnosis]):
    best = steps[1].best
    assert best is not None
    truth = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))
    bar = truth["anti_roll_bar_N_per_m_of_travel_difference"]["rear"]
    assert best.values[0] == pytest.approx(bar, rel=0.1)


def test_a_cause_nobody_has_listed_gets_no_wrong_name(
    runs: list[Run], fits: list[tuple[Fit, NoiseFloor]], steps: list[Diagnosis]
):
    """A force of 50 N that waves with travel, a period each 16 mm: no effect of the catalogue looks like it."""
    spoilt = []
    for run in runs:
        values = {}
        for corner in VEHICLE.corners:
            travel = run.signals[f"laser.{corner}.hub"].values[:, 0]
            force = run.signals[f"wheel.{corner}.force"].values.copy()
            force[:, 2] += 50.0 * np.sin(2.0 * travel / 0.005)
            values[f"wheel.{corner}.force"] = force
        spoilt.append(run.with_values(values))
    fitted = fit(model(*BARS), drives(spoilt), stored=fits[2][0].stored)
    found = diagnose(fitted, fits[2][1], CANDIDATES, noise=steps[2].noise)
    assert found.verdict in ("unlisted cause", "nothing missing"), says(found)
    assert found.best is None


def test_the_reference_car_by_the_command_line(tmp_path: Path):
    """Both bars and nothing else are named and added on four runs, and the parameters are those of the truth."""
    tables = [str(cars.CAR / f"{name}.parquet") for name in cars.RUNS]
    files = ["--rig", str(cars.CAR / "rig.toml"), "--vehicle", str(cars.CAR / "vehicle.toml")]
    folder, out = str(tmp_path / "study"), tmp_path / "diagnosis.json"
    assert main(["study", "new", folder, "--use", *tables, *files, "--draws", str(DRAWS)]) == 0
    assert main(["diagnose", folder, "--auto", "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert [item["effect"] for item in found["added"]] == [*BARS]
    assert found["verdict"] == "nothing missing"
    version: dict[str, Any] = json.loads((tmp_path / "study" / "versions" / "003.json").read_text(encoding="utf-8"))
    value = {p["name"]: p["value"] for p in version["result"]["parameters"]}
    whole = {w["name"]: w["value"] for w in version["result"]["whole_vehicle"]}
    truth = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))
    for corner in VEHICLE.corners:
        suspension = truth["suspension"]["front" if corner[0] == "f" else "rear"]
        assert value[f"spring.{corner}.k"] == pytest.approx(suspension["k_N_m"], rel=0.005)
        assert value[f"damper.{corner}.c"] == pytest.approx(suspension["c_Ns_m"], rel=0.01)
        assert value[f"tyre_stiffness.{corner}.kt"] == pytest.approx(truth["tyre_vertical_stiffness_N_m"], rel=0.005)
    for axle, bar in truth["anti_roll_bar_N_per_m_of_travel_difference"].items():
        assert value[f"anti_roll_bar.{axle}.k"] == pytest.approx(bar, rel=0.008)
    design = truth["inboard_at_design"]
    assert whole["mass"] == pytest.approx(design["mass_kg"], rel=0.0005)
    for axis, wanted in zip("xyz", design["cog_m"], strict=True):
        assert whole[f"cog.{axis}"] == pytest.approx(wanted, abs=0.002)
    for k, axis in enumerate("xyz"):
        wanted = design["inertia_about_cog_kg_m2"][k][k]
        assert whole[f"I{axis}{axis}"] == pytest.approx(wanted, rel=0.01)
