"""URDF files (the robot description of ROS) as a table of modified Denavit–Hartenberg rows, with starting parameters.

Links on fixed joints are parts of the body that carries them. A frame of the table has the origin of its joint and the
axes of the child link, turned so that z is the joint's axis: for the axis ``0 0 1`` both are the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.errors import FileFault, nearest
from lacet.identify.multibody.chain_notes import ChainNote, FramesInserted, LinksJoined, NearlyRight
from lacet.identify.multibody.coupling import Follower
from lacet.identify.multibody.rigid_body import PARAMETERS
from lacet.identify.multibody.urdf.mdh_row import rows_of
from lacet.identify.multibody.urdf.xml_lines import Element, XmlFault, read_xml
from lacet.identify.multibody.vectors import Array

ROUNDING = 1e-11
"""Distance from a quarter turn below which an angle of a file is the rounding of it [rad]: files have 12 digits."""
_NEARLY = 1e-3
"""Distance from a quarter turn below which an angle was most likely meant to be it [rad]: ``1.57``."""
_KINDS = {"revolute": 0, "continuous": 0, "prismatic": 1, "fixed": 2}
_UNSUPPORTED = ("floating", "planar", "spherical", "ball", "screw")
_NUMBER = re.compile(r"[^\s,]+")


class UrdfError(FileFault, ValueError):
    """A URDF file with faults."""


@dataclass(frozen=True)
class UrdfRobot:
    """What a URDF file says of a robot's mechanics.

    Attributes
    ----------
    rows : rows of the table.
    names : name of each row's joint; of an inserted fixed frame that of the joint it belongs to, with ``.frame``.
    absent : parameters of bodies without inertia.
    given : inertial parameters and friction (FV, FS) of the file, as values to start from.
    followers : mimic joints.
    notes : what was joined, inserted or looks rounded.
    """

    rows: tuple[Mapping[str, float], ...]
    names: tuple[str, ...]
    absent: frozenset[str]
    given: Mapping[str, float]
    followers: tuple[Follower, ...]
    notes: tuple[ChainNote, ...]


@dataclass(frozen=True)
class _Joint:
    name: str
    line: int
    kind: str
    parent: str
    child: str
    R: Array
    p: Array
    axis: Array
    damping: float
    friction: float
    mimic: tuple[int, str, float, float] | None


def read_urdf(text: str, name: str = "URDF", rounding: float = ROUNDING) -> UrdfRobot:
    """Read the text of a URDF file; angles nearer to a quarter turn than `rounding` [rad] are taken as it.

    Raises UrdfError with every fault, line by line.
    """
    return _Reader(text, name, rounding).read()


class _Reader:
    def __init__(self, text: str, name: str, rounding: float):
        self.name, self.rounding = name, rounding
        self.faults: list[tuple[int, str]] = []
        self.nearly: dict[str, float] = {}
        try:
            self.root = read_xml(text)
        except XmlFault as error:
            raise UrdfError(name, [str(error)]) from None
        if self.root.tag != "robot":
            raise UrdfError(name, [f"line {self.root.line}: a URDF begins with <robot>, found <{self.root.tag}>"])

    def fault(self, line: int, text: str) -> None:
        self.faults.append((line, f"line {line}: {text}"))

    def stop_at_faults(self) -> None:
        if self.faults:
            raise UrdfError(self.name, [text for _, text in sorted(self.faults, key=lambda fault: fault[0])])

    def read(self) -> UrdfRobot:
        for element in self.root.inside:
            if element.tag.startswith("xacro:"):
                self.fault(element.line, f"<{element.tag}> is xacro: expand the file first (xacro robot.xacro)")
        links = self._named("link")
        joints = [self._joint(name, element) for name, element in self._named("joint").items()]
        bodies = {name: self._inertia(name, element) for name, element in links.items()}
        self.stop_at_faults()
        order = self._tree(links, joints)
        self.stop_at_faults()
        return self._table(order, bodies)

    def _named(self, tag: str) -> dict[str, Element]:
        out: dict[str, Element] = {}
        for element in self.root.all(tag):
            name = element.attributes.get("name", "")
            if not name:
                self.fault(element.line, f"a {tag} without a name")
            elif name in out:
                self.fault(element.line, f"{tag} '{name}' is there already, in line {out[name].line}")
            else:
                out[name] = element
        if not out and tag == "link":
            self.fault(self.root.line, "the robot has no link")
        return out

    def _joint(self, name: str, element: Element) -> _Joint:
        kind = element.attributes.get("type", "")
        if kind in _UNSUPPORTED:
            self.fault(
                element.line,
                f"joint '{name}' is {kind}: not supported; describe it by revolute and prismatic joints with links "
                "without inertia between them",
            )
        elif kind not in _KINDS:
            self.fault(
                element.line,
                f"joint '{name}' has the type '{kind}'{nearest(kind, _KINDS)} (there are {', '.join(_KINDS)})",
            )
        ends = [self._end(name, element, tag) for tag in ("parent", "child")]
        R, p = self._origin(element, f"joint '{name}'")
        axis = self._numbers(element.first("axis"), "xyz", (1.0, 0.0, 0.0))
        length = float(np.linalg.norm(axis))
        if kind in ("revolute", "continuous", "prismatic") and length < 1e-9:
            self.fault(element.line, f"joint '{name}': the axis has no length")
        dynamics = element.first("dynamics")
        damping, friction = (self._number(dynamics, key, 0.0) for key in ("damping", "friction"))
        mimic = element.first("mimic")
        followed = None
        if mimic is not None:
            of = mimic.attributes.get("joint", "")
            followed = mimic.line, of, self._number(mimic, "multiplier", 1.0), self._number(mimic, "offset", 0.0)
        unit = axis / length if length else np.array([0.0, 0.0, 1.0])
        return _Joint(name, element.line, kind, ends[0], ends[1], R, p, unit, damping, friction, followed)

    def _end(self, name: str, element: Element, tag: str) -> str:
        end = element.first(tag)
        if end is None or not end.attributes.get("link"):
            self.fault(element.line, f"joint '{name}' has no <{tag} link=…>")
            return ""
        return end.attributes["link"]

    def _number(self, element: Element | None, key: str, default: float) -> float:
        return float(self._numbers(element, key, (default,))[0])

    def _numbers(self, element: Element | None, key: str, default: Sequence[float]) -> Array:
        """The numbers of an attribute, as many as `default` has."""
        text = None if element is None else element.attributes.get(key)
        if element is None or text is None:
            return np.array(default)
        try:
            out = np.array([float(word) for word in _NUMBER.findall(text)])
        except ValueError:
            out = np.array([np.nan])
        if out.size != len(default) or not np.all(np.isfinite(out)):
            count = f"{len(default)} numbers" if len(default) > 1 else "a number"
            self.fault(element.line, f"<{element.tag}> {key} must be {count}, found '{text}'")
            return np.array(default)
        return out

    def _origin(self, element: Element, what: str) -> tuple[Array, Array]:
        """Rotation and translation of the <origin> inside an element."""
        origin = element.first("origin")
        angles = self._numbers(origin, "rpy", (0.0, 0.0, 0.0))
        quarters = np.round(angles / (math.pi / 2))
        off = np.abs(angles - quarters * (math.pi / 2))
        if np.any(near := (off > self.rounding) & (off < _NEARLY) & (angles != 0.0)):
            self.nearly[what] = float(np.max(off[near]))
        exact = off <= self.rounding
        c = np.where(exact, np.array([1.0, 0.0, -1.0, 0.0])[quarters.astype(int) % 4], np.cos(angles))
        s = np.where(exact, np.array([0.0, 1.0, 0.0, -1.0])[quarters.astype(int) % 4], np.sin(angles))
        Rx = np.array([[1.0, 0.0, 0.0], [0.0, c[0], -s[0]], [0.0, s[0], c[0]]])
        Ry = np.array([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]])
        Rz = np.array([[c[2], -s[2], 0.0], [s[2], c[2], 0.0], [0.0, 0.0, 1.0]])
        return Rz @ Ry @ Rx, self._numbers(origin, "xyz", (0.0, 0.0, 0.0))

    def _inertia(self, name: str, element: Element) -> Array | None:
        """(4, 4) pseudo-inertia of a link in its own frame, Σ m (x, 1)(x, 1)ᵀ; None without inertia."""
        inertial = element.first("inertial")
        if inertial is None:
            return None
        mass = self._number(inertial.first("mass"), "value", 0.0)
        tensor = inertial.first("inertia")
        xx, xy, xz, yy, yz, zz = (self._number(tensor, key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        if mass < 0.0:
            self.fault(inertial.line, f"link '{name}' has the mass {mass:g} kg")
        R, p = self._origin(inertial, f"link '{name}'")
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        out = np.zeros((4, 4))
        out[:3, :3], out[3, 3] = 0.5 * np.trace(about) * np.eye(3) - about, mass
        place = _placed(R, p)
        return place @ out @ place.T

    def _tree(self, links: Mapping[str, Element], joints: Sequence[_Joint]) -> list[_Joint]:
        """The joints, each after the one that carries it."""
        carried: dict[str, _Joint] = {}
        for joint in joints:
            for tag, end in (("parent", joint.parent), ("child", joint.child)):
                if end not in links:
                    self.fault(joint.line, f"joint '{joint.name}': its {tag} link '{end}' is not in the file"
                                           f"{nearest(end, links)}")  # fmt: skip
            if other := carried.get(joint.child):
                self.fault(
                    joint.line,
                    f"link '{joint.child}' hangs on two joints, '{other.name}' (line {other.line}) and "
                    f"'{joint.name}': a closed loop, which URDF and a tree cannot have",
                )
            carried.setdefault(joint.child, joint)
        roots = [name for name in links if name not in carried]
        if len(roots) > 1:
            for name in roots[1:]:
                self.fault(
                    links[name].line, f"link '{name}' hangs on no joint, as '{roots[0]}' does: one root is wanted"
                )
        known = {joint.name: joint for joint in joints}
        for joint in joints:
            if joint.mimic is None:
                continue
            line, of, _, _ = joint.mimic
            if of not in known:
                self.fault(line, f"joint '{joint.name}' follows '{of}', which is not in the file{nearest(of, known)}")
            elif known[of].mimic is not None or known[of].kind == "fixed" or joint.kind == "fixed":
                self.fault(line, f"joint '{joint.name}' follows '{of}': both must move, and the second freely")
        children: dict[str, list[_Joint]] = {}
        for joint in joints:
            children.setdefault(joint.parent, []).append(joint)
        out: list[_Joint] = []
        waiting = [joint for root in roots[:1] for joint in reversed(children.get(root, []))]
        while waiting:
            joint = waiting.pop()
            out.append(joint)
            waiting += reversed(children.get(joint.child, []))
        reached = {id(joint) for joint in out}
        if not self.faults and (circle := [joint for joint in joints if id(joint) not in reached]):
            names = ", ".join(f"'{joint.name}'" for joint in circle)
            self.fault(circle[0].line, f"joints {names} carry each other in a closed loop, and hang on no root")
        if not self.faults and not any(joint.kind != "fixed" for joint in out):
            self.fault(self.root.line, "no joint of the robot moves")
        return out

    def _table(self, order: Sequence[_Joint], bodies: Mapping[str, Array | None]) -> UrdfRobot:
        rows: list[dict[str, float]] = []
        names: list[str] = []
        joined: list[str] = []
        inserted: list[int] = []
        number: dict[str, int] = {}
        friction: dict[str, float] = {}
        inertia: dict[int, Array] = {}
        place: dict[str, tuple[int, Array]] = {}  # link → body it belongs to (0: the ground), its frame in that body's
        if order:
            place[order[0].parent] = 0, np.eye(4)
        for joint in order:
            body, above = place[joint.parent]
            here = above @ _placed(joint.R, joint.p)
            if joint.kind == "fixed":
                place[joint.child] = body, here
                if body and bodies[joint.child] is not None:
                    joined.append(joint.child)
            else:
                A = _to_axis(joint.axis)
                entries = rows_of(here[:3, :3] @ A, here[:3, 3])
                for fixed in entries[:-1]:
                    rows.append({"j": len(rows) + 1, "ant": body, "sigma": 2, **fixed})
                    names.append(f"{joint.name}.frame")
                    body = len(rows)
                    inserted.append(body)
                rows.append({"j": len(rows) + 1, "ant": body, "sigma": _KINDS[joint.kind], **entries[-1]})
                names.append(joint.name)
                body = number[joint.name] = len(rows)
                place[joint.child] = body, _placed(A.T, np.zeros(3))
                friction |= {f"FV{body}": joint.damping, f"FS{body}": joint.friction}
            found = bodies[joint.child]
            if body and found is not None:
                at = place[joint.child][1]
                inertia[body] = inertia.get(body, np.zeros((4, 4))) + at @ found @ at.T
        given, absent = self._parameters(len(rows), inertia)
        followers = [
            Follower(number[joint.name], number[joint.mimic[1]], joint.mimic[2], joint.mimic[3])
            for joint in order if joint.mimic is not None
        ]  # fmt: skip
        notes: list[ChainNote] = []
        if joined:
            notes.append(LinksJoined(tuple(joined)))
        if inserted:
            notes.append(FramesInserted(tuple(inserted)))
        if self.nearly:
            notes.append(NearlyRight(tuple(self.nearly), max(self.nearly.values())))
        given |= {name: value for name, value in friction.items() if value != 0.0}
        return UrdfRobot(tuple(rows), tuple(names), frozenset(absent), given, tuple(followers), tuple(notes))

    @staticmethod
    def _parameters(count: int, inertia: Mapping[int, Array]) -> tuple[dict[str, float], set[str]]:
        given: dict[str, float] = {}
        absent: set[str] = set()
        for body in range(1, count + 1):
            found = inertia.get(body)
            if found is None or not np.any(found):
                absent |= {f"{key}{body}" for key in PARAMETERS}
                continue
            about = np.trace(found[:3, :3]) * np.eye(3) - found[:3, :3]
            values = [*about[np.triu_indices(3)], *found[:3, 3], found[3, 3]]
            given |= {f"{key}{body}": float(value) for key, value in zip(PARAMETERS, values, strict=True)}
        return given, absent


def _placed(R: Array, p: Array) -> Array:
    """(4, 4) homogeneous transform."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = R, p
    return out


def _to_axis(axis: Array) -> Array:
    """(3, 3) rotation that takes z to a unit vector: the shortest turn, about x where it is half a turn."""
    x, y, z = axis
    if math.hypot(x, y) < 1e-14:
        return np.diag([1.0, math.copysign(1.0, z), math.copysign(1.0, z)])
    if z > -0.5:
        K = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
        return np.eye(3) + K + K @ K / (1.0 + z)
    # Near to −z: half a turn about x first, then the shortest turn from −z.
    half = np.diag([1.0, -1.0, -1.0])
    return half @ _to_axis(half @ axis)
