"""What makes a fitted chain unsound: signs, delays, order of columns, impossible values, noise, few equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.chains.clipping import ClippedTorque
from lacet.identify.chains.effects import AsymmetricCoulomb, CoulombFriction, JointEffect, ViscousFriction
from lacet.identify.chains.exchanges import ExchangedJoints
from lacet.identify.chains.fit import ChainEstimate, ChainFit, fit_chain
from lacet.identify.chains.gaps import Gap, Leap
from lacet.identify.chains.samples import JointSamples, Recorded
from lacet.identify.chains.weights import FEW, serial_quantile, solved_together
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.uncertainty import hac
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import Filters, derivative

_ALIKE = 1e-6
"""Difference of two likelihoods ÷ either at which two choices of signs are one: all signs turned [ratio]: numerical."""
_PAIRS = 8
"""Draws of noise, each added and subtracted, where the first show that it may matter [count]. Source: its time."""
_SLOW = 5.0
"""Sample rate below which times may be milliseconds, or the rate kHz [Hz]: controllers of joints sample faster, and up
to a thousand times that."""
_TURNS = 4.0 * np.pi
"""Positions beyond which a turning joint may be given in degrees [rad]: few joints turn twice."""
_CLEARLY = 0.5
"""Error of each joint with positions read as degrees ÷ as they are, below which they are in degrees [ratio]. Source:
far from what another law explains at every joint, and from 1."""
_SHIFTS = 4
"""Largest number of times that a delay is removed and estimated again [count]."""
_SETTLED = 0.05
"""Part of a delay from which what remains of it is removed, too [ratio]. Source: its interval is about as wide."""
_MOST = 0.5
"""Part of what remains, in weighted squares, that a delay explains where it is its cause [share]. Source: the larger
part."""
_MADE = 0.5
"""Part of a law's size that the positions' noise moves it by, from which it may have made it [ratio]. Source: the
larger part."""
_FRICTION = ViscousFriction, CoulombFriction, AsymmetricCoulomb
"""Laws whose columns have the sign of the joint's rate."""


@dataclass(frozen=True)
class TurnedTorque:
    """A joint whose torque fits with the opposite sign.

    Attributes
    ----------
    joint : its name.
    seen_at : the joint where the error falls most; a turned torque makes it at the joints before.
    sigma, turned : σ of that joint's equations as the signs are given, and with all these torques turned [N·m, N].
    """

    joint: str
    seen_at: str
    sigma: float
    turned: float


@dataclass(frozen=True)
class LateTorques:
    """Torques that are later than the positions by `delay`, and half of its 95 % interval [s]; below 0 earlier."""

    delay: float
    half: float


@dataclass(frozen=True)
class Doubts:
    """Reasons not to trust a fit.

    Attributes
    ----------
    turned : joints whose torques fit with the opposite sign.
    wrong_signs : values that are negative beyond chance, though they cannot be, and not by the positions' noise.
    biased : values that the noise of the positions moves by a large part of their intervals (`noise_bias`); `moved` by
        how much, by name.
    few : whether a joint has so few equations that its noise is hardly known (`FEW`).
    in_degrees : turning joints whose positions are degrees (`in_degrees`).
    late : delay of all torques behind the positions, where it matters (`late_torques`).
    exchanged : two joints whose columns are exchanged (`exchanged_joints`); what would follow from that is no doubt
        beside it: signs of torques, delays, values that cannot be.
    in_milliseconds : whether the times of the samples are milliseconds (`in_milliseconds`).
    clipped : torques that stop at a largest value (`clipped_torques`).
    gaps, leaps : times without samples that are not fitted, and positions that leap. They are no doubt of what is
        fitted.
    """

    turned: tuple[TurnedTorque, ...] = ()
    wrong_signs: tuple[ChainEstimate, ...] = ()
    biased: tuple[ChainEstimate, ...] = ()
    few: bool = False
    in_degrees: tuple[str, ...] = ()
    late: LateTorques | None = None
    moved: Mapping[str, float] = field(default_factory=dict[str, float])
    exchanged: ExchangedJoints | None = None
    in_milliseconds: bool = False
    clipped: tuple[ClippedTorque, ...] = ()
    gaps: tuple[Gap, ...] = ()
    leaps: tuple[Leap, ...] = ()


