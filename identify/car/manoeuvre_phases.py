"""Manoeuvre phases of a run (braking, cornering, rough road …), from the measured motion alone.

Each instant has one phase. Fast signals are averaged over half a second, so that noise and single bumps do not divide a
phase; a phase shorter than a quarter of a second is merged with those around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.car.outline import Outline
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative, zero_phase

PHASES: tuple[str, ...] = (
    "standing", "straight, steady", "accelerating", "braking", "lift-off", "cornering left", "cornering right",
    "accelerating in a bend", "braking in a bend", "lift-off in a bend", "steering", "rough road",
)  # fmt: skip
"""Every phase, in the order of reports."""

STANDS = 0.5
"""Speed below which the car stands [m/s]."""
BEND = 1.5
"""Lateral acceleration from which a car corners [m/s²]: 0.15 g."""
BRAKES = -1.5
"""Longitudinal acceleration below which a car brakes [m/s²]; an engine's drag alone seldom exceeds it."""
LIFTS = -0.4
"""Longitudinal acceleration below which the driver has lifted off [m/s²]; rolling resistance alone is about −0.15."""
ACCELERATES = 0.7
"""Longitudinal acceleration from which a car accelerates [m/s²]."""
STEERS = 0.04
"""Rate of the steer angle at the wheels that counts as steering [rad/s]: 35°/s at a hand wheel geared 15 : 1."""
JERKS = 3.0
"""Rate of the lateral acceleration that counts as steering where no camera measures the wheels [m/s³]."""
ROUGH = 0.03
"""Mean over the corners of the RMS travel rate above `RIDE` that counts as a rough road [m/s]."""
RIDE = 3.0
"""Frequency above which suspension travel comes from the road and not from the driver [Hz]."""
SMOOTHING = 0.5
"""Averaging window [s]."""
SHORTEST = 0.25
"""Length of the shortest phase [s]."""
_SLOW = 1.0
"""Cut-off of the motion that the driver causes [Hz]."""


@dataclass(frozen=True)
class Interval:
    """A stretch of one manoeuvre phase from `start` to `stop` [s]."""

    phase: str
    start: float
    stop: float


@dataclass(frozen=True)
class Phases:
    """The manoeuvre phases of a run.

    `t` (N,) s; `number` (N,) index of each instant's phase in `PHASES`; `unseen` quantities that are not measured, so
    that phases which need them cannot appear.
    """

    t: Array
    number: NDArray[np.intp]
    unseen: tuple[str, ...] = ()

    @property
    def intervals(self) -> list[Interval]:
        """The stretches of one phase each, in order."""
        edges = np.flatnonzero(np.diff(self.number)) + 1
        starts = np.concatenate([[0], edges])
        stops = np.concatenate([edges, [self.t.size - 1]])
        return [
            Interval(PHASES[self.number[a]], float(self.t[a]), float(self.t[b]))
            for a, b in zip(starts, stops, strict=True)
        ]

    @property
    def present(self) -> list[str]:
        """Phases that occur, in the order of reports."""
        return [PHASES[k] for k in np.unique(self.number)]

    def at(self, t: Array) -> NDArray[np.intp]:
        """(n,) index in `PHASES` at some of the run's instants [s]."""
        return self.number[np.clip(np.searchsorted(self.t, t), 0, self.t.size - 1)]


