"""Cross products of the columns of model, sensor sheet and all candidates, and of the measured rows.

All tests of a candidate follow from such sums of products: its columns without the part that the model explains, the
fall of the weighted squares, and that fall in parts of the runs that were not fitted to. So one pass over the samples
serves every candidate. Each run's zeros are eliminated in its sums; the model's columns are first made nearly
orthonormal, so that the sums lose few digits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor


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


def sensor_columns(
    fitted: Fit, layout: Layout, piece: Piece, noisy: Piece | None = None
) -> dict[Row, list[tuple[slice, Array]]]:
    """Columns of the sheet's entries and sensor faults on a piece, or on `noisy`: row → places and (p, n) columns."""
    out: dict[Row, list[tuple[slice, Array]]] = {row: [] for row in piece.blocks}
    faults = [(t.place, fault) for t in layout.trials if (fault := t.effect.as_fault) is not None]
    if piece.sensitivity is None or not (faults or layout.sheet):
        return out
    # Sensitivities may be another run's of the same motion; the noise in these columns must be this one's.
    run = (noisy or piece).prepared
    sensitivity = piece.sensitivity.on(run.recording)
    assembly = fitted.assembly
    responses = assembly.noisy_sheet_responses(noisy, sensitivity) if noisy else assembly.own_sheet_responses(piece)
    for place, entry in enumerate(layout.sheet, start=layout.model):
        for row, series in responses.get(entry, {}).items():
            if row in out and np.any(series):
                out[row].append((slice(place, place + 1), series[None]))
    found = run.decimated_each(sensitivity.fault(fault) for _, fault in faults)
    for (place, _), response in zip(faults, found, strict=True):
        for row, series in response.items():
            if row in out and np.any(series):
                out[row].append((place, series[None]))
    return out


@dataclass(frozen=True)
class Block:
    """Weighted samples of one row of one run.

    Attributes
    ----------
    run, row : index of the run, and the row.
    zeros : (n, z) columns of the run's sensor zeros, for 1 σ of their priors.
    columns : (n, a) the columns that act on the row, at places `active` of the layout.
    number : (n,) number of each sample's block of `block_seconds`, counted over all runs.
    draws : (d, n) simulated noise of the row; `choice` (D,) which of them are the D simulated runs'.
    """

    run: int
    row: Row
    zeros: Array
    columns: Array
    active: NDArray[np.intp]
    number: NDArray[np.intp]
    draws: Array
    choice: NDArray[np.intp]


