"""`--json`: docs/json.md lists exactly the keys that commands write."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lacet.daq.formats.result import DONE, FORMAT, WITH_LOSSES
from lacet.daq.rig import Rig
from lacet.services.commands.__main__ import find_commands, main
from lacet.services.commands.check import QUESTIONS
from tests.support.candidates import few_candidates
from tests.support.processes import ROOT, Command, commands
from tests.support.rig import make_capture
from tests.support.tables import CAR, FILES, piece, without, written

PAGE = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")


ENTRY = re.compile(r"^\| `(?P<keys>[^`]+)` \| (?P<type>[^|]*?) ?\|", re.MULTILINE)
"""One row of the page's tables: keys, type, meaning."""

TYPES: dict[str, Callable[[Any], bool]] = {
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "object": lambda value: isinstance(value, dict),
    "list": lambda value: isinstance(value, list),
    "strings": lambda value: isinstance(value, list) and all(isinstance(one, str) for one in value),
    "numbers": lambda value: isinstance(value, list) and all(isinstance(one, int | float) for one in value),
    "nulls": lambda value: isinstance(value, list) and all(one is None or isinstance(one, float) for one in value),
    "null": lambda value: value is None,
}


def section(heading: str) -> str:
    """The text under a heading, up to the next one."""
    return re.split(r"^#", re.split(rf"^#+ {heading}\n", PAGE, flags=re.MULTILINE)[1], maxsplit=1, flags=re.MULTILINE)[
        0
    ]


def entries(text: str) -> Iterator[tuple[str, str, bool]]:
    """(path, type, whether it is optional) of each key of a section; `a.{b, c}` are two, an object has its keys."""
    for entry in ENTRY.finditer(text):
        kind, optional = re.subn(r"\*optional\*,? ?", "", entry["type"] or "")
        for path in written_out(entry["keys"]):
            if link := re.match(r"\[([^]]+)\]", kind):
                yield from ((f"{path}.{below}", type_, False) for below, type_, _ in entries(section(link[1])))
            else:
                yield path, kind or COMMON.get(path.rpartition(".")[2], "string"), bool(optional)


def written_out(path: str) -> list[str]:
    """`a.{b, c}` → `a.b`, `a.c`."""
    if (braces := re.search(r"\{([^}]+)\}", path)) is None:
        return [path]
    start, stop = braces.span()
    return [one for part in braces[1].split(", ") for one in written_out(path[:start] + part + path[stop:])]


COMMON = {entry["keys"]: entry["type"] or "string" for entry in ENTRY.finditer(section("Keys of all commands"))}
"""Key → type, of keys that mean the same in every command."""


def documented(command: str) -> tuple[dict[str, Any], set[str]]:
    """The tree of keys a section lists, with the types at its leaves under "", and the optional ones."""
    tree: dict[str, Any] = {"format": {"": "string"}, "command": {"": "string"}}
    optional: set[str] = set()
    for path, kind, sometimes in entries(section(command)):
        node = tree
        for part in path.replace("[]", ".[]").split("."):
            node = node.setdefault(part, {})
        node[""] = kind
        if sometimes:
            optional.add(path)
    return tree, optional


def check(value: Any, tree: dict[str, Any], optional: set[str], place: str = "") -> None:
    """Every key is documented and has its type, and every documented key is there."""
    below = {key: node for key, node in tree.items() if key}
    if kind := tree.get(""):
        kinds = kind.replace(" or ", " ").split()
        assert any(TYPES[one](value) for one in kinds), f"{place}: {value!r} is not {kind}"
    if not below or value is None:
        return
    if "[]" in below:
        assert isinstance(value, list), place
        for item in value:
            check(item, below["[]"], optional, f"{place}[]")
    elif "*" in below:
        for key, item in value.items():
            check(item, below["*"], optional, f"{place}.{key}")
    else:
        assert set(value) <= set(below), place
        assert set(below) - set(value) <= optional, place
        for key, item in value.items():
            check(item, below[key], optional, f"{place}.{key}")


