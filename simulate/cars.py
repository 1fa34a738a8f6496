"""Simulated cars: their parameters, from which the chassis and the static state follow.

A car is given by the mass, centre of mass and inertia of the *whole* vehicle at design position, as in a table of
a-priori values, and by its four unsprung assemblies; the chassis is the difference. The design position is an
equilibrium on a flat road: static offsets and wheel-centre heights are computed, not given.

Axes are body axes (ISO 8855), origin midway between the front wheel centres at design position.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError, nearest

Vector = NDArray[np.float64]


def rot_x(angle: float) -> Vector:
    """Rotation matrix about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_z(angle: float) -> Vector:
    """Rotation matrix about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass [m], inertia tensor about it [kg·m²] (tensor elements: Ixy = -∫xy dm)."""

    mass: float
    com: tuple[float, float, float]
    tensor: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, mass: float, com: Vector, tensor: Vector) -> Inertia:
        """The inertia of these arrays."""
        return cls(float(mass), tuple(np.asarray(com, float).tolist()), tuple(map(tuple, np.asarray(tensor).tolist())))

    def about(self, point: Vector) -> Vector:
        """Inertia tensor about `point` (parallel axes)."""
        r = np.asarray(self.com) - point
        return np.asarray(self.tensor) + self.mass * (r @ r * np.eye(3) - np.outer(r, r))

    def __add__(self, other: Inertia) -> Inertia:
        return self._combine(other, 1.0)

    def __sub__(self, other: Inertia) -> Inertia:
        return self._combine(other, -1.0)

    def _combine(self, other: Inertia, sign: float) -> Inertia:
        mass = self.mass + sign * other.mass
        com = (self.mass * np.asarray(self.com) + sign * other.mass * np.asarray(other.com)) / mass
        return Inertia.of(mass, com, self.about(com) + sign * other.about(com))


@dataclass(frozen=True)
class Axle:
    """Parameters of an axle's corners; the right corner is the mirror image of the left.

    Attributes
    ----------
    track : distance between the wheel centres [m].
    stiffness, damping : linear spring [N/m] and damper [N·s/m] along body z at the wheel centre.
    camber : static camber, top outward positive [rad]; `toe` : static toe, toe-in positive [rad].
    caster, kingpin_inclination : steering axis, top rearward and top inward [rad]; it passes through the wheel centre.
    carrier_mass, carrier_inertia : the part that does not spin: mass [kg], principal moments in carrier axes about
        the wheel centre, where its centre of mass lies [kg·m²].
    inboard_mass, inboard_spin, inboard_transverse : spinning parts inboard of the dynamometer (hub, disc).
    outboard_mass, outboard_spin, outboard_transverse : rim and tyre (and the spinning half of the dynamometer).
    radius : unloaded tyre radius R0 [m]; `tyre_stiffness` : vertical, along the road normal [N/m].
    cornering : cornering stiffness ÷ load at the nominal load [1/rad]; `slip` : longitudinal slip stiffness ÷ load [-].
    brake_drag : torque of a brake that is released [N·m].
    """

    track: float
    stiffness: float
    damping: float
    camber: float
    toe: float
    caster: float
    kingpin_inclination: float
    carrier_mass: float
    carrier_inertia: tuple[float, float, float]
    inboard_mass: float
    inboard_spin: float
    inboard_transverse: float
    outboard_mass: float
    outboard_spin: float
    outboard_transverse: float
    radius: float
    tyre_stiffness: float
    cornering: float
    slip: float
    steered: bool
    driven: bool
    brake_drag: float = 0.0

    @property
    def unsprung_mass(self) -> float:
        """Mass of carrier, hub, rim and tyre of one corner [kg]."""
        return self.carrier_mass + self.inboard_mass + self.outboard_mass

    @property
    def spin_inertia(self) -> float:
        """Moment of inertia of all parts that spin with the wheel [kg·m²]."""
        return self.inboard_spin + self.outboard_spin


