"""Road under the car, from the ground lasers: its normal, and the wheel centres' heights above it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.body_motion import vertical
from lacet.identify.car.motion import ConditionalTravel
from lacet.identify.multibody.vectors import Array, cross, dot, unit
from lacet.identify.signals.for_equations import laser_mount
from lacet.identify.signals.reconstruct import Signals

ABOVE = 0.005
"""Largest distance along x of a ground laser from its wheel's centre at which it measures the road under the tyre [m].
"""


@dataclass(frozen=True)
class RoadPlane:
    """Plane of the road under the car: unit `normal` (3, N) in body axes, and its `rate` [1/s]."""

    normal: Array
    rate: Array


class Road:
    """Plane through the points of the road that the ground lasers measure, and wheel-centre heights above it.

    Parameters
    ----------
    signals : N samples of all channels.
    """

    def __init__(self, signals: Signals, rig: Rig, vehicle: Vehicle, n: int):
        self.signals, self.vehicle, self.n = signals, vehicle, n
        self.mount = {c: laser_mount(rig, vehicle.corners[c]) for c in CORNERS}
        self.grounds = tuple(c for c in CORNERS if f"laser.{c}.ground" in signals.value)

    @property
    def ahead(self) -> float:
        """Distance of ground lasers ahead of their wheels' centres [m], negative behind: the largest in magnitude."""
        every = [float(self.mount[c][0] - self.vehicle.corners[c].position[0]) for c in self.grounds]
        return max(every, key=abs, default=0.0)

    @property
    def flat(self) -> bool:
        """Whether fewer than three lasers measure the ground, so that the road counts as level."""
        return len(self.grounds) < 3

    def centre_z(self, c: str) -> tuple[Array, Array, Array]:
        """Wheel-centre height in body axes [m] and its derivatives, (N,); at design height where it is not measured."""
        hub, rate, accel = self.signals.scalar(f"laser.{c}.hub", self.n)
        if f"laser.{c}.hub" not in self.signals.value:
            return hub + self.vehicle.corners[c].position[2], rate, accel
        return self.mount[c][2] - hub, -rate, -accel

    def travel(self, c: str) -> tuple[Array, Array, Array]:
        """Suspension travel [m], compression positive, and its derivatives, (N,)."""
        z, rate, accel = self.centre_z(c)
        return z - self.vehicle.corners[c].position[2], rate, accel

    def conditional_travel(self, c: str) -> ConditionalTravel | None:
        """Suspension travel of a corner given the hub laser's record; None where that is exact or absent."""
        name, signals = f"laser.{c}.hub", self.signals
        if name not in signals.mean:
            return None
        travel = self.mount[c][2] - self.vehicle.corners[c].position[2] - signals.mean[name][0]
        return ConditionalTravel(
            travel, -signals.mean_rate[name][0], signals.sigma[name][0], signals.rate_sigma[name][0],
            signals.rate_rms[name][0],
        )  # fmt: skip

    def point(self, c: str) -> Array:
        """(3, N) point of the road under a ground laser, body axes."""
        mount = self.mount[c]
        z = mount[2] - self.signals.value[f"laser.{c}.ground"][0]
        return np.stack([np.full(self.n, mount[0]), np.full(self.n, mount[1]), z])

    def plane(self, attitude: Array | None, omega: Array) -> RoadPlane:
        """Plane through the points of the road that the ground lasers measure.

        `attitude`, `omega` : of the body, for a flat road where there are fewer than three lasers.
        """
        if not self.flat:
            xy = np.array([[1.0, self.mount[c][0], self.mount[c][1]] for c in self.grounds])
            z = np.stack([self.point(c)[2] for c in self.grounds])
            z_rate = -np.stack([self.signals.scalar(f"laser.{c}.ground", self.n)[1] for c in self.grounds])
            fit = np.linalg.pinv(xy)[1:]
            up = np.concatenate([-fit @ z, np.ones((1, self.n))])
            size = np.linalg.norm(up, axis=0)
            normal, swing = up / size, np.concatenate([-fit @ z_rate, np.zeros((1, self.n))]) / size
            return RoadPlane(normal, swing - normal * dot(normal, swing))
        normal = vertical(attitude, self.n)
        return RoadPlane(normal, cross(normal, omega))

    def height(self, c: str, plane: RoadPlane, centre: Array, velocity: Array) -> tuple[Array, Array]:
        """(N,) height of a wheel centre above the road along its normal [m], and its rate [m/s].

        `centre` (3, N) and its rate `velocity` : relative to the body.
        """
        if c not in self.grounds:
            return np.full(self.n, self.vehicle.corners[c].height), np.zeros(self.n)
        ground_rate = self.signals.scalar(f"laser.{c}.ground", self.n)[1]
        gap = centre - self.point(c)
        return dot(gap, plane.normal), dot(velocity + unit(2) * ground_rate, plane.normal) + dot(gap, plane.rate)
