"""Hidden effects: what the simulated car or its sensors have and the base model lacks, by name and size.

A mechanical effect acts as a real force in the engine; a sensor fault acts on what the sensors report. Names are
``effect.where``, as in the catalogue of effects: ``anti_roll_bar.front``, ``aero_drag``, ``sensor_latency.imu``.
Suspension laws give the force F(s, ṡ) that adds to k·s + c·ṡ + offset at one corner, s travel (compression positive).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from daq.channels import CHANNELS, COLUMNS, CORNERS, FAMILIES
from daq.errors import UsageError, nearest

AXLES = ("front", "rear")
ANYWHERE = (*AXLES, *CORNERS)
SuspensionLaw = Callable[[float, float], float]


@dataclass(frozen=True)
class Kind:
    """One kind of hidden effect: `unit` of its size, the places it can be at, its shape constants with defaults."""

    about: str
    unit: str
    places: tuple[str, ...] = AXLES
    shape: Mapping[str, float] = field(default_factory=dict)


_SENSORS_BY_PART = ("wheel", "imu", "laser", "camera", "correvit")

SHORT = {f"{what}.{c}": f"{part}.{c}.{what}" for c in CORNERS for part, what in (("wheel", "force"), ("laser", "hub"))}
"""The catalogue's short places of single channels: ``force.fl``, ``hub.rr``."""

KINDS: dict[str, Kind] = {
    # suspension, per axle (size × law at both corners) or, but for the bar, at one corner
    "anti_roll_bar": Kind("size·(s - s of the other side)", "N/m"),
    "coulomb": Kind("size·tanh(ṡ/v0)", "N", ANYWHERE, {"v0": 0.01}),
    "damper_asymmetry": Kind("size·|ṡ|: stiffer in bump than in rebound", "N·s/m", ANYWHERE),
    "damper_digressive": Kind("size·ṡ·|ṡ| (negative: digressive)", "N·s²/m²", ANYWHERE),
    "damper_stroke": Kind("size·s·ṡ", "N·s/m²", ANYWHERE),
    "spring_quadratic": Kind("size·s²", "N/m²", ANYWHERE),
    "spring_cubic": Kind("size·s³", "N/m³", ANYWHERE),
    "bump_stop": Kind("size·max(0, s - gap)", "N/m", ANYWHERE, {"gap": 0.03}),
    "rebound_stop": Kind("-size·max(0, -s - gap)", "N/m", ANYWHERE, {"gap": 0.03}),
    "helper_spring": Kind("size·min(s, gap): works up to the gap, then is solid", "N/m", ANYWHERE, {"gap": 0.01}),
    # suspension kinematics, per axle
    "anti_dive": Kind("wheel centre moves forward by size·s", "-"),
    "jacking": Kind("wheel centre moves outward by size·s", "-"),
    # tyres, per axle
    "tyre_damping": Kind("size·dδ/dt along the road normal", "N·s/m"),
    "tyre_progression": Kind("size·δ² along the road normal", "N/m²"),
    "rolling_resistance": Kind("added to the rolling resistance coefficient (measured: no model lacks it)", "-"),
    "camber_thrust": Kind("lateral force size·Fz·camber (measured: no model lacks it)", "-"),
    # body
    "aero_drag": Kind("size·vx·|vx| to the rear at `height` above the road", "N·s²/m²", (), {"height": 0.0}),
    "aero_lift": Kind("size·vx² upwards on the body at the axle's middle", "N·s²/m²"),
    "payload": Kind("point mass fixed to the body at x, y, z", "kg", (), {"x": -2.2, "y": 0.0, "z": 0.3}),
    # sensors
    "sensor_latency": Kind("delay on top of the rig's", "s", (*_SENSORS_BY_PART, *FAMILIES)),
    "sensor_gain": Kind("values × (1 + size)", "-", (*_SENSORS_BY_PART, *SHORT, *FAMILIES, *CHANNELS, *COLUMNS)),
    "sensor_zero": Kind("values + size", "SI", (*COLUMNS,)),
    "sensor_drift": Kind("values + size·t/60 s", "SI per minute", (*COLUMNS,)),
    "sensor_misalignment": Kind(
        "sensor turned by size about a body axis", "rad", ("imu.roll", "imu.pitch", "imu.yaw", "correvit.yaw")
    ),
    "sensor_crosstalk": Kind("force.x and .y + size·force.z", "-", ("wheel.force",)),
}
"""Every kind of hidden effect by name."""


