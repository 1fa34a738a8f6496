"""``lacet simulate``: what it writes can be read, decoded and is what the sensors delivered."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from lacet import base_model, catalogue, compare, fit, load_runs
from lacet.daq.channels import CHANNELS, STANDARD
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.commands.__main__ import main
from lacet.simulate import Sheet, find_car, make_manoeuvre, measure
from lacet.simulate import run as drive

RIG = """
format = "lacet-rig 1"
name = "trial"
wheel_reference = "hub"
[bus.can0]
kind = "can"
[bus.can1]
kind = "can"
[bus.serial0]
kind = "serial"
[bus.udp0]
kind = "udp"
[[sensor]]
name = "wheels"
driver = "igel"
bus = "can0"
channels = ["wheel.*"]
latency = 0.002
[[sensor]]
name = "imu"
driver = "sagem"
bus = "serial0"
channels = ["imu.*"]
position = [-1.35, 0.1, 0.31]
latency = 0.004
clock = "device"
[[sensor]]
name = "lasers"
driver = "lasers"
bus = "can1"
channels = ["laser.*"]
latency = 0.008
[[sensor]]
name = "cameras"
driver = "zimmer"
bus = "udp0"
channels = ["camera.*"]
latency = 0.025
clock = "device"
[[sensor]]
name = "correvit"
driver = "correvit"
bus = "can1"
channels = ["correvit.speed"]
axes = "heading"
position = [-3.2, 0.0, 0.01]
latency = 0.012
"""
SHORT = ["--set", "duration=2"]


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    return path


def lacet(*words: object) -> int:
    return main([str(word) for word in words])


def test_tables_can_be_identified_with_what_lies_beside_them(tmp_path: Path, rig: Path) -> None:
    out, truth, result = tmp_path / "runs", tmp_path / "truth" / "truth.json", tmp_path / "result.json"
    words = ["simulate", "--rig", rig, "--manoeuvre", "sinus", "--manoeuvre", "sinus", *SHORT, "--format", "parquet"]
    assert lacet(*words, "--hide", "anti_roll_bar.front=19780", "-o", out, "--truth", truth, "--json", result) == 0
    run = open_run(out / "sinus-1.parquet")
    assert set(run.signals) == set(STANDARD)
    assert (run.vehicle, run.rig, run.wheel_reference, run.brakes) == ("peugeot-406", "trial", "hub", "off")
    vehicle = Vehicle.load(out / "peugeot-406.toml")
    centres = find_car("peugeot-406").wheel_centres
    for i, corner in enumerate(vehicle.corners.values()):
        assert corner.position == pytest.approx(centres[i], abs=1e-6)
    told = json.loads(truth.read_text(encoding="utf-8"))
    assert told["runs"][0]["hidden"][0]["name"] == "anti_roll_bar.front"
    assert json.loads(result.read_text(encoding="utf-8"))["runs"][1]["file"].endswith("sinus-2.parquet")
    for file in out.iterdir():
        assert b"anti_roll" not in file.read_bytes()
    other = open_run(out / "sinus-2.parquet")
    assert not np.array_equal(run.signals["imu.rate"].values, other.signals["imu.rate"].values)


def test_a_capture_decodes_to_what_the_sensors_delivered(tmp_path: Path, rig: Path) -> None:
    out = tmp_path / "runs"
    assert lacet("simulate", "--rig", rig, "--manoeuvre", "liftoff", *SHORT, "--seed", 4, "-o", out) == 0
    capture = out / "liftoff.mcap"
    reader = LogReader(capture)
    assert set(reader.sources()) == {"can0", "can1", "serial0", "udp0"}
    for source in reader.sources():
        assert np.all(np.diff(reader.frames(source).t_ns) >= 0)
    assert (reader.start.vehicle, reader.start.manoeuvre, reader.start.brakes) == ("peugeot-406", "liftoff", "off")
    assert not reader.damage
    assert lacet("decode", capture, "-o", tmp_path / "log.mcap") == 0
    motion = drive(find_car("peugeot-406"), make_manoeuvre("liftoff", duration=2), seed=4)
    blocks = measure(motion, Rig.load(rig), 4, sheet=Sheet(seed=4))
    decoded = LogReader(tmp_path / "log.mcap").blocks()
    assert set(decoded) == set(STANDARD)
    for name, block in blocks.items():
        assert np.array_equal(decoded[name].t_ns, block.t_ns)
        assert not np.any(decoded[name].flags)
        step = decoded[name].values - block.values
        if CHANNELS[name].family in ("wheel.angle", "imu.attitude"):
            step = np.mod(step + np.pi, 2 * np.pi) - np.pi
        assert np.max(np.abs(step)) < CHANNELS[name].noise  # quantisation lies below the noise
    run = open_run(tmp_path / "log.mcap")
    assert set(run.signals) == set(STANDARD)
    assert run.signals["wheel.fl.force"].t[-1] == pytest.approx(2.0, abs=0.1)


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path, rig: Path) -> None:
    files = []
    for name in ("a", "b"):
        assert lacet("simulate", "--rig", rig, "--manoeuvre", "kerb", *SHORT, "-o", tmp_path / name) == 0
        files.append((tmp_path / name / "kerb.mcap").read_bytes())
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--manoeuvre", "sinsu"], "sinus"),
        (["--manoeuvre", "sinus", "--set", "amplitud=1"], "amplitude"),
        (["--manoeuvre", "sinus", "--set", "amplitude"], "KEY=VALUE"),
        (["--manoeuvre", "rough", "--set", "grade=Z"], "A, B, C"),
        (["--manoeuvre", "rough", "--set", "ruogh.grade=C"], "'ruogh' is not driven; did you mean 'rough'?"),
        (["--manoeuvre", "sinus", "--set", "speed=20", "--set", "sinus.sped=20"], "did you mean 'speed'?"),
        (["--manoeuvre", "sinus", "--vehicle", "no-such.toml"], "no-such.toml"),
        (["--manoeuvre", "sinus", "--hide", "bump_stpo.front=1"], "bump_stop.front"),
        (["--manoeuvre", "sinus", "--vehicle", "peugeot-407"], "peugeot-406"),
        (["--manoeuvre", "sinus", "--truth", "OUT/truth.json"], "not kept among the runs"),
    ],
)
def test_wrong_arguments_are_told_with_the_remedy(
    tmp_path: Path, rig: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    out = tmp_path / "runs"
    given = [word.replace("OUT", str(out)) for word in words]
    assert lacet("simulate", "--rig", rig, *given, *SHORT, "-o", out) == 2
    assert told in capsys.readouterr().err


def test_runs_are_not_replaced_unless_asked(tmp_path: Path, rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--rig", rig, "--manoeuvre", "straight", "--set", "duration=0.5", "--format", "parquet"]
    assert lacet(*words, "-o", tmp_path / "runs") == 0
    assert lacet(*words, "-o", tmp_path / "runs") == 2
    assert "--force" in capsys.readouterr().err
    assert lacet(*words, "-o", tmp_path / "runs", "--force") == 0


def test_settings_are_of_all_manoeuvres_or_of_one(tmp_path: Path, rig: Path) -> None:
    words = ["--manoeuvre", "straight", "--manoeuvre", "sinus", "--set", "duration=1", "--set", "sinus.duration=2"]
    result = tmp_path / "result.json"
    lacet("simulate", "--rig", rig, *words, "--format", "parquet", "-o", tmp_path / "runs", "--json", result)
    runs = json.loads(result.read_text(encoding="utf-8"))["runs"]
    assert [run["duration_s"] for run in runs] == [1.0, 2.0]


def test_instruments_stay_the_same_from_one_command_to_the_next(tmp_path: Path, rig: Path) -> None:
    """With one seed of the sheet gains and latencies are alike and zeros are not; the truth tells what was drawn."""
    drawn = []
    for name, seeds in {"a": [1, 7], "b": [2, 7], "c": [2, 8]}.items():
        truth = tmp_path / f"{name}.json"
        words = ["--manoeuvre", "straight", "--set", "duration=0.5", "--gains", "--latencies", "--format", "parquet"]
        seed = ["--seed", seeds[0], "--sheet-seed", seeds[1], "--no-noise", "--truth", truth]
        assert lacet("simulate", "--rig", rig, *words, *seed, "-o", tmp_path / name) == 0
        drawn.append(json.loads(truth.read_text(encoding="utf-8"))["runs"][0]["sheet"])
    a, b, c = drawn
    for what in ("gains", "latencies"):
        assert a[what] == b[what]
        assert set(b[what].values()) & set(c[what].values()) <= {0.0}
    assert set(a["zeros"].values()) & set(b["zeros"].values()) <= {0.0}
    # What is told is what was measured: two runs whose zeros alone differ.
    ours, other = (open_run(tmp_path / name / "straight.parquet") for name in "bc")
    column, channel = "laser.fl.ground", "laser.fl.ground"
    true = [
        (run.signals[channel].values[:, 0] - told["zeros"][column]) / (1.0 + told["gains"][channel])
        for run, told in ((ours, b), (other, c))
    ]
    later = b["latencies"]["lasers"] - c["latencies"]["lasers"]
    n = min(map(len, true)) - 20
    assert abs(later) < 0.02
    raw = [run.signals[channel].values[:n, 0] for run in (ours, other)]
    assert np.max(np.abs(true[0][:n] - true[1][:n])) < 1e-4 < np.max(np.abs(raw[0] - raw[1]))


VEHICLE = """
format = "lacet-vehicle 1"
name = "kit-car"
[geometry]
wheelbase = { value = 2.3, unit = "m", source = "tape" }
[axle.front]
track = { value = 1.45, unit = "m", source = "tape" }
wheel_centre_height = { value = 0.27, unit = "m", source = "tape" }
tyre_radius = { value = 0.285, unit = "m", source = "tape" }
[axle.rear]
track = { value = 1.47, unit = "m", source = "tape" }
wheel_centre_height = { value = 0.27, unit = "m", source = "tape" }
tyre_radius = { value = 0.285, unit = "m", source = "tape" }
driven = true
[apriori]
mass = { value = 720, unit = "kg", source = "scales" }
"anti_roll_bar.front.k" = { value = 9000, unit = "N/m", source = "supplier" }
"""


def test_a_car_like_that_of_a_vehicle_file_is_driven(
    tmp_path: Path, rig: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, out, truth = tmp_path / "mine.toml", tmp_path / "runs", tmp_path / "truth.json"
    mine.write_text(VEHICLE, encoding="utf-8")
    words = ["--vehicle", mine, "--manoeuvre", "sinus", *SHORT, "--format", "parquet"]
    assert lacet("simulate", "--rig", rig, *words, "-o", out, "--truth", truth) == 0
    said = capsys.readouterr().out
    assert "taken as usual: cog.x" in said
    told = json.loads(truth.read_text(encoding="utf-8"))["runs"][0]
    assert [hidden["name"] for hidden in told["hidden"]] == ["anti_roll_bar.front"]
    written, given = Vehicle.load(out / "kit-car.toml"), Vehicle.load(mine)
    for name, corner in written.corners.items():
        assert corner.position[:2] == pytest.approx(given.corners[name].position[:2], abs=1e-6)
        assert corner.driven == given.corners[name].driven
    run = open_run(out / "sinus.parquet")
    load = sum(np.mean(run.signals[f"wheel.{c}.force"].values[:, 2]) for c in ("fl", "fr", "rl", "rr"))
    assert 0.8 * 720 * 9.81 < load < 720 * 9.81  # at the hubs: without the wheels
    # The geometry written for identifying is not written over the file it came from.
    mine.rename(tmp_path / "kit-car.toml")
    words[1] = tmp_path / "kit-car.toml"
    assert lacet("simulate", "--rig", rig, *words, "-o", tmp_path) == 2
    assert "would be replaced" in capsys.readouterr().err
    assert Vehicle.load(tmp_path / "kit-car.toml").apriori


@pytest.fixture(scope="module")
def on_linkages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run of the car on linkages and what is written beside it, and the truth apart from it."""
    folder = tmp_path_factory.mktemp("linkages")
    words = ["--car", "second", "--manoeuvre", "sinus", "--set", "duration=3", "--set", "amplitude=0.03"]
    out, truth = folder / "runs", folder / "truth" / "truth.json"
    where = ["--format", "parquet", "-o", out, "--truth", truth]
    assert lacet("simulate", "--rig", "peugeot-406", *words, *where) == 0
    return folder


