"""Joints that follow others: positions of all joints of a chain from those that move freely, q = C q_free + c."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True)
class Follower:
    """A joint that follows another: q[joint] = multiplier × q[of] + offset [rad, m], joints numbered from 1."""

    joint: int
    of: int
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Coupling:
    """What the joints of a chain follow.

    Attributes
    ----------
    free : numbers of the f joints that move freely, from 1.
    matrix : (n, f) C of q = C q_free + c; rows of fixed frames are 0.
    offset : (n,) c [rad, m].
    """

    free: tuple[int, ...]
    matrix: Array
    offset: Array

    @classmethod
    def of(cls, n: int, fixed: Sequence[int], followers: Sequence[Follower]) -> Coupling:
        """The coupling of a chain of n joints, of which some are fixed frames and some follow a free joint.

        Raises ValueError for a joint that does not exist, follows twice, or follows one that is not free.
        """
        following = {one.joint: one for one in followers}
        if len(following) < len(followers):
            raise ValueError("a joint can follow one other joint only")
        free = tuple(j for j in range(1, n + 1) if j not in fixed and j not in following)
        matrix, offset = np.zeros((n, len(free))), np.zeros(n)
        for place, j in enumerate(free):
            matrix[j - 1, place] = 1.0
        for one in followers:
            if not 1 <= one.joint <= n or one.joint in fixed or one.of not in free:
                raise ValueError(
                    f"joint {one.joint} cannot follow joint {one.of}: both must exist and move, the second freely"
                )
            matrix[one.joint - 1, free.index(one.of)] = one.multiplier
            offset[one.joint - 1] = one.offset
        return cls(free, matrix, offset)

    def states(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """Positions, rates and accelerations (N, n) of all joints from those (N, f) of the free ones."""
        return (
            np.asarray(q, float) @ self.matrix.T + self.offset,
            np.asarray(qd, float) @ self.matrix.T,
            np.asarray(qdd, float) @ self.matrix.T,
        )

    def torques(self, tau: ArrayLike) -> NDArray[np.float64]:
        """Torques (…, f) at the free joints that do the work of torques (…, n) at all joints: Cᵀ τ."""
        return np.asarray(tau, float) @ self.matrix

    def rows(self, W: Array) -> Array:
        """Columns (N, f, p) of the torques at the free joints, from those (N, n, p) at all joints: Cᵀ W."""
        return np.asarray(np.einsum("sjp,jf->sfp", W, self.matrix, optimize=True), float)
