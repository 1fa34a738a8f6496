"""A sensor fault taken out of the runs before the cause of what is left beside it is called unlisted.

A fault's column is of first order, and beside other effects it knows nothing of them. A hub laser's scale of 3 % moves
its zero by 9 mm: for linear springs that is a zero, but a cubic spring beside it gets another stiffness. Of a scale of
9 % a part goes into the others' tolerances. Both leave more than any candidate explains, until the fault is taken out
as it is. What its own tolerance excuses is counted among what it must explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import SensorFault
from lacet.identify.progress import Tell
from lacet.identify.regression.wls import Fit, extended
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.look import MAIN, STAYS, Look
from lacet.identify.selection.reading import Reading
from lacet.identify.selection.unlisted import left_unexcused
from lacet.identify.validation.noise_floor import floor_of


def may_leave_more(seen: Look) -> bool:
    """Whether rows fail for a cause that is not listed, and the best that stands out is a sensor fault."""
    rows_fail = seen.unlisted and not seen.strained and seen.changing is None
    return rows_fail and seen.best is not None and isinstance(seen.effects[seen.best.key], SensorFault)


def without_best(seen: Look, tell: Tell) -> Reading:
    """The runs with the best, a sensor fault, taken out, as a fit finds it; its floor is drawn anew."""
    assert seen.best is not None
    tell(f"the runs read again with {seen.best.key} taken out")
    fitted = extended(seen.space.fitted, seen.effects[seen.best.key])
    tell(f"the noise floor beside {seen.best.key}")
    floor = floor_of(fitted, seen.space.floor.count)
    return replace(Reading.of(fitted, floor), late=seen.space.reading.late)


def explained_by(seen: Look, beside: Look) -> Look:
    """`seen` as it is to be judged, once the best was taken out of the runs and `beside` is what was seen then.

    The fault alone, or with the best set beside it, must explain as much as is asked of any set.
    """
    assert seen.best is not None
    before = left_unexcused(seen.space, seen.best.key)
    whole, alone = before.excess(before.above), beside.now.excess(beside.now.above)
    left = alone if beside.unlisted else beside.excess * (1.0 - beside.explained)
    if left > (STAYS if beside.unlisted else 1.0 - MAIN) * whole:
        return seen
    together = (seen.best.key,) if beside.unlisted else (seen.best.key, *beside.together)
    best = _as_fitted(seen.best, beside.space.fitted)
    return replace(seen, best=best, unlisted=False, excess=whole, explained=1.0 - left / whole, together=together)


def _as_fitted(fault: Candidate, fitted: Fit) -> Candidate:
    """With the size at which it was taken out."""
    (at,) = (i for i, name in enumerate(fitted.model.names) if name.startswith(f"{fault.key}."))
    wide = np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at])
    return replace(fault, values=(float(fitted.theta[at]),), interval=(1.96 * float(wide),))
