"""Common scale of rows without wheel loads, which shows nothing of what the model lacks.

All that is known in such rows is in proportion to what is given, as the sprung mass, and to the specific force. With
either smaller, all parameters and whatever the model leaves are smaller by one factor: in proportion to the car's
forces the model is as wrong as before. Weighted by a noise that stays, it would seem to be right: of a front bump stop
that was missing, a sprung mass off by 95 tolerances took 98 % of the squares.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from lacet.daq.assumptions import SETS_SCALE
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.tolerances import ASSUMED


def scales_all(what: str, name: str) -> bool:
    """Whether an entry of the sensor sheet, or a fault of its kind in a channel, acts in proportion to what is known.

    Source: the left sides of combined rows (`identify.car.motion.Motion.measured`), known masses times specific force.
    """
    return (what == ASSUMED and name.partition(".")[0] in SETS_SCALE) or (what, name) == ("gain", "imu.accel")


def without_common_scale(
    columns: Mapping[Row, tuple[list[int], Array]], places: Iterable[int], known: Mapping[Row, Array],
    sigma: Mapping[Row, float],
) -> dict[Row, tuple[list[int], Array]]:  # fmt: skip
    """Columns at some places less their part in proportion to what is known, the same in all rows.

    Parameters
    ----------
    columns : row → places (p,), columns (p, n); those of other places are as they were.
    known : row → (n,) left side; `sigma` : row → noise by which rows are weighted.
    """
    out = {row: (list(at), found.copy()) for row, (at, found) in columns.items()}
    squares = sum(float(known[row] @ known[row]) / sigma[row] ** 2 for row in out)
    if squares == 0.0:
        return out
    for place in places:
        there = {row: at.index(place) for row, (at, _) in out.items() if place in at}
        product = sum(float(out[row][1][k] @ known[row]) / sigma[row] ** 2 for row, k in there.items())
        for row, (at, found) in out.items():
            if row in there:
                found[there[row]] -= product / squares * known[row]
            elif product:
                at.append(place)
                out[row] = at, np.vstack([found, -product / squares * known[row]])
    return out
