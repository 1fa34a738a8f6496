"""Units and signs of a run's channels, checked against one another before a fit believes them.

A table in degrees, in g or in kilonewtons, or with an axis turned round, is fitted without complaint; the model then
fails everywhere, and no effect explains it. What is asked here holds for every car: gravity is 9.81 m/s², wheels roll,
attitude is the sum of its rates, forces are mass times acceleration. Only what is plain is told: more than twice too
much or too little, or the wrong way round.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.car.car_tree import orientation
from lacet.identify.multibody.vectors import Array, dot
from lacet.identify.regression.prepared_run import PreparedRun

_G: Final = 9.80665
_DEGREE: Final = math.pi / 180.0
_TWICE: Final = 2.0
"""So many times too much or too little is told."""
_ALIKE: Final = 0.8
"""Correlation from which two signals are taken for the same quantity."""
_ROLLS: Final = 2.0
"""Speed from which wheels are compared with the road [m/s]."""
_FAR: Final = 3.0
"""No laser looks so far [m]."""
_LIGHT: Final = 2.0
"""Mass over wheelbase cubed of the lightest car [kg/m³]: 30 to 200 from models to lorries."""
_CORNERS: Final = 0.5
"""Side acceleration from which leaning is looked at [m/s², 1 σ]."""
_STEP: Final = 0.2
"""Over such times an attitude is compared with its rate [s]."""
_LEAST: Final = 30
"""Fewer samples tell nothing."""

_Check = Callable[[PreparedRun], Iterator[str]]


def implausible(run: PreparedRun) -> list[str]:
    """Channels whose unit, sign or axes cannot be right, a line each with what they look like; empty when all is well.

    Where a channel by itself is wrong, what follows from it in others is not told: it goes with its cause.
    Source: the conventions of ``docs/channels.md``.
    """
    for checks in _CHECKS:
        found = [line for check in checks for line in check(run)]
        if found:
            return found
    return []


# -- a channel by itself ----------------------------------------------------------------------------------------------


def _gravity(run: PreparedRun) -> Iterator[str]:
    force = _accel(run)
    if force is None:
        return
    force = force[:, _usable(run, "imu.accel")]
    if force.shape[1] < _LEAST:
        return
    size, up = float(np.median(np.linalg.norm(force, axis=0))), float(np.median(force[2]))
    if not _near(size / _G):
        guess = _guess(size / _G, {1 / _G: "g", 1e3: "mm/s²", 3.281: "ft/s²"})
        yield f"imu.accel is {size:.3g} m/s², where gravity alone is 9.81{guess}"
    elif up < 0.5 * size:
        yield (
            f"imu.accel is {up:.3g} m/s² upwards, where gravity is +9.81: look at its signs and axes, and at the "
            "sensor's orientation in the rig"
        )


def _weight(run: PreparedRun) -> Iterator[str]:
    names = _present(run, "wheel.{}.force", CORNERS)
    keep = _usable(run, *names)
    if len(names) < len(CORNERS) or np.count_nonzero(keep) < _LEAST:
        return
    loads = np.sum([dot(corner.force, corner.normal) for corner in run.motion.corners.values()], axis=0)
    weight = float(np.median(loads[keep]))
    each = {c: float(np.median(dot(k.force, k.normal)[keep])) for c, k in run.motion.corners.items()}
    pulls = [f"wheel.{c}.force" for c, load in each.items() if load < 0.0]
    if weight < 0.0:
        yield f"the wheel forces' z add up to {weight:.3g} N: they are positive when the wheels carry the car"
    elif weight / _G < _LIGHT * _wheelbase(run) ** 3:
        yield f"the wheel forces' z add up to {weight:.3g} N, a car of {weight / _G:.2g} kg: are they in kN?"
    elif pulls:
        yield f"{', '.join(pulls)} mostly pulls at the road: z is positive when a wheel carries the car"


def _distances(run: PreparedRun) -> Iterator[str]:
    for names, size in _large(run, [n for n in run.recording.signals.value if CHANNELS[n].unit == "m"], _FAR):
        unit = "mm" if size > 150.0 else "cm" if size > 29.0 else "inches"
        yield f"{names} up to {size:.3g} m: in {unit}?"


def _angles(run: PreparedRun) -> Iterator[str]:
    families = ("camera.steer", "camera.camber")
    cameras = [name for name in run.recording.signals.value if CHANNELS[name].family in families]
    for names, size in _large(run, cameras, 1.2):
        yield f"{names} up to {size:.3g} rad: in degrees?"


def _rolling(run: PreparedRun) -> Iterator[str]:
    velocity = run.motion.velocity
    keep = _usable(run, "correvit.speed")
    if velocity is None or np.count_nonzero(keep) < _LEAST:
        return
    over = float(np.mean(velocity[0][keep]))
    rims = {
        name: float(np.mean(run.recording.signals.value[name][0][keep & _usable(run, name)]))
        * run.recording.vehicle.corners[name.split(".")[1]].tyre_radius
        for name in _present(run, "wheel.{}.speed", CORNERS)
        if np.any(keep & _usable(run, name))
    }
    wrong = {name: rim for name, rim in rims.items() if not _near(rim / over)} if abs(over) > _ROLLS else {}
    rim = float(np.median(list(wrong.values()) or [0.0]))
    of_speed = _guess(over / rim, {3.6: "km/h", 2.237: "mph"}) if rim else ""
    if of_speed and len(wrong) == len(rims):  # all wheels cannot be wrong by just this
        yield f"correvit.speed x is {over:.3g} m/s where the wheels roll at {rim:.3g}{of_speed}"
    elif wrong:
        guess = _guess(rim / over, {60 / math.tau: "1/min", 1 / math.tau: "revolutions a second", 1 / _DEGREE: "°/s"})
        guess = guess or (": one of the two has the wrong sign" if rim * over < 0.0 else "")
        names = ", ".join(wrong)
        yield f"{names} times the tyre's radius: {rim:.3g} m/s where correvit.speed x is {over:.3g}{guess}"


# -- one channel against another --------------------------------------------------------------------------------------


def _turning(run: PreparedRun) -> Iterator[str]:
    attitude, recording = run.motion.attitude, run.recording
    if attitude is None or "imu.rate" not in recording.signals.value:
        return
    step = max(1, round(_STEP * recording.filters.rate))
    sensor = recording.rig.sensor_of("imu.attitude")
    turned_round = sensor is not None and sensor.axes == "sensor" and any(sensor.orientation)
    axes = ", in body axes" if turned_round else ""
    keep = _usable(run, "imu.attitude", "imu.rate")
    keep = keep[step:] & keep[:-step]
    rates = run.motion.body.omega
    steps = 0.5 * (rates[:, 1:] + rates[:, :-1]) / recording.filters.rate
    summed = np.concatenate([np.zeros((3, 1)), np.cumsum(steps, axis=1)], axis=1)
    for k, (angle, axis) in enumerate((("roll", "x"), ("pitch", "y"), ("yaw", "z"))):
        by_rate, turned = summed[k, step:] - summed[k, :-step], attitude[k, step:] - attitude[k, :-step]
        slope, alike = _slope(by_rate[keep], turned[keep])
        if alike < -_ALIKE:
            yield f"imu.attitude {angle} turns against imu.rate {axis}{axes}: one of them has the wrong sign"
        elif alike > _ALIKE and not _near(slope):
            guess = _guess(slope, {1 / _DEGREE: "degrees"}) or _guess(slope, {_DEGREE: "°/s"}, "the rate")
            yield f"imu.attitude {angle} turns {slope:.3g} times as fast as imu.rate {axis} says{guess}"


def _cornering(run: PreparedRun) -> Iterator[str]:
    force, velocity = _accel(run), run.motion.velocity
    if force is None or velocity is None or "imu.rate" not in run.recording.signals.value:
        return
    keep = _usable(run, "imu.accel", "imu.rate", "correvit.speed")
    slope, alike = _slope((velocity[0] * run.motion.body.omega[2])[keep], force[1][keep])
    if alike < -_ALIKE:
        yield (
            "imu.accel y is against imu.rate z times the speed: in a left turn both are positive. Look at signs and "
            "axes, and at the sensors' orientation in the rig"
        )
    elif alike > _ALIKE and not _near(slope):
        guess = _guess(slope, {_DEGREE: "°/s"}, "the rate")
        yield f"imu.accel y is {slope:.3g} times imu.rate z times the speed, which should be alike{guess}"


def _pushing(run: PreparedRun) -> Iterator[str]:
    force, names = _accel(run), _present(run, "wheel.{}.force", CORNERS)
    if force is None or len(names) < len(CORNERS):
        return
    keep = _usable(run, "imu.accel", *names)
    total = np.sum([corner.force for corner in run.motion.corners.values()], axis=0)
    alike = np.array([[_slope(force[i][keep], total[k][keep])[1] for i in range(2)] for k in range(2)])
    for k, axis in enumerate("xy"):
        if alike[k, k] < -_ALIKE:
            yield f"the wheel forces' {axis} are against imu.accel {axis}: they should be mass times acceleration"
    if not np.any(np.abs(np.diag(alike)) > _ALIKE) and np.any(np.abs([alike[0, 1], alike[1, 0]]) > _ALIKE):
        yield (
            "the wheel forces' x and y go with imu.accel y and x: is the inertial unit turned by 90°? Look at its "
            "orientation in the rig"
        )


def _leaning(run: PreparedRun) -> Iterator[str]:
    force = _accel(run)
    if force is None:
        return
    for axle, (left, right) in {"front": CORNERS[:2], "rear": CORNERS[2:]}.items():
        names = _present(run, "laser.{}.hub", (left, right))
        keep = _usable(run, "imu.accel", *names)
        if len(names) == 2 and np.any(keep) and float(np.std(force[1][keep])) > _CORNERS:
            lower = run.motion.corners[right].travel - run.motion.corners[left].travel
            if _slope(force[1][keep], lower[keep])[1] < -_ALIKE:
                yield (
                    f"the body leans into the turn at the {axle} axle: its hub lasers look exchanged, left and right, "
                    "or imu.accel y has the wrong sign"
                )


def _steering(run: PreparedRun) -> Iterator[str]:
    velocity, signals = run.motion.velocity, run.recording.signals.value
    front, rear = (_present(run, "camera.{}.steer", corners) for corners in (CORNERS[:2], CORNERS[2:]))
    if velocity is None or not front or "imu.rate" not in signals:
        return
    steer = sum(signals[name][0] / len(names) * sign for names, sign in ((front, 1), (rear, -1)) for name in names)
    keep = (velocity[0] > _ROLLS) & _usable(run, "imu.rate", "correvit.speed", *front, *rear)
    by_steer = np.asarray(velocity[0] * steer / _wheelbase(run))
    slope, alike = _slope(by_steer[keep], run.motion.body.omega[2][keep])
    if alike < -_ALIKE:
        yield "camera steer is against imu.rate z: both are positive to the left"
    elif alike > _ALIKE and slope < 2 * _DEGREE:  # a car that understeers turns less, but never so much less
        yield f"the car turns {slope:.2g} times as fast as its camera steer says: is steer in degrees?"


_CHECKS: tuple[Sequence[_Check], ...] = (
    (_gravity, _weight, _distances, _angles, _rolling),
    (_turning,),
    (_cornering, _pushing, _steering),
    (_leaning,),
)


# -- what they share --------------------------------------------------------------------------------------------------


def _present(run: PreparedRun, pattern: str, corners: Sequence[str]) -> list[str]:
    return [name for c in corners if (name := pattern.format(c)) in run.recording.signals.value]


def _usable(run: PreparedRun, *channels: str) -> NDArray[np.bool_]:
    out = np.ones(run.recording.t.size, bool)
    for channel in channels:
        out &= run.recording.usable.get(channel, True)
    return out


def _accel(run: PreparedRun) -> Array | None:
    """Specific force at the sensor in body axes; not at the body's origin, for which the rates must be right."""
    values = run.recording.signals.value.get("imu.accel")
    if values is None:
        return None
    sensor = run.recording.rig.sensor_of("imu.accel")
    return values if sensor is None or sensor.axes != "sensor" else orientation(sensor.orientation) @ values


