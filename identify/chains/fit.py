"""Weighted least squares of a chain with laws of its joints: base parameters, robust weights, intervals."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.errors import NotIdentifiable, nearest
from lacet.daq.expressions.expression import Expression
from lacet.identify.chains.cutoffs import FewEquations
from lacet.identify.chains.model import ChainModel
from lacet.identify.chains.samples import JointSamples
from lacet.identify.chains.weights import ALONE, second_weights, serial_quantile, solved_together, student
from lacet.identify.multibody.base_parameters import BaseParameters, find_base
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.uncertainty import at_least, clustered_scores, hac
from lacet.identify.selection.settings import SELECTION

_UNSEEN = 1e-7
"""Part of a base parameter's column, orthogonal to those before it, below which the motion does not determine it."""
_ROUNDS = 20
"""Repetitions of a fit whose columns depend on the parameters."""
_STILL = 0.01
"""Change of every parameter ÷ its σ at which these end [ratio]."""
_ROBUST_ROUNDS = 10
"""Repetitions of a fit with robust weights."""
_ROUNDED = 5e-6
"""Largest difference of a factor that is asked for from the grouping's, ÷ the latter [ratio]. Source: groupings are
printed with six digits."""
_BY_CHANCE = 0.0027
"""Part of the equations of a joint that stands still which noise puts beyond three σ of its rate, either way, which is
the default limit [probability]. Source: the normal distribution."""
_CLOSE = 1e-6
"""The same ÷ the largest factor asked for, or 1 [ratio]: numerical."""


@dataclass(frozen=True)
class ChainEstimate:
    """A combination of parameters that torques and motion determine.

    Attributes
    ----------
    name : its first parameter.
    group : the combination in numbers, ``ZZ1 + YY2 + 0.16 M3``.
    value, sigma, half : estimate, its 1 σ, and half of its 95 % interval [SI].
    least : 1 σ as if residuals were independent, as publications print it.
    """

    name: str
    group: str
    value: float
    sigma: float
    half: float
    least: float


