"""Candidates tried on top of a fitted model, all rows of all runs as one vector weighted by the noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from identify.effect import Effect, SensorFault
from identify.fit import Fit
from identify.floor import NoiseFloor
from identify.partialling import Basis
from identify.rows import row_unit
from identify.vectors import Array
from identify.zeros import zeros_of

LEAST_COVERAGE = 3.0
"""Effective number of blocks in which a candidate must act."""
LEAST_SIZE = 8.0
"""Weighted size √λ that the largest plausible effect must have after everything else is partialled out."""
BLOCK = 2.0
"""Length of a block of the cross-validation [s]."""
TIED = 0.05
"""Paired block losses that do not differ at this level (Wilcoxon's signed ranks) are a tie…"""
ALIKE = 0.5
"""… when the candidates are also at least this correlated: unlike effects that are both missing are no tie."""


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of the model.

    Attributes
    ----------
    key : the effect, with `shape` the constants that fit best.
    answer : ``missing`` (the one proposed, and those tied with it), ``undecided`` (it helps now, and is judged again
        once that one is added), ``not needed`` or ``not testable``.
    why : one or two plain sentences with numbers.
    gain : part of the weighted residual of its rows that it takes away in blocked cross-validation.
    gain_rms : by row kind's unit, the residual it takes away, as RMS over its rows [N or N·m].
    drop : fall of the weighted sum of squares on all data; `p` family-wise probability of such a fall by chance.
    coverage : effective number of blocks it acts in.
    size : √λ of the largest plausible effect after everything else is partialled out.
    values : estimates of its parameters [SI], and `interval`, half of their 95 % intervals (independent residuals).
    ties : candidates that cannot be told apart from it on these runs, with their correlation.
    """

    key: str
    shape: Mapping[str, float]
    answer: str
    why: str
    gain: float = 0.0
    gain_rms: float = 0.0
    total_gain: float = 0.0
    drop: float = 0.0
    p: float = 1.0
    coverage: float = 0.0
    size: float = 0.0
    values: tuple[float, ...] = ()
    interval: tuple[float, ...] = ()
    ties: tuple[tuple[str, float], ...] = ()
    block_gain: Array = field(default_factory=lambda: np.zeros(0), repr=False)


@dataclass(frozen=True)
class _Trial:
    """Columns of one candidate at one shape, after everything else was partialled out."""

    effect: Effect
    columns: Array
    basis: Array
    drop: float
    null: Array


class TrialSpace:
    """All rows of all runs as one weighted vector, with everything the model may explain partialled out."""

    def __init__(self, fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect], seed: int):
        self.fitted, self.floor = fitted, floor
        self.drives = fitted.drives
        self.sigma = floor.sigma
        self.segments: list[tuple[int, str, slice]] = []
        start = 0
        for d, drive in enumerate(self.drives):
            for row in drive.rows:
                n = len(drive.index[row])
                self.segments.append((d, row, slice(start, start + n)))
                start += n
        self.n = start
        self.blocks = self._blocks()
        physics, priors = self._physics()
        zeros, zero_priors = self._zeros()
        faults = [c for c in candidates if isinstance(c, SensorFault) and c.key not in fitted.model]
        self.fault_columns = {fault.key: self._fault(fault) for fault in faults}
        tolerances = {fault.key: self._tolerance(fault) for fault in faults}
        sheet = [key for key in self.fault_columns if tolerances[key] > 0 and np.any(self.fault_columns[key])]
        measured = self._stack([drive.measured for drive in self.drives])
        wide = np.column_stack([physics, zeros])
        sheet_columns = np.column_stack([np.zeros((self.n, 0)), *(self.fault_columns[k] for k in sheet)])
        sheet_priors = np.array([tolerances[k] for k in sheet])
        self.ratios = _ratios(fitted, floor)
        # Next to a misfit of many floors a prior of one σ is no bound at all: zeros and gains would soak the missing
        # effect up. The priors are stiffened by the misfit, which leaves them as they are when nothing is missing.
        temper = max(1.0, float(np.sqrt(np.mean(np.square(list(self.ratios.values()))))))
        narrow_priors = np.concatenate([priors, zero_priors / temper])
        # Sensor faults are tried against the model and zeros; physics against the sheet's tolerances as well.
        self.against_zeros = Basis(wide, narrow_priors)
        self.against_sheet = Basis(
            np.column_stack([wide, sheet_columns]), np.concatenate([narrow_priors, sheet_priors / temper])
        )
        self.y = measured
        self.null = self._null(zeros, zero_priors, sheet_columns, sheet_priors, seed)
        self.left = self.against_sheet.partial(self.y[:, None])[:, 0]
        self.null_left = self.against_sheet.partial(self.null)
        self.zeros_left = self.against_zeros.partial(self.y[:, None])[:, 0]
        self.zeros_null_left = self.against_zeros.partial(self.null)
        self.trials: dict[str, _Trial] = {}

    # -- assembling ---------------------------------------------------------------------------------------------------

    def _stack(self, parts: Sequence[Mapping[str, Array]]) -> Array:
        """Row series of every drive, (n,) each, as one weighted vector."""
        out = np.zeros(self.n)
        for d, row, place in self.segments:
            if row in parts[d]:
                out[place] = parts[d][row] / self.sigma[row]
        return out

    def _physics(self) -> tuple[Array, Array]:
        effects, keep = self.fitted.model.physics, self.fitted.base.independent
        parts = [self.drives[d].matrix(effects, row)[:, keep] / self.sigma[row] for d, row, _ in self.segments]
        priors = np.array([q.prior for effect in effects for q in effect.parameters])[keep]
        columns = np.concatenate(parts)
        for fault in self.fitted.model.faults:
            columns = np.column_stack([columns, self._fault(fault)])
            priors = np.append(priors, [q.prior for q in fault.parameters])
        return columns, priors

    def _zeros(self) -> tuple[Array, Array]:
        found = [zeros_of(d, s) for d, s in zip(self.drives, self.fitted.sensitivities, strict=True)]
        starts = np.concatenate([[0], np.cumsum([len(z.names) for z in found])]).astype(int)
        out = np.zeros((self.n, starts[-1]))
        for d, row, place in self.segments:
            out[place, starts[d] : starts[d + 1]] = found[d].columns[row] / self.sigma[row]
        return out, np.concatenate([z.sigma for z in found])

    def _fault(self, fault: SensorFault) -> Array:
        parts = [
            drive.decimated(sensitivity.fault(fault))
            for drive, sensitivity in zip(self.drives, self.fitted.sensitivities, strict=True)
        ]
        return self._stack(parts)

    def _tolerance(self, fault: SensorFault) -> float:
        rig = self.drives[0].recording.rig
        return max((rig.tolerance(channel, fault.tolerance) for channel in fault.channels()), default=0.0)

    def _columns(self, effect: Effect) -> Array:
        if isinstance(effect, SensorFault):
            return self.fault_columns[effect.key][:, None]
        p = len(effect.parameters)
        out = np.zeros((self.n, p))
        for d, row, place in self.segments:
            found = self.drives[d].columns(effect)
            if row in found:
                out[place] = found[row].T / self.sigma[row]
        return out

    def _null(self, zeros: Array, zero_priors: Array, sheet: Array, sheet_priors: Array, seed: int) -> Array:
        """(n, D) runs that lack nothing: noise, zeros and tolerances drawn from the sensor sheet."""
        rng = np.random.default_rng([seed, 6])
        out = np.zeros((self.n, self.floor.count))
        for d, row, place in self.segments:
            out[place] = self.floor.draws[d][row].T / self.sigma[row]
        out += zeros @ (zero_priors[:, None] * rng.standard_normal((len(zero_priors), self.floor.count)))
        out += sheet @ (sheet_priors[:, None] * rng.standard_normal((len(sheet_priors), self.floor.count)))
        return out

    def _blocks(self) -> NDArray[np.intp]:
        """(n,) block number of every sample; a run's blocks follow those of the run before."""
        out = np.zeros(self.n, np.intp)
        counts = [int(np.ptp(drive.motion.t) // BLOCK) + 1 for drive in self.drives]
        firsts = np.concatenate([[0], np.cumsum(counts)])
        for d, row, place in self.segments:
            t = self.drives[d].motion.t
            out[place] = firsts[d] + ((t[self.drives[d].index[row]] - t[0]) // BLOCK).astype(np.intp)
        return out

    # -- trying one candidate -----------------------------------------------------------------------------------------

    def try_candidate(self, effect: Effect) -> Candidate:
        """Search the candidate's shape constants, and measure gain, coverage and size."""
        cannot = next((why for drive in self.drives if (why := drive.can(effect))), "")
        if cannot:
            return Candidate(effect.key, {}, "not testable", f"Cannot be tested: {cannot}.")
        basis = self.against_zeros if isinstance(effect, SensorFault) else self.against_sheet
        fault = basis is self.against_zeros
        left, null_left = (self.zeros_left, self.zeros_null_left) if fault else (self.left, self.null_left)
        best: _Trial | None = None
        nulls: list[Array] = []
        for one in effect.shapes():
            raw = self._columns(one)
            columns = basis.partial(raw)
            lengths = np.linalg.norm(raw, axis=0)
            remain = np.linalg.norm(columns, axis=0)
            if not np.any(lengths) or np.any(remain < 1e-6 * np.maximum(lengths, 1e-300)):
                continue
            q = np.linalg.qr(columns)[0]
            drop, null = float(np.sum((q.T @ left) ** 2)), np.sum((q.T @ null_left) ** 2, axis=0)
            nulls.append(null)
            if best is None or drop > best.drop:
                best = _Trial(one, columns, q, drop, null)
        if best is None:
            acts = bool(np.any(self._columns(effect.shapes()[-1])))
            why = (
                "Cannot be tested: the model already explains all it does on these runs."
                if acts
                else "Cannot be tested: it never acts on these runs."
            )
            return Candidate(
                effect.key, {}, "not testable", f"{why} {effect.shown_by[0].upper()}{effect.shown_by[1:]}."
            )
        best = replace(best, null=np.max(nulls, axis=0))
        self.trials[effect.key] = best
        return self._measure(best, basis, left)

    def _measure(self, trial: _Trial, basis: Basis, left: Array) -> Candidate:
        effect, columns = trial.effect, trial.columns
        energy = np.bincount(self.blocks, weights=np.sum(columns[: self.n] ** 2, axis=1))
        coverage = float(np.sum(energy) ** 2 / np.sum(energy**2)) if np.any(energy) else 0.0
        largest = np.array([q.largest for q in effect.parameters])
        size = float(np.linalg.norm(columns * largest, axis=0).max())
        values: Array = np.asarray(np.linalg.lstsq(columns, left, rcond=None)[0], float)
        spread = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
        found = Candidate(
            effect.key, dict(effect.shape), "", "", coverage=coverage, size=size, drop=trial.drop,
            values=tuple(float(x) for x in values), interval=tuple(float(1.96 * x) for x in spread),
        )  # fmt: skip
        if coverage < LEAST_COVERAGE or size < LEAST_SIZE:
            reason = (
                f"it acts in only {coverage:.1f} blocks of {BLOCK:g} s"
                if coverage < LEAST_COVERAGE
                else f"even at its largest plausible size it would stand out by only {size:.1f} (at least "
                f"{LEAST_SIZE:g} needed) once model, zeros and sensor tolerances have taken their share"
            )
            why = f"Cannot be tested with these runs: {reason}. A run that shows it: {effect.shown_by}."
            return replace(found, answer="not testable", why=why)
        before, after = basis.cross_validated(self.y, self._columns(effect), self.blocks)
        fall = before**2 - after**2
        rows = self._rows(effect)
        acting = np.zeros(self.n, bool)
        for _, row, place in self.segments:
            acting[place] = row in rows
        here, gone = float(np.sum(before[acting] ** 2)), float(np.sum(fall[acting]))
        return replace(
            found,
            gain=gone / here if here else 0.0,
            total_gain=float(np.sum(fall)),
            gain_rms=self._rms_gain(gone, rows),
            block_gain=np.bincount(self.blocks, weights=fall).astype(float),
        )

    def _rows(self, effect: Effect) -> tuple[str, ...]:
        columns = self._columns(effect)
        return tuple(dict.fromkeys(row for _, row, place in self.segments if np.any(np.abs(columns[place]) > 1e-12)))

    def _rms_gain(self, total: float, rows: Sequence[str]) -> float:
        """The gain as the RMS of what it takes away, in the unit of the first kind of row it acts on."""
        units = [row_unit(row) for row in rows]
        alike = [row for row, unit in zip(rows, units, strict=True) if unit == units[0]]
        count = sum(place.stop - place.start for _, row, place in self.segments if row in alike)
        scale = float(np.sqrt(np.mean([self.sigma[row] ** 2 for row in alike])))
        return scale * float(np.sqrt(max(0.0, total) / count)) if count else 0.0

    def unit_of(self, key: str) -> str:
        """Unit of a candidate's `gain_rms`."""
        rows = self._rows(self.trials[key].effect)
        return row_unit(rows[0]) if rows else "N"

    # -- judging all --------------------------------------------------------------------------------------------------

    def family_wise(self, tried: Sequence[Candidate]) -> list[Candidate]:
        """Compare each drop with the largest over all candidates in every simulated run.

        Drops are measured in units of their own mean under the null, so that a sensor fault whose tolerance moves much
        does not drown the physics.
        """
        tested = [c for c in tried if c.answer == ""]
        if not tested:
            return list(tried)
        means = {c.key: float(np.mean(self.trials[c.key].null)) for c in tested}
        worst = np.max([self.trials[c.key].null / means[c.key] for c in tested], axis=0)
        return [
            replace(c, p=float((1 + np.count_nonzero(worst >= c.drop / means[c.key])) / (1 + worst.size)))
            if c.answer == ""
            else c
            for c in tried
        ]

    def explained(self, ranked: Sequence[Candidate]) -> tuple[float, float]:
        """Squares above the floor, and the part that the best set of up to three candidates takes away."""
        floor = float(np.sum(self.null_left**2)) / self.null_left.shape[1]
        excess = float(np.sum(self.left**2)) - floor
        left = self.left.copy()
        keys = [c.key for c in ranked if not isinstance(self.trials[c.key].effect, SensorFault)]
        keys += [c.key for c in ranked if c.key not in keys]
        used = np.zeros((left.size, 0))
        for _ in range(3):
            drops = [float(np.sum((fresh.T @ left) ** 2)) for fresh in (self._fresh(key, used) for key in keys)]
            if not drops or max(drops) <= 0:
                break
            best = keys[int(np.argmax(drops))]
            fresh = self._fresh(best, used)
            left = left - fresh @ (fresh.T @ left)
            used = np.column_stack([used, fresh])
            if isinstance(self.trials[best].effect, SensorFault):
                # Several gains set free together would scale the measurement away with whatever is in it.
                keys = [key for key in keys if not isinstance(self.trials[key].effect, SensorFault)]
        gone = float(np.sum(self.left**2) - np.sum(left**2))
        return excess, gone / excess if excess > 0 else 0.0

    def _fresh(self, key: str, used: Array) -> Array:
        trial = self.trials[key]
        columns = trial.columns
        if columns.shape[0] != used.shape[0]:  # a sensor fault lives in the smaller space
            columns = self.against_sheet.partial(self._columns(trial.effect))
        left = columns - used @ (used.T @ columns)
        keep = np.linalg.norm(left, axis=0) > 1e-6 * np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        return np.linalg.qr(left[:, keep])[0] if np.any(keep) else np.zeros((used.shape[0], 0))

    def with_ties(self, ranked: Sequence[Candidate]) -> list[Candidate]:
        """For each missing candidate, those whose block losses do not differ from its own."""
        out: list[Candidate] = []
        for c in ranked:
            if c.answer != "missing":
                out.append(c)
                continue
            ties = [
                (other.key, correlation)
                for other in ranked
                if other.key != c.key
                and other.answer == "missing"
                and _same_losses(c.block_gain, other.block_gain)
                and (correlation := self._correlation(c.key, other.key)) >= ALIKE
            ]
            out.append(replace(c, ties=tuple(ties)))
        return out

    def _correlation(self, a: str, b: str) -> float:
        """Largest canonical correlation of two candidates after everything else is partialled out."""
        first, second = self.trials[a].basis[: self.n], self.trials[b].basis[: self.n]
        return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])


def _ratios(fitted: Fit, floor: NoiseFloor) -> dict[str, float]:
    """Residual ÷ floor of each row over the runs used."""
    out: dict[str, float] = {}
    for row in fitted.rows:
        squares = np.concatenate([part[row] ** 2 for part in fitted.residual if row in part])
        out[row] = float(np.sqrt(np.mean(squares))) / floor.sigma[row]
    return out


def _same_losses(a: Array, b: Array) -> bool:
    difference = a - b
    active = np.abs(difference) > 1e-6 * float(np.max(np.abs(a) + np.abs(b)))
    return bool(np.count_nonzero(active) < 6 or scipy.stats.wilcoxon(difference[active]).pvalue > TIED)
