"""Windows and macOS: no module imports, or names while it is loaded, what only POSIX systems have."""

from __future__ import annotations

import ast
import os
import select
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.bus.spool import Spool
from lacet.daq.errors import UsageError
from lacet.daq.set_aside import DiskSpace
from lacet.services.acquisition import system_calls
from lacet.services.commands.__main__ import main
from tests.support.places import HOME

FOLDERS = ("lacet", "daq", "drivers", "identify", "services", "simulate")
FILES = sorted(file for folder in FOLDERS for file in (HOME / folder).glob("*.py" if folder == "lacet" else "**/*.py"))
FOR_WIRES = ("services/acquisition", "services/commands/record.py", "services/commands/mark_key.py")
"""Where functions may use what Windows lacks: what records, and what asks the system whether it has it."""
ASKS = {"daq/file_places.py": ["os.preadv", "os.pwrite"]}
"""Files that ask whether the system has a call, and do without it."""
POSIX = ("fcntl", "grp", "posix", "pty", "pwd", "resource", "termios", "tty")
"""Modules that Windows has not; those within functions are for wires."""
NAMES = {
    "os": {
        "fchmod", "fdatasync", "fork", "fstatvfs", "geteuid", "getloadavg", "getpgrp", "getuid", "killpg", "mkfifo",
        "nice", "openpty", "posix_fallocate", "pread", "preadv", "pwrite", "pwritev", "sched_getaffinity",
        "sched_setaffinity", "setpriority", "setsid", "statvfs", "sysconf", "tcgetpgrp", "ttyname", "uname", "waitpid",
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


def only_posix(source: str, nodes: Callable[[ast.AST], Iterator[ast.AST]] = while_loaded) -> list[str]:
    """What only POSIX systems have, of those parts of a module's text that `nodes` gives."""
    found: list[str] = []
    for node in nodes(ast.parse(source)):
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


def test_no_function_of_the_analysis_uses_what_windows_lacks() -> None:
    assert only_posix("def f():\n    import fcntl\n    return os.fork()", ast.walk) == ["fcntl", "os.fork"]
    names = [str(file.relative_to(HOME)) for file in FILES]
    analysis = [name for name in names if not name.startswith(FOR_WIRES)]
    assert len(names) - len(analysis) < 60
    found = {name: only_posix((HOME / name).read_text(encoding="utf-8"), ast.walk) for name in analysis}
    assert {name: those for name, those in found.items() if those} == ASKS


def test_arrays_and_messages_are_set_aside_without_calls_that_windows_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("preadv", "pwrite"):
        monkeypatch.delattr(os, name)
    arrays = {"a": np.arange(70_000.0).reshape(7, -1), "b": np.ones(3)}
    kept = DiskSpace().put(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(kept[name], array)
    spool = Spool()
    messages = {0: b"first", 3: bytes(100_000), 1: b"second"}
    assert all(spool.add("x", number, message) for number, message in messages.items())
    assert dict(spool.messages("x")) == messages
    assert spool.gaps("x", 5) == [(2, 2), (4, 4)]


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
