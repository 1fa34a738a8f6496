"""Torques that stop at a largest value: of an amplifier, or of its reading."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lacet.identify.chains.fit import ChainFit
from lacet.identify.chains.samples import Recorded
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import Filters

_EQUAL = 10
"""Samples of one extreme value from which a torque may be clipped there [count]. Source: a tenth of a second of a
slow log; noise gives fewer."""


@dataclass(frozen=True)
class ClippedTorque:
    """A joint's torque that stops at a value.

    Attributes
    ----------
    joint : its name.
    limit : the value [N·m, N].
    share : part of the samples at it.
    """

    joint: str
    limit: float
    share: float


def clipped_torques(fitted: ChainFit, recorded: Recorded, filters: Filters) -> tuple[ClippedTorque, ...]:
    """Torques that are clipped: many samples have exactly the extreme value, and the model asks for more there.

    For more, in the mean over them, by more than the user's effect size of the torque's variation: the peaks of a
    coarse reading have one value, too, which is right in the mean.
    """
    model = fitted.model.torques(recorded.samples(replace(filters, rate=recorded.rate)), fitted.standard)
    chain, out = fitted.model.chain, list[ClippedTorque]()
    for k, j in enumerate(chain.coupling.free):
        tau = recorded.tau[:, k]
        for sign, limit in ((1.0, float(np.max(tau))), (-1.0, float(np.min(tau)))):
            at = tau == limit
            if np.count_nonzero(at) < _EQUAL:
                continue
            more = float(np.mean(sign * (model[at, k] - limit)))
            if more > SELECTION.effect_size * float(np.std(tau)):
                out.append(ClippedTorque(chain.names[j - 1], limit, float(np.mean(at))))
    return tuple(out)