def doubts_of(
    fitted: ChainFit, bias: Array, degrees: tuple[str, ...] = (), late: LateTorques | None = None,
    exchanged: ExchangedJoints | None = None,
) -> Doubts:  # fmt: skip
    """Reasons that a fit itself gives, beside the bias (b,) by noise of the positions, their unit, delays, order."""
    names = [fitted.base.names[int(k)] for k in fitted.base.independent]
    moved = {one.name: abs(float(bias[names.index(one.name)])) for one in fitted.estimates}
    biased = tuple(one for one in fitted.estimates if moved[one.name] > SELECTION.confounded_interval * one.half)
    known = {one.name for one in biased}
    wrong = tuple(one for one in fitted.wrong_signs if one.name not in known)
    few, by = bool(np.any(fitted.freedom < FEW)), {one.name: moved[one.name] for one in biased}
    if exchanged is not None:
        return Doubts(biased=biased, few=few, in_degrees=degrees, moved=by, exchanged=exchanged)
    return Doubts(turned_torques(fitted), wrong, biased, few, degrees, late, by)


def in_degrees(fitted: ChainFit, recorded: Recorded, filters: Filters, slowest: Array) -> tuple[str, ...]:
    """Turning joints whose positions are degrees: they are large, and fit those joints far better as such.

    All turning joints, or those alone that are large. `slowest` : (f,) rates below which a joint's equations are not
    fitted [rad/s, m/s], as in the fit.
    """
    chain = fitted.model.chain
    turning = np.array([chain.joints[j - 1].sigma == 0 for j in chain.coupling.free])
    large = turning & (np.max(np.abs(recorded.q), axis=0) > _TURNS)
    for degrees in (turning, large) if large.any() else ():
        unit = np.where(degrees, np.pi / 180.0, 1.0)
        qd, qdd = (None if x is None else x * unit for x in (recorded.qd, recorded.qdd))
        turned = replace(recorded, q=recorded.q * unit, qd=qd, qdd=qdd)
        other = fit_chain(fitted.model, turned.samples(filters), slowest * unit)
        if np.all(other.sigma < np.where(degrees, _CLEARLY, 1.0 / _CLEARLY) * fitted.sigma):
            return tuple(chain.names[j - 1] for j, own in zip(chain.coupling.free, degrees, strict=True) if own)
    return ()


def in_milliseconds(fitted: ChainFit, recorded: Recorded, filters: Filters, slowest: Array) -> bool:
    """Whether the samples' times are milliseconds: they are far apart, and each joint fits far better as such.

    `slowest` : (f,) rates below which a joint's equations are not fitted [rad/s, m/s], as in the fit.
    """
    if recorded.rate >= _SLOW:
        return False
    assert filters.pre_cutoff is not None
    faster = replace(
        filters, rate=1e3 * filters.rate, pre_cutoff=1e3 * filters.pre_cutoff, fit_cutoff=1e3 * filters.fit_cutoff,
        edge=1e-3 * filters.edge,
    )  # fmt: skip
    given = replace(recorded, rate=1e3 * recorded.rate, gaps=1e-3 * recorded.gaps, leaps=())
    other = fit_chain(fitted.model, given.samples(faster), 1e3 * slowest)
    return bool(np.all(other.sigma < _CLEARLY * fitted.sigma))


def late_torques(fitted: ChainFit, recorded: Recorded, filters: Filters) -> LateTorques | None:
    """The delay of all torques behind the positions; None where it does not matter.

    A late torque is what the model needs, less its rate times the delay. It is removed and estimated again, as the
    rate's own noise makes a first estimate small. It matters where that is more than the user's effect size of the
    torques, or most of what remains beside the model: a delay of one sample may be less than the effect size and still
    many times the noise.
    """
    delay, half = 0.0, 0.0
    remains = _squares(fitted, fitted.sigma)
    scale = np.where(fitted.used, fitted.weights / fitted.sigma, 0.0)
    for _ in range(_SHIFTS):
        shifted = _earlier(recorded, delay)
        y = fitted.y if delay == 0.0 else _right_side(fitted, shifted, filters)
        rates = derivative(shifted.tau.T, shifted.rate).T
        late = _right_side(fitted, replace(shifted, tau=shifted.tau + rates), filters) - y  # it is linear in torques
        found = solved_together(np.concatenate([fitted.W, -late[:, :, None]], axis=2), y, fitted.used, fitted.weights)
        step = float(found.x[-1])
        delay, half = delay + step, serial_quantile(len(late)) * float(np.sqrt(found.covariance[-1, -1]))
        large = abs(delay) * np.linalg.norm(late * scale) > SELECTION.effect_size * np.linalg.norm(y * scale)
        cause = remains - _squares(fitted, found.sigma) > _MOST * remains
        if not (large or cause) or abs(delay) < half:
            return None
        if abs(step) < max(half, _SETTLED * abs(delay)):
            break
    return LateTorques(delay, half)


