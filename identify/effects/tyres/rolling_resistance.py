"""Rolling resistance, already in the measured wheel loads."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class RollingResistance(AlreadyMeasured):
    """A tyre that resists rolling: a longitudinal force, or a moment about the spin axis, at the contact."""

    name = "rolling_resistance"
    about = "rolling resistance of the tyres"
    signature = "none: it is in the measured loads"
    shown_by = "no run: nothing is missing"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 4"
    measured_by = "the dynamometers measure its force and moment (Fx, My): both are on the measured side of every row"
