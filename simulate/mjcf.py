"""MuJoCo model of the car: chassis, carriers and wheels, and the bodies that hidden effects add."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.simulate.cars import Car, Inertia, rot_x
from lacet.simulate.hidden import Hidden, total_at, total_of
from lacet.simulate.twist import Twist, split

Array = NDArray[np.float64]

STEER_ARMATURE = 1e4  # kg·m²


class Attached(Protocol):
    """A further body on the car.

    `name` of its effect, `at` its mount (body axes), `taken` the part of the chassis' inertia that it is made of,
    `joints` names of its joints, `states` number of its further states.
    """

    name: str
    at: tuple[float, float, float]
    taken: Inertia | None
    joints: tuple[str, ...]
    states: int

    def body(self, origin: tuple[float, float, float]) -> str:
        """MJCF of the body; `origin` of its parent's axes in body axes [m]."""
        ...

    def load(self, engine: Any, dofs: Sequence[int], states: Sequence[float]) -> tuple[Array, list[float]]:
        """Generalised forces (nv,) at the engine's present state, and the rates of its states."""
        ...


def numbers(values: Any) -> str:
    """Numbers as an MJCF attribute."""
    return " ".join(repr(float(v)) for v in np.ravel(values))


def inertial(body: Inertia, origin: NDArray[np.float64]) -> str:
    """MJCF of a body's inertia in axes at `origin`."""
    t = np.asarray(body.tensor)
    full = (t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
    return (
        f'<inertial pos="{numbers(np.asarray(body.com) - origin)}" mass="{body.mass!r}" fullinertia="{numbers(full)}"/>'
    )


def _quaternion(R: NDArray[np.float64]) -> NDArray[np.float64]:
    w = math.sqrt(max(0.0, 1.0 + R[0, 0] + R[1, 1] + R[2, 2])) / 2.0  # small static angles: w is near 1
    return np.array([w, *((R[2, 1] - R[1, 2]), (R[0, 2] - R[2, 0]), (R[1, 0] - R[0, 1]))]) / [1, 4 * w, 4 * w, 4 * w]


def slide_directions(car: Car, hidden: Sequence[Hidden]) -> NDArray[np.float64]:
    """(4, 3) displacement of each wheel centre per unit of travel, body axes; z without a hidden effect on it."""
    out = np.tile([0.0, 0.0, 1.0], (4, 1))
    for i, corner in enumerate(CORNERS):
        out[i, 0] = total_at(hidden, "anti_dive", corner)
        out[i, 1] = total_at(hidden, "jacking", corner) * (1.0 if corner[1] == "l" else -1.0)
    return out


def wheel_turns(car: Car, hidden: Sequence[Hidden]) -> NDArray[np.float64]:
    """(4, 3) rotation of each carrier per metre of travel [rad/m], body axes; 0 without a hidden effect on it."""
    out = np.zeros((4, 3))
    for i, corner in enumerate(CORNERS):
        side = 1.0 if corner[1] == "l" else -1.0
        out[i, 0] = -side * total_at(hidden, "camber_change", corner)
        out[i, 1] = total_at(hidden, "pitch_change", corner)
        out[i, 2] = -side * total_at(hidden, "toe_change", corner)
    return out


def _carrier(
    car: Car, i: int, slide: NDArray[np.float64], turn: NDArray[np.float64], steered: bool, origin: Any
) -> str:
    corner = CORNERS[i]
    axle, R0, centre = car.axle(corner), car.design_attitude(corner), car.wheel_centres[i] - origin
    carrier = Inertia.of(axle.carrier_mass, np.zeros(3), np.diag(axle.carrier_inertia))
    spin, side = axle.spin_inertia, axle.inboard_transverse + axle.outboard_transverse
    wheel = Inertia.of(axle.inboard_mass + axle.outboard_mass, np.zeros(3), np.diag([side, spin, side]))
    joints = f'<joint name="slide_{corner}" type="slide" axis="{numbers(R0.T @ slide)}"/>'
    if np.any(turn):
        joints += f'<joint name="turn_{corner}" type="hinge" axis="{numbers(R0.T @ turn)}"/>'
    if steered:
        joints += (
            f'<joint name="steer_{corner}" type="hinge" axis="{numbers(R0.T @ car.kingpin(corner))}" '
            f'armature="{STEER_ARMATURE!r}"/>'
        )
    return (
        f'<body name="carrier_{corner}" pos="{numbers(centre)}" quat="{numbers(_quaternion(R0))}">'
        f"{inertial(carrier, np.zeros(3))}{joints}"
        f'<body name="wheel_{corner}">{inertial(wheel, np.zeros(3))}'
        f'<joint name="spin_{corner}" type="hinge" axis="0 1 0"/></body></body>'
    )


def level(hidden: Sequence[Hidden]) -> NDArray[np.float64]:
    """(3, 3) rotation from axes of the road to level ones: the identity without a hidden slope."""
    grade, bank = total_of(hidden, "slope.grade"), total_of(hidden, "slope.bank")
    c, s = math.cos(grade), math.sin(grade)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ rot_x(bank) if grade or bank else np.eye(3)


def steered_corners(car: Car, hidden: Sequence[Hidden]) -> list[bool]:
    """Whether each carrier rotates about a kingpin axis."""
    return [car.axle(c).steered or total_at(hidden, "steer_compliance", c) != 0.0 for c in CORNERS]


def build_mjcf(
    car: Car, slides: NDArray[np.float64], hidden: Sequence[Hidden] = (), attached: Sequence[Attached] = ()
) -> tuple[str, Twist | None]:
    """The car as MJCF text, and the two parts of a chassis that twists. Raises UsageError for impossible sizes."""
    chassis = car.chassis
    for part in attached:
        if part.taken is not None:
            chassis = chassis - part.taken
            if chassis.mass <= 0.0 or np.linalg.eigvalsh(np.asarray(chassis.tensor))[0] <= 0.0:
                raise UsageError(f"{part.name}: the chassis has no {part.taken.mass:g} kg to spare at {part.at}")
    soft = next((h for h in hidden if h.effect == "chassis_torsion"), None)
    twist = None if soft is None else split(car, chassis, soft)
    steered, turns = steered_corners(car, hidden), wheel_turns(car, hidden)
    origin = np.zeros(3) if twist is None else np.array([0.0, 0.0, twist.z])
    rear_corners = [] if twist is None else [2, 3]
    front, rear = "", ""
    for i in range(4):
        if i in rear_corners:
            rear += _carrier(car, i, slides[i], turns[i], steered[i], origin)
        else:
            front += _carrier(car, i, slides[i], turns[i], steered[i], np.zeros(3))
    for part in attached:
        if twist is not None and part.at[0] < twist.middle:
            rear += part.body((0.0, 0.0, twist.z))
        else:
            front += part.body((0.0, 0.0, 0.0))
    if twist is not None:
        front += (
            f'<body name="rear_part" pos="{numbers(origin)}"><joint name="torsion" type="hinge" axis="1 0 0"/>'
            f"{inertial(twist.rear, origin)}{rear}</body>"
        )
    root = inertial(chassis if twist is None else twist.front, np.zeros(3))
    text = (
        '<mujoco model="car"><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="{numbers(level(hidden).T @ [0.0, 0.0, -car.gravity])}">'
        '<flag contact="disable" constraint="disable" sensor="disable"/></option>'
        f'<worldbody><body name="chassis"><freejoint/>{root}'
        f"{front}</body></worldbody></mujoco>"
    )
    return text, twist
