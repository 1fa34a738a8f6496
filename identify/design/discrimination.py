"""Discrimination of effects with nearly the same columns by a run, and detection of an effect not yet testable.

If effect A is the missing one, its columns at its size, y_A = X_A v_A, are in the data. Effect B, the model, the runs'
sensor zeros and the sensor sheet's tolerances imitate it as well as they can; the separation is the remainder

    T = min ‖y_A − X_B θ_B − W θ − Z z‖² / σ² + the priors of θ and z

in squares of the noise floor σ. The weighted squares that A leaves are then below those of B by T on average, with
standard deviation 2 √T: the wrong effect is chosen with probability Φ(−√T / 2). T depends on the motion only, so that
it is predicted for runs not driven yet, on top of the information of the present runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, SensorFault, with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Assembly, Piece
from lacet.identify.regression.model import known_beforehand
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import scaled_triangle
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.tolerances import sheet_responses
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor

NEEDED = 25.0
"""Separation from which two effects count as distinguished: the wrong one is chosen once in 160 times."""
SHOWS = SELECTION.least_size
"""Weighted size √λ from which an effect can be tested, as in the selection."""
DRAWS = 8
"""Draws of the channels' noise behind the floor of a run not driven yet."""
WIDE = 20.0
"""Largest half-axis of a 95 % region of sizes, in units of the size: beyond it nothing is known."""
_GONE = 1e-7
"""Part of a column's length below which it counts as zero."""


def wrong_pick(separation: float) -> float:
    """Probability that of two effects the wrong one fits better: Φ(−√T / 2)."""
    return 0.5 * math.erfc(math.sqrt(max(0.0, separation) / 8.0))


@dataclass(frozen=True)
class Compared:
    """An effect of a given size: `effect` with its shape constants, `values` (p,) of its parameters [SI]."""

    effect: Effect
    values: Array


class Question:
    """The effects to be distinguished, and the layout of their joint regressor.

    Columns in order: the model's physics and sensor faults; the sheet's gains and latencies, then `tolerances`, each
    for one σ; of every effect compared, each shape that the ranking tries, its own first.

    Parameters
    ----------
    fitted : the present model, on the present runs.
    compared : the effects.
    tolerances : sensor faults, other than gains and latencies, that the sheet bounds: fault and 1 σ.

    Attributes
    ----------
    sheet : gains and latencies of the sheet, without those that the model has as faults.
    known : (k, w) priors, as equations with σ = 1 and right side 0.
    first : place of the first effect's columns.
    """

    def __init__(self, fitted: Fit, compared: Sequence[Compared], tolerances: Sequence[tuple[SensorFault, float]] = ()):
        self.fitted, self.compared = fitted, tuple(compared)
        model = fitted.model
        mine = {fault.key for fault in model.faults}
        self.tolerances = tuple((fault, sigma) for fault, sigma in tolerances if fault.key not in mine and sigma > 0.0)
        self.sheet = fitted.sheet_entries
        self.parameters = len(model.parameters)
        self.first = self.parameters + len(self.sheet) + len(self.tolerances)
        self.shapes = [
            [one.effect, *(e for e in one.effect.shapes() if dict(e.shape) != dict(one.effect.shape))]
            for one in self.compared
        ]
        self.places: list[list[slice]] = []
        start = self.first
        for effects in self.shapes:
            self.places.append([place for _, place in with_places(effects, start)])
            start = self.places[-1][-1].stop
        self.width = start
        physics = model.physics_size
        beforehand = known_beforehand(model, np.arange(physics, dtype=np.int64))
        tolerance = np.eye(self.first - self.parameters)
        self.known = np.zeros((len(beforehand) + len(tolerance), self.width))
        self.known[: len(beforehand), : self.parameters] = beforehand
        self.known[len(beforehand) :, self.parameters : self.first] = tolerance

    def own(self, *which: int) -> list[int]:
        """Places of the tolerances that are compared effects: a fault is tested without its own tolerance."""
        effects = [self.compared[i].effect for i in which]
        entries = frozenset[tuple[str, str]]().union(*(effect.sheet_entries for effect in effects))
        keys = {effect.key for effect in effects if effect.as_fault is not None}
        out = [self.parameters + i for i, entry in enumerate(self.sheet) if entry[:2] in entries]
        start = self.parameters + len(self.sheet)
        return out + [start + i for i, (fault, _) in enumerate(self.tolerances) if fault.key in keys]

    def columns(self, piece: Piece) -> Iterator[tuple[Row, Array]]:
        """For each row of a piece of a run, its (n, z + w) columns, the run's zeros first."""
        assert piece.zeros is not None
        assert piece.sensitivity is not None
        model, run, sensitivity = self.fitted.model, piece.prepared, piece.sensitivity
        z, faults = len(piece.zeros.sigma), len(model.faults)
        responses = sheet_responses(run, sensitivity)
        tolerances = [(run.decimated(sensitivity.fault(fault)), sigma) for fault, sigma in self.tolerances]
        tried: list[tuple[slice, Mapping[Row, Array]]] = []
        for effects, places in zip(self.shapes, self.places, strict=True):
            for effect, place in zip(effects, places, strict=True):
                tried.append((place, run.effect_columns(effect, sensitivity)))
        for row, block in piece.blocks.items():
            out = np.zeros((len(block), z + self.width))
            out[:, :z] = block[:, :z]
            part = out[:, z:]
            part[:, : self.parameters - faults] = run.matrix(model.physics, row)
            if faults:
                part[:, self.parameters - faults : self.parameters] = block[:, -faults:]
            for place, entry in enumerate(self.sheet, start=self.parameters):
                if row in responses.get(entry, {}):
                    part[:, place] = responses[entry][row]
            for place, (response, sigma) in enumerate(tolerances, start=self.parameters + len(self.sheet)):
                if row in response:
                    part[:, place] = sigma * response[row]
            for place, found in tried:
                if row in found:
                    part[:, place] = found[row].T
            yield row, out


