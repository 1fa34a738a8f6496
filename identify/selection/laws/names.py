"""Names of the catalogue for laws: which of its effects a law is, on these runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

Shaped = TypeVar("Shaped", bound=Effect)


def key_of(law: OneLine) -> str:
    """Text that distinguishes a law with its constants from others."""
    return f"{law.key} {sorted(law.shape.items())}"


def catalogue_names(space: ScoreTests, laws: Sequence[OneLine]) -> dict[str, tuple[str, ...]]:
    """`key_of` a law → keys of the candidates that it is: equal columns but for size, nuisance parameters removed.

    Constants of the candidates are tried between the values of their grids. Most alike first.
    """
    fresh = list({key_of(law): law for law in laws}.values())
    acting = _rows_of_candidates(space)
    alike: dict[str, dict[str, float]] = {key_of(law): {} for law in fresh}
    for places in {_rows(law) for law in fresh}:
        mine = [law for law in fresh if _rows(law) == places]
        known = [e for key, e in space.effects.items() if e.as_physics is not None and acting.get(key) == places]
        shapes = [shaped for effect in known for shaped in with_closer_constants(effect)]
        for start in range(0, len(shapes), LAWS.together):
            for key, name, value in _correlations(space, mine, shapes[start : start + LAWS.together]):
                alike[key][name] = max(value, alike[key].get(name, 0.0))
    return {
        key: tuple(name for name, value in sorted(found.items(), key=lambda item: -item[1])
                   if value >= SELECTION.same_correlation)
        for key, found in alike.items()
    }  # fmt: skip


def _rows(law: OneLine) -> frozenset[str]:
    return frozenset(row for row, _, _ in law.acted_on())


def _rows_of_candidates(space: ScoreTests) -> Mapping[str, frozenset[str]]:
    """Key of a candidate → rows it acts on."""
    acting = space.sums.over_runs.acting
    out: dict[str, set[Row]] = {}
    for trial in space.layout.trials:
        out.setdefault(trial.effect.key, set()).update(row for row, at in acting.items() if np.any(at[trial.place]))
    return {key: frozenset(map(str, rows)) for key, rows in out.items()}


def with_closer_constants(effect: Shaped) -> list[Shaped]:
    """The effect with its constants at all values of its grid, at their bounds, and between each two of them."""
    out = [effect]
    for name, grid in effect.grids.items():
        values = np.unique([*grid, *effect.bounds_of(name)])
        for _ in range(LAWS.closer_values):
            values = np.sort(np.concatenate([values, (values[:-1] + values[1:]) / 2.0]))
        out = [replace(one, shape={**one.shape, name: float(value)}) for one in out for value in values]
    return out


def _correlations(
    space: ScoreTests, laws: Sequence[OneLine], effects: Sequence[Effect]
) -> list[tuple[str, str, float]]:
    """`key_of` a law, key of an effect, and the multiple correlation of the law with the effect's columns."""
    inside, trials = space.beside([*laws, *effects], Extent.TOTAL)
    normal = inside.reduced_noisy
    energy, whole = np.diag(normal), np.diag(inside.sums.total)
    out: list[tuple[str, str, float]] = []
    for law, mine in zip(laws, trials, strict=False):
        i = mine.place.start
        for trial in trials[len(laws) :]:
            at = np.r_[trial.place]
            if np.any(energy[at] <= SELECTION.gone_share * whole[at]) or energy[i] <= SELECTION.gone_share * whole[i]:
                continue
            inner = normal[np.ix_(at, at)] + SELECTION.correlation_ridge * np.diag(energy[at])
            square = float(normal[i, at] @ np.linalg.solve(inner, normal[at, i])) / float(energy[i])
            out.append((key_of(law), trial.effect.key, float(np.sqrt(max(0.0, square)))))
    return out
