"""Windows and macOS: no module imports, or names while it is loaded, what only POSIX systems have."""

from __future__ import annotations

import ast
import os
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lacet.daq.errors import UsageError
from lacet.services.acquisition import system_calls
from lacet.services.commands.__main__ import main
from tests.support.places import HOME

FOLDERS = ("lacet", "daq", "drivers", "identify", "services", "simulate")
FILES = sorted(file for folder in FOLDERS for file in (HOME / folder).glob("*.py" if folder == "lacet" else "**/*.py"))
POSIX = ("fcntl", "grp", "posix", "pty", "pwd", "resource", "termios", "tty")
"""Modules that Windows has not; those within functions are for wires."""
NAMES = {
    "os": {
        "fdatasync", "fork", "fstatvfs", "geteuid", "getpgrp", "getuid", "killpg", "mkfifo", "openpty",
        "sched_getaffinity", "sched_setaffinity", "setsid", "statvfs", "tcgetpgrp", "ttyname", "uname",
    },
    "select": {"POLLHUP", "POLLIN", "POLLOUT", "epoll", "poll"},
    "signal": {"SIGALRM", "SIGHUP", "SIGKILL", "SIGTTIN", "SIGUSR1", "alarm", "setitimer"},
    "socket": {"AF_CAN", "AF_UNIX", "CAN_RAW", "SCM_RIGHTS"},
}  # fmt: skip
"""Names of modules that Windows has, without these."""
ASKED = """\
import builtins, sys
there = builtins.__import__

def as_on_windows(name, globals=None, *more):
    asks = (globals or {}).get("__name__", "")
    if asks.startswith("lacet") and name.partition(".")[0] in %r:
        raise ModuleNotFoundError(f"{asks} imports {name}, which Windows has not", name=name)
    return there(name, globals, *more)

builtins.__import__ = as_on_windows
import lacet
from lacet.services.commands.__main__ import find_commands
found = find_commands()
for name in lacet.__all__:
    getattr(lacet, name)
import lacet.services.workbench.server
print(len(found))
"""


def while_loaded(node: ast.AST) -> Iterator[ast.AST]:
    """The parts of a module that are worked out while it is loaded: all but the bodies of functions."""
    for child in ast.iter_child_nodes(node):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and child in (
            node.body if isinstance(node.body, list) else [node.body]
        ):
            continue
        yield child
        yield from while_loaded(child)


def only_posix(source: str) -> list[str]:
    """What of a module's text is worked out while it is loaded and only POSIX systems have."""
    found: list[str] = []
    for node in while_loaded(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                found += [one.name for one in names if one.name.partition(".")[0] in POSIX]
            case ast.ImportFrom(module=str(module), names=names, level=0):
                found += [module] * (module.partition(".")[0] in POSIX)
                found += [f"{module}.{one.name}" for one in names if one.name in NAMES.get(module, ())]
            case ast.Attribute(value=ast.Name(id=module), attr=name) if name in NAMES.get(module, ()):
                found.append(f"{module}.{name}")
            case _:
                pass
    return found


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import fcntl", ["fcntl"]),
        ("from select import POLLIN, select", ["select.POLLIN"]),
        ("def f(sync=os.fdatasync): ...", ["os.fdatasync"]),
        ("class A:\n    import tty", ["tty"]),
        ("def f():\n    import fcntl\n    return os.fork()", []),
        ("force = getattr(os, 'fdatasync', os.fsync)", []),
    ],
)
def test_what_is_found(source: str, found: list[str]) -> None:
    assert only_posix(source) == found


def test_no_module_needs_posix_while_it_is_loaded() -> None:
    assert len(FILES) > 200
    found = {str(file.relative_to(HOME)): only_posix(file.read_text(encoding="utf-8")) for file in FILES}
    assert {name: those for name, those in found.items() if those} == {}


def test_every_command_the_library_and_the_workbench_load_without_posix_modules(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ASKED % (POSIX,)], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


class TestSystemCalls:
    def test_a_lock_is_seen_and_goes_with_its_file(self, tmp_path: Path) -> None:
        file = tmp_path / "run.mcap"
        file.touch()
        one, other = (os.open(file, os.O_RDONLY) for _ in range(2))
        system_calls.lock(one)
        assert system_calls.is_locked(other)
        os.close(one)
        assert not system_calls.is_locked(other)
        os.close(other)

    def test_a_system_without_locks_and_polls(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "fcntl", None)
        monkeypatch.delattr(select, "poll")
        system_calls.lock(0)
        assert not system_calls.is_locked(0)
        with pytest.raises(UsageError, match="wires need Linux"):
            system_calls.poller()

    @pytest.mark.parametrize(
        "words",
        [["record", "--rig", "peugeot-406", "--vehicle", "peugeot-406", "-o", "run.mcap"], ["replay", "run.mcap"]],
    )
    def test_recording_elsewhere_says_what_can_be_done_there(
        self, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr(system_calls, "SYSTEM", "win32")
        assert main(words) == 2
        assert "need Linux" in capsys.readouterr().err
