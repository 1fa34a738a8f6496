"""The committed lock and the Makefile keep their promises."""

from __future__ import annotations

import re
import subprocess
import tomllib

import pytest

from services.environment import FOLDERS, HOME

LOCKS = ("uv.txt", "run.txt", "dev.txt", "schema.txt")
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


def test_what_runs_has_the_same_version_in_tests():
    run, dev = pins("run.txt"), pins("dev.txt")
    assert {name: dev.get(name) for name in run} == run


def test_what_runs_is_light():
    assert not {"mujoco", "numba", "cvxpy", "pytest", "pyright", "pre-commit"} & set(pins("run.txt"))


def test_the_project_keeps_a_clashing_package_out():
    assert not set(FOLDERS) & (set(pins("run.txt")) | set(pins("dev.txt")))


def test_the_wheel_holds_every_folder():
    assert set(PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]) == set(FOLDERS)


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
