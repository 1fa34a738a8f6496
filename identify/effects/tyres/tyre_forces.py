"""Lateral behaviour of the tyres, already in the measured wheel loads."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class CamberThrust(AlreadyMeasured):
    """A lateral force of a tyre that leans."""

    name = "camber_thrust"
    about = "camber thrust of the tyres"
    signature = "none: it is in the measured loads"
    shown_by = "no run: nothing is missing"
    source = "Pacejka (2012), Tire and Vehicle Dynamics, chapter 4"
    measured_by = "the dynamometers measure the lateral force Fy, whatever makes it"


class PneumaticTrail(AlreadyMeasured):
    """A lateral force that acts behind the wheel centre."""

    name = "pneumatic_trail"
    about = "pneumatic trail and self-aligning moment of the tyres"
    signature = "none: it is in the measured loads"
    shown_by = "no run: nothing is missing"
    source = "Pacejka (2012), Tire and Vehicle Dynamics, chapter 3"
    measured_by = "the dynamometers measure the moment Mz about the wheel centre, whatever makes it"


class TyreSideCompliance(AlreadyMeasured):
    """A contact patch that moves sideways under load."""

    name = "tyre_side_compliance"
    about = "lateral compliance of the tyres"
    signature = "none: it is in the measured loads"
    shown_by = "no run: nothing is missing"
    source = "Pacejka (2012), Tire and Vehicle Dynamics, chapter 4"
    measured_by = "the dynamometers measure the moment Mx about the wheel centre, with the lever as it is"