@dataclass(frozen=True)
class Tyre:
    """Parameters of a tyre beyond those of its axle (identification from measured wheel loads needs none of them).

    `friction` μ; `load_nominal` [N]; `degression`: relative loss of cornering stiffness per relative load;
    `relaxation_lateral`, `relaxation_longitudinal` [m]; `trail`: pneumatic trail at no slip [m];
    `rolling_resistance` [-]; `contact_length`: of the patch, for enveloping [m]; `neutral_slip`: slip angle at which
    it has no lateral force [rad]: plysteer, conicity, and how its wheel is set.
    """

    friction: float = 0.95
    load_nominal: float = 4000.0
    degression: float = 0.15
    relaxation_lateral: float = 0.45
    relaxation_longitudinal: float = 0.25
    trail: float = 0.030
    rolling_resistance: float = 0.012
    contact_length: float = 0.12
    neutral_slip: float = 0.0


OWN = ("stiffness", "damping", "tyre_stiffness", "cornering", "brake_drag")
"""Parameters of an axle that may differ from one of its corners to the other."""


@dataclass(frozen=True)
class Car:
    """Parameters of a simulated car; `total` is the whole vehicle at design position, without the `payload` of a run.

    `corners` : parameters of single corners that differ from their axle, by corner name. Only those of `OWN` may
    differ: the geometry is the axle's. `tyres` : tyres of single corners that differ from `tyre`.
    """

    name: str
    wheelbase: float
    total: Inertia
    front: Axle
    rear: Axle
    tyre: Tyre
    gravity: float = 9.80665
    payload: Inertia | None = None
    corners: Mapping[str, Axle] = field(default_factory=dict)
    tyres: Mapping[str, Tyre] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for corner, own in self.corners.items():
            axle = self.front if corner[0] == "f" else self.rear
            alike = {name: getattr(axle, name) for name in OWN}
            if replace(own, **alike) != axle:
                raise UsageError(f"corner {corner} of {self.name}: only {', '.join(OWN)} may differ")

    def axle(self, corner: str) -> Axle:
        """Parameters of a corner: its own, else its axle's."""
        return self.corners.get(corner) or (self.front if corner[0] == "f" else self.rear)

    def tyre_at(self, corner: str) -> Tyre:
        """Tyre of a corner: its own, else that of the car."""
        return self.tyres.get(corner, self.tyre)

    @property
    def spin_axes(self) -> Vector:
        """(4, 3) spin axes n at design position (to the left), body axes."""
        return np.stack([self.design_attitude(corner)[:, 1] for corner in CORNERS])

    def design_attitude(self, corner: str) -> Vector:
        """(3, 3) R_body_carrier at design position: Rz(steer)·Rx(camber), pitch zero by definition of the axes."""
        axle, left = self.axle(corner), corner[1] == "l"
        return rot_z(-axle.toe if left else axle.toe) @ rot_x(-axle.camber if left else axle.camber)

    def kingpin(self, corner: str) -> Vector:
        """(3,) unit steering axis, upwards, body axes."""
        axle, side = self.axle(corner), 1.0 if corner[1] == "l" else -1.0
        axis = np.array([-np.tan(axle.caster), -side * np.tan(axle.kingpin_inclination), 1.0])
        return axis / np.linalg.norm(axis)

    @property
    def static_loads(self) -> Vector:
        """(4,) wheel loads standing on a flat road at design position [N] (without payload).

        Four loads, three equations of equilibrium; the fourth condition is that each axle has a part of the lateral
        offset of the centre of mass in proportion to its load, so that the body has no torsion between the axles.
        """
        weight = self.total.mass * self.gravity
        x, y, _ = self.total.com
        rear = -x / self.wheelbase
        shares = []
        for corner in CORNERS:
            share = rear if corner[0] == "r" else 1.0 - rear
            lean = y / self.axle(corner).track * (1.0 if corner[1] == "l" else -1.0)
            shares.append(share * (0.5 + lean))
        return weight * np.array(shares)

    @property
    def heights(self) -> Vector:
        """(4,) wheel-centre heights above the road at design position [m]: h = (R0 - F/kt)·√(1 - (n·e)²)."""
        loads = self.static_loads
        out = np.empty(4)
        for i, corner in enumerate(CORNERS):
            axle, n = self.axle(corner), self.design_attitude(corner)[:, 1]
            out[i] = (axle.radius - loads[i] / axle.tyre_stiffness) * np.sqrt(1.0 - n[2] ** 2)
        return out

    @property
    def origin_height(self) -> float:
        """Height of the body origin above a flat road at design position [m]."""
        return float(np.mean(self.heights[:2]))

    @property
    def wheel_centres(self) -> Vector:
        """(4, 3) wheel centres at design position, body axes [m]."""
        z = self.heights - self.origin_height
        rows = []
        for i, corner in enumerate(CORNERS):
            side = 0.5 if corner[1] == "l" else -0.5
            rows.append([0.0 if corner[0] == "f" else -self.wheelbase, side * self.axle(corner).track, z[i]])
        return np.array(rows)

    @property
    def offsets(self) -> Vector:
        """(4,) static suspension force at design position [N]: wheel load minus unsprung weight."""
        unsprung = np.array([self.axle(corner).unsprung_mass for corner in CORNERS])
        return self.static_loads - unsprung * self.gravity

    def unsprung(self, corner: str, outboard: bool = True) -> Inertia:
        """Inertia of one unsprung assembly at design position, body axes, with or without the outboard mass."""
        axle, R = self.axle(corner), self.design_attitude(corner)
        spin, transverse, mass = axle.inboard_spin, axle.inboard_transverse, axle.carrier_mass + axle.inboard_mass
        if outboard:
            spin, transverse = spin + axle.outboard_spin, transverse + axle.outboard_transverse
            mass += axle.outboard_mass
        local = np.diag(axle.carrier_inertia) + np.diag([transverse, spin, transverse])
        return Inertia.of(mass, self.wheel_centres[CORNERS.index(corner)], R @ local @ R.T)

    @property
    def chassis(self) -> Inertia:
        """Inertia of the sprung body: the whole vehicle minus the unsprung assemblies, plus the payload."""
        body = self.total
        for corner in CORNERS:
            body = body - self.unsprung(corner)
        return body if self.payload is None else body + self.payload

    @property
    def inboard(self) -> Inertia:
        """Inertia inboard of the transducers at design position: everything but rims and tyres."""
        body = self.chassis
        for corner in CORNERS:
            body = body + self.unsprung(corner, outboard=False)
        return body

    def with_payload(self, mass: float, at: tuple[float, float, float]) -> Car:
        """The car with a point mass [kg] `at` body axes [m]."""
        return replace(self, payload=Inertia.of(mass, np.asarray(at), np.zeros((3, 3))))

    def truth(self) -> dict[str, Any]:
        """Every number of the car and those that follow from it, JSON-able."""
        loaded = self.total if self.payload is None else self.total + self.payload
        return {
            **asdict(self),
            "chassis": asdict(self.chassis),
            "unsprung": {corner: asdict(self.unsprung(corner)) for corner in CORNERS},
            "inboard": asdict(self.inboard),
            "whole": asdict(loaded),
            "wheel_centres": dict(zip(CORNERS, self.wheel_centres.tolist(), strict=True)),
            "wheel_centre_heights": dict(zip(CORNERS, self.heights.tolist(), strict=True)),
            "static_loads": dict(zip(CORNERS, self.static_loads.tolist(), strict=True)),
            "suspension_offsets": dict(zip(CORNERS, self.offsets.tolist(), strict=True)),
        }


