"""A ranking by dense weighted least squares, with every zero and tolerance as a column of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lacet.daq.rig import Rig
from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.tolerances import sheet_responses
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.blocks import BLOCK
from lacet.identify.validation.noise_floor import NoiseFloor


@dataclass
class Dense:
    """All samples of all rows of all runs, weighted, with every column: [zeros of each run | model | sheet | faults].

    `prior` holds 1 / σ of each column (0 for the model's), `known` what is known of the model's parameters.
    """

    fitted: Fit
    floor: NoiseFloor
    space: ScoreTests

    @cached_property
    def prior_stiffening(self) -> float:
        """RMS of residual ÷ simulated ones, zeros and the sheet's gains and latencies taken out of both; 1 at least."""
        columns, inverse, right = self.table
        last = len(inverse) - len(self.faults)
        prior = self.prior_of(inverse)[:, :last]
        sides = np.column_stack([right, *(self.noise(draw) for draw in range(self.floor.count))])
        both = np.concatenate([columns[:, :last], prior])
        lengths = np.linalg.norm(both, axis=0)
        lengths[lengths == 0.0] = 1.0
        known = np.zeros((len(prior), sides.shape[1]))
        known[:, 0] = prior @ self.mean[:last]
        full = np.concatenate([sides, known])
        left = (full - both / lengths @ np.linalg.lstsq(both / lengths, full, rcond=1e-13)[0])[: len(columns)]
        names = np.concatenate([np.full(self.fitted.runs[r].index[row].size, row) for r, row in self.parts()])
        squares = np.array([np.sum(left[names == row] ** 2, axis=0) for row in self.floor.sigma])
        return max(1.0, float(np.sqrt(np.mean(squares[:, 0] / np.mean(squares[:, 1:], axis=1)))))

    @cached_property
    def faults(self) -> list[SensorFault]:
        """Those that stand for their own tolerance: neither gain nor latency, which stand there by channel."""
        found = [e for e in self.space.effects.values() if isinstance(e, SensorFault)]
        return [e for e in found if e.tolerance not in ("gain", "latency", "drift") and self.bound(e) > 0.0]

    def bound(self, fault: SensorFault) -> float:
        """Its tolerance."""
        return max(self.rig.tolerance(channel, fault.tolerance) for channel in fault.channels())

    @property
    def rig(self) -> Rig:
        """With the sheet."""
        return self.fitted.runs[0].recording.rig

    def parts(self) -> list[tuple[int, str]]:
        """Run and row of every stretch of samples."""
        return [(r, row) for r, drive in enumerate(self.fitted.runs) for row in drive.rows]

    @cached_property
    def base(self) -> tuple[Array, Array, Array]:
        """(n, m) columns, (m,) 1 / σ with stiffened priors, (n,) what the fit's parameters leave."""
        columns, inverse, right = self.table
        return columns, self.prior_stiffening * inverse, right

    @cached_property
    def table(self) -> tuple[Array, Array, Array]:
        """(n, m) columns, (m,) 1 / σ, (n,) what the fit's parameters leave."""
        fitted, keep = self.fitted, self.fitted.base.independent
        zeros = [zeros_of(d, s) for d, s in zip(fitted.runs, fitted.sensitivities, strict=True)]
        sheets = [sheet_responses(d, s) for d, s in zip(fitted.runs, fitted.sensitivities, strict=True)]
        entries = list(dict.fromkeys(entry for sheet in sheets for entry in sheet))
        faults = np.column_stack([self.column(e) for e in self.faults]) if self.faults else None
        out, right = [], []
        for r, row in self.parts():
            drive, sigma = fitted.runs[r], self.floor.sigma[row]
            W = drive.matrix(fitted.model.physics, row)[:, keep]
            own = [z.columns[row] if k == r else np.zeros((len(W), len(z.names))) for k, z in enumerate(zeros)]
            sheet = np.column_stack([sheets[r].get(e, {}).get(row, np.zeros(len(W))) for e in entries])
            out.append(np.concatenate([*own, W, sheet], axis=1) / sigma)
            right.append((drive.measured[row] - W @ fitted.theta[keep]) / sigma)
        columns = np.concatenate(out)
        if faults is not None:
            columns = np.concatenate([columns, faults], axis=1)
        known = np.concatenate(
            [
                *(1.0 / z.sigma for z in zeros), np.zeros(len(keep)), np.ones(len(entries)),
                [1.0 / self.bound(e) for e in self.faults],
            ]
        )  # fmt: skip
        return columns, known, np.concatenate(right)

    @cached_property
    def prior(self) -> Array:
        """(k, m) equations of what is known beforehand, right side 0."""
        return self.prior_of(self.base[1])

    def prior_of(self, inverse: Array) -> Array:
        """The same for columns of 1 / σ `inverse`."""
        start = sum(len(names) for names, _, _ in self.fitted.zeros)
        # About the fit, and no narrower than it went itself.
        known = np.array([line / np.hypot(1.0, line @ self.fitted.solution) for line in self.fitted.equations.known])
        model = np.zeros((len(known), len(inverse)))
        model[:, start : start + known.shape[1]] = known
        return np.concatenate([np.diag(inverse), model])

    def column(self, effect: Effect) -> Array:
        """(n, p) weighted columns of a candidate."""
        out = []
        made = []
        for drive, sensitivity in zip(self.fitted.runs, self.fitted.sensitivities, strict=True):
            if isinstance(effect, SensorFault):
                made.append({row: a[None] for row, a in drive.decimated(sensitivity.fault(effect)).items()})
            else:
                made.append(drive.columns(effect))
        for r, row in self.parts():
            n = len(self.fitted.runs[r].index[row])
            out.append(made[r].get(row, np.zeros((len(effect.parameters), n))).T / self.floor.sigma[row])
        return np.concatenate(out)

    @cached_property
    def block(self) -> Array:
        """(n,) number of each sample's two seconds, counted over all runs."""
        first, starts = 0, []
        numbers: dict[tuple[int, str], Array] = {}
        for r, drive in enumerate(self.fitted.runs):
            filters = drive.recording.filters
            for row, index in drive.index.items():
                numbers[r, row] = index // filters.step * filters.step / filters.rate // BLOCK
            starts.append(first)
            first += 1 + int(max(numbers[r, row].max() for row in drive.rows))
        return np.concatenate([starts[r] + numbers[r, row] for r, row in self.parts()])

    def noise(self, draw: int) -> Array:
        """(n,) one simulated run."""
        return np.concatenate([self.floor.draws[r].whole(row)[draw] / self.floor.sigma[row] for r, row in self.parts()])

    @cached_property
    def mean(self) -> Array:
        """(m,) where what is known of each column is: the rig's latencies, told from those the runs were read at."""
        out = np.zeros(len(self.table[1]))
        sheet = list(dict.fromkeys(self.space.layout.sheet))
        first = len(out) - len(self.faults) - len(sheet)
        for entry, latencies in self.space.linearisation.latencies.items():
            out[first + sheet.index(entry)] = -latencies / self.rig.tolerance(entry[1], "latency")
        return out

    def solve(
        self, right: Array, more: Array | None = None, kept: Array | None = None, drawn: bool = False
    ) -> tuple[float, Array, Array]:
        """Least squares with priors over the samples `kept`: the least, the solution (with `more`), what is left.

        What is known of a `drawn` run is zero.
        """
        A, P = self.base[0], self.prior
        if more is not None:
            A = np.column_stack([A, more])
            P = np.column_stack([P, np.zeros((len(P), more.shape[1]))])
        kept = np.ones(len(A), bool) if kept is None else kept
        known = np.zeros(len(P)) if drawn else self.prior @ self.mean
        big, side = np.concatenate([A[kept], P]), np.concatenate([right[kept], known])
        lengths = np.linalg.norm(big, axis=0)
        lengths[lengths == 0.0] = 1.0
        x = np.linalg.lstsq(big / lengths, side, rcond=1e-13)[0] / lengths
        return float(np.sum((side - big @ x) ** 2)), x, right - A @ x

    def fall(self, more: Array) -> float:
        """Blocked cross-validation: fitted outside each fold, with and without `more`, and compared inside."""
        A, right, out = self.base[0], self.base[2], 0.0
        for fold in range(SELECTION.folds):
            inside = self.block % SELECTION.folds == fold
            without, both = self.solve(right, None, ~inside)[1], self.solve(right, more, ~inside)[1]
            out += float(np.sum((right[inside] - A[inside] @ without) ** 2))
            out -= float(np.sum((right[inside] - np.column_stack([A, more])[inside] @ both) ** 2))
        return out

    def unknown(self, place: int) -> Dense:
        """The same with one column's prior removed."""
        columns, inverse, right = self.base
        inverse = inverse.copy()
        inverse[place] = 0.0
        return self._with(columns, inverse, right)

    def without(self, place: int) -> Dense:
        """The same with one column held at what is known of it."""
        columns, inverse, right = self.base
        right = right - columns[:, place] * self.mean[place]
        columns = columns.copy()
        columns[:, place] = 0.0
        return self._with(columns, inverse, right)

    def _with(self, *base: Array) -> Dense:
        out = Dense(self.fitted, self.floor, self.space)
        out.__dict__["base"] = base
        return out
