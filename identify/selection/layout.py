"""Where the columns of a model and of its candidates stand, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.tolerances import SheetEntry, sheet_entries, sheet_responses
from lacet.identify.regression.wls import Fit


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
        """Effects at their present shapes side by side, after the columns of model and sheet."""
        trials: list[Trial] = []
        start = model + len(sheet)
        for effect in effects:
            stop = start + len(effect.parameters)
            trials.append(Trial(effect, slice(start, stop)))
            start = stop
        return cls(model, tuple(sheet), tuple(trials))

    @property
    def labels(self) -> tuple[str, ...]:
        """What the columns of sheet and trials are, for telling two layouts apart."""
        return (*map(str, self.sheet), *(f"{t.effect!r} {t.place}" for t in self.trials))

    @property
    def right(self) -> int:
        """Place of the right side."""
        return self.trials[-1].place.stop if self.trials else self.model + len(self.sheet)

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right + 1


def sheet_of(fitted: Fit) -> list[SheetEntry]:
    """Gains and latencies of the sheet that the runs' rows can see, those apart that the model has as faults."""
    ours = {(fault.tolerance, channel) for fault in fitted.model.faults for channel in fault.channels()}
    found: dict[SheetEntry, None] = {}
    for run, drive in enumerate(fitted.drives):
        piece = next(fitted.assembly.pieces_of(run))
        assert piece.sensitivity is not None
        seen = dict.fromkeys(name for name, _, _ in piece.sensitivity.coarse)
        found |= dict.fromkeys(sheet_entries(drive.recording.rig, seen))
    return [entry for entry in found if entry[:2] not in ours]


def sensor_columns(
    fitted: Fit, layout: Layout, piece: Piece, noisy: Drive | None = None
) -> dict[str, list[tuple[slice, Array]]]:
    """Row → place and (p, n) columns of the sheet's entries and of the sensor faults on a piece, or with more noise."""
    out: dict[str, list[tuple[slice, Array]]] = {row: [] for row in piece.blocks}
    faults = [(t.place, t.effect) for t in layout.trials if isinstance(t.effect, SensorFault)]
    if piece.sensitivity is None or not (faults or layout.sheet):
        return out
    # Sensitivities may be another run's of the same motion; the noise in these columns must be this one's.
    drive = noisy or piece.drive
    sensitivity = piece.sensitivity.on(drive.recording)
    responses = sheet_responses(noisy, sensitivity) if noisy else fitted.assembly.own_sheet_responses(piece)
    for place, entry in enumerate(layout.sheet, start=layout.model):
        for row, series in responses.get(entry, {}).items():
            if row in out and np.any(series):
                out[row].append((slice(place, place + 1), series[None]))
    found = drive.decimated_each(sensitivity.fault(fault) for _, fault in faults)
    for (place, _), response in zip(faults, found, strict=True):
        for row, series in response.items():
            if row in out and np.any(series):
                out[row].append((place, series[None]))
    return out
