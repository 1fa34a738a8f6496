"""A model's equations on runs, piece by piece: the columns of its parameters, sensor faults and each run's zeros."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.drive import Drive
from identify.effect import Effect, SensorFault
from identify.sensitivity import Sensitivity
from identify.sheet import SheetEntry, sheet_responses
from identify.vectors import Array
from identify.zeros import Zeros, zeros_of


@dataclass(frozen=True)
class Piece:
    """A run, or a part of a long one, with its equations.

    `number` counts the parts of a long run, and is None for a whole one.

    `blocks` row → (n, z + p), columns: the run's zeros, the parameters kept, the model's sensor faults; `right` row →
    (n,) measured left sides; `instants` row → (n,) place of each sample on the run's comb of kept instants; `weights`
    row → (n,) roots of the samples' weights, or None where all count alike.
    """

    run: int
    number: int | None
    drive: Drive
    blocks: Mapping[str, Array]
    right: Mapping[str, Array]
    instants: Mapping[str, NDArray[np.intp]]
    zeros: Zeros | None
    sensitivity: Sensitivity | None
    weights: Mapping[str, Array] | None


@dataclass(frozen=True)
class Known:
    """Of each run: how its residual answers to its channels, and what the sensor sheet's entries do to it."""

    sensitivities: tuple[Sensitivity, ...]
    responses: tuple[dict[SheetEntry, dict[str, Array]], ...]


class Assembly:
    """Makes the pieces of all runs, as often as asked; those of short runs are kept, those of long ones made anew.

    Parameters
    ----------
    physics : the model's effects; `keep` which of their parameters have columns of their own.
    faults : sensor faults in the model.
    drives : the runs.
    at : every physics' parameter, at which sensitivities are taken, or None: neither zeros nor faults.
    zeros : whether each run has its sensor zeros.
    known : what is known of the runs already; none of them is in pieces.
    """

    def __init__(
        self, physics: Sequence[Effect], keep: NDArray[np.int64], faults: Sequence[SensorFault],
        drives: Sequence[Drive], at: Array | None, zeros: bool, known: Known | None = None,
    ):  # fmt: skip
        self.physics, self.keep, self.faults = tuple(physics), keep, tuple(faults)
        self.drives, self.at, self.zeros = tuple(drives), at, zeros
        self.known = known
        self._responses: dict[int, dict[SheetEntry, dict[str, Array]]] = {}
        self.weights: dict[tuple[int, int | None], Mapping[str, Array]] = {}
        self._kept: dict[int, Piece] = {}

    def pieces(self) -> Iterator[Piece]:
        """Every piece of every run, in order."""
        for run, drive in enumerate(self.drives):
            for number, part in enumerate(drive.pieces()):
                whole = part is drive
                place = None if whole else number
                if whole and run in self._kept:
                    piece = self._kept[run]
                else:
                    piece = self._make(run, place, part)
                    if whole:
                        self._kept[run] = piece
                if (run, place) in self.weights:
                    piece = replace(piece, weights=self.weights[run, place])
                yield piece

    def sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[str, Array]]:
        """What the sensor sheet's gains and latencies do to a piece."""
        if self.known:
            return self.known.responses[piece.run]
        assert piece.sensitivity is not None
        if piece.number is not None:
            return sheet_responses(piece.drive, piece.sensitivity)
        if piece.run not in self._responses:
            self._responses[piece.run] = sheet_responses(piece.drive, piece.sensitivity)
        return self._responses[piece.run]

    def as_known(self) -> Known:
        """What other noise on the same motions leaves as it is. Raises ValueError when a run is in pieces."""
        if set(self._kept) != set(range(len(self.drives))) or self.at is None:
            raise ValueError("a long run is in pieces, and nothing of it is kept")
        responses = tuple(self.sheet_responses(self._kept[run]) for run in range(len(self.drives)))
        return Known(self.sensitivities(), responses)

    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Each whole run's sensitivity; long runs' are taken now."""
        at = self.at
        if at is None:
            return ()
        return tuple(
            kept.sensitivity
            if (kept := self._kept.get(run)) is not None and kept.sensitivity is not None
            else Sensitivity.of(drive.recording, self.physics, at)
            for run, drive in enumerate(self.drives)
        )

    def _make(self, run: int, number: int | None, drive: Drive) -> Piece:
        whole = number is None
        step = drive.recording.filters.step
        matrices = {row: drive.matrix(self.physics, row)[:, self.keep] for row in drive.rows}
        sensitivity, zeros = None, None
        if self.at is not None:
            known = self.known.sensitivities[run] if self.known and whole else None
            sensitivity = known or Sensitivity.of(drive.recording, self.physics, self.at)
            faults = [drive.decimated(sensitivity.fault(fault)) for fault in self.faults]
            for row, W in matrices.items():
                matrices[row] = np.column_stack([W, *(found.get(row, np.zeros(len(W))) for found in faults)])
            if self.zeros:
                zeros = zeros_of(drive, sensitivity, every=not whole)
                matrices = {row: np.column_stack([zeros.columns[row], W]) for row, W in matrices.items()}
        instants = {row: (drive.index[row] + drive.offset) // step for row in drive.rows}
        return Piece(run, number, drive, matrices, drive.measured, instants, zeros, sensitivity, None)