def _squares(fitted: ChainFit, sigma: Array) -> float:
    """Squares of equations with σ of each joint (f,) [N·m, N], with the fit's weights."""
    return float(np.sum(np.count_nonzero(fitted.used, axis=0) * (sigma / fitted.sigma) ** 2))


def _earlier(recorded: Recorded, delay: float) -> Recorded:
    """The record with its torques read later by a time [s]."""
    places = np.arange(len(recorded.tau), dtype=float)
    at = places + delay * recorded.rate
    tau: list[Array] = [np.asarray(np.interp(at, places, series), float) for series in recorded.tau.T]
    return replace(recorded, tau=np.stack(tau, axis=1))


def _right_side(fitted: ChainFit, recorded: Recorded, filters: Filters) -> Array:
    """(m, f) right side of the equations with the torques of another record."""
    samples = recorded.samples(filters)
    return fitted.model.about(*fitted.model.equations(samples, fitted.standard), fitted.standard)[1]


def turned_torques(fitted: ChainFit) -> tuple[TurnedTorque, ...]:
    """Joints whose torques fit with the opposite sign beyond chance, and whose friction would drive them as they are.

    Bodies beyond a joint act on those before it, so that torques of one sign fit together. The likelihood with one
    joint's sign turned is compared with that of the signs given, by its differences at each instant (Vuong 1989, whose
    test holds where both models lack something), correlated in time; chance is family-wise over the joints. A law that
    is missing may fit better under a wrong sign, but leaves the joint's friction against its motion.
    """
    seen = [i for i, k in enumerate(fitted.base.independent) if fitted.base.names[int(k)] not in fitted.unseen]
    W, chain = fitted.W[:, :, seen], fitted.model.chain
    count = len(fitted.model.chain.coupling.free)
    names = [fitted.base.names[int(fitted.base.independent[i])] for i in seen]
    passive = [i for i, name in enumerate(names) if name in fitted.model.never_negative]
    friction = [
        [names.index(name) for effect in fitted.model.effects if isinstance(effect, _FRICTION)
         and effect.directions.keys() == {j} for name in effect.parameters if name in names]
        for j in chain.coupling.free
    ]  # fmt: skip
    level = float(scipy.stats.norm.isf(SELECTION.significance / count)) / SELECTION.interval_quantile

    def solved(signs: Array) -> _Signed:
        found = solved_together(W, fitted.y * signs, fitted.used, fitted.weights)
        scaled = (fitted.y * signs - W @ found.x) * fitted.weights / found.sigma
        each = np.where(fitted.used, -0.5 * scaled**2 - np.asarray(np.log(found.sigma), float), 0.0)
        likelihood = np.asarray(np.sum(each, axis=1), float)
        drives = np.array([_drives(W[:, k], found.x, friction[k]) for k in range(count)])
        return _Signed(likelihood, int(np.count_nonzero(found.x[passive] < 0.0)), found.sigma, drives)

    signs = np.asarray(np.ones(count), float)
    given = best = solved(signs)
    for _ in range(count if count > 1 else 0):
        tries = [(k, solved(_turned(signs, k))) for k in range(count)]
        most = max(one.total for _, one in tries)
        alike = [(k, one) for k, one in tries if most - one.total <= _ALIKE * abs(most)]
        k, one = min(alike, key=lambda each: each[1].negative)
        more = one.likelihood - best.likelihood
        chance = serial_quantile(len(more)) * float(np.sqrt(hac((more - float(np.mean(more)))[:, None])[0, 0]))
        if one.total - best.total <= level * chance or (friction[k] and not best.drives[k] > one.drives[k]):
            break
        best, signs = one, _turned(signs, k)
    names = [chain.names[j - 1] for j in chain.coupling.free]
    at = int(np.argmin(best.sigma / given.sigma))
    return tuple(
        TurnedTorque(names[k], names[at], float(given.sigma[at]), float(best.sigma[at]))
        for k in np.flatnonzero(signs < 0.0)
    )