def phases_of(run: Outline) -> Phases:
    """The manoeuvre phases of a run.

    Where several apply, the order of precedence is standing, rough road, longitudinal manoeuvres, steering, cornering.
    Speed is that of the speed sensor, else of the wheels; where the lateral or longitudinal acceleration is not
    measured, the phases that need it do not appear and are named in `unseen`.
    """
    rate, n = run.filters.rate, run.t.size
    unseen: list[str] = []
    zero = np.zeros(n)

    def slow(series: Array) -> Array:
        return zero_phase(series, _SLOW, rate, 5) if n > int(rate / _SLOW) + 40 else np.full(n, float(series.mean()))

    forward, lateral = zero, zero
    if "imu.accel" in run.channels:
        forward, lateral = slow(_along_road(run)), slow(run.accel[1])
    else:
        unseen.append("accelerations")
    steer = [run.corners[c].steer for c in ("fl", "fr") if {f"camera.{c}.steer", "steering.angle"} & run.channels]
    if steer:
        steering = np.abs(derivative(slow(np.mean(steer, axis=0)), rate)) > STEERS
    else:
        unseen.append("steer")
        steering = np.abs(derivative(lateral, rate)) > JERKS
    seen = [run.corners[c].rate for c in CORNERS if {f"laser.{c}.hub", f"damper.{c}.travel"} & run.channels]
    rough = np.zeros(n, bool)
    if seen and 0.4 * rate > RIDE and n > int(rate / RIDE) + 40:
        fast = np.stack(seen) - zero_phase(np.stack(seen), RIDE, rate, 5)
        window = max(1, round(2.0 * SMOOTHING * rate))
        rough = np.sqrt(np.maximum(0.0, scipy.ndimage.uniform_filter1d(fast**2, window, axis=1))).mean(axis=0) > ROUGH
    elif not seen:
        unseen.append("travel")
    speed = _speed(run)
    standing = np.zeros(n, bool)
    if speed is None:
        unseen.append("speed")
    else:
        standing = np.abs(speed) < STANDS
    bend = np.abs(lateral) > BEND
    number = np.select(
        [
            standing, rough,
            bend & (forward < BRAKES), bend & (forward < LIFTS), bend & (forward > ACCELERATES),
            forward < BRAKES, forward < LIFTS, forward > ACCELERATES,
            steering, lateral > BEND, lateral < -BEND,
        ],
        [
            PHASES.index(name)
            for name in (
                "standing", "rough road", "braking in a bend", "lift-off in a bend", "accelerating in a bend",
                "braking", "lift-off", "accelerating", "steering", "cornering left", "cornering right",
            )
        ],
        PHASES.index("straight, steady"),
    )  # fmt: skip
    number = _commonest(number.astype(np.intp), max(1, round(SMOOTHING * rate)))
    return Phases(run.t, _without_splinters(number, round(SHORTEST * rate)), tuple(unseen))


def _along_road(run: Outline) -> Array:
    """Longitudinal acceleration [m/s²]: specific force without the component of gravity from pitch."""
    if run.attitude is None:
        return run.accel[0]
    return run.accel[0] + STANDARD_GRAVITY * np.sin(run.attitude[1])


def _speed(run: Outline) -> Array | None:
    """Speed over the ground [m/s]; from the wheels where there is no speed sensor, None without either."""
    if run.velocity is not None:
        return np.hypot(run.velocity[0], run.velocity[1])
    turning = [corner for name, corner in run.corners.items() if f"wheel.{name}.speed" in run.channels]
    if not turning:
        return None
    return np.mean([corner.spin * np.where(corner.height > 0.0, corner.height, 0.3) for corner in turning], axis=0)


def _commonest(number: NDArray[np.intp], window: int) -> NDArray[np.intp]:
    """The most frequent phase within half a window to either side."""
    votes = np.stack([scipy.ndimage.uniform_filter1d((number == k).astype(float), window) for k in range(len(PHASES))])
    return np.argmax(votes, axis=0).astype(np.intp)


def _without_splinters(number: NDArray[np.intp], least: int) -> NDArray[np.intp]:
    """Phases in which stretches of fewer samples than `least` are merged with the nearest longer one."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1, [number.size]])
    keep = np.flatnonzero(np.repeat(np.diff(edges) >= least, np.diff(edges)))
    if not keep.size:
        return number
    right = np.clip(np.searchsorted(keep, np.arange(number.size)), 0, keep.size - 1)
    left = np.maximum(right - 1, 0)
    place = np.arange(number.size)
    nearest = np.where(np.abs(keep[left] - place) <= np.abs(keep[right] - place), keep[left], keep[right])
    return number[nearest]
