"""Dimensional analysis of expressions, and the largest size of one."""

from __future__ import annotations

import ast
import operator
from collections.abc import Mapping, Set
from fractions import Fraction

from lacet.daq.dimension import NUMBER, TIME, Dimension
from lacet.daq.expressions.expression import CONSTANTS, Expression

MEMORY = ("lag", "hysteresis")
"""Functions whose value depends on the run until now; their second argument is a constant above 0."""
LARGEST_POWER = 8.0
MOST_PARTS, DEEPEST = 300, 40
"""Largest number of nodes (numbers, names, operations) of one expression, and largest depth of nesting."""


def within_size(expression: Expression) -> None:
    """Check of an expression's size. Raises ExpressionFault where it is too large to be a law."""

    def depth(node: ast.AST) -> int:
        return 1 + max((depth(child) for child in ast.iter_child_nodes(node)), default=0)

    if sum(1 for node in ast.walk(expression.tree) if isinstance(node, ast.expr)) > MOST_PARTS:
        raise expression.fault(expression.tree, f"more than {MOST_PARTS} numbers, names and operations")
    if depth(expression.tree) > DEEPEST:
        raise expression.fault(expression.tree, f"brackets and operations are nested more than {DEEPEST} deep")


def names_in(node: ast.AST) -> list[ast.Name]:
    """Every name in a part of an expression."""
    return [part for part in ast.walk(node) if isinstance(part, ast.Name)]


class Dimensions:
    """Dimensional analysis of an expression: the physical dimension of each part.

    Parameters
    ----------
    names : dimension of every name but ``pi``; None where it is not known and may be any.
    units : dimension of a number by its place; other numbers are plain.
    constants : those of the names that are constants, one of which may be an exponent.
    """

    def __init__(
        self, expression: Expression, names: Mapping[str, Dimension | None], units: Mapping[int, Dimension],
        constants: Set[str] = frozenset(),
    ):  # fmt: skip
        self.expression, self.names, self.units, self.constants = expression, names, units, constants

    def of(self, node: ast.expr | None = None) -> Dimension:
        """The dimension of a part, by default of the whole. Raises ExpressionFault where dimensions do not agree."""
        return self._of(self.expression.tree if node is None else node) or NUMBER

    def found(self) -> Dimension | None:
        """The dimension of the whole, None where it could be any. Raises ExpressionFault as `of`."""
        return self._of(self.expression.tree)

    def _of(self, node: ast.expr) -> Dimension | None:
        """The dimension of a part; None for one that agrees with every dimension: a bare zero, max(0, travel)."""
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
        if left is None or right is None:
            return None
        return operator.mul(left, right) if isinstance(node.op, ast.Mult) else left / right

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
        symbols = {name.id for name in names_in(node.right)} - CONSTANTS.keys()
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
        if name in ("min", "max", "atan2"):
            found = self._alike(node, node.args[0], node.args[1])
            return NUMBER if name == "atan2" else found
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
