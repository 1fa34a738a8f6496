"""Elementary laws with memory along a run: a first-order lag, and friction that depends on the path."""

from __future__ import annotations

import math

import numpy as np

from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.recursion import recursion


def dahl(travel: Array, length: float) -> Array:
    """(…, N) state z of Dahl's friction along travels (…, N) [m], from z = 0: dz/ds = (1 − z sign ṡ) / length.

    Each step is z ← a z + b with a = exp(−|Δs| / length), b = (1 − a) sign Δs. Steps are put together in pairs, pairs
    of pairs and so on (a prefix scan): no loop over samples, and 0 ≤ a ≤ 1 keeps rounding small.

    Source: P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14 (1976).
    """
    step = np.diff(travel, prepend=travel[..., :1])
    a = np.exp(-np.abs(step) / length)
    b = (1.0 - a) * np.sign(step)
    a[..., 0] = 0.0
    shift = 1
    while shift < travel.shape[-1] and np.any(a[..., shift:] > 1e-15):
        b[..., shift:] += a[..., shift:] * b[..., :-shift]
        a[..., shift:] *= a[..., :-shift].copy()
        shift *= 2
    return b


def first_order_lag(series: Array, time: float, step: float) -> Array:
    """(N,) y of time·ẏ + y = x along a series x sampled every `step` [s], from y = x at its first sample.

    Exact for an x that is straight between samples; `time` [s] is above 0.
    """
    ratio = step / time
    a = math.exp(-ratio)
    now = 1.0 + math.expm1(-ratio) / ratio
    before = 1.0 - a - now
    return series[0] + recursion((now, before), (1.0, -a), series - series[0])
