"""Measured wheel loads in body axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.daq.rig import Rig
from lacet.identify.car.car_tree import orientation
from lacet.identify.multibody.vectors import Array, cross, turned


def pitches(channel: str, rig: Rig) -> bool:
    """Whether a wheel load is measured in axes that pitch with the carrier."""
    sensor = rig.sensor_of(channel)
    return sensor is None or sensor.axes in ("carrier", "sensor")


def load_in_body(values: Mapping[str, Array], channel: str, carrier: Array, rig: Rig, normal: Array) -> Array:
    """A wheel load in body axes (3, N), from the axes that the rig declares for it; `carrier` : axes (3, 3, N)."""
    load, spin_axis = values.get(channel), carrier[:, 1]
    if load is None:
        return np.zeros_like(spin_axis)
    sensor = rig.sensor_of(channel)
    axes = "carrier" if sensor is None else sensor.axes
    if axes == "body":
        return load
    if axes == "tydex_c":  # x parallel to the road, y along the spin axis
        x = cross(spin_axis, normal)
        x = x / np.linalg.norm(x, axis=0)
        return x * load[0] + spin_axis * load[1] + cross(x, spin_axis) * load[2]
    if sensor is not None and axes == "sensor":  # mounted at an angle in the carrier
        load = orientation(sensor.orientation) @ load
    return turned(carrier, load)
