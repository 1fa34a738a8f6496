"""Exports of a study and of runs, each read again by another program's library."""

from __future__ import annotations

import csv
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy
import yaml
from asammdf import MDF

import lacet
from benchmarks.stories.page import not_printed, play, steps
from lacet.daq.blocks import Flag
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import read_all
from lacet.daq.vehicle import Vehicle
from lacet.services.commands.__main__ import main
from lacet.services.exports.commonroad import commonroad_text
from lacet.services.exports.tables import values_table
from tests.identify.cars import CAR, piece
from tests.services.commands.test_json import conforms
from tests.support.tables import written

COMMONROAD = {
    "l", "w", "steering", "longitudinal", "m", "m_s", "m_uf", "m_ur", "a", "b", "I_Phi_s", "I_y_s", "I_z", "I_xz_s",
    "K_sf", "K_sdf", "K_sr", "K_sdr", "T_f", "T_r", "K_ras", "K_tsf", "K_tsr", "K_rad", "K_zt", "h_cg", "h_raf",
    "h_rar", "h_s", "I_uf", "I_ur", "I_y_w", "K_lt", "R_w", "T_sb", "T_se", "D_f", "D_r", "E_f", "E_r", "tire",
    "trailer",
}  # fmt: skip
"""Fields of VehicleParameters of commonroad-vehicle-models 3.0.2."""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two short runs with both bars."""
    folder = tmp_path_factory.mktemp("work")
    runs = [written(piece(name, 4.0, 14.0), folder / f"{name}.parquet") for name in ("sine", "rough")]
    made = lacet.Study.create(folder / "car", runs, [], Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml"))
    lacet.Session(made).record({"anti_roll_bar.front": {}, "anti_roll_bar.rear": {}}, "both bars")
    return folder / "car"


def exported(study: Path, file: Path, *words: str) -> Path:
    """The file that the command writes."""
    assert main(["export", str(study), "-o", str(file), *words]) == 0
    assert [one.name for one in file.parent.iterdir() if ".part" in one.name] == []
    return file


KNOWN = (
    """
[apriori]  # before the season
mass = { value = 1.5, unit = "kg", source = "scales" }
"spring.fl.k" = { value = 20, unit = "N/mm", source = "drawing" } # old
""",
    """
[apriori.mass]
value = 1.5
unit = "kg"
source = "scales"
[apriori."spring.fl.k"]
value = 20
unit = "N/mm"
source = "drawing"
""",
)
"""What is known before, in both forms that TOML has for it."""


def parameters(study: Path) -> dict[str, dict[str, float]]:
    """Identified parameters of the study's present version by name."""
    return {p["name"]: p for p in lacet.Study.open(study).version().result["parameters"]}


def test_a_vehicle_file_loads_again_with_the_identified_values(study: Path, tmp_path: Path) -> None:
    before = Vehicle.load(CAR / "vehicle.toml")
    car = Vehicle.load(exported(study, tmp_path / "car.toml"))
    assert car.numbers == before.numbers
    assert car.apriori["spring.fl.k"].value == parameters(study)["spring.fl.k"]["value"]
    assert "identified by lacet from sine, rough" in car.apriori["spring.fl.k"].source
    assert "mass" not in car.apriori  # hub loads lack the rims
    # Exported again from a study with that file, nothing is there twice and own knowledge remains.
    second = study.parent / "second"
    shutil.copytree(study, second)
    for number, text in enumerate(KNOWN):
        (second / "vehicle.toml").write_text((CAR / "vehicle.toml").read_text() + text)
        again = Vehicle.load(exported(second, tmp_path / f"again-{number}.toml"))
        assert again.numbers == before.numbers
        assert again.apriori["mass"].source == "scales"
        assert again.apriori["spring.fl.k"] == car.apriori["spring.fl.k"].__class__(
            car.apriori["spring.fl.k"].value, "N/m", again.apriori["spring.fl.k"].source
        )


