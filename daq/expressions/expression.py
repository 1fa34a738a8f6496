"""Arithmetic expressions as in a robot's table, ``2*L1*cos(A)``, or a one-line effect: parsed, never executed."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

CONSTANTS = {"pi": math.pi, "Pi": math.pi, "PI": math.pi}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "cos": np.cos, "sin": np.sin, "tan": np.tan, "sqrt": np.sqrt,
    "acos": np.arccos, "asin": np.arcsin, "atan": np.arctan, "atan2": np.arctan2,
}  # fmt: skip
_ARGUMENTS = {"atan2": 2, "min": 2, "max": 2, "lag": 2, "hysteresis": 2}
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: np.true_divide,
    ast.Pow: np.float_power,
}  # fmt: skip
_LONGEST = 4000
"""Longest expression accepted [characters]: a longer text would only exhaust the parser's depth."""


class ExpressionFault(ValueError):
    """A fault in an expression: the reason `says`, and its place, the characters `start` to `stop`."""

    def __init__(self, text: str, says: str, start: int = 0, stop: int | None = None):
        super().__init__(f"'{text[:60]}': {says}")
        self.says, self.start, self.stop = says, start, len(text) if stop is None else stop


@dataclass(frozen=True)
class Expression:
    """An arithmetic expression, never executed: numbers, names, ``+ - * / ** ^``, brackets and `functions`."""

    text: str
    tree: ast.expr
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=lambda: FUNCTIONS, repr=False)

    @classmethod
    def parse(cls, text: str, functions: Mapping[str, Callable[..., Any]] = FUNCTIONS) -> Expression:
        """The expression of a text. Raises ExpressionFault with the part at fault, its place in the stripped text."""
        written = text.strip()
        if not written:
            raise ExpressionFault(written, "nothing stands here")
        if len(written) > _LONGEST:
            raise ExpressionFault(written, f"longer than {_LONGEST} characters")
        try:
            tree = ast.parse(written.replace("^", "**"), mode="eval").body
        except SyntaxError as cause:
            at = _before(written, (cause.offset or 1) - 1) if cause.lineno == 1 else 0
            stop = at + 1 if at < len(written) else None
            raise ExpressionFault(written, "this is no arithmetic expression", at if stop else 0, stop) from None
        except (ValueError, MemoryError, RecursionError):
            raise ExpressionFault(written, "this is no arithmetic expression") from None
        try:
            _vet(tree, written, functions)
        except RecursionError:
            raise ExpressionFault(written, "nested too deeply") from None
        return cls(written, tree, functions)

    def fault(self, node: ast.expr, says: str) -> ExpressionFault:
        """A fault at a node of the expression."""
        return _fault(node, self.text, says)

    @classmethod
    def of(cls, value: float) -> Expression:
        """A constant expression."""
        return cls(repr(float(value)), ast.Constant(float(value)))

    @cached_property
    def symbols(self) -> frozenset[str]:
        """Names in the expression that need a value."""
        names = (node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name))
        return frozenset(names) - CONSTANTS.keys() - self.functions.keys()

    @cached_property
    def angles(self) -> tuple[Expression, ...]:
        """Arguments with symbols of its sines, cosines and tangents; those of roots and arc functions are no angles."""
        nodes = (node for node in ast.walk(self.tree) if isinstance(node, ast.Call))
        calls = [n for n in nodes if isinstance(n.func, ast.Name) and n.func.id in ("sin", "cos", "tan")]
        found = (Expression(ast.unparse(a), a, self.functions) for call in calls for a in call.args)
        return tuple(a for a in found if a.symbols)

    def value(self, values: Mapping[str, float]) -> float:
        """Numerical value. Raises ValueError when it is not finite, KeyError for a symbol without value."""
        try:
            with np.errstate(all="ignore"):
                out = float(_evaluate(self.tree, values, self.functions))
        except (ArithmeticError, ValueError) as error:
            raise ValueError(f"'{self.text}' has no value: {error}") from None
        if not math.isfinite(out):
            raise ValueError(f"'{self.text}' has no finite value")
        return out

    def series(
        self, values: Mapping[str, NDArray[np.float64] | float], count: int,
        functions: Mapping[str, Callable[..., Any]] | None = None,
    ) -> NDArray[np.float64]:  # fmt: skip
        """Numerical values (count,) for series of the symbols' values, (count,) or a number.

        `functions` : in place of the expression's own, of the same names.
        """
        found = np.asarray(_evaluate(self.tree, values, functions or self.functions), float)
        return np.array(np.broadcast_to(found, (count,)))


def _before(written: str, place: int) -> int:
    """Place of a character before each ``^`` was replaced by ``**``."""
    for at, character in enumerate(written):
        if character == "^" and at < place:
            place -= 1
    return min(place, len(written))


def _fault(node: ast.expr, text: str, says: str) -> ExpressionFault:
    return ExpressionFault(text, says, _before(text, node.col_offset), _before(text, node.end_col_offset or 0))


def _vet(node: ast.expr, text: str, functions: Mapping[str, Callable[..., Any]]) -> None:
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise _fault(node, text, f"{node.value!r} is no number")
        if isinstance(node.value, int) and abs(node.value) > 2**1000:
            raise _fault(node, text, "a number too large")
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        _vet(node.left, text, functions)
        _vet(node.right, text, functions)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        _vet(node.operand, text, functions)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        name = node.func.id
        if name not in functions:
            known = ", ".join(functions)
            raise _fault(node.func, text, f"the function {name} is not known (known: {known})")
        if len(node.args) != _ARGUMENTS.get(name, 1):
            raise _fault(node, text, f"{name} takes {_ARGUMENTS.get(name, 1)} argument(s)")
        for argument in node.args:
            _vet(argument, text, functions)
    elif not (isinstance(node, ast.Name) and node.id not in functions):
        raise _fault(node, text, f"only numbers, names, + - * / **, brackets and {', '.join(functions)} are read")


def _evaluate(node: ast.expr, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        return CONSTANTS[node.id] if node.id in CONSTANTS else values[node.id]
    if isinstance(node, ast.UnaryOp):
        operand = _evaluate(node.operand, values, functions)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.BinOp):
        left, right = (_evaluate(part, values, functions) for part in (node.left, node.right))
        return _OPERATORS[type(node.op)](left, right)
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return functions[node.func.id](*(_evaluate(a, values, functions) for a in node.args))
