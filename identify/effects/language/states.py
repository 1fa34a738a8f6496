"""States that a one-line effect may use: measured motion and loads, each with its unit and usual range.

A wheel's state (``travel``) is that of the wheel whose row the law is in. ``travel_other`` is that of the other side of
the axle, ``travel_fl`` that of a wheel by name; a law in a chassis row has wheels by name only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.dimension import FORCE, LENGTH, NUMBER, TIME, Dimension
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import Row, needs
from lacet.identify.multibody.vectors import Array, dot

ACROSS = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
"""Corner → the other corner of its axle."""
_SPEED, _ACCEL, _TURN, _TORQUE = LENGTH / TIME, LENGTH / TIME**2, TIME**-1, FORCE * LENGTH


@dataclass(frozen=True)
class State:
    """A measured quantity that a one-line effect may use.

    `low` and `high` bound its usual range on a lively drive of a passenger car [SI], from which the plausible size of a
    user's parameters follows. `wheel` or `body` extracts it from the motion, (N,). `channels` are those it needs,
    ``{c}`` for the wheel; `tyre` : whether it also needs the channels of the wheel's tyre row.
    """

    name: str
    dimension: Dimension
    about: str
    low: float
    high: float
    wheel: Callable[[CornerMotion], Array] | None = None
    body: Callable[[Motion], Array] | None = None
    channels: tuple[str, ...] = ()
    tyre: bool = False

    @property
    def unit(self) -> str:
        """SI unit; angles in rad."""
        return _UNIT.get(self.name, self.dimension.unit)


_UNIT = {
    **dict.fromkeys(("steer", "camber", "roll", "pitch"), "rad"),
    **dict.fromkeys(("spin", "roll_rate", "pitch_rate", "yaw_rate"), "rad/s"),
    **dict.fromkeys(("roll_accel", "pitch_accel", "yaw_accel"), "rad/s²"),
    **dict.fromkeys(("mx", "my", "mz"), "N·m"),
}  # fmt: skip

_HUB, _CAMERAS = ("laser.{c}.hub",), ("camera.{c}.steer", "camera.{c}.camber")
_LOADS, _MOMENTS, _IMU = ("wheel.{c}.force", *_CAMERAS), ("wheel.{c}.moment", *_CAMERAS), ("imu.accel", "imu.rate")


def _velocity(motion: Motion, axis: int) -> Array:
    assert motion.velocity is not None
    return motion.velocity[axis]


def _attitude(motion: Motion, axis: int) -> Array:
    assert motion.attitude is not None
    return motion.attitude[axis]


_ALL = (
    State("travel", LENGTH, "suspension travel from design height, compression positive", -0.04, 0.04,
          wheel=lambda c: c.travel, channels=_HUB),
    State("rate", _SPEED, "its rate, compression positive", -0.3, 0.3, wheel=lambda c: c.rate, channels=_HUB),
    State("accel", _ACCEL, "its second derivative", -20.0, 20.0, wheel=lambda c: c.accel, channels=_HUB),
    State("deflection", LENGTH, "tyre deflection, compression positive", 0.0, 0.03,
          wheel=lambda c: c.deflection, tyre=True),
    State("deflection_rate", _SPEED, "its rate", -0.3, 0.3, wheel=lambda c: c.deflection_rate, tyre=True),
    State("load", FORCE, "load along the road's normal", 0.0, 8000.0,
          wheel=lambda c: dot(c.force, c.normal), tyre=True),
    State("fx", FORCE, "longitudinal load on the wheel, body axes", -3000.0, 3000.0,
          wheel=lambda c: c.force[0], channels=_LOADS),
    State("fy", FORCE, "lateral load on the wheel, body axes, to the left", -4000.0, 4000.0,
          wheel=lambda c: c.force[1], channels=_LOADS),
    State("fz", FORCE, "vertical load on the wheel, body axes", 0.0, 8000.0,
          wheel=lambda c: c.force[2], channels=_LOADS),
    State("mx", _TORQUE, "moment about the wheel centre, body x", -1000.0, 1000.0,
          wheel=lambda c: c.moment[0], channels=_MOMENTS),
    State("my", _TORQUE, "moment about the wheel centre, body y", -1000.0, 1000.0,
          wheel=lambda c: c.moment[1], channels=_MOMENTS),
    State("mz", _TORQUE, "moment about the wheel centre, body z", -200.0, 200.0,
          wheel=lambda c: c.moment[2], channels=_MOMENTS),
    State("steer", NUMBER, "steer of the carrier, to the left", -0.1, 0.1,
          wheel=lambda c: c.steer, channels=("camera.{c}.steer",)),
    State("camber", NUMBER, "camber of the carrier, about body x after steer", -0.05, 0.05,
          wheel=lambda c: c.camber, channels=("camera.{c}.camber",)),
    State("spin", _TURN, "wheel speed, rolling forward positive", 0.0, 120.0,
          wheel=lambda c: c.spin, channels=("wheel.{c}.speed",)),
    State("side", NUMBER, "+1 on the left, −1 on the right", -1.0, 1.0, wheel=lambda c: np.sign(c.centre[1])),
    State("arm_x", LENGTH, "wheel centre from the body origin, forward", -3.0, 0.5, wheel=lambda c: c.centre[0]),
    State("arm_y", LENGTH, "wheel centre from the body origin, to the left", -0.8, 0.8, wheel=lambda c: c.centre[1]),
    State("arm_z", LENGTH, "wheel centre from the body origin, up", -0.1, 0.1, wheel=lambda c: c.centre[2]),
    State("speed", _SPEED, "forward speed of the body origin", 0.0, 40.0,
          body=lambda m: _velocity(m, 0), channels=("correvit.speed",)),
    State("vx", _SPEED, "the same as speed", 0.0, 40.0,
          body=lambda m: _velocity(m, 0), channels=("correvit.speed",)),
    State("vy", _SPEED, "speed of the body origin to the left", -2.0, 2.0,
          body=lambda m: _velocity(m, 1), channels=("correvit.speed",)),
    State("ax", _ACCEL, "specific force at the body origin, forward", -6.0, 6.0,
          body=lambda m: m.body.accel[0], channels=_IMU),
    State("ay", _ACCEL, "specific force, to the left", -6.0, 6.0, body=lambda m: m.body.accel[1], channels=_IMU),
    State("az", _ACCEL, "specific force, up: +9.81 at rest", 5.0, 15.0, body=lambda m: m.body.accel[2], channels=_IMU),
    *(State(f"{name}_rate", _TURN, f"{name} rate, body axes", -size, size,
            body=lambda m, k=k: m.body.omega[k], channels=("imu.rate",))
      for k, (name, size) in enumerate((("roll", 0.3), ("pitch", 0.2), ("yaw", 0.4)))),
    *(State(f"{name}_accel", TIME**-2, f"{name} acceleration, body axes", -2.0, 2.0,
            body=lambda m, k=k: m.body.omega_dot[k], channels=("imu.rate",))
      for k, name in enumerate(("roll", "pitch", "yaw"))),
    *(State(name, NUMBER, f"{name} of the body against the horizontal{turn}", -size, size,
            body=lambda m, k=k: _attitude(m, k), channels=("imu.attitude",))
      for k, (name, size, turn) in enumerate((("roll", 0.06, ", left side up"), ("pitch", 0.04, ", nose down")))),
    State("t", TIME, "time of the run", 0.0, 60.0, body=lambda m: m.t),
)  # fmt: skip

STATES: dict[str, State] = {state.name: state for state in _ALL}
"""Every state by name."""
SUFFIXES = ("other", *CORNERS)
"""Suffixes that may follow the name of a wheel's state after ``_``."""


