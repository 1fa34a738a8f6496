"""Cubic splines through samples: value and two derivatives.

Slopes at the knots are solved for as C. de Boor, A Practical Guide to Splines (2001), chapter IV, has them. Written out
because to import scipy.interpolate takes a third of a second, of which `lacet identify` takes a few.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CubicSpline:
    """A cubic spline through k series at common knots.

    Attributes
    ----------
    knots : (M,) strictly increasing, M ≥ 2.
    values, slopes : (k, M) of the series at the knots.
    """

    knots: Array
    values: Array
    slopes: Array

    @classmethod
    def of(cls, knots: Array, values: Array, natural: bool = False) -> CubicSpline:
        """Through `values` (k, M) at `knots` (M,).

        `natural` : curvature 0 at both ends; else the first two and the last two pieces are one cubic each
        (not-a-knot; through three samples a parabola, through two a line).
        """
        h = np.diff(knots)
        rise = np.diff(values, axis=-1) / h
        if len(knots) == 2:
            return cls(knots, values, np.concatenate([rise, rise], axis=-1))
        if len(knots) == 3 and not natural:
            bend = (rise[:, 1:] - rise[:, :1]) / (knots[2] - knots[0])
            first = rise[:, :1] - bend * h[0]
            return cls(knots, values, first + 2.0 * bend * (knots - knots[0]))
        # Bands below, on and above the diagonal; the first and the last line are the conditions at the ends.
        below, on, above = np.append(h[1:], 0.0), np.zeros(len(knots)), np.append(0.0, h[:-1])
        side = np.empty((len(values), len(knots)))
        on[1:-1] = 2.0 * (h[:-1] + h[1:])
        side[:, 1:-1] = 3.0 * (h[1:] * rise[:, :-1] + h[:-1] * rise[:, 1:])
        if natural:
            on[0], above[0], on[-1], below[-1] = 2.0, 1.0, 2.0, 1.0
            side[:, 0], side[:, -1] = 3.0 * rise[:, 0], 3.0 * rise[:, -1]
        else:
            two, last = h[0] + h[1], h[-1] + h[-2]
            on[0], above[0], on[-1], below[-1] = h[1], two, h[-2], last
            side[:, 0] = ((h[0] + 2.0 * two) * h[1] * rise[:, 0] + h[0] ** 2 * rise[:, 1]) / two
            side[:, -1] = (h[-1] ** 2 * rise[:, -2] + (2.0 * last + h[-1]) * h[-2] * rise[:, -1]) / last
        slopes = scipy.linalg.lapack.dgtsv(below, on, above, side.T)[3]
        return cls(knots, values, np.asarray(slopes, float).T)

    def at(self, x: Array, derivative: int = 0) -> Array:
        """(k, N) values at `x` (N,), or first or second derivatives; the last pieces are continued beyond the ends."""
        return self._of_pieces(x, (derivative,))[0]

    def course(self, x: Array) -> tuple[Array, Array, Array]:
        """(k, N) values, first and second derivatives at `x` (N,), as `at` has them."""
        value, slope, curvature = self._of_pieces(x, (0, 1, 2))
        return value, slope, curvature

    def one(self, k: int) -> CubicSpline:
        """The spline through series `k` alone."""
        return CubicSpline(self.knots, self.values[k : k + 1], self.slopes[k : k + 1])

    def _of_pieces(self, x: Array, derivatives: Collection[int]) -> list[Array]:
        piece = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        h = np.diff(self.knots)[piece]
        u = (x - self.knots[piece]) / h
        start, first, last = self.values[:, piece], self.slopes[:, piece], self.slopes[:, piece + 1]
        rise = (self.values[:, piece + 1] - start) / h
        square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
        of = {
            0: lambda: start + h * u * (first + u * (square + u * cube)),
            1: lambda: first + u * (2.0 * square + 3.0 * u * cube),
            2: lambda: (2.0 * square + 6.0 * u * cube) / h,
        }
        return [of[derivative]() for derivative in derivatives]