def conforms(file: Path, command: str) -> dict[str, Any]:
    """A result file against its section."""
    text = file.read_text(encoding="utf-8")
    result = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert (result["format"], result["command"]) == (FORMAT, command)
    check(result, *documented(command), command)
    return result


def test_every_command_has_its_section_and_takes_json():
    assert set(re.findall(r"^## (\S+)$", PAGE, re.M)) == set(find_commands())
    for name, module in find_commands().items():
        module.add_arguments(argparse.ArgumentParser())
        assert f'"{name}"' in Path(str(module.__file__)).read_text(encoding="utf-8"), name


def test_identify_study_compare_diagnose_and_add(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("lacet.services.commands.identify.SCORE_DRAWS", 3)
    monkeypatch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)
    used = str(written(piece("sine", 5.0, 12.0), tmp_path / "used.parquet"))
    held = str(written(piece("sweep", 5.0, 12.0), tmp_path / "held.parquet"))
    folder, file = str(tmp_path / "study"), tmp_path / "result.json"

    def run(*argv: str, status: int = DONE) -> dict[str, Any]:
        assert main([*argv, "--json", str(file)]) == status
        return conforms(file, argv[0])

    fitted = run("identify", used, *FILES)
    assert fitted["warnings"] == []
    assert {"spring.fl.k"} <= {p["name"] for p in fitted["parameters"]}
    for p in fitted["parameters"]:
        assert p["interval95"] == pytest.approx([p["value"] - p["half95"], p["value"] + p["half95"]])
    made = run("study", "new", folder, "--use", used, "--hold", held, *FILES, "--draws", "19")
    assert [v["version"] for v in made["versions"]] == [1]
    compared = run("compare", folder, "--no-pictures")
    assert compared["wheel_forces"]["held"]["wheel.fl.force_estimated.z"]["inside"] > 0.0
    bare, table = tmp_path / "bare.parquet", tmp_path / "forces.csv"
    pq.write_table(drop_loads(pq.read_table(held)), bare)
    forces = run("forces", folder, str(bare), "-o", str(table), "--no-picture")
    assert all(one["error"] is None for one in forces["forces"].values())
    assert table.read_text("utf-8").startswith("t,wheel.fl.force_estimated.z,wheel.fl.force_estimated.z.half95,")
    broken = pq.read_table(bare)
    laser = broken["laser.fl.hub"].to_numpy().copy()
    laser[-200:] = -9999.0
    place = broken.column_names.index("laser.fl.hub")
    pq.write_table(broken.set_column(place, "laser.fl.hub", pa.array(laser)), bare)
    doubted = run("forces", folder, str(bare), "--no-picture", status=WITH_LOSSES)
    assert [said[:36] for said in doubted["warnings"]] == ["laser.fl.hub stands still at -9999 f"]
    assert 0.0 < doubted["instants"] < forces["instants"]
    looked = run("where", folder, "--run", "held")
    assert looked["left"] == {}  # seven seconds are too short for cross-validation
    assert set(looked["phases"]) == {"held"}
    few_candidates(monkeypatch, "anti_roll_bar", "coulomb", "damper_stroke", "chassis_torsion", "sensor_gain")
    ranked = run("diagnose", folder)
    assert {c["answer"] for c in ranked["candidates"]} <= {
        "missing",
        "undecided",
        "stands in",
        "implausible size",
        "smaller than asked for",
        "not needed",
        "not testable",
    }
    added = run("add", folder, "anti_roll_bar.front")
    assert added["held"]["after"] < added["held"]["before"]


def drop_loads(table: pa.Table) -> pa.Table:
    """An exchange table as a car without dynamometers records it."""
    return table.drop_columns([name for name in table.column_names if re.match(r"wheel\...\.(force|moment)", name)])


