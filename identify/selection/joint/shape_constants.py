"""Shape constants of effects that are in the model together: a search for those that explain most, on finer grids.

Every round is one pass over the samples with further values of each constant, on a grid around the best that is a
quarter as wide as the one before; which combination of them explains most then follows from the cross products.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.columns.drawn_noise import DrawnNoise
from lacet.identify.selection.columns.interpolation import searched_in_ratios
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor


def constants_by_runs(
    fitted: Fit, floor: NoiseFloor, effects: Sequence[Effect], progress: Progress = silent,
    drawn: Sequence[DrawnNoise] = (),
) -> list[Effect]:  # fmt: skip
    """The effects with the shape constants at which they explain most together of what a fit leaves on its runs.

    Nothing is asked of them: they need not be missing. `floor` : noise floor of the fit; `drawn` :
    noise in the columns drawn for other fits.
    """
    if not any(effect.grids for effect in effects):
        return list(effects)
    begun = [replace(e, shape={**{name: values[0] for name, values in e.grids.items()}, **e.shape}) for e in effects]
    progress(Step(Stage.SHAPE_CONSTANTS, subject=", ".join(effect.key for effect in effects)))
    space = ScoreTests.of(Linearisation.of(fitted, floor), begun, 0, None, progress, drawn)
    known = [effect for effect in begun if effect.key in space.effects]
    found = {effect.key: effect for effect in with_best_constants(space, known, progress)}
    return [found.get(effect.key, effect) for effect in begun]


def with_best_constants(
    space: ScoreTests, effects: Sequence[Effect], progress: Progress = silent, groups: Sequence[int] | None = None
) -> list[Effect]:
    """The effects with the shape constants, within their bounds, at which they explain most together.

    `groups` : number of the group of each effect, where only those of a group are in the model together.

    The search begins at the constants that they have and at all values of their grids, and goes on around the best of
    them. The same law at several places has common constants, and is the simplest of its kind (`Effect.simplest`),
    unless others explain more than noise by each further constant, and more than the law may be inexact.
    """
    each = [[i] for i in range(len(effects))]
    if groups is not None:
        return _searched(space, effects, each, progress, sets=groups)
    laws = _same_law(effects)
    begun = list(effects)
    for group in laws:
        for i in group:
            begun[i] = replace(effects[i], shape=effects[group[0]].shape)
    common = _searched(space, begun, laws, progress)
    answers, searched = [common] if begun == list(effects) else [common, list(effects)], [(common, laws)]
    if any(len(group) > 1 for group in laws):
        answers.append(own := _searched(space, common, each, progress, grid=False))
        searched.append((own, each))
    for found, moved in searched:
        if (simple := [_simplest(effect) for effect in found]) != found:
            answers.append(_searched(space, simple, moved, progress, simple=True))
    return _fewest_constants(space, answers, laws) if len(answers) > 1 else common


def _simplest(effect: Effect) -> Effect:
    """The effect as the simplest law of its kind."""
    return replace(effect, shape={**effect.shape, **effect.simplest}) if effect.simplest else effect


def _fewest_constants(
    space: ScoreTests, answers: Sequence[Sequence[Effect]], laws: Sequence[Sequence[int]]
) -> list[Effect]:  # fmt: skip
    """Of several answers, the first of which has common constants, each law with the fewest that are good enough.

    One is not good enough where another with more constants explains more: by more than noise for each of them, and by
    more than the law may be inexact.
    """
    fall = _Falls.of(space, list(zip(*answers, strict=True)))
    out = list(answers[0])
    for group in laws:
        chosen = ([k if i in group else 0 for i in range(len(out))] for k in (*range(len(answers)), None))
        *falls, without = map(fall.of_choice, chosen)
        allowed = SELECTION.law_inexactness**2 * (max(falls) - without)
        counts = [_constants_of_law([answer[i] for i in group]) for answer in answers]
        best = min(
            (k for k in range(len(answers)) if all(
                other - falls[k] <= max(SELECTION.least_refinement_fall * (more - counts[k]), allowed)
                for other, more in zip(falls, counts, strict=True) if more > counts[k])),
            key=lambda k: (counts[k], -falls[k]),
        )  # fmt: skip
        for i in group:
            out[i] = answers[best][i]
    return out


def _constants_of_law(effects: Sequence[Effect]) -> int:
    """Number of constants of a law that are neither common to its places nor those of the simplest law."""
    different = {tuple(sorted(effect.shape.items())): effect for effect in effects}.values()
    return sum(
        effect.simplest.get(name) != value
        for effect in different
        for name, value in effect.shape.items()
        if name in effect.grids and np.ptp(effect.bounds_of(name)) > 0.0
    )


def constants_found(effects: Sequence[Effect]) -> int:
    """Number of constants that had to be found: those common to several places count once, the simplest not at all."""
    return sum(_constants_of_law([effects[i] for i in group]) for group in _same_law(effects))


def fall_of(space: ScoreTests, effects: Sequence[Effect]) -> float:
    """Fall of the weighted squares by effects at the shape constants that they have, all in the model together."""
    return _Falls.of(space, [[effect] for effect in effects]).of_choice([0] * len(effects))


def implausible_together(space: ScoreTests, effects: Sequence[Effect]) -> set[str]:
    """Keys of those that have a size that no car, or sensor, has, all in the model together."""
    known, trials = space.beside(effects)
    at = np.array([i for trial in trials for i in range(trial.place.start, trial.place.stop)], np.intp)
    prior = np.array([q.prior for trial in trials for q in trial.effect.parameters])
    spread = solved(known.reduced_noisy[np.ix_(at, at)] + np.diag(prior**-2.0), np.eye(len(at)))
    values = spread @ known.reduced[at, known.sums.layout.right]
    half = SELECTION.interval_quantile * np.sqrt(np.maximum(0.0, np.diag(spread)))
    ends = np.cumsum([len(trial.effect.parameters) for trial in trials])[:-1]
    sizes = zip(trials, np.split(values, ends), np.split(half, ends), strict=True)
    return {trial.effect.key for trial, size, own in sizes if trial.effect.implausible(size, own) is not None}


def _same_law(effects: Sequence[Effect]) -> list[list[int]]:
    """Indices of the effects, those of one law with constants together."""
    groups: dict[tuple[str, int], list[int]] = {}
    for i, effect in enumerate(effects):
        groups.setdefault((effect.name, -1) if effect.shape else (effect.name, i), []).append(i)
    return list(groups.values())


def _searched(
    space: ScoreTests, effects: Sequence[Effect], groups: Sequence[Sequence[int]], progress: Progress,
    sets: Sequence[int] | None = None, grid: bool = True, simple: bool = False,
) -> list[Effect]:  # fmt: skip
    """The effects with the best constants, a group with the same; in the model together are those of one set.

    `grid` : whether the values of their grids are tried as well; `simple` : they stay the simplest laws of their kind.
    """
    sets = [0] * len(effects) if sets is None else sets
    found = list(effects)
    held: list[Mapping[str, float]] = [effect.simplest if simple else dict[str, float]() for effect in found]
    widths = [
        {name: width for name, width in _first_widths(effect).items() if name not in stay}
        for effect, stay in zip(found, held, strict=True)
    ]
    for number in range(SELECTION.most_constant_rounds):
        moving = [group for group in groups if widths[group[0]]]
        if not moving:
            break
        names = ", ".join(found[i].key for group in moving for i in group)
        progress(Step(Stage.SHAPE_CONSTANTS, number + 1, subject=names))
        inner = [[effect, *_around(effect, own)] for effect, own in zip(found, widths, strict=True)]
        outer = [
            [*_around(effect, own, edge=True), *(_on_grid(effect, stay) if own and grid and number == 0 else [])]
            for effect, own, stay in zip(found, widths, held, strict=True)
        ]
        tried = [[*near, *far] for near, far in zip(inner, outer, strict=True)]
        fall = _Falls.of(space, tried)
        chosen: list[int | None] = [0] * len(found)
        for group in moving:
            first = group[0]
            others = [k if one == sets[first] else None for k, one in zip(chosen, sets, strict=True)]
            falls = [
                fall.of_choice([k if i in group else one for i, one in enumerate(others)])
                for k in range(len(tried[first]))
            ]
            best = int(np.argmax(falls))
            gained = falls[best] - falls[0]
            settled = gained < SELECTION.least_refinement_fall
            if settled and not (gained > 0.0 and found[first].shape != effects[first].shape):
                best = 0  # another value than that of the grid must be better by more than noise
            for i in group:
                chosen[i] = best
                if best < len(inner[first]):
                    widths[i] = _narrower(tried[i][best], widths[i], settled)
        found = [options[k or 0] for options, k in zip(tried, chosen, strict=True)]
    return found


def refined(space: ScoreTests, c: Candidate) -> Candidate:
    """The candidate with shape constants searched between the values of its grid, and its parameters for them.

    p and gain remain those of the grid, over which the simulated runs were searched as well.
    """
    if not c.shape or not c.tested:
        return c
    (best,) = with_best_constants(space, [replace(space.effects[c.key], shape=c.shape)])
    if best.shape == c.shape:
        return c
    inside, (trial,) = space.beside([best], Extent.TOTAL)
    values, spread = inside.values(trial.place)
    half = SELECTION.interval_quantile * spread
    return replace(c, shape=dict(best.shape), values=tuple(map(float, values)), interval=tuple(map(float, half)))


def _on_grid(effect: Effect, held: Collection[str]) -> list[Effect]:
    """The effect at all values of its grids, with the constants `held` that it has."""
    return [one for one in effect.shapes() if all(one.shape[name] == effect.shape[name] for name in held)]


def _first_widths(effect: Effect) -> dict[str, float]:
    """Half-width of the first grid around each constant: the distance to the next value, or its ratio's logarithm."""
    out: dict[str, float] = {}
    for name in effect.shape:
        values = np.unique(effect.grids[name])
        scale = np.log(values) if searched_in_ratios(effect, name) else values
        out[name] = float(np.min(np.diff(scale))) if values.size > 1 else 0.0
    return {name: width for name, width in out.items() if width > 0.0}


