"""States of the car that a row's residual may depend on, as time series beside the motion.

A state is a measured quantity that a missing force could depend on: travel and its rate, the difference across the
axle, tyre deflection, steer, accelerations, speed. Those of the row's own corner come first, then those of its axle,
then those of the body. Series are at full rate, as the motion is; for a comparison with a residual they are filtered
as the residual is, functions of them too: the function first, then the filter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.set_aside import ArraysOnDisk, DiskSpace, JoinedOnDisk
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.decimation import decimated
from lacet.identify.signals.filters import zero_phase_of
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals

OWN, AXLE, BODY = 0, 1, 2
"""Distance of a state from a row: at its own corner, across its axle, of the body."""
LEAST_SPEED = 2.0
"""Speed below which side slip is set to zero [m/s]."""
NOISY = 0.02
"""Largest part of a state's variance that may be its channels' noise.

Above it a residual, which holds the same noise, would depend on the state though nothing is missing."""
BLUR = 3.0
"""Standard deviation of the noise added to the states ÷ that of their own."""


@dataclass(frozen=True)
class State:
    """A state of the car along a run.

    Attributes
    ----------
    name : as shown, ``travel rate``; with the corner where it is another's.
    unit : SI.
    near : `OWN`, `AXLE` or `BODY`.
    series : (N,) at full rate.
    velocity : whether its sign is a direction of motion, as friction sees it.
    in_left_side : whether the row's left side is computed from it: the residual then holds its noise, so that it is
        shown but never counted as a dependence.
    """

    name: str
    unit: str
    near: int
    series: Array
    velocity: bool = False
    in_left_side: bool = False


def across(corner: str) -> str:
    """The other corner of the axle."""
    return corner[0] + ("r" if corner[1] == "l" else "l")


def states_of(motion: Motion, row: Row) -> dict[str, State]:
    """The states that belong to a row, nearest first, by name; without those that are constant or not measured."""
    return {state.name: state for state in _every_state(motion, row) if _moves(state.series)}


def _moves(series: Array) -> bool:
    """Whether a series is measured throughout and not constant."""
    return bool(np.all(np.isfinite(series)) and np.ptp(series) > 0.0)


def _every_state(motion: Motion, row: Row) -> list[State]:
    if row.corner is None:
        return _body(motion)
    return [*_corner(motion, row.corner, row.kind), *_body_seen_at_a_corner(motion)]


def _corner(motion: Motion, corner: str, kind: str) -> list[State]:
    own, other = motion.corners[corner], motion.corners[across(corner)]
    return [
        State("travel", "m", OWN, own.travel),
        State("travel rate", "m/s", OWN, own.rate, velocity=True),
        State("tyre deflection", "m", OWN, own.deflection),
        State("deflection rate", "m/s", OWN, own.deflection_rate, velocity=True),
        State("steer", "rad", OWN, own.steer),
        State("camber", "rad", OWN, own.camber),
        State(_WHEEL_LOAD, "N", OWN, own.force[2], in_left_side=kind in _WITH_WHEEL_LOAD),
        State("longitudinal wheel force", "N", OWN, own.force[0]),
        State("lateral wheel force", "N", OWN, own.force[1]),
        State("wheel speed", "rad/s", OWN, own.spin, velocity=True),
        State("travel difference across the axle", "m", AXLE, own.travel - other.travel),
        State("rate difference across the axle", "m/s", AXLE, own.rate - other.rate, velocity=True),
    ]


def _body_seen_at_a_corner(motion: Motion) -> list[State]:
    return [s for s in _body(motion) if s.name not in _BODY_ALONE]


_MODES = ("heave", "roll of the wheels", "pitch of the wheels", "warp")
_BODY_ALONE = ("front steer", *_MODES)
"""States of the body that rows of a corner do not have."""
_WHEEL_LOAD, _WITH_WHEEL_LOAD = "vertical wheel load", ("suspension", "tyre")
"""The state that the left sides of these kinds of rows are computed from."""
_SIGNS = np.array([[1, 1, 1, 1], [1, -1, 1, -1], [-1, -1, 1, 1], [1, -1, -1, 1]]) / 4.0


def _body(motion: Motion) -> list[State]:
    out: list[State] = []
    for k, which in enumerate(("longitudinal", "lateral", "vertical")):
        out.append(State(f"{which} acceleration", "m/s²", BODY, motion.body.accel[k]))
    for k, which in enumerate(("roll", "pitch", "yaw")):
        out.append(State(f"{which} rate", "rad/s", BODY, motion.body.omega[k], velocity=True))
    for k, which in enumerate(("roll", "pitch", "yaw")):
        out.append(State(f"{which} acceleration", "rad/s²", BODY, motion.body.omega_dot[k]))
    if motion.attitude is not None:
        out += [State(f"{which} angle", "rad", BODY, motion.attitude[k]) for k, which in enumerate(("roll", "pitch"))]
    if motion.velocity is not None:
        forward, left = motion.velocity[0], motion.velocity[1]
        out.append(State("speed", "m/s", BODY, np.hypot(forward, left)))
        slip = np.where(np.abs(forward) > LEAST_SPEED, np.arctan2(left, np.abs(forward)), 0.0)
        out.append(State("side slip", "rad", BODY, slip))
    corners = [motion.corners[c] for c in CORNERS if c in motion.corners]
    if len(corners) == len(CORNERS):
        travel, rate = (_SIGNS @ _stacked(corners, part) for part in ("travel", "rate"))
        out += [State(name, "m", BODY, series) for name, series in zip(_MODES, travel, strict=True)]
        out += [State(f"{n}, rate", "m/s", BODY, s, velocity=True) for n, s in zip(_MODES, rate, strict=True)]
        out.append(State("front steer", "rad", BODY, 0.5 * (corners[0].steer + corners[1].steer)))
    return out


def _stacked(corners: Sequence[CornerMotion], part: str) -> Array:
    return np.stack([np.asarray(getattr(corner, part), float) for corner in corners])


def filtered_states(run: PreparedRun, row: Row, names: Sequence[str]) -> dict[str, Array]:
    """Name → (n,) states of a row through the parallel filter, at the samples of the row's residual."""

    def pick(motion: Motion) -> Array:
        found = {state.name: state.series for state in _every_state(motion, row)}
        return np.stack([found[name] for name in names])

    return dict(zip(names, run.filtered(row, pick), strict=True)) if names else {}


