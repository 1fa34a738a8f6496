"""Igel wheel dynamometers: three messages a wheel at 500 Hz. The wire is described in ``docs/wires/igel.md``."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.can import CanSensor
from lacet.drivers.framework.crc import CRC8_J1850


class Igel(CanSensor, Driver):
    """Force, moment, angle and speed of each wheel; one counter, status and checksum over the three messages.

    The wheel angle is delivered as sent, within [0, 2π) rad; whoever reads the run unwraps it.
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
