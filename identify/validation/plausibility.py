"""Plausibility of a run before it is fitted: units and signs of its channels.

A table in degrees, in g or in kilonewtons, or with a reversed axis, is fitted without complaint; the model then fails
in every row, and no effect explains it. The checks hold for every car: gravity is 9.81 m/s², wheels roll, attitude is
the integral of its rates, forces are mass times acceleration. Only gross faults are reported: a factor above two, or
the wrong sign.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.car.car_tree import orientation
from lacet.identify.car.rows import TYRE_ROWS, Row
from lacet.identify.car.sources.completion import SPEEDS
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array, dot
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.filters import decimate
from lacet.identify.validation.channels.fault_columns import BLOCKS, FaultColumns, jackknife
from lacet.identify.validation.channels.late_instruments import late_instruments
from lacet.identify.validation.channels.speed_agreement import disagreement, is_compared, usable_samples

_DEGREE: Final = math.pi / 180.0
_TWICE: Final = 2.0
"""Factor, too large or too small, from which a value is implausible."""
_ALIKE: Final = 0.8
"""Correlation from which two signals count as the same quantity."""
_ROLLS: Final = 2.0
"""Speed from which wheel speeds are compared with the road speed [m/s]."""
_STEERING: Final = "steering.angle"
_TURNED: Final = 20.0
"""Angle beyond the stop of any steering wheel, which lorries have at three turns [rad]."""
_FAR: Final = 3.0
"""Distance beyond the range of any laser [m]."""
_LIGHT: Final = 2.0
"""Mass ÷ wheelbase³ below that of any car [kg/m³]; scale models to lorries have 30 to 200."""
_CORNERS: Final = 0.5
"""Lateral acceleration from which the roll of the body is compared with it [m/s², 1 σ]."""
_ROUGH: Final = 0.5
"""Vertical acceleration of the body from which a road shows what wheels weigh [m/s², 1 σ]."""
_OUTSIDE: Final = 5.0
"""Mass between those of no rim and tyre and of the lightest [kg]."""
_SURE: Final = 3.0
"""Distance from `_OUTSIDE` ÷ 1 σ from which a mass is on its side of it."""
_EXPLAINED: Final = 1.0 / 3.0
"""Part of what a tyre's spring leaves of a load that the mass explains, at least. Source: a choice; 0.64 to 0.69 with
the hub's loads, at most 0.15 on ten rough roads with the contact's."""
_OPPOSITE: Final = 0.3
"""Correlation, negative, from which the body turns against its travels at both axles, or on both sides. Source: a
choice; of 18 sound runs of five cars none was negative at both, and one axle at one of them, by 0.13."""
_MINOR: Final = 0.1
"""Part of the roll that a pitch is at least, and the reverse, to be compared with travels: links that raise the body in
a turn, which is no spring's doing, turn it less about the other axis."""
_STIFF: Final = 5.0
"""Roll of the body ÷ roll by the travels of an axle, or the reverse, that no tyre explains. Source: a choice; 25 sound
runs of two cars have 1.06 to 1.26, stiff springs on soft tyres more."""
_QUARTER: Final = 0.25
"""Part of the disagreement of two instruments that a sign leaves, at most, to be the wrong one."""
_STEP: Final = 0.2
"""Time step over which attitude and travels are compared with the integral of the rates [s]."""
_LEAST: Final = 30
"""Least number of samples of a check."""


_AXLES: Final = {"front": ("fr", "fl"), "rear": ("rr", "rl")}
"""Wheels of each axle: that which goes up, and the other, as the body rolls to the right."""


