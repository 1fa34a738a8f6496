"""The 42-body car of the paper as a modified Denavit–Hartenberg table, and its joints along a measured motion.

Joints 1–6 are the posture (lateral, longitudinal, vertical, yaw, pitch, roll). Four branches of nine follow: 7–15 rear
left, 16–24 rear right, 25–33 front left, 34–42 front right. In a branch: half track, half wheelbase, damper clearance,
steering, camber, then two rotations about the carrier's y axis, wheel rotation, tyre deflection (whose antecedent is
the carrier, never the spinning wheel).

The paper leaves q12 unnamed and calls q13 the kingpin angle. Here q12 is the carrier's pitch with suspension travel
(caster change, from the bench table) and q13 its pitch from steering about the inclined kingpin, so that the carrier's
attitude is Rz(q10) Rx(q11) Ry(q12 + q13), as cameras and bench tables give it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from lacet.daq.vehicle import Corner, KinematicTable
from lacet.identify.multibody.chain import Chain, Joint
from lacet.identify.multibody.vectors import Array, rotation, rpy
from lacet.identify.signals.spline import CubicSpline

CORNER_OF_BRANCH = ("rl", "rr", "fl", "fr")
"""Corners of the branches, in the paper's order."""

FIRST_JOINT = {corner: 7 + 9 * i for i, corner in enumerate(CORNER_OF_BRANCH)}
"""Number of a branch's first joint, by corner."""

CHASSIS = 6
AXLE = {corner: first + 4 for corner, first in FIRST_JOINT.items()}
"""The paper's numbers of the axles (wheel carriers): 11, 20, 29, 38."""
CARRIER = {corner: first + 6 for corner, first in FIRST_JOINT.items()}
"""Frames that the carriers are fixed to, the last before the wheel: 13, 22, 31, 40.

The parameters that the paper gives to C11 are those of this frame, because a carrier also pitches; without caster and
bench pitch the two are the same."""
WHEEL = {corner: first + 7 for corner, first in FIRST_JOINT.items()}
"""Body numbers of the wheels: 14, 23, 32, 41."""

# σ and the joint axis in body axes when every joint is at zero (x forward, y left, z up).
_POSTURE = ((1, "y"), (1, "x"), (1, "z"), (0, "z"), (0, "y"), (0, "x"))
_BRANCH = ((1, "y"), (1, "x"), (1, "z"), (0, "z"), (0, "x"), (0, "y"), (0, "y"), (0, "y"), (1, "z"))
_AXIS = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}


@dataclass(frozen=True)
class CarChain:
    """The car's chain and, for every frame, its constant rotation to body-like axes.

    `to_body[k]` is the 3 × 3 rotation from frame k + 1 to body-like axes (x forward, y left, z up) when every joint is
    at zero.
    """

    chain: Chain
    to_body: tuple[Array, ...]


@cache
def car_chain() -> CarChain:
    """The 42-joint table. All lengths are joint variables: half track and half wheelbase are q7, q8 and so on."""
    joints: list[Joint] = []
    turns: list[Array] = []

    def add(ant: int, sigma: int, axis: str) -> None:
        before = turns[ant - 1] if ant else np.eye(3)
        x, y, z = before.T @ _AXIS[axis]
        # Rz(γ) Rx(α) must carry z onto the new joint axis: (sin γ sin α, −cos γ sin α, cos α).
        alpha = math.atan2(math.hypot(x, y), z)
        gamma = math.atan2(x, -y) if alpha > 1e-9 else 0.0
        joints.append(Joint(len(joints) + 1, ant, sigma, gamma=gamma, alpha=alpha))
        # Multiples of a quarter turn: rounded to make axes exact.
        turns.append(np.round(before @ rotation(2, gamma) @ rotation(0, alpha), 12))

    for k, (sigma, axis) in enumerate(_POSTURE):
        add(k, sigma, axis)
    for corner in CORNER_OF_BRANCH:
        first = FIRST_JOINT[corner]
        for k, (sigma, axis) in enumerate(_BRANCH):
            ant = CHASSIS if k == 0 else CARRIER[corner] if k == 8 else first + k - 1
            add(ant, sigma, axis)
    return CarChain(Chain(joints), tuple(turns))


@dataclass(frozen=True)
class KinematicSlopes:
    """Joint positions from one corner's bench table along a travel history, with their derivatives by travel.

    For each joint of the branch (half track, half wheelbase, toe, camber, pitch): the `change` of the joint (N,), its
    `slope` by travel (N,) and the `curvature`, the slope of the slope (N,); zeros without a table.
    """

    change: Array
    slope: Array
    curvature: Array


