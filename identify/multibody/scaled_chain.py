"""Scaled chain: a chain in units of its own size, with its regressor at random joint states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.symbolic_table import LENGTHS
from lacet.identify.multibody.vectors import Array

_STATES = 120
"""Largest number of random states: each gives a row for every joint, and every body acts on its own joint."""


class ScaledChain:
    """A chain in units of its own size, so that rounding is the same for millimetres and for a hundred metres.

    Lengths are divided by their root mean square, and gravity is as large as the random accelerations. Relations of
    bodies, rotors and friction depend on neither, except for the unit of each parameter; those of constant forces
    depend on gravity (`lacet.identify.chains.model`).

    Parameters
    ----------
    chain : the chain in SI units; symbols without a value get random ones.
    columns : indices of the parameters to be grouped, in the order of `parameter_names` and then `friction_names`.
    seed : of the random joint states.
    """

    def __init__(self, chain: Chain, columns: NDArray[np.int64], seed: int):
        self.chain, self.columns = chain, columns
        self.numbers = chain.table.numbers({**chain.table.any_values(np.random.default_rng(1)), **chain.values})
        lengths = [abs(row[key]) for row in self.numbers for key in LENGTHS if row[key] != 0.0]
        largest = max(lengths, default=1.0)
        self.size = largest * math.sqrt(sum((x / largest) ** 2 for x in lengths) / len(lengths)) if lengths else 1.0
        strength = float(np.linalg.norm(chain.gravity))
        self.gravity = chain.gravity * (2.0 / strength) if strength else chain.gravity
        rng = np.random.default_rng(seed)
        count = min(30 + 5 * chain.n, _STATES)
        self.states = rng.uniform(-2, 2, (3, chain.n, count))
        self.exponents = np.array([_exponent(chain, int(k)) for k in columns])
        """Powers of the length's unit in each parameter's."""

    @property
    def fall_time(self) -> float:
        """Time in which a fall as long as the chain's size ends [s]; 1 without gravity."""
        strength = float(np.linalg.norm(self.chain.gravity))
        return math.sqrt(2.0 * self.size / strength) if strength else 1.0

    def matrix(self, numbers: Sequence[Mapping[str, float]]) -> Array:
        """The regressor's columns at the random states, for these lengths and angles."""
        chain = self.chain.with_geometry(numbers, self.gravity)
        W = chain.structure(*self.states, friction=bool(np.any(self.columns >= 10 * chain.n)))
        return W.reshape(-1, W.shape[2])[:, self.columns]

    def scaled_numbers(self) -> list[dict[str, float]]:
        """The table's lengths and angles, lengths in units of the chain's size."""
        return [{k: v / self.size if k in LENGTHS else v for k, v in row.items()} for row in self.numbers]

    def to_metres(self, relations: Array, kept: NDArray[np.int64], dropped: NDArray[np.int64]) -> Array:
        """Relations converted from units of the chain's size to SI units."""
        return relations * self.size ** (self.exponents[kept][:, None] - self.exponents[dropped][None, :])

    def varied(self, rng: np.random.Generator, shared: bool = False) -> tuple[list[dict[str, float]], dict[str, float]]:
        """The table with random lengths and angles in place of its symbols and lengths, and the symbols' values.

        Lengths given as numbers are symbols named by place (``d3``); with `shared` equal lengths stay equal.
        """
        values = {**self.chain.values, **self.chain.table.any_values(rng)}
        numbers = self.chain.table.numbers(values)
        out: dict[str, float] = {s: values[s] for s in self.chain.table.symbols}
        sizes: dict[float, float] = {}
        for row, changed, actual in zip(self.chain.table.rows, numbers, self.numbers, strict=True):
            for key in LENGTHS:
                if row.entries[key].symbols or actual[key] == 0.0:
                    continue
                fresh = float(rng.uniform(0.5, 1.5))
                if shared:
                    fresh = sizes.setdefault(round(abs(actual[key]) / self.size, 9), fresh)
                changed[key] = float(np.copysign(fresh, actual[key]))
                out[f"{key}{row.j}"] = changed[key]
        return numbers, out

    def scale_free_values(self) -> dict[str, float]:
        """Random values of the relations' symbols."""
        return self.varied(np.random.default_rng(0))[1]

    @cached_property
    def actual_values(self) -> dict[str, float]:
        """Values of the relations' symbols [m, rad]."""
        out: dict[str, float] = {}
        for name in self.scale_free_values():
            if name in self.chain.table.symbols:
                if name in self.chain.values:
                    out[name] = self.chain.values[name]
            else:
                out[name] = self.numbers[int(name[1:]) - 1][name[0]]
        return out


def _exponent(chain: Chain, column: int) -> int:
    """Power of the unit of length in a parameter's unit."""
    if column < 10 * chain.n:
        kind = column % 10
        return 2 if kind < 6 else 1 if kind < 9 else 0
    k, kind = divmod(column - 10 * chain.n, 3)
    if chain.joints[k].sigma == 1:
        return 1 if kind == 2 else 0
    return 2
