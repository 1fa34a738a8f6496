"""An identified car as a simulator wants it: bodies that can exist, joints, springs, dampers, bars, tyres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.car_tree import WHEEL, car_chain, carrier_axes, kinematics
from lacet.identify.effects.base import Effect, with_places
from lacet.identify.multibody.rigid_body import move_parameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.completion import Completion, complete_bodies
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.services.planning.nominal_car import CLASS, known_values, planned_car
from lacet.services.render.intervals import to_interval, with_interval
from lacet.simulate.cars import Axle, Inertia


@dataclass(frozen=True)
class Part:
    """A rigid body: mass [kg], centre of mass (3,) [m], inertia tensor about it (3, 3) [kg·m²], in its own axes."""

    mass: float
    com: Array
    tensor: Array

    @classmethod
    def of(cls, ten: Array) -> Part:
        """The body of ten parameters about the origin of its axes."""
        mass, com = float(ten[9]), ten[6:9] / ten[9]
        xx, xy, xz, yy, yz, zz = move_parameters(ten, np.eye(3), -com)[:6]
        return cls(mass, com, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    @property
    def ten(self) -> Array:
        """The ten parameters (10,) about the origin of its axes."""
        t = self.tensor + self.mass * (self.com @ self.com * np.eye(3) - np.outer(self.com, self.com))
        return np.array([t[0, 0], t[0, 1], t[0, 2], t[1, 1], t[1, 2], t[2, 2], *(self.mass * self.com), self.mass])


@dataclass(frozen=True)
class ExportedCorner:
    """One corner of an exported car.

    Attributes
    ----------
    centre : (3,) wheel centre at design height, body axes [m].
    attitude : (3, 3) from carrier to body axes at design height.
    slide : (3,) way of the wheel centre per metre of travel, body axes.
    kingpin : (3,) unit steering axis through the wheel centre, body axes; None for a corner that does not steer.
    carrier, wheel : bodies about the wheel centre in carrier axes; the wheel spins about y.
    rim : what is outboard of the wheel dynamometer, turning with the wheel; None for ``contact`` loads.
    stiffness, damping, offset, friction : of the suspension along body z [N/m, N·s/m, N, N].
    tyre_stiffness, tyre_damping : along the road's normal [N/m, N·s/m]; 0 where not identified.
    radius : unloaded tyre radius [m].
    """

    name: str
    centre: Array
    attitude: Array
    slide: Array
    kingpin: Array | None
    carrier: Part
    wheel: Part
    rim: Part | None
    stiffness: float
    damping: float
    offset: float
    friction: float
    tyre_stiffness: float
    tyre_damping: float
    radius: float


@dataclass(frozen=True)
class ExportedCar:
    """An identified car with full inertial parameters.

    Attributes
    ----------
    height : of the body origin above a flat road at design height [m].
    bars : anti-roll bars as left corner, right corner, stiffness per metre of travel difference [N/m].
    identified : lines about numbers that the runs determine, `chosen` about those taken from elsewhere.
    left_out : effect or table of the car that is in no exported simulation model → why.
    """

    name: str
    height: float
    chassis: Part
    corners: tuple[ExportedCorner, ...]
    bars: tuple[tuple[str, str, float], ...]
    identified: tuple[str, ...]
    chosen: tuple[str, ...]
    left_out: dict[str, str]


_WRITTEN = ("body", "spring", "damper", "offset", "tyre_stiffness", "tyre_damping", "outboard_mass", "anti_roll_bar")
_FRICTION = "coulomb"


def exported_car(fitted: Fit) -> ExportedCar:
    """The car of a fit. Raises UsageError when the runs do not determine its mass, SolverError as `complete_bodies`."""
    recording = fitted.runs[0].recording
    vehicle, hub = recording.vehicle, recording.reference == "hub"
    found = {e.name: e for e in estimates(fitted)}
    mass = found.get("M6")
    if mass is None or not mass.identifiable:
        raise UsageError(
            "the runs do not determine the mass of the chassis (M6), so there is no car to simulate: lacet identify "
            "--why says which rows or runs are missing; parameters can be exported as .toml, .mat, .csv or .json"
        )
    like = planned_car(vehicle, known_values(vehicle, fitted, recording.reference))
    guess = {"chassis": _ten(like.car.chassis)}
    for c in CORNERS:
        axle = like.car.axle(c)
        guess[f"axle.{c}"] = np.array([*_diagonal(axle.carrier_inertia), 0.0, 0.0, 0.0, axle.carrier_mass])
        guess[f"wheel.{c}"] = _wheel(axle, hub)
    bodies = complete_bodies(fitted, guess)
    laws = _Laws(fitted, found)
    corners = tuple(_corner(vehicle.corners[c], vehicle, bodies, laws, like.car.axle(c) if hub else None)
                    for c in CORNERS)  # fmt: skip
    chosen = [
        f"the split of what is identified together, and what the runs leave open of axles and wheels: as near to a "
        f"simulated {CLASS} of the car's size as these runs let it be ({bodies.distance:.1f} σ from the estimate)"
    ]
    if hub:
        chosen.append(
            f"moments of inertia of rims and tyres, outboard of the dynamometers: those of a {CLASS} of their mass"
        )
    return ExportedCar(
        vehicle.name, float(np.mean([vehicle.corners[c].height for c in ("fl", "fr")])),
        Part.of(bodies.ten["chassis"]), corners, laws.bars(), tuple(_identified(bodies, found)),
        (*chosen, *laws.open), {**_tables(vehicle), **laws.left_out},
    )  # fmt: skip


def _identified(bodies: Completion, found: dict[str, Estimate]) -> Iterator[str]:
    if bodies.moved is None:
        yield "the bodies have the identified values of these combinations exactly:"
    else:
        name, sigma = bodies.moved
        yield (
            "no bodies that can exist have the identified values exactly (lacet identify --consistent says why); "
            f"these are the nearest, {name} is farthest off, by {sigma:.1f} σ:"
        )
    for words, value in bodies.held.items():
        one = found[words.split(" ")[0]]
        fit = to_interval(bodies.fitted[words], one.half)
        yield f"{words} = {with_interval(value, one.half)} {one.unit} (fit: {fit})"


class _Laws:
    """Springs, dampers, bars and tyres of a fit's model by corner; what is open or left out of it in words."""

    def __init__(self, fitted: Fit, found: dict[str, Estimate]):
        self.found = found
        self.open: list[str] = []
        self.left_out: dict[str, str] = {}
        self._values: dict[str, float] = {}
        self._bars: list[tuple[str, str, float]] = []
        for effect, _ in with_places(fitted.model.physics):
            self._add(effect)
        for fault in fitted.model.faults:
            self.left_out[fault.key] = "belongs to the instruments, not to the car"

    def _add(self, effect: Effect) -> None:
        if effect.name == "body":
            return
        if effect.name == _FRICTION:
            width = 1e3 * effect.shape.get("v0", 0.01)
            self.left_out[effect.key] = f"written as dry friction, without its band of {width:g} mm/s (MJCF and URDF)"
            for c in CORNERS:
                if effect.where in (c, "front" if c[0] == "f" else "rear"):
                    self._values[f"friction.{c}"] = self.value(f"{effect.key}.f") + self.value(f"friction.{c}")
        elif effect.name == "anti_roll_bar":
            a = effect.where[0]
            self._bars.append((f"{a}l", f"{a}r", self.value(f"{effect.key}.k")))
        elif effect.name not in _WRITTEN:
            self.left_out[effect.key] = effect.about
        elif effect.where not in CORNERS:
            for c in CORNERS:
                if effect.where == ("front" if c[0] == "f" else "rear"):
                    for q in effect.parameters:
                        short = q.name.rpartition(".")[2]
                        self._values[f"{effect.name}.{c}.{short}"] = self.value(q.name)

    def value(self, name: str) -> float:
        """A parameter's value; 0, and noted as open, where the runs do not determine it."""
        if name in self._values:
            return self._values[name]
        one = self.found.get(name)
        if one is None:
            return 0.0
        if not one.identifiable:
            line = f"{name}: the runs do not determine it; it is left out"
            self.open += [line] * (line not in self.open)
            return 0.0
        return one.value

    def bars(self) -> tuple[tuple[str, str, float], ...]:
        """The anti-roll bars that have a stiffness."""
        return tuple(bar for bar in self._bars if bar[2])


