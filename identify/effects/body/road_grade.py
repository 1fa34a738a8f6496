"""Grade and bank of the road, already in the measured specific force."""

from __future__ import annotations

from lacet.identify.effects.base import AlreadyMeasured


class RoadGrade(AlreadyMeasured):
    """A road that climbs or leans."""

    name = "road_grade"
    about = "grade and bank of the road"
    signature = "none: it is in the specific force"
    shown_by = "no run: nothing is missing"
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology, chapter 3"
    measured_by = (
        "the inertial unit measures specific force, gravity included, in the axes of the body; "
        "the ground lasers measure the road under the tyres"
    )
