"""A story: a page of commands in fenced ``sh`` blocks, each with what it printed in the ``text`` block after it.

What a page shows is shortened: ``…`` stands for anything left out. Every piece between two ``…`` must stand in the
output, in that order: words as they are, line breaks and column widths as they like, numbers within 3 % or one and a
half units of their last digit. Rulers of tables (``---``) are not looked at.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from lacet.daq.formats.result import DONE, WITH_LOSSES
from lacet.services.commands.__main__ import main

STORIES = Path(__file__).resolve().parents[2] / "docs" / "stories"
TOLERANCE = 0.03
"""Relative difference of a number that rounding on another machine may make."""
UNITS = 1.5
"""The same in units of the last digit printed."""

_BLOCK = re.compile(r"^```sh\n(?P<sh>.*?)^```$(?:\n+```text\n(?P<text>.*?)^```$)?", re.MULTILINE | re.DOTALL)
_TOKEN = re.compile(r"(?P<number>[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)|[^\W\d]+|\S")
_REMARK = re.compile(r"^! ", re.MULTILINE)
"""What was left out; a page that shows it expects the exit code that goes with it."""
_RULER = re.compile(r"^[\s-]*-{3}[\s-]*$", re.MULTILINE)


@dataclass(frozen=True)
class Step:
    """The commands of one block, and what the page says they print."""

    commands: tuple[str, ...]
    shown: str


def steps(page: str) -> list[Step]:
    """The blocks of a page, in order."""
    text = (STORIES / page).read_text(encoding="utf-8")
    return [
        Step(tuple(block["sh"].replace("\\\n", " ").strip().splitlines()), block["text"] or "")
        for block in _BLOCK.finditer(text)
    ]


def play(step: Step) -> str:
    """Run a block's commands in the present folder; what they print. Raises AssertionError when one fails."""
    out = io.StringIO()
    for command in step.commands:
        program, *words = shlex.split(command)
        assert program == "lacet", f"a story has commands of lacet alone, found: {command}"
        with contextlib.redirect_stdout(out):
            code = main(words)
        expected = (DONE, WITH_LOSSES) if _REMARK.search(step.shown) else (DONE,)
        assert code in expected, f"{command}: exit code {code}\n{out.getvalue()}"
    return out.getvalue()


def not_printed(shown: str, printed: str) -> str | None:
    """The first piece of what a page shows that was not printed, or None when all was."""
    have, place = _tokens(printed), 0
    for piece in shown.split("…"):
        want = _tokens(piece)
        found = next((i for i in range(place, len(have) - len(want) + 1) if _same(want, have[i : i + len(want)])), None)
        if found is None:
            return piece.strip()
        place = found + len(want)
    return None


def _tokens(text: str) -> list[tuple[str, bool]]:
    return [(m[0], m["number"] is not None) for m in _TOKEN.finditer(_RULER.sub("", text))]


def _same(want: list[tuple[str, bool]], have: list[tuple[str, bool]]) -> bool:
    return all(
        numeric == also and (close(word, other) if numeric else word == other)
        for (word, numeric), (other, also) in zip(want, have, strict=True)
    )


def close(shown: str, printed: str) -> bool:
    """Whether a printed number is the one shown, within what another machine may change."""
    a, b = (float(word.replace("−", "-")) for word in (shown, printed))
    decimals = len(shown.partition("e")[0].partition(".")[2])
    last = 0.0 if "e" in shown else 10.0**-decimals
    return abs(a - b) <= max(TOLERANCE * abs(a), UNITS * last)
