"""Equations of a model on its runs, piece by piece: columns of parameters, sensor faults and each run's zeros."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import count, repeat

import numpy as np
from numpy.typing import NDArray

from lacet.daq.set_aside import ArraysOnDisk, DiskSpace
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import ColumnKey, PreparedRun, column_key
from lacet.identify.regression.sensitivity import ExpansionPoint, Input, Sensitivity, SlopesByInput
from lacet.identify.regression.sensor_offsets import PayloadSpread, Zeros, with_payload, zeros_of
from lacet.identify.regression.tolerances import SheetEntry, sheet_responses

KEPT = 4 * 3600.0
"""Pieces of long runs are kept on disk, without their full-rate motion, until they are this long together [s].

It bounds the file: a minute takes some tens of MB."""


@dataclass
class SensorResponses:
    """Responses of a piece to errors of its sensors, filtered, as far as they were computed.

    `faults` by fault and `sheet` by entry of the sensor sheet, row → (n,); `of_draws` those of the piece with simulated
    noise, by sign and seed of the draw.
    """

    faults: dict[ColumnKey, Mapping[Row, Array]] = field(default_factory=dict[ColumnKey, Mapping[Row, Array]])
    sheet: dict[SheetEntry, dict[Row, Array]] = field(default_factory=dict[SheetEntry, dict[Row, Array]])
    of_draws: dict[tuple[int, ...], SensorResponses] = field(
        default_factory=dict[tuple[int, ...], "SensorResponses"], repr=False
    )


@dataclass(frozen=True)
class Piece:
    """Equations of a run, or of one part of a long run.

    Attributes
    ----------
    run : index of the run in the fit.
    number : index of the part in a long run; None for a whole run.
    seed : number of the run in the seeds of its noise draws.
    prepared : motion and measured rows of the run or part.
    blocks : row → (n, z + p) columns: the run's zeros, the parameters kept, the model's sensor faults.
    right : row → (n,) measured left sides [N or N·m].
    instants : row → (n,) index of each sample among the run's instants after decimation.
    zeros : the run's sensor zeros; None where the equations have none.
    sensitivity : derivatives of the residual by the channels; None where none were computed.
    weights : row → (n,) square roots of the samples' weights; None where all weights are equal.
    responses : to errors of the sensors, for the channels of `prepared`.
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
    responses: SensorResponses = field(default_factory=SensorResponses, repr=False, compare=False)

    def uncached(self) -> Piece:
        """The equations without cached intermediate results: motion at full rate, interpolated slopes, columns."""
        sensitivity = None if self.sensitivity is None else self.sensitivity.uncached()
        return replace(self, prepared=self.prepared.uncached(), sensitivity=sensitivity, responses=SensorResponses())

    def noisy(self, seed: Sequence[int]) -> Iterator[Piece]:
        """The piece with a draw of noise added to all channels, and with it subtracted; what is computed is kept."""
        for sign, run in zip((1, -1), self.prepared.noisy(seed, loads=True, keep=True), strict=True):
            yield replace(
                self, prepared=run, responses=self.responses.of_draws.setdefault((sign, *seed), SensorResponses())
            )

    def fault_responses(self, faults: Sequence[SensorFault]) -> list[Mapping[Row, Array]]:
        """Changes of the residual per unit of each fault, of which there are none without sensitivities."""
        if self.sensitivity is None:
            return [{} for _ in faults]
        known, run = self.responses.faults, self.prepared
        fresh = {key: fault for fault in faults if (key := column_key(fault)) not in known}
        # Sensitivities may be another run's of the same motion; the noise in these columns must be this one's.
        sensitivity = self.sensitivity.on(run.recording)
        known |= zip(fresh, run.decimated_each(map(sensitivity.fault, fresh.values())), strict=True)
        return [known[column_key(fault)] for fault in faults]


@dataclass(frozen=True)
class MotionResponses:
    """Responses of the runs' residuals that depend on the motion and not on a run's noise.

    Runs that repeat the motions with other noise share them.

    Attributes
    ----------
    sensitivities : for each run, the derivatives of its residual by its channels.
    responses : for each run, entry of the sensor sheet → row → (n,) change of the residual for one tolerance.
    """

    sensitivities: tuple[Sensitivity, ...]
    responses: tuple[dict[SheetEntry, dict[Row, Array]], ...]


