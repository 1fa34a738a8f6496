"""Columns quieter than their noise or far louder than the other side's, and signs that distances and steer show.

A column in another unit by a factor of 1000, or dead with some noise left, is quieter than the noise of its own sensor
sheet: no sound instrument is. The sheet itself is in doubt where most columns of the kind are so quiet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, COLUMNS, CORNERS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun

_OTHER_UNIT = 1000.0**0.5
"""Ratio of two sizes that is nearer to 1000, the factor between a unit and its thousandth, than to 1."""
_POUND = 4.448
"""N in a pound of force: the smallest factor between two units of a load [ratio]."""
_STRAIGHT = 2.0
"""Median lateral acceleration above which a run is a circle, in which axles share their load unlike [m/s²]. Source: a
choice."""
_MIRRORED = ("laser.hub", "laser.ground", "camera.steer", "camera.camber", "wheel.angle")
"""Families that vary alike on both sides of the car, whichever wheel is braked."""
_MOVES = 3.0
"""Variation ÷ noise of the sensor sheet above which a column is more than noise."""
_QUIET = 10.0**-0.5
"""Variation ÷ noise of the sensor sheet below which a column is too quiet for a sound instrument."""
_LEAST = 30
"""Least number of samples of a column."""
_WITH_YAW = 0.5
"""Correlation with the yaw rate from which opposed steer of the front wheels is steering, and not toe."""
_SURE = 1e-6
"""Probability by chance of a correlation between two noises, below which two columns are compared."""
_ZEROS = 5.0
"""Camber ÷ tolerance of the camera's zero from which the side that a wheel leans to is sure."""
_LEAST_CAMBER = 0.0025
"""The same where the sheet has no tolerance [rad]."""
_FRONT = ("camera.fl.steer", "camera.fr.steer")


@dataclass(frozen=True)
class TooQuiet:
    """A column whose `variation` (1 σ) is far below the `noise` of its sensor sheet, while others of its kind move.

    `others` : median variation of the others of its kind.
    """

    column: str
    variation: float
    noise: float
    others: float


@dataclass(frozen=True)
class OtherSize:
    """A column whose `size` [SI] is that of another unit, beside the `others` of its kind.

    The size is the median of a wheel's load, of other columns the variation (1 σ).
    """

    column: str
    size: float
    others: float


@dataclass(frozen=True)
class NegativeDistance:
    """A laser whose mean is negative: `mean` [m]."""

    column: str
    mean: float


@dataclass(frozen=True)
class SteersAgainst:
    """A front wheel's steer with the other sign than the other front wheel's: `slope` between the two.

    `column` : the one against the yaw rate; empty where neither or both are.
    """

    column: str
    slope: float


@dataclass(frozen=True)
class LeansAlike:
    """Two wheels of an axle that lean to the same side of the car; `left`, `right` : camber at zero steer [rad]."""

    columns: tuple[str, str]
    left: float
    right: float


def quiet_columns(run: Run, rig: Rig) -> list[TooQuiet]:
    """Columns far below their own noise, by family; none where half of the family, or more, is.

    Columns that do not vary at all belong to `resting_stretches`.
    """
    families: dict[str, dict[str, float]] = {}
    for name, signal in run.signals.items():
        if not CHANNELS[name].optional and np.count_nonzero(signal.usable) >= _LEAST:
            spread: Array = np.std(signal.values[signal.usable], axis=0)
            by_column = dict(zip(CHANNELS[name].columns, (float(s) / rig.noise(name) for s in spread), strict=True))
            families.setdefault(CHANNELS[name].family, {}).update(by_column)
    return [found for family in families.values() for found in _quiet(family, rig)]


def _quiet(variations: Mapping[str, float], rig: Rig) -> list[TooQuiet]:
    quiet = [column for column, variation in variations.items() if variation < _QUIET]
    if 2 * len(quiet) >= len(variations):
        return []
    middle = float(np.median([variation for column, variation in variations.items() if column not in quiet]))
    noise = {column: rig.noise(COLUMNS[column][0].name) for column in quiet}
    return [TooQuiet(c, variations[c] * noise[c], noise[c], middle * noise[c]) for c in quiet if variations[c] > 0.0]


