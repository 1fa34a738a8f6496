"""Residual of a model by row and time, by manoeuvre phase, and as a function of a state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.manoeuvre_phases import PHASES, Phases
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.blocks import block_numbers
from lacet.identify.validation.cross_validation import FOLDS, FoldSums
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.identify.validation.projected_noise import Draws, refitted_draws
from lacet.identify.validation.residual_samples import Samples
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.smooth_regressors import ColumnMaker, Columns
from lacet.identify.validation.states import ClearStates, filtered_states, states_of

BIN = 0.5
"""Length of a time bin of the map [s]."""


@dataclass(frozen=True)
class ResidualMap:
    """Residual RMS ÷ noise floor of one run: `ratio` (rows, bins), NaN without a sample; `edges` of the bins [s]."""

    name: str
    rows: tuple[Row, ...]
    edges: Array
    ratio: Array


def residual_map(part: Comparison, bin_s: float = BIN) -> ResidualMap:
    """The residual map of one run, in units of each row's floor on this run."""
    rows = tuple(part.measured)
    start = min(float(t[0]) for t in part.t.values())
    stop = max(float(t[-1]) for t in part.t.values())
    bins = max(1, int(np.ceil((stop - start) / bin_s + 1e-9)))
    edges = np.asarray(start + bin_s * np.arange(bins + 1), float)
    field = np.full((len(rows), edges.size - 1), np.nan)
    for i, row in enumerate(rows):
        place = np.clip(((part.t[row] - start) / bin_s).astype(np.intp), 0, edges.size - 2)
        counts = np.bincount(place, minlength=edges.size - 1)
        squares = np.bincount(place, weights=part.residual(row) ** 2, minlength=edges.size - 1)
        there = counts > 0
        field[i, there] = np.sqrt(squares[there] / counts[there]) / part.scores[row].floor
    return ResidualMap(part.name, rows, edges, field)


@dataclass(frozen=True)
class InPhase:
    """Residual of a row in one manoeuvre phase over runs: `rms` [unit], its `ratio` to that of the floor, `seconds`."""

    rms: float
    ratio: float
    seconds: float


def by_phase(parts: Sequence[Comparison], phases: Sequence[Phases]) -> dict[str, dict[Row, InPhase]]:
    """Manoeuvre phase → row → residual, over runs with their phases, in the order of reports.

    The floor is that of the whole run: an excess in one phase is due to the model or the sensors' errors, not to their
    usual noise.
    """
    sums: dict[tuple[int, Row], list[float]] = {}
    for part, split in zip(parts, phases, strict=True):
        for row, t in part.t.items():
            squares = part.residual(row) ** 2
            floor, number = part.scores[row].floor, split.at(t)
            spacing = float(np.median(np.diff(t))) if t.size > 1 else 0.0
            for k in np.unique(number):
                here = number == k
                own = (float(squares[here].sum()), floor**2 * float(here.sum()), float(here.sum()), spacing)
                total = sums.setdefault((int(k), row), [0.0, 0.0, 0.0, 0.0])
                total[0] += own[0]
                total[1] += own[1]
                total[2] += own[2]
                total[3] += own[2] * spacing
    out: dict[str, dict[Row, InPhase]] = {}
    for (k, row), (squares, noise, count, seconds) in sorted(sums.items(), key=lambda item: item[0][0]):
        found = InPhase(float(np.sqrt(squares / count)), float(np.sqrt(squares / noise)), seconds)
        out.setdefault(PHASES[k], {})[row] = found
    return out


@dataclass(frozen=True)
class Conditional:
    """Conditional mean of a row's residual given a state, in bins.

    `centre` (B,) mean of the state in each bin [`unit`]; `mean` (B,) of the residual; `low`, `high` (B,) its 95 % band,
    NaN where fewer than three blocks of two seconds meet a bin; `count` (B,) samples.
    """

    state: str
    unit: str
    centre: Array
    mean: Array
    low: Array
    high: Array
    count: NDArray[np.intp]


