"""What the pages show is true: examples load, faulty ones fail as printed, tables are the code's, commands parse."""

from __future__ import annotations

import itertools
import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest

from lacet.daq import bench_readings
from lacet.daq.channels import AXES, CHANNELS, CORNERS
from lacet.daq.errors import FileFault
from lacet.daq.formats import mf4
from lacet.daq.formats.exchange import METADATA_KEYS, read_table
from lacet.daq.formats.log import LogReader
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.rig import DEFAULT_TOLERANCE, Rig
from lacet.daq.units import TO_SI, canonical
from lacet.daq.vehicle import Vehicle
from lacet.drivers import known_drivers
from lacet.services.commands.__main__ import build_parser
from lacet.simulate.known_cars import KNOWN_CARS
from tests.support.places import HOME

PAGES = sorted([*HOME.glob("*.md"), *(HOME / "docs").rglob("*.md")])
LOADERS = {"docs/rig.md": Rig, "docs/vehicle.md": Vehicle}


def read(page: str | Path) -> str:
    """A page's text."""
    return (HOME / page).read_text(encoding="utf-8")


def blocks(page: str | Path, info: str) -> list[str]:
    """Fenced blocks whose info string is `info`."""
    return re.findall(rf"^```{re.escape(info)}\n(.*?)^```$", read(page), re.MULTILINE | re.DOTALL)


def tables(page: str | Path) -> dict[str, list[list[str]]]:
    """Tables of a page by their first column's heading and section: cells of each row but the heading."""
    out: dict[str, list[list[str]]] = {}
    section, heading = "", None
    for line in read(page).splitlines():
        if line.startswith("#"):
            section = line.lstrip("# ")
        if not line.startswith("|"):
            heading = None
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if heading is None:
            heading = f"{section}: {cells[0]}"
            out[heading] = []
        elif not set(line) <= set("|- "):
            out[heading].append(cells)
    return out


def names(cell: str) -> list[str]:
    """What stands in backticks."""
    return re.findall(r"`([^`]+)`", cell)


@pytest.mark.parametrize("page", LOADERS)
def test_complete_examples_load(page):
    examples = blocks(page, "toml complete")
    assert len(examples) == 2
    for example in examples:
        assert LOADERS[page].parse(example, page).name == tomllib.loads(example)["name"]


@pytest.mark.parametrize("page", LOADERS)
def test_the_faulty_example_fails_as_printed(page):
    (example,), (answer,) = blocks(page, "toml faulty"), blocks(page, "text")
    name = f"my-{LOADERS[page].__name__.lower()}.toml"
    with pytest.raises(FileFault) as raised:
        LOADERS[page].parse(example, name)
    assert str(raised.value) == answer.rstrip()


def test_the_examples_use_every_key_the_pages_name():
    """So that no documented key goes untried (the loaders refuse the unknown ones)."""
    rig = "\n".join(blocks("docs/rig.md", "toml complete"))
    for heading in ("The file: key", "`[bus.NAME]`: key", "`[[sensor]]`: key"):
        for row in tables("docs/rig.md")[heading]:
            key = names(row[0])[0].strip("[]").removesuffix(".NAME")
            used = rig + read("daq/rigs/peugeot-406.toml")
            assert re.search(rf"^\[*(sensor\.)?{key}\b", used, re.MULTILINE), key
    vehicle = "\n".join(blocks("docs/vehicle.md", "toml complete"))
    for heading in ("An axle or corner: key", "`[axle.….kinematics]`: key"):
        for row in tables("docs/vehicle.md")[heading]:
            key = names(row[0])[0]
            assert re.search(rf"^{key} =|\.{key}\]$", vehicle, re.MULTILINE), key


def test_keys_of_the_readers_are_all_documented():
    from lacet.daq import rig, vehicle

    sensor = {names(row[0])[0] for row in tables("docs/rig.md")["`[[sensor]]`: key"]}
    assert sensor == set(rig._SENSOR_KEYS)
    corner = {names(row[0])[0] for row in tables("docs/vehicle.md")["An axle or corner: key"]}
    assert corner == set(vehicle._CORNER_KEYS)
    series = {names(row[0])[0] for row in tables("docs/vehicle.md")["`[axle.….kinematics]`: key"]}
    assert series == {"travel", *vehicle.JOINTS}


