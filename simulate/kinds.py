"""Kinds of hidden effects: law, unit, places, shape constants with their defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from lacet.daq.channels import COLUMNS as ALL_COLUMNS
from lacet.daq.channels import CORNERS, FAMILIES
from lacet.daq.channels import IN_EQUATIONS as CHANNELS

COLUMNS = tuple(column for column, (channel, _) in ALL_COLUMNS.items() if not channel.recorded_only)
"""Columns that the simulated sensors deliver."""
AXLES = ("front", "rear")
ANYWHERE = (*AXLES, *CORNERS)


@dataclass(frozen=True)
class Kind:
    """One kind of hidden effect: `unit` of its size, its possible places, its shape constants with defaults."""

    about: str
    unit: str
    places: tuple[str, ...] = AXLES
    shape: Mapping[str, float] = field(default_factory=dict)


_SENSORS_BY_PART = ("wheel", "imu", "laser", "camera", "correvit")

SHORT = {f"{what}.{c}": f"{part}.{c}.{what}" for c in CORNERS for part, what in (("wheel", "force"), ("laser", "hub"))}
"""Short names of the catalogue for single channels: ``force.fl``, ``hub.rr``."""

KINDS: dict[str, Kind] = {
    # suspension, per axle (size × law at both corners) or, except the bar, at one corner
    "anti_roll_bar": Kind("size·(s - s of the other side)", "N/m"),
    "coulomb": Kind("size·tanh(ṡ/v0)", "N", ANYWHERE, {"v0": 0.01}),
    "damper_asymmetry": Kind("size·|ṡ|: stiffer in bump than in rebound", "N·s/m", ANYWHERE),
    "damper_digressive": Kind("size·ṡ·|ṡ| (negative: digressive)", "N·s²/m²", ANYWHERE),
    "damper_knee": Kind(
        "-size·sign(ṡ)·max(0, |ṡ| - v0): softer by size beyond a knee (digressive)", "N·s/m", ANYWHERE, {"v0": 0.05}
    ),
    "damper_stroke": Kind("size·s·ṡ", "N·s/m²", ANYWHERE),
    "friction_of_load": Kind(
        "size·max(0, s)·tanh(ṡ/v0): friction that grows with the compression, as between the leaves of a spring",
        "N/m",
        ANYWHERE,
        {"v0": 0.01},
    ),
    "damper_groove": Kind(
        "size·ṡ·min(1, |s|/length): a by-pass groove takes that damping away in the middle of the stroke",
        "N·s/m",
        ANYWHERE,
        {"length": 0.02},
    ),
    "spring_quadratic": Kind("size·s²", "N/m²", ANYWHERE),
    "spring_cubic": Kind("size·s³", "N/m³", ANYWHERE),
    "bump_stop": Kind("size·max(0, s - gap)", "N/m", ANYWHERE, {"gap": 0.03}),
    "bump_stop_quadratic": Kind(
        "size·max(0, s - gap)²: rubber that stiffens as it is pressed", "N/m²", ANYWHERE, {"gap": 0.015}
    ),
    "rebound_stop": Kind("-size·max(0, -s - gap)", "N/m", ANYWHERE, {"gap": 0.03}),
    "helper_spring": Kind("size·min(s, gap): works up to the gap, then is solid", "N/m", ANYWHERE, {"gap": 0.01}),
    # suspension kinematics, per axle
    "anti_dive": Kind("wheel centre moves forward by size·s", "-"),
    "jacking": Kind("wheel centre moves outward by size·s", "-"),
    # suspension, between the axles
    "interconnection": Kind("size·(s - s of the other end of that side) at every wheel", "N/m", ()),
    # tyres, per axle
    "tyre_damping": Kind("size·dδ/dt along the road normal", "N·s/m"),
    "tyre_progression": Kind("size·δ² along the road normal", "N/m²"),
    "rolling_resistance": Kind("added to the rolling resistance coefficient (measured: no model lacks it)", "-"),
    "camber_thrust": Kind("lateral force size·Fz·camber (measured: no model lacks it)", "-"),
    # body
    "aero_drag": Kind("size·vx·|vx| to the rear at `height` above the road", "N·s²/m²", (), {"height": 0.0}),
    "aero_side": Kind(
        "side force -size·vx·vy of the body origin, acting `x` ahead of it: the yaw moment is x times it",
        "N·s²/m²",
        (),
        {"x": 0.0},
    ),
    "aero_lift": Kind("size·vx² upwards on the body at the axle's middle", "N·s²/m²"),
    "payload": Kind("point mass fixed to the body at x, y, z", "kg", (), {"x": -2.2, "y": 0.0, "z": 0.3}),
    # the road
    "slope": Kind(
        "road rises by size: ahead (grade) or to the left (bank); the inertial unit measures it: no model lacks it",
        "rad",
        ("grade", "bank"),
    ),
    # suspension with memory: a state of its own at each corner
    "damper_hysteresis": Kind(
        "friction size·z that turns round over a stroke: dz/dt = (ṡ - |ṡ|·z)/length (Dahl)",
        "N",
        ANYWHERE,
        {"length": 0.003},
    ),
    "series_damper": Kind(
        "a damper c on a spring of stiffness size beside the others: size·(s - x), c·dx/dt = size·(s - x) (Maxwell)",
        "N/m",
        ANYWHERE,
        {"c": 1500.0},
    ),
    # wheels that rotate more than in the base model
    "toe_change": Kind("wheel toes in by size·s; what the tyre does on the turn is felt by the spring", "rad/m"),
    "camber_change": Kind("top of the wheel leans outward by size·s; felt by the spring likewise", "rad/m"),
    "pitch_change": Kind(
        "carrier pitches nose down by size·s; what its brake does on the turn is felt likewise", "rad/m"
    ),
    "steer_compliance": Kind(
        "carrier steered by size × the lateral force on it (seen by the cameras: no model lacks it)", "rad/N"
    ),
    # further bodies
    "engine_mount": Kind(
        "mass separated from the chassis at x, y, z, on a vertical spring and damper (frequency [Hz], damping ratio)",
        "kg",
        (),
        {"x": 0.1, "y": 0.0, "z": 0.25, "frequency": 9.0, "damping": 0.08},
    ),
    "liquid_load": Kind(
        "mass on top of the car that swings all ways: a pendulum of `length` below x, y, z with a damping ratio",
        "kg",
        (),
        {"x": -2.4, "y": 0.0, "z": 0.5, "length": 0.25, "damping": 0.05},
    ),
    "trailer": Kind(
        "trailer of that mass on a ball hitch at x, z, its axle `length` behind it and its centre of mass `ahead` of "
        "the axle; side force of its tyres lags by `relaxation` [m]; vertical `frequency` [Hz], damping ratio",
        "kg",
        (),
        {
            "x": -3.7,
            "z": 0.05,
            "length": 2.5,
            "ahead": 0.1,
            "track": 1.4,
            "cornering": 12.0,
            "relaxation": 0.5,
            "frequency": 2.5,
            "damping": 0.25,
        },
    ),
    "chassis_torsion": Kind(
        "rear half of the body turns against the front one about the x axis at height z, on a spring of stiffness size",
        "N·m/rad",
        (),
        {"z": 0.2, "rear": 0.45, "damping": 0.05},
    ),
    # sensors
    "sensor_latency": Kind("delay on top of the rig's", "s", (*_SENSORS_BY_PART, *FAMILIES)),
    "sensor_gain": Kind("values × (1 + size)", "-", (*_SENSORS_BY_PART, *SHORT, *FAMILIES, *CHANNELS, *COLUMNS)),
    "sensor_zero": Kind("values + size", "SI", (*COLUMNS,)),
    "sensor_drift": Kind("values + size·t/60 s", "SI per minute", (*FAMILIES, *CHANNELS, *COLUMNS)),
    "sensor_misalignment": Kind(
        "sensor turned by size about a body axis", "rad", ("imu.roll", "imu.pitch", "imu.yaw", "correvit.yaw")
    ),
    "sensor_position": Kind(
        "mounted size from where the rig says, along a body axis", "m", ("imu.x", "imu.y", "imu.z")
    ),
    "sensor_crosstalk": Kind(
        "force.x + x·size·force.z, force.y + y·size·force.z, force.z + size·(zx·force.x + zy·force.y)",
        "-",
        ("wheel.force", *CORNERS),
        {"x": 1.0, "y": 1.0, "zx": 0.0, "zy": 0.0},
    ),
    "laser_tilt": Kind(
        "all ground-laser beams turned by size about body y (pitch: lower end to the rear) or x (roll: to the left)",
        "rad",
        ("pitch", "roll"),
    ),
}
"""Every kind of hidden effect by name."""


def known_names() -> list[str]:
    """Every full name, without the longest lists (single corners, channels and columns)."""
    out = []
    for name, kind in KINDS.items():
        places = [p for p in kind.places if p not in (*CORNERS, *CHANNELS, *COLUMNS)] or list(kind.places[:1])
        out += [f"{name}.{place}" for place in places] if kind.places else [name]
    return out


def listed() -> str:
    """Every kind with its places, unit, law and constants, as text for users."""
    lines = []
    for name, kind in KINDS.items():
        places = [p for p in kind.places if p in FAMILIES or p not in (*CHANNELS, *COLUMNS, *CORNERS, *SHORT)]
        also = (("corner", CORNERS), ("channel", CHANNELS), ("column", COLUMNS))
        places += [f"any {word}" for word, group in also if set(group) <= set(kind.places)]
        lines.append(f"{name}  [{kind.unit}]" + (f"  at {', '.join(places)}" if places else ""))
        lines.append(f"    {kind.about}")
        if kind.shape:
            lines.append("    constants: " + ", ".join(f"{key}={value:g}" for key, value in kind.shape.items()))
    return "\n".join(lines)
