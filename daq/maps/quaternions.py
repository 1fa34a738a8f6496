"""Attitude of a log that has it as a quaternion x, y, z, w, from the body to the ground (REP 103): its three angles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.daq.maps.names import written_name
from lacet.daq.sources.source import Listed, Series

QUANTITY = "quaternion"
"""Word for the quantity in `Listed.quantity`."""
_PARTS = ("x", "y", "z", "w")
_ANGLES = {
    "roll": ("x", "atan2(2 * ({w} * {x} + {y} * {z}), 1 - 2 * ({x}**2 + {y}**2))"),
    "pitch": ("y", "asin(2 * ({w} * {y} - {z} * {x}))"),
    "yaw": ("z", "atan2(2 * ({w} * {z} + {x} * {y}), 1 - 2 * ({y}**2 + {z}**2))"),
}
"""Angle → the part of the quaternion in whose line it is proposed, and how it is made of all four."""


def attitudes(listed: Mapping[str, Listed], series: Mapping[str, Series]) -> dict[str, tuple[str, str, Series]]:
    """Names of parts → column of the attitude, expression of it, and its values [rad]; of whole quaternions only."""
    out: dict[str, tuple[str, str, Series]] = {}
    for name, one in listed.items():
        stem, _, part = name.rpartition(".")
        names = {p: f"{stem}.{p}" for p in _PARTS}
        if part != "w" or one.quantity != QUANTITY or not all(n in series for n in names.values()):
            continue
        x, y, z, w = (series[names[p]].values for p in _PARTS)
        values = {
            "roll": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x**2 + y**2)),
            "pitch": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            "yaw": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2)),
        }
        if np.ptp(w) == 0.0 and np.ptp(x) == 0.0:
            continue  # not measured: a message has it all the same
        written = {p: written_name(n) for p, n in names.items()}
        for angle, (at, formula) in _ANGLES.items():
            made = Series(series[names[at]].t, values[angle])
            out[names[at]] = (f"imu.attitude.{angle}", formula.format(**written), made)
    return out