def test_the_rig_with_a_dbc_loads_and_its_keys_are_documented():
    from lacet.daq import rig
    from lacet.drivers.framework.message_checks import CHECKSUMS
    from lacet.services.acquisition.stream_decoder import Decoder

    (example,) = blocks("docs/rig.md", "toml dbc")
    assert len(Decoder(Rig.parse(example, "docs/rig.md", HOME / "tests/data/can")).channels) == 5
    rows = tables("docs/rig.md")["A bus by its owner's DBC: key"]
    assert {names(row[0])[0] for row in rows} == set(rig._DBC_KEYS)
    kinds = next(row[1] for row in rows if row[0] == "`checksum`")
    assert set(CHECKSUMS) <= set(names(kinds))


def test_the_sensor_sheet_is_the_code_s():
    found = {names(key)[0]: float(value) for key, value in tables("docs/rig.md")["The sensor sheet: other key"]}
    for family, *values in tables("docs/rig.md")["The sensor sheet: family"]:
        for kind, value in zip(("zero", "gain", "drift"), values, strict=True):
            if value != "–":
                found[f"{names(family)[0]}.{kind}"] = float(value)
    assert found == DEFAULT_TOLERANCE


def test_the_channel_table_is_the_vocabulary():
    rows = tables("docs/channels.md")["Channels and exchange tables: channel"]
    found = {}
    for name, components, unit, axes, rate, noise, _ in rows:
        pattern = names(name)[0]
        for corner in CORNERS if "{c}" in pattern else ("",):
            parts = () if components == "–" else tuple(components.split())
            found[pattern.replace("{c}", corner)] = (parts, unit, axes, float(rate), float(noise))
    assert found == {c.name: (c.components, c.unit, c.axes, c.rate, c.noise) for c in CHANNELS.values()}


def test_axes_units_and_metadata_keys_are_all_there():
    text = read("docs/channels.md")
    assert set(re.findall(r"^- \*\*(\w+)\*\*:", text, re.MULTILINE)) == set(AXES)
    assert {names(row[0])[0] for row in tables("docs/channels.md")["Exchange table: key"]} == set(METADATA_KEYS)
    units = {names(row[0])[0]: set(names(row[1])) for row in tables("docs/vehicle.md")["Units: dimension"]}
    expected: dict[str, set[str]] = {}
    for written, (si, _) in TO_SI.items():
        expected.setdefault(si, set()).add(written)
    assert units == expected
    assert canonical("kg*m^2") == "kg·m²"


def test_the_csv_example_reads(tmp_path):
    (csv,), (metadata,) = blocks("docs/channels.md", "csv"), blocks("docs/channels.md", "json")
    (tmp_path / "run.csv").write_text(csv, encoding="utf-8")
    (tmp_path / "run.json").write_text(metadata, encoding="utf-8")
    run = read_table(tmp_path / "run.csv")
    assert run.problems == ()
    assert set(run.signals) == {"wheel.fl.force", "wheel.fl.moment", "laser.fl.hub"}
    assert run.signals["wheel.fl.force"].usable.tolist() == [True, True, False]
    assert {key: getattr(run, key) for key in json.loads(metadata)} == json.loads(metadata)


def test_fragments_of_a_vehicle_file_fit_into_a_whole_one():
    fragments = blocks("docs/vehicle.md", "toml fragment")
    whole = blocks("docs/vehicle.md", "toml complete")[1]
    (line,) = blocks("docs/vehicle.md", "toml")
    whole, replaced = re.subn(r"^wheelbase = .*$", line.strip(), whole, flags=re.MULTILINE)
    assert (len(fragments), replaced) == (3, 1)
    assert Vehicle.parse("\n".join([whole, *fragments]), "docs/vehicle.md").name == "other-car"


def test_the_maps_of_the_pages_are_read(tmp_path):
    (example,) = blocks("docs/maps.md", "toml complete")
    assert ChannelMap.parse(example, "docs/maps.md").metadata["manoeuvre"] == "slalom"
    (example,) = blocks("docs/bench.md", "toml fragment")
    (tmp_path / "rig.map.toml").write_text(example, encoding="utf-8")
    assert bench_readings._map(tmp_path / "rig.map.toml")["toe.fl"] == ("Steer_LF", -1.0, "deg")
    (example,) = blocks("docs/channels.md", "toml")
    (tmp_path / "run.toml").write_text(example, encoding="utf-8")
    assert mf4.read_map(tmp_path / "run.toml")[0]["wheel.fl.force.y"].scale == -1.0


def test_the_gnss_receiver_of_the_page_is_a_sensor():
    (example,) = blocks("docs/wires/nmea.md", "toml")
    head = 'format = "lacet-rig 1"\nname = "car"\n[bus.serial0]\nkind = "serial"\nbaud = 9600\n'
    (sensor,) = Rig.parse(head + example, "docs/wires/nmea.md").sensors
    assert sensor.driver == "nmea"