class Symptom(Enum):
    """A kind of implausible channel; `lacet.services.render.plausibility` has the sentence of each."""

    GRAVITY_SIZE = auto()
    GRAVITY_DIRECTION = auto()
    WEIGHT_SIGN = auto()
    WEIGHT_SIZE = auto()
    WHEEL_LOAD_SIGN = auto()
    DISTANCE_SIZE = auto()
    ANGLE_SIZE = auto()
    SPEED_SIZE = auto()
    WHEEL_SPEED_SIZE = auto()
    ATTITUDE_SIGN = auto()
    ATTITUDE_SIZE = auto()
    ATTITUDE_EXCHANGED = auto()
    SPEED_SIDE_SIGN = auto()
    HUB_LOADS = auto()
    CONTACT_LOADS = auto()
    CORNERING_SIGN = auto()
    CORNERING_SIZE = auto()
    FORCE_SIGN = auto()
    INERTIAL_UNIT_TURNED = auto()
    LEANING = auto()
    TRAVEL_SIGN = auto()
    TRAVEL_SIZE = auto()
    ROLL_RATE_SIGN = auto()
    PITCH_RATE_SIGN = auto()
    STEER_SIGN = auto()
    STEER_SIZE = auto()


@dataclass(frozen=True)
class Doubt:
    """An implausible channel: its unit, sign or axes cannot be right.

    Attributes
    ----------
    symptom : the check that failed.
    subject : the channels, or the angle and axis, the axis, or the axles or sides concerned; none where all are.
    value : the value found, in the SI unit of the channel, or as a ratio of two quantities that should be equal.
    other : the value it was compared with.
    guess : the unit that explains the value; empty where none does.
    in_body_axes : whether the sensor's rates were rotated into the body's axes beforehand.
    speed : channel of the road speed that wheel speeds were compared with.
    """

    symptom: Symptom
    subject: tuple[str, ...] = ()
    value: float = math.nan
    other: float = math.nan
    guess: str = ""
    in_body_axes: bool = False
    speed: str = ""


_Check = Callable[[PreparedRun], Iterator[Doubt]]


def doubtful_channels(run: PreparedRun) -> list[Doubt]:
    """Channels whose unit, sign or axes cannot be right; empty where every check passes.

    Checks that compare channels run only where each of these by itself passes, so that a fault is not reported twice.
    Turns and travels that are opposite as one of them is late have no wrong sign. Source: the conventions of
    ``docs/channels.md``.
    """
    seen = run.overview()
    out: list[Doubt] = []
    doubtful: set[str] = set()
    for checks in _CHECKS:
        found = {check: list(check(seen)) for check, quantities in checks.items() if not doubtful & quantities}
        if found.get(_tilting) and _has_late_instrument(run):
            continue
        out += [doubt for each in found.values() for doubt in each]
        doubtful |= {quantity for check, each in found.items() if each for quantity in checks[check]}
    return out


def _has_late_instrument(run: PreparedRun) -> bool:
    """Whether the equations of wheel loads show an instrument that is late."""
    piece = next(iter(run.pieces()))
    products = None if all(row.combined for row in piece.rows) else FaultColumns.of(piece)
    return products is not None and late_instruments(piece, products) is not None


# -- checks of one channel --------------------------------------------------------------------------------------------


def _gravity(run: PreparedRun) -> Iterator[Doubt]:
    force = _accel(run)
    if force is None:
        return
    force = force[:, _usable(run, "imu.accel")]
    if force.shape[1] < _LEAST:
        return
    size, up = float(np.median(np.linalg.norm(force, axis=0))), float(np.median(force[2]))
    if not _near(size / STANDARD_GRAVITY):
        guess = _guess(size / STANDARD_GRAVITY, {1 / STANDARD_GRAVITY: "g", 1e3: "mm/s²", 3.281: "ft/s²"})
        yield Doubt(Symptom.GRAVITY_SIZE, value=size, guess=guess)
    elif up < 0.5 * size:
        yield Doubt(Symptom.GRAVITY_DIRECTION, value=up)


