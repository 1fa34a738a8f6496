"""Decomposition of a law that is linear in its parameters: parameter → measured expression with its dimension."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Set
from fractions import Fraction
from typing import Any

import numpy as np

from lacet.identify.effects.language.units import NUMBER, TIME, Dimension
from lacet.identify.effects.memory import dahl, first_order_lag
from lacet.identify.multibody.expression import CONSTANTS, Expression
from lacet.identify.multibody.vectors import Array


def _lag_of_constant(x: Array, time: float) -> Array:
    return x


def _hysteresis_of_constant(x: Array, length: float) -> Array:
    return np.sign(x)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs, "sign": np.sign, "sqrt": np.sqrt, "min": np.minimum, "max": np.maximum,
    "exp": np.exp, "log": np.log, "tanh": np.tanh, "sin": np.sin, "cos": np.cos, "tan": np.tan, "atan": np.arctan,
    "lag": _lag_of_constant, "hysteresis": _hysteresis_of_constant,
}  # fmt: skip
"""Functions that a one-line effect may use; those with memory as they are for a state that has long been constant."""
MEMORY = ("lag", "hysteresis")
"""Functions whose value depends on the run until now; their second argument is a constant above 0."""
LARGEST_POWER = 8.0
MOST_PARTS, DEEPEST = 300, 40
"""Largest number of nodes (numbers, names, operations) of one expression, and largest depth of nesting."""

Terms = dict[str, ast.expr]
"""Parameter → its factor; the term without a parameter has an empty name."""


def along_run(step: float) -> dict[str, Callable[..., Any]]:
    """The functions on series sampled every `step` [s]: with memory."""

    def lag(x: Array, time: float) -> Array:
        return first_order_lag(x, time, step) if time > 0.0 else np.full(x.shape, np.nan)

    def hysteresis(x: Array, length: float) -> Array:
        return dahl(x, length) if length > 0.0 else np.full(x.shape, np.nan)

    return {**FUNCTIONS, "lag": lag, "hysteresis": hysteresis}


def has_memory(expression: Expression) -> bool:
    """Whether a function with memory is in an expression."""
    return bool(_calls_with_memory(expression))


def check_memory(expression: Expression, states: Set[str]) -> None:
    """Check that each function with memory has states in its first argument and none in its second.

    Raises ExpressionFault.
    """
    for call in _calls_with_memory(expression):
        name, (series, constant) = ast.unparse(call.func), call.args
        if not _inside(series, states):
            raise expression.fault(series, f"{name}() follows a measured state, and there is none in this")
        if _inside(constant, states):
            says = f"the second argument of {name}() is a constant: a number with its unit, or one that is searched"
            raise expression.fault(constant, says)


def _calls_with_memory(expression: Expression) -> list[ast.Call]:
    return [n for n in ast.walk(expression.tree) if isinstance(n, ast.Call) and ast.unparse(n.func) in MEMORY]


def within_size(expression: Expression) -> None:
    """Check of an expression's size. Raises ExpressionFault where it is too large to be a law."""

    def depth(node: ast.AST) -> int:
        return 1 + max((depth(child) for child in ast.iter_child_nodes(node)), default=0)

    if sum(1 for node in ast.walk(expression.tree) if isinstance(node, ast.expr)) > MOST_PARTS:
        raise expression.fault(expression.tree, f"more than {MOST_PARTS} numbers, names and operations")
    if depth(expression.tree) > DEEPEST:
        raise expression.fault(expression.tree, f"brackets and operations are nested more than {DEEPEST} deep")


