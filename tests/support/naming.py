"""Logs of the reference car under many names, units and signs, for judging proposed maps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.run import Run
from lacet.daq.sources.shares import SharedSource, Stored
from lacet.daq.sources.source import Listed
from lacet.daq.units import read_unit

Scheme = dict[str, str]
"""Family and component → pattern of a name, with ``{c}`` for the corner in the scheme's words."""

_CORNERS = {
    "en": {"fl": "FL", "fr": "FR", "rl": "RL", "rr": "RR"}, "lf": {"fl": "LF", "fr": "RF", "rl": "LR", "rr": "RR"},
    "de": {"fl": "VL", "fr": "VR", "rl": "HL", "rr": "HR"},
    "fr": {"fl": "AVG", "fr": "AVD", "rl": "ARG", "rr": "ARD"},
    "long": {"fl": "FrontLeft", "fr": "FrontRight", "rl": "RearLeft", "rr": "RearRight"},
}  # fmt: skip
MADE_WITH: dict[str, tuple[str, Scheme]] = {
    "short English": ("en", {
        "wheel.force": "F{a}_{c}", "wheel.moment": "M{a}_{c}", "wheel.speed": "n_{c}", "laser.ground": "Hgnd_{c}",
        "suspension.travel": "DamperPot_{c}", "camera.steer": "delta_{c}", "camera.camber": "gamma_{c}",
        "imu.accel": "Acc{A}", "imu.rate": "Gyro{A}", "imu.attitude": "{a}", "correvit.speed": "V{a}",
    }),
    "German": ("de", {
        "wheel.force": "Kraft_{a}_{c}", "wheel.moment": "Moment_{a}_{c}", "wheel.speed": "Raddrehzahl_{c}",
        "laser.ground": "Bodenabstand_{c}", "suspension.travel": "Federweg_{c}", "camera.steer": "Radlenkwinkel_{c}",
        "camera.camber": "Sturz_{c}", "imu.accel": "{längs}beschleunigung", "imu.rate": "{gier}rate",
        "imu.attitude": "{gier}winkel", "correvit.speed": "V{a}",
    }),
    "long English": ("long", {
        "wheel.force": "Wheel.{c}.Force{A}", "wheel.moment": "Wheel.{c}.Moment{A}",
        "wheel.speed": "Wheel.{c}.RotationSpeed", "laser.ground": "Laser.{c}.GroundDistance",
        "suspension.travel": "Suspension.{c}.Travel", "camera.steer": "Camera.{c}.SteerAngle",
        "camera.camber": "Camera.{c}.CamberAngle", "imu.accel": "IMU.LinearAcceleration.{A}",
        "imu.rate": "IMU.AngularVelocity.{A}", "imu.attitude": "IMU.Orientation.{Yaw}",
        "correvit.speed": "Correvit.Velocity.{A}",
    }),
}  # fmt: skip
"""Schemes that the words were collected with."""
JUDGED: dict[str, tuple[str, Scheme]] = {
    "French": ("fr", {
        "wheel.force": "Effort_{a}_{c}", "wheel.moment": "Couple_{a}_{c}", "wheel.speed": "VitesseRoue_{c}",
        "laser.ground": "GardeSol_{c}", "suspension.travel": "Debattement_{c}", "camera.steer": "Braquage_{c}",
        "camera.camber": "Carrossage_{c}", "imu.accel": "Acceleration_{long}", "imu.rate": "Vitesse_{lacet}",
        "imu.attitude": "{lacet}", "correvit.speed": "Vitesse_{a}",
    }),
    "motorsport": ("lf", {
        "wheel.force": "WFT {c} F{a}", "wheel.moment": "WFT {c} M{a}", "wheel.speed": "{c} Wheel Speed",
        "laser.ground": "{c} Ride Height", "suspension.travel": "{c} Shock Pot", "camera.steer": "{c} Toe Angle",
        "camera.camber": "{c} Camber", "imu.accel": "G {Long}", "imu.rate": "{Yaw} Rate", "imu.attitude": "{Yaw} Angle",
        "correvit.speed": "Optical V{a}",
    }),
    "bus": ("en", {
        "wheel.force": "WhlFrc{A}{c}", "wheel.moment": "WhlMom{A}{c}", "wheel.speed": "WhlSpd{c}",
        "laser.ground": "RideHgt{c}", "suspension.travel": "SuspTrvl{c}", "camera.steer": "RoadWhlAng{c}",
        "camera.camber": "Cmbr{c}", "imu.accel": "{Long}Accel", "imu.rate": "Veh{Yaw}Rate",
        "imu.attitude": "Veh{Yaw}Ang",
        "correvit.speed": "VehVel{A}",
    }),
}  # fmt: skip
"""Schemes that nothing was changed for: what proposals are judged by."""
_WORDS = {
    "long": ("Longitudinale", "Laterale", "Verticale"), "Long": ("Long", "Lat", "Vert"),
    "längs": ("Längs", "Quer", "Hoch"), "gier": ("Wank", "Nick", "Gier"), "lacet": ("Roulis", "Tangage", "Lacet"),
    "Yaw": ("Roll", "Pitch", "Yaw"),
}  # fmt: skip
_UNITS = {
    "N": ("N", "kN", "daN"), "N·m": ("N*m", "Nm"), "m/s²": ("m/s**2", "g"), "m": ("mm", "m"), "rad": ("deg", "rad"),
    "rad/s": ("deg/s", "rad/s"), "m/s": ("km/h", "m/s"),
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """What a name is: its column, and value in SI = sign · factor · recorded."""

    column: str
    sign: int
    factor: float


def named_log(run: Run, scheme: tuple[str, Scheme], seed: int) -> tuple[SharedSource, dict[str, Truth]]:
    """A log in memory under a scheme: signs turned, units drawn or left away; and what each name is."""
    corners, patterns = _CORNERS[scheme[0]], scheme[1]
    rng = np.random.default_rng(seed)
    source, truth = SharedSource(Path("drawn.mat")), dict[str, Truth]()
    for name, signal in run.signals.items():
        channel = CHANNELS[name]
        family = "suspension.travel" if channel.family == "laser.hub" else channel.family
        if family not in patterns:
            continue
        mirrored = rng.random() < 0.3
        for k, column in enumerate(channel.columns):
            axis = channel.components[k] if channel.components else ""
            words = {key: of[k] for key, of in _WORDS.items() if channel.components and k < len(of)}
            own = patterns[family].format(a=axis, A=axis.upper(), c=corners.get(channel.corner or "", ""), **words)
            values = 0.3 - signal.values[:, k] if family == "suspension.travel" else signal.values[:, k]
            target = (
                column.replace("laser", "suspension").replace("hub", "travel")
                if channel.family == "laser.hub"
                else column
            )
            choices = ("1/min", "rad/s") if family == "wheel.speed" else _UNITS[channel.unit]
            unit = str(rng.choice(choices))
            sign = -1 if mirrored or rng.random() < 0.15 else 1
            factor = read_unit(unit).factor
            written = "" if rng.random() < 0.25 else unit
            source.add(Listed(own, written, len(signal.t)), Stored.of(sign * values / factor), "t", Stored.of(signal.t))
            truth[own] = Truth(target, sign, factor)
    return source, truth
