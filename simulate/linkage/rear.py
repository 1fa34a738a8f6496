"""Rear suspensions of the second car: a twist beam, or an undriven live axle with a Panhard rod.

Twist beam: two trailing arms with their wheels, joined by a beam that bends little and twists easily: two rigid halves
on a hinge along the beam's shear centre, with a torsion spring; each pivots on the chassis on a rubber bushing.

Live axle: one rigid beam with both wheels, on two lower trailing links, an upper one in the middle, and a Panhard rod
from the chassis on the left to the beam on the right; springs, dampers, and an anti-roll bar with drop links.
"""

from __future__ import annotations

import numpy as np

from lacet.simulate.cars import Car, Inertia
from lacet.simulate.linkage.front import bar_of, on_side, six_joints, upright, wheel_part
from lacet.simulate.linkage.parts import (
    Bushing,
    Damper,
    End,
    Joint,
    Linkage,
    Part,
    Point,
    Rod,
    Spring,
    Tie,
    Torsion,
)

SIDES = ((1.0, "l"), (-1.0, "r"))


def above(side: float, x: float, y: float, z: float) -> End:
    """A point of the chassis, given for the left side."""
    return End("chassis", on_side(side, x, y, z))


def twist_beam(car: Car) -> Linkage:
    """The twist-beam axle of a car: wheel centres, wheels and static angles are the car's."""
    x, z = float(car.wheel_centres[2, 0]), float(car.wheel_centres[2, 2])
    beam: Point = (x + 0.27, 0.0, z + 0.035)
    out = Linkage(
        torsions=(Torsion("beam", "twist", None, 1500.0, 1.5),),
        ties=(Tie("pivots", ("pivot_l", "pivot_r"), 1),),
    )
    for side, letter in SIDES:
        corner, name, parent = f"r{letter}", f"trailing_{letter}", "chassis" if side > 0 else "trailing_l"
        i = 2 if side > 0 else 3
        pivot = on_side(side, x + 0.43, 0.555, z + 0.045)
        arm = Inertia.of(10.0, np.array(on_side(side, x + 0.20, 0.60, z + 0.01)), np.diag([0.10, 0.28, 0.30]))
        half = Inertia.of(6.0, np.array(on_side(side, x + 0.27, 0.28, z + 0.03)), np.diag([0.16, 0.01, 0.16]))
        at: Point = (x, side * 0.5 * car.rear.track, float(car.wheel_centres[i, 2]))
        inertia = arm + half + upright(car.axle(corner), at, car.design_attitude(corner))
        joints = six_joints(name, pivot) if side > 0 else (Joint("twist", "hinge", beam, (0.0, 1.0, 0.0)),)
        spring = (
            End(name, on_side(side, x + 0.07, 0.515, z - 0.06)),
            End("chassis", on_side(side, x + 0.09, 0.515, z + 0.20)),
        )
        damper = (
            End(name, on_side(side, x - 0.05, 0.60, z - 0.03)),
            End("chassis", on_side(side, x + 0.03, 0.575, z + 0.42)),
        )
        out = out + Linkage(
            parts=(Part(name, parent, inertia, joints), wheel_part(car, corner, name)),
            springs=(Spring(f"spring_{corner}", *spring, 26_000.0),),
            dampers=(Damper(f"damper_{corner}", *damper, 3_300.0, 6.0e5, 250.0),),
            bushings=(
                Bushing(
                    f"pivot_{letter}", "chassis", name, pivot, (1.2e6, 1.6e6, 3.0e6), (700.0, 900.0, 1200.0),
                    (True, False, True),
                ),
            ),
            carriers=((corner, name),),
        )  # fmt: skip
    return out


def live_axle(car: Car) -> Linkage:
    """The undriven live axle of a car: wheel centres, wheels and static angles are the car's."""
    x, z = float(car.wheel_centres[2, 0]), float(car.wheel_centres[2, 2])
    inertia = Inertia.of(34.0, np.array([x, 0.0, z]), np.diag([5.2, 0.25, 5.2]))
    parts, out = [], Linkage()
    for side, letter in SIDES:
        corner = f"r{letter}"
        at: Point = (x, side * 0.5 * car.rear.track, float(car.wheel_centres[2 if side > 0 else 3, 2]))
        inertia = inertia + upright(car.axle(corner), at, car.design_attitude(corner))
        parts.append(wheel_part(car, corner, "axle"))
        link_end = End("axle", on_side(side, x - 0.04, 0.52, z - 0.06))
        half_bar, drop_link = bar_of(
            "rear", side, (x - 0.22, 0.50, z + 0.06), (x - 0.03, 0.52, z + 0.07), link_end, 1.8, 4.0e5, 90.0
        )
        parts.append(half_bar)
        spring = End("axle", on_side(side, x, 0.52, z + 0.03)), End("chassis", on_side(side, x + 0.02, 0.50, z + 0.29))
        damper = (
            End("axle", on_side(side, x - 0.08, 0.56, z - 0.05)),
            End("chassis", on_side(side, x - 0.03, 0.46, z + 0.36)),
        )
        lower = (
            End("chassis", on_side(side, x + 0.52, 0.50, z - 0.02)),
            End("axle", on_side(side, x + 0.02, 0.55, z - 0.075)),
        )
        out = out + Linkage(
            rods=(
                Rod(f"lower_{letter}", *lower, 2.5e6, 1200.0),
                drop_link,
            ),
            springs=(Spring(f"spring_{corner}", *spring, 23_000.0),),
            dampers=(Damper(f"damper_{corner}", *damper, 4_200.0, 6.0e5, 250.0),),
            carriers=((corner, "axle"),),
        )
    upper = End("chassis", (x + 0.36, 0.0, z + 0.10)), End("axle", (x + 0.03, 0.0, z + 0.12))
    panhard = End("chassis", (x - 0.10, 0.52, z + 0.055)), End("axle", (x - 0.10, -0.50, z + 0.02))
    return out + Linkage(
        rods=(Rod("upper", *upper, 2.5e6, 1200.0), Rod("panhard", *panhard, 3.0e6, 1200.0)),
        parts=(Part("axle", "chassis", inertia, six_joints("axle", (x, 0.0, z))), *parts),
        torsions=(Torsion("bar_rear", "bar_rear_l", "bar_rear_r", 260.0, 0.3),),
    )
