"""Rankings of the effects that a fitted model may lack."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from lacet.identify.effects.base import Effect
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS
from lacet.services.library.display import html_table, shortened
from lacet.services.library.fits import Fit, catalogue
from lacet.services.library.pictures import Picture, drawn
from lacet.services.one_thread import one_thread
from lacet.services.render.progress import in_words
from lacet.services.render.tables import table
from lacet.services.render.verdicts import says

SHOWN = 8
"""Number of candidates in a representation."""


@dataclass(frozen=True, repr=False)
class Ranking:
    """Effects that a fitted model may lack, each tested on its residual, best first.

    Returned by `lacet.rank`.

    Attributes
    ----------
    details : the diagnosis behind it.

    Examples
    --------
    >>> ranking.best.key
    'anti_roll_bar.front'
    >>> print(ranking.verdict)
    missing
    >>> both = lacet.add(fitted, ranking.missing)
    """

    details: Diagnosis = field(repr=False)

    @property
    def best(self) -> Candidate | None:
        """The effect proposed, or None."""
        return self.details.best

    @property
    def missing(self) -> tuple[Candidate, ...]:
        """The effects that are missing, the largest first."""
        return self.details.found

    @property
    def verdict(self) -> str:
        """``missing``, ``nothing missing`` or ``unlisted cause``."""
        return self.details.verdict

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Every effect tested, best first; those that these runs cannot test last."""
        return self.details.candidates

    def explain(self) -> str:
        """The verdict in sentences with numbers."""
        return says(self.details)

    def plot(self, most: int = SHOWN) -> Picture:
        """Draw what the best effects, at most `most`, gain in cross-validation, with their answers."""

        def draw() -> bytes:
            from lacet.services.render.figures.png import png
            from lacet.services.render.figures.result_plots import ranking_figure

            return png(ranking_figure(self.candidates, most))

        return drawn(f"ranking: {self.verdict}", draw)

    def _rows(self) -> list[list[str]]:
        return [[c.key, c.answer.value, f"{100 * c.gain:.3g}", f"{c.p:.2g}"] for c in self.candidates[:SHOWN]]

    def __repr__(self) -> str:
        return shortened(
            f"{self.explain()}\n{table(['effect', 'answer', 'gain %', 'p'], self._rows(), text_columns=2)}"
        )

    def _repr_html_(self) -> str:
        return html_table(self.explain(), ["effect", "answer", "gain %", "p"], self._rows())


def rank(
    fitted: Fit,
    effects: Iterable[Effect] | None = None,
    *,
    draws: int = DEFAULT_DRAWS,
    seed: int = 0,
    progress: Callable[[str], object] | None = None,
) -> Ranking:
    """Rank the effects that a fitted model may lack.

    Each is tested beside the model: the gain in cross-validation, and its family-wise p in simulated runs that lack
    nothing (docs/ranking.md).

    Parameters
    ----------
    fitted : the fitted model with its runs.
    effects : those tested; by default the whole catalogue beyond the base model.
    draws : number of simulations that lack nothing; at least 19 for a p of 0.05.
    seed : seed of the simulations.
    progress : called with a sentence at each step, e.g. ``print``.

    Examples
    --------
    >>> bars = [effect for key, effect in lacet.catalogue(runs).items() if key.startswith("anti_roll_bar")]
    >>> lacet.rank(fitted, bars, draws=19).best.key
    'anti_roll_bar.front'
    """
    tried = [effect for effect in catalogue(fitted.runs).values() if not effect.base] if effects is None else [*effects]

    def say(text: str) -> None:
        if progress:
            progress(text)

    say(f"simulating the noise floor, {draws} times")
    with one_thread():
        return Ranking(diagnose(fitted.details, fitted.noise_floor(draws), tried, seed, progress=in_words(say)))
