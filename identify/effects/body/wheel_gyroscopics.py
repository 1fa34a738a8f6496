"""Gyroscopic moments and spin inertia of the wheels, already in the base model."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class WheelGyroscopics(AlreadyMeasured):
    """Wheels that spin while the car yaws, rolls and steers."""

    name = "wheel_gyroscopics"
    about = "gyroscopic moments and spin inertia of the wheels"
    signature = "none: it is in the base model"
    shown_by = "no run: nothing is missing"
    source = "Khalil and Dombre (2002), Modeling, Identification and Control of Robots, chapter 9"
    measured_by = (
        "the wheels are bodies of the tree: their angular momentum is in every row, with the measured wheel speeds"
    )
