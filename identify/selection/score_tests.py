"""Score tests of candidates on top of a fitted model, all rows of all runs weighted by the noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import row_unit
from lacet.identify.effects.base import Effect, Parameter
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Tell, silent
from lacet.identify.selection.cross_products import BLOCK, Reading, Trial, TrialColumns
from lacet.identify.selection.lack_of_fit import (
    SIGNIFICANCE,
    Left,
    left_by,
    left_unexcused,
    louder_rows,
    prior_stiffening,
)
from lacet.identify.selection.partial_regression import GONE, Partialled, beside
from lacet.identify.selection.regressor_noise import ColumnNoise, column_labels
from lacet.identify.selection.tolerance_tests import Excused, Freed, excused, own_columns


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of the model.

    Attributes
    ----------
    key : the effect, with `shape` the constants that fit best.
    answer : ``missing`` (the one proposed, and those tied with it), ``undecided`` (it helps now, and is judged again
        once that one is added), ``not needed`` or ``not testable``.
    why : two plain sentences with numbers.
    gain : what it takes away in blocked cross-validation, as part of the weighted residual of its rows, at most 1;
        `total_gain` the same in weighted squares, of all rows.
    most : part of the weighted residual of one row that it takes away, in the row where that is most.
    gain_rms : the residual it takes away, as RMS over its `rows` of one unit [N or N·m].
    drop : fall of the weighted sum of squares on all data; `p` family-wise probability of such a fall by chance.
    coverage : effective number of blocks it acts in.
    size : √λ of the largest plausible effect after everything else is partialled out.
    absorbed : what takes it up where it cannot be tested, largest share first.
    values : estimates of its parameters [SI], and `interval`, half of their 95 % intervals (independent residuals).
    ties : candidates that cannot be told apart from it on these runs, with their correlation.
    block_gain : (B,) weighted squares it takes away, block by block.

    Examples
    --------
    >>> best = ranking.best
    >>> best.key, best.rows
    ('anti_roll_bar.front', ('suspension.fl', 'suspension.fr'))
    """

    key: str
    shape: Mapping[str, float]
    answer: str = ""
    why: str = ""
    rows: tuple[str, ...] = ()
    gain: float = 0.0
    most: float = 0.0
    gain_rms: float = 0.0
    total_gain: float = 0.0
    drop: float = 0.0
    p: float = 1.0
    coverage: float = 0.0
    size: float = 0.0
    absorbed: tuple[tuple[str, float], ...] = ()
    values: tuple[float, ...] = ()
    interval: tuple[float, ...] = ()
    ties: tuple[tuple[str, float], ...] = ()
    block_gain: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def tested(self) -> bool:
        """Whether the runs could show it."""
        return self.answer != "not testable"


LEAST_COVERAGE = 3.0
"""Effective number of blocks in which a candidate must act."""
LEAST_SIZE = 8.0
"""Weighted size √λ that the largest plausible effect must have after everything else is partialled out."""
MOSTLY_NOISE = 0.5
"""Part of a candidate's own columns that may be noise: beyond it the runs do not tell what it would do."""
FREE = 0.2
"""Part of a fault's column that may be noise for it to be weighed without its own tolerance; more is excused by it."""


@dataclass(frozen=True)
class Tried:
    """A candidate's best trial. `null` (D,) is the largest fall over its shapes in each simulated run.

    `freed` is there for a sensor fault that the sheet has a tolerance for: what it is judged by. `alone` is what its
    gain is told by: for a latency, where no clock's tolerance excuses it, as runs show how clocks differ and nothing
    of their common time; `freed` for others.
    """

    trial: Trial
    drop: float
    null: Array
    values: Array
    spread: Array
    freed: Freed | None = None
    alone: Freed | None = None

    @property
    def key(self) -> str:
        """The effect's key."""
        return self.trial.effect.key


