"""States of the car that a row's residual may depend on, as time series beside the motion.

A state is a measured quantity that a missing force could depend on: travel and its rate, the difference across the
axle, tyre deflection, steer, accelerations, speed. Those of the row's own corner come first, then those of its axle,
then those of the body. Series are at full rate, as the motion is; for a comparison with a residual they are filtered
as the residual is (`filtered`), functions of them too: the function first, then the filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
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
        State("vertical wheel load", "N", OWN, own.force[2], in_left_side=kind in ("suspension", "tyre")),
        State("longitudinal wheel force", "N", OWN, own.force[0]),
        State("lateral wheel force", "N", OWN, own.force[1]),
        State("wheel speed", "rad/s", OWN, own.spin, velocity=True),
        State("travel difference across the axle", "m", AXLE, own.travel - other.travel),
        State("rate difference across the axle", "m/s", AXLE, own.rate - other.rate, velocity=True),
    ]


def _body_seen_at_a_corner(motion: Motion) -> list[State]:
    return [s for s in _body(motion) if s.name not in ("front steer", *_MODES)]


_MODES = ("heave", "roll of the wheels", "pitch of the wheels", "warp")
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


def filtered(run: PreparedRun, row: Row, series: Array) -> Array:
    """(…, n): full-rate series (…, N) through the parallel filter, at the samples of the row's residual."""
    return run.decimated({row: series})[row]


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
        self._noisy: dict[int, Motion] = {}
        self._known: dict[tuple[int, str], dict[str, tuple[State, Array]]] = {}

    def names(self, row: Row) -> tuple[str, ...]:
        """Names of a row's states, nearest first."""
        having = [i for i, run in enumerate(self.runs) if row in run.index]
        if not having:
            return ()
        each = [self._states(i, row) for i in having]
        names = [n for n, (s, _) in each[0].items() if not s.in_left_side and all(n in other for other in each)]
        if not names:
            return ()
        values = [np.stack([states[n][0].series for n in names]) for states in each]
        noise = [np.stack([states[n][1] for n in names]) for states in each]
        both = [
            filtered(self.runs[i], row, np.concatenate(pair))
            for i, pair in zip(having, zip(values, noise, strict=True), strict=True)
        ]
        value, own = np.split(np.concatenate(both, axis=1), 2)
        total = value.var(axis=1)
        return tuple(
            n for n, v, all_ in zip(names, own.var(axis=1), total, strict=True) if all_ > 0.0 and v <= NOISY * all_
        )

    def blurred(self, run: int, row: Row, names: Sequence[str]) -> dict[str, State]:
        """Some of a row's states on one of the runs, with noise added."""
        states = self._states(run, row)
        return {n: replace(states[n][0], series=states[n][0].series + BLUR * states[n][1]) for n in names}

    def _states(self, run: int, row: Row) -> dict[str, tuple[State, Array]]:
        """States of a row and one draw of their noise, low-pass filtered as the fit is."""
        key = run, "chassis" if row.corner is None else row
        if key not in self._known:
            # At full rate: of a long run only those of the row asked for last.
            self._known = {k: states for k, states in self._known.items() if not self.runs[k[0]].is_long or k[0] != run}
            self._known[key] = self._made(run, row)
        return self._known[key]

    def _made(self, run: int, row: Row) -> dict[str, tuple[State, Array]]:
        # What stands still in one piece may move in another: the whole run decides.
        series: dict[str, list[Array]] = {}
        noise: dict[str, list[Array]] = {}
        states: dict[str, State] = {}
        for number, (piece, own) in enumerate(self.runs[run].every_piece()):
            before = {state.name: state for state in _every_state(piece.motion, row)}
            after = {state.name: state.series for state in _every_state(self._with_noise(run, number, piece), row)}
            moved = np.stack([after[name] - state.series for name, state in before.items()])
            there = np.all(np.isfinite(moved), axis=1)
            moved[there] = zero_phase_of(moved[there], piece.recording.filters)
            for (name, state), one in zip(before.items(), moved, strict=True):
                states[name] = state
                series.setdefault(name, []).append(state.series[own])
                noise.setdefault(name, []).append(one[own])
        whole = {name: (np.concatenate(series[name]), np.concatenate(noise[name])) for name in states}
        return {
            name: (replace(states[name], series=values), own)
            for name, (values, own) in whole.items()
            if _moves(values) and np.all(np.isfinite(own))
        }

    def _with_noise(self, run: int, number: int, piece: PreparedRun) -> Motion:
        """The motion of a piece of a run with one more draw of the sensor sheet's noise; kept for a whole run."""
        if run in self._noisy:
            return self._noisy[run]
        motion = _with_noise(piece.recording, [self._seed, 11, run, *([number] if number else [])])
        if not self.runs[run].is_long:
            self._noisy[run] = motion
        return motion


def _with_noise(recording: Recording, seed: Sequence[int]) -> Motion:
    """The motion of a run with one more draw of the sensor sheet's noise."""
    values = recording.signals.value
    noise = draw_noise(recording, values, np.random.default_rng(seed))
    moved = Signals.differentiated({name: values[name] + noise[name] for name in values}, recording.filters.rate)
    return build_motion(recording.with_signals(moved))