def other_sizes(run: Run, rig: Rig) -> list[OtherSize]:
    """Columns in another unit than the others of their kind: wheel loads, and what varies alike left and right.

    Of two columns of an axle the one farther from the rest of its family is named; where one of them is mere noise, as
    it should be, the other.
    """
    loads = {
        f"wheel.{c}.force.z": abs(float(_middle(run, f"wheel.{c}.force")[2])) for c in _there(run, "wheel.{}.force")
    }
    out = [OtherSize(c, size, others) for c, size, others in _unlike(loads) if _is_other(size, others)]
    if not out and len(loads) == len(CORNERS) and not _turns_all_along(run):
        out = _lopsided(list(loads), list(loads.values()))
    for family in _MIRRORED:
        pattern = ".{}.".join(family.split("."))
        sizes = {pattern.format(c): _variation(run, pattern.format(c)) for c in _there(run, pattern)}
        found = {column: (size, others) for column, size, others in _unlike(sizes)}
        for left, right in (CORNERS[:2], CORNERS[2:]):
            pair = [column for c in (left, right) if (column := pattern.format(c)) in found]
            if len(pair) == 2 and _is_other(sizes[pair[0]], sizes[pair[1]]):
                odd = max(pair, key=lambda column: sizes[column])
                if min(sizes[column] for column in pair) > _MOVES * rig.noise(pair[0]):
                    odd = max(pair, key=lambda column: abs(np.log(found[column][0] / found[column][1])))
                out.append(OtherSize(odd, sizes[odd], sizes[pair[1 - pair.index(odd)]]))
    return out


def _turns_all_along(run: Run) -> bool:
    """Whether a run is a circle, in which the inner wheels lose their load; and one without lateral acceleration."""
    return "imu.accel" not in run.signals or abs(float(_middle(run, "imu.accel")[1])) > _STRAIGHT


def _lopsided(columns: Sequence[str], loads: Sequence[float]) -> list[OtherSize]:
    """The wheel whose load is another part of its axle's than the other axle says, by a unit's factor.

    `columns`, `loads` : of the four corners. Of the four that would explain it the one farthest from the others.
    """
    if min(loads) <= 0.0:
        return []
    left_front, right_front, left_rear, right_rear = loads
    if abs(math.log(left_front / right_front * right_rear / left_rear)) < math.log(_POUND) / 2.0:
        return []
    expected = [
        right_front * left_rear / right_rear, left_front * right_rear / left_rear,
        right_rear * left_front / right_front, left_rear * right_front / left_front,
    ]  # fmt: skip
    middle = math.log(float(np.median(loads)))
    odd = max(range(len(loads)), key=lambda k: abs(math.log(loads[k]) - middle))
    return [OtherSize(columns[odd], loads[odd], expected[odd])]


def _there(run: Run, pattern: str) -> list[str]:
    """Corners of which a run has usable samples of a channel."""
    names = {c: pattern.format(c) for c in CORNERS}
    return [
        c for c, name in names.items() if name in run.signals and np.count_nonzero(run.signals[name].usable) >= _LEAST
    ]


def _middle(run: Run, channel: str) -> Array:
    signal = run.signals[channel]
    return np.asarray(np.median(signal.values[signal.usable], axis=0), float)


def _variation(run: Run, channel: str) -> float:
    signal = run.signals[channel]
    return float(np.std(signal.values[signal.usable]))


def _unlike(sizes: Mapping[str, float]) -> list[tuple[str, float, float]]:
    """Column, its size and the median of the others'; columns without variation are left out."""
    sizes = {column: size for column, size in sizes.items() if size > 0.0}
    return [
        (column, size, float(np.median([other for name, other in sizes.items() if name != column])))
        for column, size in sizes.items()
        if len(sizes) > 1
    ]


def _is_other(size: float, other: float) -> bool:
    return not 1.0 / _OTHER_UNIT < size / other < _OTHER_UNIT


