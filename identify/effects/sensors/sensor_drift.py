"""Zero drift: sensor zeros that change during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.rig import DEFAULT_TOLERANCE
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording

_FAMILIES = ("wheel.force", "imu.accel", "imu.rate", "laser.ground", "laser.hub")
"""Channel families whose zeros matter in the rows and whose instruments warm up."""


class SensorDrift(SensorFault):
    """One component's zero wanders with time, at the same rate in every run: y = x + d t, t from the run's start.

    What differs from run to run is the run's zero. `where` is a column, ``wheel.fl.force.z``.
    """

    name = "sensor_drift"
    about = "an instrument's zero that drifts during a run"
    signature = "every row it enters grows with time, whatever the car does"
    shown_by = "long runs; a piece of steady driving at their beginning and end"
    source = "Doebelin (2004), Measurement Systems, chapter 3 (zero drift)"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Each component of wheel forces, inertial unit and lasers."""
        return [cls(column) for column, (channel, _) in COLUMNS.items() if channel.family in _FAMILIES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Drift per minute, as the sensor sheet has it; ten times the usual tolerance at most."""
        channel, _ = COLUMNS[self.where]
        most = 10.0 * DEFAULT_TOLERANCE.get(f"{channel.family}.drift", 0.0)
        return (self.named("d", f"{channel.unit}/min", -most, most),)

    def channels(self) -> tuple[str, ...]:
        """The one channel."""
        return (COLUMNS[self.where][0].name,)

    def perturb(self, channel: str, recording: Recording) -> Array:
        """Minutes since the run's start."""
        out = np.zeros((CHANNELS[channel].width, recording.t.size))
        out[COLUMNS[self.where][1]] = (recording.t - recording.start) / 60.0
        return out

    @property
    def tolerance(self) -> str:
        """The sheet's drift, per minute."""
        return "drift"
