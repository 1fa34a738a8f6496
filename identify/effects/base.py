"""Base classes of effects, the terms of a model: physical laws with regressor columns, and faults of the sensors.

A model is a sum of effects and nothing else; a rigid body is an effect too. A new effect is one class in one file of
``identify/effects/`` (or of a folder named in a study), where it is found automatically.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property
from typing import ClassVar, Self, TypeVar

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, GroundLaserOffset, Motion
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording

_NODES = np.linspace(-3.0, 3.0, 11)
_SHARES = np.exp(-0.5 * _NODES**2) / np.sum(np.exp(-0.5 * _NODES**2))
"""Points, in σ, and weights of the trapezoidal rule for the mean over a normal distribution: of a law with a corner it
is right to a hundredth of what noise changes in it."""

AXLES: dict[str, tuple[str, str]] = {"front": ("fl", "fr"), "rear": ("rl", "rr")}


@dataclass(frozen=True)
class Parameter:
    """A coefficient of an effect, in which the effect is linear.

    `name` is ``effect.parameter`` (rigid bodies: as in the paper, ``XX6``); `unit` is SI; `low` and `high` bound what
    is plausible on any car; `expect` is ``positive``, ``negative`` or ``any``. `twin` names the same part on the other
    side of the car, whose value differs by `twin_sigma` (1 σ); only one of the two names the other.

    Examples
    --------
    >>> stiffness = lacet.Parameter("bar.front.k", "N/m", 0.0, 1e5, "positive")
    >>> stiffness.largest
    100000.0
    """

    name: str
    unit: str
    low: float
    high: float
    expect: str = "any"
    twin: str = ""
    twin_sigma: float = 1.0

    @property
    def largest(self) -> float:
        """The largest plausible magnitude."""
        return max(abs(self.low), abs(self.high))

    @property
    def prior(self) -> float:
        """Standard deviation (1 σ) of the prior: half the largest plausible value.

        Wide enough not to bias a parameter that a run determines; one that no run determines stays plausible.
        """
        return 0.5 * self.largest


@dataclass(frozen=True)
class Implausible:
    """A quantity of an effect outside what is plausible on any car: a parameter, or what follows from several.

    Its 95 % interval, `low` to `high` in the unit of `quantity`, is outside the plausible range of that.
    """

    quantity: Parameter
    low: float
    high: float


@dataclass(frozen=True)
class Effect(ABC):
    """A term of the model at one place: physics (`PhysicalEffect`) or a fault of the instruments (`SensorFault`).

    Attributes
    ----------
    where : place of this variant: ``front``, ``rear``, a corner, a sensor, or empty.
    shape : constants that are not linear (a gap, a speed), by name; searched over `grids`.

    Examples
    --------
    >>> bar = lacet.catalogue(runs)["anti_roll_bar.front"]
    >>> [parameter.unit for parameter in bar.parameters]
    ['N/m']
    """

    where: str = ""
    shape: Mapping[str, float] = field(default_factory=dict[str, float])

    name: ClassVar[str]
    """Family name, e.g. ``anti_roll_bar``."""
    about: ClassVar[str]
    """The effect in one line."""
    signature: ClassVar[str]
    """Pattern in the residual of a model that lacks it."""
    shown_by: ClassVar[str]
    """Manoeuvre that excites it."""
    parameters_shown_by: ClassVar[Mapping[str, str]] = {}
    """Parameter → the manoeuvre that excites it, where that is another than `shown_by`."""
    source: ClassVar[str]
    """Publication of the law."""
    rows: ClassVar[tuple[str, ...]] = ()
    """Rows it acts on: kinds (``suspension``, ``tyre``, ``spin``, ``chassis``) or single rows (``chassis.fx``)."""
    looks_like: ClassVar[tuple[str, ...]] = ()
    """Families that it is confounded with by construction, in nearly all runs; the docstring has the reason."""
    base: ClassVar[bool] = False
    """Whether it is part of the base model."""
    describes: ClassVar[bool] = False
    """Whether it only describes a force of unknown cause, as far as that follows measured states."""
    opposed: ClassVar[bool] = False
    """Whether what it does at one wheel of an axle is the opposite of what it does at the other, one force of one part;
    else left and right are two parts, which are never equal."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Channels it needs beyond those of the rows it acts on."""
    grids: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    """Values tried for each shape constant [SI]."""
    grid_units: ClassVar[Mapping[str, str]] = {}
    """SI unit of each shape constant, empty for a number."""
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Smallest and largest plausible value of shape constants [SI], between which the law is a continuous function of
    them; of a constant that is not named, those of its grid (`bounds_of`)."""
    simplest: ClassVar[Mapping[str, float]] = {}
    """Values of shape constants at which the law is one of a simpler kind, as a power of 1 is a line."""

    @cached_property
    def key(self) -> str:
        """``family.where``, the name by which models, results and commands refer to it."""
        return f"{self.name}.{self.where}" if self.where else self.name

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The effect's linear parameters."""

    @property
    def as_physics(self) -> PhysicalEffect | None:
        """This effect if it is physics, with columns of its own; else None."""
        return None

    @property
    def as_fault(self) -> SensorFault | None:
        """This effect if it is a fault of the instruments; else None."""
        return None

    @property
    def sheet_kind(self) -> str:
        """Entry of the rig's sensor sheet that bounds it: ``gain``, ``latency`` …; empty for physics."""
        return ""

    @property
    def sheet_entries(self) -> frozenset[tuple[str, str]]:
        """Entries of the sensor sheet, kind and channel, that describe the same error as it; none for physics."""
        return frozenset()

    def sheet_bound(self, rig: Rig) -> float:
        """Tolerance of the sensor sheet for it, 1 σ in the parameter's unit; 0 for physics."""
        return 0.0

    def implausible(self, values: Sequence[float] | Array, half: Sequence[float] | Array) -> Implausible | None:
        """What no car has of an effect with these values ± half (95 %) of its parameters, the first; None without any.

        Examples
        --------
        >>> stop = lacet.catalogue(runs)["bump_stop.front"]
        >>> stop.implausible([-9000.0], [200.0]).quantity.name
        'bump_stop.front.k'
        """
        for quantity, value, slack in zip(self.parameters, values, half, strict=True):
            if value + slack < quantity.low or value - slack > quantity.high:
                return Implausible(quantity, value - slack, value + slack)
        return None

    @classmethod
    @abstractmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One effect for each place it can act at on a vehicle, for wheel loads in `reference`."""

    @classmethod
    def for_runs(cls, runs: Sequence[str]) -> Sequence[Self]:
        """Variants that differ from run to run, one a run, by the runs' names; none for a property of the car."""
        return ()

    @classmethod
    def is_of_run(cls) -> bool:
        """Whether it belongs to a run and not to the car."""
        return bool(cls.for_runs(("one run", "another")))

    def lacks(self, motion: Motion) -> tuple[str | GroundLaserOffset, ...]:
        """Channels that it needs and the run of `motion` lacks, or the road under the wheels (`GroundLaserOffset`)."""
        return tuple(channel for channel in self.needs if channel not in motion.channels)

    def shapes(self) -> list[Self]:
        """This effect with each combination of its shape constants that is searched; itself where it has none."""
        out = [self]
        for name, values in self.grids.items():
            out = [replace(one, shape={**one.shape, name: value}) for one in out for value in values]
        return out

    @cached_property
    def constants(self) -> tuple[tuple[str, float], ...]:
        """Names and values of all that its columns depend on beside the motion: effects of one key differ in these."""
        return tuple(sorted(self.shape.items()))

    def bounds_of(self, constant: str) -> tuple[float, float]:
        """Smallest and largest plausible value of a shape constant [SI], between which it is searched.

        Examples
        --------
        >>> stop = lacet.catalogue(runs)["bump_stop.front"]
        >>> stop.bounds_of("gap")
        (0.0, 0.08)
        """
        values = self.grids[constant]
        return self.bounds.get(constant, (min(values), max(values)))

    def corners(self) -> tuple[str, ...]:
        """The corners an axle or corner effect acts on."""
        return AXLES.get(self.where, (self.where,))

    def acts_on(self, row: Row) -> bool:
        """Whether it acts on a row, by the rows and corners that it declares; on all rows without any."""
        corners = {*self.corners()} & {*CORNERS}
        return any(
            (not self.rows or part.kind in self.rows or part in self.rows)
            and (not corners or part.corner is None or part.corner in corners)
            for part in row.parts
        )

    def named(self, parameter: str, unit: str, low: float, high: float, expect: str = "any") -> Parameter:
        """A parameter of this effect, ``effect.where.parameter``."""
        return Parameter(f"{self.key}.{parameter}", unit, low, high, expect)