@dataclass(frozen=True)
class ChainFit:
    """A chain fitted to samples.

    Attributes
    ----------
    model : what was fitted.
    base : grouping of the parameters; those in `unseen` are not determined by this motion, and taken as 0.
    unseen : names of base parameters that the motion does not determine.
    x : (b,) base parameters.
    covariance, independent : (b, b) for correlated residuals, and as if they were independent.
    sigma : (f,) σ of each joint's equations [N·m, N]: the root of its sum of squares ÷ `freedom`.
    freedom : (f,) degrees of freedom of each joint's residual: equations less the parameters' part in them.
    shares : (f, b, b) what each joint's noise has in `independent`.
    serial : (b, b) covariance for correlated residuals alone; in `covariance` no σ is below that of `independent`.
    seconds, cutoff : length of the record [s], cut-off of the equations [Hz].
    W, y : (m, f, b), (m, f) equations after filter and decimation; `used` (m, f) those that count; `weights` (m, f).
    measured : (m, f) torques [N·m, N] that `y` was formed of: the same where no column depends on parameters.
    t : (m,) times since the first sample [s].
    """

    model: ChainModel
    base: BaseParameters
    unseen: tuple[str, ...]
    x: Array
    covariance: Array
    independent: Array
    sigma: Array
    freedom: Array
    shares: Array = field(repr=False)
    serial: Array = field(repr=False)
    seconds: float
    cutoff: float
    W: Array = field(repr=False)
    y: Array = field(repr=False)
    used: NDArray[np.bool_] = field(repr=False)
    weights: Array = field(repr=False)
    t: Array = field(repr=False)
    measured: Array = field(repr=False)

    @property
    def residual(self) -> Array:
        """(m, f) measured less modelled torque; NaN where an equation does not count."""
        return np.where(self.used, self.y - self.W @ self.x, np.nan)

    @cached_property
    def standard(self) -> Array:
        """(p,) values of all parameters that give these torques: those of the base parameters, 0 for the others."""
        out = np.zeros(len(self.model.names))
        out[self.base.independent] = self.x
        return out

    @cached_property
    def estimates(self) -> tuple[ChainEstimate, ...]:
        """All base parameters that the motion determines."""
        names = [self.base.names[int(k)] for k in self.base.independent]
        unit = np.eye(len(names))
        return tuple(
            self._estimate(name, self.base.describe(i, 0.0), unit[i])
            for i, name in enumerate(names) if name not in self.unseen
        )  # fmt: skip

    def _estimate(self, name: str, group: str, g: Array) -> ChainEstimate:
        """The sum g·x (b,): the wider of the intervals for independent residuals (Student) and for correlated ones."""
        least, serial = (float(np.sqrt(max(0.0, g @ C @ g))) for C in (self.independent, self.serial))
        half = max(student(np.einsum("i,kij,j->k", g, self.shares, g), self.freedom) * least,
                   serial_quantile(len(self.t)) * serial)  # fmt: skip
        return ChainEstimate(name, group, float(g @ self.x), max(least, serial), half, least)

    @property
    def wrong_signs(self) -> tuple[ChainEstimate, ...]:
        """Base parameters that are negative by more than chance and effect size, though none of their parts can be.

        Chance is family-wise over all that cannot be negative (Bonferroni), and their torque is more than the user's
        effect size of what its joint's torque varies by.
        """
        grouping, never = self.base.grouping(), self.model.never_negative
        held = [all(f >= 0.0 and (f == 0.0 or name in never) for f, name in zip(row, self.base.names, strict=True))
                for row in grouping]  # fmt: skip
        # In halves of 95 % intervals, which are as much wider as few equations make them.
        quantile = float(scipy.stats.norm.isf(SELECTION.significance / max(1, sum(held)))) / SELECTION.interval_quantile
        names = [self.base.names[int(k)] for k in self.base.independent]
        return tuple(
            one for one in self.estimates
            if held[i := names.index(one.name)] and one.value < -quantile * one.half and self._matters(i)
        )  # fmt: skip

    def _matters(self, i: int) -> bool:
        """Whether a base parameter's torque is more than the user's effect size, at any joint."""
        torque = np.where(self.used, self.W[:, :, i] * self.x[i], np.nan)
        measured = np.where(self.used, self.y, np.nan)
        least = SELECTION.effect_size * np.nanstd(measured, axis=0)
        return bool(np.any(np.sqrt(np.nanmean(torque**2, axis=0)) > least))

    def combination(self, text: str) -> ChainEstimate:
        """The estimate of a sum of parameters, ``ZZ1 + YY2 + 0.16*M3``; ``Izz1`` and ``fv1`` are read as well.

        Raises NotIdentifiable where torques and motion do not determine it, KeyError for an unknown name, ValueError
        for what is no sum of parameters.
        """
        expression = Expression.parse(text)
        known = {name.upper(): i for i, name in enumerate(self.base.names)}
        found: dict[str, int] = {}
        for symbol in sorted(expression.symbols):
            upper = symbol.upper()
            place = known.get(upper, known.get(upper[1:]) if upper.startswith("I") else None)
            if place is None:
                raise KeyError(f"there is no parameter '{symbol}'{nearest(upper, known)}")
            found[symbol] = place
        nothing = dict.fromkeys(found, 0.0)
        constant = expression.value(nothing)
        c = np.zeros(len(self.base.names))
        for symbol, place in found.items():
            c[place] += expression.value({**nothing, symbol: 1.0}) - constant
        ones = expression.value({s: 0.5 + i for i, s in enumerate(found)})
        if constant != 0.0 or abs(sum(c[k] * (0.5 + i) for i, k in enumerate(found.values())) - ones) > 1e-9 * max(
            1.0, abs(ones)
        ):
            raise ValueError(f"'{text}' is no sum of parameters")
        g = c[self.base.independent]
        grouping = self.base.grouping()
        allowed = np.maximum(_CLOSE * max(1.0, float(np.max(np.abs(c)))), _ROUNDED * np.abs(g) @ np.abs(grouping))
        off = np.abs(g @ grouping - c) > allowed
        off[self.base.absent] = False
        if np.any(off):
            lost = ", ".join(self.base.names[int(k)] for k in np.flatnonzero(off)[:4])
            raise NotIdentifiable(
                f"torques do not determine '{text}': {lost} would have to be in it with other factors"
            )
        names = [self.base.names[int(k)] for k in self.base.independent]
        if unseen := [name for name, part in zip(names, g, strict=True) if part and name in self.unseen]:
            raise NotIdentifiable(f"this motion does not determine {', '.join(unseen)}, which is part of '{text}'")
        return self._estimate(text, text, g)


def fit_chain(model: ChainModel, samples: JointSamples, slowest: Array, robust: bool = False) -> ChainFit:
    """Fit a model to samples.

    Parameters
    ----------
    slowest : (f,) rate below which a joint's equation does not count [rad/s, m/s]: the sign of its friction is
        uncertain there.
    robust : whether seconds with large residuals count less.

    Raises NotIdentifiable when there is no equation, none for a joint, or fewer than parameters.
    """
    keep = model.base.independent
    kept = samples.kept
    if not kept.size:
        raise NotIdentifiable("nothing of the record remains between its gaps and the filters' transients there")
    speed = np.abs(samples.qd[kept])
    used = (speed >= slowest) & (speed > 0.0)
    _refuse_still(model, used)
    record = len(samples.q) / samples.filters.rate, samples.filters.fit_cutoff
    standard: Array | None = None
    rounds = _ROUNDS if model.iterates else 1
    while True:
        equations = model.equations(samples, standard)
        W, y = equations if standard is None else model.about(*equations, standard)
        t = kept / samples.filters.rate
        found = _solved(model, W[:, :, keep], y, used, t, robust, record, equations[1])
        before, standard, rounds = standard, found.standard, rounds - 1
        step = np.inf if before is None else np.abs(standard - before)[keep]
        if rounds <= 0 or np.all(step <= _STILL * np.sqrt(np.diag(found.independent))):
            return found


