"""Drive and brake torques, internal to the car or already in rows of their own."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class WheelTorque(AlreadyMeasured):
    """Torques of engine and brakes on the wheels."""

    name = "wheel_torque"
    about = "drive and brake torque"
    signature = "none: rows they enter are formed only where they are measured or eliminated"
    shown_by = "no run: nothing is missing"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapters 2 and 3"
    measured_by = (
        "they are internal to the car and in no chassis row; suspension and spin rows take them from shaft.*.torque "
        "and brake.*.torque, or eliminate them, or are left out where that cannot be (lacet info --rows)"
    )
