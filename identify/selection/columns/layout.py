"""Order of the columns that a ranking compares: those of the model, of the sensor sheet and of all candidates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from lacet.identify.effects.base import Effect, with_places
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.selection.columns.interpolation import interpolation_weights, searched_in_ratios


@dataclass(frozen=True)
class Trial:
    """Effect with one set of shape constants, and the place of its columns."""

    effect: Effect
    place: slice

    @property
    def fault(self) -> bool:
        """Whether it is a sensor fault."""
        return self.effect.as_fault is not None


@dataclass(frozen=True)
class Layout:
    """Order of the w columns in cross products: model, sensor sheet, trials, residual.

    Attributes
    ----------
    model : number of the model's columns, which come first.
    sheet : entries of the sensor sheet, one column for a tolerance of each.
    trials : effects whose columns follow; the residual is the last column.
    """

    model: int
    sheet: tuple[SheetEntry, ...]
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, model: int, sheet: Sequence[SheetEntry], effects: Sequence[Effect]) -> Layout:
        """The layout with trials of these effects at their present shapes."""
        trials = (Trial(effect, place) for effect, place in with_places(effects, start=model + len(sheet)))
        return cls(model, tuple(sheet), tuple(trials))

    @property
    def labels(self) -> tuple[str, ...]:
        """Descriptions of the columns of sheet and trials, equal for equal layouts."""
        return (*map(str, self.sheet), *(f"{t.effect!r} {t.place}" for t in self.trials))

    def spans(self, effect: Effect) -> bool:
        """Whether there are trials with shape constants on both sides of an effect's, to interpolate its columns."""
        constants = effect.shape.keys() >= effect.grids.keys()
        inside = (min(values) <= effect.shape[name] <= max(values) for name, values in effect.grids.items())
        return effect.key in self._places and constants and all(inside)

    def interpolation(self, effect: Effect) -> list[tuple[slice, float]]:
        """Places of an effect's trials around its shape constants, with their weights in the interpolation."""
        around: list[tuple[dict[str, float], float]] = [({}, 1.0)]
        for name, values in effect.grids.items():
            sides = interpolation_weights(values, effect.shape[name], searched_in_ratios(effect, name))
            around = [({**shape, name: at}, weight * w) for shape, weight in around for at, w in sides]
        places = self._places[effect.key]
        return [(places[tuple(sorted(shape.items()))], weight) for shape, weight in around]

    @cached_property
    def _places(self) -> Mapping[str, Mapping[tuple[tuple[str, float], ...], slice]]:
        """Key of an effect → its shape constants → place of the trial."""
        out: dict[str, dict[tuple[tuple[str, float], ...], slice]] = {}
        for trial in self.trials:
            if trial.effect.shape.keys() >= trial.effect.grids.keys():
                out.setdefault(trial.effect.key, {})[_constants(trial.effect)] = trial.place
        return out

    def of_keys(self, sizes: Mapping[str, float]) -> Iterator[tuple[slice, float]]:
        """Place of each trial whose effect is a key of `sizes`, with its size."""
        return ((t.place, sizes[t.effect.key]) for t in self.trials if t.effect.key in sizes)

    @property
    def right(self) -> int:
        """Index of the residual's column."""
        return self.trials[-1].place.stop if self.trials else self.model + len(self.sheet)

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right + 1


def _constants(effect: Effect) -> tuple[tuple[str, float], ...]:
    return tuple(sorted((name, effect.shape[name]) for name in effect.grids))