@dataclass(frozen=True)
class RunProducts:
    """Sums of products of one run's columns, the columns of its z sensor zeros first.

    Attributes
    ----------
    zeros : z, the number of its sensor zeros.
    inside : (folds, z + w, z + w) products over the samples inside each fold.
    by_row : row → (z + w, z + w) products over the row's samples.
    noise : row → (z + w, D) products with the row's simulated noise; `noise_squares` (D,) its squares.
    """

    zeros: int
    inside: Array
    by_row: Mapping[Row, Array]
    noise: Mapping[Row, Array]
    noise_squares: Mapping[Row, Array]

    @classmethod
    def of(cls, blocks: Sequence[Block], z: int, w: int, draws: int) -> RunProducts:
        """Products of a run's samples: of `z` zeros and `w` columns, with `draws` simulated runs."""
        inside = np.zeros((SELECTION.folds, z + w, z + w))
        by_row = {block.row: np.zeros((z + w, z + w)) for block in blocks}
        noise = {row: np.zeros((z + w, draws)) for row in by_row}
        squares = {row: np.zeros(draws) for row in by_row}
        for block in blocks:
            both = np.concatenate([block.zeros, block.columns], axis=1)
            place = np.concatenate([np.arange(z), z + block.active])
            for fold in range(SELECTION.folds):
                part = both[block.number % SELECTION.folds == fold]
                products = part.T @ part
                inside[fold][np.ix_(place, place)] += products
                by_row[block.row][np.ix_(place, place)] += products
            noise[block.row][place] += (both.T @ block.draws.T)[:, block.choice]
            squares[block.row] += np.sum(block.draws**2, axis=1)[block.choice]
        return cls(z, inside, by_row, noise, squares)

    @cached_property
    def whole(self) -> Array:
        """(z + w, z + w) products over all samples."""
        return self.inside.sum(axis=0)

    @cached_property
    def eliminated(self) -> tuple[Array, Array]:
        """(z, w) regression of each column on the zeros, and (w, w) products of its remainders."""
        return without_zeros(self.whole, self.zeros)

    def fold(self, fold: int) -> tuple[Array, Array]:
        """(w, w) products of the samples outside a fold, and of those inside it at the zeros found outside."""
        gain, outside = without_zeros(self.whole - self.inside[fold], self.zeros)
        return outside, at_zeros(self.inside[fold], gain)

    def remaining(self, products: Array) -> Array:
        """(w, D) products of the columns less their regression on the zeros, from those of all columns (z + w, D)."""
        return products[self.zeros :] - self.eliminated[0].T @ products[: self.zeros]

    def with_drawn_zeros(self, drawn: Array) -> Array:
        """(w, D) products of the columns, less their regression on the zeros, with simulated zeros (z, D)."""
        z, whole = self.zeros, self.whole
        return whole[z:, :z] @ drawn - self.eliminated[0].T @ (whole[:z, :z] @ drawn)

    @property
    def noise_zeros(self) -> Array:
        """(z, D) regression of the simulated noise on the zeros."""
        z = self.zeros
        pushed = np.sum([products[:z] for products in self.noise.values()], axis=0)
        return np.asarray(np.linalg.solve(self.whole[:z, :z] + np.eye(z), pushed), float)

    def row(self, row: Row) -> RowProducts:
        """Products over one row's samples, less the regression of columns and simulated noise on the zeros."""
        z, gain, drawn = self.zeros, self.eliminated[0], self.noise_zeros
        normal, noise = self.by_row[row], self.noise[row]
        remaining = noise - normal[:, :z] @ drawn
        squares = self.noise_squares[row] - np.einsum("zd,zd->d", drawn, noise[:z] + remaining[:z])
        return RowProducts(at_zeros(normal, gain), remaining[z:] - gain.T @ remaining[:z], squares)


@dataclass(frozen=True)
class RowProducts:
    """Sums of products over the samples of one row, every run's zeros eliminated.

    Attributes
    ----------
    columns : (w, w) products of the columns.
    noise : (w, D) products with the simulated noise; `squares` (D,) its squares.
    """

    columns: Array
    noise: Array
    squares: Array

    def __add__(self, other: RowProducts) -> RowProducts:
        return RowProducts(self.columns + other.columns, self.noise + other.noise, self.squares + other.squares)

    def squares_of(self, coefficients: Array) -> Array:
        """(k,) sums of squares of the columns · coefficients (w, k)."""
        used = self._used
        return np.einsum("wk,wk->k", coefficients[used], self.columns[np.ix_(used, used)] @ coefficients[used])

    def squares_with_noise(self, coefficients: Array) -> Array:
        """(D,) sums of squares of the simulated noise plus columns · coefficients (w, D)."""
        across = np.einsum("wd,wd->d", self.noise, coefficients)
        return self.squares + 2.0 * across + self.squares_of(coefficients)

    @property
    def _used(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diag(self.columns))


@dataclass
class _Sums:
    """Sums over the runs added so far; attributes as in `CrossProducts`."""

    total: Array
    train: Array
    test: Array
    null: dict[Row, Array]
    null_sheet: Array
    rows: dict[Row, RowProducts]

    @classmethod
    def zero(cls, w: int, rows: Iterable[Row], draws: int) -> _Sums:
        """The sums over no run, of `w` columns and `draws` simulated runs."""
        train, test = np.zeros((2, SELECTION.folds, w, w))
        null = {row: np.zeros((w, draws)) for row in rows}
        return cls(np.zeros((w, w)), train, test, null, np.zeros((w, draws)), {})

    def add(self, products: RunProducts) -> None:
        """Add the products of a run: of all its samples, of its folds, and with its simulated noise."""
        self.total += products.eliminated[1]
        for fold in range(SELECTION.folds):
            outside, inside = products.fold(fold)
            self.train[fold] += outside
            self.test[fold] += inside
        for row, noise in products.noise.items():
            self.null[row] += products.remaining(noise)
            found = products.row(row)
            self.rows[row] = self.rows[row] + found if row in self.rows else found

    def add_sheet(self, products: Iterable[Array]) -> None:
        """Add products (w, D) with errors of the sensors that are drawn for a run."""
        for part in products:
            self.null_sheet += part


