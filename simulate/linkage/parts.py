"""Parts and elements that a linkage is made of, as plain data.

All positions are those of the design position in body axes (ISO 8855, origin midway between the front wheel centres)
[m]; every part's own axes are parallel to them there. SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lacet.simulate.cars import Inertia

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Joint:
    """A joint of a part on its parent, at 0 in the design position.

    `kind` : slide along, or hinge about, `axis` (unit vector), or ball; `at` : its place; `armature` : rotor inertia
    between the two parts that has no momentum of its own [kg or kg·m²].
    """

    name: str
    kind: Literal["slide", "hinge", "ball"]
    at: Point
    axis: Point = (0.0, 0.0, 1.0)
    armature: float = 0.0


@dataclass(frozen=True)
class Part:
    """A rigid body on the joints that connect it with its `parent`; "chassis" is the root."""

    name: str
    parent: str
    inertia: Inertia
    joints: tuple[Joint, ...]


@dataclass(frozen=True)
class End:
    """A point fixed to a part."""

    part: str
    at: Point


@dataclass(frozen=True)
class Rod:
    """A link without mass between two ball joints.

    Rigid: of constant length. On rubber: `stiffness` [N/m] and `damping` [N·s/m] along itself.
    """

    name: str
    a: End
    b: End
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Spring:
    """A coil spring along the line between its ends: `stiffness` [N/m], preloaded to hold the design position."""

    name: str
    a: End
    b: End
    stiffness: float


@dataclass(frozen=True)
class Damper:
    """A damper along the line between its ends, `damping` [N·s/m], in series with its upper mount.

    On rubber the mount has `mount_stiffness` [N/m] and `mount_damping` [N·s/m]; rigid, it has no give.
    """

    name: str
    a: End
    b: End
    damping: float
    mount_stiffness: float
    mount_damping: float


@dataclass(frozen=True)
class Bushing:
    """A rubber bushing at one point of parts `a` and `b`.

    On rubber it resists the displacement of b's point in a's axes: `stiffness` [N/m], `damping` [N·s/m] by direction.
    Rigid, the displacement is 0 in the directions `held`.
    """

    name: str
    a: str
    b: str
    at: Point
    stiffness: Point
    damping: Point
    held: tuple[bool, bool, bool]


@dataclass(frozen=True)
class Tie:
    """In the rigid variant: the displacements of two bushings in direction `component` have the sum 0."""

    name: str
    bushings: tuple[str, str]
    component: int


@dataclass(frozen=True)
class Torsion:
    """A torsion spring on the angle of hinge `first`, less that of `second` where there is one.

    `stiffness` [N·m/rad], `damping` [N·m·s/rad].
    """

    name: str
    first: str
    second: str | None
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Rubber:
    """Rubber that resists the rotation of a part on a ball joint, alike about every axis.

    `joint` : the ball; `stiffness` [N·m/rad] times the rotation vector; `damping` [N·m·s/rad].
    """

    joint: str
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Linkage:
    """Parts of one or more suspensions with the elements between them.

    `carriers` : name of the part that carries the wheel, by corner; wheels are parts ``wheel_fl`` … on hinges
    ``spin_fl`` …
    """

    parts: tuple[Part, ...] = ()
    rods: tuple[Rod, ...] = ()
    springs: tuple[Spring, ...] = ()
    dampers: tuple[Damper, ...] = ()
    bushings: tuple[Bushing, ...] = ()
    ties: tuple[Tie, ...] = ()
    torsions: tuple[Torsion, ...] = ()
    rubbers: tuple[Rubber, ...] = ()
    carriers: tuple[tuple[str, str], ...] = ()

    def part(self, name: str) -> Part:
        """A part by name."""
        return next(part for part in self.parts if part.name == name)

    def __add__(self, other: Linkage) -> Linkage:
        return Linkage(
            self.parts + other.parts,
            self.rods + other.rods,
            self.springs + other.springs,
            self.dampers + other.dampers,
            self.bushings + other.bushings,
            self.ties + other.ties,
            self.torsions + other.torsions,
            self.rubbers + other.rubbers,
            self.carriers + other.carriers,
        )
