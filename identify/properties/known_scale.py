"""Scale of a fit without wheel loads: how much of what is known in its rows may be noise and other assumptions.

Without wheel loads every term of the equations is in proportion to an unknown parameter, but for the known one, as the
sprung mass, which is on the left side. Where noise and the tolerances of what else is assumed there are not small
beside it, all parameters follow them instead, and are too small by one common factor: the fit is then none of the
known parameter. The same happens where other parameters do nearly what the known one does: then the runs determine
none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import SETS_SCALE
from lacet.identify.car.rows import Row
from lacet.identify.regression.tolerances import ASSUMED
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import WIDE, Estimate


@dataclass(frozen=True)
class KnownScale:
    """How well what is known stands out in the rows of a fit.

    `known` : names of the given assumptions that set the scale. `disturbed` : what noise and one tolerance of all else
    that is assumed make of the left sides, as a part of their squares about each run's mean, each row ÷ its noise.
    `related` : whether the runs determine any spring or damper beside it to a part of its value, `WIDE`.
    """

    known: tuple[str, ...]
    disturbed: float
    related: bool

    @property
    def weak(self) -> bool:
        """Whether sizes may be too small by more than the interval of an identifiable parameter is wide, `WIDE`."""
        return self.disturbed > WIDE or not self.related


def known_scale(fitted: Fit, found: Sequence[Estimate]) -> KnownScale | None:
    """What sets the scale of a fit to rows without wheel loads; None where a run of it measures them.

    `found` : the fit's parameters.
    """
    if not fitted.rows or not all(row.combined for row in fitted.rows):
        return None
    given: dict[str, None] = {}
    known, off = 0.0, 0.0
    for number, run in enumerate(fitted.runs):
        given |= {n: None for n, one in run.recording.assumptions.items() if one.given and _sets_scale(n)}
        moved = _by_tolerances(fitted, number)
        for row in run.rows:
            side, noise = run.measured[row], fitted.sigma[row] ** 2
            known += side.size * float(np.var(side)) / noise
            off += side.size * (1.0 + moved.get(row, 0.0) / noise)
    # Inertias and static loads follow from the known mass even in a fit whose springs are near 0: of a model that lacks
    # a stiff law in roll it may be the best.
    suspensions = [e for e in found if e.effect.partition(".")[0] in ("spring", "damper")]
    related = any(e.identifiable and e.half_sheet <= WIDE * abs(e.value) for e in suspensions)
    return KnownScale(tuple(given), off / known if known else np.inf, related)


def _sets_scale(name: str) -> bool:
    return name.partition(".")[0] in SETS_SCALE


def _by_tolerances(fitted: Fit, number: int) -> dict[Row, float]:
    """Row → mean square about its mean of a run's change by one tolerance of each assumption that sets no scale."""
    out: dict[Row, float] = {}
    for piece in fitted.assembly.pieces_of(number):
        if piece.sensitivity is None:
            continue
        for (what, name, _), rows in fitted.assembly.sheet_responses(piece).items():
            if what == ASSUMED and not _sets_scale(name):
                for row, series in rows.items():
                    share = series.size / fitted.runs[number].measured[row].size
                    out[row] = out.get(row, 0.0) + share * float(np.var(series))
    return out