@dataclass(frozen=True)
class Use:
    """A state as used in an expression; `wheel` is a corner, ``other``, ``own``, or empty for a state of the body."""

    state: State
    wheel: str

    def corner(self, corner: str) -> str:
        """The wheel meant in a row of `corner`."""
        return {"own": corner, "other": ACROSS.get(corner, "")}.get(self.wheel, self.wheel)

    def value(self, motion: Motion, corner: str) -> Array:
        """(N,) values in a row of `corner` (empty for a chassis row)."""
        if self.state.wheel is not None:
            return self.state.wheel(motion.corners[self.corner(corner)])
        assert self.state.body is not None
        return self.state.body(motion)

    def lacks(self, motion: Motion, corner: str) -> list[str]:
        """Channels that it needs and a run lacks. Angles of the wheels may follow from steering and travels.

        An error of these turns a load in the second order of it.
        """
        c = self.corner(corner)
        has = motion.channels | {name for name in motion.derived if name.startswith("camera.")}
        channels = [channel.format(c=c) for channel in self.state.channels]
        if self.state.tyre:
            grounds = tuple(one for one in CORNERS if f"laser.{one}.ground" in has)
            channels += needs(Row.parse(f"tyre.{c}"), motion.reference, grounds)
        return [channel for channel in channels if channel not in has]


def use_of(name: str) -> Use | None:
    """The state that a name denotes, or None where it is no state."""
    if name in STATES:
        return Use(STATES[name], "own" if STATES[name].wheel else "")
    stem, _, suffix = name.rpartition("_")
    if suffix in SUFFIXES and stem in STATES and STATES[stem].wheel:
        return Use(STATES[stem], suffix)
    return None


def all_names() -> list[str]:
    """Every name that denotes a state, suffixes included."""
    return [*STATES, *(f"{s.name}_{suffix}" for s in _ALL if s.wheel for suffix in SUFFIXES)]
