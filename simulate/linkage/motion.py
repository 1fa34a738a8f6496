"""Motion of a second car: what its sensors need, with the wheels' motion as the mechanism gave it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.motion import CarMotion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinkageMotion(CarMotion):
    """The motion and forces of one drive of a second car.

    Attributes beside those of `CarMotion`
    ----------
    centres : (N, 4, 3) wheel centres, `attitudes` : (N, 4, 3, 3) R_body_carrier, body axes.
    centre_velocity, centre_acceleration, carrier_rate, carrier_rate_change : (N, 4, 3) in space, body axes.
    q, v, a : coordinates of the mechanism (N, nq), velocities and accelerations (N, nv).
    """

    car: SecondCar
    centres: Array
    attitudes: Array
    centre_velocity: Array
    centre_acceleration: Array
    carrier_rate: Array
    carrier_rate_change: Array
    q: Array
    v: Array
    a: Array

    @property
    def own_wheel_centres(self) -> Array:
        """(N, 4, 3) wheel centres, body axes [m]."""
        return self.centres

    @cached_property
    def own_carrier_attitude(self) -> Array:
        """(N, 4, 3, 3) R_body_carrier."""
        return self.attitudes

    @cached_property
    def wheel_centre_motion(self) -> tuple[Array, Array]:
        """Velocity and acceleration (N, 4, 3) of the wheel centres, body axes [m/s, m/s²]."""
        return self.centre_velocity, self.centre_acceleration

    @cached_property
    def carrier_turn(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration (N, 4, 3) of the carriers, body axes [rad/s, rad/s²]."""
        return self.carrier_rate, self.carrier_rate_change

    @property
    def travel(self) -> Array:
        """(N, 4) travel of the wheel centres from the design position along body z [m], compression positive."""
        return self.centres[:, :, 2] - self.car.wheel_centres[:, 2]

    def truth(self) -> dict[str, Any]:
        """True parameters and settings of the run, JSON-able, with what the mechanism gives at the design position."""
        from lacet.simulate.linkage.truth import design_truth

        return {**super().truth(), "design": design_truth(self.car)}