def test_a_car_on_linkages_writes_what_identify_reads_and_keeps_its_truth_apart(on_linkages: Path) -> None:
    out, truth = on_linkages / "runs", on_linkages / "truth" / "truth.json"
    run, vehicle = open_run(out / "sinus.parquet"), Vehicle.load(out / "second.toml")
    assert set(run.signals) == set(STANDARD)
    assert run.vehicle == "second"
    assert all(corner.table is not None for corner in vehicle.corners.values())
    (found,) = json.loads(truth.read_text(encoding="utf-8"))["runs"]
    assert found["design"]["roll_stiffness"][0] > 0.0
    assert "bushings" in found["car"]["linkage"]
    assert all(b"bushing" not in file.read_bytes() for file in out.iterdir())


def test_a_car_on_linkages_is_identified_with_what_was_written_beside_its_runs(
    tmp_path: Path, on_linkages: Path
) -> None:
    """With the joints of its vehicle file the suspension rows come to their floor, without them they do not."""
    shutil.copytree(on_linkages / "runs", tmp_path, dirs_exist_ok=True)
    text = (tmp_path / "second.toml").read_text(encoding="utf-8")
    (tmp_path / "bump.toml").write_text(text[: text.index("[corner.fl.joints.own]")], encoding="utf-8")
    worst = {}
    for vehicle in ("second", "bump"):
        runs = load_runs(tmp_path / "sinus.parquet", rig="peugeot-406", vehicle=tmp_path / f"{vehicle}.toml")
        model, known = base_model(runs), catalogue(runs)
        for effect in ("anti_roll_bar.front", "anti_roll_bar.rear", "axle_damping.rear"):
            model = model + known[effect]
        (rows,) = compare(fit(model, runs)).ratios.values()
        worst[vehicle] = max(ratio for row, ratio in rows.items() if row.startswith("suspension"))
    assert worst["second"] < 1.25
    assert worst["bump"] > 1.35


