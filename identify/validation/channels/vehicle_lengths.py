"""Wheelbase and tracks of the vehicle file: what an error of them changes in a car's equations."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import Final

import numpy as np

from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import residual

_STEP: Final = 1e-3
"""Step of a length of which the derivative is taken [m]."""


class Length(Enum):
    """A length of the vehicle file, by its key there."""

    FRONT_TRACK = "axle.front.track"
    REAR_TRACK = "axle.rear.track"
    WHEELBASE = "geometry.wheelbase"

    def of(self, vehicle: Vehicle) -> float:
        """The length of a vehicle file [m]."""
        if self is Length.WHEELBASE:
            return vehicle.wheelbase
        left, right = ("fl", "fr") if self is Length.FRONT_TRACK else ("rl", "rr")
        return vehicle.corners[left].position[1] - vehicle.corners[right].position[1]


def with_lengths(vehicle: Vehicle, longer: Mapping[Length, float]) -> Vehicle:
    """The vehicle with lengths that are so much longer [m]; the origin stays between the front wheels."""
    corners = {name: _moved(corner, longer) for name, corner in vehicle.corners.items()}
    return replace(vehicle, corners=corners)


def _moved(corner: Corner, longer: Mapping[Length, float]) -> Corner:
    front = corner.name.startswith("f")
    x, y, z = corner.position
    y += 0.5 * corner.side * longer.get(Length.FRONT_TRACK if front else Length.REAR_TRACK, 0.0)
    return replace(corner, position=(x if front else x - longer.get(Length.WHEELBASE, 0.0), y, z))


def length_columns(
    run: PreparedRun, effects: Sequence[PhysicalEffect], theta: Array, of: Collection[Length]
) -> dict[Row, Array]:
    """What the left sides of a run's rows would have beside the laws (k, n), for each length 1 m longer than it says.

    First order, at parameter values `theta` (p,) of `effects`; zero for lengths that are not among those `of` interest.
    """
    if not of:
        return {row: np.zeros((len(Length), len(run.index[row]))) for row in run.rows}
    recording = run.recording
    before = residual(build_motion(recording), effects, theta)
    changes: dict[Row, list[Array]] = {row: [] for row in run.rows}
    for length in Length:
        if length not in of:
            for row, found in changes.items():
                found.append(np.zeros_like(before[row]))
            continue
        longer = replace(recording, vehicle=with_lengths(recording.vehicle, {length: _STEP}))
        after = residual(build_motion(longer), effects, theta)
        for row, found in changes.items():
            found.append((before[row] - after[row]) / _STEP)
    return run.decimated({row: np.stack(found) for row, found in changes.items()})
