"""Decomposition of a law that is linear in its parameters: parameter → measured expression."""

from __future__ import annotations

import ast
from collections.abc import Callable, Set
from typing import Any

import numpy as np

from lacet.daq.expressions.dimensions import MEMORY, names_in
from lacet.daq.expressions.expression import Expression
from lacet.identify.effects.memory import dahl, first_order_lag
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
    written = [n.id for n in sorted(names_in(expression.tree), key=lambda n: n.col_offset)]
    order = [name for name in dict.fromkeys(written) if name in found]
    return {name: Expression(expression.text, found[name], expression.functions) for name in order}


def _inside(node: ast.expr, parameters: Set[str]) -> list[str]:
    return sorted({part.id for part in names_in(node)} & parameters)


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
