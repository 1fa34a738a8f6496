"""Compliance of steering and toe under load, already in the measured wheel angles."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class SteerCompliance(AlreadyMeasured):
    """A carrier that turns under lateral force or braking moment."""

    name = "steer_compliance"
    about = "compliance of the steering and of toe under load"
    signature = "none: it is in the measured steer and camber angles"
    shown_by = "no run: nothing is missing"
    source = "Reimpell et al. (2001), The Automotive Chassis, chapters 3 and 4"
    measured_by = "the cameras measure steer and camber of every wheel as they are, compliance included"
