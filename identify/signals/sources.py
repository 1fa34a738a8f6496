"""Sources of the channels that the equations need: measured, derived from others, or assumed with a tolerance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Generic, TypeVar

from lacet.daq.assumptions import Assumption
from lacet.identify.multibody.vectors import Array


class Kind(Enum):
    """How a quantity is known."""

    MEASURED = auto()
    """By an instrument."""
    DERIVED = auto()
    """From measured channels by an identity, by filtering, or by one stated ratio with its tolerance."""
    ASSUMED = auto()
    """From a nominal value with a tolerance, or by a law whose constants have tolerances."""


class Method(Enum):
    """How a channel that is not measured is obtained."""

    MOTION_RATIO = auto()
    """Travel from a potentiometer on the damper and its motion ratio."""
    LOAD_TRAVEL = auto()
    """Travel from the wheel load ÷ that of the run's mean, and a nominal static deflection."""
    LOAD_CELL = auto()
    """Wheel force from a vertical load cell; its horizontal parts from the accelerations and the load."""
    PUSHROD = auto()
    """Vertical wheel force from the pushrod's, and a nominal unsprung mass."""
    SCALE = auto()
    """Wheel force from a corner scale under the tyre."""
    NOMINAL_LOAD = auto()
    """Wheel force from known masses at rest, for rows in which the vertical forces cancel."""
    CONTACT = auto()
    """Wheel moment of the forces in the contact patch: loaded radius, trail, rolling resistance."""
    OTHER_WHEEL = auto()
    """Steer of the other wheel of the axle."""
    STEERING_WHEEL = auto()
    """Steer from the angle of the steering wheel and the vehicle's table or ratio."""
    BENCH_TABLE = auto()
    """Static angle of the vehicle file and the bench table, along the travel."""
    TURN = auto()
    """Steer of the front wheels from yaw rate, speed and a nominal understeer, or from the lateral acceleration."""
    FROM_SPEED = auto()
    """Wheel speed from the car's speed and the loaded radius."""
    NOMINAL_SPEED = auto()
    """Wheel speed from a nominal speed of the car."""
    GRAVITY = auto()
    """Attitude from the angular rates and from gravity, by a smoother over the whole run."""
    CAR_BUS = auto()
    """From single accelerations and rates of the car's own bus; what they lack is nominal."""


@dataclass(frozen=True)
class Source:
    """Where a channel that is not measured comes from.

    Attributes
    ----------
    kinds : how each of its components is known.
    method : how it is obtained.
    inputs : measured channels it is obtained from.
    unfit : kinds of rows that it cannot serve, because it would only return what was assumed.
    """

    kinds: tuple[Kind, ...]
    method: Method
    inputs: tuple[str, ...] = ()
    unfit: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """The least certain of its components' kinds."""
        return max(self.kinds, key=lambda kind: kind.value)


@dataclass(frozen=True)
class Series:
    """A channel's value and two derivatives, (k, N) each."""

    value: Array
    rate: Array
    accel: Array


@dataclass(frozen=True)
class Conditional:
    """Expected true value and rate of a channel given its noisy record, their standard deviations, and the root mean
    square of the rate over the run, (1, N) each."""

    mean: Array
    mean_rate: Array
    sigma: Array
    rate_sigma: Array
    rate_rms: Array


_Signals = TypeVar("_Signals", contravariant=True, bound=Any)


class Law(ABC, Generic[_Signals]):
    """A channel as a function of other channels and of assumptions, at each sample by itself.

    The assumptions' values are read from the signals: they are inputs of the equations like channels, and the
    residual's derivatives by them are columns of the sensor sheet.
    """

    @property
    @abstractmethod
    def channel(self) -> str:
        """The channel it gives."""

    @property
    @abstractmethod
    def assumptions(self) -> tuple[Assumption, ...]:
        """Its constants that may be off."""

    @abstractmethod
    def series(self, signals: _Signals) -> Series:
        """The channel and its derivatives."""

    def conditional(self, signals: _Signals) -> Conditional | None:
        """The channel given the noisy record, where that of its input is known; by default none."""
        return None
