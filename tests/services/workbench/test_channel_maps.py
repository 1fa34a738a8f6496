"""Channel maps from the page: proposals, checks by entry, and a log that becomes a run."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient

from lacet.daq.formats.open_run import open_run
from lacet.daq.maps.channel_map import ChannelMap
from lacet.services.workbench.server import Settings, create_app
from tests.services.workbench.bench_page import Page
from tests.support.tables import piece

G = 9.80665
NAMES = ("LongAcc", "LatAcc", "VertAcc")


def foreign_log(file: Path) -> np.ndarray:
    """A table of another system with the accelerations of a reference run in g; returns them in m/s²."""
    signal = piece("sine", 5.0, 8.0).signals["imu.accel"]
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["Time [s]", *(f"{name} [g]" for name in NAMES), "Laptimer"])
        for t, row in zip(signal.t, signal.values, strict=True):
            writer.writerow([f"{t:.6f}", *(f"{v / G:.9f}" for v in row), 0])
    return np.asarray(signal.values)


def test_a_log_of_another_system_becomes_a_run(tmp_path: Path):
    folder = tmp_path / "new"
    (folder / "runs").mkdir(parents=True)
    values = foreign_log(folder / "runs" / "lap.csv")
    with TestClient(create_app(Settings(folder)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)
        (run,) = page.get("runs")
        assert (run["by_map"], run["quality"]) == (True, "cannot be read")
        found = page.get("runs/lap/map")
        names = {one["name"]: one for one in found["names"]}
        assert set(NAMES) <= set(names)
        assert names["LatAcc"]["unit"] == "g"
        assert names["LatAcc"]["high"] == pytest.approx(values[:, 1].max() / G)
        assert "LatAcc" in found["proposals"]["imu.accel.y"]["expression"]
        assert 0.0 < found["proposals"]["imu.accel.y"]["probability"] <= 1.0
        entries = {f"imu.accel.{axis}": name for axis, name in zip("xyz", NAMES, strict=True)}
        wrong = page.post(
            "runs/lap/map", {"entries": {**entries, "imu.rate.x": "LatAcc + 3 mm", "imu.rate.y": "Nothing"}}
        )
        assert "g" in wrong["columns"]["imu.rate.x"]["fault"] or wrong["columns"]["imu.rate.x"]["low"] is None
        assert wrong["columns"]["imu.rate.y"]["low"] is None
        right = page.post("runs/lap/map", {"entries": entries})
        assert right["makes_run"]
        assert right["columns"]["imu.accel.x"]["high"] == pytest.approx(values[:, 0].max(), rel=1e-5)
        assert not list((folder / "runs").glob("*.toml")), "a check writes nothing"
        page.post("runs/lap/map", {"entries": {"imu.accel.y": "LatAcc + 3 mm"}}, 200)
        page.client.post("/api/runs/lap/map?keep=true", json={"entries": {"imu.accel.y": "Nothing"}}).json()
        assert not list((folder / "runs").glob("*.toml")), "what makes no run is not kept"
        for _ in range(2):
            assert page.post("runs/lap/map?keep=true", {"entries": entries, "units": {"Laptimer": "s"}})["kept"]
        map_ = ChannelMap.load(folder / "runs" / "lap.map.toml")
        assert set(map_.channels) == set(entries)
        assert map_.said("Laptimer").unit == "s"
        assert len(list((folder / "removed").iterdir())) == 1
        (run,) = page.get("runs")
        assert (run["quality"], run["channels"]) == ("good", 1)
        assert page.get("runs/lap/map")["entries"] == entries
        assert page.get("runs/lap/map")["map"] == "lap.map.toml"
    made = open_run(folder / "runs" / "lap.csv").signals["imu.accel"].values
    assert made == pytest.approx(values, abs=1e-6)


def test_what_the_page_does_not_edit_stays(tmp_path: Path):
    folder = tmp_path / "new"
    (folder / "runs").mkdir(parents=True)
    foreign_log(folder / "runs" / "lap.csv")
    written = """format = "lacet-map 1"
