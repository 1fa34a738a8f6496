"""Units that a name ends in, as ``Lenkwinkel_deg``, ``speed_kmph`` or ``yaw_rate_deg_s``."""

from __future__ import annotations

import re

_UNITS = {
    "deg": "deg", "rad": "rad", "mrad": "mrad", "grad": "deg",
    "degps": "deg/s", "degs": "deg/s", "deg_s": "deg/s", "dps": "deg/s",
    "radps": "rad/s", "rads": "rad/s", "rad_s": "rad/s", "rpm": "1/min", "1pmin": "1/min", "Upm": "1/min",
    "trmin": "1/min", "tr_min": "1/min", "trpmin": "1/min",
    "kmh": "km/h", "kmph": "km/h", "kph": "km/h", "km_h": "km/h", "mps": "m/s", "ms": "m/s", "m_s": "m/s",
    "mps2": "m/s²", "ms2": "m/s²", "m_s2": "m/s²", "mpss": "m/s²", "g": "g",
    "m": "m", "cm": "cm", "mm": "mm", "N": "N", "daN": "daN", "kN": "kN", "Nm": "N·m", "kNm": "kN·m",
    "bar": "bar", "mbar": "mbar", "Pa": "Pa", "kPa": "kPa", "pct": "%", "percent": "%",
}  # fmt: skip
"""Ends of names → units. Capitals count: ``Rad`` is a German wheel, and ``n`` a speed of rotation."""
_END = re.compile(
    rf"(?P<stem>.*[^\W_].*?)(?:[_ .-]+|\s*[\[(]\s*)(?P<unit>{'|'.join(sorted(_UNITS, key=len, reverse=True))})\s*[\])]?"
)


def unit_at_end(name: str) -> tuple[str, str] | None:
    """A name without the unit that it ends in, and that unit; None where it ends in none."""
    found = _END.fullmatch(name)
    return None if found is None else (found["stem"], _UNITS[found["unit"]])
