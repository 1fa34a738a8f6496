"""One run ready for fitting: its motion, and every effect's columns after the parallel filter and decimation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.set_aside import DiskSpace, JoinedOnDisk
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.measured_rows import MeasuredRows
from lacet.identify.car.motion import GroundLaserOffset, Motion
from lacet.identify.car.outline import Outline
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.car.sources.completion import completed
from lacet.identify.effects.base import Effect, PhysicalEffect, sum_by_row
from lacet.identify.effects.user_files import checked_columns, is_own
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.signals.decimation import comb, decimated
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals, bring_together

PIECE = 60.0
"""Longer runs are worked on in pieces of about this length [s]: memory does not grow with their full-rate motion."""
OVERVIEW = 50.0
"""Least rate of the overview of a long run [Hz]: above twice the pre-filter's usual cut-off."""
_TOGETHER = 120_000
"""Samples of the series that are filtered together: so many stay in the cache."""


ColumnKey = tuple[str, tuple[tuple[str, float], ...]]
"""Key and shape constants of an effect: what its columns on a run depend on."""


@dataclass(frozen=True)
class Unmeasured:
    """Absence from a run of what an effect needs.

    Attributes
    ----------
    run : name of the run.
    needs : channels that it does not have; the offset of its ground lasers for effects of the road under the wheels.
    """

    run: str
    needs: tuple[str | GroundLaserOffset, ...]


@dataclass(frozen=True)
class NoisyColumns:
    """Columns of effects, and left sides row → (n,), of a run with one draw of simulated noise in its channels.

    `given` : columns of effects that are expectations, given the record without the draw: the draw is in their linear
    part alone.
    """

    columns: Mapping[ColumnKey, Mapping[Row, Array]]
    given: Mapping[ColumnKey, Mapping[Row, Array]]
    measured: Mapping[Row, Array]

    def acting(
        self, placed: Iterable[tuple[PhysicalEffect, slice]], row: Row, given: bool = False
    ) -> tuple[NDArray[np.intp], Array]:
        """Indices (a,) of the parameters that act on a row, and their (n, a) columns; `placed` : effects, slices."""
        places = [np.zeros(0, np.intp)]
        columns = [np.zeros((0, len(self.measured[row])))]
        for effect, place in placed:
            found = self.of(effect, given)
            if row in found:
                places.append(np.arange(place.start, place.stop, dtype=np.intp))
                columns.append(found[row])
        return np.concatenate(places), np.concatenate(columns).T

    def of(self, effect: PhysicalEffect, given: bool = False) -> Mapping[Row, Array]:
        """Columns of an effect, row → (p, n); with `given` those with the draw in their linear part alone."""
        key = column_key(effect)
        return self.given[key] if given and key in self.given else self.columns[key]

    def extended(self, noisy: PreparedRun, effects: Sequence[PhysicalEffect], run: PreparedRun) -> NoisyColumns:
        """These columns and those of further effects on `noisy`, which has the same noise added to `run`."""
        noisy.prepare(effects)
        further = {column_key(effect): noisy.columns(effect) for effect in effects}
        expected = [effect for effect in effects if run.expects(effect)]
        given = dict[ColumnKey, Mapping[Row, Array]]()
        if expected:
            motion = noisy.motion.given(run.motion)
            found = noisy.decimated_each(checked_columns(effect, motion) for effect in expected)
            given = dict(zip(map(column_key, expected), found, strict=True))
        return NoisyColumns({**self.columns, **further}, {**self.given, **given}, self.measured or noisy.measured)


def _joined(parts: Iterable[Mapping[Row, Array]]) -> dict[Row, Array]:
    """Series (…, n) of rows, those of the pieces of a run one after the other."""
    found: dict[Row, list[Array]] = {}
    for part in parts:
        for row, series in part.items():
            found.setdefault(row, []).append(series)
    return {row: np.concatenate(series, axis=-1) for row, series in found.items()}


