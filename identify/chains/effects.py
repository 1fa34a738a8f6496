"""Laws of joints that a chain of rigid bodies does not have: rotors, friction, springs, offsets, and measured forces.

A law acts along a direction of joint space: one joint, or a motor that turns with several, whose angle is s = c·q. Its
torques are then c f(s, ṡ, s̈), so that motor and load do the same work.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True)
class JointEffect(ABC):
    """A law at a joint, linear in its parameters.

    Attributes
    ----------
    along : number of the joint (from 1), or joint → coefficient c of a motor that turns by Σ c q.
    name : what is written behind the parameters' letters; by default the joints' numbers (``FV5``, ``FV5_6``).
    """

    along: int | Mapping[int, float]
    name: str = ""

    family: ClassVar[str]
    """Name of the law, as rankings print it."""
    letters: ClassVar[tuple[str, ...]]
    """Letters of its parameters."""
    grid: ClassVar[tuple[float, ...]] = ()
    """Values tried of its constant that is not linear [SI]."""
    passive: ClassVar[bool] = False
    """Whether its parameters cannot be negative: it stores or dissipates energy."""
    largest: ClassVar[float] = float("inf")
    """Largest absolute value that its parameters can have [SI]."""

    @property
    def directions(self) -> dict[int, float]:
        """Joint → coefficient."""
        return {self.along: 1.0} if isinstance(self.along, int) else dict(self.along)

    @property
    def where(self) -> str:
        """The joints as text: ``5``, ``5_6``, or ``5_6n`` where they turn against each other."""
        parts = [f"{j}{'n' if c < 0.0 else ''}" for j, c in self.directions.items()]
        return self.name or "_".join(parts)

    @property
    def key(self) -> str:
        """``family.where``."""
        return f"{self.family}.{self.where}"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(f"{letters}{self.where}" for letters in self.letters)

    @abstractmethod
    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """Torque along its direction per unit of each parameter, (N, k).

        Parameters
        ----------
        s, rate, acceleration : (N,) of the direction.
        load : (N,) torque [N·m] that the bodies ask for along it.
        """

    @property
    def constant(self) -> float:
        """Value of its constant that is not linear [SI]; not a number where it has none."""
        return float("nan")

    def at(self, constant: float) -> JointEffect:
        """The law with another value of its constant; itself where it has none."""
        return self


class RotorInertia(JointEffect):
    """Inertia of a rotor: IA s̈ [kg·m²]."""

    family, letters = "rotor_inertia", ("IA",)
    passive = True

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """s̈."""
        return acceleration[:, None]


class ViscousFriction(JointEffect):
    """Viscous friction: FV ṡ [N·m·s/rad]."""

    family, letters = "viscous", ("FV",)
    passive = True

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """ṡ."""
        return rate[:, None]


class CoulombFriction(JointEffect):
    """Coulomb friction: FS sign ṡ [N·m]."""

    family, letters = "coulomb", ("FS",)
    passive = True

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """sign ṡ."""
        return np.sign(rate)[:, None]


class AsymmetricCoulomb(JointEffect):
    """Coulomb friction of another size each way [N·m]: FSP forwards, FSN backwards.

    The same as Coulomb friction with a `JointOffset`: FSP = FS + OFF, FSN = FS − OFF.
    """

    family, letters = "asymmetric_coulomb", ("FSP", "FSN")
    passive = True

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """1 forwards; −1 backwards."""
        sign = np.sign(rate)
        return np.stack([np.maximum(sign, 0.0), np.minimum(sign, 0.0)], axis=1)


class AsymmetricViscous(JointEffect):
    """What viscous friction is more forwards than on average of both ways: FVA |ṡ| [N·m·s/rad]."""

    family, letters = "asymmetric_viscous", ("FVA",)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """|ṡ|."""
        return np.abs(rate)[:, None]


@dataclass(frozen=True)
class StribeckFriction(JointEffect):
    """Friction that falls as motion begins: FB sign ṡ exp(−(ṡ/speed)²) [N·m], beside Coulomb friction.

    `speed` : at which it has fallen to 1/e [rad/s].
    """

    speed: float = 0.1

    family, letters = "stribeck", ("FB",)
    passive = True
    grid = (0.03, 0.1, 0.3)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """sign ṡ exp(−(ṡ/speed)²)."""
        return (np.sign(rate) * np.exp(-((rate / self.speed) ** 2)))[:, None]

    @property
    def constant(self) -> float:
        """`speed` [rad/s]."""
        return self.speed

    def at(self, constant: float) -> StribeckFriction:
        """The law with another `speed` [rad/s]."""
        return StribeckFriction(self.along, self.name, constant)


class LoadFriction(JointEffect):
    """Friction of a gear that grows with what it carries: FL |load| sign ṡ [ratio].

    The load is the torque that the bodies ask for in the model itself, found again until it stands still; a rotor's
    inertia that cannot be distinguished from a body's counts among it.
    """

    family, letters = "load_friction", ("FL",)
    passive = True

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """|load| sign ṡ."""
        return (np.abs(load) * np.sign(rate))[:, None]


class MotorGain(JointEffect):
    """What a motor reads more of the bodies' torque than there is: GM load [ratio].

    The load is found as that of `LoadFriction` is. It is told apart from the bodies where their parameters act on other
    joints too; the laws of the joint itself have the values that its motor reads.
    """

    family, letters = "motor_gain", ("GM",)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """The load."""
        return load[:, None]


class JointOffset(JointEffect):
    """A constant torque: OFF [N·m], of an amplifier, or of a counterweight's spring."""

    family, letters = "offset", ("OFF",)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """1."""
        return np.ones((s.size, 1))