def known_names() -> list[str]:
    """Every full name, the longest lists (single corners, channels and columns) left out."""
    out = []
    for name, kind in KINDS.items():
        places = [p for p in kind.places if p not in (*CORNERS, *CHANNELS, *COLUMNS)] or list(kind.places[:1])
        out += [f"{name}.{place}" for place in places] if kind.places else [name]
    return out


@dataclass(frozen=True)
class Hidden:
    """One hidden effect.

    `name` in full (``bump_stop.front``), or with `where` apart; `size` in the unit of its kind; `shape` its constants
    (``{"gap": 0.02}``), defaults filled in. Raises UsageError for what is not known, with the nearest
    match and the list.
    """

    name: str
    size: float
    where: str | None = None
    shape: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        head, _, tail = self.name.partition(".")
        where = self.where or tail or None
        full = head if where is None else f"{head}.{where}"
        kind = KINDS.get(head)
        places = kind.places if kind else ()
        if kind is None or (where not in places if places else where is not None):
            choices = known_names() if kind is None or not places else [f"{head}.{place}" for place in places]
            shown = ", ".join(choices[:60])
            raise UsageError(f"no hidden effect is called '{full}'{nearest(full, choices)} Known: {shown}")
        for key in self.shape:
            if key not in kind.shape:
                listed = ", ".join(kind.shape) or "none"
                raise UsageError(f"{full} has no shape constant '{key}'{nearest(key, kind.shape)} It has: {listed}")
        if not math.isfinite(self.size):
            raise UsageError(f"the size of {full} must be a finite number, found {self.size}")
        object.__setattr__(self, "name", full)
        object.__setattr__(self, "where", where)
        object.__setattr__(self, "shape", {**kind.shape, **self.shape})

    @property
    def effect(self) -> str:
        """The kind's name."""
        return self.name.partition(".")[0]

    @property
    def of_sensor(self) -> bool:
        """Whether it acts on what the sensors report instead of on the car."""
        return self.effect.startswith("sensor_")

    @classmethod
    def parse(cls, text: str) -> Hidden:
        """From ``name=size`` or ``name=size,constant=value``; raises UsageError."""
        head, *rest = text.split(",")
        try:
            name, size = head.split("=")
            pairs = [item.split("=") for item in rest]
            return cls(name.strip(), float(size), shape={key.strip(): float(value) for key, value in pairs})
        except ValueError:
            raise UsageError(
                f"'{text}' is not a hidden effect: write name=size or name=size,constant=value, "
                "e.g. anti_roll_bar.front=19780 or bump_stop.front=200000,gap=0.02"
            ) from None

    def truth(self) -> dict[str, Any]:
        """JSON-able record."""
        kind = KINDS[self.effect]
        return {"name": self.name, "size": self.size, "unit": kind.unit, "shape": dict(self.shape), "law": kind.about}

    def at(self, corner: str) -> bool:
        """Whether an effect of an axle or a corner acts at `corner`."""
        return self.where in (corner, "front" if corner[0] == "f" else "rear")


def suspension_law(effect: Hidden) -> SuspensionLaw | None:
    """Force [N] at a corner from (s, ṡ); None when the effect is not such a law."""
    p = effect.size
    match effect.effect:
        case "coulomb":
            v0 = effect.shape["v0"]
            return lambda s, v: p * math.tanh(v / v0)
        case "damper_asymmetry":
            return lambda s, v: p * abs(v)
        case "damper_digressive":
            return lambda s, v: p * v * abs(v)
        case "damper_stroke":
            return lambda s, v: p * s * v
        case "spring_quadratic":
            return lambda s, v: p * s * s
        case "spring_cubic":
            return lambda s, v: p * s * s * s
        case "bump_stop":
            gap = effect.shape["gap"]
            return lambda s, v: p * max(0.0, s - gap)
        case "rebound_stop":
            gap = effect.shape["gap"]
            return lambda s, v: p * min(0.0, s + gap)
        case "helper_spring":
            gap = effect.shape["gap"]
            return lambda s, v: p * min(s, gap)
    return None


def total_at(effects: Iterable[Hidden], name: str, corner: str) -> float:
    """Sum of the sizes of one axle effect at a corner."""
    return sum(effect.size for effect in effects if effect.effect == name and effect.at(corner))
