"""Driver of laser height sensors: one message for two lasers of a wheel, 250 Hz. Format: ``docs/wires/lasers.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor


class Lasers(CanSensor, Driver):
    """Driver of the lasers: height above the road and distance to the wheel centre of each wheel, with status."""

    name: str = "lasers"
    layout = "lasers.dbc"
    messages: Mapping[str, tuple[str, ...]] = {"laser_{c}": ("laser.{c}.ground", "laser.{c}.hub")}
