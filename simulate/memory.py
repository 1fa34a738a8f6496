"""Hidden suspension laws with memory: each corner has a state of its own, integrated with the motion.

Dahl's friction (Dahl 1968, without the exponent): dF/dt = (F_max/length)·(ṡ - |ṡ|·F/F_max), here with z = F/F_max.
Maxwell's element, a damper in series with a spring, x the stroke of the damper: F = k·(s - x) = c·ẋ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lacet.daq.errors import UsageError
from lacet.simulate.hidden import Hidden

MemoryLaw = Callable[[float, float, float], tuple[float, float]]
"""(s, ṡ, state) → force [N] between chassis and carrier along the travel, rate of the state [1/s]."""


@dataclass(frozen=True)
class OwnLaw:
    """A suspension law that is given as a function, for causes that are no hidden effect by name.

    `where` : axle or corner; `law` : (s, ṡ, s and ṡ of the other side of the axle, state) → force [N], resisting
    compression, and rate of the state [1/s], which begins at 0.
    """

    where: str
    law: Callable[[float, float, float, float, float], tuple[float, float]]

    def at(self, corner: str) -> bool:
        """Whether it acts at `corner`."""
        return self.where in (corner, "front" if corner[0] == "f" else "rear")


SHORTEST = 0.001
"""Least `length` of the hysteresis [m]: 2 m/s of damper speed are then integrated in steps of 0.5 ms."""
QUICKEST = 800.0
"""Largest size/c of a damper in series [1/s], for the same reason."""


def memory_law(effect: Hidden) -> MemoryLaw | None:
    """The law of an effect; None when it has no memory. Raises UsageError for one too fast for the integrator."""
    p = effect.size
    if effect.effect == "damper_hysteresis":
        length = effect.shape["length"]
        if length < SHORTEST:
            raise UsageError(f"{effect.name}: length must be at least {SHORTEST} m, found {length:g}")
        return lambda s, v, z: (p * z, (v - abs(v) * z) / length)
    if effect.effect == "series_damper":
        c = effect.shape["c"]
        if c <= 0.0 or p < 0.0 or p > QUICKEST * c:
            raise UsageError(
                f"{effect.name}: its stiffness must be from 0 to {QUICKEST:g}·c = {QUICKEST * max(c, 0.0):g} N/m, "
                f"found {p:g}: give a larger c or a smaller size"
            )
        return lambda s, v, x: (p * (s - x), p * (s - x) / c)
    return None
