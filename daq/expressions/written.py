"""Reader of written expressions with units: ``300 mm - 1.32 * travel``."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from typing import Any

from lacet.daq.dimension import Dimension
from lacet.daq.expressions.dimensions import within_size
from lacet.daq.expressions.expression import FUNCTIONS, Expression, ExpressionFault
from lacet.daq.expressions.written_units import unit_at

NUMBER_TEXT = r"(?:\d+(?:\.\d+)?|\.\d+)(?:[eE][-+]?\d+)?"
_WRITTEN = re.compile(rf"(?<![\w.]){NUMBER_TEXT}")


def read_expression(
    text: str, functions: Mapping[str, Callable[..., Any]] = FUNCTIONS
) -> tuple[Expression, dict[int, Dimension]]:
    """The expression with numbers in SI, and the dimensions of numbers by their place in its tree.

    Raises ExpressionFault with the place in `text`.
    """
    units: dict[int, tuple[float, Dimension]] = {}
    for number in _WRITTEN.finditer(text):
        at = number.end() + len(text[number.end() :]) - len(text[number.end() :].lstrip(" "))
        if not re.match(r"[A-Za-zµ°%_]", text[at : at + 1]):
            continue
        try:
            factor, dimension, length = unit_at(text[at:])
        except ValueError as wrong:
            says = f"'{wrong}' is no unit that is known here (after a number stands its unit, or an operator)"
            raise ExpressionFault(text, says, at, at + len(str(wrong))) from None
        units[number.start()] = (factor, dimension)
        text = text[:at] + " " * length + text[at + length :]  # same length, so that places stay valid
    strange = re.search(r"[^\x20-\x7e]", text)
    if strange:
        known = {"·": "*", "×": "*", "−": "-", "–": "-", "÷": "/", "²": "**2", "³": "**3"}
        instead = f"; write {known[strange[0]]}" if strange[0] in known else ""
        raise ExpressionFault(text, f"'{strange[0]}' cannot be read here{instead}", *strange.span())
    expression = Expression.parse(text, functions)
    within_size(expression)
    dimensions: dict[int, Dimension] = {}
    for node in ast.walk(expression.tree):
        if isinstance(node, ast.Constant):
            found = units.get(expression.fault(node, "").start)
            if found is not None and isinstance(node.value, int | float):
                node.value, dimensions[node.col_offset] = node.value * found[0], found[1]
    return expression, dimensions
