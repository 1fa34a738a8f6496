"""``lacet completion``: the script by which a shell completes commands, options and file names."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

import shtab

from lacet.daq.formats.result import DONE, write_result

HELP = "complete commands, options and files in the shell"
DESCRIPTION = """\
Print the script with which a shell completes lacet's commands, options, choices and file names at the Tab key. It is
made once, so that completing needs no lacet and no time; make it anew after an update.

  lacet completion bash > ~/.local/share/bash-completion/completions/lacet     (mkdir -p its folder before)
  lacet completion zsh > ~/.zfunc/_lacet          with  fpath+=~/.zfunc; autoload -Uz compinit; compinit  in ~/.zshrc
  lacet completion tcsh > ~/.lacet.tcsh           with  source ~/.lacet.tcsh  in ~/.tcshrc

Open a new shell afterwards."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("shell", choices=shtab.SUPPORTED_SHELLS, help="the shell")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    # By its name: the table of all commands, which this one is in.
    parser: Any = importlib.import_module("lacet.services.commands.__main__").build_parser()
    _complete_files(parser)
    script = shtab.complete(parser, shell=args.shell)
    print(script)
    write_result(args.json, "completion", {"shell": args.shell, "script": script})
    return DONE


def _complete_files(parser: argparse.ArgumentParser) -> None:
    """Let each argument that is a path, and those of its sub-commands, be completed as one."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                _complete_files(sub)
        elif action.type is Path or action.metavar in ("FILE", "RIG"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