class TrialSpace:
    """A fitted model with every candidate beside it, less what model, zeros and the sheet's tolerances explain.

    Parameters
    ----------
    columns : those of model, sensor sheet and candidates.
    noise : the noise in them, where it is known already.
    tell : told what is done now.

    Attributes
    ----------
    columns, noise : as given, or found.
    partialled : everything less what model, zeros and the sensor sheet's tolerances explain. A sensor fault is tried as
        one that is free of its tolerance.
    freed : place → sensor fault that the sheet has a tolerance for.
    null : (w, D) products of all columns with simulated runs that lack nothing.
    louder : row → by how much its noise exceeds the sheet's: so much louder are the simulated runs, too.
    """

    def __init__(self, columns: TrialColumns, noise: ColumnNoise | None = None, tell: Tell = silent):
        self.columns, self.sums, self.layout = columns, columns.sums, columns.sums.layout
        self.reading, self.effects = columns.reading, columns.effects
        self.fitted, self.floor = columns.reading.fitted, columns.reading.floor
        if noise is None or not noise.fits(column_labels(self.fitted, self.layout), self.floor.sigma):
            tell("the noise in what they follow")
            noise = ColumnNoise.of(
                self.fitted, self.sums, self.floor.sigma,
                progress=lambda step: tell(f"the noise in what they follow: {step.done} of {step.total} draws"),
            )  # fmt: skip
        self.noise = noise
        self.louder = louder_rows(self.sums, columns.taken, columns.prior, columns.pull)
        noisy = noise.products(self.sums, self.louder, self.floor.sigma)
        self.partialled = Partialled(self.sums, columns.taken, columns.prior, noisy, columns.pull)
        self.freed = {
            trial.place.start: Freed(self.partialled, trial.place.start, own)
            for trial in self.layout.trials
            if trial.fault
            and (own := own_columns(self.partialled, trial.place.start, self._alike(trial))).size
            and np.all(self.partialled.remaining(trial.place) > GONE)
        }
        loud = [self.louder[row] * products for row, products in self.sums.null.items()]
        there = columns.taken[self.layout.model :]
        # What is drawn acts through the true channels, the columns have the channels' noise as well.
        self.null = self.sums.null_sheet + self.partialled.total[:, there] @ columns.drawn + np.sum(loud, axis=0)
        self.tried: dict[str, Tried] = {}

    @classmethod
    def of(
        cls, reading: Reading, candidates: Sequence[Effect], seed: int, noise: ColumnNoise | None = None,
        tell: Tell = silent,
    ) -> TrialSpace:  # fmt: skip
        """Candidates beside a model on runs as they were read."""
        return cls(TrialColumns.of(reading, candidates, seed, prior_stiffening(reading), tell), noise, tell)

    # -- one candidate ------------------------------------------------------------------------------------------------

    def try_all(self) -> list[Candidate]:
        """Every candidate: its best shape, what these runs can tell of it, and how far the error falls."""
        out = [
            Candidate(key, {}, "not testable", f"Cannot be tested: {why}.") for key, why in self.columns.cannot.items()
        ]
        there = [t for t in self.layout.trials if np.all(self.partialled.remaining(t.place) > GONE)]
        every = [self._try(trial) for trial in there]
        covered = dict(zip((one.trial.place.start for one in every), self._block_energy(every), strict=True))
        for effect in self.effects:
            seen = [one for one in every if one.key == effect.key]
            # A gap passed once by a hair leaves a column of nothing, in which noise taken off looks like a fall.
            shown = [
                one
                for one in seen
                if self._size(one) >= LEAST_SIZE and covered[one.trial.place.start] >= LEAST_COVERAGE
            ]
            if seen:
                best = max(shown or seen, key=lambda one: one.drop)
                null = np.max([one.null for one in shown or seen], axis=0)
                self.tried[effect.key] = replace(best, null=null)
                out.append(self._measured(best, covered[best.trial.place.start]))
            else:
                shapes = [trial for trial in self.layout.trials if trial.effect.key == effect.key]
                out.append(self._unseen(effect, shapes))
        return self._with_blocks(out)

    def _try(self, trial: Trial) -> Tried:
        if (freed := self.freed.get(trial.place.start)) is not None and freed.noisy_part < FREE:
            value, spread = np.array([freed.value]), np.array([freed.spread])
            alone = freed
            if trial.effect.sheet_kind == "latency":
                alone = Freed(self.partialled, trial.place.start, self._clocks)
            return Tried(trial, freed.drop, freed.null(self.null), value, spread, freed, alone)
        drop, null = self.partialled.scores(trial.place, self.null)
        return Tried(trial, drop, null, *self.partialled.values(trial.place))

    def _alike(self, trial: Trial) -> NDArray[np.intp]:
        """Positions among the columns partialled out of the tolerances that may stand for a fault."""
        mine = trial.effect.sheet_entries
        faults = {other.place.start: other.effect for other in self.layout.trials if other.fault}
        first, model = self.layout.model + len(self.layout.sheet), self.layout.model
        out: list[int] = []
        for position in range(model, len(self.partialled.taken)):
            place = int(self.partialled.taken[position])
            entry = self.layout.sheet[place - model][:2] if place < first else None
            if mine & ({entry} if entry else faults[place].sheet_entries):
                out.append(position)
        return np.array(out, np.intp)

    @cached_property
    def _clocks(self) -> NDArray[np.intp]:
        """Positions among the columns partialled out of all latencies of the sheet."""
        late = [self.layout.model + i for i, entry in enumerate(self.layout.sheet) if entry[0] == "latency"]
        return np.flatnonzero(np.isin(self.partialled.taken, late))

    def _unseen(self, effect: Effect, shapes: Sequence[Trial]) -> Candidate:
        acts = any(np.any(np.diag(self.sums.total)[trial.place]) for trial in shapes)
        why = "the model already explains all it does on these runs" if acts else "it never acts on these runs"
        return Candidate(effect.key, {}, "not testable", f"Cannot be tested: {why}. {_shown(effect)}")

    def _block_energy(self, tried: Sequence[Tried]) -> list[float]:
        """For each trial, the effective number of blocks it acts in."""
        if not tried:
            return []
        parts: list[Array] = []
        owner: list[int] = []
        for i, one in enumerate(tried):
            scales = [q.largest for q in one.trial.effect.parameters]
            places = np.zeros((self.layout.width, len(scales)))
            places[one.trial.place] = np.diag(scales)
            parts.append(self.partialled.coefficients(places))
            owner += [i] * len(scales)
        columns = np.concatenate(parts, axis=1)
        energy = np.zeros((self._block_count, columns.shape[1]))
        for block, series in self.sums.series(columns):
            np.add.at(energy, block.number, series**2)
        joined = np.zeros((self._block_count, len(tried)))
        np.add.at(joined.T, np.array(owner), energy.T)
        total = joined.sum(axis=0)
        squares = np.sum(joined**2, axis=0)
        return [float(x) for x in np.divide(total**2, squares, out=np.zeros_like(total), where=squares > 0)]

    @property
    def _block_count(self) -> int:
        return 1 + max(int(block.number.max()) for block in self.sums.blocks)

    def _size(self, one: Tried) -> float:
        """√λ of the largest plausible size."""
        largest = np.array([q.largest for q in one.trial.effect.parameters])
        energy = np.array([one.freed.energy]) if one.freed else np.diag(self.partialled.left)[one.trial.place]
        return float(np.sqrt(max(0.0, np.max(energy * largest**2))))

    def _measured(self, one: Tried, coverage: float) -> Candidate:
        effect, place, size = one.trial.effect, one.trial.place, self._size(one)
        found = Candidate(
            effect.key, dict(effect.shape), rows=self._rows(place), coverage=coverage, size=size, drop=one.drop,
            values=tuple(float(x) for x in one.values),
            interval=tuple(float(1.96 * x) for x in one.spread),
        )  # fmt: skip
        if coverage < LEAST_COVERAGE:
            reason = f"it acts in only {coverage:.1f} blocks of {BLOCK:g} s (at least {LEAST_COVERAGE:g} needed)"
        elif size < LEAST_SIZE:
            absorbed = self._absorbed(one)
            found = replace(found, absorbed=absorbed)
            by = ", ".join(f"{key} {100 * share:.0f} %" for key, share in absorbed[:3])
            reason = (
                f"even at its largest plausible size it would stand out by only {size:.1f} times its noise "
                f"(at least {LEAST_SIZE:g} needed){f', most of it taken up by {by}' if by else ''}"
            )
        elif one.freed is None and (part := self.partialled.noisy_part(place)) > MOSTLY_NOISE:
            reason = f"{100 * part:.0f} % of what it would follow is noise of the sensors"
        else:
            return replace(found, total_gain=one.alone.fall() if one.alone else self.partialled.fall(place))
        return replace(found, answer="not testable", why=f"Cannot be tested: {reason}. {_shown(effect)}")

    def _absorbed(self, one: Tried) -> tuple[tuple[str, float], ...]:
        """What takes a candidate's columns up: shares of their energy, by effect of the model and by sensor fault."""
        place, total = one.trial.place, self.sums.total
        k = place.start + int(np.argmax(np.diag(self.partialled.left)[place]))
        whole = float(total[k, k])
        # Shares of a regression, as products of coefficient and covariance, in the model's own parameters.
        p = self.layout.model
        gain = self.partialled.gain[:, k]
        turned = np.linalg.solve(self.sums.turn, np.eye(p))
        parts = (self.sums.turn @ gain[:p]) * (turned.T @ total[:p, k])
        shares: dict[str, float] = {}
        names = [name.rsplit(".", 1)[0] for name in self.fitted.columns]
        for name, part in zip(names, parts, strict=True):
            shares[name] = shares.get(name, 0.0) + float(part) / whole
        for other, part in zip(
            self.partialled.taken[p:].tolist(), gain[p:] * total[self.partialled.taken[p:], k], strict=True
        ):
            name = self.columns.sheet[other]
            shares[name] = shares.get(name, 0.0) + float(part) / whole
        ranked = sorted(((key, share) for key, share in shares.items() if share > 0.05), key=lambda item: -item[1])
        return tuple(ranked)

    @cached_property
    def _acting(self) -> dict[str, NDArray[np.bool_]]:
        """Row → (w,) whether a column acts on it."""
        out = {row: np.zeros(self.layout.width, bool) for row in self.sums.null}
        for block in self.sums.blocks:
            out[block.row][block.active] = True
        return out

    def _rows(self, place: slice) -> tuple[str, ...]:
        return tuple(row for row, acting in self._acting.items() if np.any(acting[place]))

    def _with_blocks(self, found: Sequence[Candidate]) -> list[Candidate]:
        """Gains by block, and as parts of the residual of the rows acted on."""
        tested = [c.key for c in found if c.tested]
        if not tested:
            return list(found)
        right, m = self.layout.right, len(tested)
        # The effects, the residual, and for a fault that the sheet excuses the residual without that excuse.
        plain = np.zeros((self.layout.width, m + 1))
        plain[right, -1] = 1.0
        for i, key in enumerate(tested):
            plain[self.tried[key].trial.place, i] = self.tried[key].values
        plain = self.partialled.coefficients(plain)
        before = np.repeat(plain[:, -1:], m, axis=1)
        for i, key in enumerate(tested):
            if (alone := self.tried[key].alone) is not None:
                plain[:, i], before[:, i] = (alone.coefficients() * np.array([alone.value, 1.0])).T
        falls = np.zeros((self._block_count, m))
        squares, counts = {row: np.zeros(m) for row in self.floor.sigma}, dict.fromkeys(self.floor.sigma, 0)
        rows = {row: np.zeros(m) for row in self.floor.sigma}
        whole = 0.0
        for block, series in self.sums.series(np.concatenate([plain, before], axis=1)):
            effect, left, without = series[:, :m], series[:, m : m + 1], series[:, m + 1 :]
            after = (without - effect) ** 2
            np.add.at(falls, block.number, left**2 - after)
            squares[block.row] += np.sum(without**2, axis=0)
            rows[block.row] += np.sum(without**2 - after, axis=0)
            counts[block.row] += len(series)
            whole += float(np.sum(left**2))
        # In cross-validation the model alone leaves more than on all data.
        more = max(0.0, sum(float(test[right, right]) for _, test in self.partialled.folds) - whole)
        place = {key: i for i, key in enumerate(tested)}
        out: list[Candidate] = []
        for c in found:
            if c.tested:
                here = more + sum(float(squares[row][place[c.key]]) for row in c.rows)
                alike = [row for row in c.rows if row_unit(row) == row_unit(c.rows[0])]
                scale = float(np.sqrt(np.mean([self.floor.sigma[row] ** 2 for row in alike])))
                rms = scale * float(np.sqrt(max(0.0, c.total_gain) / max(1, sum(counts[row] for row in alike))))
                # Rows it does not act on gain too, where it frees the parameters they share.
                gain = min(1.0, c.total_gain / here) if here else 0.0
                i = place[c.key]
                most = max((float(rows[row][i] / squares[row][i]) for row in c.rows if squares[row][i]), default=0.0)
                c = replace(c, gain=gain, most=most, gain_rms=rms, block_gain=falls[:, place[c.key]])
            out.append(c)
        return out

    @property
    def led(self) -> Array:
        """Values of the physics' parameters that the sensor sheet leads to, beside no candidate."""
        out, model = self.fitted.theta.copy(), self.layout.model
        out[self.fitted.place] += self.sums.turn @ self.partialled.gain[:model, self.layout.right]
        return out[: len(self.fitted.physics)]

    # -- effects added, at shapes of their own -------------------------------------------------------------------------

    @property
    def _grid(self) -> dict[str, slice]:
        return {key: one.trial.place for key, one in self.tried.items()}

    def beside(self, effects: Sequence[Effect], draws: bool = True) -> tuple[Partialled, tuple[Trial, ...]]:
        """Columns of some effects at their present shapes, less what model, zeros and sheet explain.

        `draws` : beside the simulated runs, too.
        """
        return beside(self.columns, self.partialled, effects, self._grid if draws else None)

    def left_by(self, added: Sequence[Effect]) -> Left:
        """The residual after model, zeros, sensor sheet and some effects, beside simulated runs treated alike."""
        return left_by(self.columns, self.partialled, added, self._grid)

    def left_unexcused(self, key: str) -> Left:
        """The residual after model, zeros and sheet, where nothing of a sensor fault is excused by its tolerance."""
        freed = self.tried[key].freed
        return left_unexcused(self.partialled, freed.own if freed else np.zeros(0, np.intp))

    def excused(self, key: str = "") -> Excused:
        """What the sheet takes up beside the candidate `key` at its best shape, or beside none."""
        return excused(self.columns, self.partialled, self.null, self._taken_up(key))

    def _taken_up(self, key: str) -> Array:
        """(a,) what the columns partialled out explain of the residual, less a candidate."""
        known, right = self.partialled, self.layout.right
        if not key:
            return known.gain[:, right]
        one = self.tried[key]
        if one.freed is None:
            return known.gain[:, right] - known.gain[:, one.trial.place] @ one.values
        # A fault set free is excused by nothing that stands for it.
        fault, residual = one.freed.coefficients()[known.taken].T
        out = float(one.values[0]) * fault - residual
        out[one.freed.own] = 0.0
        return out

    # -- all of them --------------------------------------------------------------------------------------------------

    def family_wise(self, found: Sequence[Candidate]) -> list[Candidate]:
        """Compare each fall with the largest over all candidates in every simulated run.

        Falls are measured in units of their own mean under the null: beside a misfit, where the sheet's priors are
        stiffened, a fault whose tolerance moves much would else drown the physics.
        """
        tested = [self.tried[c.key] for c in found if c.tested]
        if not tested:
            return list(found)
        means = {one.key: float(np.mean(one.null)) for one in tested}
        worst = np.max([one.null / means[one.key] for one in tested], axis=0)
        return [
            replace(c, p=float((1 + np.count_nonzero(worst >= c.drop / means[c.key])) / (1 + worst.size)))
            if c.tested
            else c
            for c in found
        ]

    def correlation(self, a: str, b: str) -> float:
        """Largest canonical correlation of two candidates after everything else is partialled out."""
        first, second = self.tried[a].trial.place, self.tried[b].trial.place
        # A touch more on the diagonal: of a law's parameters one may be all but another's double on these runs.
        A, B = (
            np.linalg.cholesky(G + 1e-12 * np.diag(np.diag(G)))
            for G in (self.partialled.whole[first, first], self.partialled.whole[second, second])
        )
        across = np.linalg.solve(A, self.partialled.whole[first, second])
        return min(1.0, float(np.linalg.svd(np.linalg.solve(B, across.T), compute_uv=False)[0]))