class ClearStates:
    """States with little noise that the residuals of some runs are tested against, with noise added to them.

    A residual and the states share the channels' noise: where several states together determine what one of them ought
    to be, its noise is known from them, and the residual would appear to depend on the states though nothing is
    missing. So `BLUR` times their own noise is added to the states, drawn from the sensor sheet for all channels
    together: of a residual made of noise no more than 1 ÷ (1 + `BLUR`²) can then be predicted.

    Left out: states of only some of the runs, those that a row's left side is computed from, and those of whose
    variance more than `NOISY` is noise.
    """

    def __init__(self, runs: Sequence[PreparedRun], seed: int = 0):
        self.runs, self._seed = tuple(runs), seed
        self._made: dict[int, _StatesOnDisk] = {}
        self._names: dict[Row, tuple[str, ...]] = {}

    def names(self, row: Row) -> tuple[str, ...]:
        """Names of a row's states, nearest first."""
        if row not in self._names:
            self._names[row] = tuple(self._clear(row))
        return self._names[row]

    def _clear(self, row: Row) -> Iterator[str]:
        having = [i for i, run in enumerate(self.runs) if row in run.index]
        each = [self._of(i) for i in having]
        for key in each[0].of_row(row) if each else ():
            if (row.kind in _WITH_WHEEL_LOAD and key[1] == _WHEEL_LOAD) or not all(key in run.states for run in each):
                continue
            parts = [run.filtered(key)[:, self.runs[i].kept(row)] for i, run in zip(having, each, strict=True)]
            total, noise = np.concatenate(parts, axis=1).var(axis=1)
            if total > 0.0 and noise <= NOISY * total:
                yield key[1]

    def blurred(self, run: int, row: Row, name: str) -> State:
        """One of a row's states on one of the runs, with noise added."""
        made = self._of(run)
        return made.blurred(made.of_name(row, name))

    def filtered(self, run: int, row: Row, names: Sequence[str]) -> Array:
        """(…, n) some of a row's states with noise added, through the parallel filter, at the row's samples."""
        made, kept = self._of(run), self.runs[run].kept(row)
        found = [np.array([1.0, BLUR]) @ made.filtered(made.of_name(row, name))[:, kept] for name in names]
        return np.stack(found) if found else np.zeros((0, kept.size))

    def _of(self, run: int) -> _StatesOnDisk:
        if run not in self._made:
            self._made[run] = _StatesOnDisk.of(self.runs[run], [self._seed, 11, run])
        return self._made[run]


