"""Where the columns of a model and of its candidates stand, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.assembly import Piece
from identify.effect import Effect, SensorFault
from identify.fit import Fit
from identify.sheet import SheetEntry
from identify.vectors import Array


@dataclass(frozen=True)
class Trial:
    """One effect at one set of shape constants, and the place of its columns."""

    effect: Effect
    place: slice

    @property
    def fault(self) -> bool:
        """Whether it is a sensor fault."""
        return isinstance(self.effect, SensorFault)


@dataclass(frozen=True)
class Layout:
    """The model's columns, one for one tolerance of each entry of the sensor sheet, the trials', the residual."""

    model: int
    sheet: tuple[SheetEntry, ...]
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, model: int, sheet: Sequence[SheetEntry], effects: Sequence[Effect]) -> Layout:
        """Every effect at every shape, after the columns of model and sheet."""
        trials: list[Trial] = []
        start = model + len(sheet)
        for effect in effects:
            for one in effect.shapes():
                stop = start + len(one.parameters)
                trials.append(Trial(one, slice(start, stop)))
                start = stop
        return cls(model, tuple(sheet), tuple(trials))

    @property
    def right(self) -> int:
        """Place of the right side."""
        return self.trials[-1].place.stop if self.trials else self.model + len(self.sheet)

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right + 1


def sensor_columns(fitted: Fit, piece: Piece, layout: Layout) -> dict[str, list[tuple[slice, Array]]]:
    """Row → place and (p, n) columns of the sheet's entries and of the sensor faults on a piece."""
    out: dict[str, list[tuple[slice, Array]]] = {row: [] for row in piece.blocks}
    responses = fitted.assembly.sheet_responses(piece) if layout.sheet else {}
    for place, entry in enumerate(layout.sheet, start=layout.model):
        for row, series in responses.get(entry, {}).items():
            if np.any(series):
                out[row].append((slice(place, place + 1), series[None]))
    faults = [trial for trial in layout.trials if isinstance(trial.effect, SensorFault)]
    found: dict[int, dict[str, Array]] = {}
    for trial in faults:
        assert isinstance(trial.effect, SensorFault)
        assert piece.sensitivity is not None
        found[trial.place.start] = piece.sensitivity.fault(trial.effect)
    for row in piece.drive.rows:
        having = [t.place for t in faults if row in found[t.place.start] and np.any(found[t.place.start][row])]
        if having:
            # Through the filter together.
            series = piece.drive.decimated({row: np.stack([found[place.start][row] for place in having])})[row]
            out[row] += [(place, one[None]) for place, one in zip(having, series, strict=True)]
    return out