def _corner(corner: Corner, vehicle: Vehicle, bodies: Completion, laws: _Laws, rim: Axle | None) -> ExportedCorner:
    c, side = corner.name, corner.side
    axle = "front" if c[0] == "f" else "rear"
    camber = vehicle.numbers.get(f"corner.{c}.static_camber") or vehicle.numbers.get(f"axle.{axle}.static_camber")
    lean = -side * (camber.value if camber else 0.0)
    attitude = carrier_axes(np.array([-side * corner.static_toe]), np.array([lean]), np.zeros(1))[:, :, 0]
    slope = kinematics(corner, np.zeros(1)).slope[:, 0]
    kingpin = np.array([-np.tan(corner.caster), -side * np.tan(corner.kingpin_inclination), 1.0])
    outboard = None
    if rim is not None:
        found = laws.found.get(f"outboard_mass.{c}.m")
        known = found is not None and found.identifiable
        mass = found.value if found is not None and known else rim.outboard_mass
        if not known:
            laws.open.append(f"outboard mass of {c}: {mass:.3g} kg, that of a {CLASS} of the car's size")
        share = mass / rim.outboard_mass
        spin, across = share * rim.outboard_spin, share * rim.outboard_transverse
        outboard = Part(mass, np.zeros(3), np.diag([across, spin, across]))
    return ExportedCorner(
        name=c,
        centre=np.asarray(corner.position, float),
        attitude=attitude,
        slide=np.array([slope[1], slope[0], 1.0]),
        kingpin=kingpin / np.linalg.norm(kingpin) if axle == "front" else None,
        carrier=Part.of(bodies.ten[f"axle.{c}"]),
        wheel=Part.of(move_parameters(bodies.ten[f"wheel.{c}"], car_chain().to_body[WHEEL[c] - 1], np.zeros(3))),
        rim=outboard,
        stiffness=laws.value(f"spring.{c}.k"),
        damping=laws.value(f"damper.{c}.c"),
        offset=laws.value(f"offset.{c}.f0"),
        friction=laws.value(f"friction.{c}"),
        tyre_stiffness=laws.value(f"tyre_stiffness.{c}.kt"),
        tyre_damping=laws.value(f"tyre_damping.{c}.c"),
        radius=corner.tyre_radius,
    )


