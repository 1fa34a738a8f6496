"""Tilt of the ground lasers: beams that are not vertical to the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.body_motion import body_attitude
from lacet.identify.car.road import Road
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array, unit
from lacet.identify.signals.reconstruct import Recording


class LaserTilt(SensorFault):
    """All ground-laser beams turned by a small angle about a body axis.

    ``pitch`` is about y, the lower end to the rear; ``roll`` about x, the lower end to the left. A laser at the height
    H above the road, along the road's normal n, reads d = H / (−n·b) along its beam b, which is −z by the rig. Turned
    by p it reads, to first order, d (1 − p n_x / n_z) in pitch and d (1 + p n_y / n_z) in roll.
    """

    name = "laser_tilt"
    about = "ground lasers that do not look straight down"
    signature = "tyre rows follow pitch or roll of the body relative to the road"
    shown_by = "braking (pitch), cornering (roll)"
    source = "plane geometry of a beam and a road; docs/rows.md, tyre rows"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Two variants: tilted in pitch and in roll."""
        return [cls("pitch"), cls("roll")]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Angle of the beams."""
        return (self.named("angle", "rad", -0.2, 0.2),)

    def channels(self) -> tuple[str, ...]:
        """The channels of all ground lasers."""
        return tuple(f"laser.{c}.ground" for c in CORNERS)

    def perturb(self, channel: str, recording: Recording) -> Array:
        """−d n_x / n_z or d n_y / n_z, n the road's normal in body axes."""
        return recording.signals.value[channel] * self._slope(recording)

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """What a beam straight down would read: d (cos p + sin p n_x / n_z), or with −n_y; 5° alone read 0.4 % more."""
        return recording.signals.value[channel] * (np.cos(p) - np.sin(p) * self._slope(recording))

    def _slope(self, recording: Recording) -> Array:
        """(N,) of the road across the axis the beams turn about: −n_x / n_z or n_y / n_z."""
        signals, n = recording.signals, recording.t.size
        road = Road(signals, recording.rig, recording.vehicle, n)
        normal = road.plane(body_attitude(signals.value, recording.rig), unit(2) * np.zeros(n)).normal
        return -normal[0] / normal[2] if self.where == "pitch" else normal[1] / normal[2]

    @property
    def tolerance(self) -> str:
        """The sheet's misalignment of the lasers."""
        return "misalignment"
