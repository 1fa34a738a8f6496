"""A model's equations on runs, piece by piece: the columns of its parameters, sensor faults and each run's zeros."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import count, repeat

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import Zeros, zeros_of
from lacet.identify.regression.tolerances import SheetEntry, sheet_responses

KEPT = 900.0
"""Pieces of long runs are kept, without their full-rate motion, until they are this long together [s]."""


@dataclass(frozen=True)
class Piece:
    """A run, or a part of a long one, with its equations.

    `number` counts the parts of a long run, and is None for a whole one; `seed` of the run's noise draws.

    `blocks` row → (n, z + p), columns: the run's zeros, the parameters kept, the model's sensor faults; `right` row →
    (n,) measured left sides; `instants` row → (n,) place of each sample on the run's comb of kept instants; `weights`
    row → (n,) roots of the samples' weights, or None where all count alike.
    """

    run: int
    number: int | None
    seed: int
    prepared: PreparedRun
    blocks: Mapping[Row, Array]
    right: Mapping[Row, Array]
    instants: Mapping[Row, NDArray[np.intp]]
    zeros: Zeros | None
    sensitivity: Sensitivity | None
    weights: Mapping[Row, Array] | None

    def anew(self) -> Piece:
        """The same equations, with nothing that was computed beside them: full-rate motion, slopes, further columns."""
        sensitivity = None if self.sensitivity is None else self.sensitivity.anew()
        return replace(self, prepared=self.prepared.anew(), sensitivity=sensitivity)


@dataclass(frozen=True)
class Known:
    """Sensitivities of each run's residual to its channels, and its responses to the sensor sheet's entries."""

    sensitivities: tuple[Sensitivity, ...]
    responses: tuple[dict[SheetEntry, dict[Row, Array]], ...]


@dataclass
class _PieceCache:
    """Pieces and what the sensor sheet does to them, made once: pure memoisation, shared by `Assembly.weighted`.

    `pieces`, and `own` (this very run's responses to the sheet's entries), by run and piece; `responses` by run; `long`
    length of the pieces of long runs that were kept [s].
    """

    pieces: dict[tuple[int, int | None], Piece] = field(default_factory=dict[tuple[int, int | None], Piece])
    responses: dict[int, dict[SheetEntry, dict[Row, Array]]] = field(
        default_factory=dict[int, dict[SheetEntry, dict[Row, Array]]]
    )
    own: dict[tuple[int, int | None], dict[SheetEntry, dict[Row, Array]]] = field(
        default_factory=dict[tuple[int, int | None], dict[SheetEntry, dict[Row, Array]]]
    )
    long: float = 0.0


class Assembly:
    """The equations of all runs in pieces; those of very long runs are made anew each time they are read.

    Parameters
    ----------
    physics : the model's effects; `keep` which of their parameters have columns of their own.
    faults : sensor faults in the model.
    runs : the runs.
    at : every physics' parameter, at which sensitivities are taken, or None: neither zeros nor faults.
    zeros : whether each run has its sensor zeros.
    known : what is known of the runs already; none of them is in pieces.
    seeds : number of each run in the seeds of its noise draws; by default its place.
    """

    def __init__(
        self, physics: Sequence[PhysicalEffect], keep: NDArray[np.int64], faults: Sequence[SensorFault],
        runs: Sequence[PreparedRun], at: Array | None, zeros: bool, known: Known | None = None,
        seeds: Sequence[int] = (),
    ):  # fmt: skip
        self.physics, self.keep, self.faults = tuple(physics), keep, tuple(faults)
        self.runs, self.at, self.zeros = tuple(runs), at, zeros
        self.known = known
        self.seeds = tuple(seeds) or tuple(range(len(self.runs)))
        self.weights: Mapping[tuple[int, int | None], Mapping[Row, Array]] = {}
        self._cache = _PieceCache()

    def weighted(self, weights: Mapping[tuple[int, int | None], Mapping[Row, Array]]) -> Assembly:
        """The same equations with other weights of samples: (run, piece) → row → (n,) roots of them."""
        out = copy(self)
        out.weights = weights
        return out

    def pieces(self) -> Iterator[Piece]:
        """Every piece of every run, in order."""
        for run in range(len(self.runs)):
            yield from self.pieces_of(run)

    def pieces_of(self, run: int) -> Iterator[Piece]:
        """Every piece of one run, in order; what is computed on a part of a long run goes with the piece."""
        return map(self._piece, repeat(run), self.runs[run].pieces(), count())

    def _piece(self, run: int, part: PreparedRun, number: int) -> Piece:
        """A part of a run, as it is kept or made now."""
        place = run, None if part is self.runs[run] else number
        piece = self._cache.pieces.get(place)
        if piece is None:
            piece = self._make(*place, part)
            self._keep(piece)
        if piece.number is not None:
            piece = piece.anew()
        weights = self.weights.get(place)
        return piece if weights is None else replace(piece, weights=weights)

    def _keep(self, piece: Piece) -> None:
        if piece.number is None:
            self._cache.pieces[piece.run, None] = piece
            return
        self._cache.long += float(np.ptp(piece.prepared.recording.t))
        if self._cache.long <= KEPT:
            self._cache.pieces[piece.run, piece.number] = piece

    def sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """Responses of a piece to the sensor sheet's gains and latencies."""
        if self.known:
            return self.known.responses[piece.run]
        assert piece.sensitivity is not None
        if piece.number is not None:
            return sheet_responses(piece.prepared, piece.sensitivity)
        if piece.run not in self._cache.responses:
            self._cache.responses[piece.run] = sheet_responses(piece.prepared, piece.sensitivity)
        return self._cache.responses[piece.run]

    def own_sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """The same with the noise of this very run, where sensitivities may be another run's of the same motion."""
        if self.known is None and piece.number is None:
            return self.sheet_responses(piece)
        assert piece.sensitivity is not None
        place = (piece.run, piece.number)
        found = self._cache.own.get(place)
        if found is None:
            found = sheet_responses(piece.prepared, piece.sensitivity.on(piece.prepared.recording))
            if place in self._cache.pieces:
                self._cache.own[place] = found
        return found

    @staticmethod
    def noisy_sheet_responses(piece: Piece, sensitivity: Sensitivity) -> dict[SheetEntry, dict[Row, Array]]:
        """The same of a piece with other noise drawn, by its `sensitivity`; not kept."""
        return sheet_responses(piece.prepared, sensitivity)

    def as_known(self) -> Known:
        """What other noise on the same motions leaves as it is. Raises ValueError when a run is in pieces."""
        if not all((run, None) in self._cache.pieces for run in range(len(self.runs))) or self.at is None:
            raise ValueError("a long run is in pieces, which have no sensitivity in common")
        responses = tuple(self.sheet_responses(self._cache.pieces[run, None]) for run in range(len(self.runs)))
        return Known(self.sensitivities(), responses)

    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Each whole run's sensitivity; long runs' are taken now."""
        at = self.at
        if at is None:
            return ()
        return tuple(
            kept.sensitivity
            if (kept := self._cache.pieces.get((run, None))) is not None and kept.sensitivity is not None
            else Sensitivity.of(drive.recording, self.physics, at)
            for run, drive in enumerate(self.runs)
        )

    def _make(self, run: int, number: int | None, drive: PreparedRun) -> Piece:
        whole = number is None
        step = drive.recording.filters.step
        matrices: dict[Row, Array] = {row: drive.matrix(self.physics, row)[:, self.keep] for row in drive.rows}
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
        instants: dict[Row, NDArray[np.intp]] = {row: (drive.index[row] + drive.offset) // step for row in drive.rows}
        piece = Piece(run, number, self.seeds[run], drive, matrices, drive.measured, instants, zeros, sensitivity, None)
        # Motion and slopes of a part of a long run are many times as large as its equations.
        return piece if whole else piece.anew()
