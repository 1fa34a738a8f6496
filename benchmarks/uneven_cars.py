"""Cars whose tyres and released brakes differ from wheel to wheel, as those of a set on a road car do.

Sources: alignment to 0.1° a wheel, as service manuals ask; conicity, a random quantity of production, of the order of
0.05° of slip angle, and stiffness of tyres of one type to some per cent (H. B. Pacejka, Tyre and Vehicle Dynamics,
2012, chapter 4); rolling resistance of passenger tyres 0.0065 to 0.0105 and more, classes A to E of Regulation (EU)
2020/740, and higher while cold; drag of a released disc brake up to 4 N·m, the limit of a service manual (Mitsubishi
Eclipse, 1997).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.simulate import Car

NEUTRAL_SLIP = np.hypot(np.radians(0.1), np.radians(0.05))
"""1 σ of a wheel's slip angle without lateral force, toe and conicity [rad]."""
CORNERING = 0.04
"""1 σ of the cornering stiffness of a tyre, as a part of it."""
ROLLING = (0.0115, 0.0025)
"""Mean and 1 σ of the rolling resistance of a set of tyres."""
ROLLING_OWN = 0.05
"""1 σ of the rolling resistance of a tyre, as a part of the set's: pressure and temperature."""
TRAIL = 0.2
"""1 σ of the pneumatic trail of a set, as a part of it."""
DEGRESSION = (0.05, 0.25)
"""Least and largest relative loss of cornering stiffness per relative load of a set."""
BRAKE_DRAG = (0.0, 4.0)
"""Least and largest torque of a released brake [N·m]."""


def uneven_car(rng: np.random.Generator, like: Car) -> Car:
    """The car with tyres of a set drawn anew, each a little unlike the others, and brakes that drag."""
    tyre = replace(
        like.tyre,
        rolling_resistance=float(rng.normal(*ROLLING)),
        trail=like.tyre.trail * (1.0 + TRAIL * float(rng.standard_normal())),
        degression=float(rng.uniform(*DEGRESSION)),
    )
    tyres, corners = {}, {}
    for corner in CORNERS:
        slip, rolling, stiffness = rng.standard_normal(3).tolist()
        tyres[corner] = replace(
            tyre,
            neutral_slip=NEUTRAL_SLIP * slip,
            rolling_resistance=tyre.rolling_resistance * (1.0 + ROLLING_OWN * rolling),
        )
        axle = like.axle(corner)
        corners[corner] = replace(
            axle, cornering=axle.cornering * (1.0 + CORNERING * stiffness), brake_drag=float(rng.uniform(*BRAKE_DRAG))
        )
    return replace(like, tyre=tyre, tyres=tyres, corners=corners)
