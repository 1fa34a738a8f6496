"""Where the inertial unit is, by axis, from the car's own equations.

A unit p farther along an axis feels ω̇ × p + ω × (ω × p) more. Forces are mass times acceleration of the centre of
gravity, and the loads at rest show where that is, so that p is estimated beside all parameters of the car, the
centre of gravity and the inertias among them (source: the effect `sensor_position`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.identify.effects.sensors.sensor_position import SensorPosition
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.wls import Fit, extended

TESTABLE = 0.05
"""Half of a 95 % interval above which an axis counts as not testable with the runs [m]: the size of a unit."""
_SURE = 1.5
"""Half intervals, 3 σ, by which a position may differ beside the sheet's tolerance."""
CHANNEL = "imu.accel"


@dataclass(frozen=True)
class AxisPosition:
    """Position of the inertial unit along one body axis.

    Attributes
    ----------
    axis : ``x``, ``y`` or ``z``.
    rig : position that the rig file gives [m].
    found : position found [m].
    half : half of its 95 % interval [m].
    tolerance : that of the sensor sheet, 1 σ [m].
    """

    axis: str
    rig: float
    found: float
    half: float
    tolerance: float

    @property
    def testable(self) -> bool:
        """Whether its 95 % interval is narrow enough for a test of the rig file's value."""
        return self.half < TESTABLE

    @property
    def agrees(self) -> bool:
        """Whether the rig file's position is within 3 σ of the one found, or within 2 σ of the sheet."""
        return abs(self.found - self.rig) <= max(_SURE * self.half, 2.0 * self.tolerance)


def unit_position(fitted: Fit) -> list[AxisPosition]:
    """Position of the inertial unit by axis, from a fit with sensor positions added to its model.

    Empty where the runs have no inertial unit with a position in the rig, or no row of the chassis.
    """
    rig = fitted.runs[0].recording.rig
    sensor = rig.sensor_of(CHANNEL)
    if sensor is None or not any(row.kind == "chassis" for row in fitted.rows):
        return []
    given: Sequence[float] = sensor.position.get("", (0.0, 0.0, 0.0))
    faults = {axis: SensorPosition(f"imu.{axis}") for axis in "xyz"}
    there = {effect.key for effect in fitted.model.effects}
    found = extended(fitted, [fault for fault in faults.values() if fault.key not in there])
    names = [parameter.name for parameter in found.model.parameters]
    out: list[AxisPosition] = []
    for k, (axis, fault) in enumerate(faults.items()):
        place = names.index(fault.parameters[0].name)
        half = TWO_SIDED_95 * float(np.sqrt(found.covariance[place, place]))
        tolerance = rig.tolerance(CHANNEL, "position")
        out.append(AxisPosition(axis, given[k], given[k] + float(found.theta[place]), half, tolerance))
    return out
