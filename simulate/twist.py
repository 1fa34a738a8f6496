"""Chassis torsion: the rear part of the chassis rotates about an x axis relative to the front part.

The two parts make up the rigid chassis: at angle 0 mass, centre of mass and inertia are those of the whole. The front
part carries body axes, IMU and front wheels; the rear part the rear wheels and everything mounted behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.errors import UsageError
from lacet.simulate.cars import Car, Inertia
from lacet.simulate.hidden import Hidden

SPREAD = 0.45
"""Distance between the parts' centres of mass in wheelbases."""
STIFFEST = 1e8
"""Largest stiffness [N·m/rad] for the integration step."""


@dataclass(frozen=True)
class Twist:
    """The two parts, hinge height z [m] and law of the hinge: stiffness·θ + damping·θ̇ + static torque [N·m]."""

    front: Inertia
    rear: Inertia
    z: float
    stiffness: float
    damping: float
    static: float

    @property
    def middle(self) -> float:
        """x [m] behind which sensors are mounted on the rear part."""
        return 0.5 * (self.front.com[0] + self.rear.com[0])

    def torque(self, angle: float, rate: float) -> float:
        """Torque [N·m] of the spring on the rear part about x."""
        return self.static - self.stiffness * angle - self.damping * rate


def split(car: Car, chassis: Inertia, effect: Hidden) -> Twist:
    """A `chassis` divided in two. Raises UsageError for an impossible stiffness or share."""
    share, z, size = effect.shape["rear"], effect.shape["z"], effect.size
    if not 0.0 < size <= STIFFEST:
        raise UsageError(f"{effect.name}: its stiffness must lie in (0, {STIFFEST:g}] N·m/rad, found {size:g}")
    if not 0.1 <= share <= 0.9:
        raise UsageError(f"{effect.name}: rear, its share of the chassis' mass, must lie in 0.1 … 0.9, found {share:g}")
    apart = np.array([SPREAD * car.wheelbase, 0.0, 0.0])
    com, tensor = np.asarray(chassis.com), np.asarray(chassis.tensor)
    own = tensor - chassis.mass * share * (1.0 - share) * apart[0] ** 2 * np.diag([0.0, 1.0, 1.0])
    if np.linalg.eigvalsh(own)[0] <= 0.0:
        raise UsageError(f"{effect.name}: the chassis is too compact to be split into two parts")
    front = Inertia.of(chassis.mass * (1.0 - share), com + share * apart, (1.0 - share) * own)
    rear = Inertia.of(chassis.mass * share, com - (1.0 - share) * apart, share * own)
    hinge = np.array([0.0, 0.0, z])
    a, b = (float(part.about(np.array([part.com[0], *hinge[1:]]))[0, 0]) for part in (front, rear))
    damping = 2.0 * effect.shape["damping"] * math.sqrt(size * a * b / (a + b))
    # static torque at angle 0: moments of the rear wheels' loads and of the rear part's weight about the hinge
    carried = car.offsets[2:] @ car.wheel_centres[2:, 1]
    empty = replace(car, payload=None).chassis
    weight = share * empty.mass * car.gravity * empty.com[1]
    return Twist(front, rear, z, size, damping, float(weight - carried))
