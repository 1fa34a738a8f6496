"""An arm of four joints that moves slowly, with known parameters and torques of its own equations of motion."""

from __future__ import annotations

from functools import cache

import numpy as np

from lacet.identify.multibody.chain import Chain

RATE = 500.0
"""Samples a second [Hz]."""
ARM = Chain.from_table(
    [{"j": 1}, {"j": 2, "ant": 1, "alpha": "-pi/2"}, {"j": 3, "ant": 2, "d": 0.5},
     {"j": 4, "ant": 3, "d": 0.3, "alpha": "pi/2", "r": 0.1}]
)  # fmt: skip
NOISE = np.array([0.5, 0.6, 0.3, 0.1])
"""σ of each torque [N·m]."""


def _values() -> dict[str, float]:
    """Bodies like rods, and friction that falls along the arm."""
    out: dict[str, float] = {}
    for j, (mass, length) in enumerate([(8.0, 0.2), (5.0, 0.3), (3.0, 0.2), (1.5, 0.1)], 1):
        square = mass * length**2
        bodies = {"M": mass, "MX": 0.5 * mass * length, "MY": 0.02 * mass, "MZ": 0.01 * mass, "XX": square / 6,
                  "YY": square / 3, "ZZ": square / 3, "XY": 0.01 * mass * length}  # fmt: skip
        laws = {"IA": 0.3 / j, "FV": 6.0 / j, "FS": 5.0 / j, "OFF": 0.2 / j}
        out |= {f"{name}{j}": value for name, value in (bodies | laws).items()}
    return out


VALUES = _values()


@cache
def states(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, rates and accelerations (N, 4): sums of sines up to 0.43 Hz, of random sizes and phases."""
    rng = np.random.default_rng([seed, 5])
    t = np.arange(0.0, seconds, 1.0 / RATE)[:, None]
    q, qd, qdd = (np.zeros((t.size, 4)) for _ in range(3))
    for f in (0.07, 0.15, 0.22, 0.31, 0.43):
        w, phase, size = 2.0 * np.pi * f, rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.5, 1.2, 4) * 0.12 / (f + 0.05)
        q += size * np.sin(w * t + phase)
        qd += size * w * np.cos(w * t + phase)
        qdd -= size * w**2 * np.sin(w * t + phase)
    return kept(q), kept(qd), kept(qdd)


def kept(values: np.ndarray) -> np.ndarray:
    """The array, which nobody may change: others are given the same."""
    values.flags.writeable = False
    return values


@cache
def exact(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques (N, 4) without noise."""
    q, qd, qdd = states(seed, seconds)
    tau = ARM.inverse_dynamics(q, qd, qdd, {k: v for k, v in VALUES.items() if not k.startswith("OFF")})
    return q, kept(tau + [VALUES[f"OFF{j}"] for j in range(1, 5)])


def record(seed: int, seconds: float = 20.0, positions: float = 1e-6) -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques (N, 4) with white noise; `positions` : σ of theirs [rad]."""
    q, tau = exact(seed, seconds)
    rng = np.random.default_rng([seed, 6])
    return q + positions * rng.standard_normal(q.shape), tau + NOISE * rng.standard_normal(q.shape)
