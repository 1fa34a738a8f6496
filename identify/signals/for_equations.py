"""A run as the equations take it: without channels that are only recorded, travel as the hub laser it stands in for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.multibody.vectors import Array


def for_equations(run: Run, vehicle: Vehicle, rig: Rig) -> Run:
    """The run with its channels of the equations only.

    A corner with measured travel (a potentiometer) and without a hub laser gets the hub laser's values: the height of
    its mount above the wheel centre at design height, less the travel.
    """
    signals = {name: signal for name, signal in run.signals.items() if not CHANNELS[name].recorded_only}
    for corner in CORNERS:
        travel, hub = run.signals.get(f"suspension.{corner}.travel"), f"laser.{corner}.hub"
        if travel is not None and hub not in signals:
            about = vehicle.corners[corner]
            design = float(laser_mount(rig, about)[2] - about.position[2])
            signals[hub] = Signal(travel.t, design - travel.values, travel.flags)
    return run if signals.keys() == run.signals.keys() else replace(run, signals=signals)


def laser_mount(rig: Rig, corner: Corner) -> Array:
    """(3,) position of a corner's lasers in body axes [m]; 0.3 m above the wheel centre where the rig gives none."""
    sensor = rig.sensor_of(f"laser.{corner.name}.hub") or rig.sensor_of(f"laser.{corner.name}.ground")
    centre = np.asarray(corner.position)
    if sensor is not None and corner.name in sensor.position:
        return np.asarray(sensor.position[corner.name])
    offset = (0.0, 0.0, 0.3) if sensor is None or sensor.from_wheel_centre is None else sensor.from_wheel_centre
    return centre + np.asarray(offset)
