"""What is hidden: one row an effect, a pair, a kind of null or an unlisted cause."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from lacet.simulate import KINDS, Hidden

SEEDS = 20
BANDS: dict[str, tuple[float, float, float]] = {
    "just": (8.0, 12.0, 10.0),
    "ordinary": (12.0, 40.0, 22.0),
    "large": (40.0, float("inf"), 150.0),
}
"""Sizes by the oracle's √λ: from, to, and what is aimed at."""
TOLERANCES = 5.0
"""A fault of the instruments is one only when it is so many times what the sensor sheet allows."""
SIZES = Path(__file__).with_name("sizes.json")
UNSIZED = "no size yet: python -m benchmarks.blind --size"
UNLISTED_FAMILIES = ("engine_mount", "damper_mount", "chassis_torsion")
"""Left out of the candidates whenever the cause is to be unlisted."""


@dataclass(frozen=True)
class Campaign:
    """What is driven, alike for every case: runs used and held out, `duration` of each [s], car and rig."""

    used: tuple[str, ...] = ("sinus", "liftoff", "rough", "spiral")
    held: tuple[str, ...] = ("braking", "sweep")
    duration: float = 16.0
    car: str = "peugeot-406-measured"
    rig: str = "peugeot-406"


CAMPAIGN = Campaign()


@dataclass(frozen=True)
class Part:
    """One hidden effect as the simulator and as the catalogue have it.

    Attributes
    ----------
    hidden : the simulator's name; `shape` its constants.
    largest : largest size that is plausible on a car [its unit], with the sign it is hidden with; the smallest one
        where `inverse`.
    key : the catalogue's key; `constants` the true shape constants as the catalogue names them.
    inverse : the effect grows as the size falls (a stiffness that was taken for rigid).
    values : the catalogue's parameters per unit of the simulator's size, the first one scored; empty where the laws
        differ, so that there is no true value.
    """

    hidden: str
    largest: float
    key: str = ""
    shape: Mapping[str, float] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    values: tuple[float, ...] = (1.0,)
    inverse: bool = False

    @property
    def known(self) -> bool:
        """Whether this simulator has it."""
        return self.hidden.partition(".")[0] in KINDS

    def of_size(self, size: float) -> Hidden:
        """Hidden, that large."""
        return Hidden(self.hidden, size, shape=self.shape)


SINGLES: dict[str, Part] = {
    part.key: part
    for part in (
        Part("anti_roll_bar.front", 1e5, "anti_roll_bar.front"),
        Part("anti_roll_bar.rear", 1e5, "anti_roll_bar.rear"),
        Part("coulomb.front", 500.0, "coulomb.front", {"v0": 0.02}, {"v0": 0.02}),
        Part("coulomb.rl", 500.0, "coulomb.rl", {"v0": 0.015}, {"v0": 0.015}, ()),
        Part("damper_asymmetry.front", -4e3, "damper_asymmetry.front"),
        Part("damper_asymmetry.rr", -4e3, "damper_asymmetry.rr"),
        Part("damper_digressive.rear", -1e4, "damper_digressive.rear"),
        Part("damper_stroke.front", 5e4, "damper_stroke.front"),
        Part("damper_hysteresis.front", 1500.0, "damper_hysteresis.front", {"length": 0.003}, {"length": 0.003}),
        Part("spring_quadratic.rear", 1e6, "spring_quadratic.rear"),
        Part("spring_cubic.front", 3e7, "spring_cubic.front"),
        Part("bump_stop.front", 5e5, "bump_stop.front", {"gap": 0.018}, {"gap": 0.018}, ()),
        Part("rebound_stop.rear", 5e5, "rebound_stop.rear", {"gap": 0.015}, {"gap": 0.015}),
        Part("helper_spring.front", 2e5, "helper_spring.front", {"gap": 0.01}, {"gap": 0.01}),
        Part("anti_dive.front", 0.5, "anti_dive.front", values=()),
        Part("jacking.rear", 0.5, "jacking.rear", values=()),
        Part("tyre_damping.front", 2e3, "tyre_damping.front"),
        Part("tyre_progression.rear", 3e6, "tyre_progression.rear"),
        Part("aero_drag", 3.0, "aero_drag", {"height": 0.3}),
        Part("aero_lift.front", 3.0, "aero_lift.front"),
        Part("aero_side", 10.0, "aero_side", {"x": -1.2}, values=(1.0, 0.0, -1.2)),
        Part("sensor_latency.laser", 0.05, "sensor_latency.laser"),
        Part("sensor_latency.imu", 0.05, "sensor_latency.imu"),
        Part("sensor_gain.hub.fl", 0.2, "sensor_gain.hub.fl"),
        Part("sensor_gain.force.rr", 0.2, "sensor_gain.force.rr"),
        Part("sensor_misalignment.imu.pitch", 0.1, "sensor_misalignment.imu.pitch"),
        Part("sensor_position.imu.x", 0.5, "sensor_position.imu.x"),
        Part("laser_tilt.pitch", 0.2, "laser_tilt.pitch"),
        Part("sensor_crosstalk.wheel.force", 0.1, "sensor_crosstalk.all.zx", {"x": 1.0, "y": 0.0}),
    )
}
"""Effects hidden one at a time."""

