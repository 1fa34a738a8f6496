"""Cars and signals made here for tests: a car with bench tables, exact motions, loads that fulfil a model exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.formats.open_run import open_run
from lacet.daq.joint_tables import JointCurve, JointTables
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import KinematicTable, Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sensitivity import residual
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import Recording, Signals
from tests.support.places import HOME

CAR = HOME / "tests" / "data" / "car"
RUNS = ("sine", "sweep", "liftoff", "rough")
LOADS = tuple(f"wheel.{c}.{what}" for c in CORNERS for what in ("force", "moment"))


def reference_car() -> tuple[Vehicle, Rig]:
    """The reference car's files."""
    return Vehicle.load(CAR / "vehicle.toml"), Rig.load(CAR / "rig.toml")


def piece(name: str, start: float, stop: float) -> Run:
    """Some seconds of a run of the reference car."""
    run = open_run(CAR / f"{name}.parquet")
    signals: dict[str, Signal] = {}
    for channel, s in run.signals.items():
        keep = (s.t >= start) & (s.t < stop)
        signals[channel] = replace(s, t=s.t[keep], values=s.values[keep], flags=s.flags[keep])
    return replace(run, signals=signals)


def with_tables(vehicle: Vehicle, pitch: bool = True) -> Vehicle:
    """The car with smooth bench tables, different at each corner, every column with slopes that are not zero."""
    s = np.linspace(-0.12, 0.12, 13)
    corners = {}
    for i, (name, corner) in enumerate(vehicle.corners.items()):
        k = 1.0 + 0.1 * i
        table = KinematicTable(
            travel=s,
            half_track=k * (0.10 * s - 0.9 * s**2),
            half_wheelbase=k * (-0.06 * s + 0.4 * s**2),
            toe=k * (0.05 * s - 0.3 * s**2),
            camber=k * (-0.20 * s - 0.8 * s**2),
            pitch=(1.0 if pitch else 0.0) * k * (0.12 * s + 0.5 * s**2),
        )
        corners[name] = replace(corner, table=table, driven=False)
    return replace(vehicle, corners=corners)


def with_joints(vehicle: Vehicle) -> Vehicle:
    """The car with joint tables, different at each corner: both wheels of an axle move with both, in front the rack.

    Knots at 0 and at ± 0.1 m alone, so that tests can differentiate numerically in between.
    """
    s = np.array([-0.1, 0.0, 0.1])
    corners = {}
    for i, (name, corner) in enumerate(vehicle.corners.items()):
        k = 1.0 + 0.1 * i
        own = np.outer(s, [0.10, -0.06, 0.05, -0.20, 0.42]) + np.outer(s**2, [-0.9, 0.4, -0.3, -0.8, 0.5])
        other = np.outer(s, [-0.05, 0.03, 0.07, 0.31, -0.15]) + np.outer(s**2, [0.4, -0.5, 0.2, 0.6, -0.3])
        # The steering's rack pushes the left wheel's toe in and the right one's out.
        rack = np.outer(s, [0.08, 0.20 * corner.side, 5.0 * corner.side, 0.3, 0.6 * corner.side])
        rack += np.outer(s**2, [-1.0, 0.5, 3.0, 2.0, 1.5])
        curves = [JointCurve(s, k * values) for values in (own, other, rack)]
        tables = JointTables(
            curves[0], curves[1], curves[2] if name[0] == "f" else None, {},
            product=k * np.array([0.7, -0.4, 0.5, 0.9, -0.6]),
            rack_product=k * np.array([0.3, 0.6, -4.0, -3.0, 1.0]) * (name[0] == "f"),
        )  # fmt: skip
        corners[name] = replace(corner, table=None, joints=tables, driven=False)
    return replace(vehicle, corners=corners)


def in_reference(rig: Rig, reference: str, axes: Mapping[str, str] | None = None) -> Rig:
    """The rig with another wheel reference, and other axes for some sensors (by sensor name)."""
    axes = axes or {}
    sensors = tuple(replace(s, axes=axes.get(s.name, s.axes)) for s in rig.sensors)
    return replace(rig, wheel_reference=reference, sensors=sensors)


RATE = Filters().rate
"""Rate of recordings [Hz]."""


class MultiSine:
    """A sum of sines with its derivatives, exact at any instant.

    Parameters
    ----------
    amplitude : of the value, (k,) or scalar; `offset` likewise.
    band : lowest and highest frequency [Hz]; `tones` of them, amplitudes falling with the frequency.
    """

    def __init__(
        self, rng: np.random.Generator, width: int, amplitude: float, offset: Sequence[float] | float = 0.0,
        band: tuple[float, float] = (0.15, 3.0), tones: int = 12,
    ):  # fmt: skip
        self.w = 2 * np.pi * rng.uniform(*band, (width, tones, 1))
        size = 1.0 / (1.0 + self.w / (2 * np.pi))
        self.a = amplitude * size / np.sqrt(np.sum(size**2, axis=1, keepdims=True) / 2)
        self.phase = rng.uniform(0, 2 * np.pi, (width, tones, 1))
        self.offset = np.broadcast_to(np.asarray(offset, float), (width,))[:, None]

    def at(self, t: Array, order: int = 0) -> Array:
        """(k, N) value or derivative at the instants `t`."""
        angle = self.w * t + self.phase + 0.5 * np.pi * order
        return np.sum(self.a * self.w**order * np.sin(angle), axis=1) + (self.offset if order == 0 else 0.0)


