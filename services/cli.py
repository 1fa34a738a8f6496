"""The command ``lacet``: finds its sub-commands by walking ``services/commands`` and turns errors into plain text."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import pkgutil
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType

from threadpoolctl import threadpool_limits

from daq.errors import LacetError, NotIdentifiable
from services import commands
from services.result import BAD_INPUT, WITH_LOSSES

ABOUT = """\
lacet: record an instrumented car, identify its dynamic parameters, and learn which physical effect a model lacks.

The usual order:
  lacet record    log what comes over the wires        (or: lacet decode, for a raw capture)
  lacet identify  fit the base model to runs
  lacet study     keep runs, model versions and errors in a folder
  lacet compare   model against measurement, row by row
  lacet diagnose  which effect is missing
  lacet add       add it, fit again, and see the error fall"""


def find_commands(only: str | None = None) -> dict[str, ModuleType]:
    """Every sub-command module by name, in alphabetical order; or just one, which loads much quicker."""
    files = {module.name.replace("_", "-"): module.name for module in pkgutil.iter_modules(commands.__path__)}
    names = [only] if only in files else sorted(files)
    return {name: importlib.import_module(f"services.commands.{files[name]}") for name in names}


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """The whole command line, or that of one sub-command."""
    parser = argparse.ArgumentParser(
        prog="lacet", description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    try:
        parser.add_argument("--version", action="version", version=f"lacet {version('lacet')}")
    except PackageNotFoundError:
        parser.add_argument("--version", action="version", version="lacet (not installed)")
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
        sub.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one sub-command. Returns 0 done, 2 bad usage or input, 3 done with losses or nothing identifiable."""
    words = sys.argv[1:] if argv is None else list(argv)
    args = build_parser(words[0] if words else None).parse_args(words)
    try:
        # Matrices here are small: more threads gain nothing (measured), and the other cores are the recorder's.
        with threadpool_limits(1), contextlib.ExitStack() as stack:
            if args.json == "-":  # standard output is for the result alone; what is for people goes to standard error
                args.json = sys.stdout
                stack.enter_context(contextlib.redirect_stdout(sys.stderr))
            return int(args.run(args))
    except NotIdentifiable as error:
        print(f"lacet {args.command}: nothing identifiable: {error}", file=sys.stderr)
        return WITH_LOSSES
    except LacetError as error:
        print(f"lacet {args.command}: {error}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        return BAD_INPUT
    except OSError as error:  # a folder that cannot be made, a full disk
        where = f"{error.filename}: " if error.filename else ""
        print(f"lacet {args.command}: {where}{error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"\nlacet {args.command}: stopped", file=sys.stderr)
        return WITH_LOSSES


if __name__ == "__main__":
    sys.exit(main())
