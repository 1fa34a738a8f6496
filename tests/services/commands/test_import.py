"""``lacet import`` and ``--map``: raw logs of others as inputs of the commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from lacet.daq.formats.open_run import open_run
from lacet.services.commands.__main__ import main
from lacet.services.workspace.study import Study
from tests.services.commands.test_json import conforms
from tests.support.foreign_logs import MAP_HEAD, foreign, write_csv
from tests.support.places import HOME
from tests.support.tables import piece

CAN = HOME / "tests" / "data" / "can"


def car_csv(folder: Path, name: str = "sine") -> tuple[Path, Path]:
    """A spreadsheet of the reference car and its map."""
    t, columns, channels = foreign(piece(name, 5.0, 12.0))
    write_csv(folder / f"{name}.csv", t, columns)
    (folder / "car.toml").write_text(MAP_HEAD + channels)
    return folder / f"{name}.csv", folder / "car.toml"


def test_a_real_car_s_bus_is_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.toml").write_text(
        'format = "lacet-map 1"\n[channels]\n"car.yaw_rate" = "GYRO_YAW"\n"car.lateral_accel" = "ACCEL_LAT"\n'
        '"steering.angle" = "STEER_ANGEL"\n'
    )
    out, result = tmp_path / "lap.mcap", tmp_path / "r.json"
    words = ["import", CAN / "road-car.candump.log", "--map", tmp_path / "m.toml", "--dbc", CAN / "road-car.dbc"]
    words += ["-o", out]
    assert main([*map(str, words), "--json", str(result)]) == 3
    found = conforms(result, "import")
    assert set(found["samples"]) == {"car.yaw_rate", "car.lateral_accel"}
    printed = capsys.readouterr().out
    assert "did you mean 'ID_D0.STEER_ANGLE'" in printed
    assert f"name its vehicle and rig file: in [run] of {tmp_path / 'm.toml'}" in printed
    run = open_run(out)
    assert run.duration == pytest.approx(12.0, abs=0.1)
    assert any("steering.angle was left out" in problem for problem in run.problems)
    assert main([*map(str, words)]) == 2  # nothing is replaced


@pytest.mark.parametrize("suffix", ["mcap", "parquet"])
def test_a_pause_is_told_and_lasts_as_long_in_info(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"{0.01 * k:.2f},{k % 7}" for k in range(1000) if not 300 < k < 500]
    (tmp_path / "lap.csv").write_text("\n".join(["t,V [m/s]", *lines]) + "\n")
    (tmp_path / "m.toml").write_text('format = "lacet-map 1"\n[channels]\n"car.speed" = "V"\n')
    out = tmp_path / f"lap.{suffix}"
    words = ["import", tmp_path / "lap.csv", "--map", tmp_path / "m.toml", "-o", out]
    assert main(list(map(str, words))) == 3
    assert "! no samples of car.speed from 3.00 to 5.00 s" in capsys.readouterr().out
    main(["info", str(out)])
    assert "no samples of car.speed from 3.00 to 5.00 s" in capsys.readouterr().out


def test_a_damaged_log_leaves_no_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "lap.mf4").write_bytes((CAN / "canedge-gps-imu.mf4").read_bytes()[:3000])
    (tmp_path / "m.toml").write_text('format = "lacet-map 1"\n[channels]\n"gnss.speed" = "Speed"\n')
    words = ["import", tmp_path / "lap.mf4", "--map", tmp_path / "m.toml", "-o", tmp_path / "lap.mcap"]
    assert main(list(map(str, words))) == 2
    assert "lap.mf4" in capsys.readouterr().err
    assert [p.name for p in tmp_path.glob("lap.mcap*")] == []


def test_identify_study_and_info_take_a_log_with_a_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("lacet.services.commands.identify.SCORE_DRAWS", 3)
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)
    file, map_ = car_csv(tmp_path)
    result = tmp_path / "r.json"
    assert main(["info", str(file), "--map", str(map_)]) in (0, 3)
    said = capsys.readouterr().out
    assert re.search(r"^  wheel .*\bfl\b.*\bforce\b.* 1750  250.0$", said, re.MULTILINE)
    assert "unusable samples: none" in said
    assert main(["identify", str(file), "--map", str(map_), "--json", str(result)]) in (0, 3)
    springs = {p["name"]: p["value"] for p in json.loads(result.read_text())["parameters"]}
    assert 10_000 < springs["spring.fl.k"] < 60_000
    study = tmp_path / "study"
    assert main(["study", "new", str(study), "--use", str(file), "--map", str(map_), "--draws", "19"]) in (0, 3)
    (kept,) = Study.open(study).paths()
    assert kept.name == "sine.mcap"
    assert kept.parent.parent == study


def test_a_log_without_a_map_is_refused_with_the_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, _ = car_csv(tmp_path)
    assert main(["identify", str(file)]) == 2
    said = capsys.readouterr().err
    assert "lacet map --guess" in said
    assert "--map map.toml" in said


def test_the_workbench_shows_a_raw_bus_log_beside_a_map(tmp_path: Path) -> None:
    """Files dropped into a study's folder of runs: the log, its DBC, and the map for all of them."""
    from lacet.services.workbench.run_channels import RunChannels, state_key
    from lacet.services.workbench.run_files import summary
    from lacet.services.workbench.uploads import safe_name

    names = ["road-car.candump.log", "road-car.dbc", "map.toml"]
    assert [safe_name(name) for name in names] == names
    for name in names[:2]:
        (tmp_path / name).write_bytes((CAN / name).read_bytes())
    text = 'format = "lacet-map 1"\n[read]\ndbc = "road-car.dbc"\n[channels]\n"car.yaw_rate" = "GYRO_YAW"\n'
    (tmp_path / "map.toml").write_text(text)
    log = tmp_path / names[0]
    before = state_key(log)
    found = summary(log, RunChannels(tmp_path))
    assert [one["name"] for one in found["channel_list"]] == ["car.yaw_rate"]
    assert found["seconds"] == pytest.approx(12.0, abs=0.1)
    (tmp_path / "map.toml").write_text(text + '"car.speed" = "SPEED"\n')
    assert state_key(log) != before  # another map is another run
    assert len(summary(log, RunChannels(tmp_path))["channel_list"]) == 2


