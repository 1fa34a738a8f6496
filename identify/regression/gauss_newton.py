"""Gauss–Newton iteration: the equations are linearised again at the values found until a step is small.

Three kinds of values are found by it, each with its own rule for the longest step and the end: latencies of ordinary
runs (`CHECK_RULE`), sensor faults of a model (`FAULT_RULE`), and latencies before candidates are screened, whose rule
`Fit.latency_rule` makes from the settings of the selection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True)
class LinearStep:
    """Step of a Gauss–Newton iteration: the solution of the equations linearised at the present values.

    Attributes
    ----------
    step : (n,) change of the values.
    half : (n,) half of the 95 % intervals of the values; zero where the end does not depend on them.
    final : whether the iteration may end here; False where a more exact linearisation must follow.
    """

    step: Array
    half: Array | float = 0.0
    final: bool = True


@dataclass(frozen=True)
class Relinearised:
    """Result of a Gauss–Newton iteration.

    Attributes
    ----------
    values : (n,) values at which the equations were linearised last.
    settled : whether the last step found was small.
    made : number of steps made.
    """

    values: Array
    settled: bool
    made: int


@dataclass(frozen=True)
class StepRule:
    """Limits and stopping rule of a Gauss–Newton iteration.

    A step is small when that of each value is below the largest of the three tolerances `close`, `close_of_interval`
    and `close_of_value`.

    Attributes
    ----------
    most : largest number of steps.
    longest : longest step of a value, in the unit of the limits.
    close : tolerance in the unit of the limits.
    first_close : tolerance of the first step in place of `close`; None for the same.
    close_of_interval, close_of_value : tolerance as a share of half of the value's 95 % interval, and of the value
        after the step.
    small_step_made : whether the last, small step is made before the iteration ends.
    scale : unit of the limits ÷ unit of the values: ω at the cut-off [rad/s] for latencies [s] limited by phase [rad].
    """

    most: int
    longest: float = np.inf
    close: float = 0.0
    first_close: float | None = None
    close_of_interval: float = 0.0
    close_of_value: float = 0.0
    small_step_made: bool = False
    scale: float = 1.0

    def limited(self, step: Array) -> Array:
        """(n,) the step with each value's change limited to `longest`."""
        return np.clip(step, -self.longest / self.scale, self.longest / self.scale)

    def is_small(self, step: Array, values: Array, half: Array | float = 0.0, first: bool = False) -> bool:
        """Whether a step that leads to these values is small."""
        close = self.close if self.first_close is None or not first else self.first_close
        shares = np.maximum(self.close_of_interval * np.asarray(half), self.close_of_value * np.abs(values))
        return bool(np.all(np.abs(self.scale * step) < np.maximum(close, shares)))

    def relinearised(
        self,
        linearise: Callable[[int, Array], Array | LinearStep],
        start: Array,
        bounds: tuple[Array | float, Array | float] = (-np.inf, np.inf),
    ) -> Relinearised:
        """Linearise at `start`, step, and linearise again, until a step is small or `most` steps are made.

        Parameters
        ----------
        linearise : function of the number of steps made and of the present values (n,) that gives the next step. The
            last call is at the values that are returned.
        start : (n,) first values.
        bounds : least and largest values, each (n,) or one for all.
        """
        values, made = start, 0
        while True:
            found = linearise(made, values)
            linear = found if isinstance(found, LinearStep) else LinearStep(found)
            step = self.limited(linear.step)
            after = np.clip(values + step, *bounds)
            small = self.is_small(step, after, linear.half, first=made == 0)
            end = small and linear.final
            if made >= self.most or (end and not self.small_step_made):
                return Relinearised(values, small, made)
            values, made = after, made + 1
            if end:
                linearise(made, values)
                return Relinearised(values, small, made)


CHECK_RULE = StepRule(most=11, longest=0.015, close=5e-5, close_of_interval=0.05)
"""Rule for latencies of ordinary runs [s]. The longest step is about a fifth of the period at the fit's cut-off: beyond
it the first-order columns are no longer valid."""

FAULT_RULE = StepRule(most=4, close_of_value=1e-3, small_step_made=True)
"""Rule for sensor faults of a model, each in the unit of its parameter."""