def test_the_python_of_the_run_log_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(HOME / "replay_logs" / "nothing-hidden" / "sinus.mcap", "run.mcap")
    (example,) = blocks("docs/log.md", "python")
    known = {}
    exec(compile(example, "docs/log.md", "exec"), known)
    assert len(known["frames"]) > 1000
    assert LogReader("whole.mcap").damage == []


def test_the_drivers_of_the_examples_exist():
    for example in blocks("docs/rig.md", "toml complete"):
        for sensor in Rig.parse(example).sensors:
            assert sensor.driver is None or sensor.driver in known_drivers()


SIMULATED = {("vehicle", name) for name in KNOWN_CARS}
"""Cars of the simulator need no vehicle file."""


def commands() -> list[tuple[str, str]]:
    """(page, line) of every ``lacet …`` line in a fenced block that is not an outline (with an ellipsis)."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for body in re.findall(r"^```(?:sh|console|bash)?\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
            lines = body.replace("\\\n", " ").splitlines()
            found += [
                (str(page.relative_to(HOME)), line.removeprefix("$ ").removeprefix(".venv/bin/"))
                for line in lines
                if re.match(r"(\$ )?(\.venv/bin/)?lacet ", line) and "…" not in line and "..." not in line
            ]
    return found


def arguments(line: str) -> list[str]:
    """Words after ``lacet``, up to what the shell takes (``&``, ``|``, ``>``) or a column of prose."""
    shell = re.split(r"\s{3,}(?=\S)", line)[0]
    words = shlex.split(shell, comments=True)
    return list(itertools.takewhile(lambda word: word not in ("&", "&&", "|", ">", ";"), words))[1:]


@pytest.mark.parametrize(("page", "line"), commands())
def test_commands_parse_and_name_shipped_files(page, line):
    parsed = build_parser().parse_args(arguments(line))
    for option, kind in (("rig", Rig), ("vehicle", Vehicle)):
        given = getattr(parsed, option, None)
        if given is not None and "." not in str(given) and (option, str(given)) not in SIMULATED:
            kind.load(str(given))


def test_there_are_commands_in_the_pages():
    assert len(commands()) >= 5


@pytest.mark.parametrize("page", [str(page.relative_to(HOME)) for page in PAGES])
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", read(page)):
        assert ((HOME / page).parent / target).exists(), target


LONGEST = 1600
"""Words of prose that a page may have: beyond, nobody finds an answer in a minute. Source: a choice."""
ALL_READ = 21_000
"""The same of all pages that are read, and not looked up in, together: an hour and three quarters. Source: a choice."""
LOOKED_UP = ("reference", "benchmarks", "wires")
"""Folders of pages that are looked up in; so are the pages that index.md lists as reference, and the glossary."""
COLLECTIONS = ("CHANGELOG.md", "docs/catalogue.md", "docs/glossary.md", "docs/json.md")
"""Pages of entries, each of which is read by itself."""


def prose(text: str) -> int:
    """Words outside code blocks and tables."""
    plain = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    return sum(len(line.split()) for line in plain.splitlines() if not line.startswith("|"))


def test_pages_are_short():
    assert prose("two words\n| a | table |\n```sh\nlacet doctor\n```\n") == 2
    lengths = {str(page.relative_to(HOME)): prose(page.read_text(encoding="utf-8")) for page in PAGES}
    long = {page: words for page, words in lengths.items() if words > LONGEST}
    assert {page for page in long if page not in COLLECTIONS and "reference" not in page} == set()


def test_all_pages_that_are_read_take_less_than_two_hours():
    looked_up = re.split(r"^\*\*Reference\*\*|^\*\*Terms\*\*", read("docs/index.md"), flags=re.MULTILINE)[1]
    names = {HOME / "docs" / name for name in re.findall(r"\]\(([\w-]+\.md)\)", looked_up)}
    assert HOME / "docs" / "json.md" in names
    names |= {HOME / "docs" / "index.md", HOME / "docs" / "glossary.md"}
    pages = [HOME / "README.md", HOME / "CONTRIBUTING.md", *(HOME / "docs").rglob("*.md")]
    lengths = [prose(read(page)) for page in pages if page not in names and not set(LOOKED_UP) & set(page.parts)]
    assert len(lengths) > 50
    assert ALL_READ / 2 < sum(lengths) <= ALL_READ