class PhysicalEffect(Effect):
    """A physical effect: a force or moment in rows of the equations, linear in its parameters.

    Examples
    --------
    >>> bar = lacet.catalogue(runs)["anti_roll_bar.front"]
    >>> sorted(bar.columns(runs.prepared[0].motion))
    ['suspension.fl', 'suspension.fr']
    """

    instantaneous: ClassVar[bool] = True
    """Whether its columns at an instant follow from the motion at that instant alone, without memory or derivatives."""

    @property
    def conditional(self) -> bool:
        """Whether its columns are expectations of the law given the noisy record, where signals are not exact."""
        return False

    @property
    def as_physics(self) -> PhysicalEffect:
        """This effect."""
        return self

    @abstractmethod
    def columns(self, motion: Motion) -> dict[str, Array]:
        """Right-hand side per unit of each parameter: row → (p, N) in the row's unit; rows not acted on are absent."""

    def parts(self) -> Sequence[PhysicalEffect]:
        """Effects, each at wheels of its own, whose columns add up to this effect's; by default itself."""
        return (self,)

    def force(self, motion: Motion, values: Array) -> dict[str, Array]:
        """Right-hand side for parameter values (p,): row → (N,)."""
        return {row: np.asarray(values) @ columns for row, columns in self.columns(motion).items()}