@dataclass(frozen=True)
class WeightedRun:
    """The weighted equations of one run with its sensor zeros still in them, so that its duration can be changed.

    `root` (z + w, z + w) R factor of ``[zeros | columns]``; `prior` (z,) 1 σ of the zeros; `seconds` duration without
    the filters' transients [s]; `edges` that of the transients [s].
    """

    root: Array
    prior: Array
    seconds: float
    edges: float

    def lasting(self, duration: float | None = None) -> Array:
        """(w, w) R factor of a run of this kind that lasts `duration` [s], by default its own duration.

        Squares grow with the time driven; the zeros' priors do not.
        """
        share = 1.0 if duration is None else max(0.0, duration - self.edges) / self.seconds
        z = len(self.prior)
        known = np.zeros((z, self.root.shape[1]))
        known[:, :z] = np.diag(1.0 / self.prior)
        return _merged(known, np.sqrt(share) * self.root)[z:, z:]


@dataclass(frozen=True)
class Present:
    """Information of a fit's runs on the effects compared.

    `root` (w, w) R factor of their columns, weighted by their noise floor; `noise` (w, w) the same of the noise in the
    columns themselves, which distinguishes nothing.
    """

    root: Array
    noise: Array


def present_runs(question: Question, floor: NoiseFloor, louder: Mapping[Row, float] | None = None) -> Present:
    """The information of a fit's runs, weighted by their noise floor.

    `louder` : row → factor of its noise over the sheet's; 1 where absent.
    """
    assembly = question.fitted.assembly
    larger = {row: (louder or {}).get(row, 1.0) for row in floor.sigma}
    sigma = {row: floor.sigma[row] * larger[row] for row in floor.sigma}
    roots: list[Array] = []
    noise: list[Array] = []
    for run in range(len(assembly.runs)):
        pieces = list(assembly.pieces_of(run))
        roots.append(weighted_run(question, pieces, sigma).lasting())
        noise.append(_column_noise(question, pieces, floor.sigma))
    return Present(_merged(*roots), _merged(*noise))


