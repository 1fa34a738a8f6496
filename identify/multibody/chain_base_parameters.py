"""Base parameters of a chain, with their regrouping relations in numbers and in symbols."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lacet.identify.multibody.arguments import chosen
from lacet.identify.multibody.base_parameters import BaseParameters, combine, find_base
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.regrouping_formulas import closed_forms, join
from lacet.identify.multibody.scaled_chain import ScaledChain

_CLEAR = 1e3
"""Smallest kept ÷ largest dropped pivot below which the number of base parameters is checked again."""
_NOISE = 1e-10
"""Magnitude of relations, in units of the chain's own size, below which they are rounding errors."""


@dataclass(frozen=True)
class ChainBaseParameters(BaseParameters):
    """Base parameters of a chain.

    Attributes
    ----------
    scaled_chain : the chain in its own units, from which the relations were computed.
    """

    scaled_chain: ScaledChain

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Symbols in the relations: those of the table, and lengths given as numbers, named by place (``d3``)."""
        return tuple(self.scaled_chain.scale_free_values())

    @property
    def symbol_values(self) -> dict[str, float]:
        """Values of the symbols that have one, lengths [m], angles [rad]."""
        return self.scaled_chain.actual_values

    @cached_property
    def formulas(self) -> tuple[tuple[str, ...], ...]:
        """`relations` as text, ``2*D3``; a number where no closed form was found, empty where it is 0."""
        return closed_forms(self, self.scaled_chain)

    def describe(self, i: int, tolerance: float = 0.0) -> str:
        """Base parameter `i` in numbers, ``ZZ1 + YY2 + 0.2025 M3``; in symbols where these have no value."""
        return self.relation(i) if self.scaled_chain.chain.missing else super().describe(i, tolerance)

    def relation(self, i: int) -> str:
        """Base parameter `i` in symbols, ``ZZ1 + YY2 + D3**2*M3``: an expression that can be evaluated."""
        terms = [("1", self.names[int(self.independent[i])])]
        terms += [(text, self.names[int(k)]) for text, k in zip(self.formulas[i], self.dependent, strict=True) if text]
        return join(terms)

    def table(self) -> str:
        """Every relation in symbols, one line each, and the values of the symbols."""
        lines = [self.relation(i) for i in range(self.rank)]
        if self.symbol_values:
            lines += ["with " + ", ".join(f"{name} = {value:.6g}" for name, value in self.symbol_values.items())]
        return "\n".join(lines)


def base_parameters(
    chain: Chain, friction: bool = False, parameters: Collection[str] | None = None, seed: int = 0
) -> ChainBaseParameters:
    """The base (minimal) parameters of a chain: the combinations of standard ones that its joint torques depend on.

    Found by rank-revealing QR of the regressor at random states; earlier parameters are kept before later ones.

    Parameters
    ----------
    chain : the tree of bodies; its symbols need no values.
    friction : with rotor inertia, viscous and Coulomb friction of every joint. Without it rotor inertias still
        count where a ``.par`` file lists them: SYMORO has them among the inertial parameters.
    parameters : names of the parameters that are not 0; by default all that are not `absent`.
    seed : of the random states.

    Raises ValueError for an unknown name.

    Examples
    --------
    >>> arm = lacet.Chain.from_table([{"j": 1, "ant": 0, "sigma": 0}, {"j": 2, "ant": 1, "sigma": 0, "d": 0.5}])
    >>> lacet.base_parameters(arm).names[:3]
    ('XX1', 'XY1', 'XZ1')
    """
    names = [*chain.parameter_names, *chain.friction_names]
    if parameters is not None:
        return _grouped(chain, chosen(names, parameters), seed)
    counted = [
        name for i, name in enumerate(names)
        if i < 10 * chain.n or friction or (chain.rotors and name.startswith("IA"))
    ]  # fmt: skip
    return _grouped(chain, [name for name in counted if name not in chain.absent], seed)


def _grouped(chain: Chain, names: Sequence[str], seed: int) -> ChainBaseParameters:
    """A chain's parameters of these names (in the chain's order) grouped into base parameters."""
    every = {name: i for i, name in enumerate((*chain.parameter_names, *chain.friction_names))}
    scaled = ScaledChain(chain, np.array([every[name] for name in names], dtype=np.int64), seed)
    W = scaled.matrix(scaled.scaled_numbers())
    base = find_base(W, names)
    if base.gap < _CLEAR:
        # Lengths of very different size: rounding hides the rank, which is that of random lengths of one size.
        for shared in (True, False):
            other = find_base(scaled.matrix(scaled.varied(np.random.default_rng(seed), shared)[0]), names)
            if other.gap > max(_CLEAR, base.gap):
                base = replace(other, relations=combine(W, other.independent, other.dependent)[0])
                break
    relations = np.where(np.abs(base.relations) < _NOISE, 0.0, base.relations)
    relations = scaled.to_metres(relations, base.independent, base.dependent)
    if chain.missing:  # relations that depend on a symbol without value have none
        again = scaled.matrix(scaled.varied(np.random.default_rng([seed, 7]))[0])
        moved, _ = combine(again, base.independent, base.dependent)
        moved = scaled.to_metres(moved, base.independent, base.dependent)
        relations = np.where(np.abs(moved - relations) < 1e-8, relations, np.nan)
    return ChainBaseParameters(base.names, base.independent, base.dependent, base.absent, relations, base.gap, scaled)
