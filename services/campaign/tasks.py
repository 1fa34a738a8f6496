"""Tasks of a campaign: pure functions of a run's reference and plain values, and of sums of runs.

Whatever worker does a task, and however often, its result has the same bits: noise is drawn with the run's content as
seed, and mathematics runs on one thread. A run that cannot be used gives a `Broken` in place of its sums, and what is
merged with it is broken as well: the campaign names it and goes on without it.
"""

from __future__ import annotations

import hashlib
import json
import traceback
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import LacetError
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import silent
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.model import Model
from lacet.identify.regression.qr_accumulation import RunEquations, squares_at
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.sums.prepared_runs import PreparedEquations, PreparedRuns
from lacet.identify.regression.uncertainty import Spread, spread_of
from lacet.identify.validation.score import compare_values
from lacet.services.cache.keys import key_of, service_sources
from lacet.services.cache.records import to_record
from lacet.services.cache.store import Store
from lacet.services.campaign.run_reference import ReadRun, RunReference, Settings, read_run
from lacet.services.one_thread import one_thread
from lacet.services.workspace.results import scores

T = TypeVar("T")

MOST_BYTES = 100_000_000
"""Size of one run's kept sums above which the oldest are removed [bytes]; a fit of 75 parameters keeps 5 MB."""
KEPT_RUNS = 2
"""Runs whose equations a worker keeps from one pass to the next: a straight line of time over runs costs no more."""


@dataclass(frozen=True)
class Broken:
    """Runs that cannot be used: name → reason."""

    runs: Mapping[str, str]


# -- states: what a pass asks of every run, with the values it asks it at ----------------------------------------------


class State(Protocol):
    """What a pass asks of every run, with the values it asks it at: a data class of plain values and arrays."""

    @property
    def room(self) -> str:
        """The room of `lacet.identify` whose sources the sums depend on."""
        ...

    def sums(self, run: SingleRun) -> Any:
        """The sums of one run."""
        ...


@dataclass(frozen=True)
class Survey:
    """What a campaign has to know of a run before it begins.

    Attributes
    ----------
    reference : with the digest of the content.
    vehicle, rig : texts of the files that hold for the run; `rig_name` name of the rig.
    wheel_reference : ``contact`` or ``hub``.
    seconds : length of the run [s].
    warnings : about the run, one line each.
    sound : whether no channel of it is in doubt.
    """

    reference: RunReference
    vehicle: str
    rig: str
    rig_name: str
    wheel_reference: str
    seconds: float
    warnings: tuple[str, ...]
    sound: bool


@dataclass(frozen=True)
class ColumnsAt:
    """Equations in every parameter of the physics, without zeros; sensor faults removed at sizes `removed`."""

    removed: Array

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "regression"

    def sums(self, run: SingleRun) -> RunEquations:
        """The equations."""
        found = run.without_faults(self.removed).columns()
        assert found is not None
        return found


@dataclass(frozen=True)
class Turn:
    """One turn of robust weights: from the residual at `x` with rows weighted by `sigma`, `usual` the rows' medians."""

    x: Array
    sigma: Mapping[Row, float]
    usual: Mapping[Row, float]


@dataclass(frozen=True)
class EquationsAt:
    """Equations with the sensitivities at one set of parameters.

    Attributes
    ----------
    keep, at, known, rows : as `RunSums.linearised` takes them.
    removed : sizes of the sensor faults removed.
    turns : robust weights so far.
    """

    keep: NDArray[np.int64]
    at: ExpansionPoint | None
    known: Array
    rows: tuple[Row, ...]
    removed: Array
    turns: tuple[Turn, ...] = ()

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "regression"

    def linearised(self, run: SingleRun) -> PreparedEquations:
        """The run's equations and its samples, as the worker keeps them for the next pass."""
        return run.kept(self, lambda: self._made(run))

    def _made(self, run: SingleRun) -> PreparedEquations:
        out = run.without_faults(self.removed).linearised(self.keep, self.at, self.known, self.rows)
        for turn in self.turns:
            out = out.with_weights(out.second_sizes(turn.x, turn.sigma), turn.usual)
        return out

    def sums(self, run: SingleRun) -> RunEquations:
        """The equations."""
        return self.linearised(run).equations.runs[0]