@dataclass(frozen=True)
class CrossProducts:
    """Sums of products of the columns of `layout` over all runs, every run's zeros eliminated.

    Attributes
    ----------
    layout : order of the w columns.
    turn : (p, p) matrix T; the model's columns times T are nearly orthonormal and stand in place of them.
    prior : (p, p) normal matrix of the priors of the model's parameters, for the orthonormal columns.
    blocks : the samples, run by run.
    total : (w, w) of all samples; `train`, `test` (folds, w, w) of those outside and inside a fold, `test` at the
        zeros found outside.
    null : row → (w, D) products with the row's simulated noise; `null_sheet` (w, D) with simulated zeros and drifts.
    rows : row → sums over its samples alone.
    prior_stiffening : 1 σ of the sensor sheet ÷ 1 σ of the zeros' priors.
    zero_gains : for each run (z, w) regression of each column on its zeros.
    noise_zeros : for each run (z, D) regression of its simulated noise on its zeros.
    """

    layout: Layout
    turn: Array
    prior: Array
    blocks: tuple[Block, ...]
    total: Array
    train: Array
    test: Array
    null: Mapping[Row, Array]
    null_sheet: Array
    rows: Mapping[Row, RowProducts]
    prior_stiffening: float
    zero_gains: tuple[Array, ...]
    noise_zeros: tuple[Array, ...]

    @classmethod
    def of(
        cls, fitted: Fit, floor: NoiseFloor, layout: Layout, prior_stiffening: float, drifts: Mapping[str, float],
        rng: np.random.Generator,
    ) -> CrossProducts:  # fmt: skip
        """Cross products of all columns of a fit, from one pass over the samples of its runs.

        Parameters
        ----------
        fitted : the model, on its runs.
        floor : weights and simulated noise.
        prior_stiffening : 1 σ of the sensor sheet ÷ 1 σ of the zeros' priors.
        drifts : key → 1 σ of the sensor faults whose size is another in each run.
        rng : for simulated zeros and drifts.
        """
        turn, draws = fitted.orthonormaliser(floor.sigma), floor.count
        sums = _Sums.zero(layout.width, floor.sigma, draws)
        blocks: list[Block] = []
        zero_gains: list[Array] = []
        noise_zeros: list[Array] = []
        for of_run, z in _blocks_by_run(fitted, floor, layout, turn, prior_stiffening):
            products = RunProducts.of(of_run, z, layout.width, draws)
            sums.add(products)
            sums.add_sheet(_sheet_draws(products, layout, prior_stiffening, drifts, draws, rng))
            blocks += of_run
            zero_gains.append(products.eliminated[0])
            noise_zeros.append(products.noise_zeros)
        return cls(
            layout, turn, _model_prior(fitted, turn), tuple(blocks), sums.total, sums.train, sums.test, sums.null,
            sums.null_sheet, sums.rows, prior_stiffening, tuple(zero_gains), tuple(noise_zeros),
        )  # fmt: skip

    @property
    def block_count(self) -> int:
        """Number of blocks of the cross-validation over all runs."""
        return 1 + max(int(block.number.max()) for block in self.blocks)

    def series(self, coefficients: Array, row: Row | None = None) -> Iterator[tuple[Block, Array]]:
        """For each block, or each of a `row`, (n, k) columns · coefficients (w, k), less their regression on zeros."""
        for block in self.blocks if row is None else [block for block in self.blocks if block.row == row]:
            nuisance = self.zero_gains[block.run] @ coefficients
            yield block, block.columns @ coefficients[block.active] - block.zeros @ nuisance

    def noise_series(self, coefficients: Array, row: Row) -> Iterator[tuple[Block, Array]]:
        """For each block of a row (n, D) noise plus columns · coefficients (w, D), less the regression on zeros."""
        for block, moved in self.series(coefficients, row):
            yield block, block.draws.T[:, block.choice] - block.zeros @ self.noise_zeros[block.run] + moved


