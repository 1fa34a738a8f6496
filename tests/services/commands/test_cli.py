"""The top of the command line: what a user sees before any sub-command is loaded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lacet.services.commands import demo
from lacet.services.commands.__main__ import build_parser, find_commands, main
from tests.support.places import HOME


def test_the_overview_names_every_command_without_loading_any() -> None:
    """`lacet --help` is what a new user types first, and loading all of lacet takes seconds."""
    asked = (
        "import sys; from lacet.services.commands import __main__ as cli; print(cli.build_overview().format_help()); "
        "loaded = ('lacet.services.commands.', 'numpy', 'scipy', 'lacet.identify'); "
        "print([name for name in sys.modules if name.startswith(loaded) and name != cli.__name__])"
    )
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True).stdout
    words, _, loaded = told.strip().rpartition("\n")
    assert loaded == "[]"
    flat = " ".join(words.split())
    for name, module in find_commands().items():
        assert f" {name} {' '.join(module.HELP.split())}" in flat


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["--", "identfy"]])
def test_what_is_no_command_ends_as_the_whole_parser_would(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    found = capsys.readouterr()
    with pytest.raises(SystemExit) as expected:
        build_parser().parse_args(words)
    assert (found, ended.value.code) == (capsys.readouterr(), expected.value.code)


def test_a_word_that_is_no_command_is_answered_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["identfy", "run.mcap"])
    assert ended.value.code == 2
    assert "there is no command 'identfy'; did you mean 'identify'?" in capsys.readouterr().err


def test_the_name_alone_prints_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 0
    assert "The usual order:" in capsys.readouterr().out


def test_the_demonstration_says_what_to_type_next_as_this_shell_calls_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, other = tmp_path / "lacet", tmp_path / "elsewhere"
    for file in (script, other):
        file.touch()
    monkeypatch.setattr(sys, "argv", [str(script)])
    monkeypatch.setattr(demo.shutil, "which", lambda _: None)
    assert demo.called() == str(script)
    monkeypatch.setattr(demo.shutil, "which", lambda _: str(other))
    assert demo.called() == str(script)
    monkeypatch.setattr(demo.shutil, "which", lambda _: str(script))
    assert demo.called() == "lacet"


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["study", "new", "folder"], "use"),
        (["study", "new", "folder"], "hold"),
        (["plan"], "want"),
        (["plan"], "like"),
        (["export", "run.mcap", "-o", "run.mat"], "channels"),
    ],
)
def test_an_option_for_several_values_may_be_written_several_times(words: list[str], option: str) -> None:
    """A run of `--use a --use b` that only the last was used of would be lost without a word."""
    found = build_parser().parse_args([*words, f"--{option}", "a", "b", f"--{option}", "c"])
    assert list(map(str, getattr(found, option))) == ["a", "b", "c"]


def test_the_demonstration_s_processes_work_in_the_folder_that_it_was_called_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = Path("out")
    out.mkdir()
    (out / "rig.toml").write_bytes((HOME / "tests/data/car/rig.toml").read_bytes())
    assert demo._lacet(out, "info", out / "rig.toml").wait(60) == 0
    assert "wheels" in (out / "info.txt").read_text(encoding="utf-8")


def test_an_encoding_without_all_characters_ends_no_command(tmp_path: Path) -> None:
    """As in a file of a Windows console; the result as JSON is UTF-8."""
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    for words, kept in ((["doctor"], False), (["doctor", "--json", "-"], True)):
        done = subprocess.run(
            [sys.executable, "-m", "lacet", *words], env=environment, capture_output=True, check=False
        )
        assert done.returncode in (0, 3), done.stderr
        assert b"Python" in done.stdout
        if kept:
            json.loads(done.stdout.decode("utf-8"))


def test_words_too_many_are_answered_with_the_usage_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["add", "study", "anti_roll_bar.front", "anti_roll_bar.rear", "--nosuch"])
    said = capsys.readouterr().err
    assert said.startswith("usage: lacet add ")
    assert "not understood: anti_roll_bar.rear --nosuch" in said


def test_an_option_that_a_run_alone_has_no_use_for_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "run.parquet", "--rig", "rig.toml"]) == 2
    assert "--rig goes with --model" in capsys.readouterr().err