@dataclass(frozen=True)
class _PutAside:
    """A part of a long run whose arrays are on disk.

    `piece` is what remains of it in memory; `blocks`, `right` and `zeros` row → columns, left sides and columns of the
    zeros; `slopes` (input, row) → derivatives of the residual.
    """

    piece: Piece
    blocks: ArraysOnDisk[Row]
    right: ArraysOnDisk[Row]
    zeros: ArraysOnDisk[Row]
    slopes: ArraysOnDisk[tuple[Input, Row]]

    @classmethod
    def of(cls, piece: Piece, space: DiskSpace) -> _PutAside:
        zeros, sensitivity = piece.zeros, piece.sensitivity
        coarse: SlopesByInput = {} if sensitivity is None else sensitivity.taken.coarse
        remaining = replace(
            piece, blocks={}, right={}, zeros=zeros and replace(zeros, columns={}),
            sensitivity=sensitivity and replace(sensitivity, taken=replace(sensitivity.taken, coarse={})),
        )  # fmt: skip
        columns: Mapping[Row, Array] = {} if zeros is None else zeros.columns
        return cls(
            remaining, space.put(piece.blocks), space.put(piece.right), space.put(columns),
            space.put({(key, row): slope for key, rows in coarse.items() for row, slope in rows.items()}),
        )  # fmt: skip

    def read(self) -> Piece:
        """The piece, its arrays read again."""
        zeros, sensitivity = self.piece.zeros, self.piece.sensitivity
        coarse: dict[Input, dict[Row, Array]] = {}
        if sensitivity is not None:
            for (key, row), slope in self.slopes.items():
                coarse.setdefault(key, {})[row] = slope
        return replace(
            self.piece, blocks=dict(self.blocks), right=dict(self.right),
            zeros=zeros and replace(zeros, columns=dict(self.zeros)),
            sensitivity=sensitivity and replace(sensitivity, taken=replace(sensitivity.taken, coarse=coarse)),
        )  # fmt: skip


@dataclass
class _PieceCache:
    """Cache of pieces and of their responses to the sensor sheet, shared by assemblies that differ in weights only.

    `pieces` by run; `parts` of long runs by run and number, in the `space` on disk, `long` their duration together [s];
    `responses` to the sheet's entries by run; `own` those with the noise of the run itself, `own_of_part` those of
    parts of long runs, on disk.
    """

    pieces: dict[int, Piece] = field(default_factory=dict[int, Piece])
    parts: dict[tuple[int, int], _PutAside] = field(default_factory=dict[tuple[int, int], _PutAside])
    space: DiskSpace = field(default_factory=DiskSpace)
    responses: dict[int, dict[SheetEntry, dict[Row, Array]]] = field(
        default_factory=dict[int, dict[SheetEntry, dict[Row, Array]]]
    )
    own: dict[int, dict[SheetEntry, dict[Row, Array]]] = field(
        default_factory=dict[int, dict[SheetEntry, dict[Row, Array]]]
    )
    own_of_part: dict[tuple[int, int], ArraysOnDisk[tuple[SheetEntry, Row]]] = field(
        default_factory=dict[tuple[int, int], ArraysOnDisk[tuple[SheetEntry, Row]]]
    )
    long: float = 0.0


