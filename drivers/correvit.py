"""Driver of the Correvit optical speed sensor: one message at 250 Hz. Wire format: ``docs/wires/correvit.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor


class Correvit(CanSensor, Driver):
    """Driver of the Correvit: longitudinal and transverse velocity over the road at the sensor's mount."""

    name: str = "correvit"
    layout = "correvit.dbc"
    messages: Mapping[str, tuple[str, ...]] = {"correvit": ("correvit.speed",)}
