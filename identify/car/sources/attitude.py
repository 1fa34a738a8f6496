"""Attitude of a car without an attitude channel, from angular rates and gravity, by a smoother over the whole run."""

from __future__ import annotations

import numpy as np
import scipy

from lacet.identify.car.body_motion import body_motion
from lacet.identify.car.car_tree import orientation
from lacet.identify.car.sources.wheel_force import GRAVITY
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.reconstruct import Recording

WANDER = 0.0007
"""Random walk of an integrated rate [rad/√s]: what a rate's noise and zero leave over some seconds."""
SLOPE = 0.03
"""1 σ of the attitude that gravity gives at an instant [rad]: accelerations that the speed does not show."""
AGREES = 1.0
"""Time over which the errors of that attitude are alike [s]."""
LEAST_ZERO = 1e-5
"""Least tolerance of a rate's zero that is taken [rad/s]."""
_PASSES = 3
"""Passes, as the rates of roll and pitch depend on roll and pitch."""


def attitude_by_gravity(recording: Recording, speed: str | None) -> Array:
    """(3, N) roll, pitch, yaw of the inertial unit to the ground [rad]; yaw is zero at the start.

    `speed` : a channel whose first component is the forward speed, which tells the car's own acceleration from gravity;
    None of a car that stands. Roll and pitch are those that fit the integrated rates and, at every instant, gravity
    best: the smoother of a random walk, which a tridiagonal system solves (Rauch, Tung and Striebel, 1965).
    """
    signals, rig, rate = recording.signals, recording.rig, recording.filters.rate
    n = recording.t.size
    body = body_motion(signals, rig, n)
    x, y, z = body.accel
    zero = max(rig.tolerance("imu.rate", "zero"), LEAST_ZERO)
    v = np.zeros(n) if speed is None else signals.value[speed][0]
    x, y = x - derivative(v[None], rate)[0], y - v * body.omega[2]
    by_gravity = np.stack([np.arctan2(y, z), -np.arcsin(np.clip(x / GRAVITY, -1.0, 1.0))])
    angles = by_gravity.mean(axis=1, keepdims=True) * np.ones((2, n))
    yaw = np.zeros(n)
    for _ in range(_PASSES):
        roll, pitch = angles
        across = body.omega[1] * np.sin(roll) + body.omega[2] * np.cos(roll)
        rates = np.stack(
            [body.omega[0] + across * np.tan(pitch), body.omega[1] * np.cos(roll) - body.omega[2] * np.sin(roll)]
        )
        angles = np.stack([_smoothed(g, r, rate, zero) for g, r in zip(by_gravity, rates, strict=True)])
        yaw = np.cumsum(across / np.cos(pitch)) / rate
    sensor = rig.sensor_of("imu.attitude")
    if sensor is None or sensor.axes != "sensor" or not any(sensor.orientation):
        return np.stack([*angles, yaw - yaw[0]])
    return _of_sensor(np.stack([*angles, yaw - yaw[0]]), orientation(sensor.orientation))


def _smoothed(measured: Array, rates: Array, rate: float, zero: float) -> Array:
    """(N,) angle of least Σ (angle − measured)² ÷ σ² + Σ (Δangle − Δintegral)² ÷ w², a zero of the rate removed."""
    n = measured.size
    weight = (1.0 / rate) / AGREES / SLOPE**2
    stiff = rate / WANDER**2
    integral = np.cumsum(rates) / rate
    # A zero of the rate makes the integral drift in proportion to time, by no more than the sheet allows.
    t = (np.arange(n) - 0.5 * (n - 1)) / rate
    apart = integral - measured
    drift = float(t @ apart) / (float(t @ t) + SLOPE**2 * AGREES * rate / zero**2)
    expected = integral - float(np.mean(apart)) - drift * t
    bands = np.empty((2, n))
    bands[0], bands[1] = weight + 2.0 * stiff, -stiff
    bands[0, [0, -1]] -= stiff
    departure: Array = scipy.linalg.solveh_banded(bands, weight * (measured - expected), lower=True)
    return expected + departure


def _of_sensor(attitude: Array, R_body_sensor: Array) -> Array:
    """Attitude of a sensor turned in the body, from the body's."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in attitude)
    R = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    S = np.einsum("ijn,jk->ikn", R, R_body_sensor)
    return np.stack(
        [np.arctan2(S[2, 1], S[2, 2]), -np.arcsin(np.clip(S[2, 0], -1, 1)), np.unwrap(np.arctan2(S[1, 0], S[0, 0]))]
    )
