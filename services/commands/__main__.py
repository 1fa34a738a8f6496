"""The command ``lacet``, which finds its sub-commands in ``services/commands`` and reports errors as plain text."""

from __future__ import annotations

import argparse
import ast
import contextlib
import gc
import importlib
import importlib.resources
import io
import os
import pkgutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from lacet.daq.errors import LacetError, NotIdentifiable, nearest
from lacet.daq.formats.result import BAD_INPUT, WITH_LOSSES
from lacet.services import commands

ABOUT = """\
lacet: record an instrumented car, identify its dynamic parameters, and learn which physical effect a model lacks.

The usual order:
  lacet record    log what comes over the wires        (or: lacet decode, for a raw capture)
  lacet identify  fit the base model to runs
  lacet study     keep runs, model versions and errors in a folder
  lacet compare   model against measurement, row by row
  lacet diagnose  which effect is missing
  lacet add       add it, fit again, and see the error fall"""


NO_COMMANDS = ("__main__", "bus_options", "limit_options", "mark_key", "progress")
"""Modules of this folder that are no sub-commands."""


def _files() -> dict[str, str]:
    """Name of each sub-command and of its module, in alphabetical order."""
    names = sorted(module.name for module in pkgutil.iter_modules(commands.__path__) if module.name not in NO_COMMANDS)
    return {name.replace("_", "-"): name for name in names}


def find_commands(only: str | None = None) -> dict[str, ModuleType]:
    """Sub-command modules by name, in alphabetical order; or only one, which loads much faster."""
    files = _files()
    names = [only] if only in files else list(files)
    return {name: importlib.import_module(f"{commands.__name__}.{files[name]}") for name in names}


def _help(module: str) -> str:
    """Line of help of a sub-command, read from its source: importing all of them takes seconds."""
    source = importlib.resources.files(commands).joinpath(f"{module}.py").read_text(encoding="utf-8")
    for statement in ast.parse(source).body:
        match statement:
            case ast.Assign(targets=[ast.Name(id="HELP")], value=value):
                return str(ast.literal_eval(value))
            case _:
                pass
    raise AssertionError(f"services/commands/{module}.py has no HELP")


def _top_level() -> argparse.ArgumentParser:
    """Parser of the command line without its sub-commands."""
    parser = argparse.ArgumentParser(
        prog="lacet", description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    return parser


class _Version(argparse.Action):
    """Option that prints the version, and reads it only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version  # its packages are a fiftieth of start-up

        try:
            print(f"lacet {version('lacet')}")
        except PackageNotFoundError:
            print("lacet (not installed)")
        parser.exit()


def build_overview() -> argparse.ArgumentParser:
    """Parser of ``lacet --help``: every sub-command with its line of help, without importing them."""
    parser = _top_level()
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in _files().items():
        subparsers.add_parser(name, help=_help(module))
    return parser


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Parser of the whole command line, or of one sub-command."""
    parser = _top_level()
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in find_commands(only).items():
        sub = subparsers.add_parser(
            name,
            help=module.HELP,
            description=module.DESCRIPTION,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(sub)
        sub.add_argument("--json", metavar="FILE", help="also write the result as JSON (docs/json.md); - for stdout")
        sub.set_defaults(run=module.run, parser=sub)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one sub-command. Returns 0: success, 2: bad usage or input, 3: losses, or nothing identifiable."""
    words = (sys.argv[1:] if argv is None else list(argv)) or ["--help"]
    if argv is None:
        _write_what_can_be_written()
    try:
        if words[0] not in _files():  # help, the version, or a word that is no command
            overview = build_overview()
            if not words[0].startswith("-"):
                overview.error(
                    f"there is no command '{words[0]}'{nearest(words[0], _files())} (lacet --help lists them)"
                )
            overview.parse_args(words)
        with _without_collection() if argv is None else contextlib.nullcontext():
            parser = build_parser(words[0])
        args, not_understood = parser.parse_known_args(words)
        if not_understood:  # with the usage of the command: argparse's own is of all commands
            args.parser.error(f"not understood: {' '.join(not_understood)} (lacet {args.command} --help)")
    except BrokenPipeError:
        return _unread()
    from lacet.services.one_thread import one_thread  # imported here, so that `lacet --help` is fast

    try:
        with one_thread(), contextlib.ExitStack() as stack:
            if args.json == "-":  # standard output is for the result only, text for people goes to standard error
                args.json = sys.stdout
                if isinstance(sys.stdout, io.TextIOWrapper):
                    sys.stdout.reconfigure(encoding="utf-8")
                stack.enter_context(contextlib.redirect_stdout(sys.stderr))
            return int(args.run(args))
    except NotIdentifiable as error:
        print(f"lacet {args.command}: nothing identifiable: {error}", file=sys.stderr)
        return WITH_LOSSES
    except LacetError as error:
        print(f"lacet {args.command}: {error}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        return _unread()
    except OSError as error:  # a folder that cannot be created, a full disk
        print(f"lacet {args.command}: {_failed(error)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"\nlacet {args.command}: stopped", file=sys.stderr)
        return WITH_LOSSES


@contextlib.contextmanager
def _without_collection() -> Iterator[None]:
    """Imports without garbage collection: they make no garbage, and looking for it is a seventh of start-up.

    Only in a process of one command: what is there afterwards is never looked at again.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
        gc.freeze()
    finally:
        if collects:
            gc.enable()


def _write_what_can_be_written() -> None:
    """Write ``?`` for a character that the output's encoding lacks (``→`` in a file of a Windows console).

    A result as JSON goes out as UTF-8 in any case.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _failed(error: OSError) -> str:
    """What the system refused, with the file; a file in the place of a folder is named as such."""
    if isinstance(error, FileExistsError | NotADirectoryError) and isinstance(error.filename, str):
        name = Path(error.filename)
        if file := next((one for one in (name, *name.parents) if one.is_file()), None):
            return f"{file} is a file: name a folder in its place"
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}"


def _unread() -> int:
    """Exit when the reader of a pipe has gone (``lacet … | head``), discarding output still to be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