PAIRS: tuple[tuple[str, str], ...] = (
    ("anti_roll_bar.front", "anti_roll_bar.rear"),
    ("anti_roll_bar.front", "coulomb.front"),
    ("aero_drag", "damper_asymmetry.front"),
    ("bump_stop.front", "tyre_progression.rear"),
    ("spring_cubic.front", "sensor_gain.hub.fl"),
    ("spring_quadratic.rear", "damper_asymmetry.rr"),
)
"""Effects hidden two at a time, each as large as alone."""

CAUSES: dict[str, Part] = {
    part.hidden: part
    for part in (
        Part("engine_mount", 300.0),
        Part("series_damper.front", 1e5),
        Part("trailer", 1500.0),
        Part("liquid_load", 800.0),
        Part("chassis_torsion", 5e4, inverse=True),
    )
}
"""Causes no candidate stands for: families of that name are taken out of the candidates."""
CAUSE_BANDS = ("ordinary", "large")


@dataclass(frozen=True)
class Null:
    """A drive in which nothing the catalogue can name is missing."""

    name: str
    kind: str
    seeds: int
    hidden: tuple[Hidden, ...] = ()
    noise: float = 1.0
    drift: bool = False
    road: int = 0


def _measured_already() -> Iterator[Null]:
    sizes = {"rolling_resistance": 0.01, "camber_thrust": 1.0, "steer_compliance": 5e-6}
    for kind, size in sizes.items():
        if kind in KINDS:
            for place in KINDS[kind].places[:2] or (None,):
                hidden = Hidden(kind, size, where=place)
                yield Null(f"measured.{hidden.name}", "already measured", 10, (hidden,))


NULLS: dict[str, Null] = {
    null.name: null
    for null in (
        *(Null(f"plain.{road}", "ordinary noise", 20, road=road) for road in range(5)),
        *(Null(f"loud.{road}", "noise twice the sheet", 20, noise=2.0, road=road) for road in range(5)),
        *(Null(f"drift.{road}", "offsets and drift", 20, drift=True, road=road) for road in range(3)),
        *_measured_already(),
    )
}
"""Nulls by name; `road` draws the roads, so that not all are one drive with other noise."""


@dataclass(frozen=True)
class Cell:
    """Trials that differ in their seed alone: what is hidden, how large, how noisy.

    `kind` is ``single``, ``pair``, ``null`` or ``unlisted``; `band` a size, or the kind of null; `parts` and `hidden`
    belong together; `root_lambda` the oracle's √λ of each part; `left_out` why it cannot be tried.
    """

    name: str
    kind: str
    band: str
    seeds: int
    parts: tuple[Part, ...] = ()
    hidden: tuple[Hidden, ...] = ()
    root_lambda: tuple[float, ...] = ()
    noise: float = 1.0
    drift: bool = False
    road: int = 0
    left_out: str = ""
    campaign: Campaign = CAMPAIGN

    @property
    def keys(self) -> tuple[str, ...]:
        """Catalogue keys of what is hidden."""
        return tuple(part.key for part in self.parts if part.key)


@cache
def sizes() -> dict[str, dict[str, float | str]]:
    """What the oracle found, by ``case/band``: size, root_lambda, or the reason why there is none."""
    return json.loads(SIZES.read_text(encoding="utf-8")) if SIZES.is_file() else {}


def _cell(name: str, kind: str, band: str, parts: tuple[Part, ...]) -> Cell:
    found: list[tuple[Hidden, float]] = []
    for part in parts:
        entry = sizes().get(
            f"{part.key or part.hidden}/{band}", {"why": "no size yet: python -m benchmarks.blind --size"}
        )
        if not part.known:
            entry = {"why": f"the simulator has no {part.hidden}"}
        if "size" not in entry:
            return Cell(f"{name}/{band}", kind, band, SEEDS, parts, left_out=str(entry["why"]))
        found.append((part.of_size(float(entry["size"])), float(entry["root_lambda"])))
    return Cell(
        f"{name}/{band}", kind, band, SEEDS, parts, tuple(h for h, _ in found), tuple(root for _, root in found)
    )


def cells() -> dict[str, Cell]:
    """Every cell by name."""
    out = [_cell(key, "single", band, (part,)) for band in BANDS for key, part in SINGLES.items()]
    out += [_cell(f"{a}+{b}", "pair", band, (SINGLES[a], SINGLES[b])) for band in BANDS for a, b in PAIRS]
    out += [_cell(name, "unlisted", band, (part,)) for band in CAUSE_BANDS for name, part in CAUSES.items()]
    out += [
        Cell(f"null/{null.name}", "null", null.kind, null.seeds, (), null.hidden, (), null.noise, null.drift, null.road)
        for null in NULLS.values()
    ]
    return {cell.name: cell for cell in out}
