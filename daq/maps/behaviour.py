"""Signs of channels by the car's behaviour: gravity, loads that carry it, turns, and correlations between channels.

Evidence is a correlation of slow motion, below 2 Hz, where there is enough of it. A car and its mirror image obey the
same laws: that a turn is to the left, and not to the right, only what has a side can say, wheel speeds and loads.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.sources.source import Array

RATE = 20.0
"""Rate of the grid on which names are compared [Hz]."""
_SMOOTH = 0.25
"""Length of the moving average before that [s]."""
_LEAST_SAMPLES = 60
LEAST_ACCEL = 0.4
"""Least standard deviation of an acceleration by which others are judged [m/s²]: a lively drive, no noise."""
LEAST_YAW_RATE = 0.02
"""The same of a yaw rate [rad/s]."""
LEAST_CARRIED = 0.003
"""The same of the pitch rate of a rolled car that yaws [rad/s]: 0.1 rad/s at 2° of roll."""
LEAST_SIDE_SPEED, LEAST_SIDE_LOAD = 0.001, 0.02
"""The same of the difference of two wheels of an axle by their sum, speeds and loads: 0.03 rad/s at 20 m/s."""
SURE = 0.9
"""Certainty of a sign from which others are judged by it."""
ANGLES = {"imu.attitude.roll": "imu.rate.x", "imu.attitude.pitch": "imu.rate.y", "imu.attitude.yaw": "imu.rate.z"}
"""Angle → the rate that it turns at."""


def on_grid(t: Array, values: Array, grid: Array) -> Array:
    """A series smoothed and on the common grid; NaN outside."""
    good = np.isfinite(values) & np.isfinite(t)
    t, values = t[good], values[good]
    if len(t) < 3:
        return np.full(len(grid), np.nan)
    step = float(np.median(np.diff(t)))
    n = max(1, round(_SMOOTH / step)) if step > 0.0 else 1
    if 1 < n < len(values):
        values = np.convolve(values, np.ones(n) / n, "same")
        t, values = t[n : len(t) - n], values[n : len(values) - n]
    return np.interp(grid, t, values, left=np.nan, right=np.nan) if len(t) > 2 else np.full(len(grid), np.nan)


def correlation(a: Array, b: Array) -> float:
    """Correlation of two series where both have values; 0 for too few values or a constant series."""
    good = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(good) < _LEAST_SAMPLES:
        return 0.0
    a, b = a[good] - np.mean(a[good]), b[good] - np.mean(b[good])
    size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / size if size > 0.0 else 0.0


class Car:
    """Slow motion of what is mapped so far: column → series on the grid, in SI, with the sign as recorded."""

    def __init__(self, columns: Mapping[str, Array]):
        self.columns = dict(columns)
        self.signs: dict[str, tuple[int, float]] = {}
        """Column → sign that makes it right, and the certainty of it, 0.5 to 1."""
        self.related: dict[str, tuple[int, float]] = {}
        """Angle → 1 if it turns with its rate, -1 if against it, both as recorded; and the certainty of it."""

    def get(self, column: str) -> Array | None:
        """A column with its sign, where that is sure enough to judge others by; None otherwise."""
        if column not in self.columns:
            return None
        sign, sure = self.signs.get(column, (1, 0.5))
        return sign * self.columns[column] if sure >= SURE else None

    def judge(self, column: str, by: Array | None, positive: bool = True) -> None:
        """Take a column's sign from its correlation with another series, unless a better judgement is there."""
        if by is None or column not in self.columns:
            return
        found = correlation(self.columns[column], by) * (1 if positive else -1)
        sure = certainty(abs(found))
        if sure > self.signs.get(column, (1, 0.0))[1]:
            self.signs[column] = (1 if found > 0.0 else -1, sure)

    def find_signs(self) -> None:
        """Find all signs: first of columns that are judged alone, then of those judged by them."""
        for column in self.columns:
            upright = column == "imu.accel.z" or column.endswith(".force.z")
            if upright or column.startswith("laser.") or column.endswith((".speed", ".speed.x")):
                self._by_mean(column)
        left = self._left_turn()
        speed = self._speed()
        ahead = None if speed is None else enough(np.gradient(speed) * RATE, LEAST_ACCEL)
        self.judge("imu.accel.x", ahead)
        for column in ("imu.rate.z", "imu.accel.y", "steering.angle", *(f"camera.{c}.steer" for c in CORNERS[:2])):
            self.judge(column, left)
        yaw = enough(self.get("imu.rate.z"), LEAST_YAW_RATE)
        turning = None if yaw is None else yaw * (speed if speed is not None else 1.0)
        for column in ("imu.accel.y",):
            self.judge(column, turning)
        for column in ("steering.angle", "camera.fl.steer", "camera.fr.steer"):
            self.judge(column, yaw)
        ay = enough(self.get("imu.accel.y"), LEAST_ACCEL)
        if yaw is None and ay is not None:
            self.judge("imu.rate.z", ay)
        if ay is None:
            ay = turning
        slope = None if ay is None else np.gradient(ay) * RATE
        self.judge("imu.attitude.roll", ay)
        roll = self.get("imu.attitude.roll")
        self.judge("imu.rate.x", slope if roll is None else np.gradient(roll) * RATE)
        ax = enough(self.get("imu.accel.x"), LEAST_ACCEL) if ahead is not None else None
        self.judge("imu.attitude.pitch", ax, positive=False)
        self.judge("imu.rate.y", self._carried())
        self._angles_with_rates()
        for corner in CORNERS:
            self.judge(f"wheel.{corner}.force.y", ay)
            load, side = self.get(f"wheel.{corner}.force.z"), self.get(f"wheel.{corner}.force.y")
            self.judge(f"wheel.{corner}.moment.x", side)
            for travel in (f"suspension.{corner}.travel", f"damper.{corner}.travel"):
                self.judge(travel, load)
                self.judge(travel, ay, positive=corner.endswith("r"))

    def _by_mean(self, column: str) -> None:
        """Take the sign of what is positive by nature: distances, and speeds of a car that does not drive backwards."""
        series = self.columns[column]
        if np.isfinite(series).any():
            mean, spread = float(np.nanmean(series)), float(np.nanstd(series))
            self.signs[column] = (1 if mean > 0.0 else -1, 0.99 if abs(mean) > spread else 0.8)

    def _carried(self) -> Array | None:
        """Pitch rate of a rolled car that yaws, about its own lateral axis, without a change of pitch [rad/s]."""
        roll, yaw = self.get("imu.attitude.roll"), self.get("imu.rate.z")
        return None if roll is None or yaw is None else enough(yaw * np.sin(roll), LEAST_CARRIED)

    def _tilting(self, rate: Array) -> Array | None:
        """The part of a pitch rate, as recorded, by which the pitch angle changes; None where it cannot be known."""
        if not {"imu.attitude.roll", "imu.rate.z"} <= set(self.columns):
            return None
        if enough(self.columns["imu.rate.z"] * np.sin(self.columns["imu.attitude.roll"]), LEAST_CARRIED) is None:
            return rate
        carried, sign = self._carried(), self.signs.get("imu.rate.y", (1, 0.0))
        return None if carried is None or sign[1] < SURE else rate - sign[0] * carried

    def _angles_with_rates(self) -> None:
        """Find which angle turns with, or against, its rate; the less certain sign of both follows the other."""
        for angle, rate in ANGLES.items():
            if angle not in self.columns or rate not in self.columns:
                continue
            turning = self._tilting(self.columns[rate]) if rate == "imu.rate.y" else self.columns[rate]
            if turning is None:
                continue
            found = correlation(np.gradient(self.columns[angle]) * RATE, turning)
            sure = certainty(abs(found))
            if sure < SURE:
                continue
            relation = 1 if found > 0.0 else -1
            self.related[angle] = (relation, sure)
            better, worse = sorted((angle, rate), key=lambda one: -self.signs.get(one, (1, 0.0))[1])
            sign, known = self.signs.get(better, (1, 0.0))
            if known >= SURE:
                same = self.signs.get(worse, (1, 0.0))
                agreed = known * sure if same[0] != relation * sign else max(same[1], known * sure)
                self.signs[worse] = (relation * sign, agreed)

    def _speed(self) -> Array | None:
        for column in ("correvit.speed.x", "car.speed", "gnss.speed"):
            if column in self.columns:
                series = self.columns[column]
                return -series if np.nansum(series) < 0.0 else series
        wheels = [self.columns[f"wheel.{c}.speed"] for c in CORNERS if f"wheel.{c}.speed" in self.columns]
        return np.abs(np.mean(wheels, axis=0)) if wheels else None

    def _left_turn(self) -> Array | None:
        """A series that is positive in left turns, by differences of the sides: wheel speeds, else loads."""
        for what, front in (("speed", "rl rr"), ("speed", "fl fr"), ("force.z", "fl fr"), ("force.z", "rl rr")):
            left, right = (self.columns.get(f"wheel.{c}.{what}") for c in front.split())
            if left is None or right is None:
                continue
            difference = np.abs(right) - np.abs(left)
            mean = np.abs(right) + np.abs(left)
            with np.errstate(all="ignore"):
                relative = difference / mean
            found = enough(relative, LEAST_SIDE_SPEED if what == "speed" else LEAST_SIDE_LOAD)
            if found is not None:
                return found
        return None


def enough(series: Array | None, least: float) -> Array | None:
    """A series whose standard deviation is at least `least`, None otherwise."""
    if series is None or not np.isfinite(series).any():
        return None
    return series if float(np.nanstd(series)) >= least else None


def certainty(size: float) -> float:
    """Probability that a sign is right by the size of a correlation: 0.5 at none, 0.99 from 0.7 on."""
    return float(np.interp(size, [0.0, 0.15, 0.35, 0.5, 0.7], [0.5, 0.6, 0.85, 0.96, 0.99]))