def _sheet_draws(
    products: RunProducts, layout: Layout, prior_stiffening: float, drifts: Mapping[str, float], draws: int,
    rng: np.random.Generator,
) -> Iterator[Array]:  # fmt: skip
    """(w, D) products of a run's columns with simulated zeros of its sensors, then with each simulated drift."""
    # Zeros are drawn from the sheet, whose σ the priors are `prior_stiffening` times stiffer than.
    yield products.with_drawn_zeros(prior_stiffening * rng.standard_normal((products.zeros, draws)))
    for place, drift in layout.of_keys(drifts):
        yield products.eliminated[1][:, place] @ (drift * rng.standard_normal((1, draws)))


def _model_prior(fitted: Fit, turn: Array) -> Array:
    """(p, p) normal matrix of the priors of a model's parameters, for its orthonormal columns.

    The priors are centred on the fit. Where the fit is many σ away from a prior (a late laser moves a wheel's moment by
    twelve), the prior is widened to that distance: else a candidate would gain by moving the parameter back.
    """
    equations = fitted.equations.known
    widening = np.hypot(1.0, equations @ fitted.solution)
    prior = (equations / widening[:, None]) @ turn
    return prior.T @ prior


def _blocks_by_run(
    fitted: Fit, floor: NoiseFloor, layout: Layout, turn: Array, prior_stiffening: float
) -> Iterator[tuple[list[Block], int]]:
    """For each run its samples and the number of its sensor zeros; blocks are numbered on from run to run."""
    first = 0
    for run in range(len(fitted.runs)):
        priors = fitted.zeros[run][1] / prior_stiffening
        blocks = list(_blocks(fitted, floor, layout, turn, run, priors, first))
        first = 1 + max((int(block.number.max()) for block in blocks), default=first)
        yield blocks, len(priors)


