"""The model of a chain with laws of its joints: its parameters, their grouping, and the columns of its equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import UsageError
from lacet.identify.chains.effects import (
    OF_BODIES,
    STANDARD,
    BaseInclination,
    EncoderOffset,
    JointEffect,
    LoadFriction,
    MotorGain,
)
from lacet.identify.chains.samples import JointSamples
from lacet.identify.multibody.base_parameters import BaseParameters, find_base
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.rigid_body import NEVER_NEGATIVE
from lacet.identify.multibody.scaled_chain import ScaledChain
from lacet.identify.multibody.symbolic_table import FIXED
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.decimation import decimated

_PIECE = 4000
"""Samples of which the equations are formed at a time: the memory of a long recording is that of a piece."""
_STATES = 300
"""Random states that show which parameters go together."""
_ROUNDING = 1e-8
"""Factor by which a parameter is grouped, both in units of their columns' size, that is 0 [ratio]: numerical."""
_TURN = 1e-4
"""Step of the differences that give the torques' change with a joint's position [rad]."""
_NO_CHANGE = 1e-12
"""Difference of two torques ÷ the largest below which a joint's position changes none [ratio]: numerical."""
_LOADED = LoadFriction, MotorGain
"""Laws whose columns depend on the bodies' torques."""


@dataclass(frozen=True)
class ChainModel:
    """A chain of bodies with laws of its joints.

    Attributes
    ----------
    chain : the bodies.
    effects : the laws.
    """

    chain: Chain
    effects: tuple[JointEffect, ...]

    @classmethod
    def of(cls, chain: Chain, effects: Sequence[JointEffect] | None = None) -> ChainModel:
        """The model; by default with the usual laws at every joint that moves freely (`STANDARD`).

        Raises UsageError for joints that do not move or do not exist, or a law that is there twice.
        """
        chain.regressor(np.zeros((1, chain.n)), np.zeros((1, chain.n)), np.zeros((1, chain.n)))  # needs numbers
        if effects is None:
            effects = standard_effects(chain)
        moving = {joint.j for joint in chain.joints if joint.sigma != FIXED}
        for effect in effects:
            if lost := [j for j in effect.directions if j not in moving]:
                raise UsageError(f"{effect.key}: there is no joint {lost[0]} that moves (there are {sorted(moving)})")
            if isinstance(effect, EncoderOffset | MotorGain) and len(effect.directions) > 1:
                raise UsageError(f"{effect.key}: an encoder, or a motor's gain, stands at one joint")
        names = [name for effect in effects for name in effect.parameters]
        if twice := [name for i, name in enumerate(names) if name in names[:i] or name in chain.parameter_names]:
            raise UsageError(f"two effects have a parameter {twice[0]}: give one a name (name='m6')")
        return cls(chain, tuple(effects))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters: of the bodies, then of the laws."""
        return (*self.chain.parameter_names, *(name for effect in self.effects for name in effect.parameters))

    @cached_property
    def never_negative(self) -> frozenset[str]:
        """Names of parameters that no body or law can have below 0: masses, moments of inertia, passive laws' own."""
        bodies = (name for name in self.chain.parameter_names if name.rstrip("0123456789") in NEVER_NEGATIVE)
        return frozenset((*bodies, *(name for effect in self.effects if effect.passive for name in effect.parameters)))

    @cached_property
    def place(self) -> dict[str, slice]:
        """Key of a law → its columns."""
        out: dict[str, slice] = {}
        at = 10 * self.chain.n
        for effect in self.effects:
            out[effect.key] = slice(at, at + len(effect.letters))
            at += len(effect.letters)
        return out

    @cached_property
    def base(self) -> BaseParameters:
        """Grouping of the parameters that torques hold only together; those a chain's file says it has not are absent.

        Encoder offsets and an inclination are not grouped: their columns depend on the parameters.
        """
        joined, units = self._random_columns()
        base = find_base(joined, self.names)
        relations = np.where(np.abs(base.relations) < _ROUNDING, 0.0, base.relations)
        relations = relations * units[base.dependent] / units[base.independent][:, None]
        return BaseParameters(base.names, base.independent, base.dependent, base.absent, relations, base.gap)

    def _random_columns(self) -> tuple[Array, Array]:
        """Columns of all parameters at random states, each ÷ a unit of its size, (rows, p), and these units (p,).

        The states are random in units of the chain's own size and of the time in which a fall of that size ends. The
        bodies, gravity, laws and joints that follow others are those of the chain itself: what a parameter is grouped
        with follows from the torques alone, whatever its unit holds of length and time. A base that may lean does:
        gravity then acts on first moments that it does not act on as it is given.
        """
        some = np.full(len(self.names), 0.1 * float(np.linalg.norm(self.chain.gravity)))
        chain, n = self.inclined(some), self.chain.n
        free = chain.coupling.free
        scaled = ScaledChain(chain, np.arange(10 * n), 0)
        length, time = scaled.size, scaled.fall_time
        sliding = np.array([chain.joints[j - 1].sigma == 1 for j in free])
        step = np.where(sliding, length, 1.0)
        rng = np.random.default_rng(11)
        shape = max(30, _STATES // n), len(free)
        qf = rng.uniform(-2, 2, (3, *shape)) * step / time ** np.arange(3.0)[:, None, None]
        states = [np.ascontiguousarray(x.T) for x in chain.coupling.states(*qf)]
        W = chain.coupling.rows(chain.structure(states[0], states[1], states[2]))
        load = rng.uniform(0.5, 2.0, shape)
        parts = [W]
        for effect in self.effects:
            dependent = isinstance(effect, OF_BODIES)
            parts.append(rng.normal(size=(*shape, 1)) if dependent else effect_columns(chain, effect, qf, load))
        # Torques ÷ (length² ÷ time²), forces ÷ (length ÷ time²): every row of the size of the others.
        rows = np.concatenate(parts, axis=2) * (step / (length / time) ** 2)[None, :, None]
        joined = rows.reshape(-1, len(self.names))
        joined[:, [i for i, name in enumerate(self.names) if name in chain.absent]] = 0.0
        sizes = np.sqrt(np.mean(joined[:, 10 * n :] ** 2, axis=0))
        units = np.concatenate([length ** -scaled.exponents.astype(float), np.where(sizes > 0.0, sizes, 1.0)])
        return joined / units, units

    def columns(self, samples: JointSamples, standard: Array | None) -> Array:
        """(N, f, p) torques at the free joints per unit of every parameter.

        `standard` : (p,) present values, for what depends on them: loads, and the change with an encoder's zero.
        """
        chain, coupling = self.inclined(standard), self.chain.coupling
        full = coupling.states(samples.q, samples.qd, samples.qdd)
        W = coupling.rows(chain.regressor(full[0], full[1], full[2]))
        bodies = np.zeros(10 * chain.n) if standard is None else standard[: 10 * chain.n]
        return np.concatenate([W, *self._laws(samples, full, bodies, W @ bodies, chain)], axis=2)

    def law_columns(self, samples: JointSamples, standard: Array) -> Array:
        """(N, f, …) the same of the laws alone."""
        bodies = standard[: 10 * self.chain.n]
        full = self.chain.coupling.states(samples.q, samples.qd, samples.qdd)
        load = np.zeros_like(samples.q)
        if any(isinstance(effect, _LOADED) for effect in self.effects):
            torques = self.inclined(standard).inverse_dynamics(full[0], full[1], full[2], bodies)
            load = self.chain.coupling.torques(torques)
        return np.concatenate(self._laws(samples, full, bodies, load, self.inclined(standard)), axis=2)

    def _laws(
        self, samples: JointSamples, full: tuple[NDArray[np.float64], ...], bodies: Array, load: Array, chain: Chain
    ) -> list[Array]:
        states = samples.q, samples.qd, samples.qdd
        parts: list[Array] = []
        for effect in self.effects:
            if isinstance(effect, EncoderOffset):
                parts.append(self._turned(full, bodies, effect, chain))
            elif isinstance(effect, BaseInclination):
                parts.append(self._under(full, bodies, effect, chain))
            else:
                parts.append(effect_columns(chain, effect, states, load, samples))
        return parts

    def _under(
        self, full: tuple[NDArray[np.float64], ...], bodies: Array, effect: BaseInclination, chain: Chain
    ) -> Array:
        """(N, f, 1) change of the bodies' torques, which are linear in gravity, with its part along the axis."""
        vertical = int(np.argmax(np.abs(self.chain.gravity)))
        along = chain.gravity / float(np.linalg.norm(chain.gravity))
        turned = np.eye(3)[effect.axis] - along[effect.axis] * along
        change = chain.gravity[vertical] / self.chain.gravity[vertical] * turned
        still = np.zeros_like(full[0])
        torques = self.chain.with_gravity(change.tolist()).inverse_dynamics(full[0], still, still, bodies)
        return self.chain.coupling.torques(torques)[:, :, None]

    def _turned(
        self, full: tuple[NDArray[np.float64], ...], bodies: Array, effect: EncoderOffset, chain: Chain
    ) -> Array:
        j = next(iter(effect.directions))
        step = np.zeros(chain.n)
        step[j - 1] = _TURN
        more, less = (chain.inverse_dynamics(full[0] + s * step, full[1], full[2], bodies) for s in (1, -1))
        change = self.chain.coupling.torques(more - less)
        if np.max(np.abs(change)) <= _NO_CHANGE * np.max(np.abs(more)):
            change = np.zeros_like(change)  # an axis along gravity, with nothing before it: only rounding is there
        return change[:, :, None] / (2.0 * _TURN)

    @property
    def places_of_bodies(self) -> list[int]:
        """Columns of encoder offsets and of an inclination."""
        return [self.place[effect.key].start for effect in self.effects if isinstance(effect, OF_BODIES)]

    def inclined(self, standard: Array | None) -> Chain:
        """The chain under gravity as it is by the inclination found, of present values (p,)."""
        leaning = [effect for effect in self.effects if isinstance(effect, BaseInclination)]
        if standard is None or not leaning:
            return self.chain
        gravity = self.chain.gravity.copy()
        for effect in leaning:
            gravity[effect.axis] += standard[self.place[effect.key]][0]
        gravity *= np.linalg.norm(self.chain.gravity) / np.linalg.norm(gravity)  # its direction alone changes
        return self.chain.with_gravity(gravity.tolist())

    def about(self, W: Array, y: Array, standard: Array) -> tuple[Array, Array]:
        """Equations (m, f, p) and right sides (m, f) about present values (p,), whose products with others are linear.

        Encoder offsets and an inclination that are known are in positions and gravity: the equations give what is added
        to them. A motor's gain scales the bodies' columns of its joint.
        """
        columns, right = W.copy(), y + W[:, :, self.places_of_bodies] @ standard[self.places_of_bodies]
        for effect in self.effects:
            if isinstance(effect, MotorGain):
                at = self.chain.coupling.free.index(next(iter(effect.directions)))
                place = self.place[effect.key].start
                right[:, at] += standard[place] * W[:, at, place]
                columns[:, at, : 10 * self.chain.n] *= 1.0 + standard[place]
        return columns, right

    @property
    def iterates(self) -> bool:
        """Whether columns depend on parameters, so that the fit is repeated."""
        return any(isinstance(effect, (*OF_BODIES, *_LOADED)) for effect in self.effects)

    def shifted(self, samples: JointSamples, standard: Array | None) -> JointSamples:
        """The samples with the joints where they stand by the encoder offsets found."""
        if standard is None or not any(isinstance(effect, EncoderOffset) for effect in self.effects):
            return samples
        q = samples.q.copy()
        for effect in self.effects:
            if isinstance(effect, EncoderOffset):
                at = self.chain.coupling.free.index(next(iter(effect.directions)))
                q[:, at] += standard[self.place[effect.key]][0]
        return replace(samples, q=q)

    def torques(self, samples: JointSamples, standard: Array) -> Array:
        """(N, f) torques of the model with parameters `standard` (p,), external forces included."""
        samples = self.shifted(samples, standard)
        bodies = standard[: 10 * self.chain.n]
        full = self.chain.coupling.states(samples.q, samples.qd, samples.qdd)
        torques = self.inclined(standard).inverse_dynamics(full[0], full[1], full[2], bodies)
        load = self.chain.coupling.torques(torques)
        out = load + samples.external_torques(self.chain)
        for effect in self.effects:
            if not isinstance(effect, OF_BODIES):
                states = samples.q, samples.qd, samples.qdd
                columns = effect_columns(self.chain, effect, states, load, samples)
                out += columns @ standard[self.place[effect.key]]
        return out

    def law_equations(self, samples: JointSamples, standard: Array, place: slice) -> Array:
        """(m, f, k) columns after filter and decimation of the parameters at `place`, which are laws'."""
        laws = slice(place.start - 10 * self.chain.n, place.stop - 10 * self.chain.n)
        return _decimated(self.shifted(samples, standard), lambda part: self.law_columns(part, standard)[:, :, laws])

    def equations(self, samples: JointSamples, standard: Array | None = None) -> tuple[Array, Array]:
        """(m, f, p) columns and (m, f) right sides after filter and decimation.

        External forces stand on the right side; encoder offsets that are known in `standard` are in the positions.
        """

        def both(part: JointSamples) -> Array:
            y = part.tau - part.external_torques(self.chain)
            return np.concatenate([self.columns(part, standard), y[:, :, None]], axis=2)

        found = _decimated(self.shifted(samples, standard), both)
        return np.ascontiguousarray(found[:, :, :-1]), np.ascontiguousarray(found[:, :, -1])


def _decimated(samples: JointSamples, columns: Callable[[JointSamples], Array]) -> Array:
    """(m, f, k) `columns` (N, f, k) of samples after filter and decimation, formed piece by piece."""
    kept, filters = samples.kept, samples.filters
    memory = int(np.ceil(min(filters.memory, 3.0 * filters.edge) * filters.rate))
    count = max(1, _PIECE // filters.step)
    out: list[Array] = []
    for first in range(0, len(kept), count):
        here = kept[first : first + count]
        start = max(0, int(here[0]) - memory) // filters.step * filters.step
        stop = min(len(samples.q), int(here[-1]) + memory + 1)
        found = columns(samples.part(slice(start, stop)))
        through = decimated(found.transpose(1, 2, 0), filters)[:, :, (here - start) // filters.step]
        out.append(through.transpose(2, 0, 1))
    return np.concatenate(out)


def standard_effects(chain: Chain, *laws: type[JointEffect]) -> tuple[JointEffect, ...]:
    """Laws at every joint of a chain that moves freely; by default the usual ones (`STANDARD`)."""
    return tuple(law(j) for j in chain.coupling.free for law in (laws or STANDARD))


def effect_columns(
    chain: Chain, effect: JointEffect, states: Sequence[Array] | NDArray[np.float64], load: Array,
    samples: JointSamples | None = None,
) -> Array:  # fmt: skip
    """(N, f, k) torques at the free joints per unit of a law's parameters, from (N, f) states and the bodies' load.

    `samples` : those of the states. Where each stands for several of the record, and a direction turns back within
    their time, a column is the mean over them. Friction jumps there: its value at one instant moves the jump by up to
    half the time between samples, which the low-pass turns into a pulse that the torque does not have.
    """
    coupling = chain.coupling
    c = sum((k * coupling.matrix[j - 1] for j, k in effect.directions.items()), np.zeros(len(coupling.free)))
    away = float(sum(k * coupling.offset[j - 1] for j, k in effect.directions.items()))
    # The load of a motor is the torque that does the work of all its joints' loads.
    along = load @ c / float(c @ c) if np.any(c) else np.zeros(len(load))
    s, rate, acceleration = states[0] @ c + away, states[1] @ c, states[2] @ c
    found = effect.columns(s, rate, acceleration, along)
    if samples is not None and samples.recorded > 1:
        period = 1.0 / samples.filters.rate
        back = np.flatnonzero(np.abs(rate) < 0.5 * period * np.abs(acceleration))
        s, rate, acceleration, along = s[back], rate[back], acceleration[back], along[back]
        found = found.copy()
        found[back] = np.sum(
            [
                share * effect.columns(s + rate * dt, rate + acceleration * dt, acceleration, along)
                for dt, share in _around(samples.recorded, period)
            ],
            axis=0,
        )
    return c[None, :, None] * found[:, None, :]


def _around(recorded: int, period: float) -> list[tuple[float, float]]:
    """Instants of the record's samples around one of fewer [s from it], and the share of each: halves at both ends."""
    step, reach = period / recorded, recorded // 2
    ends = 1.0 if recorded % 2 else 0.5
    return [(k * step, (ends if abs(k) == reach else 1.0) / recorded) for k in range(-reach, reach + 1)]