def test_the_bench_writes_a_table_a_test_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, result = tmp_path / "bench", tmp_path / "result.json"
    words = ["bench", "--car", "second", "--test", "single-left", "--test", "aligning", "-o", out]
    assert lacet(*words, "--json", result) == 0
    assert sorted(file.name for file in out.iterdir()) == ["aligning.csv", "bench.png", "single-left.csv"]
    head, *rows = (out / "single-left.csv").read_text(encoding="utf-8").splitlines()
    assert len(head.split(",")) == len(rows[0].split(","))
    assert [one["steps"] for one in json.loads(result.read_text(encoding="utf-8"))["tables"]] == [len(rows), 7]
    assert (out / "bench.png").read_bytes().startswith(b"\x89PNG")
    assert lacet(*words) == 2
    assert "already there" in capsys.readouterr().err
    assert lacet("bench", "--car", "seconds", "-o", tmp_path / "other") == 2
    assert "did you mean 'second'" in capsys.readouterr().err
    tests = ("single-left", "single-right", "steer")
    words = [word for name in tests for word in ("--test", name)]
    assert lacet("bench", "--car", "second", *words, "-o", tmp_path / "own") == 0
    joints = tmp_path / "joints.toml"
    assert lacet("bench", *(tmp_path / "own" / f"{name}.csv" for name in tests), "-o", joints) == 0
    assert "fl: against own, other, rack" in capsys.readouterr().out
    assert "[corner.rr.joints.other]" in joints.read_text(encoding="utf-8")
