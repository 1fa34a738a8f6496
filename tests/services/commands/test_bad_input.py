"""Bad input at the command line: a clear message, the right exit code, and what can be identified still is."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.formats.log import LogReader
from lacet.daq.run import signal_of
from lacet.services.commands.__main__ import main
from lacet.services.workspace.study import Study
from tests.support.places import HOME
from tests.support.tables import FILES, exchanged, piece, spoilt, without, written

CAPTURE = HOME / "replay_logs" / "anti-roll-bars" / "sinus.mcap"
DBC = HOME / "drivers" / "dbc" / "igel.dbc"


class Said(NamedTuple):
    """What a command left behind."""

    code: int
    text: str
    result: dict[str, Any]

    def value(self, name: str) -> tuple[float, float]:
        """A parameter and half of its interval."""
        found = next(p for p in self.result["parameters"] if p["name"] == name)
        return found["value"], found["half95"]

    @property
    def scored(self) -> set[str]:
        """Rows of the first run that were fitted."""
        return set(next(iter(self.result["rows"]["used"].values())))


@pytest.fixture
def lacet(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs a command line in this process; a traceback fails the test by itself."""
    monkeypatch.setattr("lacet.services.commands.identify.SCORE_DRAWS", 3)
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)

    def run(*argv: object) -> Said:
        file = tmp_path / "result.json"
        file.unlink(missing_ok=True)
        code = main([*map(str, argv), "--json", str(file)])
        out = capsys.readouterr()
        result = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        return Said(code, out.out + out.err, result)

    return run


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten good seconds."""
    return written(piece(), tmp_path_factory.mktemp("sound") / "sound.parquet")


@pytest.fixture(scope="module")
def fitted(sound: Path, tmp_path_factory: pytest.TempPathFactory) -> Said:
    """What they give."""
    file = tmp_path_factory.mktemp("fit") / "fit.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lacet.services.commands.identify.SCORE_DRAWS", 3)
        assert main(["identify", str(sound), *FILES, "--json", str(file)]) == 0
    return Said(0, "", json.loads(file.read_text(encoding="utf-8")))


MAIN = ("spring.rl.k", "spring.rr.k", "tyre_stiffness.rl.kt", "tyre_stiffness.rr.kt")


def alike(a: Said, b: Said, names: tuple[str, ...] = MAIN) -> None:
    """The same parameters within their intervals."""
    for name in names:
        (x, dx), (y, dy) = a.value(name), b.value(name)
        assert abs(x - y) <= np.hypot(dx, dy), name


# -- captures --------------------------------------------------------------------------------------------------------


def test_a_capture_cut_in_the_middle_is_decoded_as_far_as_it_is_whole_and_identified(lacet, tmp_path: Path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(CAPTURE.read_bytes()[: int(0.65 * CAPTURE.stat().st_size)])
    said = lacet("decode", cut, "-o", tmp_path / "run.mcap")
    assert said.code == 3
    assert "cut off at byte" in said.text
    assert "the recording was not closed" in said.text
    whole = LogReader(CAPTURE)
    for source in whole.sources():
        kept = LogReader(cut).frames(source)
        full = whole.frames(source)
        assert 0.4 * len(full) < len(kept) < 0.8 * len(full)
        assert np.array_equal(kept.t_ns, full.t_ns[: len(kept)])
    assert set(said.result["samples"]) == set(LogReader(tmp_path / "run.mcap").channels())
    said = lacet("identify", tmp_path / "run.mcap")
    assert said.code == 3
    assert "the raw log was damaged: cut off at byte" in said.text
    assert {"chassis.fz", "suspension.fl", "tyre.rr"} <= said.scored
    value, half = said.value("tyre_stiffness.fl.kt")
    assert half < 0.05 * value
    info = lacet("info", cut)
    assert info.code == 3
    assert "cut off" in info.text


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.01, 0.9999])
def test_a_capture_cut_anywhere_ends_in_no_traceback(lacet, tmp_path: Path, share: float):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(CAPTURE.read_bytes()[: int(share * CAPTURE.stat().st_size)])
    said = lacet("decode", cut, "-o", tmp_path / "run.mcap")
    assert said.code == (3 if share > 0.5 else 2)
    assert str(cut) in said.text or "cut" in said.text
    assert (tmp_path / "run.mcap").exists() == (said.code == 3)
    assert not list(tmp_path.glob("*.part"))


def test_a_wrong_dbc_is_refused_with_every_fault_at_once(lacet, tmp_path: Path):
    text = DBC.read_text(encoding="utf-8")
    gone = ("wheel_fl_force", "wheel_rr_moment")
    parts = [part for part in text.split("\n\n") if not any(name in part for name in gone)]
    assert len(parts) == len(text.split("\n\n")) - 2
    wrong = tmp_path / "igel.dbc"
    wrong.write_text("\n\n".join(parts), encoding="utf-8")
    said = lacet("decode", CAPTURE, "-o", tmp_path / "run.mcap", "--dbc", wrong)
    assert said.code == 2
    assert said.text.count("\n  - ") >= 2, said.text
    for name in gone:
        assert name in said.text
    assert not (tmp_path / "run.mcap").exists()


@pytest.mark.parametrize(("name", "text", "says"), [
    ("igel.dbc", "no dbc at all", "igel.dbc"),
    ("iegl.dbc", "VERSION \"\"\n", "did you mean 'igel.dbc'?"),
])  # fmt: skip
def test_a_dbc_that_is_none_or_not_used_is_refused(lacet, tmp_path: Path, name: str, text: str, says: str):
    (tmp_path / name).write_text(text, encoding="utf-8")
    said = lacet("decode", CAPTURE, "-o", tmp_path / "run.mcap", "--dbc", tmp_path / name)
    assert said.code == 2
    assert says in said.text


# -- runs with something wrong ---------------------------------------------------------------------------------------


def test_without_one_laser_its_rows_are_named_and_the_others_identified(lacet, tmp_path: Path, fitted: Said):
    said = lacet("identify", written(without(piece(), "laser.fl.hub"), tmp_path / "run.parquet"), *FILES)
    assert said.code == 0
    assert "suspension.fl; tyre.fl: needs: laser.fl.hub (or suspension.fl.travel, damper.fl.travel)" in said.text
    assert said.scored == fitted.scored - {"suspension.fl", "tyre.fl"}
    assert of_source(said, "assumed") == {row for row in fitted.scored if row.startswith("chassis.")}
    alike(said, fitted)
    assert "spring.fl.k" in {p["name"] for p in said.result["not_identifiable"]}


def of_source(said: Said, source: str) -> set[str]:
    """Rows that are measured, assumed or impossible."""
    return {one["row"] for one in said.result["row_sources"] if one["source"] == source}


@pytest.mark.parametrize("sensor", ["imu", "wheel"])
def test_without_a_whole_sensor_nothing_is_identifiable_and_it_is_said_what_lacks(lacet, tmp_path: Path, sensor: str):
    said = lacet("identify", written(without(piece(), sensor), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "nothing identifiable" in said.text
    assert f"needs: {sensor}." in said.text


@pytest.mark.parametrize(("sensor", "kinds"), [("camera", ("chassis", "suspension", "tyre")), ("laser", ("chassis",))])
def test_without_cameras_or_lasers_rows_stand_on_assumptions_and_it_is_said_which(
    lacet, tmp_path: Path, fitted: Said, sensor: str, kinds: tuple[str, ...]
):
    said = lacet("identify", written(without(piece(), sensor), tmp_path / "run.parquet"), *FILES)
    assert said.scored == of_source(said, "assumed") == {r for r in fitted.scored if r.startswith(kinds)}
    assert not of_source(said, "measured")
    assert f"{sensor}." in said.text


def test_a_stretch_without_values_is_flagged_and_the_rest_gives_the_same(lacet, tmp_path: Path, fitted: Said):
    said = lacet("identify", written(spoilt(piece(), "imu.accel", 500, 900), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "7.00 to 8.60 s: no usable samples of imu.accel" in said.text
    assert said.scored == fitted.scored
    alike(said, fitted)


def test_a_channel_without_any_value_is_as_good_as_absent(lacet, tmp_path: Path, fitted: Said):
    said = lacet("identify", written(spoilt(piece(), "wheel.fl.force", 0, 9999), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "wheel.fl.force has fewer than 30 usable samples" in said.text
    assert "suspension.fl" not in said.scored
    alike(said, fitted)


def test_exchanged_wheels_are_told_with_the_remedy_and_the_other_axle_is_identified(lacet, tmp_path, fitted: Said):
    said = lacet("identify", written(exchanged(piece(), "fl", "fr"), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "the loads of fl follow the tyre at fr, the loads of fr follow the tyre at fl" in said.text
    assert "the order of 'corners' in the rig's wheel sensor" in said.text
    alike(said, fitted)
    assert not {"suspension.fl", "suspension.fr", "chassis.fz"} & said.scored


def test_loads_of_the_other_sign_are_not_taken_for_exchanged_ones(lacet, tmp_path: Path):
    """With y to the right and z down a wheel's load goes against its own tyre, and with that across the car."""
    run = piece("sine")
    turned = {name: run.signals[name].values * [1.0, -1.0, -1.0] for name in run.signals if name.endswith(".force")}
    said = lacet("identify", written(run.with_values(turned), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "they are positive when the wheels carry the car" in said.text
    assert "look exchanged" not in said.text


def test_exchanged_lasers_are_not_taken_for_exchanged_loads(lacet, tmp_path: Path, fitted: Said):
    """The loads move the body as they should."""
    lasers = exchanged(piece(), "fl", "fr", "laser")
    said = lacet("identify", written(lasers, tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "lasers or travels of wheels look exchanged (the loads of fl follow the tyre at fr" in said.text
    assert "Their loads are left out" not in said.text
    assert "chassis.fz" in said.scored
    alike(said, fitted)


def test_without_chassis_rows_exchanged_wheels_may_be_either(lacet, tmp_path: Path):
    front = without(exchanged(piece(), "fl", "fr"), "wheel.rl.force")
    said = lacet("identify", written(front, tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert ": their loads, or their lasers or travels. The loads are left out" in said.text


def test_exchanged_load_cells_may_be_either_and_are_left_out(lacet, tmp_path: Path, fitted: Said):
    """The body is moved by their sum, which stays as it was."""
    run, other = piece(), {"fl": "fr", "fr": "fl"}
    signals = {name: signal for name, signal in run.signals.items() if not name.startswith("wheel.")}
    for corner in CORNERS:
        force = run.signals[f"wheel.{other.get(corner, corner)}.force"]
        signals[f"hub.{corner}.load"] = signal_of(f"hub.{corner}.load", force.t, force.values[:, 2:])
    said = lacet("identify", written(replace(run, signals=signals), tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert ": their loads, or their lasers or travels. The loads are left out" in said.text
    assert not {"suspension.fl", "suspension.fr", "chassis.fz"} & said.scored


def test_where_the_wheels_of_both_axles_are_exchanged_the_refusal_says_so(lacet, tmp_path: Path):
    wrong = exchanged(exchanged(piece(), "fl", "fr"), "rl", "rr")
    said = lacet("identify", written(wrong, tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "no row of the equations can be formed" in said.text
    assert "the loads of rl follow the tyre at rr, the loads of rr follow the tyre at rl" in said.text


@pytest.mark.parametrize("step", [7.3, -3.0])
def test_a_time_that_jumps_is_flagged_and_does_no_harm(lacet, tmp_path: Path, fitted: Said, sound: Path, step: float):
    table = pq.read_table(sound)
    t = table["t"].to_numpy().copy()
    t[1250:] += step
    file = tmp_path / "run.parquet"
    pq.write_table(table.set_column(table.column_names.index("t"), "t", pa.array(t)), file)
    said = lacet("identify", file, *FILES)
    assert said.code == 3
    if step > 0:
        assert "10.00 to 17.30 s: no usable samples" in said.text
    else:
        assert "750 rows have a time that does not increase (first: row 1251)" in said.text
    alike(said, fitted, ("tyre_stiffness.rl.kt", "tyre_stiffness.rr.kt"))
    if step > 0:
        alike(said, fitted)


@pytest.mark.parametrize(("seconds", "says"), [(1.0, "at least 2.17 s are needed"), (0.02, "record for some seconds")])
def test_a_run_too_short_is_refused_with_the_length_needed(lacet, tmp_path: Path, seconds: float, says: str):
    said = lacet("identify", written(piece("sine", 5.0, 5.0 + seconds), tmp_path / "run.parquet"), *FILES)
    assert said.code == 2
    assert says in said.text


def test_of_two_runs_the_bad_one_is_left_out_and_named(lacet, tmp_path: Path, sound: Path, fitted: Said):
    short = written(piece("sine", 5.0, 6.0), tmp_path / "short.parquet")
    said = lacet("identify", short, sound, *FILES)
    assert said.code == 3
    assert "left out: short:" in said.text
    alike(said, fitted)


def test_a_car_that_stands_still_with_dead_sensors_has_nothing_identifiable(lacet, tmp_path: Path):
    dead = piece().with_values({n: 0.0 * s.values for n, s in piece().signals.items()})
    said = lacet("identify", written(dead, tmp_path / "run.parquet"), *FILES)
    assert said.code == 3
    assert "Nothing is identifiable" in said.text


def test_a_whole_vehicle_value_on_round_off_alone_is_not_shown(lacet, tmp_path: Path):
    still = piece().with_values({n: np.repeat(s.values[:1], len(s.t), 0) for n, s in piece().signals.items()})
    said = lacet("identify", written(still, tmp_path / "run.parquet"), *FILES)
    for item in said.result["whole_vehicle"]:
        assert not item["identifiable"] or item["half95"] < abs(item["value"]) + 3.0, item


# -- arguments -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "says"), [
    (["--add", "anti_roll_bar.frnt"], "did you mean 'anti_roll_bar.front'?"),
    (["--add", "spring.fl"], "spring.fl is in the model already"),
    (["--rig", "peugeot-407"], "did you mean 'peugeot-406'?"),
    (["--vehicle", "peugeot"], "not one shipped with lacet (peugeot-406)"),
    (["--cutoff", "-1"], "a frequency above 0 Hz"),
    (["--cutoff", "nan"], "a frequency above 0 Hz"),
    (["--cutoff", "200"], "needs a rate above 400 Hz"),
])  # fmt: skip
def test_wrong_words_get_the_nearest_right_one(lacet, sound: Path, words: list[str], says: str):
    said = lacet("identify", sound, *FILES, *words)
    assert said.code == 2
    assert says in said.text


def test_a_table_that_names_a_rig_nobody_has_says_what_to_give(lacet, sound: Path):
    said = lacet("identify", sound)
    assert said.code == 2
    assert "give --rig FILE" in said.text


def test_a_csv_without_metadata_needs_rig_and_vehicle_named(lacet, tmp_path: Path, fitted: Said):
    csv = written(piece(), tmp_path / "run.csv")
    csv.with_suffix(".json").unlink()
    said = lacet("identify", csv)
    assert said.code == 2
    assert "does not say which rig recorded it: give --rig FILE" in said.text
    said = lacet("identify", csv, *FILES)
    assert said.code == 0
    alike(said, fitted)


def test_contact_and_hub_runs_are_not_mixed(lacet, tmp_path: Path, sound: Path):
    other = written(replace(piece("sweep"), wheel_reference="contact"), tmp_path / "other.parquet")
    said = lacet("identify", sound, other, *FILES)
    assert said.code == 2
    assert "contact and hub" in said.text


def test_a_run_given_twice_is_refused(lacet, sound: Path):
    said = lacet("identify", sound, sound, *FILES)
    assert said.code == 2
    assert "given twice" in said.text


def test_runs_of_one_name_from_two_folders_are_both_scored(lacet, tmp_path: Path, sound: Path):
    (tmp_path / "monday").mkdir()
    other = written(piece("sweep"), tmp_path / "monday" / sound.name)
    said = lacet("identify", sound, other, *FILES)
    assert said.code == 0
    assert len(said.result["rows"]["used"]) == 2


@pytest.mark.parametrize("name", ["absent.parquet", "absent.mcap", "run.xlsx", "."])
def test_files_that_are_not_there_are_named(lacet, tmp_path: Path, name: str):
    said = lacet("identify", tmp_path / name, *FILES)
    assert said.code == 2
    assert str(tmp_path) in said.text


@pytest.mark.parametrize("name", ["run.parquet", "run.mcap", "run.csv", "rig.toml"])
@pytest.mark.parametrize("content", [b"", b"hello", bytes(range(256)) * 50], ids=["empty", "words", "bytes"])
def test_files_of_rubbish_are_refused(lacet, tmp_path: Path, name: str, content: bytes):
    (tmp_path / name).write_bytes(content)
    assert lacet("info", tmp_path / name).code == 2
    if name != "rig.toml":
        assert lacet("identify", tmp_path / name, *FILES).code == 2


def test_a_result_that_cannot_be_written_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["info", "--rows", "--json", str(tmp_path)]) == 2
    assert "cannot be written" in capsys.readouterr().err


# -- studies ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def study(sound: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of the ten good seconds."""
    folder = tmp_path_factory.mktemp("studies") / "study"
    assert main(["study", "new", str(folder), "--use", str(sound), *FILES]) == 0
    return folder


def test_a_study_that_exists_is_not_made_again(lacet, study: Path, sound: Path):
    before = (study / "study.json").read_bytes()
    said = lacet("study", "new", study, "--use", sound, *FILES)
    assert said.code == 2
    assert "is a study already" in said.text
    assert (study / "study.json").read_bytes() == before


@pytest.mark.parametrize("command", [["study"], ["compare"], ["diagnose"], ["add"]])
def test_a_folder_that_is_no_study_is_told(lacet, tmp_path: Path, command: list[str]):
    said = lacet(*command, tmp_path, *(["anti_roll_bar.front"] if command == ["add"] else []))
    assert said.code == 2
    assert "is no study (no study.json in it); make one: lacet study new" in said.text
    said = lacet("diagnose", written(piece(), tmp_path / "run.parquet"))
    assert "run.parquet is a file; a study is a folder" in said.text


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "lacet-study 9"}', '{"format": "lacet-study 1"}'])
def test_a_study_file_that_is_broken_is_told(lacet, tmp_path: Path, text: str):
    (tmp_path / "study.json").write_text(text, encoding="utf-8")
    said = lacet("study", tmp_path)
    assert said.code == 2
    assert "study.json cannot be read" in said.text


def test_a_second_writer_is_kept_out(lacet, study: Path, tmp_path: Path):
    copy = Path(shutil.copytree(study, study.parent / "locked"))
    (copy / ".writing").touch()
    said = lacet("add", copy, "anti_roll_bar.front")
    assert said.code == 2
    assert f"another lacet is writing to {copy}; if not, remove {copy / '.writing'}" in said.text
    assert len(Study.open(copy).versions()) == 1


@pytest.mark.parametrize(("words", "says"), [
    (["undo", "{}"], "there is nothing to undo"),
    (["study", "{}", "--version", "7"], "has no version 7 (it has 1)"),
    (["study", "{}", "--use", "x.parquet"], "--use and --hold go with a new study"),
    (["remove", "{}", "spring.fl"], "spring.fl was not added to version 1"),
    (["compare", "{}", "--version", "0"], "has no version 0"),
    (["diagnose", "{}", "--draws", "5"], "at least 19 are needed"),
    (["add", "{}"], "name an effect, or give --best"),
    (["add", "{}", "--best"], "no diagnosis of version 1 proposes anything: lacet diagnose"),
    (["add", "{}", "anti_roll_bar.fornt"], "did you mean 'anti_roll_bar.front'?"),
    (["add", "{}", "bump_stop.front", "--shape", "gap=nan"], "write gap=NUMBER"),
    (["add", "{}", "bump_stop.front", "--shape", "gap=30"], "in SI units; 0.005 to 0.06 are usual for gap"),
    (["add", "{}", "bump_stop.front", "--shape", "gup=1"], "the effect's constants are gap, n"),
])  # fmt: skip
def test_what_cannot_be_done_with_a_study_is_told(lacet, study: Path, words: list[str], says: str):
    said = lacet(*(word.format(study) for word in words))
    assert said.code == 2
    assert says in said.text
    assert len(Study.open(study).versions()) == 1


def test_a_study_whose_making_failed_leaves_nothing_behind(lacet, tmp_path: Path, sound: Path):
    short = written(piece("sine", 5.0, 6.0), tmp_path / "short.parquet")
    folder = tmp_path / "study"
    cases = {
        "at least 2.17 s are needed": ["--use", short],
        "both used and held out": ["--use", sound, "--hold", sound],
        "no such file": ["--use", sound, "--hold", tmp_path / "absent.parquet"],
        "given twice": ["--use", sound, sound],
        "name the runs to identify with": [],
        "at least 19 are needed": ["--use", sound, "--draws", "5"],
    }
    for says, words in cases.items():
        said = lacet("study", "new", folder, *words, *FILES)
        assert said.code == 2
        assert says in said.text
        assert not folder.exists(), says
    said = lacet("study", "new", sound, "--use", sound, *FILES)
    assert said.code == 2
    assert "no folder can be made there" in said.text


def test_why_names_the_channel_and_not_a_manoeuvre(lacet, tmp_path: Path):
    run = piece()
    lacking = replace(run, signals={n: s for n, s in run.signals.items() if n != "wheel.fl.force"})
    said = lacet("identify", written(lacking, tmp_path / "run.parquet"), *FILES)
    why = {item["name"]: item["why"] for item in said.result["not_identifiable"]}
    for name in ("XX6", "M6", "spring.fl.k", "tyre_stiffness.fl.kt"):
        assert "wheel.fl.force" in why[name], why[name]
        assert "steering" not in why[name]