def _shown(effect: Effect) -> str:
    return f"What shows it: {effect.shown_by}."


LEAST_GAIN = 0.01
"""A proposal must take away at least this part of the weighted residual of the rows it acts on, or of one of them."""


def judged(c: Candidate, effect: Effect, draws: int) -> Candidate:
    """A tested candidate as ``missing`` or ``not needed``, with the reason."""
    wrong = implausible(c, effect.parameters)
    takes = (
        f"Added to the model it takes {c.gain_rms:.3g} {unit_of(c)} RMS off {_listed(c.rows)} "
        f"({100 * c.gain:.3g} % of what they leave) in parts of the runs it was not fitted to."
        if c.gain > 0.0
        else f"Added to the model it takes nothing off {_listed(c.rows)} in parts of the runs it was not fitted to."
    )
    found = f"Its size would be {sizes(c, effect.parameters)}"
    fault = effect.as_fault is not None
    alone = "noise and the sheet's tolerances" if fault else "noise alone"
    chance = (
        f"{alone} never did as well in {draws} simulated runs (p = {c.p:.2g})"
        if c.p <= 1.0 / (draws + 1) + 1e-12
        else f"{alone} {'do' if fault else 'does'} as well with p = {c.p:.2g}"
    )
    if c.p > SIGNIFICANCE:
        why = f"{takes} Not needed: {chance}, more than {SIGNIFICANCE:g}."
    elif c.gain <= 0.0 or max(c.gain, c.most) < LEAST_GAIN:
        why = f"{takes} Not needed: less than {100 * LEAST_GAIN:g} % of any row, though {chance}."
    elif wrong:
        why = f"{takes} Not needed: {wrong}, which no car has; something else looks like it ({chance})."
    else:
        return replace(c, answer="missing", why=f"{takes} {found}; {chance}.")
    return replace(c, answer="not needed", why=why)


