"""How far bench tables may be off: one row a joint, a curve and what has an error of its own, for the sensor sheet.

Repeatability of a bench is of each wheel; what hysteresis and temperature of the rubber, or the rig itself, do to a
reading is alike on both wheels of an axle, in the mirrored signs of the tables. Together they are what one wheel may be
off. Slopes are of 50 mm of travel, of the wheel or of the axle's other one, and of 30 mm of rack.
"""

from __future__ import annotations

from lacet.daq.compliance import JOINTS

CURVES: dict[str, tuple[str, str]] = {
    "": ("travel", "50 mm of travel"),
    "_other": ("travel of the axle's other wheel", "50 mm of travel"),
    "_rack": ("travel of the rack", "30 mm of rack"),
}
"""Suffix of a key for each curve of a table: what it is against, and the range of a bench."""
AXLE = "_axle"
"""Suffix of the part that both wheels of an axle have in common."""
COMPLIANCE = "table_compliance"
_DIRECTIONS = {
    "half_track": "half track, outwards",
    "half_wheelbase": "half wheelbase, forwards",
    "toe": "toe-in",
    "camber": "camber, top outwards",
    "pitch": "pitch of the carrier, nose down",
}
_SLOPES = {  # (curve, place or angle): of each wheel, of both
    ("", "m"): (0.002, 0.004),
    ("", "rad"): (0.007, 0.007),
    ("_rack", "m"): (0.003, 0.007),
    ("_rack", "rad"): (0.012, 0.012),
}
_READINGS = {
    "m": ("0.1 mm of repeatability", "0.2 mm of hysteresis"),
    "rad": ("0.02° of repeatability", "0.02° of hysteresis"),
}


def table_key(joint: str, curve: str = "") -> str:
    """Key of the error of a joint's slope along a curve of its table, by the suffix of `CURVES`."""
    return f"table_{joint}{curve}"


def _rows() -> dict[str, tuple[str, float, float, str, str, str]]:
    out: dict[str, tuple[str, float, float, str, str, str]] = {}
    for curve, (against, over) in CURVES.items():
        for joint, unit in JOINTS.items():
            own, both = _SLOPES.get((curve, unit), _SLOPES["", unit])
            per = "-" if unit == "m" else "rad/m"
            reading, hysteresis = _READINGS[unit]
            about = f"{_DIRECTIONS[joint]}, per {against} beyond the bench table"
            key = table_key(joint, curve)
            out[key] = (per, 0.0, own, "corner", about, f"K&C rigs: {reading} in {over}")
            alike = f"{about}, alike on both wheels"
            out[f"{key}{AXLE}"] = (per, 0.0, both, "axle", alike, f"K&C rigs: {hysteresis} in {over}")
    stated = "compliance ÷ that of the bench table"
    out[COMPLIANCE] = ("-", 1.0, 0.05, "corner", stated, "rubber: scatter of its parts")
    source = "rubber: friction and temperature change its stiffness by 10 %"
    out[f"{COMPLIANCE}{AXLE}"] = ("-", 0.0, 0.09, "axle", f"added to {COMPLIANCE}, alike on both wheels", source)
    return out


TABLE_TOLERANCES = _rows()
"""Key → unit, value, tolerance (1 σ), what has an error of its own, meaning, source."""
