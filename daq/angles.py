"""Angles made continuous: what was cut off at full turns is put back, piece by piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TURN = 2.0 * np.pi
_WITHIN = 1.05
"""Range of an angle that is cut off at full turns, at most [turns]: its scale may be some per cent off."""
_TAILS = (0.02, 0.98)
"""Quantiles of the values between which their range is taken: a damaged sample is no turn."""


@dataclass
class ContinuousAngle:
    """Continues an angle of which full turns were cut off; one that goes beyond a turn by itself counts its turns.

    Steps of more than half a turn are a cut in the former, and fast turning in the latter, also behind a pause.
    """

    _last: NDArray[np.float64] | None = None
    _turns: NDArray[np.float64] | None = None
    _counted: NDArray[np.bool_] | None = None

    def add(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next values (N, k) [rad], all finite, made continuous with those before."""
        if not len(values):
            return values
        before = values[:1] if self._last is None else self._last
        low, high = np.quantile(values, _TAILS, axis=0)
        counted = high - low > _WITHIN * _TURN
        self._counted = counted = counted if self._counted is None else self._counted | counted
        steps = np.diff(values, axis=0, prepend=before)
        cut = np.where(counted, 0.0, -np.rint(steps / _TURN))
        turns = np.cumsum(cut, axis=0) + (0.0 if self._turns is None else self._turns)
        self._last, self._turns = values[-1:], turns[-1:]
        return values + _TURN * turns