def negative_distances(run: Run) -> list[NegativeDistance]:
    """Lasers whose mean is negative: all are mounted above what they measure the distance to."""
    means = {
        name: float(np.mean(signal.values[signal.usable]))
        for name, signal in run.signals.items()
        if CHANNELS[name].family in ("laser.hub", "laser.ground") and np.any(signal.usable)
    }
    return [NegativeDistance(name, mean) for name, mean in means.items() if mean < 0.0]


def opposed_steer(run: PreparedRun) -> SteersAgainst | None:
    """The front wheel that steers against the other; None where they steer alike, or hardly."""
    values = run.recording.signals.value
    if not all(name in values for name in _FRONT):
        return None
    keep = run.recording.usable[_FRONT[0]] & run.recording.usable[_FRONT[1]]
    left, right = (np.asarray(values[name][0][keep], float) for name in _FRONT)
    if left.size < _LEAST or min(np.std(s) for s in (left, right)) < run.recording.rig.noise(_FRONT[0]):
        return None
    r = float(np.mean((left - np.mean(left)) * (right - np.mean(right)))) / float(np.std(left) * np.std(right))
    freedom = left.size - 2
    t = -abs(r) * math.sqrt(freedom / max(1e-300, 1.0 - r * r))
    chance = 2.0 * float(scipy.special.stdtr(float(freedom), t))
    if not (r < 0.0 and r * r > 0.5 and chance < _SURE) or _toe_alone(run, keep, left - right):
        return None
    return SteersAgainst(_against_yaw(run, keep, (left, right)), r * float(np.std(right) / np.std(left)))


def unmirrored_camber(run: Run, rig: Rig) -> list[LeansAlike]:
    """Axles whose wheels lean to the same side, by more than the cameras' zeros: on a car they are mirror images.

    At the front the part that goes with the steer is removed.
    """
    out: list[LeansAlike] = []
    for pair in (CORNERS[:2], CORNERS[2:]):
        names = f"camera.{pair[0]}.camber", f"camera.{pair[1]}.camber"
        if len(_there(run, "camera.{}.camber")) < len(CORNERS) or len(_there(run, "camera.{}.steer")) < len(CORNERS):
            continue
        left, right = (_at_zero_steer(run, c) for c in pair)
        small, large = sorted((abs(left), abs(right)))
        if left * right > 0.0 and small > max(0.5 * large, _ZEROS * rig.tolerance(names[0], "zero"), _LEAST_CAMBER):
            out.append(LeansAlike(names, left, right))
    return out


def _at_zero_steer(run: Run, corner: str) -> float:
    """Mean camber of a wheel [rad], at the front that at zero steer."""
    camber, steer = run.signals[f"camera.{corner}.camber"], run.signals[f"camera.{corner}.steer"]
    series = camber.values[camber.usable, 0]
    if corner in CORNERS[2:]:
        return float(np.mean(series))
    at: Array = np.interp(camber.t[camber.usable], steer.t[steer.usable], steer.values[steer.usable, 0])
    return float(np.linalg.lstsq(np.stack([np.ones(at.size), at], axis=1), series, rcond=None)[0][0])


def _toe_alone(run: PreparedRun, keep: NDArray[np.bool_], opposed: Array) -> bool:
    """Whether the opposed part of the steer has little to do with the yaw rate: bump and load change toe."""
    if "imu.rate" not in run.recording.signals.value:
        return False
    yaw = run.motion.body.omega[2][keep]
    return bool(abs(float(np.corrcoef(opposed, yaw)[0, 1])) < _WITH_YAW) if np.std(yaw) > 0.0 else False


def _against_yaw(run: PreparedRun, keep: NDArray[np.bool_], steer: Sequence[Array]) -> str:
    """The front wheel that alone steers against the yaw rate; empty where it is open."""
    if "imu.rate" not in run.recording.signals.value or run.motion.velocity is None:
        return ""
    with_turn = [float(np.dot(s - float(np.mean(s)), run.motion.body.omega[2][keep])) for s in steer]
    against = [name for name, product in zip(_FRONT, with_turn, strict=True) if product < 0.0]
    return against[0] if len(against) == 1 else ""
