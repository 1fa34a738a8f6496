"""Limits and counts of the search for laws, each with meaning, unit and source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LawSettings:
    """Limits and counts of the search for laws of an unlisted cause."""

    most_terms: int = 3
    """Terms of a law [count]. Source: a choice of presentation; more are a curve through these runs."""
    beam: int = 3
    """Laws of as many terms that are kept, to be extended by a further term [count]. Source: processor time."""
    sharpened: int = 6
    """Laws of one term whose constants are searched between the grid's values [count]. Source: processor time."""
    at_corners: int = 40
    """Laws of an axle, the best, that are tried at each of its wheels alone as well [count]. Source: processor time."""
    together: int = 250
    """Columns whose cross products are formed at once [count]. Source: memory: 5 MB a row and fold."""
    standard_errors: float = 1.0
    """Standard errors over the folds of the cross-validation within which a law of less terms and constants is as good
    as the best [σ]. Source: L. Breiman et al., Classification and Regression Trees (1984), the one-standard-error
    rule."""
    digits: int = 3
    """Digits of a constant in a law's text [count]. Source: a choice of presentation."""
    closer_values: int = 2
    """Halvings of the distance between the grid values of a catalogue effect, where it is compared with a law [count].
    Source: two stops whose gaps differ by a quarter of a grid step correlate by more than `same_correlation`."""


LAWS = LawSettings()
"""The settings in use."""
