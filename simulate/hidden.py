"""Hidden effects: effects of the simulated car or its sensors that the base model lacks, by name and size.

A mechanical effect is a force in the engine; a sensor fault changes the sensors' signals. Names are ``effect.where``,
as in the catalogue of effects: ``anti_roll_bar.front``, ``aero_drag``, ``sensor_latency.imu``. Suspension laws give the
force F(s, ṡ) that adds to k·s + c·ṡ + offset at one corner, s travel (compression positive).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.simulate.kinds import KINDS, known_names

SuspensionLaw = Callable[[float, float], float]


@dataclass(frozen=True)
class Hidden:
    """One hidden effect, by name and size.

    `name` in full (``bump_stop.front``), or without the place, which is `where`; `size` in the unit of its kind;
    `shape` its constants (``{"gap": 0.02}``), completed by defaults. Raises UsageError for an unknown name or constant,
    with the nearest match and the list.
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
        """Name of its kind."""
        return self.name.partition(".")[0]

    @property
    def of_sensor(self) -> bool:
        """Whether it changes the sensors' signals and not the car."""
        return self.is_of_sensor(self.effect)

    @staticmethod
    def is_of_sensor(kind: str) -> bool:
        """Whether a kind of effect is a sensor fault."""
        return kind.startswith("sensor_") or kind == "laser_tilt"

    @classmethod
    def parse(cls, text: str) -> Hidden:
        """The hidden effect of ``name=size`` or ``name=size,constant=value``. Raises UsageError."""
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
        """The effect as a JSON-able record of the true values."""
        kind = KINDS[self.effect]
        return {"name": self.name, "size": self.size, "unit": kind.unit, "shape": dict(self.shape), "law": kind.about}

    def at(self, corner: str) -> bool:
        """Whether an effect of an axle or a corner acts at `corner`."""
        return self.where in (corner, "front" if corner[0] == "f" else "rear")


def suspension_law(effect: Hidden) -> SuspensionLaw | None:
    """Force [N] at a corner as a function of (s, ṡ); None when the effect is no such law."""
    p = effect.size
    match effect.effect:
        case "coulomb":
            v0 = effect.shape["v0"]
            return lambda s, v: p * math.tanh(v / v0)
        case "damper_asymmetry":
            return lambda s, v: p * abs(v)
        case "damper_digressive":
            return lambda s, v: p * v * abs(v)
        case "damper_knee":
            v0 = effect.shape["v0"]
            return lambda s, v: -p * math.copysign(max(0.0, abs(v) - v0), v)
        case "friction_of_load":
            v0 = effect.shape["v0"]
            return lambda s, v: p * max(0.0, s) * math.tanh(v / v0)
        case "damper_stroke":
            return lambda s, v: p * s * v
        case "damper_groove":
            length = effect.shape["length"]
            if not length > 0.0:
                raise UsageError(f"{effect.name}: length must be above 0, found {length:g}")
            return lambda s, v: p * v * min(1.0, abs(s) / length)
        case "spring_quadratic":
            return lambda s, v: p * s * s
        case "spring_cubic":
            return lambda s, v: p * s * s * s
        case "bump_stop":
            gap = effect.shape["gap"]
            return lambda s, v: p * max(0.0, s - gap)
        case "bump_stop_quadratic":
            gap = effect.shape["gap"]
            return lambda s, v: p * max(0.0, s - gap) ** 2
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


def total_of(effects: Iterable[Hidden], name: str) -> float:
    """Sum of the sizes of one effect, its full name given."""
    return sum(effect.size for effect in effects if effect.name == name)


def one_of(effects: Sequence[Hidden], name: str) -> Hidden | None:
    """The effect of a kind that a car can have once; None when it is absent. Raises UsageError when there are two."""
    found = [effect for effect in effects if effect.effect == name]
    if len(found) > 1:
        raise UsageError(f"{name} is given {len(found)} times: a car has one")
    return found[0] if found else None