def _weight(run: PreparedRun) -> Iterator[Doubt]:
    names = _present(run, "wheel.{}.force", CORNERS)
    keep = _usable(run, *names)
    if len(names) < len(CORNERS) or np.count_nonzero(keep) < _LEAST:
        return
    loads = np.sum([corner.load for corner in run.outline.corners.values()], axis=0)
    weight = float(np.median(loads[keep]))
    each = {c: float(np.median(corner.load[keep])) for c, corner in run.outline.corners.items()}
    upward = [f"wheel.{c}.force" for c, load in each.items() if load < 0.0]
    if weight < 0.0:
        yield Doubt(Symptom.WEIGHT_SIGN, value=weight)
    elif weight / STANDARD_GRAVITY < _LIGHT * _wheelbase(run) ** 3:
        yield Doubt(Symptom.WEIGHT_SIZE, value=weight, other=weight / STANDARD_GRAVITY, guess="kN")
    elif upward:
        yield Doubt(Symptom.WHEEL_LOAD_SIGN, tuple(upward))


def _distances(run: PreparedRun) -> Iterator[Doubt]:
    for names, size in _large(run, [n for n in run.recording.signals.value if CHANNELS[n].unit == "m"], _FAR):
        unit = "mm" if size > 150.0 else "cm" if size > 29.0 else "inches"
        yield Doubt(Symptom.DISTANCE_SIZE, names, size, guess=unit)


def _angles(run: PreparedRun) -> Iterator[Doubt]:
    families = ("camera.steer", "camera.camber")
    cameras = [name for name in run.recording.signals.value if CHANNELS[name].family in families]
    wheel = [_STEERING] if _STEERING in run.recording.signals.value else []
    for names, size in (*_large(run, cameras, 1.2), *_large(run, wheel, _TURNED)):
        yield Doubt(Symptom.ANGLE_SIZE, names, size, guess="degrees")


def _rolling(run: PreparedRun) -> Iterator[Doubt]:
    speed, forwards = _forwards(run)
    keep = _usable(run, speed)
    if forwards is None or np.count_nonzero(keep) < _LEAST:
        return
    over = _mean(forwards, keep)
    rims = {
        name: _mean(run.recording.signals.value[name][0], keep & _usable(run, name))
        * run.recording.vehicle.corners[name.split(".")[1]].tyre_radius
        for name in _present(run, "wheel.{}.speed", CORNERS)
        if np.any(keep & _usable(run, name))
    }
    wrong = {name: rim for name, rim in rims.items() if not _near(rim / over)} if abs(over) > _ROLLS else {}
    rim = float(np.median(list(wrong.values()) or [0.0]))
    of_speed = _guess(over / rim, {3.6: "km/h", 2.237: "mph"}) if rim else ""
    if of_speed and len(wrong) == len(rims):  # where all wheels disagree alike, the road speed is at fault
        yield Doubt(Symptom.SPEED_SIZE, value=over, other=rim, guess=of_speed, speed=speed)
    elif wrong:
        guess = _guess(rim / over, {60 / math.tau: "1/min", 1 / math.tau: "revolutions a second", 1 / _DEGREE: "°/s"})
        yield Doubt(Symptom.WHEEL_SPEED_SIZE, tuple(wrong), rim, over, guess, speed=speed)


# -- checks of one channel against another ----------------------------------------------------------------------------


def _turning(run: PreparedRun) -> Iterator[Doubt]:
    attitude, recording = run.outline.attitude, run.recording
    derived = "imu.attitude" in recording.sources  # from the rates themselves
    if attitude is None or derived or "imu.rate" not in recording.signals.value:
        return
    step = _step(run)
    sensor = recording.rig.sensor_of("imu.attitude")
    turned_round = sensor is not None and sensor.axes == "sensor" and any(sensor.orientation)
    keep = _usable(run, "imu.attitude", "imu.rate")
    keep = keep[step:] & keep[:-step]
    by_rate = _turned(run)
    angles = attitude[:2, step:] - attitude[:2, :-step]
    alike = np.array([[_slope(by_rate[i, keep], angle[keep])[1] for i in range(2)] for angle in angles])
    if np.all(np.abs(alike[[0, 1], [1, 0]]) > _ALIKE) and not np.any(np.abs(np.diag(alike)) > _ALIKE):
        yield Doubt(Symptom.ATTITUDE_EXCHANGED)
        return
    for k, (angle, axis) in enumerate((("roll", "x"), ("pitch", "y"), ("yaw", "z"))):
        turned = attitude[k, step:] - attitude[k, :-step]
        slope, alike = _slope(by_rate[k, keep], turned[keep])
        if alike < -_ALIKE:
            yield Doubt(Symptom.ATTITUDE_SIGN, (angle, axis), in_body_axes=turned_round)
        elif alike > _ALIKE and not _near(slope):
            guess = _guess(slope, {1 / _DEGREE: "degrees", _DEGREE: "°/s"})
            yield Doubt(Symptom.ATTITUDE_SIZE, (angle, axis), slope, guess=guess)


