"""Optional parts: what is missing is named with the command that installs it, before work is begun."""

from __future__ import annotations

import sys

import pytest

from lacet.daq.parts import MissingPart, absent, from_part, require


def test_what_is_installed_is_required_in_silence() -> None:
    assert absent("plots") == []
    require("plots")


def test_a_module_that_is_not_installed_is_named_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert absent("ui") == ["uvicorn"]
    with pytest.raises(MissingPart, match=r"uvicorn is not installed\. For the workbench .*pip install 'lacet\[ui\]'"):
        require("ui")
    with pytest.raises(MissingPart, match=r"; or give --no-page$"):
        require("ui", "give --no-page")


def test_imports_of_a_part_that_is_missing_or_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingPart, match=r"mujoco is not installed\. .*pip install 'lacet\[sim\]'"), from_part("sim"):
        import mujoco  # noqa: F401
    with pytest.raises(MissingPart, match=r"cannot be loaded \(libGL.so.1: no such file\)"), from_part("sim"):
        raise ImportError("libGL.so.1: no such file")


def test_other_faults_within_a_part_are_left_as_they_are() -> None:
    with pytest.raises(ZeroDivisionError), from_part("sim"):
        _ = 1 / 0
