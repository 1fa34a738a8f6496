"""Notes of a chain that was read from a table or a file: what was assumed, left out or not used."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LoopsCut:
    """Closed loops, read as the equivalent tree of bodies 1 to `bodies`; `joints` : where it is cut, one a loop."""

    bodies: int
    joints: tuple[int, ...]


@dataclass(frozen=True)
class LoadsLeftOut:
    """External forces and moments that a file gives (``FX``, ``CZ``), left out of the model."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class GeometryMissing:
    """Lengths and angles that a file does not have (``b``, ``gamma``), taken as 0 at every joint."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class ParametersMissing:
    """Inertial parameters that a file does not have (``XX``, ``M``): every body is taken to have them."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class ConstantPosition:
    """A number in place of a joint's position, taken as the constant part beside it.

    Attributes
    ----------
    key : ``theta`` of a revolute joint [rad], ``r`` of a prismatic one [m].
    joint : its number.
    text : the number as the file has it.
    """

    key: str
    joint: int
    text: str


@dataclass(frozen=True)
class GravityAssumed:
    """Gravity that a file leaves open.

    Attributes
    ----------
    gravity : what is taken: acceleration in the ground frame [m/s²].
    symbols : those of the file's G that have no value; none where the file has no G.
    """

    gravity: tuple[float, ...]
    symbols: tuple[str, ...] = ()


@dataclass(frozen=True)
class ValuesUnused:
    """Values that were given for symbols (`names`) which the table or the file does not have."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class LinksJoined:
    """Links (`names`) on fixed joints whose inertia was added to that of the body which carries them."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class FramesInserted:
    """Fixed frames (`numbers`) in front of joints whose axes are nearly parallel to those before them."""

    numbers: tuple[int, ...]


@dataclass(frozen=True)
class NearlyRight:
    """Angles of a file that are nearly quarter turns, and most likely are meant to be.

    Attributes
    ----------
    places : joints and links that have them.
    most : largest distance from a quarter turn [rad].
    """

    places: tuple[str, ...]
    most: float


ChainNote = (
    LoopsCut | LoadsLeftOut | GeometryMissing | ParametersMissing | ConstantPosition | GravityAssumed | ValuesUnused
    | LinksJoined | FramesInserted | NearlyRight
)  # fmt: skip
"""A note of a chain."""
