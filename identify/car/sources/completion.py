"""Choice of a source for each channel that the rows need and a recording lacks: derived if it can be, else assumed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.channels import CHANNELS, CORNERS, other_corner
from lacet.daq.vehicle import Corner
from lacet.identify.car.rows import PARAMETER_OF, SPRUNG_MASS
from lacet.identify.car.sources.attitude import attitude_by_gravity
from lacet.identify.car.sources.car_bus import LATERAL, YAW_RATE, BusAccel, BusRates
from lacet.identify.car.sources.nominal_load import NominalLoad
from lacet.identify.car.sources.travel import DamperTravel, LoadTravel, UnsprungForce
from lacet.identify.car.sources.wheel_angles import Camber, Steer, SteeringWheel, SteerOfOther, Travels, Turning
from lacet.identify.car.sources.wheel_force import LoadCell, Pushrod, Scale
from lacet.identify.car.sources.wheel_moment import ContactMoment, Outboard
from lacet.identify.car.sources.wheel_speed import RolledSpeed, Speed, speed_of_turns
from lacet.identify.car.table_errors import table_assumptions
from lacet.identify.signals.for_equations import STAND_INS, design_reading
from lacet.identify.signals.reconstruct import Recording, RunNote, Signals
from lacet.identify.signals.sources import Kind, Law, Method, Source

SPEEDS = ("correvit.speed", "car.speed", "gnss.speed")
"""Channels whose first component is the forward speed, the best first."""
LEAST_LOAD = 100.0
"""Mean load of a wheel below which its travel is not taken from its load [N]."""
_INERTIAL = ("imu.accel", "imu.rate")


def completed(recording: Recording) -> Recording:
    """The recording with sources for the channels that it lacks; itself where it lacks none.

    Nothing that is measured is replaced. Without wheel forces, and without a mass or parameter given, nothing is
    assumed.
    """
    if recording.laws or recording.sources or recording.tables:
        return recording
    return with_tables(_Completion(recording).done())


def with_tables(recording: Recording) -> Recording:
    """The recording with what is assumed beyond the bench tables of its vehicle."""
    tables, n = table_assumptions(recording.vehicle), recording.t.size
    assumed = {**recording.signals.assumed, **{one.name: np.full((1, n), one.value) for one in tables}}
    return replace(recording, signals=replace(recording.signals, assumed=assumed), tables=tables)


def with_sources_of(recording: Recording, other: Recording) -> Recording:
    """A recording of some of another's samples, on the same instants, with the sources of that."""
    if not other.assumptions and not other.sources:
        return recording
    derived = {name: a for name, a in other.signals.value.items() if name in other.sources}
    signals = replace(
        recording.signals, value={**recording.signals.value, **derived}, assumed=dict(other.signals.assumed)
    )
    return replace(recording, signals=signals, sources=other.sources, laws=other.laws, tables=other.tables)


@dataclass(frozen=True)
class SteeringAngleUnused(RunNote):
    """The angle of the steering wheel is recorded, but its ratio to the front wheels' steer is not known."""

    is_fault = False