def test_values_of_a_version_that_fails_are_exported_with_a_warning(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its bars are missing: springs carry their load."""
    own = shutil.copytree(study.parent, tmp_path / "work") / study.name
    lacet.Session(lacet.Study.open(own)).record({}, "no bars")
    for number, warned in ((1, False), (2, True)):
        assert main(["export", str(own), "-o", str(tmp_path / f"{number}.toml"), "--version", str(number)]) == 0
        assert ("! this version fails (" in capsys.readouterr().out) is warned


def test_commonroad_has_its_names_and_units(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = exported(study, tmp_path / "car.yaml").read_text(encoding="utf-8")
    found, known = yaml.safe_load(text), parameters(study)
    assert set(found) <= COMMONROAD
    assert all(isinstance(value, float) and math.isfinite(value) for value in found.values())
    said = capsys.readouterr().out
    assert all(name in said for name in COMMONROAD - set(found))  # what is left out is named
    assert found["m_s"] == known["M6"]["value"]
    assert found["m"] == pytest.approx(found["m_s"] + found["m_uf"] + found["m_ur"])
    assert found["a"] + found["b"] == pytest.approx(2.7)
    assert found["K_sf"] == pytest.approx((known["spring.fl.k"]["value"] + known["spring.fr.k"]["value"]) / 2)
    assert found["K_tsf"] == pytest.approx(-(1.5**2) * known["anti_roll_bar.front.k"]["value"])
    assert "ASSUMED" in text


def test_commonroad_names_the_laws_that_it_has_no_place_for(tmp_path: Path) -> None:
    """In the file and beside it; a bar has its place."""
    vehicle = lacet.Vehicle.load("peugeot-406")
    known = [{"name": name, "value": 1.0, "identifiable": True, "group": name} for name in ("MX6", "MZ6", "M6")]
    result = {"parameters": known, "effects": ["anti_roll_bar.front", "coulomb.rear"], "wheel_reference": "contact"}
    text, left_out = commonroad_text(vehicle, result, "a car", ["anti_roll_bar.front", "coulomb.rear"])
    assert "# coulomb.rear: the format has no place for it" in text
    assert "coulomb.rear" in left_out
    assert "anti_roll_bar.front" not in left_out


def test_matlab_structs_have_values_intervals_and_units(study: Path, tmp_path: Path) -> None:
    found = scipy.io.loadmat(exported(study, tmp_path / "car.mat"), simplify_cells=True)["lacet"]
    spring = parameters(study)["spring.rr.k"]
    one = found["p"]["spring_rr_k"]
    assert (one["name"], one["value"], one["unit"]) == ("spring.rr.k", spring["value"], "N/m")
    half = spring["half95_sheet"]
    assert (one["low95"], one["high95"]) == (spring["value"] - half, spring["value"] + half)
    assert (one["half95_sheet"], one["half95"]) == (half, spring["half95"])
    assert half > spring["half95"]
    values = found["values"]
    at = list(values["name"]).index("roll_gradient")
    assert values["unit"][at] == "deg/g"
    assert values["value"].shape == values["half95"].shape == (len(values["name"]),)
    assert set(found["errors"]["run"]) == {"sine", "rough"}
    assert "ranking" not in found


def test_an_interval_without_the_sheet_is_given_where_that_is_all_there_is() -> None:
    """Of a study that an earlier version made."""
    mass = {"name": "mass", "value": 1400.0, "unit": "kg", "half95": 2.0, "identifiable": True}
    found = values_table({"parameters": [], "not_identifiable": [], "whole_vehicle": [mass]})
    (row,) = (dict(zip(found.columns, row, strict=True)) for row in found.rows)
    assert (row["low95"], row["high95"], row["half95_sheet"], row["half95"]) == (1398.0, 1402.0, None, 2.0)


def test_tables_and_json_agree(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = parameters(study)
    with exported(study, tmp_path / "v.csv").open(encoding="utf-8", newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["kind"] == "parameter"]
    assert {row["name"]: float(row["value"]) for row in rows if row["identified"] == "True"} == {
        name: p["value"] for name, p in known.items()
    }
    assert all(row["why_not"] for row in rows if row["identified"] == "False")
    table = pq.read_table(exported(study, tmp_path / "v.parquet")).to_pylist()
    kept = {row["name"]: row for row in table if row["kind"] == "parameter" and row["identified"]}
    assert {name: (row["low95"], row["high95"]) for name, row in kept.items()} == {
        name: (p["value"] - p["half95_sheet"], p["value"] + p["half95_sheet"]) for name, p in known.items()
    }
    assert {row["kind"] for row in table} == {"parameter", "whole vehicle", "derived"}
    said = tmp_path / "said.json"
    body = json.loads(exported(study, tmp_path / "r.json", "--json", str(said)).read_text(encoding="utf-8"))
    assert conforms(said, "export")["form"] == "results"
    assert {p["name"] for p in body["parameters"]} == set(known)
    errors = pq.read_table(exported(study, tmp_path / "e.parquet", "--as", "errors")).to_pylist()
    scores = body["rows"]["used"]
    assert {(e["run"], e["row"]): e["ratio"] for e in errors} == {
        (run, row): s["ratio"] for run, of in scores.items() for row, s in of.items()
    }
    assert main(["export", str(study), "-o", str(tmp_path / "k.csv"), "--as", "ranking"]) == 2
    assert "lacet diagnose" in capsys.readouterr().err


def test_a_ranking_is_a_table(study: Path, tmp_path: Path) -> None:
    ranked = study.parent / "ranked"
    shutil.copytree(study, ranked)
    candidate = {"effect": "coulomb.front", "answer": "missing", "gain": 0.125, "p": 0.01, "size": 40.0, "why": "-so"}
    lacet.Study.open(ranked).record_diagnosis({"candidates": [candidate]})
    rows = list(csv.reader(exported(ranked, tmp_path / "r.csv", "--as", "ranking").open(encoding="utf-8")))
    assert rows[1] == ["1", "coulomb.front", "missing", "12.5", "0.01", "40.0", "'-so"]  # never a formula


def test_a_run_is_read_again_and_by_asammdf_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = piece("rough", 4.0, 8.0)
    table = written(run, tmp_path / "rough.parquet")
    file = exported(table, tmp_path / "rough.mf4")
    with MDF(file) as mdf:
        found = mdf.get("wheel.rl.force.z")
        assert (found.unit, found.comment.split(";")[0]) == ("N", "wheel load")
        np.testing.assert_array_equal(found.samples, run.signals["wheel.rl.force"].values[:, 2])
    again = open_run(file)
    before = open_run(table)
    assert again.problems == ()
    assert (again.wheel_reference, again.brakes, again.rig) == (before.wheel_reference, before.brakes, before.rig)
    assert set(again.signals) == set(before.signals)
    for name, signal in before.signals.items():
        np.testing.assert_array_equal(again.signals[name].values, signal.values)
        np.testing.assert_allclose(again.signals[name].t, signal.t - signal.t[0], atol=1e-12)
    with opened(file) as source:  # as a log of another system, for a channel map
        assert source.listed["imu.accel.x"].unit == "m/s²"
        np.testing.assert_array_equal(
            read_all(source, ["imu.accel.x"])["imu.accel.x"].values, run.signals["imu.accel"].values[:, 0]
        )
    (tmp_path / "m.toml").write_text('format = "lacet-map 1"\n[channels]\n"laser.fl.hub" = "laser.fl.hub + 10 mm"\n')
    words = ["import", str(file), "--map", str(tmp_path / "m.toml"), "-o", str(tmp_path / "again.mcap")]
    assert main(words) == 0, capsys.readouterr().err
    hub = open_run(tmp_path / "again.mcap").signals["laser.fl.hub"].values
    np.testing.assert_allclose(hub, run.signals["laser.fl.hub"].values + 0.01)
    exported(tmp_path / "again.mcap", tmp_path / "one.mf4", "--channels", "laser.*")
    with MDF(tmp_path / "one.mf4") as mdf:
        assert set(mdf.channels_db) == {"time", "laser.fl.hub"}


def test_a_note_on_a_log_is_no_damage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of how it was read, a unit taken for SI here; the log is whole, and the exit code 0."""
    (tmp_path / "a.csv").write_text("t,v\n" + "".join(f"{k / 100},{k / 10}\n" for k in range(300)))
    (tmp_path / "m.toml").write_text('format = "lacet-map 1"\n[channels]\n"car.speed" = "v"\n')
    words = ["import", str(tmp_path / "a.csv"), "--map", str(tmp_path / "m.toml"), "-o", str(tmp_path / "a.mcap")]
    assert main(words) == 3
    capsys.readouterr()
    assert main(["export", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "a.mf4")]) == 0
    said = capsys.readouterr().out
    assert "! without a unit in file and map, taken as SI: v" in said
    assert "damaged" not in said


