"""Nominal car for planning: the user's geometry, known parameter values, and typical values for the rest.

A plan needs the motion of a run, not the car itself: widths of intervals follow from it to some ten per cent even where
a spring is wrong by as much. Values are rounded, so that stored motions serve the next plan too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.design.run_ranking import quantities
from lacet.identify.properties.whole_vehicle import NAMES
from lacet.identify.regression.wls import Fit
from lacet.simulate import Car, Hidden, find_car
from lacet.simulate.cars import Axle, Inertia

CLASS = "peugeot-406"
"""Simulated car whose unsprung parts, scaled by mass, and tyres replace unknown ones."""
KNOWN = 0.1
"""Largest half-width ÷ size of an identified value that is simulated."""
MASS = 1500.0
GYRATION = (0.41, 0.43, 0.47)
"""Radii of gyration: about x relative to the track, about y and z relative to the wheelbase (within 10 % in the class).
"""
FRONT_SHARE = 0.58
HEIGHT = 0.25
"""Height of the centre of gravity above the wheel centres [m]."""
RIDE = 1.2
DAMPING = 0.4
"""Ride frequency [Hz] and damping ratio of a corner."""


@dataclass(frozen=True)
class PlannedCar:
    """A nominal car with its anti-roll bars, and the assumptions made about unknown values, in words."""

    car: Car
    bars: tuple[Hidden, ...]
    assumed: tuple[str, ...]


def known_values(vehicle: Vehicle, fitted: Fit | None, reference: str) -> dict[str, float]:
    """Known values of a car by name: identified ones, else those of the vehicle file's ``[apriori]``.

    Values of the whole vehicle that hub loads give lack what is outboard of the dynamometers: the file's come first,
    and where it has none the wheels are added.
    """
    out = {name: quantity.value for name, quantity in vehicle.apriori.items()}
    if fitted is None:
        return out
    found = {q.name: q.value for q in quantities(fitted, vehicle).values() if q.half < KNOWN * q.size}
    whole = {name: found.pop(name) for name in NAMES if name in found}
    out |= found
    return out | whole if reference == "contact" else {**_with_wheels(whole, vehicle, found), **out}


def _with_wheels(whole: Mapping[str, float], vehicle: Vehicle, found: Mapping[str, float]) -> dict[str, float]:
    """The values known of a vehicle without its wheels, with them; their mass is identified, or that of the class."""
    if not {"mass", "cog.x"} <= set(whole):
        return {}
    like, get = find_car(CLASS), {"cog.z": HEIGHT, **whole}.get
    tensor = np.array([[get(f"I{min(a, b)}{max(a, b)}", 0.0) for b in "xyz"] for a in "xyz"])
    total = Inertia.of(whole["mass"], np.array([get(f"cog.{a}", 0.0) for a in "xyz"]), tensor)
    for name, corner in vehicle.corners.items():
        axle = like.front if name.startswith("f") else like.rear
        mass = found.get(f"outboard_mass.{name}.m", axle.outboard_mass * whole["mass"] / like.total.mass)
        turns = np.diag([axle.outboard_transverse, axle.outboard_spin, axle.outboard_transverse])
        total += Inertia.of(mass, np.array(corner.position), turns * mass / axle.outboard_mass)
    values = {"mass": total.mass} | {f"cog.{a}": value for a, value in zip("xyz", total.com, strict=True)}
    values |= {
        f"I{a}{b}": total.tensor["xyz".index(a)]["xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")
    }
    return {name: value for name, value in values.items() if name in whole}


def planned_car(vehicle: Vehicle, known: Mapping[str, float]) -> PlannedCar:
    """The nominal car of known values by name."""
    assumed: list[str] = []

    def value(name: str, otherwise: float, unit: str, digits: int = 2) -> float:
        if name not in known:
            assumed.append(f"{name} {_rounded(otherwise, digits):g} {unit}")
        return _rounded(known.get(name, otherwise), digits)

    wheelbase = -float(np.mean([vehicle.corners[c].position[0] for c in ("rl", "rr")]))
    tracks = [vehicle.corners[f"{a}l"].position[1] - vehicle.corners[f"{a}r"].position[1] for a in "fr"]
    mass = value("mass", MASS, "kg", 3)
    com = (
        value("cog.x", -(1.0 - FRONT_SHARE) * wheelbase, "m", 3), _rounded(known.get("cog.y", 0.0), 2),
        value("cog.z", HEIGHT, "m"),
    )  # fmt: skip
    arms = (GYRATION[0] * float(np.mean(tracks)), GYRATION[1] * wheelbase, GYRATION[2] * wheelbase)
    typical = [mass * arm**2 for arm in arms]
    tensor = np.diag([value(f"I{2 * a}", size, "kg·m²") for a, size in zip("xyz", typical, strict=True)])
    tensor[0, 2] = tensor[2, 0] = _rounded(known.get("Ixz", 0.0), 2)
    like = find_car(CLASS)
    scale = mass / like.total.mass
    axles: list[Axle] = []
    for a, base, track in zip("fr", (like.front, like.rear), tracks, strict=True):
        share = -com[0] / wheelbase if a == "r" else 1.0 + com[0] / wheelbase
        sprung = 0.5 * mass * share - scale * base.unsprung_mass
        stiffness = _mean(known, f"spring.{a}", "k")
        k = value(f"spring.{a}*.k", sprung * (2 * math.pi * RIDE) ** 2, "N/m") if stiffness is None else stiffness
        damping = _mean(known, f"damper.{a}", "c")
        c = value(f"damper.{a}*.c", 2 * DAMPING * math.sqrt(k * sprung), "N·s/m") if damping is None else damping
        tyre = _mean(known, f"tyre_stiffness.{a}", "kt")
        kt = value(f"tyre_stiffness.{a}*.kt", base.tyre_stiffness * scale, "N/m") if tyre is None else tyre
        axles.append(_axle(vehicle, a, base, track, scale, k, c, kt))
    if not any(axle.driven for axle in axles):
        axles[0] = replace(axles[0], driven=True)
    total = Inertia.of(mass, np.array(com), tensor)
    tyre = replace(like.tyre, load_nominal=_rounded(mass * like.gravity / 4, 2))
    car = Car(f"like {vehicle.name}", wheelbase, total, axles[0], axles[1], tyre)
    if not _possible(car):
        assumed.append("moments of inertia of the class (those known leave no possible chassis)")
        car = replace(car, total=Inertia.of(mass, np.array(com), np.diag([_rounded(size, 2) for size in typical])))
    names = ("anti_roll_bar.front", "anti_roll_bar.rear")
    bars = tuple(Hidden(n, _rounded(known[f"{n}.k"], 2)) for n in names if known.get(f"{n}.k", 0.0) > 0.0)
    return PlannedCar(car, bars, tuple(assumed))


def _axle(vehicle: Vehicle, a: str, base: Axle, track: float, scale: float, k: float, c: float, kt: float) -> Axle:
    corner = vehicle.corners[f"{a}l"]
    place = "axle.front" if a == "f" else "axle.rear"
    camber = vehicle.numbers.get(f"{place}.static_camber")
    x, y, z = base.carrier_inertia
    light = scale * (corner.tyre_radius / base.radius) ** 2
    return replace(
        base, track=track, stiffness=k, damping=c, tyre_stiffness=kt, radius=corner.tyre_radius,
        camber=camber.value if camber else 0.0, toe=corner.static_toe, caster=corner.caster,
        kingpin_inclination=corner.kingpin_inclination, driven=corner.driven, steered=a == "f",
        carrier_mass=scale * base.carrier_mass, inboard_mass=scale * base.inboard_mass,
        outboard_mass=scale * base.outboard_mass,
        carrier_inertia=(light * x, light * y, light * z),
        inboard_spin=light * base.inboard_spin, inboard_transverse=light * base.inboard_transverse,
        outboard_spin=light * base.outboard_spin, outboard_transverse=light * base.outboard_transverse,
    )  # fmt: skip


def _mean(known: Mapping[str, float], family: str, parameter: str) -> float | None:
    """Mean of the left and right value of an axle, where either is known and positive."""
    corners: Iterable[float] = (known.get(f"{family}{side}.{parameter}", 0.0) for side in "lr")
    found = [value for value in corners if value > 0.0]
    return _rounded(float(np.mean(found)), 2) if found else None


def _possible(car: Car) -> bool:
    """Whether the chassis, the car without its unsprung parts, is physically possible."""
    chassis = car.chassis
    moments = np.linalg.eigvalsh(np.asarray(chassis.tensor))
    loads = car.static_loads
    return bool(
        chassis.mass > 0.0 and moments[0] > 0.0 and moments[0] + moments[1] > 1.001 * moments[2] and np.all(loads > 0.0)
    )


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")
