"""Diagnosis of a model as a value: its verdict, the effects found, what remains, and the grounds of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.properties.known_scale import KnownScale
from lacet.identify.selection.candidate import Candidate, Reason
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.joint.unknown_tables import LackingTables
from lacet.identify.selection.laws.formulas import Formula
from lacet.identify.selection.tolerance_tests import ToleranceUse


class Verdict(StrEnum):
    """Verdict of a diagnosis."""

    MISSING = "missing"
    """Listed effects are missing; something unlisted may remain beside them."""
    NOTHING = "nothing missing"
    UNLISTED = "unlisted cause"
    """The model fails for a cause that no candidate stands for, and nothing listed is missing; or what is found need
    not be there beside an unknown bench table of its axle."""


@dataclass(frozen=True)
class Grounds:
    """Grounds of a verdict, in addition to the numbers of the diagnosis; all of the model with the effects found.

    Attributes
    ----------
    ratios : row → residual ÷ floor with the sensor sheet's tolerances in the model.
    forces : row → RMS of what remains above the floor [N or N·m], and the row's own RMS variation.
    tolerances : sensor tolerances that the runs need.
    tolerance_exceeded : whether the sheet would have to be wrong, and no other test makes a cause unlisted.
    not_constant : candidate → Chow test that rejects that its parameters are the same in all runs.
    scale : where the sheet would have to be wrong and no run measures wheel loads: how well the scale is known.
    assumed : unlisted row → channels assumed in some run whose error its rest may be; empty where no run is at hand.
    """

    ratios: Mapping[Row, float]
    forces: Mapping[Row, tuple[float, float]]
    tolerances: ToleranceUse
    tolerance_exceeded: bool
    not_constant: Mapping[str, ParameterConstancy]
    scale: KnownScale | None = None
    assumed: Mapping[Row, tuple[str, ...]] = field(default_factory=dict[Row, tuple[str, ...]])


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of a model: what is missing in it; `lacet.services.render.verdicts` has it in sentences.

    Attributes
    ----------
    verdict : whether listed effects are missing.
    found : the effects that are missing, the largest first, with sizes of a fit with all of them.
    unlisted_rows : rows in which the model with those leaves more than chance, inexact laws and the user's effect size
        allow; `small_rows` those whose rest is less than that.
    maybe : listed effects that these runs cannot test, and that may be the cause of what remains.
    candidates : all, best first; those that cannot be tested last.
    ratios : row → residual ÷ floor of the present model on the runs used.
    excess : weighted squares above the floor in the rows that fail and what is found acts on; `explained` the part that
        the effects found take away.
    draws : number of noise-floor simulations behind p.
    noise_ratio : row → noise ÷ noise by the sensor sheet, from the residual with all candidates in the model; at
        least 1.
    failing : rows above their floor by more than chance.
    noise : noise in the columns at the first screening, for the next ranking.
    grounds : grounds of the verdict.
    effects : key → effect of every candidate that can be computed.
    formulas : laws that part of an unlisted rest follows, best first; `described` those that were in the fit which the
        sizes of the effects found are of.
    without_tables : axles without bench tables whose wheels, by the effects found, move or turn with the travel.
    after : the diagnosis of the model with all effects found; None where nothing is found, or it was not made.
    """

    verdict: Verdict
    found: tuple[Candidate, ...]
    unlisted_rows: tuple[Row, ...]
    small_rows: tuple[Row, ...]
    maybe: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    ratios: Mapping[Row, float]
    excess: float
    explained: float
    draws: int
    noise_ratio: Mapping[Row, float]
    failing: tuple[Row, ...]
    noise: RegressorNoise = field(repr=False)
    grounds: Grounds = field(repr=False)
    effects: Mapping[str, Effect] = field(repr=False)
    formulas: tuple[Formula, ...] = ()
    described: tuple[str, ...] = ()
    without_tables: LackingTables = field(default_factory=LackingTables)
    after: Diagnosis | None = field(default=None, repr=False)

    @property
    def best(self) -> Candidate | None:
        """The largest of the effects found, or None."""
        return self.found[0] if self.found else None

    @property
    def unlisted(self) -> bool:
        """Whether something remains that no candidate stands for, alone or beside the effects found."""
        grounds = self.grounds
        fails = bool(self.unlisted_rows or grounds.not_constant) or grounds.tolerance_exceeded
        return fails or (not self.found and bool(self.instead_of_tables))

    @property
    def instead_of_tables(self) -> tuple[str, ...]:
        """Keys of the effects of the set found that a bench table which an axle lacks may explain as well."""
        return tuple(c.key for c in self.candidates if c.reason is Reason.NO_TABLE)
