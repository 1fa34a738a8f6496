"""Arithmetic expressions of a robot's table, ``-EF``, ``pi/2`` or ``2*L1*cos(A)``: read without running them."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

CONSTANTS = {"pi": math.pi, "Pi": math.pi, "PI": math.pi}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "cos": np.cos, "sin": np.sin, "tan": np.tan, "sqrt": np.sqrt,
    "acos": np.arccos, "asin": np.arcsin, "atan": np.arctan, "atan2": np.arctan2,
}  # fmt: skip
_ARGUMENTS = {"atan2": 2}
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: np.true_divide,
    ast.Pow: np.float_power,
}  # fmt: skip
_LONGEST = 4000
"""Characters: a longer text is no entry of a table (and would only try the parser's depth)."""


@dataclass(frozen=True)
class Expression:
    """A text that was vetted: numbers, names, ``+ - * / ** ^``, brackets and the functions of `FUNCTIONS`."""

    text: str
    tree: ast.expr

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Read a text. Raises ValueError that says what cannot be read."""
        written = text.strip()
        if not written:
            raise ValueError("nothing stands here")
        if len(written) > _LONGEST:
            raise ValueError(f"longer than {_LONGEST} characters")
        try:
            tree = ast.parse(written.replace("^", "**"), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise ValueError(f"'{written[:60]}' is no arithmetic expression") from None
        try:
            _vet(tree, written[:60])
        except RecursionError:
            raise ValueError(f"'{written[:60]}' is nested too deeply") from None
        return cls(written, tree)

    @classmethod
    def of(cls, value: float) -> Expression:
        """A constant."""
        return cls(repr(float(value)), ast.Constant(float(value)))

    @cached_property
    def symbols(self) -> frozenset[str]:
        """The names in it that need a value."""
        names = (node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name))
        return frozenset(names) - CONSTANTS.keys() - FUNCTIONS.keys()

    @cached_property
    def angles(self) -> tuple[Expression, ...]:
        """Arguments of its sines, cosines and tangents that hold symbols (those of a root or an arc are no angles)."""
        nodes = (node for node in ast.walk(self.tree) if isinstance(node, ast.Call))
        calls = [n for n in nodes if isinstance(n.func, ast.Name) and n.func.id in ("sin", "cos", "tan")]
        found = (Expression(ast.unparse(a), a) for call in calls for a in call.args)
        return tuple(a for a in found if a.symbols)

    def value(self, values: Mapping[str, float]) -> float:
        """Its number. Raises ValueError when that is not finite, KeyError for a symbol without value."""
        try:
            with np.errstate(all="ignore"):
                out = float(_evaluate(self.tree, values))
        except (ArithmeticError, ValueError) as error:
            raise ValueError(f"'{self.text}' has no value: {error}") from None
        if not math.isfinite(out):
            raise ValueError(f"'{self.text}' has no finite value")
        return out

    def series(self, values: Mapping[str, NDArray[np.float64]], count: int) -> NDArray[np.float64]:
        """Its numbers (count,) for series of the symbols' values (count,)."""
        return np.asarray(_evaluate(self.tree, values), float) * np.ones(count)


def _vet(node: ast.expr, text: str) -> None:
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise ValueError(f"'{text}': {node.value!r} is no number")
        if isinstance(node.value, int) and abs(node.value) > 2**1000:
            raise ValueError(f"'{text}': a number too large")
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        _vet(node.left, text)
        _vet(node.right, text)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        _vet(node.operand, text)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        name = node.func.id
        if name not in FUNCTIONS:
            raise ValueError(f"'{text}': the function {name} is not known (known: {', '.join(FUNCTIONS)})")
        if len(node.args) != _ARGUMENTS.get(name, 1):
            raise ValueError(f"'{text}': {name} takes {_ARGUMENTS.get(name, 1)} argument(s)")
        for argument in node.args:
            _vet(argument, text)
    elif not (isinstance(node, ast.Name) and node.id not in FUNCTIONS):
        raise ValueError(f"'{text}': only numbers, names, + - * / **, brackets and {', '.join(FUNCTIONS)} are read")


def _evaluate(node: ast.expr, values: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        return CONSTANTS[node.id] if node.id in CONSTANTS else values[node.id]
    if isinstance(node, ast.UnaryOp):
        operand = _evaluate(node.operand, values)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_evaluate(node.left, values), _evaluate(node.right, values))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return FUNCTIONS[node.func.id](*(_evaluate(a, values) for a in node.args))