def _wheelbase(run: PreparedRun) -> float:
    corners = run.recording.vehicle.corners
    return float(corners["fl"].position[0] - corners["rl"].position[0])


def _large(run: PreparedRun, names: Sequence[str], most: float) -> Iterator[tuple[str, float]]:
    """Channels whose values are mostly larger than `most`, those of a family together, and how large they are."""
    found: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for name in names:
        values = np.abs(run.recording.signals.value[name][:, _usable(run, name)])
        if values.size and (size := float(np.quantile(values, 0.95))) > most:
            found[CHANNELS[name].family][name] = size
    for sizes in found.values():
        yield f"{', '.join(sizes)} {'is' if len(sizes) == 1 else 'are'}", max(sizes.values())


def _near(ratio: float) -> bool:
    """Whether two numbers that should be alike are."""
    return 1 / _TWICE < ratio < _TWICE


def _slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y against x, and their correlation; zeros where there is nothing to tell from."""
    if x.size < _LEAST:
        return 0.0, 0.0
    x, y = x - np.mean(x), y - np.mean(y)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    return (xy / xx, xy / math.sqrt(xx * yy)) if xx > 0.0 and yy > 0.0 else (0.0, 0.0)


def _guess(ratio: float, units: Mapping[float, str], what: str = "it") -> str:
    """The unit that explains a ratio, as a question; nothing where none does."""
    near = [unit for factor, unit in units.items() if 0.75 < ratio / factor < 1.33]
    return f": is {what} in {near[0]}?" if near else ""
