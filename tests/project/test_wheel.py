"""The wheel: one top-level package, which an environment with nothing of the checkout in it can work with.

The environment has none of the optional parts: what these tests do is done with ``pip install lacet`` alone.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from lacet.daq.parts import PARTS
from lacet.services.commands.__main__ import find_commands
from tests.support.places import HOME

PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))
CAPTURE = HOME / "replay_logs" / "anti-roll-bars" / "sinus.mcap"
OPTIONAL = sorted(
    {name for part in PARTS.values() for name in part.modules} | {"lxml", "pandas", "pydantic", "starlette"}
)
"""What the optional parts bring, and of what these depend on the heavy packages."""
PRE_COMMITS_IDENTIFY = """\
def tags_from_path(path):
    return {"file"}
"""


def run(*command: object, cwd: Path, **variables: str) -> str:
    """What a command prints, which must succeed; nothing of the checkout is on its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env={**environment, **variables}, capture_output=True, text=True, timeout=240,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as the Dockerfile builds it."""
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=HOME)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel in it, and beside it the locked packages that it depends on.

    These are reached by their folder, in which no ``.pth`` file is followed: the editable lacet is not among them.
    Nor are the optional parts: an import of theirs fails as if they were not installed.
    """
    folder = tmp_path_factory.mktemp("environment")
    uv = (sys.executable, "-m", "uv", "--quiet", "--offline", "--no-cache")
    run(*uv, "venv", "--python", sys.executable, folder / "venv", cwd=folder)
    python = folder / "venv" / "bin" / "python"
    run(*uv, "pip", "install", "--python", python, "--no-deps", wheel, cwd=folder)
    (packages,) = folder.glob("venv/lib/python*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    blocked = f"import sys; sys.modules.update(dict.fromkeys({OPTIONAL}))\n"
    (packages / "without_optional_parts.pth").write_text(blocked, encoding="utf-8")
    return folder / "venv"


def built(kind: str, source: Path, folder: Path, **variables: str) -> Path:
    """The wheel or sdist of a folder."""
    folder.mkdir()
    run(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", folder, cwd=source, **variables)
    (path,) = folder.iterdir()
    return path


def test_an_sdist_gives_the_same_wheel_of_the_same_version(wheel: Path, tmp_path: Path) -> None:
    sdist = built("sdist", HOME, tmp_path / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    (folder,) = (tmp_path / "unpacked").iterdir()
    again = built("wheel", folder, tmp_path / "wheel")
    assert again.name == wheel.name
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


@pytest.mark.parametrize(
    ("commands", "version"),
    [
        ([], r"0\.1\.dev0"),
        (["init -q", "add README.md", "commit -q -m one"], r"0\.1\.dev1\+g[0-9a-f]+(\.d\d{8})?"),
        (["init -q", "add -A", "commit -q -m one", "tag v1.2.3"], r"1\.2\.3"),
        (
            ["init -q", "add -A", "commit -q -m one", "tag v1.2.3", "commit -q -m two --allow-empty"],
            r"1\.2\.4\.dev1\+g[0-9a-f]+",
        ),
    ],
    ids=["no git", "no tag", "at a tag", "after a tag"],
)
def test_the_version_is_of_the_tag_or_of_the_commits_since(tmp_path: Path, commands: list[str], version: str) -> None:
    source = tmp_path / "source"
    (source / "lacet" / "services" / "workbench" / "static" / "vendor" / "uplot").mkdir(parents=True)
    for name in ("pyproject.toml", *PROJECT["project"]["license-files"], "README.md", "lacet/__init__.py"):
        shutil.copyfile(HOME / name, source / name)
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    for command in commands:
        run("git", *who, *shlex.split(command), cwd=source)
    alone = {"GIT_CEILING_DIRECTORIES": str(tmp_path)}
    wheel = built("wheel", source, tmp_path / "out", **alone)
    assert re.fullmatch(rf"lacet-{version}-py3-none-any\.whl", wheel.name), wheel.name


def test_the_wheel_holds_lacet_alone(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0].partition("-")[0] for name in names} == {"lacet"}
    assert {name.split("/")[0] for name in names if not name.split("/")[0].endswith(".dist-info")} == {"lacet"}
    for wanted in ("daq/rigs/peugeot-406.toml", "daq/vehicles/peugeot-406.toml", "drivers/dbc/igel.dbc", "py.typed"):
        assert f"lacet/{wanted}" in names


def test_the_installed_wheel_runs_the_first_fit_of_the_demonstration(environment: Path, tmp_path: Path) -> None:
    """Decode a capture of the demo and fit the base model to it, in a folder that has nothing to do with lacet."""
    lacet = environment / "bin" / "lacet"
    assert "record" in run(lacet, "--help", cwd=tmp_path)
    run(lacet, "decode", CAPTURE, "-o", "sinus.mcap", cwd=tmp_path)
    run(lacet, "identify", "sinus.mcap", "--json", "fit.json", cwd=tmp_path)
    found = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert found["format"] == "lacet-result 1"


LACKING: dict[str, list[str]] = {
    "plots": ["compare", "study"],
    "ui": ["ui", "study"],
    "logs": ["info", "table.mf4", "--map", "map.toml"],
    "sim": ["simulate", "--rig", "peugeot-406", "--vehicle", "peugeot-406", "--manoeuvre", "sinus", "-o", "x"],
    "consistency": ["identify", "sinus.mcap", "--consistent"],
    "foxglove": ["foxglove"],
    "campaign": ["campaign", "sinus.mcap"],
}
"""Part → a command that needs it."""
ASKED = """\
import contextlib, io, json, sys
from lacet.services.commands.__main__ import build_parser, main
found = {"help": build_parser().format_help()}
for part, words in json.loads(sys.argv[1]).items():
    with contextlib.redirect_stderr(io.StringIO()) as said:
        found[part] = [main(words), said.getvalue()]
print(json.dumps(found))
"""


def test_without_the_optional_parts_commands_explain_themselves_and_say_what_installs_the_part_they_need(
    environment: Path, tmp_path: Path
) -> None:
    """In one process, for it takes seconds to load them all."""
    (tmp_path / "table.mf4").write_bytes(b"MDF     4.10")
    (tmp_path / "map.toml").write_text('format = "lacet-map 1"\n[channels]\n"imu.accel.y" = "ay"\n', encoding="utf-8")
    (tmp_path / "sinus.mcap").write_bytes(CAPTURE.read_bytes())
    found = json.loads(run(environment / "bin" / "python", "-c", ASKED, json.dumps(LACKING), cwd=tmp_path))
    for name, module in find_commands().items():
        assert name in found["help"].split()
        assert " ".join(module.HELP.split())[:30] in " ".join(found["help"].split())
    assert set(LACKING) == set(PARTS)
    for part in LACKING:
        code, said = found[part]
        assert code == 2, part
        assert f"pip install 'lacet[{part}]'" in said


def test_lacet_and_the_identify_of_pre_commit_live_side_by_side(environment: Path, tmp_path: Path) -> None:
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "identify").mkdir()
    (packages / "identify" / "__init__.py").touch()
    (packages / "identify" / "identify.py").write_text(PRE_COMMITS_IDENTIFY, encoding="utf-8")
    code = (
        "from identify import identify; import lacet, lacet.identify.progress as ours\n"
        "print(identify.tags_from_path('x')); print(lacet.__file__); print(ours.__file__)"
    )
    tags, package, module = run(environment / "bin" / "python", "-c", code, cwd=tmp_path).splitlines()
    assert tags == "{'file'}"
    assert Path(package).parent == packages / "lacet"
    assert Path(module).parent == packages / "lacet" / "identify"