def drive_curves(rng: np.random.Generator, band: tuple[float, float] = (0.15, 3.0)) -> dict[str, MultiSine]:
    """A lively drive: every channel that is no load as a multi-sine."""
    curves = {
        "imu.accel": MultiSine(rng, 3, 2.0, (0.0, 0.0, 9.81), band),
        "imu.rate": MultiSine(rng, 3, 0.35, 0.0, band),
        "imu.attitude": MultiSine(rng, 3, 0.04, 0.0, band),
        "correvit.speed": MultiSine(rng, 2, 2.0, (22.0, 0.0), band),
    }
    for c in CORNERS:
        curves[f"laser.{c}.ground"] = MultiSine(rng, 1, 0.012, 0.6, band)
        curves[f"laser.{c}.hub"] = MultiSine(rng, 1, 0.018, 0.3, band)
        curves[f"camera.{c}.steer"] = MultiSine(rng, 1, 0.06, 0.0, band)
        curves[f"camera.{c}.camber"] = MultiSine(rng, 1, 0.02, 0.0, band)
        curves[f"wheel.{c}.speed"] = MultiSine(rng, 1, 3.0, 75.0, band)
    return curves


def exact_signals(curves: Mapping[str, MultiSine], t: Array) -> Signals:
    """Values and derivatives of all curves at `t`, no loads yet (zeros)."""
    loads = {name: np.zeros((3, t.size)) for name in LOADS}
    return Signals(
        {name: curve.at(t) for name, curve in curves.items()} | loads,
        {name: curve.at(t, 1) for name, curve in curves.items()},
        {name: curve.at(t, 2) for name, curve in curves.items()},
    )


def recording(
    signals: Signals, vehicle: Vehicle, rig: Rig, filters: Filters | None = None, brakes: str = "off"
) -> Recording:
    """A recording of exact signals, everything usable."""
    filters = filters or Filters(pre_cutoff=None)
    t = np.arange(next(iter(signals.value.values())).shape[1]) / filters.rate
    usable = {name: np.ones(t.size, bool) for name in signals.value}
    rates = {name: CHANNELS[name].rate for name in signals.value}
    return Recording("exact", t, signals, usable, rates, vehicle, rig, filters, rig.wheel_reference, brakes)


def random_signals(seed: int, n: int = 40) -> Signals:
    """Signals of single instants: values and derivatives independent of each other, loads too."""
    rng = np.random.default_rng(seed)
    curves = drive_curves(rng)
    value, rate, accel = ({k: v.at(rng.uniform(0, 1e3, n), order) for k, v in curves.items()} for order in range(3))
    value |= {name: rng.normal(0, 800, (3, n)) for name in LOADS}
    return Signals(value, rate, accel)


_FREE: dict[str, float] = {
    **{name: 3000.0 if name.endswith("force") else 300.0 for name in LOADS},
    "imu.accel": 0.5,
    **{f"laser.{c}.ground": 0.01 for c in CORNERS},
    **{
        f"{part}.{c}.{what}": 3000.0
        for c in CORNERS
        for part, what in (("hub", "load"), ("pushrod", "force"), ("scale", "load"))
    },
}
"""Channels of which only values enter a model without tyre damping, with the size of a change."""


def fulfil(record: Recording, effects: Sequence[Effect], theta: Array, changes: Array | None = None) -> Recording:
    """The recording with loads, specific force and ground lasers moved as little as makes Y = W θ in every row.

    Rows are not free of each other (the chassis carries what its suspensions carry), so loads alone cannot do it.
    Newton's method with the slopes of the first point. `changes` : the `smallest_changes` of the recording, where they
    are known; laws of suspensions and tyres that are added to the model leave them as they are.
    """
    if changes is None:
        changes = smallest_changes(record, effects, theta)
    values, free = dict(record.signals.value), _free(record)
    rest = start = _left(record, effects, theta, {})
    size = max(float(np.max(np.abs(start))), 100.0)  # of rows that hold already
    for _ in range(40):
        step = -np.einsum("nij,nj->ni", changes, rest).T
        place = 0
        for name, scale in free.items():
            width = CHANNELS[name].width
            values[name] = values[name] + scale * step[place : place + width]
            place += width
        rest = _left(record, effects, theta, values)
        if np.max(np.abs(rest)) < 1e-13 * size:
            break
    assert np.max(np.abs(rest)) < 1e-11 * size, "some row cannot be fulfilled"
    assert all(values[name].shape == (CHANNELS[name].width, record.t.size) for name in free)
    return record.with_signals(replace(record.signals, value=values))


def smallest_changes(record: Recording, effects: Sequence[Effect], theta: Array) -> Array:
    """(N, k, r) changes of k channels, relative to `_FREE`, for a unit in each of r rows: the smallest that make it."""
    start, slopes = _left(record, effects, theta, {}), list[Array]()
    for name, step in _free(record).items():
        for k in range(CHANNELS[name].width):
            moved = record.signals.value[name].copy()
            moved[k] += 1e-3 * step
            slopes.append((_left(record, effects, theta, {name: moved}) - start) / 1e-3)
    A = np.stack(slopes, axis=2)
    A_t = A.transpose(0, 2, 1)
    return A_t @ np.linalg.inv(A @ A_t)  # rounding is mended by iterating


def _free(record: Recording) -> dict[str, float]:
    return {name: step for name, step in _FREE.items() if name in record.signals.value}


def _left(record: Recording, effects: Sequence[Effect], theta: Array, changed: Mapping[str, Array]) -> Array:
    """(N, r) residual of the recording with some channels `changed`."""
    moved = record.with_signals(replace(record.signals, value={**record.signals.value, **changed}))
    return np.stack([*residual(build_motion(moved), effects, theta).values()], axis=1)
