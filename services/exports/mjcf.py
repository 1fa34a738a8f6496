"""MJCF: an identified car as a model that MuJoCo simulates by itself."""

from __future__ import annotations

import xml.etree.ElementTree as xml
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array
from lacet.services.exports.car import ExportedCar, ExportedCorner, Part

STEP = 0.0005
"""Integration step [s]: a tenth of the period of the fastest mode, the wheel on its tyre, and less."""
STEER_GAIN = 2e5
"""Stiffness of the steering actuators [N·m/rad]: an aligning moment of 200 N·m turns a wheel by 1 mrad."""
STEER_DAMPING = 500.0
"""Damping of the steering actuators [N·m·s/rad]: near critical for a carrier with wheel of 0.5 kg·m²."""

_ABOUT = """
 steer_*: angle of the carrier about its kingpin [rad], through a stiff actuator (assumed: {gain:g} N·m/rad,
   {damping:g} N·m·s/rad).
 drive_*: torque on the wheel about its axis [N·m], a drive positive and a brake negative; it reacts on the carrier.
 tyre_*: vertical tyre spring between the flat road z = 0 and the wheel centre, upward only; it needs no control.
 Along and across the road there is no tyre force: lacet measures those forces and has no law for them. Apply yours to
 the wheels (data.xfrc_applied), or add contact. Springs are wheel rates along body z; travel is 0 at design height.
"""


def mjcf_text(car: ExportedCar, title: str) -> str:
    """The car as MJCF text; `title` says where it comes from."""
    root = xml.Element("mujoco", model=car.name)
    root.append(xml.Comment(comment(title, car) + _ABOUT.format(gain=STEER_GAIN, damping=STEER_DAMPING)))
    _add(root, "compiler", angle="radian", autolimits="true")
    _add(root, "option", gravity=f"0 0 -{STANDARD_GRAVITY}", timestep=STEP, integrator="implicitfast")
    visual = _add(root, "visual")
    _add(visual, "global", offwidth=1280, offheight=720)
    sky = {"rgb1": "0.9 0.95 1", "rgb2": "0.6 0.7 0.85", "width": 64, "height": 384}
    _add(_add(root, "asset"), "texture", type="skybox", builtin="gradient", **sky)
    world = _add(root, "worldbody")
    _add(world, "light", pos="0 0 6", dir="0 0 -1", directional="true", castshadow="false")
    _add(world, "geom", name="road", type="plane", size="0 0 1", rgba="0.75 0.78 0.8 1", contype=0, conaffinity=0)
    _add(world, "site", name="road", pos="0 0 0")
    body = _add(world, "body", name="chassis", pos=(0.0, 0.0, car.height))
    _add(body, "freejoint", name="car")
    _inertial(body, car.chassis)
    length = -min(corner.centre[0] for corner in car.corners)
    width = max(corner.centre[1] for corner in car.corners)
    box = {"contype": 0, "conaffinity": 0, "mass": 0, "rgba": "0.2 0.35 0.6 0.5"}
    _add(body, "geom", type="box", pos=(-0.5 * length, 0.0, 0.25), size=(0.5 * length, 0.6 * width, 0.2), **box)
    _add(body, "site", name="origin", pos="0 0 0")
    for corner in car.corners:
        _corner(body, corner)
    if car.bars:
        tendons = _add(root, "tendon")
        for left, right, stiffness in car.bars:
            bar = _add(tendons, "fixed", name=f"bar_{left}_{right}", stiffness=stiffness, springlength=0)
            for name, sign in ((left, 1.0), (right, -1.0)):
                way = next(np.linalg.norm(c.slide) for c in car.corners if c.name == name)
                _add(bar, "joint", joint=f"slide_{name}", coef=sign / float(way))
    actuators = _add(root, "actuator")
    for corner in car.corners:
        _actuators(actuators, corner)
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def comment(title: str, car: ExportedCar) -> str:
    """The comment at the head of a model: what is identified, chosen and left out."""
    parts = [f" {title}", "SI units; x forward, y left, z up; origin midway between the front wheel centres."]
    parts += ["Identified:", *(f"  {line}" for line in car.identified)]
    parts += ["Chosen:", *(f"  {line}" for line in car.chosen)]
    parts += ["Left out:", *(f"  {name}: {why}" for name, why in car.left_out.items())] if car.left_out else []
    return "\n ".join(line.replace("--", "−−") for line in parts) + "\n"


def _corner(parent: xml.Element, corner: ExportedCorner) -> None:
    c, R = corner.name, corner.attitude
    way = float(np.linalg.norm(corner.slide))
    carrier = _add(parent, "body", name=f"carrier_{c}", pos=corner.centre, quat=quaternion(R))
    _inertial(carrier, corner.carrier)
    k = corner.stiffness / way**2
    slide = {"stiffness": k, "springref": -corner.offset / way / k} if k else {}
    _add(
        carrier, "joint", name=f"slide_{c}", type="slide", axis=R.T @ corner.slide / way,
        damping=corner.damping / way**2, frictionloss=corner.friction / way, **slide,
    )  # fmt: skip
    if corner.kingpin is not None:
        _add(carrier, "joint", name=f"steer_{c}", type="hinge", axis=R.T @ corner.kingpin)
    wheel = _add(carrier, "body", name=f"wheel_{c}")
    _inertial(wheel, corner.wheel)
    _add(wheel, "joint", name=f"spin_{c}", type="hinge", axis="0 1 0")
    tyre = {"type": "cylinder", "euler": f"{np.pi / 2} 0 0", "contype": 0, "conaffinity": 0, "mass": 0}
    _add(wheel, "geom", size=(corner.radius, 0.09), rgba="0.15 0.15 0.15 1", **tyre)
    if corner.rim is not None:
        wheel = _add(wheel, "body", name=f"rim_{c}")
        _inertial(wheel, corner.rim)
    _add(wheel, "site", name=f"centre_{c}", pos="0 0 0")


def _actuators(parent: xml.Element, corner: ExportedCorner) -> None:
    c = corner.name
    if corner.kingpin is not None:
        _add(parent, "position", name=f"steer_{c}", joint=f"steer_{c}", kp=STEER_GAIN, kv=STEER_DAMPING)
    _add(parent, "motor", name=f"drive_{c}", joint=f"spin_{c}")
    if corner.tyre_stiffness:
        # δ = R0 − h/cos γ at the camber that the wheel has at design height.
        upright = float(np.sqrt(1.0 - corner.attitude[2, 1] ** 2))
        kt, damping = corner.tyre_stiffness, corner.tyre_damping
        _add(
            parent, "general", name=f"tyre_{c}", site=f"centre_{c}", refsite="road", gear="0 0 1 0 0 0", gainprm=0,
            biastype="affine", biasprm=(kt * corner.radius, -kt / upright, -damping / upright), forcerange="0 1e6",
        )  # fmt: skip


def quaternion(R: Array) -> Array:
    """Unit quaternion of a rotation matrix, scalar first."""
    return np.roll(Rotation.from_matrix(R).as_quat(), 1)


def _inertial(parent: xml.Element, part: Part) -> None:
    t = part.tensor
    full = (t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
    _add(parent, "inertial", pos=part.com, mass=part.mass, fullinertia=full)


def _add(parent: xml.Element, tag: str, **attributes: Any) -> xml.Element:
    return xml.SubElement(parent, tag, {key: attribute(value) for key, value in attributes.items()})


def attribute(value: Any) -> str:
    """A number, several numbers or a text as an attribute of XML."""
    if isinstance(value, str | int):
        return str(value)
    return " ".join(repr(float(v)) for v in np.ravel(value))