def _cornering(run: PreparedRun) -> Iterator[Doubt]:
    force, (speed, forwards) = _accel(run), _forwards(run)
    if force is None or forwards is None or "imu.rate" not in run.recording.signals.value:
        return
    keep = _usable(run, "imu.accel", "imu.rate", speed)
    slope, alike = _slope((forwards * run.outline.omega[2])[keep], force[1][keep])
    if alike < -_ALIKE:
        yield Doubt(Symptom.CORNERING_SIGN)
    elif alike > _ALIKE and not _near(slope):
        yield Doubt(Symptom.CORNERING_SIZE, value=slope, guess=_guess(slope, {_DEGREE: "°/s"}))


def _sliding(run: PreparedRun) -> Iterator[Doubt]:
    """The speed to the side, of which the rate is what acceleration, yaw rate and attitude leave for it."""
    recording = run.recording
    if not is_compared(recording):
        return
    value = dict(recording.signals.value)
    value["correvit.speed"] = value["correvit.speed"] * np.array([[1.0], [-1.0]])
    changed = recording.signals.changed(value, recording.filters.rate)
    keep = usable_samples(recording)
    own, opposite = (float(np.var(disagreement(recording, one)[1, keep])) for one in (recording.signals, changed))
    if opposite < _QUARTER * own:
        yield Doubt(Symptom.SPEED_SIDE_SIGN, ("correvit.speed.y",))


def _pushing(run: PreparedRun) -> Iterator[Doubt]:
    force, names = _accel(run), _present(run, "wheel.{}.force", CORNERS)
    if force is None or len(names) < len(CORNERS):
        return
    keep = _usable(run, "imu.accel", *names)
    total = np.sum([corner.force for corner in run.outline.corners.values()], axis=0)
    alike = np.array([[_slope(force[i][keep], total[k][keep])[1] for i in range(2)] for k in range(2)])
    for k, axis in enumerate("xy"):
        if alike[k, k] < -_ALIKE:
            yield Doubt(Symptom.FORCE_SIGN, (axis,))
    if not np.any(np.abs(np.diag(alike)) > _ALIKE) and np.any(np.abs([alike[0, 1], alike[1, 0]]) > _ALIKE):
        yield Doubt(Symptom.INERTIAL_UNIT_TURNED)


def _reference(run: PreparedRun) -> Iterator[Doubt]:
    """Wheel loads of the other reference: on a rough road those of the hub lack what rim and tyre outside weigh."""
    rows = [row for row in TYRE_ROWS if row in run.rows]
    force = _accel(run)
    if len(rows) < len(TYRE_ROWS) or force is None or _deviation(force[2, _usable(run, "imu.accel")]) < _ROUGH:
        return
    masses = [_mass_outside(run, row) for row in rows]
    mean = float(np.mean([one.mass for one in masses]))
    if run.recording.reference == "hub":
        if all(abs(one.mass) + _SURE * one.sigma < _OUTSIDE for one in masses):
            yield Doubt(Symptom.CONTACT_LOADS, value=mean)
    elif all(one.mass - _SURE * one.sigma > _OUTSIDE and one.part > _EXPLAINED for one in masses):
        yield Doubt(Symptom.HUB_LOADS, value=mean)


