"""The systemd unit: what it starts can be started, and systemd takes it."""

from __future__ import annotations

import argparse
import configparser
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from lacet.services.commands import record
from tests.support.processes import ROOT

FOLDER = ROOT / "services" / "acquisition" / "systemd"
UNIT = FOLDER / "lacet-record.service"


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str  # type: ignore[assignment]
    parser.read_string(UNIT.read_text(encoding="utf-8"))
    return parser


def settings() -> dict[str, str]:
    lines = (FOLDER / "record.conf").read_text(encoding="utf-8").splitlines()
    return dict(line.split("=", 1) for line in lines if not line.startswith("#"))


def test_the_command_line_of_the_unit_is_one_of_record():
    words: list[str] = []
    for word in shlex.split(unit()["Service"]["ExecStart"]):
        name = word.strip("${}")
        words += [word] if not word.startswith("$") else [settings()[name]] if "{" in word else settings()[name].split()
    assert words[:2] == ["/opt/lacet/.venv/bin/lacet", "record"]
    parser = argparse.ArgumentParser()
    record.add_arguments(parser)
    args = parser.parse_args(words[2:])
    assert args.resume
    assert args.out == Path("/var/lib/lacet")
    assert args.split == "10min"
    assert all("=" in source for source in args.sources)


def test_a_crash_starts_it_again_and_losses_are_no_crash():
    service = unit()["Service"]
    assert service["Restart"] == "on-failure"
    assert unit()["Unit"]["StartLimitIntervalSec"] == "0"  # however often
    assert service["SuccessExitStatus"] == str(record.WITH_LOSSES)
    assert int(service["TimeoutStopSec"]) > 30 + 5  # longer than a worker is waited for


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_systemd_takes_the_unit(tmp_path: Path):
    program = tmp_path / "lacet"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    text = UNIT.read_text(encoding="utf-8").replace("/opt/lacet/.venv/bin/lacet", str(program))
    (tmp_path / UNIT.name).write_text(text.replace("User=lacet", "User=root"))

    def verified() -> str:
        found = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", str(tmp_path / UNIT.name)], capture_output=True, text=True
        )
        return "\n".join(line for line in found.stderr.splitlines() if UNIT.name in line)

    assert verified() == ""
    (tmp_path / UNIT.name).write_text(text.replace("Restart=on-failure", "Restart=now and then"))
    assert "restart specifier" in verified()  # it would say what is wrong