def _narrower(effect: Effect, widths: dict[str, float], settled: bool) -> dict[str, float]:
    """The half-widths of the next grid; none where the search has `settled` and the values are close."""
    first, parts = _first_widths(effect), _parts(widths)
    if settled and any(widths[name] / parts < SELECTION.least_constant_step * first[name] for name in widths):
        return {}
    return {name: width / parts for name, width in widths.items()}


def _parts(widths: Mapping[str, float]) -> int:
    """Number of parts that a half-width is divided into: fewer where more than two constants are searched at once."""
    return 4 if len(widths) <= 2 else 2


def _around(effect: Effect, widths: dict[str, float], edge: bool = False) -> Iterator[Effect]:
    """The effect with its constants on a grid around them, within their bounds; its inner part, or its `edge`."""
    parts = _parts(widths)
    for move in itertools.product(range(1 - parts, parts), repeat=len(widths)):
        if not any(move) or edge != (max(map(abs, move)) == parts - 1):
            continue
        shape = dict(effect.shape)
        for by, (name, width) in zip(move, widths.items(), strict=True):
            low, high = effect.bounds_of(name)
            away = by * width / parts
            moved = shape[name] * np.exp(away) if searched_in_ratios(effect, name) else shape[name] + away
            shape[name] = float(np.clip(moved, low, high))
        if shape != dict(effect.shape):
            yield replace(effect, shape=shape)