@dataclass(frozen=True)
class _MassOutside:
    """Mass that a wheel's load lacks in its own acceleration, and 1 σ [kg]; the part of what a tyre spring leaves of
    the load that it explains."""

    mass: float
    sigma: float
    part: float


def _mass_outside(run: PreparedRun, row: Row) -> _MassOutside:
    wheel = run.motion.corners[row.place]
    load = run.outline.tyres[row]
    series = np.stack([np.ones_like(load), wheel.deflection, -dot(wheel.centre_accel, wheel.normal), load])
    table = decimate(series, run.outline.filters, run.index[row])
    parts = np.stack([part @ part.T for part in np.array_split(table, BLOCKS, axis=1)])
    whole = parts.sum(axis=0)

    def fitted(gram: Array, count: int) -> tuple[Array, float]:
        """Coefficients of the first series, and the squares of the load that they leave."""
        found = np.asarray(np.linalg.lstsq(gram[:count, :count], gram[:count, 3], rcond=None)[0], float)
        return found, float(gram[3, 3] - gram[3, :count] @ found)

    found, both = fitted(whole, 3)
    _, spring = fitted(whole, 2)
    each = np.array([fitted(whole - part, 3)[0][2] for part in parts])
    return _MassOutside(
        float(found[2]), float(jackknife(each[:, None])[0]), 1.0 - both / spring if spring > 0.0 else 0.0
    )


def _leaning(run: PreparedRun) -> Iterator[Doubt]:
    force = _accel(run)
    if force is None:
        return
    for axle, (left, right) in {"front": CORNERS[:2], "rear": CORNERS[2:]}.items():
        names = [name for c in (left, right) for name in _travels(run, c)[:1]]
        keep = _usable(run, "imu.accel", *names)
        if len(names) == 2 and np.any(keep) and float(np.std(force[1][keep])) > _CORNERS:
            lower = run.outline.corners[right].travel - run.outline.corners[left].travel
            if _slope(force[1][keep], lower[keep])[1] < -_ALIKE:
                yield Doubt(Symptom.LEANING, (axle,))


def _steering_wheel(run: PreparedRun) -> Iterator[Doubt]:
    """The steering wheel's sign, also without a speed: a car that is driven forwards turns where it is steered."""
    values, (speed, forwards) = run.recording.signals.value, _forwards(run)
    if _STEERING not in values or "imu.rate" not in values:
        return
    keep = _usable(run, "imu.rate", _STEERING, *([speed] if speed else []))
    keep &= np.ones_like(keep) if forwards is None else forwards > _ROLLS
    if _slope(values[_STEERING][0][keep], run.outline.omega[2][keep])[1] < -_ALIKE:
        yield Doubt(Symptom.STEER_SIGN, (_STEERING,))


def _steering(run: PreparedRun) -> Iterator[Doubt]:
    (speed, forwards), signals = _forwards(run), run.recording.signals.value
    front, rear = (_present(run, "camera.{}.steer", corners) for corners in (CORNERS[:2], CORNERS[2:]))
    if forwards is None or not front or "imu.rate" not in signals:
        return
    steer = sum(signals[name][0] / len(names) * sign for names, sign in ((front, 1), (rear, -1)) for name in names)
    keep = (forwards > _ROLLS) & _usable(run, "imu.rate", speed, *front, *rear)
    by_steer = np.asarray(forwards * steer / _wheelbase(run))
    slope, alike = _slope(by_steer[keep], run.outline.omega[2][keep])
    if alike < -_ALIKE:
        yield Doubt(Symptom.STEER_SIGN)
    elif alike > _ALIKE and slope < 2 * _DEGREE:  # far below what understeer explains
        yield Doubt(Symptom.STEER_SIZE, value=slope, guess="degrees")


