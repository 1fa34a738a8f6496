"""Front suspension of the second car: double wishbones, rack steering, coil-over struts and an anti-roll bar.

On each side a lower wishbone on two bushings carries the upright by a ball joint and the strut; the upper wishbone is
two links without mass that meet in the upper ball joint, and the tie rod joins the steering arm with the rack behind
the axle. The kingpin axis runs from the lower to the upper ball joint. The bar is two halves that turn about one axis
on the chassis, a torsion spring between them, each joined to its wishbone by a drop link.
"""

from __future__ import annotations

import numpy as np

from lacet.simulate.cars import Axle, Car, Inertia
from lacet.simulate.linkage.parts import (
    Bushing,
    Damper,
    End,
    Joint,
    Linkage,
    Part,
    Point,
    Rod,
    Rubber,
    Spring,
    Torsion,
)

RACK_ARMATURE = 1e6
"""kg: the rack moves as the driver demands; no tie rod moves it by more than some nm."""
BAR_STIFFNESS = 520.0
"""N·m/rad between the halves of the front anti-roll bar."""


def on_side(side: float, x: float, y: float, z: float) -> Point:
    """A point given for the left side, on the left (`side` 1) or right (-1)."""
    return (x, side * y, z)


def six_joints(name: str, at: Point) -> tuple[Joint, ...]:
    """The joints of a part that moves freely relative to its parent: three slides, then a ball."""
    slides = [
        Joint(f"{name}_{letter}", "slide", at, axis)
        for letter, axis in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0)))
    ]
    return (*slides, Joint(f"{name}_turn", "ball", at))


def bar_of(
    axle: str, side: float, pivot: Point, end: Point, link_end: End, mass: float, stiffness: float, damping: float
) -> tuple[Part, Rod]:
    """A half of an anti-roll bar and its drop link; `pivot`, `end` for the left side, link rubber `stiffness` [N/m]."""
    letter = "l" if side > 0 else "r"
    name = f"bar_{axle}_{letter}"
    tip = on_side(side, *end)
    com = 0.5 * (np.asarray(on_side(side, *pivot)) + np.asarray(tip))
    arm = np.linalg.norm(np.subtract(end, pivot)[[0, 2]])
    tensor = np.diag([0.06, mass * arm**2 / 12.0 + 0.004, 0.06])
    part = Part(
        name,
        "chassis",
        Inertia.of(mass, com, tensor),
        (Joint(name, "hinge", on_side(side, *pivot), (0.0, 1.0, 0.0)),),
    )
    return part, Rod(f"drop_link_{axle}_{letter}", End(name, tip), link_end, stiffness, damping)


def wheel_part(car: Car, corner: str, carrier: str) -> Part:
    """The spinning parts of a wheel on their hinge."""
    axle, at = car.axle(corner), car.wheel_centres[["fl", "fr", "rl", "rr"].index(corner)]
    R = car.design_attitude(corner)
    spin, across = axle.spin_inertia, axle.inboard_transverse + axle.outboard_transverse
    inertia = Inertia.of(axle.inboard_mass + axle.outboard_mass, at, R @ np.diag([across, spin, across]) @ R.T)
    joint = Joint(f"spin_{corner}", "hinge", _point(at), _point(R[:, 1]))
    return Part(f"wheel_{corner}", carrier, inertia, (joint,))


def upright(axle: Axle, at: Point, R: np.ndarray) -> Inertia:
    """The part of a corner that does not spin, its centre of mass at the wheel centre."""
    return Inertia.of(axle.carrier_mass, np.asarray(at), R @ np.diag(axle.carrier_inertia) @ R.T)


def _point(values: np.ndarray) -> Point:
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def double_wishbone(car: Car) -> Linkage:
    """The front suspension of a car: wheel centres, wheels and static angles are the car's."""
    out = Linkage(
        parts=(
            Part(
                "rack",
                "chassis",
                Inertia.of(2.5, np.array([-0.125, 0.0, -0.0413]), np.diag([0.05, 0.002, 0.05])),
                (Joint("rack", "slide", (-0.125, 0.0, -0.0413), (0.0, 1.0, 0.0), RACK_ARMATURE),),
            ),
        )
    )
    for side, letter in ((1.0, "l"), (-1.0, "r")):
        out = out + _side(car, side, letter)
    return out + Linkage(torsions=(Torsion("bar_front", "bar_front_l", "bar_front_r", BAR_STIFFNESS, 0.4),))


def _side(car: Car, side: float, letter: str) -> Linkage:
    corner = f"f{letter}"
    centre = _point(car.wheel_centres[0 if side > 0 else 1])
    arm, carrier = f"arm_{letter}", f"upright_{letter}"
    front, rear = on_side(side, 0.13, 0.37, -0.095), on_side(side, -0.21, 0.38, -0.085)
    lower, upper = on_side(side, 0.008, 0.695, -0.115), on_side(side, -0.017, 0.650, 0.165)
    steering_arm, rack_end = on_side(side, -0.130, 0.685, -0.055), on_side(side, -0.125, 0.431, -0.0413)
    middle = _point(0.5 * (np.asarray(front) + np.asarray(rear)))
    wishbone = Inertia.of(6.5, np.array(on_side(side, -0.02, 0.50, -0.10)), np.diag([0.10, 0.09, 0.18]))
    half_bar, drop_link = bar_of(
        "front", side, (-0.27, 0.42, -0.02), (-0.06, 0.47, 0.015), End(arm, on_side(side, -0.055, 0.565, -0.10)),
        2.4, 4.0e5, 90.0,
    )  # fmt: skip
    parts = (
        Part(arm, "chassis", wishbone, six_joints(arm, middle)),
        Part(
            carrier, arm, upright(car.axle(corner), centre, car.design_attitude(corner)),
            (Joint(f"ball_{letter}", "ball", lower),),
        ),
        wheel_part(car, corner, carrier),
        half_bar,
    )  # fmt: skip
    strut = End(arm, on_side(side, -0.005, 0.60, -0.10)), End("chassis", on_side(side, -0.035, 0.525, 0.42))
    ahead, behind = on_side(side, 0.10, 0.425, 0.185), on_side(side, -0.15, 0.430, 0.150)
    return Linkage(
        parts=parts,
        rods=(
            Rod(f"upper_front_{letter}", End("chassis", ahead), End(carrier, upper), 4.0e6, 1500.0),
            Rod(f"upper_rear_{letter}", End("chassis", behind), End(carrier, upper), 4.0e6, 1500.0),
            Rod(f"tie_{letter}", End("rack", rack_end), End(carrier, steering_arm), 6.0e6, 1500.0),
            drop_link,
        ),
        springs=(Spring(f"spring_{corner}", *strut, 44_000.0),),
        dampers=(Damper(f"damper_{corner}", *strut, 5_200.0, 7.0e5, 300.0),),
        bushings=(
            Bushing(
                f"front_{letter}", "chassis", arm, front, (5.0e5, 5.0e6, 5.0e6), (300.0, 1200.0, 1200.0),
                (True, True, True),
            ),
            Bushing(
                f"rear_{letter}", "chassis", arm, rear, (5.0e5, 1.2e6, 2.0e6), (300.0, 600.0, 600.0),
                (False, True, True),
            ),
        ),
        rubbers=(Rubber(f"{arm}_turn", 90.0, 0.6),),
        carriers=((corner, carrier),),
    )  # fmt: skip