def test_the_workbench_counts_no_empty_cells_between_samples(tmp_path: Path) -> None:
    """A table with the stamps of two instruments, neither of them at all."""
    from lacet.services.workbench.run_channels import RunChannels
    from lacet.services.workbench.run_files import summary

    ms = [t for t in range(2000) if t % 2 == 0 or t % 5 == 0]
    lines = [f"{t / 1000},{'' if t % 2 else 1.0},{'' if t % 5 else 20.0}" for t in ms]
    table = tmp_path / "run.csv"
    table.write_text("\n".join(["t,car.yaw_rate,car.speed", *lines]) + "\n")
    found = summary(table, RunChannels(tmp_path))
    rates = {one["name"]: (one["samples"], one["flagged"], round(one["rate"])) for one in found["channel_list"]}
    assert rates == {"car.yaw_rate": (1000, 0, 500), "car.speed": (400, 0, 200)}
    assert not any("cannot be used" in line for line in found["says"])


def test_a_campaign_imports_logs_by_a_map_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Up to the workers, which are given the imported runs."""
    from contextlib import nullcontext
    from types import SimpleNamespace

    from lacet.daq.errors import UsageError
    from lacet.services.commands import campaign

    given: list[list[str]] = []

    def runs_of(_: object, places: list[str], __: object) -> None:
        given.append(places)
        assert "wheel.fl.force" in open_run(places[0]).signals
        raise UsageError("far enough")

    monkeypatch.setattr(campaign, "connected", lambda *_: nullcontext(SimpleNamespace(dashboard_link="")))
    monkeypatch.setattr(campaign, "Cluster", lambda *_: None)
    monkeypatch.setattr(campaign, "Campaign", SimpleNamespace(of=runs_of))
    file, map_ = car_csv(tmp_path)
    words = ["campaign", str(file), "--map", str(map_)]
    assert main([*words, "--keep", str(tmp_path / "sums")]) == 2
    assert "far enough" in capsys.readouterr().err
    assert main(words) == 2
    assert given[0] == [str(tmp_path / "sums/runs/sine.mcap")]
    assert Path(given[0][0]).exists()
    assert not Path(given[1][0]).exists()  # of that campaign alone
    assert main([*words, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "a folder that its workers see: --keep FOLDER" in capsys.readouterr().err
    assert main(["campaign", "s3://runs/lap.csv", "--map", str(map_)]) == 2
    assert "s3://runs/lap.csv: --map imports files of this machine" in capsys.readouterr().err


FD_J1939_MULTIPLEXED = """\
VERSION ""
BO_ 258 Muxed: 8 X
 SG_ Which M : 0|8@1+ (1,0) [0|255] "" X
 SG_ Fl m0 : 8|16@1+ (0.1,0) [0|0] "rpm" X
 SG_ Fr m1 : 8|16@1+ (0.1,0) [0|0] "rpm" X