def peugeot_406() -> Car:
    """The Peugeot 406 of the paper, with its a-priori values.

    From its tables 1, 2 and 7 (a-priori values): mass 1668.5 kg, centre of mass 1112.5 mm behind the front axle and
    259.7 mm above the wheel centres, Ixx 630, Iyy 2250, Izz 2734 kg·m², XZ 20 kg·m² in axes with x to the rear, hence
    -20 in ISO axes (XY and YZ are not legible in our copy: zero); springs 20 and 22 N/mm, dampers 3200 and 3800 N·s/m
    (joints 27, 36 front and 9, 18 rear); tyres 200 N/mm; wheel spin inertia 1 kg·m². Wheelbase 2.70 m: maker's public
    data. Radius of a 195/65 R 15 tyre by its marking. The rest (tracks rounded to 10 mm, unsprung masses with
    dynamometer rims, steering axis, static angles, tyre slip) is typical of the class and not claimed for the car.
    """
    degree = np.pi / 180.0
    common = {
        "inboard_mass": 5.0,
        "inboard_spin": 0.10,
        "inboard_transverse": 0.06,
        "outboard_mass": 20.0,
        "outboard_spin": 0.90,
        "outboard_transverse": 0.52,
        "radius": 0.317,
        "tyre_stiffness": 200_000.0,
        "slip": 22.0,
    }
    front = Axle(
        track=1.50, stiffness=20_000.0, damping=3_200.0, camber=-0.5 * degree, toe=0.1 * degree, caster=3.0 * degree,
        kingpin_inclination=12.0 * degree, carrier_mass=19.0, carrier_inertia=(0.40, 0.35, 0.35), cornering=15.0,
        steered=True, driven=True, **common,
    )  # fmt: skip
    rear = Axle(
        track=1.48, stiffness=22_000.0, damping=3_800.0, camber=-1.0 * degree, toe=0.1 * degree, caster=0.0,
        kingpin_inclination=0.0, carrier_mass=16.0, carrier_inertia=(0.35, 0.30, 0.30), cornering=18.0,
        steered=False, driven=False, **common,
    )  # fmt: skip
    tensor = ((630.0, 0.0, -20.0), (0.0, 2250.0, 0.0), (-20.0, 0.0, 2734.0))
    total = Inertia(1668.5, (-1.1125, 0.0, 0.2597), tensor)
    return Car("peugeot-406", 2.70, total, front, rear, Tyre())


