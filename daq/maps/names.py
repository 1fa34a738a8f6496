"""Names of a log inside an expression: plain, with dots (``ID_D0.STEER_ANGLE``), or in backquotes (```Lat Acc```)."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from lacet.daq.dimension import Dimension
from lacet.daq.expressions.expression import CONSTANTS, Expression, ExpressionFault
from lacet.daq.expressions.functions import FUNCTIONS
from lacet.daq.expressions.written import read_expression

_QUOTED = re.compile(r"`([^`]+)`|(?<![\w.`])([A-Za-z_]\w*(?:\.\w+)+)")


@dataclass(frozen=True)
class Written:
    """An expression over names of a log.

    Attributes
    ----------
    text : as written.
    expression : with numbers in SI; names that are no identifiers have stand-ins of the same length.
    numbers : dimension of each number by its place.
    names : name in the expression → name in the log.
    """

    text: str
    expression: Expression
    numbers: Mapping[int, Dimension]
    names: Mapping[str, str]

    @property
    def bare(self) -> bool:
        """Whether it is one name, perhaps with a sign: its unit is that of the result."""
        return re.fullmatch(r"[-+\s(]*(`[^`]+`|[A-Za-z_][\w.]*)[\s)]*", self.text) is not None


def read_names(text: str, functions: Mapping[str, Callable[..., Any]]) -> Written:
    """The expression of a text. Raises ExpressionFault with the place in `text`."""
    stand_ins: dict[str, str] = {}
    for_name: dict[str, str] = {}

    def stand_in(found: re.Match[str]) -> str:
        name = found[1] if found[1] is not None else found[2]
        length = len(found[0])
        key = (name, length)
        known = for_name.get(str(key))
        if known is None:
            known = f"_{len(for_name)}".ljust(length, "_")
            for_name[str(key)] = known
            stand_ins[known] = name
        return known

    plain = _QUOTED.sub(stand_in, text)
    expression, numbers = read_expression(plain, functions)
    names = {name: stand_ins.get(name, name) for name in sorted(expression.symbols) if name not in CONSTANTS}
    return Written(text, expression, numbers, names)


def marked(text: str, fault: ExpressionFault) -> str:
    """The text with a mark under the place of a fault."""
    width = max(1, fault.stop - fault.start)
    return f"{fault.says}\n      {text}\n      {' ' * fault.start}{'^' * width}"


def written_name(name: str) -> str:
    """A name as an expression has it: in backquotes where it is no plain word."""
    plain = re.fullmatch(r"[A-Za-z_]\w*(\.\w+)*", name, re.ASCII)
    taken = any(part in FUNCTIONS or keyword.iskeyword(part) or part == "pi" for part in name.split("."))
    return name if plain and not taken else f"`{name}`"
