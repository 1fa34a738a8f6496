"""The committed lock and the Makefile keep their promises."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions

import pytest

from lacet.daq.parts import EVERYTHING, PARTS
from tests.support.places import HOME

LOCKS = ("uv.txt", "run.txt", "dev.txt", "campaign.txt", "schema.txt")
PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))


def pins(name: str) -> dict[str, set[str]]:
    """Locked versions by distribution (several where they depend on the Python version)."""
    out: dict[str, set[str]] = {}
    for line in (HOME / "requirements" / name).read_text(encoding="utf-8").splitlines():
        if match := re.match(r"([a-z0-9._-]+)==(\S+)", line):
            out.setdefault(match[1], set()).add(match[2])
    return out


def wanted(requirements: list[str]) -> set[str]:
    """Names in a list of requirements."""
    return {re.split(r"[\s\[<>=!~;]", requirement)[0].lower() for requirement in requirements}


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_has_versions_and_hashes_and_no_address(name):
    text = (HOME / "requirements" / name).read_text(encoding="utf-8")
    assert not re.search(r"://|index-url|find-links|trusted-host|^-e|@ ", text, re.MULTILINE | re.IGNORECASE)
    entries = [block for block in re.split(r"\n(?=[a-z0-9])", text.strip()) if not block.startswith("#")]
    assert entries
    for entry in entries:
        assert re.match(r"[a-z0-9._-]+==\S+", entry), entry.splitlines()[0]
        assert "--hash=sha256:" in entry, entry.splitlines()[0]


def test_the_locks_hold_what_pyproject_asks_for():
    project, groups = PROJECT["project"], PROJECT["dependency-groups"]
    run, dev = pins("run.txt"), pins("dev.txt")
    assert wanted(project["dependencies"]) | wanted(groups["build"]) <= set(run)
    assert wanted(groups["dev"]) | wanted(project["optional-dependencies"]["sim"]) <= set(dev)


def test_the_parts_are_the_extras_and_one_extra_brings_all_of_them():
    extras = PROJECT["project"]["optional-dependencies"]
    assert set(PARTS) == set(extras) - {EVERYTHING}
    assert extras[EVERYTHING] == [f"lacet[{','.join(PARTS)}]"]


def test_the_modules_of_a_part_are_of_its_packages():
    providers = packages_distributions()
    for name, part in PARTS.items():
        provided = {module: {package.lower() for package in providers[module]} for module in part.modules}
        assert all(provided.values())
        assert packages_of(name) <= set().union(*provided.values()), name


def packages_of(name: str) -> set[str]:
    """Names of the packages that an extra asks for, those of extras within it included."""
    extras = PROJECT["project"]["optional-dependencies"]
    brought, todo = set(), [name]
    while todo:
        for requirement in extras[todo.pop()]:
            if within := re.fullmatch(r"lacet\[(.+)\]", requirement):
                todo += within[1].split(",")
            else:
                brought |= wanted([requirement])
    return brought


def test_what_runs_has_the_same_version_in_tests():
    run, dev = pins("run.txt"), pins("dev.txt")
    assert {name: dev.get(name) for name in run} == run


def test_a_campaign_runs_on_what_runs_and_dask():
    run, dev, campaign = pins("run.txt"), pins("dev.txt"), pins("campaign.txt")
    assert wanted(PROJECT["project"]["optional-dependencies"]["campaign"]) <= set(campaign) - set(run)
    assert {name: campaign.get(name) for name in run} == run
    assert {name: dev.get(name) for name in campaign} == campaign


def test_what_runs_is_light():
    heavy = {"mujoco", "cvxpy", "distributed", "bokeh", "pytest", "pyrefly", "pre-commit"}
    assert not heavy & set(pins("run.txt"))


def test_the_wheel_holds_one_package():
    assert PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == ["lacet"]


def test_every_folder_of_the_package_is_a_link_to_the_one_beside_it():
    for name in ("daq", "drivers", "identify", "services", "simulate"):
        assert os.readlink(HOME / "lacet" / name) == f"../{name}"


def test_a_checkout_without_links_says_what_to_do(tmp_path):
    """On Windows git writes a link as a small text file."""
    package = tmp_path / "lacet"
    package.mkdir()
    (package / "__init__.py").write_text((HOME / "lacet" / "__init__.py").read_text(encoding="utf-8"), encoding="utf-8")
    for name in ("daq", "drivers", "identify", "services", "simulate"):
        (package / name).write_text(f"../{name}", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import lacet"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert "core.symlinks" in done.stderr
    assert "pip install" in done.stderr


class TestMakeVenv:
    """`requirements/make_venv.sh` with Pythons that will not do."""

    @staticmethod
    def run(tmp_path, script: str | None) -> str:
        fake = tmp_path / "a folder" / "python3"
        fake.parent.mkdir()
        if script is not None:
            fake.write_text("#!/bin/sh\n" + script, encoding="utf-8")
            fake.chmod(0o755)
        done = subprocess.run(
            ["sh", str(HOME / "requirements" / "make_venv.sh")],
            cwd=tmp_path, env={"PATH": "/usr/bin:/bin", "PYTHON": str(fake)}, capture_output=True, text=True,
            timeout=30, check=False,
        )  # fmt: skip
        assert done.returncode == 1
        assert not (tmp_path / ".venv").exists()
        return done.stderr

    def test_too_old(self, tmp_path):
        text = self.run(tmp_path, 'case "$*" in *:2]*) echo 3.9;; *) exit 1;; esac\n')
        assert "3.11 or newer" in text
        assert "is 3.9" in text

    def test_no_venv_module(self, tmp_path):
        text = self.run(tmp_path, 'case "$*" in *:2]*) echo 3.12;; *ensurepip*) exit 1;; esac\n')
        assert "apt-get install python3-venv" in text
        assert "python3.12-venv" in text

    def test_no_python(self, tmp_path):
        assert "no Python found" in self.run(tmp_path, None)

    def test_venv_fails(self, tmp_path):
        text = self.run(tmp_path, 'case "$*" in *:2]*) echo 3.12;; *"-m venv"*) exit 1;; esac\n')
        assert "failed" in text


def test_the_licence_and_those_of_vendored_parts_are_named():
    """Whatever folder holds somebody else's files has their licence beside them, and stands in the notices."""
    project, notices = PROJECT["project"], (HOME / "NOTICE.md").read_text(encoding="utf-8")
    assert project["license"] == "BSD-3-Clause"
    assert "the lacet authors" in (HOME / "LICENSE").read_text(encoding="utf-8")
    for file in project["license-files"]:
        assert (HOME / file).is_file(), file
    for part in ("services/workbench/static/vendor/uplot", "tests/data/compose"):
        assert (HOME / part / "LICENSE").is_file(), part
        assert part in notices, part
