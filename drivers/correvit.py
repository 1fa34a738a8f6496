"""Correvit optical speed sensor: one message at 250 Hz. The wire is described in ``docs/wires/correvit.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor


class Correvit(CanSensor, Driver):
    """Longitudinal and transverse velocity over the road at the sensor's mount."""

    name: str = "correvit"
    layout = "correvit.dbc"
    messages: Mapping[str, tuple[str, ...]] = {"correvit": ("correvit.speed",)}