def terms_of(expression: Expression, parameters: Set[str]) -> dict[str, Expression]:
    """The terms of an expression that is linear in `parameters`: parameter → factor, in the order written.

    Exact: the tree is expanded symbolically. Raises ExpressionFault with the place where it is not linear, or where a
    term has no parameter.
    """
    found = _expanded(expression, expression.tree, parameters)
    if "" in found:
        raise expression.fault(
            found[""], "this has no parameter: every term must be parameter × something, as in p * travel**2"
        )
    written = [n.id for n in sorted(_names(expression.tree), key=lambda n: n.col_offset)]
    order = [name for name in dict.fromkeys(written) if name in found]
    return {name: Expression(expression.text, found[name], expression.functions) for name in order}


def _names(node: ast.AST) -> list[ast.Name]:
    return [part for part in ast.walk(node) if isinstance(part, ast.Name)]


def _inside(node: ast.expr, parameters: Set[str]) -> list[str]:
    return sorted({part.id for part in _names(node)} & parameters)


def _expanded(expression: Expression, node: ast.expr, parameters: Set[str]) -> Terms:
    inside = _inside(node, parameters)
    if not inside:
        return {"": node}
    if isinstance(node, ast.Name):
        return {node.id: ast.copy_location(ast.Constant(1.0), node)}
    if isinstance(node, ast.UnaryOp):
        parts = _expanded(expression, node.operand, parameters)
        return {name: ast.copy_location(ast.UnaryOp(node.op, part), part) for name, part in parts.items()}
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        out = _expanded(expression, node.left, parameters)
        for name, part in _expanded(expression, node.right, parameters).items():
            if name in out:
                out[name] = ast.copy_location(ast.BinOp(out[name], node.op, part), node)
            elif isinstance(node.op, ast.Sub):
                out[name] = ast.copy_location(ast.UnaryOp(ast.USub(), part), part)
            else:
                out[name] = part
        return out
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        return _scaled(expression, node, parameters)
    names = " and ".join(inside)
    if isinstance(node, ast.Call):
        how = f"stands inside {ast.unparse(node.func)}()"
    elif isinstance(node, ast.BinOp) and _inside(node.right, parameters):
        how = "stands in an exponent"
    else:
        how = "is raised to a power"
    raise expression.fault(node, f"{names} {how}, {_REMEDY.format(inside[0])}")


_REMEDY = (
    "but a law must be linear in its parameters. Make it a constant that is searched: add ', {0} = 0.01 0.02 UNIT' at "
    "the end of the line"
)


def _scaled(expression: Expression, node: ast.BinOp, parameters: Set[str]) -> Terms:
    left, right = _inside(node.left, parameters), _inside(node.right, parameters)
    if isinstance(node.op, ast.Div) and right:
        raise expression.fault(node.right, f"{' and '.join(right)} stands in a divisor, {_REMEDY.format(right[0])}")
    if left and right:
        for part in (node.left, node.right):  # a factor that is not linear by itself is reported first
            _expanded(expression, part, parameters)
        both = " and ".join(dict.fromkeys((*left, *right)))
        says = f"{both} are multiplied" if len({*left, *right}) > 1 else f"{both} appears squared"
        raise expression.fault(node, f"{says}, {_REMEDY.format(right[0])}")
    carrier, factor = (node.left, node.right) if left else (node.right, node.left)
    out: Terms = {}
    for name, part in _expanded(expression, carrier, parameters).items():
        pair = (part, factor) if left else (factor, part)
        out[name] = ast.copy_location(ast.BinOp(pair[0], node.op, pair[1]), node)
    return out


