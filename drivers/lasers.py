"""Laser heights: two lasers a message, a message a wheel at 250 Hz. The wire is in ``docs/wires/lasers.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor


class Lasers(CanSensor, Driver):
    """Height above the road and distance to the wheel centre at each wheel; each laser has its own status."""

    name: str = "lasers"
    layout = "lasers.dbc"
    messages: Mapping[str, tuple[str, ...]] = {"laser_{c}": ("laser.{c}.ground", "laser.{c}.hub")}