def _refuse_still(model: ChainModel, used: NDArray[np.bool_]) -> None:
    """Raises NotIdentifiable for joints that have no more equations `used` (m, f) than noise alone gives them."""
    chance = np.asarray(scipy.stats.binom.sf(np.count_nonzero(used, axis=0) - 1, len(used), _BY_CHANCE), float).tolist()
    names = [model.chain.names[j - 1] for j in model.chain.coupling.free]
    still = [name for name, p in zip(names, chance, strict=True) if p > SELECTION.significance]
    if len(still) == len(names):
        raise NotIdentifiable("no joint moves faster than the limit (slowest): there is no equation")
    if still:
        raise NotIdentifiable(
            f"{', '.join(still)} never moves faster than the limit (slowest), but by noise: no equation. Make it fixed "
            "where it stands (sigma: 2 in a table, type fixed in a URDF) and give q and tau without its column: the "
            "others are identified so"
        )


def refitted(fitted: ChainFit) -> ChainFit:
    """The fit again to those of its equations that are `used`. Raises NotIdentifiable as `fit_chain`."""
    record = fitted.seconds, fitted.cutoff
    return _solved(fitted.model, fitted.W, fitted.y, fitted.used, fitted.t, False, record, fitted.measured)


def _solved(
    model: ChainModel, W: Array, y: Array, used: NDArray[np.bool_], t: Array, robust: bool,
    record: tuple[float, float], measured: Array,
) -> ChainFit:  # fmt: skip
    base = model.base
    if not np.all(np.any(used, axis=0)):
        joint = model.chain.names[model.chain.coupling.free[int(np.argmin(np.any(used, axis=0)))] - 1]
        raise NotIdentifiable(f"{joint} never moves faster than the limit: it has no equation")
    names = [base.names[int(k)] for k in base.independent]
    joints = range(y.shape[1])
    weighted = [W[used[:, k], k] / (float(np.std(y[used[:, k], k])) or 1.0) for k in joints]
    seen = find_base(np.concatenate(weighted), names, _UNSEEN).independent
    few = FewEquations(record[0], int(np.count_nonzero(used)), record[1], len(seen))
    if few.equations <= few.values:
        raise NotIdentifiable(str(few))
    W_seen = W[:, :, seen]
    weights = np.ones_like(y)
    found = solved_together(W_seen, y, used, weights)
    for _ in range(_ROBUST_ROUNDS if robust else 0):
        before, weights = weights, second_weights(y - W_seen @ found.x, used, t)
        found = solved_together(W_seen, y, used, weights)
        if np.max(np.abs(weights - before)) < 1e-3:
            break
    if np.any(found.freedom < ALONE):
        k = int(np.argmin(found.freedom))
        joint = model.chain.names[model.chain.coupling.free[k] - 1]
        raise NotIdentifiable(
            f"{few}. The fit goes through all {np.count_nonzero(used[:, k])} equations "
            f"of {joint}, so that they do not show its noise"
        )
    residual = np.where(used, y - W_seen @ found.x, 0.0)
    counts = np.count_nonzero(used, axis=0)
    # What the fit takes away from each joint's residual is given back: its squares ÷ n − tr H.
    whole = residual * np.sqrt(counts / found.freedom)
    rows = {k: (W_seen[:, k] * (weights[:, k] ** 2)[:, None], whole[:, k], float(found.sigma[k])) for k in joints}
    scores = clustered_scores(rows, dict.fromkeys(joints, np.arange(len(t))), len(t))
    bread = found.covariance
    serial = bread @ hac(scores) @ bread
    every = np.zeros(len(names))
    every[seen] = found.x
    unseen = tuple(name for i, name in enumerate(names) if i not in set(seen.tolist()))

    def placed(C: Array) -> Array:
        out = np.zeros((*C.shape[:-2], len(names), len(names)))
        out[(..., *np.ix_(seen, seen))] = C
        return out

    return ChainFit(
        model, base, unseen, every, placed(at_least(serial, bread)), placed(bread), found.sigma, found.freedom,
        placed(found.shares), placed(serial), *record, W, y, used, weights, t, measured,
    )  # fmt: skip