class PreparedRun:
    """A run ready for fitting: the motion of a recording and the columns of effects on it, cached.

    Parameters
    ----------
    recording : channels on one grid.
    offset : index of its first sample in the run that it is a piece of; 0 for a whole run.
    index : row → indices of the kept samples, where they are known already; None to compute them.
    is_piece : whether it is a piece of a longer run, which is not divided again.
    columns : columns of effects that are known already, to which those computed are added.
    """

    def __init__(
        self, recording: Recording, offset: int = 0, index: Mapping[Row, NDArray[np.intp]] | None = None,
        is_piece: bool = False, columns: dict[ColumnKey, Mapping[Row, Array]] | None = None,
    ):  # fmt: skip
        self.recording, self.offset, self._index, self._is_piece = recording, offset, index, is_piece
        self._noisy: dict[tuple[int, ...], Sequence[NoisyColumns]] = {}
        self._columns: dict[ColumnKey, Mapping[Row, Array]] = {} if columns is None else columns
        self._of_draws: dict[tuple[int, ...], dict[ColumnKey, Mapping[Row, Array]]] = {}

    @classmethod
    def of(cls, run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None = None) -> PreparedRun:
        """The prepared run of a run as recorded, its channels on one grid; what the rows lack is derived or assumed.

        Raises RunError when it is too short.
        """
        return cls(completed(bring_together(run, vehicle, rig, filters or Filters())))

    def __repr__(self) -> str:
        recording = self.recording
        return f"{type(self).__name__}({self.name!r}, {recording.t[-1] - recording.t[0]:.1f} s, {len(self.rows)} rows)"

    @property
    def name(self) -> str:
        """The run's name."""
        return self.recording.run

    @cached_property
    def motion(self) -> Motion:
        """The motion and loads at full rate: 0.7 MB a second, so that `kept_motion` serves better where it can."""
        return build_motion(self.recording, measured=self.measured_rows)

    @cached_property
    def outline(self) -> Outline:
        """The few series of the motion that checks look at, at full rate; of a longer run made by stretches."""
        recording, measured = self.recording, self.measured_rows
        count = round(recording.t.size / (PIECE * recording.filters.rate))
        if count < 2:
            return Outline.of(self.motion)
        edges = np.linspace(0, recording.t.size, count + 1).astype(int).tolist()
        stretches = [slice(first, last) for first, last in pairwise(edges)]
        return Outline.joined(
            [Outline.of(build_motion(recording.at(part), measured=measured.at(part))) for part in stretches]
        )

    @cached_property
    def kept_motion(self) -> Motion:
        """The motion and loads at the instants `comb` alone, of which `kept` gives a row's."""
        return build_motion(self.recording.at(self.comb), measured=self.measured_rows.at(self.comb))

    @cached_property
    def measured_rows(self) -> MeasuredRows:
        """The rows that the recording measures."""
        return MeasuredRows.of(self.recording)

    @cached_property
    def comb(self) -> NDArray[np.intp]:
        """Indices of the instants that decimation keeps, before what is not usable is left out."""
        # One comb for the whole run, so that all rows are decimated at the same instants.
        return comb(self.recording.t.size, self.recording.filters)

    def kept(self, row: Row) -> NDArray[np.intp]:
        """Places in `comb` of a row's samples."""
        return self.index[row] // self.recording.filters.step

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows with a measured left side and at least one usable sample."""
        return tuple(row for row in ROWS if row in self.index)

    @cached_property
    def index(self) -> Mapping[Row, NDArray[np.intp]]:
        """Row → indices of the samples kept after decimation."""
        if self._index is not None:
            return self._index
        usable = self.measured_rows.usable
        kept = {row: self.comb[usable[row][self.comb]] for row in self.measured_rows.torques}
        return {row: places for row, places in kept.items() if len(places)}

    def uncached(self) -> PreparedRun:
        """The run without cached results: motion and columns are computed again when they are needed."""
        return PreparedRun(self.recording, self.offset, self.index, self._is_piece)

    @cached_property
    def measured(self) -> dict[Row, Array]:
        """Left sides after the parallel filter, at the kept samples: row → (n,)."""
        if self.is_long:
            return _joined(part.measured for part in self.pieces())
        return self.decimated({row: self.motion.measured(row) for row in self.rows})

    def columns(self, effect: PhysicalEffect) -> Mapping[Row, Array]:
        """An effect's columns after the parallel filter, at the kept samples: row → (p, n); of a long run on disk."""
        if (key := column_key(effect)) not in self._columns:
            self.prepare([effect])
        return self._columns[key]

    def effect_columns(self, effect: Effect, sensitivity: Sensitivity | None) -> Mapping[Row, Array]:
        """Columns of a physical effect, or of a sensor fault by its `sensitivity`: row → (p, n); none without one."""
        if (physics := effect.as_physics) is not None:
            return self.columns(physics)
        if (fault := effect.as_fault) is None or sensitivity is None:
            return {}
        return {row: series[None] for row, series in self.decimated(sensitivity.fault(fault)).items()}

    def decimated(self, rows: Mapping[Row, Array]) -> dict[Row, Array]:
        """Series of rows (…, N) after the parallel filter, at the kept samples (…, n); others are absent."""
        return self.decimated_each([rows])[0]

    def decimated_each(self, found: Iterable[Mapping[Row, Array]]) -> list[dict[Row, Array]]:
        """`decimated` of each mapping, many series filtered at once, which costs hardly more than a few."""
        out: list[dict[Row, Array]] = []
        batch: list[tuple[dict[Row, Array], Row, Array]] = []
        held = 0
        for rows in found:
            out.append({})
            batch += (fresh := [(out[-1], row, series) for row, series in rows.items() if row in self.index])
            held += sum(series.size for _, _, series in fresh)
            if held >= _TOGETHER:
                self._through_filter(batch)
                batch.clear()
                held = 0
        self._through_filter(batch)
        return out

    def _through_filter(self, batch: Sequence[tuple[dict[Row, Array], Row, Array]]) -> None:
        """Filter the series of a batch together, and enter the kept samples of each in its mapping."""
        if not batch:
            return
        flat = np.concatenate([series.reshape(-1, series.shape[-1]) for _, _, series in batch])
        found = decimated(flat, self.recording.filters)
        kept = {row: self.kept(row) for row in {row for _, row, _ in batch}}
        start = 0
        for place, row, series in batch:
            stop, keep = start + series[..., 0].size, kept[row]
            place[row] = found[start:stop, keep].reshape(*series.shape[:-1], len(keep))
            start = stop

    def matrix(self, effects: Sequence[PhysicalEffect], row: Row) -> Array:
        """(n, p) observation matrix of a row, all effects side by side, zero where an effect does not act."""
        n = len(self.index[row])
        self.prepare(effects)
        parts = [
            columns[row] if row in (columns := self.columns(effect)) else np.zeros((len(effect.parameters), n))
            for effect in effects
        ]
        return np.concatenate(parts).T if parts else np.zeros((n, 0))

    def prepare(self, effects: Sequence[PhysicalEffect]) -> None:
        """Compute the columns of effects that are not in the cache, filtered together."""
        fresh = [(key, effect) for effect in effects if (key := column_key(effect)) not in self._columns]
        if not fresh:
            return
        if self.is_long:
            # All effects of a piece together, so that its motion is made once.
            space, effects = DiskSpace(), [effect for _, effect in fresh]
            parts = [[space.put(columns) for columns in part.each_column(effects)] for part in self.pieces()]
            done = [JoinedOnDisk(columns) for columns in zip(*parts, strict=True)]
            self._columns |= {key: columns for (key, _), columns in zip(fresh, done, strict=True)}
            return
        made_of = {key: [(column_key(part), part) for part in _parts(effect)] for key, effect in fresh}
        missing = {key: part for some in made_of.values() for key, part in some if key not in self._columns}
        found = self.decimated_each(checked_columns(part, self.motion) for part in missing.values())
        self._columns |= zip(missing, found, strict=True)
        for key, some in made_of.items():
            self._columns[key] = sum_by_row([self._columns[part] for part, _ in some])

    def each_column(self, effects: Sequence[PhysicalEffect]) -> list[Mapping[Row, Array]]:
        """`columns` of each of the effects."""
        self.prepare(effects)
        return [self.columns(effect) for effect in effects]

    @property
    def is_long(self) -> bool:
        """Whether the run is worked on in pieces."""
        return self.piece_count > 1

    @property
    def piece_count(self) -> int:
        """Number of the pieces it is worked on in; those without a usable sample are passed over."""
        return 1 if self._is_piece else max(1, round(self.recording.t.size / (PIECE * self.recording.filters.rate)))

    def pieces(self) -> Iterator[PreparedRun]:
        """The run itself, or of a longer one equal pieces of about `PIECE` [s] that together keep just its samples.

        Each piece reaches over its ends by as much as the parallel filter sees. Pieces without a usable sample are
        left out.
        """
        for piece, _ in self.every_piece():
            if piece.index or not self.index:
                yield piece

    def every_piece(self) -> Iterator[tuple[PreparedRun, slice]]:
        """The run's pieces without exception, each with the place of its own samples in it."""
        filters, n = self.recording.filters, self.recording.t.size
        if not self.is_long:
            yield self, slice(0, n)
            return
        count, step = self.piece_count, filters.step
        margin = math.ceil(filters.memory * filters.rate / step) * step
        for start, end in pairwise([*(n * k // count // step * step for k in range(count)), n]):
            first = max(0, start - margin)
            kept = {row: index[(index >= start) & (index < end)] - first for row, index in self.index.items()}
            index = {row: places for row, places in kept.items() if len(places)}
            part = self.recording.at(slice(first, end + margin))
            yield PreparedRun(part, first, index, is_piece=True), slice(start - first, end - first)

    def sensitive_pieces(
        self, effects: Sequence[PhysicalEffect], values: Array
    ) -> Iterator[tuple[PreparedRun, Sensitivity]]:
        """The run's `pieces`, each with its sensitivity at parameter `values`."""
        for piece in self.pieces():
            yield piece, Sensitivity.of(piece.recording, effects, values)

    def filtered(self, row: Row, pick: Callable[[Motion], Array]) -> Array:
        """(…, n): series (…, N) of the motion through the parallel filter, at the samples of a row."""
        parts = (piece.decimated({row: pick(piece.motion)}) for piece in self.pieces() if row in piece.index)
        return _joined(parts)[row]

    def overview(self) -> PreparedRun:
        """The run itself, or of a long one fewer samples, at 50 Hz or more: for checks, phases and ranges."""
        step = max(1, int(self.recording.filters.rate / OVERVIEW)) if self.is_long else 1
        return self if step == 1 else PreparedRun(self.recording.thinned(step), is_piece=True)

    def noisy(self, seed: Sequence[int], loads: bool = False, keep: bool = False) -> Iterator[PreparedRun]:
        """Two copies of this run: with one draw of simulated channel noise added, and with the same draw subtracted.

        Wheel loads get noise only with `loads`: in the base model they stand on the left side only, where noise brings
        no bias. With `keep` this run keeps the columns of effects on the copies for when the draw is asked for again.
        """
        recording = self.recording
        values = recording.signals.value
        still: tuple[str, ...] = () if loads else ("wheel.force", "wheel.moment")
        moving = [name for name in values if CHANNELS[name].family not in still]
        noise = draw_noise(recording, moving, np.random.default_rng(seed))
        for sign in (1, -1):
            moved = {**values, **{name: values[name] + sign * noise[name] for name in moving}}
            noisy = recording.with_signals(Signals.differentiated(moved, recording.filters.rate))
            columns = self._of_draws.setdefault((sign, loads, *seed), {}) if keep else None
            yield PreparedRun(noisy, self.offset, self.index, self._is_piece, columns)

    def noisy_columns(self, effects: Sequence[PhysicalEffect], seed: Sequence[int]) -> Sequence[NoisyColumns]:
        """Columns with a draw of noise added, and with it subtracted, wheel loads without noise; cached by `seed`."""
        known = self._noisy.get(tuple(seed), (NoisyColumns({}, {}, {}), NoisyColumns({}, {}, {})))
        fresh = [effect for effect in effects if column_key(effect) not in known[0].columns]
        if fresh or not known[0].measured:
            known = [one.extended(noisy, fresh, self) for one, noisy in zip(known, self.noisy(seed), strict=True)]
            self._noisy[tuple(seed)] = known
        return known

    def expects(self, effect: PhysicalEffect) -> bool:
        """Whether an effect's columns on this run are expectations given its noisy record."""
        return effect.conditional and bool(self.recording.smoothers)

    def lacks(self, effect: Effect) -> Unmeasured | None:
        """What an effect needs that is not measured in this run; None where it can be computed."""
        needs = effect.lacks(self.kept_motion)
        return Unmeasured(self.name, needs) if needs else None


def _parts(effect: PhysicalEffect) -> Sequence[PhysicalEffect]:
    """The `parts` of an effect; a user's law may ask where it is, and stays whole."""
    return (effect,) if is_own(type(effect)) else effect.parts()


def column_key(effect: Effect) -> ColumnKey:
    """Key and constants of an effect."""
    return effect.key, effect.constants