class Assembly:
    """Equations of all runs in pieces; those of very long runs are computed again each time they are read.

    Parameters
    ----------
    physics : the model's effects; `keep` indices of their parameters that have columns of their own.
    faults : sensor faults in the model.
    runs : the runs.
    at : where sensitivities are computed; None for equations without sensor zeros and faults.
    zeros : whether each run has sensor zeros as parameters.
    shared : responses from other runs of the same motions, none of them in pieces; None to compute them.
    seeds : number of each run in the seeds of its noise draws; by default its index.
    payload : 1 σ of the runs' payloads; each run then has its own, beside its zeros; None for no payloads.
    """

    def __init__(
        self, physics: Sequence[PhysicalEffect], keep: NDArray[np.int64], faults: Sequence[SensorFault],
        runs: Sequence[PreparedRun], at: ExpansionPoint | None, zeros: bool, shared: MotionResponses | None = None,
        seeds: Sequence[int] = (), payload: PayloadSpread | None = None,
    ):  # fmt: skip
        self.physics, self.keep, self.faults = tuple(physics), keep, tuple(faults)
        self.runs, self.at, self.zeros = tuple(runs), at, zeros
        self.shared, self.payload = shared, payload
        self.seeds = tuple(seeds) or tuple(range(len(self.runs)))
        self.weights: Mapping[tuple[int, int | None], Mapping[Row, Array]] = {}
        self._cache = _PieceCache()

    def weighted(self, weights: Mapping[tuple[int, int | None], Mapping[Row, Array]]) -> Assembly:
        """The equations with these weights of the samples: (run, piece) → row → (n,) square roots of the weights."""
        out = copy(self)
        out.weights = weights
        return out

    def pieces(self) -> Iterator[Piece]:
        """Every piece of every run, in order."""
        for run in range(len(self.runs)):
            yield from self.pieces_of(run)

    def pieces_of(self, run: int) -> Iterator[Piece]:
        """Every piece of one run, in order; memory of a part of a long run is released with its piece."""
        return map(self._piece, repeat(run), self.runs[run].pieces(), count())

    def _piece(self, run: int, part: PreparedRun, number: int) -> Piece:
        """A run or a part of it with its equations, from the cache or computed."""
        place = run, None if part is self.runs[run] else number
        piece = self._cached(place)
        if piece is None:
            piece = self.made(*place, part)
            self._keep(piece)
        if piece.number is not None:
            piece = piece.uncached()
        weights = self.weights.get(place)
        return piece if weights is None else replace(piece, weights=weights)

    def _cached(self, place: tuple[int, int | None]) -> Piece | None:
        run, number = place
        if number is None:
            return self._cache.pieces.get(run)
        part = self._cache.parts.get((run, number))
        return None if part is None else part.read()

    def _keep(self, piece: Piece) -> None:
        if piece.number is None:
            self._cache.pieces[piece.run] = piece
            return
        self._cache.long += float(np.ptp(piece.prepared.recording.t))
        if self._cache.long <= KEPT:
            self._cache.parts[piece.run, piece.number] = _PutAside.of(piece, self._cache.space)

    def sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """Responses of a piece to one tolerance of each gain and latency of the sensor sheet: entry → row → (n,)."""
        if self.shared:
            return self.shared.responses[piece.run]
        assert piece.sensitivity is not None
        if piece.number is not None:
            return sheet_responses(piece.prepared, piece.sensitivity)
        if piece.run not in self._cache.responses:
            self._cache.responses[piece.run] = sheet_responses(piece.prepared, piece.sensitivity)
        return self._cache.responses[piece.run]

    def own_sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """Responses to the sensor sheet computed from the run's own channels, where sensitivities are shared ones."""
        if self.shared is None and piece.number is None:
            return self.sheet_responses(piece)
        assert piece.sensitivity is not None
        place = None if piece.number is None else (piece.run, piece.number)
        if place in self._cache.own_of_part:
            found: dict[SheetEntry, dict[Row, Array]] = {}
            for (entry, row), series in self._cache.own_of_part[place].items():
                found.setdefault(entry, {})[row] = series
            return found
        if place is None and piece.run in self._cache.own:
            return self._cache.own[piece.run]
        found = sheet_responses(piece.prepared, piece.sensitivity.on(piece.prepared.recording))
        if place is None:
            self._cache.own[piece.run] = found
        elif place in self._cache.parts:
            by_row = {(entry, row): series for entry, rows in found.items() for row, series in rows.items()}
            self._cache.own_of_part[place] = self._cache.space.put(by_row)
        return found

    def noisy_sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """Responses to the sensor sheet of a piece with simulated noise (`Piece.noisy`).

        Sensitivities shared with other runs hold those runs' noise in the assumptions' columns, and none of this one's.
        """
        known, recording = piece.responses.sheet, piece.prepared.recording
        if not known and piece.sensitivity is not None:
            own = (
                piece.sensitivity.on(recording)
                if self.shared or self.at is None
                else piece.sensitivity.noisy(recording, self.physics, self.at.values)
            )
            known |= sheet_responses(piece.prepared, own)
        return known

    def motion_responses(self) -> MotionResponses:
        """Responses for runs of the same motions with other noise. Raises ValueError for a long run in pieces."""
        if not all(run in self._cache.pieces for run in range(len(self.runs))) or self.at is None:
            raise ValueError("a long run is in pieces, which have no sensitivity in common")
        responses = tuple(self.sheet_responses(self._cache.pieces[run]) for run in range(len(self.runs)))
        return MotionResponses(self.sensitivities(), responses)

    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Sensitivities of the runs, each run in one; those of long runs are computed at each call."""
        at = self.at
        if at is None:
            return ()
        return tuple(
            kept.sensitivity
            if (kept := self._cache.pieces.get(run)) is not None and kept.sensitivity is not None
            else Sensitivity.of(drive.recording, self.physics, at.values, at.spacing)
            for run, drive in enumerate(self.runs)
        )

    def made(self, run: int, number: int | None, drive: PreparedRun) -> Piece:
        whole = number is None
        step = drive.recording.filters.step
        matrices: dict[Row, Array] = {row: drive.matrix(self.physics, row)[:, self.keep] for row in drive.rows}
        sensitivity, zeros = None, None
        if self.at is not None:
            shared = self.shared.sensitivities[run] if self.shared and whole else None
            sensitivity = shared or Sensitivity.of(drive.recording, self.physics, self.at.values, self.at.spacing)
            faults = [drive.decimated(sensitivity.fault(fault)) for fault in self.faults]
            for row, W in matrices.items():
                matrices[row] = np.column_stack([W, *(found.get(row, np.zeros(len(W))) for found in faults)])
            if self.zeros:
                zeros = zeros_of(drive, sensitivity, every=not whole)
        if self.payload is not None:
            zeros = with_payload(zeros, drive, self.payload)
        if zeros is not None:
            matrices = {row: np.column_stack([zeros.columns[row], W]) for row, W in matrices.items()}
        instants: dict[Row, NDArray[np.intp]] = {row: (drive.index[row] + drive.offset) // step for row in drive.rows}
        piece = Piece(run, number, self.seeds[run], drive, matrices, drive.measured, instants, zeros, sensitivity, None)
        # Motion and slopes of a part of a long run are many times as large as its equations.
        return piece if whole else piece.uncached()