def _column_noise(question: Question, pieces: Sequence[Piece], sigma: Mapping[Row, float]) -> Array:
    """(w, w) R factor of the noise in a run's columns, by a draw added and subtracted; of a long run by its middle.

    Louder sensors add to the noise and lower the weight alike.
    """
    piece = pieces[len(pieces) // 2]
    assert piece.sensitivity is not None
    assert piece.zeros is not None
    z = len(piece.zeros.sigma)
    moved: list[dict[Row, Array]] = []
    for noisy in piece.noisy([2003, piece.run]):
        own = replace(noisy, sensitivity=piece.sensitivity.on(noisy.prepared.recording))
        moved.append(dict(question.columns(own)))
    share = sum(map(_samples, pieces)) / _samples(piece)
    parts = [(plus - moved[1][row])[:, z:] * (0.5 * np.sqrt(share) / sigma[row]) for row, plus in moved[0].items()]
    return _merged(np.zeros((0, question.width)), *parts)


def _samples(piece: Piece) -> int:
    return sum(len(block) for block in piece.blocks.values())


def planned_run(
    question: Question, run: PreparedRun, louder: Mapping[Row, float] | None = None, draws: int = DRAWS, seed: int = 0
) -> WeightedRun:
    """Weighted equations of a planned motion, measured by the rig's sensors and weighted by their noise in its rows."""
    fitted = question.fitted
    model = fitted.model
    every = np.arange(len(fitted.physics), dtype=np.int64)
    at = ExpansionPoint(fitted.physics)
    pieces = list(Assembly(model.physics, every, model.faults, [run], at, zeros=True).pieces())
    squares: dict[Row, float] = dict.fromkeys(run.rows, 0.0)
    counts: dict[Row, int] = dict.fromkeys(run.rows, 0)
    rng = np.random.default_rng([seed, draws])
    for piece in pieces:
        assert piece.sensitivity is not None
        for _ in range(draws):
            for row, noise in piece.prepared.decimated(piece.sensitivity.noise(rng)).items():
                squares[row] += float(np.sum(noise**2))
                counts[row] += noise.size
    sigma: dict[Row, float] = {}
    for row in run.rows:
        floor = float(np.sqrt(squares[row] / max(1, counts[row]))) * (louder or {}).get(row, 1.0)
        # A row without noise would get infinite weight; 1e-9 of its size stands for rounding.
        sigma[row] = max(floor, 1e-9 * float(np.max(np.abs(run.measured[row]), initial=1.0)))
    return weighted_run(question, pieces, sigma)


def weighted_run(question: Question, pieces: Sequence[Piece], sigma: Mapping[Row, float]) -> WeightedRun:
    """The equations of one run, piece by piece, weighted by the rows' `sigma`."""
    zeros = pieces[0].zeros
    assert zeros is not None
    root = np.zeros((0, len(zeros.sigma) + question.width))
    seen: dict[Row, int] = {}
    for piece in pieces:
        parts = [columns / sigma[row] for row, columns in question.columns(piece)]
        root = _merged(root, *parts)
        for row, block in piece.blocks.items():
            seen[row] = seen.get(row, 0) + len(block)
    filters = pieces[0].prepared.recording.filters
    seconds = max(seen.values(), default=1) * filters.step / filters.rate
    return WeightedRun(root, zeros.sigma, seconds, 2.0 * filters.edge)


class Separations:
    """Separations of the effects compared, by several runs together.

    Parameters
    ----------
    question : the effects compared.
    present : information of the runs at hand; None where there are none.
    runs : (w, w) R factors of runs to come (`WeightedRun.lasting`).
    """

    def __init__(self, question: Question, present: Present | None, *runs: Array):
        self.question = question
        whole = _merged(question.known, *((present.root,) if present else ()), *runs)
        # Tolerances that are compared effects themselves come after all other nuisance parameters.
        own = question.own(*range(len(question.compared)))
        taken = [i for i in range(question.first) if i not in own]
        order = [*taken, *own, *range(question.first, question.width)]
        R, lengths = scaled_triangle(whole[:, order])
        t = len(taken)
        # Columns are in units of their own length before nuisance parameters are removed.
        self._remaining = R[t:, t:]
        self._noise = np.zeros((0, len(order) - t))
        if present is not None:
            explained = np.asarray(scipy.linalg.solve_triangular(R[:t, :t], R[:t, t:]), float)
            noise = present.noise[:, order] / lengths
            self._noise = noise[:, t:] - noise[:, :t] @ explained
        self._place = {place: i for i, place in enumerate(order[t:])}
        self._length = {place: float(length) for place, length in zip(order[t:], lengths[t:], strict=True)}

    def separation(self, a: int, b: int) -> float:
        """T of effect `a` at its size from effect `b` at any size, for the shape of `b` that imitates it best."""
        q = self.question
        free = [i for i in q.own(*range(len(q.compared))) if i not in q.own(a, b)]
        effect = q.places[a][0], q.compared[a].values
        return min(self.remaining(*effect, [*free, *_places(place)]) for place in q.places[b])

    def least(self, which: Sequence[int] | None = None) -> float:
        """The smallest separation of any two of the effects, either of them being the missing one."""
        chosen = range(len(self.question.compared)) if which is None else which
        pairs = combinations(chosen, 2)
        return min((min(self.separation(a, b), self.separation(b, a)) for a, b in pairs), default=np.inf)

    def size(self, a: int, values: Array | None = None) -> float:
        """√λ of effect `a` at `values`, by default as given: its size relative to the noise, beside no other effect."""
        q = self.question
        theta = q.compared[a].values if values is None else values
        return float(np.sqrt(self.remaining(q.places[a][0], theta, q.own(*range(len(q.compared))))))

    def remaining(self, place: slice, values: Array, others: Sequence[int] = ()) -> float:
        """Weighted squares of columns times values that model, zeros, sheet and the columns `others` do not explain."""
        x = self._unexplained(place, values, others)
        return max(0.0, float(np.sum((self._remaining @ x) ** 2) - np.sum((self._noise @ x) ** 2)))

    def closest(self) -> list[int]:
        """The two effects that are least apart; the first alone where there is no other."""
        pairs = combinations(range(len(self.question.compared)), 2)
        apart = {pair: min(self.separation(*pair), self.separation(*reversed(pair))) for pair in pairs}
        return list(min(apart, key=lambda pair: apart[pair])) if apart else [0]

    def information(self, which: Sequence[int]) -> Array:
        """(n, n) information on the sizes of effects fitted together, each in units of the size it is taken at.

        The inverse is their covariance; it is positive semidefinite, and singular where the runs leave it open.
        """
        q = self.question
        free = [i for i in q.own(*range(len(q.compared))) if i not in q.own(*which)]
        x = np.column_stack([self._unexplained(q.places[i][0], q.compared[i].values, free) for i in which])
        found, noise = self._remaining @ x, self._noise @ x
        values, vectors = np.linalg.eigh(found.T @ found - noise.T @ noise)
        return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, float)

    def _unexplained(self, place: slice, values: Array, others: Sequence[int]) -> Array:
        """Columns times values, with the multiples of the columns `others` that imitate them best removed."""
        x = np.zeros(self._remaining.shape[1])
        for i, value in zip(_places(place), values, strict=True):
            x[self._place[i]] = value * self._length[i]
        if others:
            where = [self._place[i] for i in others]
            U, s, Vt = np.linalg.svd(self._remaining[:, where], full_matrices=False)
            kept = s > _GONE
            x[where] -= Vt[kept].T @ ((U[:, kept].T @ (self._remaining @ x)) / s[kept])
        return x


def region(information: Array, points: int = 72) -> Array:
    """(points, n) edge of the 95 % region of n sizes about 1, n = 1 or 2, for their (n, n) information.

    Directions that are left open reach to `WIDE`.
    """
    n = len(information)
    values, vectors = np.linalg.eigh(information)
    half = np.sqrt(float(scipy.special.chdtri(n, 0.05)) / np.maximum(values, 1e-12))
    half = np.minimum(half, WIDE)
    if n == 1:
        return np.array([[1.0 - half[0]], [1.0 + half[0]]])
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.asarray(1.0 + (vectors * half) @ np.stack([np.cos(angle), np.sin(angle)]), float).T


def _places(place: slice) -> range:
    return range(place.start, place.stop)


def _merged(*parts: Array) -> Array:
    """(w, w) R factor of stacked parts, accurate for columns of very different lengths."""
    R, lengths = scaled_triangle(np.concatenate(parts))
    return R * lengths