_Key = tuple[str, str]
"""Corner, empty for the body, and name of a state."""


@dataclass(frozen=True)
class _StatesOnDisk:
    """The states of a run that move, each with one draw of its noise through the parallel filter, on disk.

    `states` : without their series; `full` : state → (2, N) series and noise at full rate; `combed` : state → (2, n)
    both through the parallel filter, at the instants of `PreparedRun.comb`.
    """

    states: Mapping[_Key, State]
    full: JoinedOnDisk[_Key]
    combed: ArraysOnDisk[_Key]

    @classmethod
    def of(cls, run: PreparedRun, seed: Sequence[int]) -> _StatesOnDisk:
        """The states of all rows of a run, made in one pass over its pieces."""
        corners = list(dict.fromkeys(row.corner or "" for row in run.rows))
        parts: list[ArraysOnDisk[_Key]] = []
        ranges: dict[_Key, Array] = {}
        states: dict[_Key, State] = {}
        space = DiskSpace()
        for number, (piece, own) in enumerate(run.every_piece()):
            before = dict(_by_key(piece.motion, corners))
            noisy = _with_noise(piece.recording, [*seed, *([number] if number else [])])
            moved = np.stack([state.series - before[key].series for key, state in _by_key(noisy, corners)])
            there = np.all(np.isfinite(moved), axis=1)
            moved[there] = zero_phase_of(moved[there], piece.recording.filters)
            both = {
                key: np.stack([state.series[own], one[own]])
                for (key, state), one in zip(before.items(), moved, strict=True)
            }
            parts.append(space.put(both))
            for key, pair in both.items():
                found = np.stack([pair.min(axis=1), pair.max(axis=1)])
                known = ranges.get(key, found)
                ranges[key] = np.stack([np.minimum(known[0], found[0]), np.maximum(known[1], found[1])])
            states = {key: replace(state, series=np.zeros(0)) for key, state in before.items()}
        # What stands still in one piece may move in another: the whole run decides.
        moving = {key: states[key] for key, ends in ranges.items() if np.isfinite(ends).all() and np.ptp(ends[:, 0])}
        full = JoinedOnDisk(parts)
        combed = space.put_each((key, decimated(full[key], run.recording.filters)) for key in moving)
        return cls(moving, full, combed)

    def of_row(self, row: Row) -> list[_Key]:
        """The states that belong to a row, nearest first."""
        own = [key for key in self.states if row.corner and key[0] == row.corner]
        return own + [key for key in self.states if not key[0] and not (row.corner and key[1] in _BODY_ALONE)]

    def of_name(self, row: Row, name: str) -> _Key:
        """The state of a name that belongs to a row."""
        own = (row.corner or "", name)
        return own if own in self.states else ("", name)

    def blurred(self, key: _Key) -> State:
        """A state with noise added."""
        series, noise = self.full[key]
        return replace(self.states[key], series=series + BLUR * noise)

    def filtered(self, key: _Key) -> Array:
        """(2, n) a state and its noise through the parallel filter."""
        return self.combed[key]


def _by_key(motion: Motion, corners: Iterable[str]) -> Iterator[tuple[_Key, State]]:
    """The states of corners and of the body."""
    for corner in corners:
        for state in _corner(motion, corner, "") if corner else ():
            yield (corner, state.name), state
    for state in _body(motion):
        yield ("", state.name), state


def _with_noise(recording: Recording, seed: Sequence[int]) -> Motion:
    """The motion of a run with one more draw of the sensor sheet's noise."""
    values = recording.signals.value
    noise = draw_noise(recording, values, np.random.default_rng(seed))
    moved = Signals.differentiated({name: values[name] + noise[name] for name in values}, recording.filters.rate)
    return build_motion(recording.with_signals(moved))