def kinematics(corner: Corner, travel: Array, other: float = 1.0) -> KinematicSlopes:
    """A corner's bench table along `travel` (N,) [m]: value and two derivatives, (5, N) each.

    The five rows are half track, half wheelbase, steer, camber, pitch. Of joint tables it is what they give where the
    axle's other wheel moves by `other` times this travel: 1 in bump, −1 in roll, 0 held; the rack stays.

    Signs are converted from the file's (outward, toe-in, top outward) to the joints' (y to the left, steer to the left,
    positive about x). Interpolation is by a cubic spline, so that slopes are continuous; extrapolation is linear.
    """
    zeros = np.zeros((5, travel.size))
    if corner.joints is not None:
        parts = [corner.joints.own.value(travel, order).T for order in range(3)]
        if corner.joints.other is not None:
            moved = [other**order * corner.joints.other.value(other * travel, order).T for order in range(3)]
            parts = [a + b for a, b in zip(parts, moved, strict=True)]
        twice = other * corner.joints.product[:, None] * np.ones(travel.size)
        parts = [a + b for a, b in zip(parts, (twice * travel**2, 2.0 * twice * travel, 2.0 * twice), strict=True)]
        return KinematicSlopes(*(table_signs(corner) * part for part in parts))
    if corner.table is None:
        return KinematicSlopes(zeros, zeros, zeros)
    spline = table_spline(corner.table)
    low, high = corner.table.travel[0], corner.table.travel[-1]
    inside = np.clip(travel, low, high)
    signs = table_signs(corner)
    value, slope, curvature = spline.course(inside)
    beyond = np.where((travel < low) | (travel > high), 0.0, 1.0)
    change = value + slope * (travel - inside)
    return KinematicSlopes(signs * change, signs * slope, signs * curvature * beyond)


def table_signs(corner: Corner) -> Array:
    """(5, 1) signs of the joints' changes for positive values in the vehicle file: half track … pitch."""
    return np.array([[corner.side], [1.0], [-corner.side], [-corner.side], [1.0]])


def table_spline(table: KinematicTable) -> CubicSpline:
    """The natural cubic spline through a bench table's five columns."""
    columns = np.stack([table.half_track, table.half_wheelbase, table.toe, table.camber, table.pitch])
    return CubicSpline.of(table.travel, columns, natural=True)


def kingpin_pitch(corner: Corner, steer: Array) -> tuple[Array, Array, Array]:
    """Carrier pitch from steering about the inclined kingpin [rad], and its first two derivatives by the steer angle.

    From its design attitude the carrier turns by an angle δ about the kingpin axis k (top rearward by the caster,
    inward by the inclination). Written as Rz(steer) Rx(camber) Ry(pitch), the turn has a pitch that depends on the
    steer angle alone. `steer` is the angle that the camera measures, static toe included. All three are (N,).
    """
    if corner.caster == 0.0 and corner.kingpin_inclination == 0.0:
        zero = np.zeros_like(steer)
        return zero, zero, zero
    # Toe-in steers the left wheel to the right.
    return _along_kingpin(corner, 0, steer + corner.side * corner.static_toe)


def kingpin_camber(corner: Corner, steer: Array) -> tuple[Array, Array, Array]:
    """Camber from steering about the inclined kingpin [rad], and its first two derivatives by the steer angle.

    The same turn as in `kingpin_pitch`, its part about x after the steer. All three are (N,).
    """
    if corner.caster == 0.0 and corner.kingpin_inclination == 0.0:
        zero = np.zeros_like(steer)
        return zero, zero, zero
    return _along_kingpin(corner, 1, steer + corner.side * corner.static_toe)


def _along_kingpin(corner: Corner, angle: int, turned: Array) -> tuple[Array, Array, Array]:
    """Carrier pitch (`angle` 0) or camber (1), and two derivatives, where the carrier is `turned` (N,) [rad]."""
    spline = _kingpin_spline(corner.caster, corner.side * corner.kingpin_inclination).one(angle)
    value, slope, curvature = (part[0] for part in spline.course(turned))
    return value, slope, curvature


@lru_cache(maxsize=64)
def _kingpin_spline(caster: float, lean: float) -> CubicSpline:
    """Carrier pitch and camber by its yaw [rad], for an axis leaning rearward by `caster`, right by `lean` [rad]."""
    axis: Array = np.array([-math.tan(caster), -math.tan(lean), 1.0])
    axis /= float(np.linalg.norm(axis))
    delta = np.linspace(-1.0, 1.0, 401)  # rad about the kingpin: beyond any steering lock
    c, s = np.cos(delta), np.sin(delta)
    x, y, z = axis
    # Elements of the rotation about `axis` (Rodrigues) that give the three angles.
    yaw = np.arctan2(-(x * y * (1 - c) - z * s), c + y * y * (1 - c))
    pitch = np.arctan2(-(z * x * (1 - c) - y * s), c + z * z * (1 - c))
    return CubicSpline.of(yaw, np.stack([pitch, np.arcsin(y * z * (1 - c) + x * s)]))


def carrier_axes(steer: Array, camber: Array, pitch: Array) -> Array:
    """Rotation from carrier to body axes, (3, 3, N): Rz(steer) Rx(camber) Ry(pitch); angles (N,) [rad]."""
    (ca, sa), (cb, sb), (cg, sg) = ((np.cos(angle), np.sin(angle)) for angle in (steer, camber, pitch))
    out = np.empty((3, 3, steer.size))
    x, z = sb * sg, sb * cg
    out[0, 0], out[0, 1], out[0, 2] = ca * cg - sa * x, -sa * cb, ca * sg + sa * z
    out[1, 0], out[1, 1], out[1, 2] = sa * cg + ca * x, ca * cb, sa * sg - ca * z
    out[2, 0], out[2, 1], out[2, 2] = -cb * sg, sb, cb * cg
    return out


def orientation(angles: tuple[float, ...]) -> NDArray[np.float64]:
    """3 × 3 rotation from a sensor's axes to body axes, from its roll, pitch, yaw [rad]."""
    return rpy(*angles)