def _tables(vehicle: Vehicle) -> dict[str, str]:
    with_table = [c for c, corner in vehicle.corners.items() if corner.table or corner.joints]
    if not with_table:
        return {}
    return {
        f"bench table of {', '.join(with_table)}": "the wheel centre keeps the direction that it has at design height; "
        "change of camber, toe and pitch with travel is left out"
    }


def _ten(body: Inertia) -> Array:
    t, first = body.about(np.zeros(3)), body.mass * np.asarray(body.com)
    return np.array([t[0, 0], t[0, 1], t[0, 2], t[1, 1], t[1, 2], t[2, 2], *first, body.mass])


def _diagonal(moments: tuple[float, float, float]) -> tuple[float, ...]:
    x, y, z = moments
    return x, 0.0, 0.0, y, 0.0, z


def _wheel(axle: Axle, hub: bool) -> Array:
    """Ten parameters of a wheel in its joint frame, z along the spin axis; inboard parts only for ``hub`` loads."""
    spin, across, mass = axle.inboard_spin, axle.inboard_transverse, axle.inboard_mass
    if not hub:
        spin, across, mass = spin + axle.outboard_spin, across + axle.outboard_transverse, mass + axle.outboard_mass
    return np.array([*_diagonal((across, across, spin)), 0.0, 0.0, 0.0, mass])