def peugeot_406_measured() -> Car:
    """The Peugeot 406 with the values that the paper estimated on the road, its tables 5 to 7.

    XX and ZZ of table 5 are corrected. Springs, dampers and tyres differ from corner to corner; the centre of mass is
    5.16 mm off the middle (R_Q has y to the right: -5.16 mm there is to the left). YY, which sinus steering does not
    excite, is that of table 1. The further laws of the tables, anti-roll bars and friction, are hidden effects
    (`measured_effects`).
    """
    car = peugeot_406()
    tensor = ((760.31, 0.0, -45.0), (0.0, 2250.0, 0.0), (-45.0, 0.0, 2783.96))
    own = {  # paper: ks, h of tables 6, kt of table 7; joints 27, 36, 9, 18 and 33, 42, 15, 24
        "fl": (27_129.51, 3_306.20, 232_581.41),
        "fr": (27_084.50, 3_408.44, 230_549.08),
        "rl": (27_059.51, 4_526.08, 216_502.50),
        "rr": (23_317.02, 4_274.80, 217_816.21),
    }
    corners = {
        corner: replace(car.axle(corner), stiffness=stiffness, damping=damping, tyre_stiffness=tyre)
        for corner, (stiffness, damping, tyre) in own.items()
    }
    total = Inertia(1668.53, (-1.13106, 0.00516, 0.24669), tensor)
    return replace(car, name="peugeot-406-measured", total=total, corners=corners)


CARS = {"peugeot-406": peugeot_406, "peugeot-406-measured": peugeot_406_measured}
"""Cars by name."""


def find_car(name: str) -> Car:
    """A car by name. Raises UsageError naming the known ones."""
    if name not in CARS:
        raise UsageError(f"no simulated car is called '{name}'{nearest(name, CARS) or '.'} Known: {', '.join(CARS)}")
    return CARS[name]()