def test_samples_not_to_be_used_are_marked_invalid(tmp_path: Path) -> None:
    run = piece("sine", 4.0, 6.0)
    run.signals["imu.rate"].flags[20:30] |= np.uint8(Flag.RANGE)
    lacet.export(run, tmp_path / "sine.mf4")
    usable = open_run(tmp_path / "sine.mf4").signals["imu.rate"].usable
    assert np.flatnonzero(~usable).tolist() == list(range(20, 30))


def test_a_map_for_other_logs_in_the_folder_is_not_for_it(tmp_path: Path) -> None:
    """lacet's own MDF files say who wrote them."""
    lacet.export(piece("sine", 4.0, 6.0), tmp_path / "sine.mf4")
    (tmp_path / "map.toml").write_text('format = "lacet-map 1"\n[channels]\n"laser.fl.hub" = "AnotherName"\n')
    assert len(open_run(tmp_path / "sine.mf4").signals) == 36


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["{study}", "-o", "{here}/car.xlm"], "did you mean '.xml'"),
        (["{study}", "-o", "{here}/car.mf4"], "it is made of a run"),
        (["{run}", "-o", "{here}/car.xml"], "it is made of a study"),
        (["{study}", "-o", "{here}/car.yaml", "--as", "comonroad"], "did you mean 'commonroad'"),
        (["{study}", "-o", "{here}/car.yaml", "--as", "mjcf"], "mjcf goes into a file .xml, not '.yaml'"),
        (["{study}", "-o", "{here}/there.csv"], "exists: give another name, or --force"),
        (["{study}", "-o", "{here}/no/where.csv"], "there is no folder"),
        (["{here}", "-o", "{here}/x.csv"], "study"),
        (["{here}/none", "-o", "{here}/x.csv"], "no such study or run"),
        (["{run}", "-o", "{here}/x.mf4", "--channels", "imu.rates"], "did you mean 'imu.rate'"),
        (["{run}", "-o", "{here}/x.mf4", "--version", "1"], "--version goes with a study"),
        (["{study}", "-o", "{here}/x.csv", "--version", "9"], "no version 9"),
        (["{study}", "-o", "{here}/x.csv", "--channels", "imu.rate"], "--channels goes with a run"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    (tmp_path / "there.csv").write_text("mine")
    places = {"study": study, "run": study.parent / "sine.parquet", "here": tmp_path}
    assert main(["export", *(word.format(**places) for word in words)]) == 2
    assert says in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["there.csv"]
    assert (tmp_path / "there.csv").read_text() == "mine"


def test_a_failed_writer_leaves_the_old_file(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that fails half way."""
    file = tmp_path / "v.csv"
    file.write_text("before")

    def fails(table: object, path: Path) -> None:
        path.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("lacet.services.exports.files.write_table", fails)
    assert main(["export", str(study), "-o", str(file), "--force"]) == 2
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("v.csv", "before")]


def test_a_model_from_a_study_loads_in_mujoco(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mujoco = pytest.importorskip("mujoco")
    known = parameters(study)
    model = mujoco.MjModel.from_xml_path(str(exported(study, tmp_path / "car.xml")))
    chassis = model.body("chassis").id
    assert model.body_mass[chassis] == pytest.approx(known["M6"]["value"], rel=1e-12)
    assert model.joint("slide_fl").stiffness[0] == pytest.approx(known["spring.fl.k"]["value"])
    assert sorted(model.tendon_stiffness) == pytest.approx(sorted(known[f"anti_roll_bar.{a}.k"]["value"]
                                                                   for a in ("front", "rear")))  # fmt: skip
    assert "tyre forces along and across the road" in capsys.readouterr().out


def test_no_library_of_a_form_is_loaded_before_it_is_used() -> None:
    code = (
        "import sys, lacet, lacet.services.commands.export; lacet.export; "
        "print(*(m for m in ('asammdf', 'pandas', 'cvxpy', 'mujoco', 'scipy.io', 'scipy.spatial') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == []


def test_the_commands_of_the_page_print_what_it_shows(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/export.md, in a folder with the study and its runs."""
    monkeypatch.chdir(study.parent)
    (step,) = steps("../export.md")
    printed = play(step)
    assert not_printed(step.shown, printed) is None, printed
