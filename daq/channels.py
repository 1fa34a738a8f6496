"""Vocabulary of measured channels: name, components, unit, axes, rate and design noise.

Drivers produce these channels, logs store them, models read them. SI units and radians throughout. Source: the channel
table in ``docs/channels.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

CORNERS = ("fl", "fr", "rl", "rr")
"""Front left, front right, rear left, rear right."""


def other_corner(corner: str) -> str:
    """The axle's other corner: ``fr`` of ``fl``."""
    return corner[0] + ("r" if corner[1] == "l" else "l")


@dataclass(frozen=True)
class Channel:
    """One measured quantity.

    Attributes
    ----------
    name : e.g. ``wheel.fl.force``.
    family : the name without its corner, e.g. ``wheel.force``; the key of noise and tolerance sheets.
    components : component names, ``()`` for a scalar.
    unit : SI unit of every component.
    axes : axes the components are given in unless the rig file says otherwise.
    rate : nominal rate [Hz].
    noise : 1 σ of white noise at that rate, in `unit`, as a design value.
    about : description in one line.
    optional : whether a run is complete without it: it is not among the paper's instruments.
    recorded_only : whether no equation uses it: it is kept with the run, shown and exported, and nothing more.
    """

    name: str
    family: str
    components: tuple[str, ...]
    unit: str
    axes: str
    rate: float
    noise: float
    about: str
    optional: bool = False
    recorded_only: bool = False

    @cached_property
    def width(self) -> int:
        """Number of components (1 for a scalar)."""
        return max(1, len(self.components))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the exchange-table columns, ``channel.component`` or just ``channel``."""
        return tuple(f"{self.name}.{c}" for c in self.components) or (self.name,)

    @property
    def corner(self) -> str | None:
        """The corner of this channel, or None."""
        part = self.name.split(".")[1]
        return part if part in CORNERS else None


XYZ = ("x", "y", "z")
_TABLE = (
    # family, components, unit, axes, rate, noise, about
    ("wheel.{c}.force", XYZ, "N", "carrier", 500.0, 30.0, "wheel load"),
    ("wheel.{c}.moment", XYZ, "N·m", "carrier", 500.0, 8.0, "wheel moment about the wheel centre"),
    ("wheel.{c}.angle", (), "rad", "carrier", 500.0, 0.002, "wheel angle about carrier y"),
    ("wheel.{c}.speed", (), "rad/s", "carrier", 500.0, 0.01, "wheel speed about carrier y, rolling forward positive"),
    ("imu.accel", XYZ, "m/s²", "sensor", 200.0, 0.05, "specific force, +g upwards at rest"),
    ("imu.rate", XYZ, "rad/s", "sensor", 200.0, 0.002, "angular rate"),
    ("imu.attitude", ("roll", "pitch", "yaw"), "rad", "sensor", 200.0, 0.0005, "attitude, sensor to ground"),
    ("laser.{c}.ground", (), "m", "body", 250.0, 0.0003, "height of the laser mount above the road, along body -z"),
    ("laser.{c}.hub", (), "m", "body", 250.0, 0.0003, "laser mount minus wheel centre, along body z"),
    ("camera.{c}.steer", (), "rad", "body", 100.0, 0.0003, "steer angle about body z, left positive"),
    ("camera.{c}.camber", (), "rad", "body", 100.0, 0.0003, "camber angle about x after steer"),
    ("correvit.speed", ("x", "y"), "m/s", "sensor", 250.0, 0.02, "velocity over the road at the sensor's mount"),
)
_OPTIONAL = (
    # Not among the paper's instruments: without them some seconds, or rows, of driven or braked wheels are left out.
    ("shaft.{c}.torque", (), "N·m", "carrier", 500.0, 5.0, "half-shaft torque on the wheel, driving forward positive"),
    ("brake.{c}.torque", (), "N·m", "carrier", 500.0, 10.0, "brake torque on the wheel, slowing forward roll positive"),
    ("brake.pressure", (), "Pa", "body", 100.0, 2e4, "brake line pressure above the air's, 0 when released"),
)
_RECORDED = (
    # Named by quantity, whatever instrument measures it. No equation needs them; some stand in for a channel that is
    # not there (identify.car.sources).
    ("suspension.{c}.travel", (), "m", "body", 250.0, 0.0003, "suspension travel, compression positive"),
    ("damper.{c}.travel", (), "m", "body", 250.0, 0.0002, "potentiometer on the damper, compression positive"),
    ("damper.{c}.force", (), "N", "body", 500.0, 20.0, "force in the damper, compression positive"),
    ("pushrod.{c}.force", (), "N", "body", 500.0, 20.0, "force in the pushrod, compression positive"),
    ("hub.{c}.load", (), "N", "carrier", 500.0, 30.0, "load of a one-axis cell in the hub, along the carrier"),
    ("scale.{c}.load", (), "N", "body", 10.0, 20.0, "load on a corner scale or a post, along the vertical"),
    ("hub.{c}.accel", XYZ, "m/s²", "carrier", 500.0, 0.5, "specific force at the wheel carrier"),
    ("steering.angle", (), "rad", "body", 100.0, 0.002, "angle of the steering wheel, left positive"),
    ("steering.torque", (), "N·m", "body", 100.0, 0.05, "torque on the steering wheel, left positive"),
    ("car.speed", (), "m/s", "body", 100.0, 0.05, "forward speed by the car's own bus"),
    ("car.lateral_accel", (), "m/s²", "body", 100.0, 0.1, "lateral acceleration alone, to the left positive"),
    ("car.longitudinal_accel", (), "m/s²", "body", 100.0, 0.1, "longitudinal acceleration alone, forward positive"),
    ("car.vertical_accel", (), "m/s²", "body", 100.0, 0.1, "vertical specific force alone, +g at rest"),
    ("car.roll_rate", (), "rad/s", "body", 100.0, 0.005, "roll rate alone"),
    ("car.pitch_rate", (), "rad/s", "body", 100.0, 0.005, "pitch rate alone, nose down positive"),
    ("car.yaw_rate", (), "rad/s", "body", 100.0, 0.005, "yaw rate alone, to the left positive"),
    ("gnss.speed", (), "m/s", "body", 20.0, 0.05, "speed over the ground by satellite"),
    ("gnss.course", (), "rad", "body", 20.0, 0.01, "course over the ground by satellite, from north to the east"),
    ("gnss.latitude", (), "rad", "body", 20.0, 1e-7, "geographic latitude"),
    ("gnss.longitude", (), "rad", "body", 20.0, 1e-7, "geographic longitude"),
    ("gnss.altitude", (), "m", "body", 20.0, 1.0, "altitude by satellite"),
    ("engine.speed", (), "rad/s", "body", 100.0, 1.0, "speed of the crankshaft"),
    ("engine.throttle", (), "-", "body", 100.0, 0.005, "opening of the throttle or of its pedal, 0 to 1"),
)

AXES = ("sensor", "body", "heading", "carrier", "tydex_c")
"""Axes that a rig file may declare."""
AXES_OF = {
    **dict.fromkeys(("wheel.force", "wheel.moment"), ("carrier", "tydex_c", "body", "sensor")),
    **dict.fromkeys(("imu.accel", "imu.rate", "imu.attitude"), ("sensor", "body")),
    "correvit.speed": ("sensor", "body", "heading"),
}
"""Family → axes that a rig file may declare for it; of the others the axes are fixed, whatever is declared."""


def _build() -> dict[str, Channel]:
    out: dict[str, Channel] = {}
    for row in (*_TABLE, *_OPTIONAL, *_RECORDED):
        pattern, components, unit, axes, rate, noise, about = row
        family = pattern.replace(".{c}", "")
        names = [pattern.format(c=c) for c in CORNERS] if "{c}" in pattern else [pattern]
        for name in names:
            out[name] = Channel(
                name, family, components, unit, axes, rate, noise, about, row not in _TABLE, row in _RECORDED
            )
    return out


CHANNELS: dict[str, Channel] = _build()
"""Every channel by name."""

MAY_REST = frozenset({
    "brake.pressure", "brake.torque", "engine.speed", "engine.throttle", "gnss.altitude", "gnss.course",
    "gnss.latitude", "gnss.longitude", "gnss.speed", "scale.load", "shaft.torque", "steering.torque",
})  # fmt: skip
"""Families that may have one value for a while in a moving car: nobody brakes, or a receiver holds what it has."""

STANDARD: tuple[str, ...] = tuple(name for name, channel in CHANNELS.items() if not channel.optional)
"""Names of the channels that the paper's instruments measure."""

FAMILIES: tuple[str, ...] = tuple(dict.fromkeys(c.family for c in CHANNELS.values() if not c.recorded_only))
"""Every family name that equations use, in table order."""

IN_EQUATIONS: tuple[str, ...] = tuple(name for name, channel in CHANNELS.items() if not channel.recorded_only)
"""Names of the channels that equations use."""

COLUMNS: dict[str, tuple[Channel, int]] = {
    column: (channel, index) for channel in CHANNELS.values() for index, column in enumerate(channel.columns)
}
"""Exchange-table column name → its channel and component index."""
