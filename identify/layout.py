"""Where the columns of a model and of its candidates stand, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.assembly import Piece
from identify.effect import Effect, SensorFault
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
    """The model's columns, then the trials', the measured right side last."""

    model: int
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, model: int, effects: Sequence[Effect]) -> Layout:
        """Every effect at every shape, after `model` columns."""
        trials: list[Trial] = []
        start = model
        for effect in effects:
            for one in effect.shapes():
                stop = start + len(one.parameters)
                trials.append(Trial(one, slice(start, stop)))
                start = stop
        return cls(model, tuple(trials))

    @property
    def right(self) -> int:
        """Place of the right side."""
        return self.trials[-1].place.stop if self.trials else self.model

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right + 1


def fault_columns(piece: Piece, layout: Layout) -> dict[str, dict[str, Array]]:
    """For each sensor fault of the layout, row → (1, n) change of Y − W θ per unit, filtered together."""
    faults = [t.effect for t in layout.trials if isinstance(t.effect, SensorFault)]
    if not faults or piece.sensitivity is None:
        return {}
    found = {fault.key: piece.sensitivity.fault(fault) for fault in faults}
    out: dict[str, dict[str, Array]] = {key: {} for key in found}
    for row in piece.drive.rows:
        having = [key for key, response in found.items() if row in response and np.any(response[row])]
        if having:
            series = piece.drive.decimated({row: np.stack([found[key][row] for key in having])})[row]
            for key, one in zip(having, series, strict=True):
                out[key][row] = one[None]
    return out
