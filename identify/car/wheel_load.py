"""Measured wheel loads in body axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.identify.car.car_tree import orientation
from lacet.identify.multibody.vectors import Array, cross, turned
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.signals.sources import Method


def _axes(channel: str, recording: Recording) -> str:
    """Axes of a wheel load: those that the rig declares, of the body where it follows from a scale."""
    source, sensor = recording.sources.get(channel), recording.rig.sensor_of(channel)
    if source is not None and source.method is Method.SCALE:
        return "body"
    return "carrier" if sensor is None else sensor.axes


def pitches(channel: str, recording: Recording) -> bool:
    """Whether a wheel load is measured in axes that pitch with the carrier."""
    return _axes(channel, recording) in ("carrier", "sensor")


def load_in_body(
    values: Mapping[str, Array], channel: str, carrier: Array, recording: Recording, normal: Array
) -> Array:
    """A wheel load in body axes (3, N), from the axes that it is measured in; `carrier` : axes (3, 3, N)."""
    load, spin_axis = values.get(channel), carrier[:, 1]
    if load is None:
        return np.zeros_like(spin_axis)
    sensor, axes = recording.rig.sensor_of(channel), _axes(channel, recording)
    if axes == "body":
        return load
    if axes == "tydex_c":  # x parallel to the road, y along the spin axis
        x = cross(spin_axis, normal)
        x = x / np.linalg.norm(x, axis=0)
        return x * load[0] + spin_axis * load[1] + cross(x, spin_axis) * load[2]
    if sensor is not None and axes == "sensor":  # mounted at an angle in the carrier
        load = orientation(sensor.orientation) @ load
    return turned(carrier, load)
