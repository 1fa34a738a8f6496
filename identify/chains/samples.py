"""Sampled joint positions and torques made ready for a fit: filtered alike, differentiated, at a working rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lacet.daq.errors import UsageError
from lacet.identify.chains.cutoffs import EDGE, ORDER, PRE, default_cutoff
from lacet.identify.chains.effects import ExternalForce
from lacet.identify.chains.gaps import Gap, Leap, bridged, continuous, missing_at, on_grid, uniform_times, without_leaps
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.vectors import Array, cross
from lacet.identify.signals.filters import Filters, derivative, two_pass_gain, zero_phase
from lacet.identify.signals.noise_level import white_noise

_BRIDGED = 0.5
"""Longest gap that is bridged × cut-off of the pre-filter: samples that far apart still hold what passes it (sampling
theorem). A longer one is not fitted, nor what the filters carry over from it."""
_OVERSAMPLING = 10.0
"""Working rate ÷ cut-off of the pre-filter: differences of eighth order are then exact to 1 in 10⁶ up to it."""


@dataclass(frozen=True)
class Recorded:
    """What was sampled, at the joints: positions and torques at their own rate.

    Attributes
    ----------
    q, tau : (N, f) positions [rad, m] and torques [N·m, N] of the chain's f free joints.
    qd, qdd : (N, f) their derivatives where they were given.
    rate : [Hz].
    external : forces on bodies.
    gaps : (g, 2) time of the sample before samples that are missing by their times, and time to the next one [s].
    leaps : positions that leap. Both are bridged in `q` and `tau`.
    missing : (N,) which samples are not there.
    """

    q: Array
    tau: Array
    rate: float
    qd: Array | None = None
    qdd: Array | None = None
    external: tuple[ExternalForce, ...] = ()
    gaps: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    leaps: tuple[Leap, ...] = ()
    missing: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool), repr=False)

    @classmethod
    def read(
        cls, chain: Chain, q: ArrayLike, tau: ArrayLike, *, rate: float | None, t: ArrayLike | None,
        qd: ArrayLike | None = None, qdd: ArrayLike | None = None, motors: ArrayLike | None = None,
        zero: ArrayLike | None = None, external: Sequence[ExternalForce] = (),
    ) -> Recorded:  # fmt: skip
        """What `identify_chain` was given, at the joints. Raises UsageError for shapes and times that do not fit."""
        count = len(chain.coupling.free)
        q_, tau_ = _table("q", q, count), _table("tau", tau, count)
        rates = [None if x is None else _table(name, x, count) for name, x in (("qd", qd), ("qdd", qdd))]
        for name, x in (("tau", tau_), ("qd", rates[0]), ("qdd", rates[1])):
            if x is not None and len(x) != len(q_):
                raise UsageError(f"{name} has {len(x)} samples, q has {len(q_)}")
        for force in external:
            if not 1 <= force.body <= chain.n:
                raise UsageError(f"bodies are numbered 1 to {chain.n}, found an external force on {force.body}")
            for x in (force.force, force.moment):
                if x is not None and np.shape(x) != (len(q_), 3):
                    raise UsageError(f"external forces must have the shape ({len(q_)}, 3), found {np.shape(x)}")
        gaps = np.zeros((0, 2))
        missing = np.zeros(len(q_), bool)
        if (rate is None) == (t is None):
            raise UsageError("give either the sample rate (rate=5000) or the times of the samples (t=…)")
        if t is not None:
            times = np.asarray(t, float)
            if times.shape != (len(q_),) or not np.all(np.diff(times) > 0.0):
                raise UsageError(f"t must be {len(q_)} increasing times, found the shape {times.shape}")
            grid, rate, gaps = uniform_times(times)
            if len(grid) != len(times) or np.max(np.abs(grid - times)) > 1e-3 / rate:
                missing = missing_at(times, grid)
                q_, tau_ = on_grid(times, q_, grid), bridged(on_grid(times, tau_, grid), missing, False)
                rates = [None if x is None else on_grid(times, x, grid) for x in rates]
                external = [
                    replace(
                        one, force=bridged(on_grid(times, np.asarray(one.force, float), grid), missing, False),
                        moment=None if one.moment is None
                        else bridged(on_grid(times, np.asarray(one.moment, float), grid), missing, False),
                    ) for one in external
                ]  # fmt: skip
        assert rate is not None
        if isinstance(rate, str) or np.ndim(rate):
            raise UsageError(f"the rate must be a number of Hz, found {rate!r}")
        if not rate > 0.0:
            raise UsageError(f"the rate must be positive, found {rate:g} Hz")
        q_, leaps = without_leaps(q_, rate)
        if motors is not None:
            C = np.asarray(motors, float)
            if C.shape != (count, count) or np.linalg.matrix_rank(C) < count:
                raise UsageError(f"motors must be an invertible {count} × {count} matrix, q_motor = C q")
            inverse = np.linalg.inv(C)
            q_, tau_ = q_ @ inverse.T, tau_ @ C
            rates = [None if x is None else x @ inverse.T for x in rates]
        if zero is not None:
            offset = np.asarray(zero, float)
            if offset.shape != (count,):
                raise UsageError(f"zero must be {count} positions, found the shape {offset.shape}")
            q_ = q_ + offset
        return cls(q_, tau_, rate, rates[0], rates[1], tuple(external), gaps, leaps, missing)

    def beginning(self, part: float) -> Recorded:
        """The first part (0 to 1) of the record."""
        count = math.ceil(part * len(self.q))
        seconds = count / self.rate
        external = tuple(
            replace(one, force=np.asarray(one.force)[:count], moment=None if one.moment is None else one.moment[:count])
            for one in self.external
        )
        return replace(
            self, q=self.q[:count], tau=self.tau[:count], external=external, missing=self.missing[:count],
            qd=None if self.qd is None else self.qd[:count], qdd=None if self.qdd is None else self.qdd[:count],
            gaps=self.gaps[np.sum(self.gaps, axis=1) < seconds],
            leaps=tuple(one for one in self.leaps if one.start + one.seconds < seconds),
        )  # fmt: skip

    def filters(self, cutoff: float | None, pre_cutoff: float | None, values: int = 0) -> Filters:
        """Filters of a fit of so many values up to `cutoff` [Hz] (by default `default_cutoff`), at the working rate.

        Raises UsageError for filters that cannot be.
        """
        if cutoff is None:
            q = continuous(self.q, self.rate, self.leaps)
            cutoff = default_cutoff(q, self.rate, values, self.noise_of(q, True))
        pre = pre_cutoff or min(PRE * cutoff, 0.4 * self.rate)
        work = max(1, math.floor(self.rate / (_OVERSAMPLING * pre)))
        try:
            found = Filters(self.rate / work, pre, cutoff, ORDER, EDGE / cutoff)
        except ValueError as error:
            raise UsageError(str(error)) from None
        if len(self.q) / self.rate <= 2.0 * found.edge + 1.0 / cutoff:
            raise UsageError(
                f"{len(self.q) / self.rate:.3g} s are too few for a fit up to {cutoff:.3g} Hz: the filters' transients "
                f"take {found.edge:.3g} s at each end"
            )
        return found

    def noise_of(self, values: Array, smooth: bool) -> Array:
        """(f,) σ of the white noise of values (N, f), which were bridged where samples are missing (`bridged`).

        What is bridged has less noise at the upper end of the spectrum: as much less as drawn noise has there.
        """
        found = white_noise(values)
        if not self.missing.any():
            return found
        drawn = np.random.default_rng(5).standard_normal((len(values), 1))
        return found / np.maximum(white_noise(bridged(drawn, self.missing, smooth)) / white_noise(drawn), 1e-300)

    def rate_noise(self, filters: Filters, sigma: Array) -> Array:
        """(f,) σ of the joint rates after the pre-filter [rad/s, m/s], from σ of white noise of the positions."""
        assert filters.pre_cutoff is not None
        f = np.linspace(0.0, 0.5 * self.rate, 2001)
        gain = 2.0 * np.pi * f * two_pass_gain(f, filters.pre_cutoff, self.rate, filters.order)
        return sigma * float(np.sqrt(np.mean(gain**2)))

    def samples(self, filters: Filters, noise: tuple[Array, Array] | None = None) -> JointSamples:
        """The samples filtered and differentiated, at the working rate; `noise` (N, f) of both added first."""
        added = noise or (np.zeros((1, 1)), np.zeros((1, 1)))
        if len(added[0]) > 1 and self.missing.any():
            added = bridged(added[0], self.missing, True), added[1]
        if len(added[1]) > 1 and self.missing.any():
            added = added[0], bridged(added[1], self.missing, False)
        work = round(self.rate / filters.rate)
        assert filters.pre_cutoff is not None
        pre = filters.pre_cutoff

        def through(x: Array) -> Array:
            return zero_phase(np.ascontiguousarray(x.T), pre, self.rate, filters.order)

        q = through(self.q + added[0])
        qd = derivative(q, self.rate) if self.qd is None else through(self.qd)
        qdd = derivative(qd, self.rate) if self.qdd is None else through(self.qdd)
        tau = through(self.tau + added[1])
        loads = tuple(
            replace(one, force=through(np.asarray(one.force, float)).T[::work],
                    moment=None if one.moment is None else through(np.asarray(one.moment, float)).T[::work])
            for one in self.external
        )  # fmt: skip
        q, qd, qdd, tau = (np.ascontiguousarray(x[:, ::work].T) for x in (q, qd, qdd, tau))
        leaps = [one for one in self.leaps if one.lasts or one.seconds > _BRIDGED / pre]
        omitted = [*self.omitted(filters), *leaps]
        times = np.array([(one.start, one.start + one.seconds) for one in omitted]).reshape(-1, 2)
        return JointSamples(q, qd, qdd, tau, loads, filters, work, times)

    def omitted(self, filters: Filters) -> tuple[Gap, ...]:
        """The gaps that are too long to be bridged: equations that the filters carry them into are not formed."""
        assert filters.pre_cutoff is not None
        long = self.gaps[self.gaps[:, 1] > _BRIDGED / filters.pre_cutoff]
        return tuple(Gap(float(start), float(seconds)) for start, seconds in long)


@dataclass(frozen=True)
class JointSamples:
    """States and torques (N, f) of the free joints at the working rate, all filtered alike.

    `external` : forces at the same samples. `filters` : of the equations. `recorded` : samples of the record for each.
    `omitted` : (g, 2) begin and end of what is not fitted [s].
    """

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    external: tuple[ExternalForce, ...]
    filters: Filters
    recorded: int = 1
    omitted: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def kept(self) -> NDArray[np.intp]:
        """(m,) places of the samples that decimation keeps, without the filters' transients at ends and gaps."""
        filters = self.filters
        places = np.arange(filters.step // 2, len(self.q), filters.step)
        edge = filters.edge * filters.rate
        inside = (places >= edge) & (places < len(self.q) - edge)
        for start, stop in self.omitted * filters.rate:
            inside &= (places <= start - edge) | (places >= stop + edge)
        return places[inside]

    def part(self, part: slice) -> JointSamples:
        """Some of the samples."""
        loads = tuple(
            replace(one, force=one.force[part], moment=None if one.moment is None else one.moment[part])
            for one in self.external
        )
        return replace(self, q=self.q[part], qd=self.qd[part], qdd=self.qdd[part], tau=self.tau[part], external=loads)

    def external_torques(self, chain: Chain) -> Array:
        """(N, f) torques at the free joints that hold the external forces: −Jᵀ F."""
        out = np.zeros_like(self.q)
        full = chain.coupling.states(self.q, self.qd, self.qdd)[0]
        for one in self.external:
            J = chain.jacobian(one.body, full, one.axes)
            force = np.asarray(one.force, float).T
            arm = np.asarray(one.point, float)[:, None] * np.ones((1, force.shape[1]))
            if one.axes == "ground":
                arm = np.einsum("nij,jn->in", chain.pose(one.body, full)[:, :3, :3], arm)
            moment = cross(arm, force) + (0.0 if one.moment is None else np.asarray(one.moment, float).T)
            torque = np.asarray(np.einsum("nij,in->nj", J, np.concatenate([force, moment])), float)
            out -= chain.coupling.torques(torque)
        return out


def _table(name: str, values: ArrayLike, count: int) -> Array:
    out = np.asarray(values, float)
    if out.ndim != 2 or out.shape[1] != count:
        raise UsageError(f"{name} must have the shape (N, {count}), a column for each joint that moves freely, "
                         f"found {out.shape}")  # fmt: skip
    if not np.all(np.isfinite(out)):
        bad = np.argwhere(~np.isfinite(out))
        raise UsageError(f"{name} has {len(bad)} values that are not finite, the first at sample {bad[0, 0]}, "
                         f"column {bad[0, 1] + 1}")  # fmt: skip
    return out