class Dimensions:
    """Dimensional analysis of an expression: the physical dimension of each part.

    Parameters
    ----------
    names : dimension of every name but ``pi``.
    units : dimension of a number by its place; other numbers are plain.
    constants : those of the names that are constants, one of which may be an exponent.
    """

    def __init__(
        self, expression: Expression, names: Mapping[str, Dimension], units: Mapping[int, Dimension],
        constants: Set[str] = frozenset(),
    ):  # fmt: skip
        self.expression, self.names, self.units, self.constants = expression, names, units, constants

    def of(self, node: ast.expr | None = None) -> Dimension:
        """The dimension of a part, by default of the whole. Raises ExpressionFault where dimensions do not agree."""
        return self._of(self.expression.tree if node is None else node) or NUMBER

    def _of(self, node: ast.expr) -> Dimension | None:
        """The dimension of a part; None for a bare zero, which agrees with every dimension: max(0, travel)."""
        if isinstance(node, ast.Constant):
            return None if node.value == 0 and node.col_offset not in self.units else self._number(node)
        if isinstance(node, ast.Name):
            return NUMBER if node.id in CONSTANTS else self.names[node.id]
        if isinstance(node, ast.UnaryOp):
            return self._of(node.operand)
        if isinstance(node, ast.Call):
            return self._call(node)
        assert isinstance(node, ast.BinOp)
        if isinstance(node.op, ast.Add | ast.Sub):
            return self._alike(node, node.left, node.right)
        if isinstance(node.op, ast.Pow):
            return self._power(node)
        left, right = self._of(node.left), self._of(node.right)
        if left is None:
            return None
        return operator.mul(left, right or NUMBER) if isinstance(node.op, ast.Mult) else left / (right or NUMBER)

    def _number(self, node: ast.Constant) -> Dimension:
        return self.units.get(node.col_offset, NUMBER)

    def _text(self, node: ast.expr) -> str:
        fault = self.expression.fault(node, "")
        return self.expression.text[fault.start : fault.stop]

    def _alike(self, node: ast.expr, left: ast.expr, right: ast.expr) -> Dimension | None:
        first, second = self._of(left), self._of(right)
        if first is None or second is None:
            return first or second
        if first != second:
            parts = f"{self._text(left)} [{first.unit}] and {self._text(right)} [{second.unit}]"
            raise self.expression.fault(node, f"{parts} have different units and cannot be added or compared")
        return first

    def _power(self, node: ast.BinOp) -> Dimension | None:
        if not (self._of(node.right) or NUMBER).plain:
            raise self.expression.fault(node.right, "an exponent has no unit")
        symbols = {name.id for name in _names(node.right)} - CONSTANTS.keys()
        if symbols and symbols <= self.constants and (self._of(node.left) or NUMBER).plain:
            return NUMBER
        if symbols:
            says = "an exponent must be a number, or a constant where what is raised has no unit: (travel/10 mm)**n"
            raise self.expression.fault(node.right, says)
        try:
            power = Expression(self.expression.text, node.right, self.expression.functions).value({})
        except ValueError:
            raise self.expression.fault(node.right, "this exponent has no finite value") from None
        if abs(power) > LARGEST_POWER:
            raise self.expression.fault(node.right, f"an exponent may be ±{LARGEST_POWER:g} at most")
        base = self._of(node.left)
        return base if base is None or base.plain else base ** Fraction(power).limit_denominator(12)

    def _call(self, node: ast.Call) -> Dimension | None:
        name = ast.unparse(node.func)
        if name in ("min", "max"):
            return self._alike(node, node.args[0], node.args[1])
        inside = self._of(node.args[0])
        if name == "abs":
            return inside
        if name in MEMORY:
            second, wanted = self._of(node.args[1]), TIME if name == "lag" else inside or NUMBER
            if second is not None and second != wanted:
                says = f"the second argument of {name}() is in {wanted.unit}, and this is in {second.unit}"
                raise self.expression.fault(node.args[1], says)
            return inside if name == "lag" else NUMBER
        if name == "sign":
            return NUMBER
        if name == "sqrt":
            return None if inside is None else inside ** Fraction(1, 2)
        if inside is not None and not inside.plain:
            what = self._text(node.args[0])
            raise self.expression.fault(
                node.args[0],
                f"{name}() takes a plain number, and {what} is in {inside.unit}: divide it by a constant, as in "
                f"{name}(({what})/c0), and give the constant at the end of the line: ', c0 = 0.01 0.02 {inside.unit}'",
            )
        return NUMBER
