"""A run reduced to the channels of its equations; travel becomes the hub laser that it stands in for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.rig import DEFAULT_TOLERANCE, Rig, Sensor
from lacet.daq.run import ChosenSignals, Run, Signal
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.own_rate import at_own_rate

STAND_INS: dict[str, tuple[str, ...]] = {
    "wheel.{c}.force": ("hub.{c}.load", "pushrod.{c}.force", "scale.{c}.load"),
    "camera.fl.steer": ("steering.angle",),
    "camera.fr.steer": ("steering.angle",),
    "correvit.speed": ("car.speed", "gnss.speed"),
    "imu.rate": ("car.yaw_rate",),
    "imu.accel": ("car.lateral_accel",),
}
"""Channel of the equations → channels that may stand in for it where it is not measured, the best first."""


_ABOVE_CENTRE = (0.0, 0.0, 0.3)
"""Mount of a corner's lasers from its wheel centre where the rig gives none [m]."""
_OF_A_CHANNEL = ("zero", "gain", "drift")
"""Entries of the sensor sheet for each channel."""
_TRAVEL = ("suspension.{c}.travel", "damper.{c}.travel")
_SPEED = ("correvit.speed", "car.speed", "gnss.speed")


def alternatives(channel: str) -> tuple[str, ...]:
    """Channels that serve as well as one that the equations need, the best first: any of them is enough."""
    corner = CHANNELS[channel].corner or ""
    others = {"laser.hub": _TRAVEL, "imu.attitude": _SPEED}.get(CHANNELS[channel].family, ())
    for pattern, found in STAND_INS.items():
        if pattern.format(c=corner) == channel:
            others = found
    return tuple(other.format(c=corner) for other in others)


def stands_in_for(channel: str) -> tuple[str, ...]:
    """Channels of the equations that a channel may stand in for."""
    corner = CHANNELS[channel].corner or ""
    named = {pattern.format(c=corner): others for pattern, others in STAND_INS.items()}
    named[f"laser.{corner}.hub"] = _TRAVEL
    return tuple(name for name, others in named.items() if channel in [other.format(c=corner) for other in others])


def for_equations(run: Run, vehicle: Vehicle, rig: Rig) -> tuple[Run, Rig]:
    """The run with the channels of its equations only, those that stand in for one that is not measured included.

    A corner with measured travel and without a hub laser gets the hub laser's values: the height of its mount above the
    wheel centre at design height, less the travel; and the rig has the sensor of that travel as this laser's, with its
    latency, noise and tolerances. A potentiometer on the damper stands in where the vehicle file has a motion ratio.
    A channel slower than its table loses the empty cells between its samples.
    """
    names = dict.fromkeys(name for name in run.signals if not CHANNELS[name].recorded_only)
    for pattern, others in STAND_INS.items():
        for c in CORNERS if "{c}" in pattern else ("",):
            if pattern.format(c=c) not in run.signals:
                there = [name for other in others if (name := other.format(c=c)) in run.signals]
                names |= dict.fromkeys(there[:1])
    travels: dict[str, str] = {}
    for corner in CORNERS:
        hub, travel, damper = f"laser.{corner}.hub", f"suspension.{corner}.travel", f"damper.{corner}.travel"
        if hub in names:
            continue
        if travel in run.signals:
            travels[travel] = hub
        elif damper in run.signals and vehicle.assumption("motion_ratio", corner).given:
            names[damper] = None
    rig = with_travel_as_laser(rig, travels)
    made: dict[str, Signal] = {}
    for travel, hub in travels.items():
        signal, corner = at_own_rate(run.signals[travel]), vehicle.corners[CHANNELS[hub].corner or ""]
        made[hub] = replace(signal, values=design_reading(rig, corner) - signal.values)
    for name in names:
        signal = run.signals[name]
        if (slower := at_own_rate(signal)) is not signal:
            made[name] = slower
    if made or names.keys() != run.signals.keys():
        run = replace(run, signals=ChosenSignals(run.signals, list(names), made))
    return run, rig


def with_travel_as_laser(rig: Rig, travels: Mapping[str, str]) -> Rig:
    """The rig with the sensors of `travels` as those of the hub lasers that they stand in for, travel → laser."""
    measured = {travel: hub for travel, hub in travels.items() if rig.sensor_of(travel) is not None}
    sensors = (
        replace(one, channels=tuple(name for name in one.channels if name not in measured.values()))
        for one in rig.sensors
    )
    return replace(rig, sensors=tuple(_as_laser(one, measured) for one in sensors)) if measured else rig


def _as_laser(sensor: Sensor, travels: Mapping[str, str]) -> Sensor:
    """A sensor with its travels as hub lasers. The mount is that of the corner's lasers, unless it has one itself."""
    if not travels.keys() & set(sensor.channels):
        return sensor
    entries = {f"laser.hub.{what}": DEFAULT_TOLERANCE.get(f"suspension.travel.{what}", 0.0) for what in _OF_A_CHANNEL}
    entries |= {
        key.replace("suspension.travel", "laser.hub"): value
        for key, value in sensor.tolerance.items()
        if key.startswith("suspension.travel.")
    }
    noise = sensor.noise.get("suspension.travel", CHANNELS[next(iter(travels))].noise)
    lasers = any(name.startswith("laser.") for name in sensor.channels)
    return replace(
        sensor, channels=tuple(travels.get(name, name) for name in sensor.channels),
        noise={**sensor.noise, "laser.hub": noise}, tolerance={**sensor.tolerance, **entries},
        position=sensor.position if lasers else {}, from_wheel_centre=sensor.from_wheel_centre if lasers else None,
    )  # fmt: skip


def design_reading(rig: Rig, corner: Corner) -> float:
    """Reading of a corner's hub laser at design height [m]."""
    return float(laser_mount(rig, corner)[2] - corner.position[2])


def laser_mount(rig: Rig, corner: Corner) -> Array:
    """(3,) position of a corner's lasers in body axes [m]; `_ABOVE_CENTRE` where the rig gives none."""
    rows = (rig.sensor_of(f"laser.{corner.name}.{what}") for what in ("hub", "ground"))
    there = [row for row in rows if row is not None]
    for row in there:
        if corner.name in row.position:
            return np.asarray(row.position[corner.name])
    offsets = (row.from_wheel_centre for row in there if row.from_wheel_centre is not None)
    return np.asarray(corner.position) + np.asarray(next(offsets, _ABOVE_CENTRE))
