"""Steps of a search that begins with other laws than the true ones: constants of one of them free, one for two.

An effect selected early gets the constants with which it does the work of those that are missing beside it: a bump stop
without a gap that of a progressive spring. Where it has them, the spring explains nothing more. So a candidate is
tested beside the selected effects with the constants of each of them free in turn, and a selected effect is dropped
where another with other constants does its work. A law like the true one is selected together with what the two
differ by: one candidate in the place of both. All falls follow from the cross products of the columns.

Source: H. Hazimeh and R. Mazumder, Fast best subset selection: coordinate descent and local combinatorial optimization
algorithms, Operations Research 68 (2020): beyond local optima of single steps by exchanges of several at once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class FreeStep:
    """A candidate beside the selected effects, one of which has other shape constants.

    Attributes
    ----------
    candidate : the candidate.
    other : the selected effect with its other constants.
    fall : fall of the weighted squares by the candidate beside the others with these constants.
    gain : fall of the weighted squares in all, from the selected effects as they are.
    """

    candidate: Effect
    other: Effect
    fall: float
    gain: float


class FreeConstants:
    """The selected effects of score tests, one of which may have any constants of its grid.

    Parameters
    ----------
    space : score tests beside the selected effects.
    keys : those that are selected in the present search.
    """

    def __init__(self, space: ScoreTests, keys: Collection[str]):
        known = space.regression_without(keys)
        self.right = space.layout.right
        self.trials = [trial for trial in space.layout.trials if not trial.fault]
        self.own = {t.effect.key: t for t in space.columns.selected if t.effect.key in keys}
        self.normal = known.reduced.copy()
        for trial in space.layout.trials:
            spread = np.array([q.prior for q in trial.effect.parameters])
            self.normal[trial.place, trial.place] += np.diag(spread**-2.0)
        # Less its noise, a column that is mostly noise would seem to explain anything.
        noise = (1.0 / SELECTION.most_noise_in_candidate - 1.0) * np.diag(known.noise)
        self.least = np.maximum(SELECTION.gone_share * np.diag(space.sums.total), noise)

    def steps(self, candidates: Collection[str]) -> list[FreeStep]:
        """For each candidate the best step with other constants of one selected effect; the largest gain first.

        Only where it explains more than any candidate beside the effects with the constants that they have.
        """
        tried = [trial for trial in self.trials if trial.effect.key in candidates]
        blocks, best = _Blocks.of(tried), dict[str, FreeStep]()
        present, beside = self._given(self.own.values())
        plain = float(np.max(blocks.falls(beside, self.right, self.least), initial=0.0))
        for key, options in self._options().items():
            less, normal = self._given(trial for other, trial in self.own.items() if other != key)
            for option in options:
                by_option, after = self._swept(normal, option.place)
                for trial, fall in zip(tried, blocks.falls(after, self.right, self.least).tolist(), strict=True):
                    name, gain = trial.effect.key, less + by_option + fall - present
                    if gain > (best[name].gain if name in best else plain + SELECTION.least_refinement_fall):
                        best[name] = FreeStep(trial.effect, option.effect, fall, gain)
        return sorted(best.values(), key=lambda step: -step.gain)

    def in_place_of_one(self, candidates: Collection[str]) -> list[tuple[FreeStep, str]]:
        """Steps with a candidate in the place of a selected effect, whose key is returned with each; as `steps`.

        For each candidate and effect the best, if all explain more so, or with fewer constants as much (`least_gain`).
        """
        tried = [trial for trial in self.trials if trial.effect.key in candidates]
        blocks, best = _Blocks.of(tried), dict[tuple[str, str], FreeStep]()
        present, _ = self._given(self.own.values())
        for key, own in self.own.items():
            for name, options in self._options().items():
                less, normal = self._given(trial for other, trial in self.own.items() if other not in (key, name))
                for option in options if name != key else ():
                    by_option, after = self._swept(normal, option.place)
                    for trial, fall in zip(tried, blocks.falls(after, self.right, self.least).tolist(), strict=True):
                        pair, gain = (key, trial.effect.key), less + by_option + fall - present
                        least = least_gain(trial.effect, own.effect)
                        if gain > (best[pair].gain if pair in best else least):
                            best[pair] = FreeStep(trial.effect, option.effect, fall, gain)
        return [(step, key) for (key, _), step in sorted(best.items(), key=lambda one: -one[1].gain)]

    def loss_without(self, key: str) -> tuple[float, Effect | None]:
        """Rise of the weighted squares without a selected effect, the constants of another one free.

        The other one with its constants is returned as well; None where no other one explains more with others.
        """
        present, _ = self._given(self.own.values())
        kept, _ = self._given(trial for other, trial in self.own.items() if other != key)
        best, with_other = kept, None
        for name, options in self._options().items():
            if name != key:
                less, normal = self._given(t for other, t in self.own.items() if other not in (key, name))
                for option in options:
                    fall = less + self._swept(normal, option.place)[0]
                    if fall > best + SELECTION.least_refinement_fall:
                        best, with_other = fall, option.effect
        return present - best, with_other

    def in_place_of_two(
        self, candidates: Collection[str], pairs: Mapping[tuple[str, str], float]
    ) -> list[tuple[float, Effect, tuple[str, str]]]:
        """Rises of the weighted squares with a candidate in the place of two selected effects, the least first.

        Beside the candidate the two must explain less than `exchanged_share` of what they do; else all are missing.
        `pairs` : keys of the two → weighted squares up to which the rise may be.
        """
        tried = [trial for trial in self.trials if trial.effect.key in candidates]
        blocks, (present, beside) = _Blocks.of(tried), self._given(self.own.values())
        further = blocks.falls(beside, self.right, self.least).tolist()
        out: list[tuple[float, Effect, tuple[str, str]]] = []
        for pair, most in pairs.items():
            kept, normal = self._given(trial for key, trial in self.own.items() if key not in pair)
            falls = blocks.falls(normal, self.right, self.least).tolist()
            best: dict[str, tuple[float, Effect, tuple[str, str]]] = {}
            for trial, fall, more in zip(tried, falls, further, strict=True):
                rise = present - kept - fall
                least = best[trial.effect.key][0] if trial.effect.key in best else most
                if rise < least and rise + more <= SELECTION.exchanged_share * (present - kept):
                    best[trial.effect.key] = rise, trial.effect, pair
            out += best.values()
        return sorted(out, key=lambda one: one[0])

    def _options(self) -> Mapping[str, Sequence[Trial]]:
        """Selected effect with constants → its trials at the values of its grids."""
        out: dict[str, list[Trial]] = {}
        for trial in self.trials:
            key = trial.effect.key
            if key in self.own and trial.effect.grids and trial is not self.own[key]:
                out.setdefault(key, []).append(trial)
        return out

    def _given(self, selected: Iterable[Trial]) -> tuple[float, Array]:
        """Fall by some selected effects, and the normal matrix of all columns beside them."""
        places = [np.r_[trial.place] for trial in selected]
        return self._swept(self.normal, np.concatenate(places)) if places else (0.0, self.normal)

    def _swept(self, normal: Array, at: slice | NDArray[np.intp]) -> tuple[float, Array]:
        """Fall by the columns at these places, and the normal matrix of the others beside them."""
        rows = normal[at]
        gain = solved(rows[:, at], rows)
        return float(rows[:, self.right] @ gain[:, self.right]), normal - rows.T @ gain


def least_gain(candidate: Effect, law: Effect) -> float:
    """Weighted squares by which a candidate in the place of a law must explain more, with all constants searched anew.

    It may be less by as much as the search of constants leaves, if it has fewer sizes and constants than the law.
    """
    fewer = _constants(candidate) < _constants(law)
    return -SELECTION.least_refinement_fall if fewer else SELECTION.least_refinement_fall


def _constants(effect: Effect) -> int:
    return len(effect.parameters) + len(effect.grids)


@dataclass(frozen=True)
class _Blocks:
    """Places (n, k) of the columns of n trials; `there` (n, k) which of them a trial has, the others are filled up."""

    places: NDArray[np.intp]
    there: NDArray[np.bool_]

    @classmethod
    def of(cls, trials: Sequence[Trial]) -> _Blocks:
        size = max((t.place.stop - t.place.start for t in trials), default=0)
        counts = np.array([t.place.stop - t.place.start for t in trials], np.intp)
        there = np.arange(size) < counts[:, None]
        starts = np.array([t.place.start for t in trials], np.intp)
        return cls(starts[:, None] + np.where(there, np.arange(size), 0), there)

    def falls(self, normal: Array, right: int, least: Array) -> Array:
        """(n,) fall by each trial's columns; 0 where the energy of one of them beside those in `normal` is not above
        `least`."""
        squares, score = normal[self.places[:, :, None], self.places[:, None, :]], normal[self.places, right]
        both = self.there[:, :, None] & self.there[:, None, :]
        squares = np.where(both, squares, np.eye(self.there.shape[1]))
        score = np.where(self.there, score, 0.0)
        diagonal = np.einsum("nkk->nk", squares)
        shown = np.all(~self.there | (diagonal > least[self.places]), axis=1)
        scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        values, vectors = np.linalg.eigh(squares / (scale[:, :, None] * scale[:, None, :]))
        turned = np.einsum("nkj,nk->nj", vectors, score / scale)
        kept = values > SELECTION.shared_eigenvalue * np.max(values, axis=1, initial=0.0, keepdims=True)
        falls = np.sum(np.divide(turned**2, values, out=np.zeros_like(turned), where=kept), axis=1)
        return np.where(shown, falls, 0.0)