def test_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run, file, rig = (
        written(piece("rough", 4.0, 14.0), tmp_path / "rough.parquet"),
        tmp_path / "check.json",
        tmp_path / "rig",
    )
    bars = ("--add", "anti_roll_bar.front", "--add", "anti_roll_bar.rear")
    assert main(["check", str(run), *FILES, *bars, "--write-rig", str(rig), "--json", str(file)]) == 0
    result = conforms(file, "check")
    assert result["bias"]["plain"]["p"] < 0.01 < result["bias"]["corrected"]["p"]
    assert {
        n["verdict"] for n in result["noise"] if n["family"].startswith(("wheel", "imu", "laser.hub", "camera"))
    } == {"as the sheet"}
    latency = {s["sensor"]: s for s in result["latency"]["sensors"]}
    assert latency["imu"]["agrees"]
    assert latency["correvit"]["half95"] is None
    assert result["agreement"] == []
    assert [one["axis"] for one in result["position"]] == ["x", "y", "z"]
    assert all(one["agrees"] for one in result["position"] if one["testable"])
    assert Rig.load(rig) == replace(Rig.load(CAR / "rig.toml"), folder=tmp_path, text=rig.read_text("utf-8"))
    text = capsys.readouterr().out
    for part in ("time base", "not testable with these runs", "agrees with the instruments", "agree within the sheet"):
        assert part in text
    assert main(["check", str(run), *FILES, "--only", "noise", "--json", str(file)]) == 0
    assert set(conforms(file, "check")) & {*QUESTIONS} == {"noise"}


def test_check_names_a_unit_elsewhere_by_the_speed_sensor_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    driven = piece("sine", 2.0, 22.0)
    run, file, rig = written(driven, tmp_path / "sine.parquet"), tmp_path / "check.json", tmp_path / "rig.toml"
    text = (CAR / "rig.toml").read_text(encoding="utf-8")
    changed = text.replace("position = [-1.35, 0.1, 0.31]", "position = [-1.65, 0.1, 0.31]")
    assert changed != text
    rig.write_text(changed, encoding="utf-8")
    command = ["check", str(run), "--rig", str(rig), "--vehicle", str(CAR / "vehicle.toml"), "--only", "agreement"]
    assert main([*command, "--json", str(file)]) == 0
    (found,) = conforms(file, "check")["agreement"]
    assert (found["effect"], found["unit"]) == ("sensor_position.imu.x", "m")
    assert abs(found["value"] - 0.3) < 1.5 * found["half95"] < 0.15
    said = capsys.readouterr().out
    assert "sensor_position.imu.x" in said
    assert "the speed sensor is elsewhere, as far the other way" in said
    written(without(driven, "correvit.speed"), run)
    assert main([*command, "--json", str(file)]) == 0
    assert conforms(file, "check")["agreement"] is None
    assert "not compared" in capsys.readouterr().out


def test_info_decode_export_and_replay(tmp_path: Path):
    raw, log, file = tmp_path / "raw.mcap", tmp_path / "log.mcap", tmp_path / "result.json"
    make_capture(raw, 1.0, 47110)
    for argv in (
        ["decode", raw, "-o", log],
        ["recover", raw, "-o", tmp_path / "whole.mcap"],
        ["export", "--rows", log, "-o", tmp_path / "rows.mcap"],
        ["info", log],
        ["info", raw],
        ["info", CAR / "rig.toml"],
        ["info", CAR / "vehicle.toml"],
        ["info", "--channels", "--effects", "--rows"],
    ):
        assert main([*map(str, argv), "--json", str(file)]) == 0
        conforms(file, str(argv[0]))
    with commands() as running:
        running.append(Command("replay", raw, "--bus", "udp0", "--speed", "max", "--json", file, cwd=tmp_path))
        running[0].wait()
    conforms(file, "replay")


def test_standard_output_carries_the_result_alone(capsys: pytest.CaptureFixture[str]):
    assert main(["info", "--rows", "--json", "-"]) == 0
    out = capsys.readouterr()
    assert json.loads(out.out)["command"] == "info"
    assert "chassis.fx" in out.err