def _tilting(run: PreparedRun) -> Iterator[Doubt]:
    if "imu.rate" not in run.recording.signals.value:
        return
    roll, pitch = _turning_with(run, 0, _AXLES), _turning_with(run, 1, {"left": ("fl", "rl"), "right": ("fr", "rr")})
    against = [len(of) == 2 and all(alike < -_OPPOSITE for alike in of.values()) for of in (roll, pitch)]
    if all(against):
        yield Doubt(Symptom.TRAVEL_SIGN)
        return
    force, usable = _accel(run), _usable(run, "imu.accel")
    for symptom, of, whole, axis in (
        (Symptom.ROLL_RATE_SIGN, roll, against[0], 1), (Symptom.PITCH_RATE_SIGN, pitch, against[1], 0)
    ):  # fmt: skip
        driven = force is not None and _deviation(force[axis, usable]) > _CORNERS
        places = tuple(place for place, alike in of.items() if driven and alike < -_ALIKE)
        if whole or places:
            yield Doubt(symptom, () if whole or len(of) == 1 else places)


def _deviation(values: Array) -> float:
    """Standard deviation; 0 of nothing, as where every sample of a channel is flagged."""
    return float(np.std(values)) if values.size else 0.0


def _turning_with(run: PreparedRun, axis: int, pairs: Mapping[str, tuple[str, str]]) -> dict[str, float]:
    """Correlation of the body's turns with the difference of two travels, by pair; 0 where it hardly turns.

    Springs turn the body back towards its wheels, so that on any road not both pairs are negative. One may be on a rig
    that lifts the wheels of one axle alone, but not in a manoeuvre.
    """
    out: dict[str, float] = {}
    for place, change, turned in _changes(run, pairs):
        most = float(np.max(np.std(turned[:2], axis=1)))
        out[place] = _slope(change, turned[axis])[1] if float(np.std(turned[axis])) > _MINOR * most else 0.0
    return out


def _changes(run: PreparedRun, pairs: Mapping[str, tuple[str, str]]) -> Iterator[tuple[str, Array, Array]]:
    """Of each pair of corners the change (n,) of the travels' difference [m] and the body's turns (3, n) in a step."""
    step, turned = _step(run), _turned(run)
    for place, (lower, higher) in pairs.items():
        channels = [name for c in (lower, higher) for name in _travels(run, c)[:1]]
        keep = _usable(run, "imu.rate", *channels)
        keep = keep[step:] & keep[:-step]
        if len(channels) == 2 and np.count_nonzero(keep) >= _LEAST:
            difference = run.outline.corners[lower].travel - run.outline.corners[higher].travel
            yield place, (difference[step:] - difference[:-step])[keep], turned[:, keep]


def _rolling_as_far(run: PreparedRun) -> Iterator[Doubt]:
    """Travels in another unit or scale: in turns the body rolls as its travels differ, and as its tyres give.

    In turns the car yaws as it is pushed aside; on a rig that rolls it by its wheels it does not.
    """
    force, usable = _accel(run), _usable(run, "imu.accel", "imu.rate")
    if force is None or "imu.rate" not in run.recording.signals.value or _deviation(force[1, usable]) < _CORNERS:
        return
    if _slope(run.outline.omega[2][usable], force[1, usable])[1] < _ALIKE:
        return
    found: dict[str, float] = {}
    for axle, change, turned in _changes(run, _AXLES):
        left, right = (run.recording.vehicle.corners[c].position[1] for c in reversed(_AXLES[axle]))
        slope, alike = _slope(change / (left - right), turned[0])
        if alike > _ALIKE and not 1.0 / _STIFF < slope < _STIFF:
            found[axle] = slope
    if found:
        yield Doubt(Symptom.TRAVEL_SIZE, tuple(found), float(np.mean(list(found.values()))))


_CHECKS: tuple[Mapping[_Check, Set[str]], ...] = (
    {
        _gravity: {"accel"}, _weight: {"loads"}, _distances: {"travels"}, _angles: {"cameras", "steering"},
        _rolling: {"speed", "wheel speeds"},
    },
    {_turning: {"rate", "attitude"}},
    {
        _cornering: {"accel", "rate", "speed"}, _sliding: {"accel", "rate", "attitude", "speed"},
        _pushing: {"accel", "loads"}, _steering: {"cameras", "rate", "speed"},
        _steering_wheel: {"steering", "rate", "speed"},
    },
    {_leaning: {"accel", "travels"}, _reference: {"accel", "loads", "travels"}},
    {_tilting: {"accel", "rate", "travels"}},
    {_rolling_as_far: {"accel", "rate", "travels"}},
)  # fmt: skip
"""Checks with the quantities that each judges or compares, one level after another."""


