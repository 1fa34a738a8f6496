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


def find_commands() -> dict[str, ModuleType]:
    """Every sub-command module by name, in alphabetical order."""
    names = sorted(module.name for module in pkgutil.iter_modules(commands.__path__))
    return {name.replace("_", "-"): importlib.import_module(f"services.commands.{name}") for name in names}


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = argparse.ArgumentParser(
        prog="lacet", description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    try:
        parser.add_argument("--version", action="version", version=f"lacet {version('lacet')}")
    except PackageNotFoundError:
        parser.add_argument("--version", action="version", version="lacet (not installed)")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in find_commands().items():
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
    args = build_parser().parse_args(argv)
    try:
        # Matrices here are small: threads inside the linear algebra only fight each other (measured: 25 times slower).
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
    except KeyboardInterrupt:
        print(f"\nlacet {args.command}: stopped", file=sys.stderr)
        return WITH_LOSSES


if __name__ == "__main__":
    sys.exit(main())