def _blocks(
    fitted: Fit, floor: NoiseFloor, layout: Layout, turn: Array, run: int, priors: Array, first: int
) -> Iterator[Block]:
    """Weighted samples of one run, row by row; `first` is the number of its first block."""
    filters = fitted.runs[run].recording.filters
    seen: dict[Row, int] = {}

    def of_piece(piece: Piece) -> Iterator[Block]:
        for row, (columns, active) in columns_of(fitted, layout, piece, floor.sigma):
            start = seen.get(row, 0)
            seen[row] = start + len(columns)
            time = piece.instants[row] * (filters.step / filters.rate)
            number = first + (time // SELECTION.block_seconds).astype(np.intp)
            zeros = piece.blocks[row][:, : len(priors)] * (priors / floor.sigma[row])
            noise, choice = floor.draws[run].piece(row, start, seen[row])
            model = columns[:, : layout.model]
            # The right side is what the fit leaves: priors then hold on to the fit, and not to a smaller scale.
            columns[:, -1] -= model @ fitted.solution
            columns[:, : layout.model] = model @ turn
            yield Block(run, row, zeros, columns, active, number, noise / floor.sigma[row], choice)

    # Mapped, so that a piece's motion and slopes are gone before the next piece is made.
    return chain.from_iterable(map(of_piece, fitted.assembly.pieces_of(run)))


def columns_of(
    fitted: Fit, layout: Layout, piece: Piece, sigma: Mapping[Row, float], noisy: Piece | None = None
) -> Iterator[tuple[Row, tuple[Array, NDArray[np.intp]]]]:
    """Weighted columns (n, a) of each row of a piece, the measured side last, and their places in the layout.

    `noisy` : the piece with simulated noise, from which the columns are computed instead.
    """
    p, keep, run = layout.model, fitted.base.independent, (noisy or piece).prepared
    tried = [(trial.place, one) for trial in layout.trials if (one := trial.effect.as_physics) is not None]
    run.prepare([*(fitted.model.physics if noisy else ()), *(one for _, one in tried)])
    sensors = sensor_columns(fitted, layout, piece, noisy)
    physics = [(place, run.columns(one)) for place, one in tried]
    for row, block in piece.blocks.items():
        model, right = block[:, block.shape[1] - p :], piece.right[row]
        if noisy:
            model, right = model.copy(), run.measured[row]
            model[:, : len(keep)] = run.matrix(fitted.model.physics, row)[:, keep]
        own = [*sensors[row], *((place, found[row]) for place, found in physics if row in found)]
        parts = [model, *(columns.T for _, columns in own), right[:, None]]
        active = [*range(p), *(i for place, _ in own for i in range(place.start, place.stop)), layout.right]
        yield row, (np.concatenate(parts, axis=1) / sigma[row], np.array(active, np.intp))


def without_zeros(normal: Array, z: int) -> tuple[Array, Array]:
    """(z, w) regression of the other columns on zeros of prior σ = 1, and (w, w) products of their remainders."""
    gain = np.asarray(np.linalg.solve(normal[:z, :z] + np.eye(z), normal[:z, z:]), float)
    return gain, normal[z:, z:] - normal[z:, :z] @ gain


def at_zeros(normal: Array, gain: Array) -> Array:
    """(w, w) products of the columns less their regression `gain` (z, w) on the zeros."""
    z = len(gain)
    across = gain.T @ normal[:z, z:]
    return normal[z:, z:] - across - across.T + gain.T @ normal[:z, :z] @ gain


@dataclass(frozen=True)
class Linearisation:
    """Fit with the latencies at which its columns are linearised.

    Attributes
    ----------
    fitted, floor : fit and noise floor.
    latencies : entry of the sheet → latency removed from the runs [s]; empty for runs as recorded.
    sums : cross products of the columns of model and sensor sheet.
    """

    fitted: Fit
    floor: NoiseFloor
    latencies: Mapping[SheetEntry, float]
    sums: CrossProducts

    @classmethod
    def of(cls, fitted: Fit, floor: NoiseFloor) -> Linearisation:
        """Linearisation at the latencies of the rig file: runs as recorded."""
        return cls(fitted, floor, {}, sheet_products(fitted, floor))

    @cached_property
    def latency_tolerances(self) -> dict[SheetEntry, float]:
        """Tolerances of latencies: entry of the sheet → [s]."""
        rig = self.fitted.runs[0].recording.rig
        return {e: rig.tolerance(e[1], "latency") for e in self.sums.layout.sheet if e[0] == "latency"}

    @cached_property
    def prior_side(self) -> Array:
        """(model + sheet,) means of the priors in tolerances: latencies of the rig file less those removed."""
        off = [
            -self.latencies[e] / self.latency_tolerances[e] if e in self.latencies else 0.0
            for e in self.sums.layout.sheet
        ]
        return np.array([0.0] * self.sums.layout.model + off)

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return self.fitted.omega

    def nuisance_prior(self, prior_side: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Places (a,) of the model's and sheet's columns that act; normal matrix and right side of their priors."""
        sums, layout = self.sums, self.sums.layout
        places = np.arange(layout.right)
        nuisance = places[np.diag(sums.total)[places] > 0.0]
        prior = np.eye(layout.right)
        prior[: layout.model, : layout.model] = sums.prior
        return nuisance, prior[np.ix_(nuisance, nuisance)], prior_side[nuisance]


def sheet_products(fitted: Fit, floor: NoiseFloor) -> CrossProducts:
    """Cross products of a fit's columns and those of the sensor sheet."""
    layout = Layout.of(len(fitted.place), fitted.sheet_entries, ())
    return CrossProducts.of(fitted, floor, layout, 1.0, {}, np.random.default_rng(0))


@dataclass(frozen=True)
class CandidateColumns:
    """Cross products of the columns of candidates, of a model and of the sensor sheet, with the priors.

    Attributes
    ----------
    linearisation : the fit and its floor, at the latencies removed from the runs.
    effects : candidates that can be computed on these runs; those of the model are passed over.
    unmeasured : key → what a run lacks for a candidate that cannot be computed.
    sums : cross products of all columns.
    sheet : place → name of the columns that stand for the sensor sheet's tolerances; `sigma` one tolerance, in the
        column's own unit.
    nuisance : (a,) places of the columns of model and sheet that act: their parameters are nuisance to every test.
    prior, prior_side : (a, a) normal matrix and (a,) right side of the priors of their parameters.
    drawn : (s, D) tolerances of the sheet drawn for every simulated run.
    """

    linearisation: Linearisation
    effects: tuple[Effect, ...]
    unmeasured: Mapping[str, Unmeasured]
    sums: CrossProducts
    sheet: Mapping[int, str]
    sigma: Mapping[int, float]
    nuisance: NDArray[np.intp]
    prior: Array
    prior_side: Array
    drawn: Array

    @classmethod
    def of(
        cls,
        linearisation: Linearisation,
        candidates: Sequence[Effect],
        seed: int,
        prior_stiffening: float,
        progress: Progress = silent,
    ) -> CandidateColumns:
        """Columns of these candidates; `seed` of simulated zeros and tolerances; priors with σ ÷ `prior_stiffening`."""
        fitted, floor = linearisation.fitted, linearisation.floor
        fresh = [effect for effect in candidates if effect.key not in fitted.model]
        unmeasured = {e.key: lack for e in fresh if (lack := _unmeasured(fitted, e))}
        effects = [effect for effect in fresh if effect.key not in unmeasured]
        rng = np.random.default_rng([seed, 6])
        rig = fitted.runs[0].recording.rig
        bounds = {e.key: e.sheet_bound(rig) for e in effects}
        kinds = {e.key: e.sheet_kind for e in effects}
        drifts = {key: bound for key, bound in bounds.items() if kinds[key] == "drift" and bound > 0.0}
        shapes = [one for effect in effects for one in effect.shapes()]
        layout = Layout.of(len(fitted.place), linearisation.sums.layout.sheet, shapes)
        progress(Step(Stage.TRIAL_COLUMNS, total=len(effects)))
        sums = CrossProducts.of(fitted, floor, layout, prior_stiffening, drifts, rng)
        # Gains and latencies stand in the sheet channel by channel; other faults stand for their own tolerance.
        sheet = {layout.model + i: f"{e[0]} of {e[1]}" for i, e in enumerate(layout.sheet)}
        sigma = dict.fromkeys(sheet, 1.0)
        for trial in layout.trials:
            key = trial.effect.key
            if trial.fault and bounds[key] > 0.0 and kinds[key] not in ("gain", "latency", "drift"):
                sheet[trial.place.start], sigma[trial.place.start] = key, bounds[key]
        there = [place for place in sheet if sums.total[place, place] > 0.0]
        one = np.array([sigma[place] for place in there])
        prior = scipy.linalg.block_diag(sums.prior, np.diag((prior_stiffening / one) ** 2))
        nuisance = np.concatenate([np.arange(layout.model), there]).astype(np.intp)
        known = np.zeros(layout.width)
        known[: len(linearisation.prior_side)] = linearisation.prior_side
        prior_side = np.concatenate([np.zeros(layout.model), (prior_stiffening / one) ** 2 * known[there]])
        drawn = one[:, None] * rng.standard_normal((len(there), floor.count))
        return cls(linearisation, tuple(effects), unmeasured, sums, sheet, sigma, nuisance, prior, prior_side, drawn)


def _unmeasured(fitted: Fit, effect: Effect) -> Unmeasured | None:
    """Channels that an effect needs and a run lacks, of the first such run; None without any."""
    return next((lack for run in fitted.runs if (lack := run.lacks(effect))), None)


def solved(G: Array, sides: Array) -> Array:
    """Pseudo-inverse of G times `sides`: linearly dependent columns (two laws equal on these runs) count once."""
    scale = np.sqrt(np.diag(G))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(G / np.outer(scale, scale))
    kept = values > SELECTION.shared_eigenvalue * values[-1]
    V = vectors[:, kept]
    return (V @ ((V.T @ (sides / scale[:, None])) / values[kept, None])) / scale[:, None]