class JointSpring(JointEffect):
    """A linear spring: K s [N·m/rad]. Where its rest is not s = 0, a `JointOffset` beside it holds −K s₀."""

    family, letters = "spring", ("K",)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """s."""
        return s[:, None]


class EncoderOffset(JointEffect):
    """An encoder whose zero is off: the joint stands at q + QO [rad]. It acts through the bodies' torques alone.

    It is named up to half a radian: beyond that the torques' change is no longer in proportion, and one sees it.
    """

    family, letters = "encoder_offset", ("QO",)
    largest = 0.5

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """Nothing: the fit has the torques' change with the joint's position in its place."""
        return np.zeros((s.size, 1))


@dataclass(frozen=True)
class BaseInclination(JointEffect):
    """A base that leans: gravity keeps its size and points along one more axis of the ground frame, too, by GX, GY or
    GZ [m/s²] beside the part that was given. Their ratio is the tangent of the inclination.

    It is named up to a quarter of gravity, 14°: one sees more.

    Attributes
    ----------
    axis : of the ground frame, 0, 1 or 2.
    """

    along: int | Mapping[int, float] = field(default_factory=dict[int, float])
    axis: int = 0

    family, letters = "inclination", ("G",)
    largest = 2.5

    @property
    def where(self) -> str:
        """The axis: ``x``, ``y`` or ``z``."""
        return "xyz"[self.axis]

    @property
    def parameters(self) -> tuple[str, ...]:
        """``GX``, ``GY`` or ``GZ``."""
        return (f"G{self.where.upper()}",)

    def columns(self, s: Array, rate: Array, acceleration: Array, load: Array) -> NDArray[np.float64]:
        """Nothing: the fit has the bodies' torques under that gravity in its place."""
        return np.zeros((s.size, 1))


@dataclass(frozen=True)
class ExternalForce:
    """A force and a moment that act on a body and are measured, or known.

    Attributes
    ----------
    body : number of the body, from 1.
    force : (N, 3) [N], at every sample of the positions given.
    moment : (N, 3) [N·m] about the frame's origin, or None.
    point : where the force acts, in the body's frame [m].
    axes : whether both are in the axes of the ``body`` or of the ``ground``.
    """

    body: int
    force: Array = field(repr=False)
    moment: Array | None = field(default=None, repr=False)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: str = "body"


STANDARD: tuple[type[JointEffect], ...] = (RotorInertia, ViscousFriction, CoulombFriction, JointOffset)
"""Laws that a fit has at every joint by default, as in the identification of robots (Gautier)."""
EVERY: tuple[type[JointEffect], ...] = (
    *STANDARD, StribeckFriction, LoadFriction, AsymmetricViscous, JointSpring, EncoderOffset, MotorGain
)  # fmt: skip
"""Laws that a ranking tries at every joint. Asymmetric Coulomb friction is Coulomb friction with an offset."""
ACROSS: tuple[type[JointEffect], ...] = (RotorInertia, ViscousFriction, CoulombFriction)
"""Laws that a ranking tries of a motor that turns with two neighbouring joints."""
OF_BODIES: tuple[type[JointEffect], ...] = (EncoderOffset, BaseInclination)
"""Laws that act through the bodies' torques alone: where a joint stands, and where gravity points."""
