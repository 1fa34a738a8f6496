"""Driver of Igel wheel dynamometers: three messages a wheel at 500 Hz. Wire format: ``docs/wires/igel.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor
from lacet.drivers.framework.crc import CRC8_J1850


class Igel(CanSensor, Driver):
    """Driver of the Igel: force, moment, angle and speed of each wheel; one counter, status and checksum a sample.

    The wheel angle is decoded as sent, within [0, 2π) rad; it is unwrapped when the run is read.
    """

    name: str = "igel"
    layout = "igel.dbc"
    messages: Mapping[str, tuple[str, ...]] = {
        "wheel_{c}_force": ("wheel.{c}.force",),
        "wheel_{c}_moment": ("wheel.{c}.moment",),
        "wheel_{c}_state": ("wheel.{c}.angle", "wheel.{c}.speed"),
    }
    cyclic = ("wheel.{c}.angle",)
    checksum = CRC8_J1850