@dataclass(frozen=True)
class _Falls:
    """Falls of the weighted squares by one option of each effect, all in the model together.

    `places` : for each effect, the places of the columns of its options; `prior` 1 σ of each column's parameter.
    """

    inside: PartialRegression
    places: list[list[slice]]
    prior: Array

    @classmethod
    def of(cls, space: ScoreTests, tried: Sequence[Sequence[Effect]]) -> _Falls:
        inside, trials = space.beside([option for options in tried for option in options], Extent.TOTAL)
        queue = iter(trials)
        places = [[next(queue).place for _ in options] for options in tried]
        prior = np.ones(inside.sums.layout.width)
        for trial in trials:
            prior[trial.place] = [q.prior for q in trial.effect.parameters]
        return cls(inside, places, prior)

    def of_choice(self, chosen: Sequence[int | None]) -> float:
        """Fall by the option of each effect that is chosen; None for an effect that is left out."""
        pairs = zip(self.places, chosen, strict=True)
        at = np.array([place for options, k in pairs if k is not None for place in np.r_[options[k]]], np.intp)
        if not at.size:
            return 0.0
        score = self.inside.reduced[at, self.inside.sums.layout.right]
        normal = self.inside.reduced[np.ix_(at, at)] + np.diag(self.prior[at] ** -2.0)
        return float(score @ solved(normal, score[:, None])[:, 0])
