"""URDF: tree, inertias, joint damping and dry friction of an identified car. The format has no springs and no tyres."""

from __future__ import annotations

import xml.etree.ElementTree as xml

import numpy as np
from scipy.spatial.transform import Rotation

from lacet.identify.multibody.pseudo_inertia import in_units, pseudo_inertia
from lacet.identify.multibody.vectors import Array
from lacet.services.exports.car import ExportedCar, ExportedCorner, Part
from lacet.services.exports.mjcf import attribute, comment

_SHARE = 0.01
"""Part of the carrier's smallest pseudo-inertia that goes to the link between its two joints: URDF joints have one
degree of freedom each, and simulators refuse a moving link without mass."""
_LENGTH = 0.1
"""Radius of gyration of that link [m]."""
_TRAVEL = 1.0
"""Limit of travel [m] and of its rate and force, which the format demands and no car reaches."""

_ABOUT = """
 slide_*: suspension travel, compression positive, 0 at design height; steer_*: about the kingpin; spin_*: the wheel.
 The root link chassis is free: add a floating joint (Pinocchio: JointModelFreeFlyer; MuJoCo: a freejoint on chassis).
 The limits of slide_* are assumed, the format demands some.
 URDF cannot say these; apply them as forces:
"""


def urdf_text(car: ExportedCar, title: str) -> str:
    """The car as URDF text; `title` says where it comes from."""
    robot = xml.Element("robot", name=car.name)
    lines = [f"   {name}: {law}" for name, law in not_in_urdf(car).items()]
    robot.append(xml.Comment(comment(title, car) + _ABOUT + "\n".join(lines) + "\n"))
    _link(robot, "chassis", car.chassis)
    for corner in car.corners:
        _corner(robot, corner)
    xml.indent(robot)
    return '<?xml version="1.0"?>\n' + xml.tostring(robot, encoding="unicode") + "\n"


def not_in_urdf(car: ExportedCar) -> dict[str, str]:
    """What the identified car has and URDF cannot say: name → law with its numbers, at joint ``slide_…`` or wheel."""
    out: dict[str, str] = {}
    for corner in car.corners:
        c = corner.name
        out[f"spring.{c}, offset.{c}"] = f"force on slide_{c}: -({corner.stiffness:.6g} N/m s + {corner.offset:.6g} N)"
        if corner.tyre_stiffness:
            out[f"tyre_stiffness.{c}"] = (
                f"force on wheel_{c} along the road's normal: {corner.tyre_stiffness:.6g} N/m "
                f"({corner.radius:g} m - height of the wheel centre), never below 0"
            )
    for left, right, stiffness in car.bars:
        out[f"anti-roll bar {left} {right}"] = (
            f"force on slide_{left}: -{stiffness:.6g} N/m (s_{left} - s_{right}), its opposite on slide_{right}"
        )
    return out


def _corner(robot: xml.Element, corner: ExportedCorner) -> None:
    c, R, way = corner.name, corner.attitude, float(np.linalg.norm(corner.slide))
    carrier, steers = corner.carrier, corner.kingpin is not None
    if steers:
        # m diag(L², L², L², 1) is the pseudo-inertia of the link, so that the rest of the carrier is a body as well.
        smallest = float(np.linalg.eigvalsh(in_units(pseudo_inertia(carrier.ten), 1.0, _LENGTH))[0])
        mass = _SHARE * smallest
        slider = Part(mass, np.zeros(3), 2.0 * mass * _LENGTH**2 * np.eye(3))
        carrier = Part.of(carrier.ten - slider.ten)
        _link(robot, f"slider_{c}", slider)
    moved = f"slider_{c}" if steers else f"carrier_{c}"
    slide = _joint(robot, f"slide_{c}", "prismatic", "chassis", moved, R.T @ corner.slide / way, corner.centre, R)
    xml.SubElement(slide, "limit", lower=f"{-_TRAVEL}", upper=f"{_TRAVEL}", effort="1e6", velocity="1e3")
    xml.SubElement(
        slide, "dynamics", damping=attribute(corner.damping / way**2), friction=attribute(corner.friction / way)
    )
    if corner.kingpin is not None:
        _joint(robot, f"steer_{c}", "continuous", moved, f"carrier_{c}", R.T @ corner.kingpin)
    _link(robot, f"carrier_{c}", carrier)
    _joint(robot, f"spin_{c}", "continuous", f"carrier_{c}", f"wheel_{c}", np.array([0.0, 1.0, 0.0]))
    _link(robot, f"wheel_{c}", corner.wheel)
    if corner.rim is not None:
        _joint(robot, f"transducer_{c}", "fixed", f"wheel_{c}", f"rim_{c}", None)
        _link(robot, f"rim_{c}", corner.rim)


def _link(robot: xml.Element, name: str, part: Part) -> None:
    link = xml.SubElement(robot, "link", name=name)
    inertial = xml.SubElement(link, "inertial")
    xml.SubElement(inertial, "origin", xyz=attribute(part.com), rpy="0 0 0")
    xml.SubElement(inertial, "mass", value=attribute(part.mass))
    t = part.tensor
    names = {"ixx": t[0, 0], "ixy": t[0, 1], "ixz": t[0, 2], "iyy": t[1, 1], "iyz": t[1, 2], "izz": t[2, 2]}
    xml.SubElement(inertial, "inertia", {key: attribute(value) for key, value in names.items()})


def _joint(
    robot: xml.Element, name: str, kind: str, parent: str, child: str, axis: Array | None,
    at: Array | None = None, R: Array | None = None,
) -> xml.Element:  # fmt: skip
    joint = xml.SubElement(robot, "joint", name=name, type=kind)
    xml.SubElement(joint, "parent", link=parent)
    xml.SubElement(joint, "child", link=child)
    turned = np.zeros(3) if R is None else Rotation.from_matrix(R).as_euler("xyz")
    xml.SubElement(joint, "origin", xyz=attribute(np.zeros(3) if at is None else at), rpy=attribute(turned))
    if axis is not None:
        xml.SubElement(joint, "axis", xyz=attribute(axis))
    return joint