[run]
manoeuvre = "slalom"
[sources]
"Lap*" = { unit = "s", delay = "4 ms" }
[channels]
"imu.accel.x" = "LongAcc"
"imu.accel.y" = { from = "LatAcc", delay = "12 ms" }
"imu.accel.z" = "VertAcc"
"""
    (folder / "runs" / "lap.map.toml").write_text(written, encoding="utf-8")
    with TestClient(create_app(Settings(folder)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)
        found = page.get("runs/lap/map")
        delayed = {"from": "LatAcc", "delay": "12 ms"}
        assert found["entries"] == {"imu.accel.x": "LongAcc", "imu.accel.y": delayed, "imu.accel.z": "VertAcc"}
        assert (found["kept"], found["units"]) == ([], {"Lap*": "s"})
        entries = {**found["entries"], "imu.accel.x": "-LongAcc"}
        assert page.post("runs/lap/map?keep=true", {"entries": entries, "units": {"Lap*": "min"}})["kept"]
        after = ChannelMap.load(folder / "runs" / "lap.map.toml")
        assert after.metadata["manoeuvre"] == "slalom"
        assert after.channels["imu.accel.y"].delay == pytest.approx(0.012)
        assert (after.said("Laptimer").unit, after.said("Laptimer").delay) == ("min", pytest.approx(0.004))
        assert after.channels["imu.accel.x"].written.text == "-LongAcc"


def test_the_text_of_a_map_stays_where_nothing_is_edited(tmp_path: Path):
    """Comments, order and dotted keys; one entry is changed, one goes, one and a unit come."""
    folder = tmp_path / "new"
    (folder / "runs").mkdir(parents=True)
    foreign_log(folder / "runs" / "lap.csv")
    text = """# Cable 3 was changed on 12 May.
format = "lacet-map 1"

[channels] # all in g
imu.accel.x = "LongAcc" # forwards
imu.accel.y = { from = "LatAcc", delay = "12 ms" } # to the left
# upwards
imu.accel.z = "VertAcc"
engine.speed = "Laptimer * 1 rad/s" # not from this cable
"""
    (folder / "runs" / "lap.map.toml").write_text(text, encoding="utf-8")
    with TestClient(create_app(Settings(folder)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)
        entries = page.get("runs/lap/map")["entries"]
        assert page.post("runs/lap/map?keep=true", {"entries": entries})["kept"]
        assert (folder / "runs" / "lap.map.toml").read_text(encoding="utf-8") == text
        del entries["engine.speed"]
        entries |= {"imu.accel.z": "-VertAcc", "engine.throttle": "Laptimer"}
        assert page.post("runs/lap/map?keep=true", {"entries": entries, "units": {"Laptimer": "1"}})["kept"]
    expected = text.replace('engine.speed = "Laptimer * 1 rad/s" # not from this cable\n', "").replace(
        '"VertAcc"', '"-VertAcc"'
    )
    assert (folder / "runs" / "lap.map.toml").read_text(encoding="utf-8").split() == [
        *expected.split(), 'engine.throttle', "=", '"Laptimer"', "[sources]", "Laptimer", "=", '"1"',
    ]  # fmt: skip


def test_an_entry_has_unit_delay_and_table(tmp_path: Path):
    """Each is checked with its entry; a table is a file beside the log, never one elsewhere."""
    folder = tmp_path / "new"
    (folder / "runs").mkdir(parents=True)
    foreign_log(folder / "runs" / "lap.csv")
    (tmp_path / "secret.csv").write_text("LatAcc [g],imu.accel.y [m/s²]\n0,1\n1,2\n", encoding="utf-8")
    (folder / "runs" / "lookup.csv").write_text("LatAcc [g],imu.accel.y [m/s²]\n-9,0\n9,90\n", encoding="utf-8")
    with TestClient(create_app(Settings(folder)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)

        def checked(**entry: str) -> dict[str, object]:
            entries = {"imu.accel.x": "LongAcc", "imu.accel.z": "VertAcc", "imu.accel.y": {"from": "LatAcc", **entry}}
            return page.post("runs/lap/map", {"entries": entries})["columns"]["imu.accel.y"]

        plain, in_other = checked(), checked(unit="m/s²")
        assert isinstance(plain["high"], float)
        assert in_other["high"] == pytest.approx(plain["high"] / G, rel=1e-6)
        assert checked(table="lookup.csv")["high"] == pytest.approx(45.0 + 5.0 * plain["high"] / G, rel=1e-6)
        for wrong, said in (
            ({"delay": "12"}, "time with its unit"), ({"unit": "xyz"}, "xyz"), ({"table": "none.csv"}, "none.csv"),
            ({"table": "../../secret.csv"}, "beside the log"), ({"table": str(tmp_path / "secret.csv")}, "beside"),
        ):  # fmt: skip
            assert said in str(checked(**wrong)["fault"])
        for none in ({"imu.accel.y": {"from": "LatAcc", "to": "x"}}, {"imu.accel.y": 7}, {"imu.accel.y": {"from": 7}}):
            page.post("runs/lap/map", {"entries": none}, 400)