@dataclass
class _Completion:
    """Sources and laws of a recording, collected in the order in which the laws depend on each other."""

    recording: Recording
    notes: list[RunNote] = field(default_factory=list[RunNote])
    laws: list[Law[Signals]] = field(default_factory=list[Law[Signals]])
    sources: dict[str, Source] = field(default_factory=dict[str, Source])

    def done(self) -> Recording:
        """The recording with what was found."""
        recording = self.recording
        speed = next((name for name in SPEEDS if self._has(name)), None)
        stands = any(self._has(f"scale.{c}.load") for c in CORNERS)
        if (speed or stands) and self._has(*_INERTIAL) and not self._has("imu.attitude"):
            self._attitude(speed)
            recording = self.recording
        if not self._has(*_INERTIAL):
            self._bus()
        for step in (self._damper, self._force, self._travel, self._steer, self._camber, self._speed, self._moment):
            self._at_corners(step)
        n = recording.t.size
        assumed = {one.name: np.full((1, n), one.value) for law in self.laws for one in law.assumptions}
        usable = dict(recording.usable)
        for name, source in self.sources.items():
            masks = [recording.usable[one] for one in source.inputs if one in recording.usable]
            if masks:
                usable[name] = np.all(masks, axis=0)
        signals = replace(recording.signals, assumed=assumed)
        return replace(
            recording, signals=signals, usable=usable, sources=self.sources, laws=tuple(self.laws),
            notes=tuple(dict.fromkeys((*recording.notes, *self.notes))),
        )  # fmt: skip

    def _at_corners(self, step: Callable[[Corner], None]) -> None:
        for c in CORNERS:
            step(self.recording.vehicle.corners[c])

    def _has(self, *channels: str) -> bool:
        return all(name in self.recording.signals.value for name in channels)

    def _known(self, *channels: str) -> bool:
        """Whether channels are measured or have a source."""
        return all(name in self.recording.signals.value or name in self.sources for name in channels)

    def _assume(self, key: str, corner: str = "") -> Assumption:
        return self.recording.vehicle.assumption(key, corner)

    def _add(
        self, law: Law[Signals], method: Method, kinds: tuple[Kind, ...], inputs: tuple[str, ...], *unfit: str
    ) -> None:
        self.laws.append(law)
        self.sources[law.channel] = Source(kinds, method, tuple(dict.fromkeys(inputs)), unfit)

    def _all(self, channel: str, kind: Kind) -> tuple[Kind, ...]:
        return (kind,) * CHANNELS[channel].width

    def _attitude(self, speed: str | None) -> None:
        attitude = attitude_by_gravity(self.recording, speed)
        signals = self.recording.signals
        self.sources["imu.attitude"] = Source(
            self._all("imu.attitude", Kind.DERIVED), Method.GRAVITY, (*_INERTIAL, *((speed,) if speed else ()))
        )
        self.recording = replace(
            self.recording,
            signals=replace(signals, value={**signals.value, "imu.attitude": attitude}),
            rates={**self.recording.rates, "imu.attitude": self.recording.filters.rate},
        )

    def _bus(self) -> None:
        rig = self.recording.rig
        if not self._has(YAW_RATE, LATERAL) or any(rig.sensor_of(name) is not None for name in _INERTIAL):
            return
        sensor = rig.sensor_of(LATERAL)
        position = (0.0, 0.0, 0.0) if sensor is None else sensor.position.get("", (0.0, 0.0, 0.0))
        self._add(
            BusRates(self._assume("roll_gradient")), Method.CAR_BUS, (Kind.ASSUMED, Kind.ASSUMED, Kind.MEASURED),
            (YAW_RATE, LATERAL),
        )  # fmt: skip
        law = BusAccel(position, self._assume("longitudinal_accel"), self._assume("vertical_accel"))
        kinds = (Kind.ASSUMED, Kind.MEASURED, Kind.ASSUMED)
        self._add(law, Method.CAR_BUS, kinds, (LATERAL, YAW_RATE))

    @property
    def _so_far(self) -> Recording:
        """The recording with the laws found so far."""
        assumed = {
            one.name: np.full((1, self.recording.t.size), one.value) for law in self.laws for one in law.assumptions
        }
        signals = replace(self.recording.signals, assumed=assumed)
        return replace(self.recording, signals=signals, laws=tuple(self.laws))

    def _force(self, corner: Corner) -> None:
        c, rig = corner.name, self.recording.rig
        if self._has(f"wheel.{c}.force") or not self._known(*_INERTIAL):
            return
        shares = self._assume("lateral_share", c), self._assume("longitudinal_share", c)
        hub_loads = self.recording.reference == "hub"
        outboard = self._assume("outboard_mass", c) if hub_loads else None
        if self._has(load := f"hub.{c}.load"):
            kinds = (Kind.ASSUMED, Kind.ASSUMED, Kind.MEASURED)
            self._add(LoadCell(corner, load, rig, *shares), Method.LOAD_CELL, kinds, (load, *_INERTIAL))
        elif self._has(rod := f"pushrod.{c}.force") and (ratio := self._assume("pushrod_ratio", c)).given:
            law = Pushrod(
                corner, rig, design_reading(rig, corner), ratio, self._assume("unsprung_mass", c), outboard,
                self._assume("travel_accel", c), *shares,
            )  # fmt: skip
            self._add(law, Method.PUSHROD, (Kind.ASSUMED, Kind.ASSUMED, Kind.DERIVED), (rod, *_INERTIAL))
        elif self._has(load := f"scale.{c}.load"):
            kinds = (Kind.ASSUMED, Kind.ASSUMED, Kind.MEASURED)
            self._add(Scale(corner, rig, *shares, outboard), Method.SCALE, kinds, (load, *_INERTIAL))
        elif self._no_load and ((sprung := self._assume(SPRUNG_MASS)).given or self._given_parameters):
            law = NominalLoad(
                corner, rig, sprung if sprung.given else None, self._assume("static_load", c), self._given_parameters,
                self._assume("unsprung_mass", c), outboard, self._assume("load_transfer", c), *shares,
            )  # fmt: skip
            self._add(
                law, Method.NOMINAL_LOAD, self._all(law.channel, Kind.ASSUMED), _INERTIAL, "chassis", "suspension",
                "tyre", "spin",
            )  # fmt: skip

    @cached_property
    def _given_parameters(self) -> tuple[tuple[str, Assumption], ...]:
        """Parameters that the vehicle file gives and that set the scale of this rig's rows, by name."""
        found = {
            name.format(c=c): one
            for key, name in PARAMETER_OF.items()
            for c in CORNERS
            if (one := self._assume(key, c)).given and self._sets_scale(key, c)
        }
        return tuple(found.items())

    def _sets_scale(self, key: str, c: str) -> bool:
        """Whether a parameter given at a corner can set the scale.

        The static load of one wheel cannot, as the other three can cancel it by cross-weight (+ − − +), which moves no
        row; those of an axle can. A tyre's stiffness is in the row with its deflection alone.
        """
        if key == "static_load":
            return self._assume(key, other_corner(c)).given
        if key != "tyre_rate":
            return True
        grounds = [f"laser.{one}.ground" for one in CORNERS if self._has(f"laser.{one}.ground")]
        return f"laser.{c}.ground" in grounds and (len(grounds) >= 3 or self._known("imu.attitude"))

    @property
    def _no_load(self) -> bool:
        """Whether no wheel's load is measured and all travels are, as the rows of the body alone need them."""
        return not self._loads and all(self._known(f"laser.{c}.hub") for c in CORNERS)

    @cached_property
    def _loads(self) -> list[str]:
        """Measured channels of wheel loads."""
        kinds = ("wheel.{c}.force", *STAND_INS["wheel.{c}.force"])
        return [name for c in CORNERS for kind in kinds if self._has(name := kind.format(c=c))]

    def _damper(self, corner: Corner) -> None:
        c, design = corner.name, design_reading(self.recording.rig, corner)
        if not self._has(f"laser.{c}.hub") and self._has(damper := f"damper.{c}.travel"):
            law = DamperTravel(corner, design, self._assume("motion_ratio", c))
            self._add(law, Method.MOTION_RATIO, (Kind.DERIVED,), (damper,))

    def _travel(self, corner: Corner) -> None:
        c, rig, hub = corner.name, self.recording.rig, f"laser.{corner.name}.hub"
        design = design_reading(rig, corner)
        if not self._known(hub) and self._known(f"wheel.{c}.force") and self._known(*_INERTIAL):
            mean = self._mean_load(c)
            if mean < LEAST_LOAD:
                return
            follows = self._assume("travel_accel", c)
            law = LoadTravel(
                corner, rig, mean, design, self._assume("static_deflection", c), self._assume("travel", c),
                follows.value,
            )  # fmt: skip
            other = self.recording.vehicle.corners[("r" if c[0] == "f" else "f") + c[1]]
            mass = self._assume("unsprung_mass", c).value
            if self.recording.reference == "hub":
                mass -= self._assume("outboard_mass", c).value
            far = self._assume("travel_accel_other", c)
            self.laws.append(UnsprungForce(corner, other, rig, mass, follows, far))
            self._add(law, Method.LOAD_TRAVEL, (Kind.ASSUMED,), (f"wheel.{c}.force", *_INERTIAL), "suspension", "tyre")

    def _mean_load(self, c: str) -> float:
        """Mean load of a wheel over the run [N]."""
        load = self._so_far.completed.value[f"wheel.{c}.force"][2]
        return float(np.mean(np.asarray(load, float)))

    def _steer(self, corner: Corner) -> None:
        c, vehicle, rig = corner.name, self.recording.vehicle, self.recording.rig
        channel, hub = f"camera.{c}.steer", f"laser.{c}.hub"
        if self._has(channel) or not self._known(hub, f"wheel.{c}.force"):
            return
        travels, lasers = self._travels(corner)
        zero, kinds = self._assume("toe", c), (Kind.ASSUMED,)
        other = vehicle.corners[c[0] + ("r" if c[1] == "l" else "l")]
        if self._has(seen := f"camera.{other.name}.steer"):
            self._add(SteerOfOther(travels, zero, other), Method.OTHER_WHEEL, kinds, (seen,))
        elif c[0] == "r":
            self._add(Steer(travels, zero), Method.BENCH_TABLE, kinds, lasers)
        elif self._has("steering.angle") and (vehicle.steering is not None or self._assume("steering_ratio").given):
            scale = self._assume("steering_ratio" if vehicle.steering is None else "steering_table")
            law = SteeringWheel(travels, zero, scale, vehicle.steering)
            self._add(law, Method.STEERING_WHEEL, kinds, ("steering.angle", *lasers))
        elif self._known(*_INERTIAL) and self._known(*(f"wheel.{one}.force" for one in CORNERS)):
            speed = self._the_speed()
            slips = self._assume("slip_angle", "fl"), self._assume("slip_angle", "rl")
            law = Turning(travels, zero, rig, vehicle.wheelbase, speed, *slips)
            self._add(law, Method.TURN, kinds, tuple(name for name in (*_INERTIAL, speed.channel) if name))
            if self._has("steering.angle"):
                self.notes.append(SteeringAngleUnused())

    def _camber(self, corner: Corner) -> None:
        c, channel = corner.name, f"camera.{corner.name}.camber"
        needed = f"laser.{c}.hub", f"camera.{c}.steer"
        if self._has(channel) or not self._known(*needed):
            return
        travels, lasers = self._travels(corner)
        law = Camber(travels, self._assume("camber", c), self._assume("camber_slope", c))
        self._add(law, Method.BENCH_TABLE, (Kind.ASSUMED,), (*lasers, needed[1]))

    def _travels(self, corner: Corner) -> tuple[Travels, tuple[str, ...]]:
        """The travels that a wheel's bench tables are against, and the channels that give them."""
        rig, own = self.recording.rig, f"laser.{corner.name}.hub"
        other = self.recording.vehicle.corners[other_corner(corner.name)]
        design = design_reading(rig, corner)
        if corner.follows_other and self._known(laser := f"laser.{other.name}.hub"):
            return Travels(corner, design, design_reading(rig, other)), (own, laser)
        return Travels(corner, design), (own,)

    def _speed(self, corner: Corner) -> None:
        c = corner.name
        if self._has(f"wheel.{c}.speed") or not self._known(f"wheel.{c}.force") or not self._known(*_INERTIAL):
            return
        speed = self._the_speed()
        law = RolledSpeed(corner, self.recording.rig, speed, self._assume("loaded_radius", c), self._assume("slip", c))
        measured = tuple(name for name in (speed.channel, *_INERTIAL) if name)
        kind, method = (Kind.DERIVED, Method.FROM_SPEED) if speed.channel else (Kind.ASSUMED, Method.NOMINAL_SPEED)
        self._add(law, method, (kind,), measured)

    def _the_speed(self) -> Speed:
        """The best measured speed, else that of the run's turns."""
        for name in SPEEDS:
            if self._has(name):
                return Speed(name)
        recording = self._so_far
        nominal = speed_of_turns(recording.completed, recording.rig, recording.t.size)
        return Speed("", nominal, self._assume("speed"))

    def _moment(self, corner: Corner) -> None:
        c, hub_loads = corner.name, self.recording.reference == "hub"
        needed = f"wheel.{c}.force", f"camera.{c}.steer", *((f"wheel.{c}.speed",) if hub_loads else ())
        if self._has(f"wheel.{c}.moment") or not self._known(*needed):
            return
        outboard = Outboard(self._assume("outboard_mass", c), self._assume("outboard_spin_inertia", c))
        law = ContactMoment(
            corner, self.recording.rig, self._assume("loaded_radius", c), self._assume("pneumatic_trail", c),
            self._assume("friction", c),
            self._assume("rolling_resistance", c), self._assume("lateral_shift", c), outboard if hub_loads else None,
        )  # fmt: skip
        self._add(law, Method.CONTACT, self._all(law.channel, Kind.ASSUMED), needed, "spin")
