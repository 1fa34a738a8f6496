"""The script of `lacet completion`, read by a real bash, completes commands, options, choices and files."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from lacet.services.commands.__main__ import find_commands, main
from tests.services.commands.test_json import conforms

ASK = """\
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(( $# - 1 )); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
_shtab_lacet 2>/dev/null
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The script for bash, as a user makes it."""
    folder = tmp_path_factory.mktemp("completion")
    assert main(["completion", "bash", "--json", str(folder / "completion.json")]) == 0
    found = conforms(folder / "completion.json", "completion")
    (folder / "lacet.bash").write_text(found["script"], encoding="utf-8")
    return folder / "lacet.bash"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash on this computer")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["di"], {"diagnose"}),
        (["record", "--spl"], {"--split"}),
        (["info", "--reference", ""], {"contact", "hub"}),
        (["decode", "some"], {"some-run.mcap"}),
        (["doctor", "--logs", "some"], {"some-run.mcap"}),
    ],
)
def test_bash_offers_what_fits(script: Path, tmp_path: Path, typed: list[str], offered: set[str]) -> None:
    (tmp_path / "some-run.mcap").touch()
    done = subprocess.run(
        ["bash", "-c", ASK, "bash", script, "lacet", *typed], cwd=tmp_path, capture_output=True, text=True, timeout=60,
        check=True,
    )  # fmt: skip
    assert set(done.stdout.split()) == offered


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_the_scripts_of_the_other_shells_name_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell, "--json", "-"]) == 0
    text = json.loads(capsys.readouterr().out)["script"]
    assert [name for name in find_commands() if name not in text] == []
