"""Formulas in the measured states, as ``travel_fl - travel_fr``: the language of own effects without parameters."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lacet.daq.dimension import Dimension
from lacet.daq.errors import UsageError, nearest
from lacet.daq.expressions.dimensions import Dimensions
from lacet.daq.expressions.expression import CONSTANTS, Expression, ExpressionFault
from lacet.daq.expressions.written import read_expression
from lacet.identify.car.motion import Motion
from lacet.identify.effects.language.linearity import FUNCTIONS, along_run, check_memory
from lacet.identify.effects.language.states import Use, all_names, use_of
from lacet.identify.multibody.vectors import Array

LONGEST = 500
"""Length of the longest formula [characters]."""


@dataclass(frozen=True)
class Formula:
    """A formula: its `text`, the `uses` of states in it by name, and the `dimension` of its value."""

    text: str
    expression: Expression
    uses: Mapping[str, Use]
    dimension: Dimension

    @property
    def unit(self) -> str:
        """SI unit of its value, that of the state where it is one alone."""
        alone = self.uses.get(self.text)
        return alone.state.unit if alone else self.dimension.unit

    def series(self, motion: Motion) -> Array:
        """(N,) its values along a motion, NaN where not finite. Raises UsageError for channels that it lacks."""
        lacking = dict.fromkeys(channel for use in self.uses.values() for channel in use.lacks(motion, ""))
        if lacking:
            raise UsageError(f"{self.text}: {', '.join(lacking)} not measured in {motion.name}")
        step = float(np.ptp(motion.t)) / max(1, motion.t.size - 1)
        values = {name: use.value(motion, "") for name, use in self.uses.items()}
        with np.errstate(all="ignore"):
            out = self.expression.series(values, motion.t.size, along_run(step))
        return np.where(np.isfinite(out), out, np.nan)


def read_formula(text: str) -> Formula:
    """The formula of a text. Raises UsageError with the part at fault."""
    if len(text) > LONGEST:
        raise UsageError(f"a formula has at most {LONGEST} characters")
    written = text.strip()
    try:
        expression, units = read_expression(written, FUNCTIONS)
        uses = {node.id: _use(expression, node) for node in _names(expression)}
        if not uses:
            raise expression.fault(expression.tree, "no measured state is in it, such as travel_fl or ay")
        check_memory(expression, uses.keys())
        known = {name: use.state.dimension for name, use in uses.items()}
        dimension = Dimensions(expression, known, units).of()
    except ExpressionFault as fault:
        part = written[fault.start : fault.stop]
        raise UsageError(f"{fault.says}{f' (at “{part}”)' if part and part != written else ''}") from None
    return Formula(written, expression, uses, dimension)


def _names(expression: Expression) -> list[ast.Name]:
    names = [node for node in ast.walk(expression.tree) if isinstance(node, ast.Name)]
    return [node for node in names if node.id not in (*CONSTANTS, *FUNCTIONS)]


def _use(expression: Expression, node: ast.Name) -> Use:
    """The state that a name denotes, of a wheel by name or of the body."""
    use = use_of(node.id)
    if use is None:
        raise expression.fault(node, f"there is no state '{node.id}'{nearest(node.id, all_names())}")
    if use.wheel in ("own", "other"):
        stem = use.state.name
        raise expression.fault(
            node, f"{node.id} belongs to a wheel: write {stem}_fl, {stem}_fr, {stem}_rl or {stem}_rr"
        )
    return use