@dataclass(frozen=True)
class SecondsAt:
    """RMS of the residual second by second, for robust weights."""

    where: EquationsAt
    x: Array
    sigma: Mapping[Row, float]

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "regression"

    def sums(self, run: SingleRun) -> dict[Row, Array]:
        """Row → (s,) of its seconds."""
        return self.where.linearised(run).second_sizes(self.x, self.sigma).by_row()


@dataclass(frozen=True)
class NoiseAt:
    """What noise in the regressors does, at these weights of the rows; `draws` pairs are drawn."""

    where: EquationsAt
    sigma: Mapping[Row, float]
    draws: int

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "regression"

    def sums(self, run: SingleRun) -> NoiseMoments:
        """The moments."""
        return self.where.linearised(run).noise_moments(self.sigma, self.draws, silent)


@dataclass(frozen=True)
class SpreadAt:
    """Spread of the scores at the solution `x`."""

    where: EquationsAt
    sigma: Mapping[Row, float]
    x: Array

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "regression"

    def sums(self, run: SingleRun) -> Spread:
        """The spread."""
        found = self.where.linearised(run)
        zeros = found.equations.zeros(self.x, self.sigma)
        sheet = self.where.at is not None
        return spread_of(found.assembly, found.equations, self.x, zeros, self.sigma, sheet)[0]


RunScores = dict[str, dict[str, dict[str, Any]]]
"""Run → row → score of a row as plain data (docs/json.md)."""


@dataclass(frozen=True)
class ScoresAt:
    """Scores of a run against its noise floor at these parameters of the physics (p,), sensor faults removed.

    `at` : where the floor's sensitivities are computed, as by `validation.score.compare`; None for `physics`.
    """

    physics: Array
    at: ExpansionPoint | None
    removed: Array
    draws: int

    @property
    def room(self) -> str:
        """The room that makes the sums."""
        return "validation"

    def sums(self, run: SingleRun) -> RunScores:
        """Run → row → score, as plain data; the floor's noise is drawn with the run's content as seed."""
        (prepared,) = run.without_faults(self.removed).runs
        physics, at = run.model.physics, self.at or ExpansionPoint(self.physics)
        part = compare_values(
            physics, self.physics, prepared, self.draws, run.reference.seed, payload=run.settings.payload,
            pieces=prepared.sensitive_pieces(physics, at.values),
        )  # fmt: skip
        return scores([part])


def joined_scores(parts: Sequence[RunScores]) -> RunScores:
    """Scores of several runs."""
    return {name: rows for part in parts for name, rows in part.items()}


def joined_seconds(parts: Sequence[Mapping[Row, Array]]) -> dict[Row, Array]:
    """Row → seconds of several runs."""
    rows = dict.fromkeys(row for part in parts for row in part)
    return {row: np.concatenate([part[row] for part in parts if row in part]) for row in rows}


def joined_counts(parts: Sequence[Mapping[Row, int]]) -> dict[Row, int]:
    """Row → number of samples of several runs."""
    rows = dict.fromkeys(row for part in parts for row in part)
    return {row: sum(part.get(row, 0) for part in parts) for row in rows}


# -- one run on a worker -----------------------------------------------------------------------------------------------


@dataclass
class SingleRun:
    """One run on a worker, read when a state asks for its samples."""

    reference: RunReference
    settings: Settings
    _read: ReadRun | None = field(default=None, repr=False)
    _model: Model | None = field(default=None, repr=False)

    @property
    def model(self) -> Model:
        """The campaign's model."""
        if self._model is None:
            self._model = self.settings.model()
        return self._model

    def read(self) -> ReadRun:
        """The run."""
        if self._read is None:
            self._read = read_run(self.reference, self.settings)
        return self._read

    def without_faults(self, removed: Array) -> PreparedRuns:
        """The run, the model's sensor faults removed at these sizes, as a fit asks for sums."""
        runs = PreparedRuns(
            self.model,
            (self.read().prepared,),
            self.settings.zeros,
            seeds=(self.reference.seed,),
            payload=self.settings.payload,
        )
        return runs.without_faults(removed) if np.any(removed) else runs

    def kept(self, state: EquationsAt, make: Callable[[], PreparedEquations]) -> PreparedEquations:
        """The equations of a state, made or as this worker kept them."""
        key = digest_of(self.reference, self.settings, state)
        if key in _kept:
            _kept.move_to_end(key)
            return _kept[key]
        found = _kept[key] = make()
        while len(_kept) > KEPT_RUNS:
            _kept.popitem(last=False)
        return found