# -- shared by the checks ---------------------------------------------------------------------------------------------


def _present(run: PreparedRun, pattern: str, corners: Sequence[str]) -> list[str]:
    return [name for c in corners if (name := pattern.format(c)) in run.recording.signals.value]


def _travels(run: PreparedRun, corner: str) -> list[str]:
    """The channels that measure a corner's travel."""
    return [name for kind in ("laser.{}.hub", "damper.{}.travel") for name in _present(run, kind, (corner,))]


def _forwards(run: PreparedRun) -> tuple[str, Array | None]:
    """The channel of the road speed and its component forwards (N,) [m/s]; None without one."""
    values, velocity = run.recording.signals.value, run.outline.velocity
    speed = next((name for name in SPEEDS if name in values), "")
    if not speed:
        return "", None
    return speed, values[speed][0] if velocity is None else velocity[0]


def _step(run: PreparedRun) -> int:
    """Samples over which turns are compared."""
    return max(1, round(_STEP * run.recording.filters.rate))


def _turned(run: PreparedRun) -> Array:
    """(3, N - step) angles by which the body turns within a step, by its rates [rad]."""
    rates, step = run.outline.omega, _step(run)
    steps = 0.5 * (rates[:, 1:] + rates[:, :-1]) / run.recording.filters.rate
    summed = np.concatenate([np.zeros((3, 1)), np.cumsum(steps, axis=1)], axis=1)
    return summed[:, step:] - summed[:, :-step]


def _usable(run: PreparedRun, *channels: str) -> NDArray[np.bool_]:
    out = np.ones(run.recording.t.size, bool)
    for channel in channels:
        out &= run.recording.usable.get(channel, True)
    return out


def _mean(series: Array, keep: NDArray[np.bool_]) -> float:
    return float(np.mean(series[keep]))


def _accel(run: PreparedRun) -> Array | None:
    """Specific force at the sensor in body axes; not moved to the body's origin, which would need correct rates."""
    values = run.recording.signals.value.get("imu.accel")
    if values is None:
        return None
    sensor = run.recording.rig.sensor_of("imu.accel")
    return values if sensor is None or sensor.axes != "sensor" else orientation(sensor.orientation) @ values


def _wheelbase(run: PreparedRun) -> float:
    corners = run.recording.vehicle.corners
    return float(corners["fl"].position[0] - corners["rl"].position[0])


def _large(run: PreparedRun, names: Sequence[str], most: float) -> Iterator[tuple[tuple[str, ...], float]]:
    """Families of channels whose values mostly exceed `most`, and their size."""
    found: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for name in names:
        values = np.abs(run.recording.signals.value[name][:, _usable(run, name)])
        if values.size and (size := float(np.quantile(values, 0.95))) > most:
            found[CHANNELS[name].family][name] = size
    for sizes in found.values():
        yield tuple(sizes), max(sizes.values())


def _near(ratio: float) -> bool:
    """Whether a ratio is within a factor of two of 1."""
    return 1 / _TWICE < ratio < _TWICE


def _slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y against x, and their correlation; zeros where there are too few samples."""
    if x.size < _LEAST:
        return 0.0, 0.0
    x, y = x - float(np.mean(x)), y - float(np.mean(y))
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    return (xy / xx, xy / math.sqrt(xx * yy)) if xx > 0.0 and yy > 0.0 else (0.0, 0.0)


def _guess(ratio: float, units: Mapping[float, str]) -> str:
    """The unit that explains a ratio; empty where none does."""
    near = [unit for factor, unit in units.items() if 0.75 < ratio / factor < 1.33]
    return near[0] if near else ""