def stands_out(c: Candidate, effect: Effect) -> bool:
    """Whether chance does not do as well and its size is plausible, however little it takes away."""
    return c.p <= SIGNIFICANCE and c.gain > 0.0 and not implausible(c, effect.parameters)


def implausible(c: Candidate, parameters: Sequence[Parameter]) -> str:
    """Which of its parameters would lie outside what is plausible on any car, by more than its interval; or nothing."""
    for q, value, half in zip(parameters, c.values, c.interval, strict=True):
        if value + half < q.low or value - half > q.high:
            return (
                f"{_last(q)} would be {value:.3g} ± {_two_digits(half)} {q.unit} (plausible: {q.low:g} to {q.high:g})"
            )
    return ""


def sizes(c: Candidate, parameters: Sequence[Parameter]) -> str:
    """Its parameters with 95 % intervals, and its shape constants."""
    parts = [
        f"{_last(q)} = {_rounded(value, half)} ± {_two_digits(half)} {q.unit}"
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
    ]
    unusual = [
        _last(q)
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
        if (q.expect == "positive" and value + half < 0.0) or (q.expect == "negative" and value - half > 0.0)
    ]
    out = ", ".join([*parts, *(f"{name} {value:.3g} (SI)" for name, value in c.shape.items())])
    return f"{out} (the sign of {', '.join(unusual)} is not the usual one)" if unusual else out


def unit_of(c: Candidate) -> str:
    """Unit of a candidate's `gain_rms`."""
    return row_unit(c.rows[0]) if c.rows else "N"


def _listed(rows: Sequence[str], most: int = 4) -> str:
    shown = ", ".join(rows[:most])
    return shown if len(rows) <= most else f"{shown} and {len(rows) - most} more rows"


def _last(q: Parameter) -> str:
    return q.name.rsplit(".", 1)[-1]


def _two_digits(half: float) -> str:
    """An interval with two digits, without a power of ten up to a million."""
    return f"{float(f'{half:.2g}'):g}"


def _rounded(value: float, half: float) -> str:
    """To the second digit of its interval."""
    if not half > 0.0 or not np.isfinite(half):
        return f"{value:.3g}"
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(half))))}f}"
