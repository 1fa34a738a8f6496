"""Motions simulated once for all tests of the simulated car, and a rig to measure them."""

from __future__ import annotations

import functools

import numpy as np

from lacet.daq.rig import Rig
from lacet.simulate import Hidden, find_car, make_manoeuvre, run
from lacet.simulate.motion import SimulatedMotion

RIG = """
format = "lacet-rig 1"
name = "trial"
wheel_reference = "{reference}"
[bus.can0]
kind = "can"
[bus.serial0]
kind = "serial"
[bus.udp0]
kind = "udp"
[[sensor]]
name = "wheels"
driver = "igel"
bus = "can0"
channels = ["wheel.*"]
axes = "{axes}"
latency = 0.002
[[sensor]]
name = "imu"
driver = "sagem"
bus = "serial0"
channels = ["imu.*"]
position = [-1.35, 0.1, 0.31]
orientation = [0.02, -0.03, 0.05]
latency = 0.004
clock = "device"
[[sensor]]
name = "lasers"
driver = "lasers"
bus = "can0"
channels = ["laser.*"]
position_from_wheel_centre = [0.0, 0.0, 0.30]
latency = 0.008
[[sensor]]
name = "cameras"
driver = "zimmer"
bus = "udp0"
channels = ["camera.*"]
latency = 0.025
clock = "device"
[[sensor]]
name = "correvit"
driver = "correvit"
bus = "can0"
channels = ["correvit.speed"]
axes = "heading"
position = [-3.2, 0.0, 0.01]
latency = 0.012
[[sensor]]
name = "torques"
channels = ["shaft.*", "brake.*"]
latency = 0.003
"""


def make_rig(reference: str = "contact", axes: str = "carrier") -> Rig:
    """A rig with every sensor."""
    return Rig.parse(RIG.format(reference=reference, axes=axes), "trial")


@functools.cache
def drive(name: str, *hidden: str, seed: int = 1, **settings: float) -> SimulatedMotion:
    """A short motion, computed once."""
    effects = [Hidden.parse(text) for text in hidden]
    chosen = {"duration": 3.0, **settings}
    return run(find_car("peugeot-406"), make_manoeuvre(name, **chosen), effects, seed=seed, settle=1.0)


MOTIONS = ("sinus", "liftoff", "spiral", "braking", "rough", "sweep", "kerb")


def relative(residual: np.ndarray, scale: np.ndarray) -> float:
    """Largest residual over the largest value of what it closes."""
    return float(np.max(np.abs(residual)) / np.max(np.abs(scale)))
