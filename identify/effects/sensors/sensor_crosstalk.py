"""Cross-talk of the wheel dynamometers: one force read as another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording

_PAIRS = ("zx", "zy", "xz", "yz")
"""From which force into which: the vertical one, which is large, into the others; the others into the vertical one,
which the suspensions and tyres read."""


class SensorCrosstalk(SensorFault):
    """A part of one force is read as another, in the dynamometer's axes: F_b read = F_b + p F_a.

    `where` is the wheel, or ``all`` for the same of every wheel, and the pair: ``fl.zx`` is vertical read as
    longitudinal.
    """

    name = "sensor_crosstalk"
    about = "cross-talk of a wheel dynamometer: a part of one force read as another"
    signature = "rows of one force follow another force of the same wheel, constant parts included"
    shown_by = "strong braking and cornering: forces that change apart from each other"
    source = "Doebelin (2004), Measurement Systems, chapter 5 (multi-component dynamometers)"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Each pair, for all wheels alike and for each."""
        return [cls(f"{place}.{pair}") for place in ("all", *vehicle.corners) for pair in _PAIRS]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The part p."""
        return (self.named("p", "-", -0.1, 0.1),)

    def channels(self) -> tuple[str, ...]:
        """The wheel's force, or that of all wheels."""
        place = self.where.partition(".")[0]
        return tuple(f"wheel.{c}.force" for c in (("fl", "fr", "rl", "rr") if place == "all" else (place,)))

    def perturb(self, channel: str, recording: Recording) -> Array:
        """The one force, in the place of the other."""
        value = recording.signals.value[channel]
        out = np.zeros_like(value)
        source, target = self.where.partition(".")[2]
        out["xyz".index(target)] = value["xyz".index(source)]
        return out

    @property
    def tolerance(self) -> str:
        """The sheet's cross-talk."""
        return "crosstalk"