def conditional_mean(
    state: Array, residual: Array, blocks: NDArray[np.intp], name: str = "", unit: str = "", bins: int = 14
) -> Conditional:
    """Mean of a residual in bins of a state with equal numbers of samples.

    Residuals are correlated within a block of two seconds: the 95 % band is cluster-robust, with a block's sum in a bin
    as one observation, and uses Student's t with the effective number of blocks.
    """
    edges = np.unique(np.quantile(state, np.linspace(0.0, 1.0, max(2, min(bins, state.size // 8)) + 1)))
    place = np.clip(np.searchsorted(edges, state, side="right") - 1, 0, max(0, edges.size - 2))
    number = np.unique(place, return_inverse=True)[1]
    size = int(number.max()) + 1
    count = np.bincount(number, minlength=size)
    centre = np.bincount(number, weights=state) / count
    mean = np.bincount(number, weights=residual) / count
    block = np.unique(blocks, return_inverse=True)[1]
    cell = number * (int(block.max()) + 1) + block
    shape = (size, int(block.max()) + 1)
    sums = np.bincount(cell, weights=residual - mean[number], minlength=shape[0] * shape[1]).reshape(shape)
    met = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    weights = met / count[:, None]
    effective = 1.0 / np.sum(weights**2, axis=1)
    # A block's deviation shrinks with its own share in the mean: divided by 1 − share (CR3, as in a jackknife).
    lever = sums / np.maximum(1.0 - weights, 0.25)
    spread = np.sqrt(np.sum(lever**2, axis=1)) / count
    enough = (np.count_nonzero(met, axis=1) >= 3) & (effective > 2.0)
    t = np.full(size, np.nan)
    t[enough] = scipy.special.stdtrit(effective[enough] - 1.0, 0.975)
    return Conditional(name, unit, centre, mean, mean - t * spread, mean + t * spread, count)


@dataclass(frozen=True)
class Follows:
    """Dependence of a row's residual on one state.

    `part` of its squares that a smooth function of this state predicts, cross-validated in blocks, beside the model's
    own lines (springs, dampers, masses), which a fit that lacks an effect has biased. `p` family-wise over the states
    of the row; `rms` of the part predicted [`row_unit`].
    """

    state: str
    unit: str
    near: int
    part: float
    p: float
    rms: float
    row_unit: str


def followed_states(
    fitted: Fit, floor: NoiseFloor, rows: Sequence[Row] | None = None, clear: ClearStates | None = None,
    draws: Draws | None = None, progress: Progress = silent,
) -> dict[Row, list[Follows]]:  # fmt: skip
    """For each row, its states, in descending order of the part of the residual that each predicts.

    `clear`, `draws` : those of this fit where they are computed already (`validation.states`,
    `validation.projected_noise`). Rows too short for cross-validation are left out. `progress` receives the number of
    rows done.
    """
    clear = clear or ClearStates(fitted.runs)
    draws = draws or refitted_draws(fitted, floor)
    maker = ColumnMaker(clear, history=False)
    out: dict[Row, list[Follows]] = {}
    wanted = rows or fitted.rows
    for done, row in enumerate(wanted):
        progress(Step(Stage.STATES_FOLLOWED, done, len(wanted)))
        names = clear.names(row)
        having = [i for i, run in enumerate(fitted.runs) if row in run.index]
        blocks = block_numbers(fitted.runs, row) if having else np.zeros(0, np.intp)
        if not names or np.unique(blocks).size < 2 * FOLDS:
            continue
        residual = np.concatenate([fitted.residual[i][row] for i in having])
        columns = maker.columns(row, names)
        sums = FoldSums.of(Samples.of(fitted, draws, [row], columns))
        squares = [sums.ridges(_beside(columns, k)).squares for k in range(len(names))]
        parts = [1.0 - least.min(axis=0) / least[0] for least in squares]
        largest = np.max([part[1:] for part in parts], axis=0)
        rms = float(np.sqrt(np.mean(residual**2)))
        states = states_of(fitted.runs[having[0]].kept_motion, row)
        found = [
            Follows(
                name, states[name].unit, states[name].near, float(part[0]),
                float((1 + np.count_nonzero(largest >= part[0])) / (1 + largest.size)),
                rms * float(np.sqrt(max(0.0, float(part[0])))), row.unit,
            )
            for name, part in zip(names, parts, strict=True)
        ]  # fmt: skip
        out[row] = sorted(found, key=lambda f: -f.part)
    return out


def _beside(columns: Columns, k: int) -> NDArray[np.intp]:
    """Places of the columns of the model's own lines, then of the smooth functions of a state."""
    own = np.flatnonzero(columns.of == k)
    return np.concatenate([columns.lines[~np.isin(columns.lines, own)], own])


@dataclass(frozen=True)
class Against:
    """A row's residual and a state at the same instants, all runs together.

    `values` (n,) of the state [`mean.unit`]; `residual` (n,) [`row_unit`]; `mean` its conditional mean. Where
    `put_back`, the part of the dependence that the model's own springs, dampers and masses absorbed is added to the
    residual again.
    """

    row: Row
    row_unit: str
    values: Array
    residual: Array
    mean: Conditional
    put_back: bool


def against_states(
    runs: Sequence[PreparedRun], residual: Sequence[Mapping[Row, Array]], row: Row, names: Sequence[str] | None = None,
    clear: ClearStates | None = None,
) -> dict[str, Against]:  # fmt: skip
    """State → the residual of a row against it.

    By default every state of the row, those included that its left side is computed from: such a plot proves nothing.
    With `clear`, the dependence that the model absorbed is added again where the state has little enough noise.
    """
    having = [i for i, run in enumerate(runs) if row in run.index and row in residual[i]]
    each = [states_of(runs[i].kept_motion, row) for i in having]
    if not each:
        return {}
    shared = [name for name in each[0] if all(name in other for other in each)]
    measured = np.concatenate([residual[i][row] for i in having])
    blocks = block_numbers([runs[i] for i in having], row)
    clean = clear.names(row) if clear else ()
    wanted = shared if names is None else [name for name in names if name in shared]
    restored = dict[str, Array]()
    if clear and (again := [name for name in wanted if name in clean]):
        columns = ColumnMaker(clear, history=False).columns(row, clean)
        restored = dict(zip(again, _put_back(measured, columns, [clean.index(name) for name in again]), strict=True))
    series = [filtered_states(runs[i], row, wanted) for i in having]
    out: dict[str, Against] = {}
    for name in wanted:
        values = np.concatenate([found[name] for found in series])
        shown = restored.get(name, measured)
        mean = conditional_mean(values, shown, blocks, name, each[0][name].unit)
        out[name] = Against(row, row.unit, values, shown, mean, name in restored)
    return out


def _put_back(residual: Array, columns: Columns, states: Sequence[int]) -> Iterator[Array]:
    """For each state the residual without the change of the model's own lines that its smooth functions bring about."""
    m = columns.stored.size
    gram, moments, begin = np.zeros((m, m)), np.zeros(m), 0
    for A in columns.stretches():
        gram += A.T @ A
        moments += A.T @ residual[begin : (begin := begin + len(A))]
    for k in states:
        places = _beside(columns, k)
        lines = int(np.count_nonzero(columns.of[places] != k))
        ridge = 1e-4 * residual.size * np.eye(places.size)
        x = np.linalg.solve(gram[np.ix_(places, places)] + ridge, moments[places])
        yield residual - np.concatenate([A @ x[:lines] for A in columns.stretches(places[:lines])])