BO_ 259 Wide: 48 X
 SG_ Force : 320|32@1- (1,0) [0|0] "N" X
BO_ 2364540158 Eec1: 8 X
 SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" X
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2364540158 3;
SIG_VALTYPE_ 259 Force : 1;
"""


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc"])
def test_can_fd_j1939_and_multiplexed_signals_of_a_log(tmp_path: Path, suffix: str) -> None:
    """A log that another library writes."""
    import can
    import numpy as np

    rows = []
    for i in range(20):
        muxed = bytes([i % 2]) + (100 * i).to_bytes(2, "little") + bytes(5)
        wide = bytes(40) + np.float32(1.5 * i).tobytes() + bytes(4)
        engine = bytes(3) + (800 * i).to_bytes(2, "little") + bytes(3)
        sender = [0x0CF00400, 0x18F00400][i % 2]  # another priority
        rows += [(0x102, False, muxed), (0x103, False, wide), (sender, True, engine)]
    with can.Logger(str(tmp_path / f"lap{suffix}")) as writer:
        for i, (ident, extended, data) in enumerate(rows):
            writer(can.Message(timestamp=1.6e9 + 0.01 * i, arbitration_id=ident, is_extended_id=extended, data=data,
                               is_fd=len(data) > 8, channel=0, is_rx=True))  # fmt: skip
    (tmp_path / "car.dbc").write_text(FD_J1939_MULTIPLEXED)
    (tmp_path / "m.toml").write_text(
        'format = "lacet-map 1"\n[read]\ndbc = "car.dbc"\n[channels]\n"wheel.fl.speed" = "Fl"\n'
        '"wheel.fr.speed" = "Fr"\n"damper.fl.force" = "Force"\n"engine.speed" = "EngineSpeed"\n'
    )
    words = ["import", tmp_path / f"lap{suffix}", "--map", tmp_path / "m.toml", "-o", tmp_path / "lap.mcap"]
    assert main(list(map(str, words))) == 0
    signals, rpm = open_run(tmp_path / "lap.mcap").signals, np.pi / 30
    for name, wanted in {
        "wheel.fl.speed": rpm * 10 * np.arange(0, 20, 2), "wheel.fr.speed": rpm * 10 * np.arange(1, 20, 2),
        "damper.fl.force": 1.5 * np.arange(20), "engine.speed": rpm * 100 * np.arange(20),
    }.items():  # fmt: skip
        np.testing.assert_allclose(signals[name].values[:, 0], wanted)


def test_j1939_of_a_real_car_s_log(tmp_path: Path) -> None:
    """The CANedge's other bus carries it; the layout of the engine's message is the standard's."""
    (tmp_path / "car.dbc").write_text(FD_J1939_MULTIPLEXED)
    (tmp_path / "m.toml").write_text(
        'format = "lacet-map 1"\n[read]\ndbc = "car.dbc"\n[channels]\n"engine.speed" = "EngineSpeed"\n'
    )
    words = ["import", CAN / "canedge-gps-imu.mf4", "--map", tmp_path / "m.toml", "-o", tmp_path / "lap.mcap"]
    assert main(list(map(str, words))) in (0, 3)
    speed = open_run(tmp_path / "lap.mcap").signals["engine.speed"]
    assert len(speed.t) > 100
    assert 500 < speed.values.min() * 30 / 3.1416 < speed.values.max() * 30 / 3.1416 < 4000


def test_proposals_kept_as_comments_are_named_and_a_clock_that_a_log_lacks_once_a_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, map_ = car_csv(tmp_path)
    text = map_.read_text(encoding="utf-8")
    rare = text.replace('"wheel.fl.force.x" = ', '# "wheel.fl.force.x" = ').replace(
        '"imu.accel.x" = ', '# "imu.accel.x" = '
    )
    assert rare.count('# "') == text.count('# "') + 2
    map_.write_text(rare + '# "laser.fl.hub" = "x"\n', encoding="utf-8")  # a channel that the map has
    words = ["import", str(log), "--map", str(map_), "--rig", "peugeot-406", "-o", str(tmp_path / "lap.mcap")]
    assert main(words) == 3
    assert f"2 proposals are comments in {map_}: look at them" in capsys.readouterr().out
    clocks = [one for one in open_run(tmp_path / "lap.mcap").problems if "device clock" in one]
    assert clocks == ["cameras, imu: the rig asks for the device clock, the log has none: stamps are arrivals"]
