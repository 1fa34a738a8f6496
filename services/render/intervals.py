"""Values beside their intervals: a half-width to two significant digits, its value to the same decimal place."""

from __future__ import annotations

import math


def to_interval(value: float, half: float | None = None, sign: str = "") -> str:
    """A value to the decimal place of the second significant digit of its interval's half-width `half`.

    Without a power of ten: 51234 beside 2184 is 51200. To five significant digits where `half` is None, 0 or not
    finite. `sign` : ``"+"`` to write the sign of positive values too.
    """
    if half is None or not 0.0 < half < math.inf:
        return f"{value:{sign}.5g}"
    place = 1 - int(f"{half:.1e}".partition("e")[2])
    return f"{round(float(value), place) + 0.0:{sign}.{max(0, place)}f}"


def half_width(half: float) -> str:
    """Half of an interval to two significant digits, without a power of ten: 2184 is 2200."""
    return to_interval(half, half)


def with_interval(value: float, half: float, sign: str = "") -> str:
    """A value with its interval, ``51200 ± 2200``; `sign` as in `to_interval`."""
    return f"{to_interval(value, half, sign)} ± {half_width(half)}"
