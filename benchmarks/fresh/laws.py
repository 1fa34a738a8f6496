"""What is hidden: laws of the simulated car with their usual sizes, and the names that the catalogue may give them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.simulate import Hidden

AXLES = ("front", "rear")
COUNTS: dict[str, tuple[int, int]] = {
    "none": (0, 0), "single": (1, 1), "pair": (2, 2), "three": (3, 3), "four": (4, 4), "six": (6, 6), "eight": (8, 8),
    "unlisted": (0, 0), "listed+unlisted": (3, 5),
}  # fmt: skip
"""Class of trial → least and largest number of listed effects."""
CLASSES = tuple(COUNTS)
BOTH = 0.75
"""Chance that an effect acts at both axles, where it can."""
STOPS = ("bump_stop", "helper_spring")
"""Families that are a spring engaging at a gap, or, with the opposite sign, one that goes solid there."""


@dataclass(frozen=True)
class Law:
    """A law that can be hidden.

    Attributes
    ----------
    name : what it is called here; `kind` the simulator's name; `group` : a car has one law of a group.
    usual : sizes found on cars [the kind's unit], with the sign it is hidden with; `largest` that is plausible.
    places : where it can act; empty for one that acts on the whole car.
    shape : constants, each drawn from a range.
    families : families of the catalogue that are this law; none for an unlisted one.
    values : family → parameter → its true value per unit of size, where the laws are equal; the first family is the
        law itself, with `constants` and those of `shape`.
    """

    name: str
    kind: str
    group: str
    usual: tuple[float, float]
    largest: float
    places: tuple[str, ...] = AXLES
    shape: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    families: tuple[str, ...] = ()
    values: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)


LAWS: tuple[Law, ...] = (
    Law("anti-roll bar", "anti_roll_bar", "bar", (5e3, 2e4), 3e4, families=("anti_roll_bar",),
        values={"anti_roll_bar": {"k": 1.0}}),
    Law("friction", "coulomb", "friction", (20.0, 80.0), 150.0, shape={"v0": (0.004, 0.02)}, families=("coulomb",),
        values={"coulomb": {"f": 1.0}}),
    Law("bump stop", "bump_stop", "stop", (1e4, 5e4), 1e5, shape={"gap": (0.008, 0.018)}, families=STOPS,
        values={"bump_stop": {"k": 1.0}}, constants={"n": 1.0}),
    Law("quadratic bump stop", "bump_stop_quadratic", "stop", (1e6, 4e6), 6e6, shape={"gap": (0.008, 0.018)},
        families=STOPS, values={"bump_stop": {"k": 0.01}}, constants={"n": 2.0}),
    Law("second spring", "bump_stop", "stop", (5e3, 1.5e4), 2e4, shape={"gap": (0.003, 0.007)}, families=STOPS,
        values={"bump_stop": {"k": 1.0}}, constants={"n": 1.0}),
    Law("asymmetric damper", "damper_asymmetry", "damper", (-300.0, -1000.0), -1500.0, families=("damper_asymmetry",),
        values={"damper_asymmetry": {"a": 1.0}}),
    Law("digressive damper", "damper_digressive", "damper", (-1500.0, -4000.0), -5000.0,
        families=("damper_digressive",), values={"damper_digressive": {"c2": 1.0}}),
    Law("damper with a knee", "damper_knee", "damper", (800.0, 1700.0), 2000.0, shape={"v0": (0.03, 0.08)},
        families=("damper_knee", "damper_digressive", "damper_saturation"),
        values={"damper_knee": {"d": -1.0}}),
    Law("aerodynamic drag", "aero_drag", "drag", (0.3, 0.9), 3.0, (), {"height": (0.2, 0.6)}, ("aero_drag",),
        {"aero_drag": {"d": 1.0}}),
    Law("aerodynamic lift", "aero_lift", "lift", (0.15, 0.6), 2.0, families=("aero_lift",),
        values={"aero_lift": {"l": 1.0}}),
    Law("tyre damping", "tyre_damping", "tyre damping", (300.0, 1200.0), 2000.0, families=("tyre_damping",),
        values={"tyre_damping": {"c": 1.0}}),
    Law("tyre progression", "tyre_progression", "tyre progression", (5e5, 2e6), 3e6, families=("tyre_progression",),
        values={"tyre_progression": {"k2": 1.0}}),
    Law("cubic spring", "spring_cubic", "spring", (1e6, 6e6), 1.5e7, families=("spring_cubic",),
        values={"spring_cubic": {"k3": 1.0}}),
    Law("quadratic spring", "spring_quadratic", "spring", (2e4, 1e5), 3e5, families=("spring_quadratic",),
        values={"spring_quadratic": {"k2": 1.0}}),
)  # fmt: skip
"""Listed mechanical effects."""

UNLISTED: tuple[Law, ...] = (
    Law("friction of the load", "friction_of_load", "unlisted", (2e3, 8e3), 1.2e4, shape={"v0": (0.005, 0.02)}),
    Law("interconnection", "interconnection", "unlisted", (1e3, 6e3), 1e4, ()),
    Law("damper with a by-pass groove", "damper_groove", "unlisted", (1500.0, 4e3), 5e3,
        shape={"length": (0.008, 0.02)}),
    Law("sloshing load", "liquid_load", "unlisted", (60.0, 200.0), 300.0, (), {"length": (0.15, 0.35)}),
    Law("trailer", "trailer", "unlisted", (150.0, 600.0), 800.0, (), {"length": (2.0, 3.0)}),
)  # fmt: skip
"""Laws that no family of the catalogue is."""

TOLERANCES = (14.0, 25.0)
"""Size of an instrument's fault, in tolerances of the sensor sheet: below, some are not testable (√λ 12) beside it."""
FAULTS: tuple[tuple[str, str, str, str], ...] = (
    *((f"sensor_gain.hub.{c}", f"laser.{c}.hub", "gain", "g") for c in CORNERS),
    *((f"sensor_gain.force.{c}", f"wheel.{c}.force", "gain", "g") for c in CORNERS),
    ("sensor_latency.laser", "laser.fl.hub", "latency", "tau"),
    ("sensor_latency.imu", "imu.accel", "latency", "tau"),
    ("sensor_misalignment.imu.pitch", "imu.accel", "misalignment", "angle"),
    ("sensor_position.imu.x", "imu.accel", "position", "p"),
)
"""Faults of an instrument: name, the same in the catalogue; channel and entry of the sheet; the catalogue's parameter.
One at most is hidden."""


@dataclass(frozen=True)
class Part:
    """A law at one place: what is looked for by name.

    `hidden` is of size ±1 until it is sized; `usual` the size drawn from the usual ones, `goal` the √λ drawn;
    `tolerance` : what the sensor sheet adds to a fault of an instrument, 1 σ.
    """

    law: Law
    hidden: Hidden
    usual: float
    goal: float
    tolerance: float = 0.0

    @property
    def listed(self) -> bool:
        """Whether the catalogue has a family for it."""
        return bool(self.law.families)

    def of_size(self, size: float) -> Part:
        """The same, that large."""
        return replace(self, hidden=Hidden(self.hidden.name, float(f"{size:.6g}"), shape=self.hidden.shape))

    def truth(self, root: float) -> dict[str, Any]:
        """What is hidden, and what it may be called, as plain data; `root` its √λ."""
        return {
            "law": self.law.name,
            "name": self.hidden.name,
            "size": self.hidden.size,
            "shape": {**self.hidden.shape, **self.law.constants},
            "root_lambda": None if math.isnan(root) else root,
            "families": list(self.law.families),
            "values": {family: dict(values) for family, values in self.law.values.items()},
            "tolerance": self.tolerance,
        }


GOALS = (17.0, 60.0)
"""√λ aimed at."""


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A draw between two numbers of the same sign, uniform in the logarithm."""
    return float(np.sign(low) * np.exp(rng.uniform(np.log(abs(low)), np.log(abs(high)))))


def parts_of(law: Law, rng: np.random.Generator) -> list[Part]:
    """A law at both axles or one, a size of its own at each; constants are those of the parts' make, the same at both.

    What acts on the whole car is one part.
    """
    shape = {name: float(f"{rng.uniform(*bounds):.4g}") for name, bounds in law.shape.items()}
    both, one = rng.random() < BOTH, int(rng.integers(2))
    places = law.places if both or not law.places else (law.places[one],)
    out: list[Part] = []
    for name in [f"{law.kind}.{place}" for place in places] or [law.kind]:
        usual, goal = log_uniform(rng, *law.usual), log_uniform(rng, *GOALS)
        unit = Hidden(name, float(np.sign(usual)), shape=shape)
        out.append(Part(law, unit, usual, goal))
    return out


def fault_of(rng: np.random.Generator, tolerance: Mapping[str, float]) -> Part:
    """A fault of an instrument; `tolerance` : name → what the sheet allows [the fault's unit]."""
    name, _, entry, parameter = FAULTS[int(rng.integers(len(FAULTS)))]
    size = float(rng.choice((-1.0, 1.0))) * log_uniform(rng, *TOLERANCES) * tolerance[name]
    law = Law("instrument", name, "instrument", (size, size), size, (), {}, (name,), {name: {parameter: 1.0}})
    drawn = entry in ("gain", "latency")
    return Part(law, Hidden(name, float(f"{size:.6g}")), size, 0.0, tolerance[name] if drawn else 0.0)


def drawn_parts(
    kind: str, rng: np.random.Generator, tolerance: Mapping[str, float], laws: Sequence[Law] = LAWS
) -> list[Part]:
    """What a trial of a class hides of some laws, not sized yet."""
    low, high = COUNTS[kind]
    count = int(rng.integers(low, high + 1))
    groups = [*dict.fromkeys(law.group for law in laws), "instrument"]
    chosen = [groups[int(i)] for i in rng.permutation(len(groups))[:count]]
    out: list[Part] = []
    for group in chosen:
        if group == "instrument":
            out.append(fault_of(rng, tolerance))
        else:
            out += parts_of(_one_of([law for law in laws if law.group == group], rng), rng)
    if "unlisted" in kind:
        out += parts_of(_one_of(UNLISTED, rng), rng)
    return out


def _one_of(laws: Sequence[Law], rng: np.random.Generator) -> Law:
    return laws[int(rng.integers(len(laws)))]