_kept: OrderedDict[str, PreparedEquations] = OrderedDict()
"""Equations of the runs that this worker had last, by what they depend on."""


def digest_of(*values: object) -> str:
    """Digest of plain values, data classes of lacet and arrays, by content."""
    out = hashlib.sha256()
    for value in values:
        record = to_record(value)
        out.update(json.dumps(record.tree, sort_keys=True).encode())
        for array in record.arrays:
            out.update(f"{array.dtype} {array.shape}".encode())
            out.update(np.ascontiguousarray(array).tobytes())
    return out.hexdigest()


# -- the tasks ---------------------------------------------------------------------------------------------------------


def survey(reference: RunReference, settings: Settings) -> Survey | Broken:
    """A run looked at: whether it can be used, of which car, with which content."""

    def found() -> Survey:
        run = read_run(reference, settings)
        recording = run.prepared.recording
        return Survey(
            run.reference, run.vehicle.text, run.rig.text, run.rig.name, recording.reference,
            float(np.ptp(recording.t)), run.warnings, run.sound,
        )  # fmt: skip

    return _or_broken(reference, found)


def reduce(reference: RunReference, settings: Settings, state: State) -> Any:
    """The sums of one run that a pass asks for: as they are kept by content, or made now; or `Broken`."""

    def found() -> Any:
        run = SingleRun(reference, settings)
        store, key = _store(reference, settings), ""
        kind = type(state).__name__
        if store is not None:
            classes = {type(effect) for effect in run.model.effects}
            plain = digest_of(
                settings.rig, settings.vehicle, settings.filters, settings.effects, settings.wheel_reference,
                settings.zeros, settings.payload, reference.name, state,
            )  # fmt: skip
            key = key_of(state.room, classes, reference.digest, plain, service_sources("campaign"))
            if (kept := store.load(kind, key)) is not None:
                return kept
        out = state.sums(run)
        if store is not None:
            store.save(kind, key, out)
        return out

    return _or_broken(reference, found)


def _store(reference: RunReference, settings: Settings) -> Store | None:
    """Where the sums of a run are kept: a folder for each run, so that none has many files."""
    if not settings.store:
        return None
    folder = Path(settings.store) / reference.digest[:2] / reference.digest[2:32]
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return Store(folder, MOST_BYTES)


def _or_broken(reference: RunReference, compute: Callable[[], T]) -> T | Broken:
    """The result, or the run's name with the reason why there is none."""
    try:
        with one_thread():
            return compute()
    except LacetError as error:
        return Broken({reference.name: str(error)})
    except (OSError, ArithmeticError, ValueError, LookupError, TypeError, AssertionError) as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{at.name} in {Path(at.filename).name}, line {at.lineno}"
        return Broken({reference.name: f"{type(error).__name__}: {str(error) or 'no reason'} ({where})"})


def reduced_root(run: RunEquations | Broken, sigma: Mapping[Row, float]) -> Array | Broken:
    """(p + 1, p + 1) R factor of a run's weighted equations, its zeros eliminated."""
    with one_thread():
        return run if isinstance(run, Broken) else run.reduced(sigma)[1]


def reduced_normal(run: RunEquations | Broken, sigma: Mapping[Row, float]) -> Array | Broken:
    """(p + 1, p + 1) normal matrix of the same."""
    with one_thread():
        return run if isinstance(run, Broken) else run.reduced_normal(sigma)[0]


def row_squares(
    run: RunEquations | Broken, sigma: Mapping[Row, float], x: Array, quick: bool
) -> dict[Row, float] | Broken:
    """Row → sum of squares of a run at parameters `x` and the zeros that belong to them."""
    with one_thread():
        return run if isinstance(run, Broken) else squares_at(run, x, sigma, quick)


def row_counts(run: RunEquations | Broken) -> dict[Row, int] | Broken:
    """Row → number of samples of a run."""
    return run if isinstance(run, Broken) else dict(run.counts)


def merge(parts: Sequence[T | Broken], how: Callable[[Sequence[T]], T]) -> T | Broken:
    """Parts merged, or all that is broken among them."""
    broken = {name: why for part in parts if isinstance(part, Broken) for name, why in part.runs.items()}
    if broken:
        return Broken(broken)
    with one_thread():
        return how([part for part in parts if not isinstance(part, Broken)])