K = TypeVar("K")


def sum_by_row(parts: Iterable[Mapping[K, Array]]) -> dict[K, Array]:
    """Sums of several tables row → array; a row that some lack is the sum of the others'."""
    out: dict[K, Array] = {}
    for rows in parts:
        for row, array in rows.items():
            out[row] = out[row] + array if row in out else array
    return out


def columns_by_row(effect: PhysicalEffect, motion: Motion) -> dict[Row, Array]:
    """Regressor columns of an effect, row → (p, N), 0 for parameters whose value the motion knows.

    Raises UsageError where a key of them is no row.
    """
    columns = effect.columns(motion)
    if (free := free_parameters(effect, motion)) is not None:
        columns = {text: free[:, None] * table for text, table in columns.items()}
    return motion.with_body_rows({Row.parse(text): table for text, table in columns.items()})


def free_parameters(effect: PhysicalEffect, motion: Motion) -> Array | None:
    """(p,) 0 for each parameter of an effect whose value the motion knows, else 1; None where it knows none.

    The force of the former is on the left side (`Motion.measured`).
    """
    free = np.array([parameter.name not in motion.known for parameter in effect.parameters], float)
    return None if np.all(free) else free


class Bend(Enum):
    """The argument of a suspension's law in which it bends within the noise: has a corner, a step or saturates."""

    NOWHERE = auto()
    TRAVEL = auto()
    RATE = auto()


