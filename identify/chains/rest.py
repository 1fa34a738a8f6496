"""What the laws found leave at each joint, and which of them may be parts of an unlisted cause.

A law that explains no more than what remains unlisted at its joints may be part of the same cause, as for a car's rows
(`lacet.identify.selection.rest`): a wrong direction of gravity looks like springs and friction of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class FoundLaw:
    """A law found missing: `columns` (r, k) of it beside those of the model, and `whole` as they are, weighted."""

    columns: Array = field(repr=False)
    whole: Array = field(repr=False)


@dataclass(frozen=True)
class JointRest:
    """Weighted squares at the f joints that a model leaves with the laws found in it.

    Attributes
    ----------
    standing : keys of the laws that explain more than what remains unlisted at their joints.
    ratios : (f,) error ÷ noise floor of each joint with these laws.
    unlisted : (f,) whether what remains there is more than noise, inexact laws and the user's effect size.
    """

    standing: tuple[str, ...]
    ratios: Array
    unlisted: NDArray[np.bool_]


def rest_of(
    laws: Mapping[str, FoundLaw], residual: Array, joint: NDArray[np.intp], noise: Array, inexact: Array, small: Array
) -> JointRest:
    """The rest beside those of `laws` that stand; the one that explains least in proportion goes first.

    Parameters
    ----------
    residual, joint : (r,) weighted residual of the model without the laws, and the joint of each equation.
    noise : (f,) squares that the instruments' noise leaves; infinite where the error is no more than that.
    inexact, small : (f,) squares that the laws in the model may leave, and that are less than the user's effect size.
    """
    standing = dict(laws)
    while True:
        after, torques = _fitted(standing, residual, joint, noise.size)
        allowed = inexact + SELECTION.selected_inexactness**2 * np.sum(
            [*torques.values(), np.zeros(noise.size)], axis=0
        )
        excess = np.maximum(0.0, after - noise)
        unlisted = (after > SELECTION.failing_ratio**2 * noise) & (excess > np.maximum(allowed, small))
        parts: dict[str, float] = {}
        for key, torque in torques.items():
            without = {other: law for other, law in standing.items() if other != key}
            fall = float(np.sum(_fitted(without, residual, joint, noise.size)[0] - after))
            share = np.sqrt(torque / max(float(np.max(torque)), 1e-300))
            remains = float(np.sum(np.where(unlisted, excess, 0.0) * share))
            if fall <= remains:
                parts[key] = fall / remains if remains > 0.0 else 0.0
        if not parts:
            return JointRest(tuple(standing), np.sqrt(after / noise), unlisted)
        del standing[min(parts, key=lambda key: parts[key])]


def _fitted(
    laws: Mapping[str, FoundLaw], residual: Array, joint: NDArray[np.intp], joints: int
) -> tuple[Array, dict[str, Array]]:
    """(f,) squares of the residual with these laws, and (f,) squares of each law's torque about its mean."""
    if not laws:
        return _squares(residual, joint, joints), {}
    columns = np.concatenate([law.columns for law in laws.values()], axis=1)
    sizes = np.asarray(np.linalg.lstsq(columns, residual, rcond=None)[0], float)
    count = np.maximum(1, np.bincount(joint, minlength=joints))
    torques: dict[str, Array] = {}
    first = 0
    for key, law in laws.items():
        torque = law.whole @ sizes[first : first + law.whole.shape[1]]
        torque = torque - (np.bincount(joint, torque, joints) / count)[joint]
        torques[key] = _squares(torque, joint, joints)
        first += law.whole.shape[1]
    return _squares(residual - columns @ sizes, joint, joints), torques


def _squares(values: Array, joint: NDArray[np.intp], joints: int) -> Array:
    return np.asarray(np.bincount(joint, values**2, joints), float)
