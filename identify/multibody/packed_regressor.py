"""The regressor of a tree by machine code: whole, or packed to the entries that are not zero by structure.

A joint feels the bodies that it carries and no others. A prismatic joint feels a force, to which the inertia about the
frame's origin adds nothing; a fixed frame feels nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.compiled import compiled
from lacet.identify.multibody.regressor_kernel import (
    FIRST_MOMENTS,
    FORCES,
    JOINT,
    MOMENTS,
    PRISMATIC,
    REVOLUTE,
    SIGNATURE,
    fill_regressor,
)
from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True, eq=False)
class PackedRegressor:
    """The entries of a regressor that are not zero by structure, joint by joint and in the order of the columns.

    `values` (N, p): entry e of a sample stands in row `rows[e]` and column `columns[e]`, (p,) each and counted from 0,
    of the sample's regressor, whose size is `shape`.
    """

    values: Array
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    shape: tuple[int, int]

    def row(self, joint: int) -> tuple[NDArray[np.int64], Array]:
        """The columns that a joint (numbered from 1) feels (c,), and its entries (N, c), a view of `values`.

        Raises ValueError for a joint that does not exist.
        """
        if not 1 <= joint <= self.shape[0]:
            raise ValueError(f"joints are numbered 1 to {self.shape[0]}, found {joint}")
        start, stop = np.searchsorted(self.rows, [joint - 1, joint])
        return self.columns[start:stop], self.values[:, start:stop]

    def dense(self) -> Array:
        """The regressor with its zeros, (N, n, columns)."""
        out = np.zeros((len(self.values), *self.shape))
        out[:, self.rows, self.columns] = self.values
        return out


@dataclass(frozen=True)
class _Places:
    """Where the entries go: `runs` as in `fill_regressor`, and row and column of each entry."""

    runs: NDArray[np.uint64]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


class CompiledRegressor:
    """The regressor of one tree.

    Parameters
    ----------
    sigma, ant : of each joint, its kind and the number of its antecedent (0: the ground).
    turn, step, constant, gravity : as in `fill_regressor`.
    """

    def __init__(
        self, sigma: Sequence[int], ant: Sequence[int], turn: Array, step: Array, constant: Array, gravity: Array
    ):
        self.n, self.sigma = len(sigma), sigma
        self._carried: list[list[int]] = [[] for _ in sigma]
        """For each joint, the bodies that it carries, from 0."""
        bodies = np.zeros((self.n, 3), np.int64)
        turning = [False]
        for k, (kind, above) in enumerate(zip(sigma, ant, strict=True)):
            turning.append(turning[above] or kind == REVOLUTE)
            # Only levers between a revolute joint and what it carries count: positions begin at the first such joint.
            bodies[k] = kind, above, not turning[above]
            j = k + 1
            while j:
                self._carried[j - 1].append(k)
                j = ant[j - 1]
        self._tree = bodies, turn, step, constant, gravity
        self._places: dict[tuple[bool, bool], _Places] = {}

    def dense(self, states: Sequence[Array], friction: bool, threads: int, out: Array | None) -> Array:
        """`Chain.regressor` at states q, qd, qdd (N, n)."""
        width = (13 if friction else 10) * self.n
        shape = len(states[0]), self.n, width
        if out is None:
            found = np.zeros(shape)
        elif out.shape == shape and out.dtype == np.float64 and out.flags.c_contiguous and out.flags.writeable:
            found = out
        else:
            raise ValueError(
                f"out must be a contiguous, writeable array of float64 of the shape {shape}, "
                f"found {out.dtype} {out.shape}"
            )
        places = self._of(friction, packed=False)
        self._fill(states, places.runs, out is not None, found.reshape(shape[0], self.n * width), threads)
        return found

    def packed(self, states: Sequence[Array], friction: bool, threads: int) -> PackedRegressor:
        """`Chain.packed_regressor` at states q, qd, qdd (N, n)."""
        places = self._of(friction, packed=True)
        values = np.empty((len(states[0]), len(places.rows)))
        self._fill(states, places.runs, False, values, threads)
        return PackedRegressor(values, places.rows, places.columns, (self.n, (13 if friction else 10) * self.n))

    def _fill(self, states: Sequence[Array], runs: NDArray[np.uint64], clear: bool, out: Array, threads: int) -> None:
        """Fill `out`, each thread a part of the samples; the calling thread is one of them."""
        if threads < 1:
            raise ValueError(f"threads must be at least 1, found {threads}")
        kernel = compiled(fill_regressor, SIGNATURE)

        def fill(start: int, stop: int) -> None:
            q, qd, qdd = (x[start:stop] for x in states)
            kernel(q, qd, qdd, *self._tree, runs, clear, out[start:stop])

        cuts = [len(out) * part // threads for part in range(threads + 1)]
        if threads == 1:
            fill(*cuts)
            return
        with ThreadPoolExecutor(threads - 1) as pool:
            others = [pool.submit(fill, *cut) for cut in pairwise(cuts[1:])]
            fill(*cuts[:2])
            for other in others:
                other.result()

    def _of(self, friction: bool, packed: bool) -> _Places:
        if (friction, packed) not in self._places:
            self._places[friction, packed] = self._found(friction, packed)
        return self._places[friction, packed]

    def _found(self, friction: bool, packed: bool) -> _Places:
        width, place = (13 if friction else 10) * self.n, 0
        runs: list[tuple[int, ...]] = []
        columns: list[NDArray[np.int64]] = []
        for k, kind in enumerate(self.sigma):
            if kind not in (REVOLUTE, PRISMATIC):
                continue
            own: list[tuple[int, NDArray[np.int64]]] = []  # kind of each run, and its columns
            for first, count in _consecutive(self._carried[k]):
                every = np.arange(10 * first, 10 * (first + count))
                if kind == REVOLUTE:
                    own.append((MOMENTS, every))
                else:
                    own.append((FIRST_MOMENTS, every[every % 10 >= 6]) if packed else (FORCES, every))
            if friction:
                own.append((JOINT, np.arange(3) + 10 * self.n + 3 * k))
            for sort, at in own:
                start = k if sort == JOINT else 4 * (int(at[0]) // 10) if sort == FIRST_MOMENTS else int(at[0])
                runs.append((k + 1, sort, start, len(at), place if packed else k * width + int(at[0])))
                columns.append(k * width + at)
                place += len(at)
        # A chain of fixed frames has no entries.
        flat = np.concatenate(columns) if columns else np.zeros(0, np.int64)
        return _Places(np.array(runs, np.uint64).reshape(-1, 5), flat // width, flat % width)


def _consecutive(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Ascending numbers as runs: the first of each, and how many follow on each other."""
    out: list[tuple[int, int]] = []
    for number in numbers:
        if out and number == sum(out[-1]):
            out[-1] = out[-1][0], out[-1][1] + 1
        else:
            out.append((number, 1))
    return out