class AtSuspensions(PhysicalEffect):
    """A force in each suspension of an axle, or in one corner's."""

    rows = ("suspension",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Both axles (the same parameter left and right) and each corner."""
        return [cls(where) for where in (*AXLES, *vehicle.corners)]

    def parts(self) -> Sequence[PhysicalEffect]:
        """The same force at each corner: the variants of two axles and four corners need the law four times."""
        return [replace(self, where=corner) for corner in self.corners()]


class SuspensionForce(AtSuspensions):
    """A force in each suspension, resisting compression, as a function of travel s [m] and its rate [m/s].

    A subclass defines `law` and its parameters; front and rear axle and each single corner are its variants. Of a law
    that bends, the columns are its expectation given the noisy record (regression calibration,
    docs/decisions/noise-in-regressors.md): the law smoothed with the conditional distribution of its argument.

    Examples
    --------
    >>> class CubicSpring(lacet.SuspensionForce):
    ...     name = "my_cubic_spring"
    ...     about = "spring that stiffens with the cube of its travel"
    ...     signature = "suspension row follows the cube of the travel"
    ...     shown_by = "large travel"
    ...     source = "own measurement"
    ...
    ...     @property
    ...     def parameters(self):
    ...         return (self.named("k3", "N/m³", -1e8, 1e8),)
    ...
    ...     def law(self, travel, rate):
    ...         return travel**3
    >>> lacet.add(fitted, CubicSpring("front")).model
    Model(29 effects of the base model + my_cubic_spring.front)
    """

    bend: ClassVar[Bend] = Bend.NOWHERE
    """Where the law bends within the noise of its argument; a polynomial does not. One that bends is a function of both
    at an instant alone: it is evaluated at several motions, one after the other."""

    @property
    def conditional(self) -> bool:
        """Whether the law bends."""
        return self.bend is not Bend.NOWHERE

    @abstractmethod
    def law(self, travel: Array, rate: Array) -> Array:
        """(N,) force per unit of the parameter [N], from travel [m] and its rate [m/s]; (p, N) for several of them."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The law in the suspension rows of the corners acted on, or its expectation."""
        return expected_columns(self._plain, motion, self.corners(), self.bend)

    def _plain(self, motions: Sequence[Motion]) -> dict[str, Array]:
        out: dict[str, Array] = {}
        for c in self.corners():
            parts = [motion.corners[c] for motion in motions]
            found = self.law(in_turn([part.travel for part in parts]), in_turn([part.rate for part in parts]))
            out[f"suspension.{c}"] = np.atleast_2d(found)
        return out


def expected_columns(
    law: Callable[[Sequence[Motion]], Mapping[str, Array]], motion: Motion, corners: Iterable[str], bend: Bend
) -> dict[str, Array]:
    """Expectation of a law's columns over the true travel at some corners, given the record: row → (p, N).

    The law itself where it does not bend, or the signals are exact. Of a law that bends with the rate, the linear part
    is taken at the measured rate: it is what a damper does, and has the noise of a damper's column. A law that is all
    but linear would else explain the noise of the rate, which the damper brings into the residual.

    `law` : row → (p, K·N) columns in K motions, one after the other (`in_turn`).
    """
    given = tuple(dict.fromkeys(c for c in corners if motion.corners[c].conditional is not None))
    if bend is Bend.NOWHERE or not given:
        return dict(law([motion]))
    nodes = _NODES.tolist()
    if bend is Bend.TRAVEL:
        motions = [motion.off_expectation(given, node, 0.0) for node in nodes]
    else:
        usual = [motion.at_usual_rate(given, sign) for sign in (1.0, -1.0)]
        motions = [*(motion.off_expectation(given, 0.0, node) for node in nodes), *usual]
    out: dict[str, Array] = {}
    for row, table in law(motions).items():
        each = table.reshape(len(table), len(motions), -1)
        out[row] = np.asarray(np.tensordot(each[:, : len(nodes)], _SHARES, (1, 0)), float)
        if bend is Bend.RATE and (c := row.rpartition(".")[2]) in given:
            out[row] += _linear_part(each[:, -2] - each[:, -1], motion.corners[c])
    return out


def in_turn(series: Sequence[Array]) -> Array:
    """(K·N,) series in K motions, one after the other."""
    return series[0] if len(series) == 1 else np.concatenate(series)


def _linear_part(difference: Array, corner: CornerMotion) -> Array:
    """(p, N) linear part of a law at the measured rate less that at the expected one.

    `difference` : (p, N) of the law's values at ± the root mean square of the rate.
    """
    given = corner.conditional
    assert given is not None
    slope = np.divide(difference, 2.0 * given.rate_rms, out=np.zeros_like(difference), where=given.rate_rms > 0.0)
    return slope * (corner.rate - given.rate)


class TyreForce(PhysicalEffect):
    """A force of the tyres along the road's normal; a subclass defines the law per unit of its one parameter.

    Examples
    --------
    >>> class Progressive(lacet.TyreForce):
    ...     name = "my_progressive_tyre"
    ...
    ...     @property
    ...     def parameters(self):
    ...         return (self.named("k2", "N/m²", -1e7, 1e7),)
    ...
    ...     def law(self, corner):
    ...         return corner.deflection**2
    >>> sorted(Progressive("rear").columns(runs.prepared[0].motion))
    ['tyre.rl', 'tyre.rr']
    """

    rows = ("tyre",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """The variants of both axles (the same parameter left and right)."""
        return [cls(where) for where in AXLES]

    @abstractmethod
    def law(self, corner: CornerMotion) -> Array:
        """(N,) force per unit of the parameter [N], from the motion of one corner."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The law in the tyre rows of the corners acted on."""
        return {f"tyre.{c}": self.law(motion.corners[c])[None] for c in self.corners()}


class SensorFault(Effect):
    """A fault of the instruments in some of the measured channels, with one parameter.

    It is a candidate beside the physics. Its columns depend on the model: they are the change of Y − W θ̂ per unit of
    its parameter. It acts on every row that its channels enter, so that `rows` is empty.

    Examples
    --------
    >>> scale = lacet.catalogue(runs)["sensor_gain.hub.fl"]
    >>> scale.channels(), scale.tolerance
    (('laser.fl.hub',), 'gain')
    """

    @property
    def as_fault(self) -> SensorFault:
        """This effect."""
        return self

    @property
    def sheet_kind(self) -> str:
        """Entry of the sensor sheet that bounds it: its `tolerance`."""
        return self.tolerance

    @property
    def sheet_entries(self) -> frozenset[tuple[str, str]]:
        """Entries of the sensor sheet for it: its kind of tolerance in each of its channels."""
        return frozenset((self.tolerance, channel) for channel in self.channels())

    def sheet_bound(self, rig: Rig) -> float:
        """The largest tolerance of its kind among its channels; 0 where the sheet has none."""
        return max((rig.tolerance(channel, self.tolerance) for channel in self.channels()), default=0.0)

    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Channels that have the fault."""

    @abstractmethod
    def perturb(self, channel: str, recording: Recording) -> Array:
        """Change of a channel of the recording (k, N) per unit of the parameter, for a small fault.

        `recording` has this channel, and of the others those of the run (`recording.signals`).
        """

    def changes(self, recording: Recording) -> dict[str, Array]:
        """Changes of channels (k, N) per unit of the parameter, equivalent to the fault in the equations."""
        there = [name for name in self.channels() if name in recording.signals.value]
        return {name: self.perturb(name, recording) for name in there}

    @property
    @abstractmethod
    def tolerance(self) -> str:
        """Entry of the rig's sensor sheet that bounds it: ``gain``, ``latency`` … (`daq.rig.Rig.tolerance`)."""

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """A channel of a recording (k, N) with a fault of size `p` removed, by default to first order."""
        return recording.signals.value[channel] - p * self.perturb(channel, recording)


def is_sensor_fault(family: type[Effect]) -> bool:
    """Whether a family of effects consists of faults of the instruments."""
    return issubclass(family, SensorFault)


AnEffect = TypeVar("AnEffect", bound=Effect)


def with_places(effects: Iterable[AnEffect], start: int = 0) -> Iterator[tuple[AnEffect, slice]]:
    """Each effect with the slice of its parameters in the vector of all effects' parameters, the first at `start`."""
    for effect in effects:
        stop = start + len(effect.parameters)
        yield effect, slice(start, stop)
        start = stop
