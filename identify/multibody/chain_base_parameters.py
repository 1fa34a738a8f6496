"""Base parameters of a chain: their number whatever its scale, and the relations in numbers and in symbols."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.base_parameters import BaseParameters, combine, find_base
from lacet.identify.multibody.symbolic_table import LENGTHS
from lacet.identify.multibody.vectors import Array

if TYPE_CHECKING:
    from lacet.identify.multibody.chain import Chain

_CLEAR = 1e3
"""Smallest kept ÷ largest dropped pivot below which the number of base parameters is looked at twice."""
_STATES = 120
"""Random states at most: every joint gives a row in each, and every body acts on its own joint."""
_NOISE = 1e-10
"""Relations below this, in units of the chain's own size, are rounding."""


@dataclass(frozen=True)
class ChainBase(BaseParameters):
    """Base parameters of a chain.

    Attributes
    ----------
    study : the chain in its own units, from which the relations were computed.
    """

    study: ChainStudy

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """What the relations hold: the table's symbols, and lengths given as numbers by place (``d3``)."""
        return tuple(self.study.scale_free_values())

    @property
    def symbol_values(self) -> dict[str, float]:
        """Their values, lengths [m], angles [rad]; those without one are left out."""
        return self.study.actual_values

    @cached_property
    def formulas(self) -> tuple[tuple[str, ...], ...]:
        """`relations` as text, ``2*D3``; a number where no closed form was found, nothing where it is 0."""
        from lacet.identify.multibody.regrouping_formulas import closed_forms

        return closed_forms(self)

    def describe(self, i: int, tolerance: float = 0.0) -> str:
        """Base parameter `i` in numbers, ``ZZ1 + YY2 + 0.2025 M3``; in symbols where these have no value."""
        return self.relation(i) if self.study.chain.missing else super().describe(i, tolerance)

    def relation(self, i: int) -> str:
        """Base parameter `i` in symbols, ``ZZ1 + YY2 + D3**2*M3``: an expression that can be evaluated."""
        from lacet.identify.multibody.regrouping_formulas import join

        terms = [("1", self.names[int(self.independent[i])])]
        terms += [(text, self.names[int(k)]) for text, k in zip(self.formulas[i], self.dependent, strict=True) if text]
        return join(terms)

    def table(self) -> str:
        """Every relation in symbols, one line each, and what they stand for."""
        lines = [self.relation(i) for i in range(self.rank)]
        if self.symbol_values:
            lines += ["with " + ", ".join(f"{name} = {value:.6g}" for name, value in self.symbol_values.items())]
        return "\n".join(lines)


class ChainStudy:
    """A chain in units of its own size, so that millimetres and a hundred metres are the same to the arithmetic.

    Lengths are divided by their root mean square, and gravity is as strong as the random accelerations. The relations
    do not depend on either, but for the unit of each parameter.
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

    def matrix(self, numbers: Sequence[Mapping[str, float]]) -> Array:
        """The regressor's columns at the random states, for these lengths and angles."""
        chain = self.chain.with_geometry(numbers, self.gravity)
        W = chain.structure(*self.states, friction=bool(np.any(self.columns >= 10 * chain.n)))
        return W.reshape(-1, W.shape[2])[:, self.columns]

    def scaled(self) -> list[dict[str, float]]:
        """The table's lengths and angles, lengths in units of the chain's size."""
        return [{k: v / self.size if k in LENGTHS else v for k, v in row.items()} for row in self.numbers]

    def to_metres(self, relations: Array, kept: NDArray[np.int64], dropped: NDArray[np.int64]) -> Array:
        """Relations in units of the chain's size, in SI."""
        return relations * self.size ** (self.exponents[kept][:, None] - self.exponents[dropped][None, :])

    def varied(self, rng: np.random.Generator, shared: bool = False) -> tuple[list[dict[str, float]], dict[str, float]]:
        """The table with other lengths and angles where it has symbols or lengths, and the symbols' values.

        Lengths given as numbers are symbols by their place (``d3``); with `shared` those of equal size stay so.
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
        """Symbols of the relations with any values."""
        return self.varied(np.random.default_rng(0))[1]

    @cached_property
    def actual_values(self) -> dict[str, float]:
        """Symbols of the relations with their values [m, rad]."""
        out: dict[str, float] = {}
        for name in self.scale_free_values():
            if name in self.chain.table.symbols:
                if name in self.chain.values:
                    out[name] = self.chain.values[name]
            else:
                out[name] = self.numbers[int(name[1:]) - 1][name[0]]
        return out


def chain_base(chain: Chain, names: Sequence[str], seed: int = 0) -> ChainBase:
    """Group a chain's parameters of these names (in the chain's order) into base parameters."""
    every = {name: i for i, name in enumerate((*chain.parameter_names, *chain.friction_names))}
    study = ChainStudy(chain, np.array([every[name] for name in names], dtype=np.int64), seed)
    W = study.matrix(study.scaled())
    base = find_base(W, names)
    if base.gap < _CLEAR:
        # Lengths of very different size hide the structure behind rounding: it is that of lengths without coincidence.
        for shared in (True, False):
            other = find_base(study.matrix(study.varied(np.random.default_rng(seed), shared)[0]), names)
            if other.gap > max(_CLEAR, base.gap):
                base = replace(other, relations=combine(W, other.independent, other.dependent)[0])
                break
    relations = np.where(np.abs(base.relations) < _NOISE, 0.0, base.relations)
    relations = study.to_metres(relations, base.independent, base.dependent)
    if chain.missing:  # what depends on a symbol without value has none
        again = study.matrix(study.varied(np.random.default_rng([seed, 7]))[0])
        moved, _ = combine(again, base.independent, base.dependent)
        moved = study.to_metres(moved, base.independent, base.dependent)
        relations = np.where(np.abs(moved - relations) < 1e-8, relations, np.nan)
    return ChainBase(base.names, base.independent, base.dependent, base.absent, relations, base.gap, study)


def _exponent(chain: Chain, column: int) -> int:
    """Power of the unit of length in a parameter's unit."""
    if column < 10 * chain.n:
        kind = column % 10
        return 2 if kind < 6 else 1 if kind < 9 else 0
    k, kind = divmod(column - 10 * chain.n, 3)
    if chain.joints[k].sigma == 1:
        return 1 if kind == 2 else 0
    return 2