def _turned(signs: Array, k: int) -> Array:
    """Signs with that of joint `k` turned."""
    out = signs.copy()
    out[k] = -out[k]
    return out


@dataclass(frozen=True)
class _Signed:
    """A fit with some torques' signs turned.

    `likelihood` : (m,) its logarithm at each instant. `negative` : values below 0 that cannot be. `sigma` : (f,).
    `drives` : (f,) whether each joint's friction drives it.
    """

    likelihood: Array
    negative: int
    sigma: Array
    drives: NDArray[np.bool_]

    @property
    def total(self) -> float:
        return float(np.sum(self.likelihood))


def _drives(W: Array, x: Array, places: list[int]) -> bool:
    """Whether the friction at a joint, of columns (m, b) at `places`, acts with its motion in the mean."""
    columns = W[:, places]
    along = np.sum(columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300), axis=1)
    return bool(along @ (columns @ x[places]) < 0.0)


def noise_bias(fitted: ChainFit, recorded: Recorded, filters: Filters, sigma: Array) -> Array:
    """(b,) bias of the base parameters by white noise σ (f,) [rad, m] of the positions; 0 where it may be chance.

    As much noise again is added to the record: what that moves the parameters by, the record's own noise has moved
    them by already (simulation and extrapolation: Cook and Stefanski 1994). Each draw is added and subtracted, so that
    what is linear in the noise, and no bias, cancels.
    """
    seen = [i for i, k in enumerate(fitted.base.independent) if fitted.base.names[int(k)] not in fitted.unseen]
    sigma_x = np.sqrt(np.diag(fitted.independent))[seen]
    rng = np.random.default_rng(3)
    moved: list[Array] = []
    while len(moved) < SELECTION.noise_pairs or (
        len(moved) < _PAIRS and np.max(np.abs(np.mean(moved, axis=0)), initial=0.0) > SELECTION.confounded_interval
    ):
        drawn = rng.standard_normal(recorded.q.shape) * sigma
        pair = [_refitted_to(fitted, recorded.samples(filters, (x, np.zeros((1, 1)))), seen) for x in (drawn, -drawn)]
        moved.append((0.5 * (pair[0] + pair[1]) - fitted.x[seen]) / sigma_x)
    mean = np.asarray(np.mean(moved, axis=0), float)
    own = np.asarray(np.std(moved, axis=0, ddof=1), float) / len(moved) ** 0.5
    error = np.maximum(
        own, float(own @ own / own.size) ** 0.5
    )  # of few pairs, a parameter's own may be small by chance
    beyond = float(scipy.stats.norm.isf(0.5 * SELECTION.significance / len(seen)))
    out = np.zeros(len(fitted.x))
    out[seen] = np.where(np.abs(mean) > beyond * error, mean, 0.0) * sigma_x
    return out


def _refitted_to(fitted: ChainFit, samples: JointSamples, seen: list[int]) -> Array:
    """Base parameters `seen` by other samples of the same record, with the fit's weights and equations."""
    model = fitted.model
    scale = (fitted.weights / fitted.sigma)[fitted.used]
    W, y = model.about(*model.equations(samples, fitted.standard), fitted.standard)
    right = y[fitted.used] * scale
    columns = W[:, :, model.base.independent[seen]][fitted.used] * scale[:, None]
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(columns / lengths, right, rcond=None)[0], float) / lengths


def accounted_for(doubts: Doubts, after: Doubts, laws: Sequence[JointEffect]) -> Doubts:
    """The doubts of a fit beside which `laws` seem missing, less those that they account for; `after` : with them.

    Values that cannot be, and a delay that the laws look like, are gone with them. Noise of the positions that had made
    a law would, added again, make as much of it again: where it moves the laws' own sizes by a small part of them, it
    is no doubt of them.
    """
    sizes = {name for effect in laws for name in effect.parameters}
    made = [
        one for one in after.biased
        if one.name in sizes and after.moved[one.name] > _MADE * abs(one.value)
    ]  # fmt: skip
    return replace(
        doubts,
        wrong_signs=doubts.wrong_signs if after.wrong_signs else (),
        biased=doubts.biased if made else (),
        moved=doubts.moved if made else {},
        late=doubts.late if after.late else None,
    )
