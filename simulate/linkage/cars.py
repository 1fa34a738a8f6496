"""The second car and its variants: wheels on linkages, so that it is not of the class of lacet's model.

    from lacet.simulate.linkage import SecondCar
    car = SecondCar.named("second-live-axle")

Sizes, masses of the whole car, wheels, tyres and static angles are held as those of a `Car`, whose slides, springs and
dampers it does not have. A car of 2.62 m wheelbase and 1,520 kg, invented, with hardpoints, rates and rubber usual for
its class.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.simulate.cars import Axle, Car, Inertia, Tyre
from lacet.simulate.linkage.front import double_wishbone, six_joints
from lacet.simulate.linkage.parts import Bushing, Linkage, Part, Point
from lacet.simulate.linkage.rear import live_axle, twist_beam

Array = NDArray[np.float64]

ENGINE_MOUNTS: tuple[Point, ...] = ((0.16, -0.42, 0.30), (0.10, 0.40, 0.26), (-0.12, 0.02, -0.06))
"""Places of the engine's mounts [m]."""


@dataclass(frozen=True)
class SecondCar:
    """A car on linkages.

    `sizes` : total mass, wheels, tyres, tracks, static angles (`stiffness` and `damping` of its axles are 0 and mean
    nothing here); `live_axle` : at the rear, instead of the twist beam; `rigid` : loops are closed exactly and no
    rubber gives; `engine_mounts` : engine and gearbox on rubber, they take the reaction of the half-shafts.
    """

    sizes: Car
    live_axle: bool = False
    rigid: bool = False
    engine_mounts: bool = False

    @classmethod
    def named(cls, name: str) -> SecondCar:
        """A variant by its name in `SECOND_CARS`."""
        return cls(replace(second_sizes(), name=name), **SECOND_CARS[name])

    @property
    def name(self) -> str:
        """Name of the car."""
        return self.sizes.name

    @property
    def tyre(self) -> Tyre:
        """What its tyres have in common."""
        return self.sizes.tyre

    @property
    def front(self) -> Axle:
        """Sizes of the front axle."""
        return self.sizes.front

    @property
    def rear(self) -> Axle:
        """Sizes of the rear axle."""
        return self.sizes.rear

    @property
    def total(self) -> Inertia:
        """Inertia of the whole car at design position, body axes."""
        return self.sizes.total

    @property
    def payload(self) -> None:
        """Nothing: it carries no load."""
        return

    @property
    def gravity(self) -> float:
        """m/s²."""
        return self.sizes.gravity

    @property
    def wheelbase(self) -> float:
        """m, at design position."""
        return self.sizes.wheelbase

    @property
    def static_loads(self) -> Array:
        """(4,) wheel loads standing at design position [N]."""
        return self.sizes.static_loads

    @property
    def heights(self) -> Array:
        """(4,) wheel-centre heights above the road at design position [m]."""
        return self.sizes.heights

    @property
    def origin_height(self) -> float:
        """Height of the body origin above the road at design position [m]."""
        return self.sizes.origin_height

    @property
    def wheel_centres(self) -> Array:
        """(4, 3) wheel centres at design position, body axes [m]."""
        return self.sizes.wheel_centres

    def axle(self, corner: str) -> Axle:
        """Sizes of a corner's axle."""
        return self.sizes.axle(corner)

    def design_attitude(self, corner: str) -> Array:
        """(3, 3) R_body_carrier at design position."""
        return self.sizes.design_attitude(corner)

    @cached_property
    def linkage(self) -> Linkage:
        """All parts and elements."""
        out = double_wishbone(self.sizes) + (live_axle(self.sizes) if self.live_axle else twist_beam(self.sizes))
        return out + self._engine() if self.engine_mounts and not self.rigid else out

    def _engine(self) -> Linkage:
        com: Point = (0.10, 0.03, 0.14)
        inertia = Inertia.of(165.0, np.array(com), np.diag([9.0, 4.5, 8.5]))
        mounts = tuple(
            Bushing(
                f"mount_{i}", "chassis", "engine", at, (1.6e5, 1.6e5, 2.4e5), (500.0, 500.0, 700.0), (True, True, True)
            )
            for i, at in enumerate(ENGINE_MOUNTS)
        )
        return Linkage(parts=(Part("engine", "chassis", inertia, six_joints("engine", com)),), bushings=mounts)

    @cached_property
    def chassis(self) -> Inertia:
        """Inertia of the sprung body: the whole car less the parts of its linkages."""
        body = self.total
        for part in self.linkage.parts:
            body = body - part.inertia
        return body

    @property
    def inboard(self) -> Inertia:
        """Inertia inboard of the wheel dynamometers at design position: everything but rims and tyres."""
        body = self.total
        for corner in CORNERS:
            axle, R = self.axle(corner), self.design_attitude(corner)
            local = np.diag([axle.outboard_transverse, axle.outboard_spin, axle.outboard_transverse])
            at = self.wheel_centres[CORNERS.index(corner)]
            body = body - Inertia.of(axle.outboard_mass, at, R @ local @ R.T)
        return body

    def truth(self) -> dict[str, Any]:
        """Every number of the car and those that follow from it, JSON-able."""
        sizes = asdict(self.sizes)
        for axle in ("front", "rear"):
            del sizes[axle]["stiffness"], sizes[axle]["damping"]
        return {
            **sizes,
            "live_axle": self.live_axle,
            "rigid": self.rigid,
            "engine_mounts": self.engine_mounts,
            "linkage": asdict(self.linkage),
            "chassis": asdict(self.chassis),
            "inboard": asdict(self.inboard),
            "wheel_centres": dict(zip(CORNERS, self.wheel_centres.tolist(), strict=True)),
            "static_loads": dict(zip(CORNERS, self.static_loads.tolist(), strict=True)),
        }


def second_sizes() -> Car:
    """Sizes, masses, wheels and tyres of the second car."""
    degree = np.pi / 180.0
    common = {
        "stiffness": 0.0, "damping": 0.0, "inboard_mass": 5.5, "inboard_spin": 0.11, "inboard_transverse": 0.07,
        "outboard_mass": 21.0, "outboard_spin": 0.95, "outboard_transverse": 0.55, "radius": 0.312,
        "tyre_stiffness": 215_000.0, "slip": 21.0,
    }  # fmt: skip
    front = Axle(
        track=1.51, camber=-0.6 * degree, toe=0.08 * degree, caster=5.1 * degree, kingpin_inclination=9.1 * degree,
        carrier_mass=15.0, carrier_inertia=(0.36, 0.30, 0.32), cornering=15.0, steered=True, driven=True, **common,
    )  # fmt: skip
    rear = Axle(
        track=1.49, camber=-1.1 * degree, toe=0.15 * degree, caster=0.0, kingpin_inclination=0.0,
        carrier_mass=11.0, carrier_inertia=(0.25, 0.20, 0.22), cornering=18.0, steered=False, driven=False, **common,
    )  # fmt: skip
    total = Inertia(1520.0, (-1.06, 0.0, 0.25), ((560.0, 0.0, -15.0), (0.0, 2050.0, 0.0), (-15.0, 0.0, 2380.0)))
    return Car("second", 2.62, total, front, rear, Tyre(load_nominal=3700.0, relaxation_lateral=0.5))


SECOND_CARS: dict[str, dict[str, bool]] = {
    "second": {},
    "second-live-axle": {"live_axle": True},
    "second-engine": {"engine_mounts": True},
    "second-rigid": {"rigid": True},
    "second-live-axle-rigid": {"live_axle": True, "rigid": True},
}
"""Variants of the second car by name, with what they have."""
