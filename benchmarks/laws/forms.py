"""Forms of the laws that are hidden, a development and a test set; no form is in both.

A form is a force of travel s [m] and rate v [m/s] of a wheel, of those of the other side of its axle, S and V, and of a
state z; its constants are drawn. It is scaled before it is hidden. The search never sees this file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

Force = Callable[[float, float, float, float, float], float]
Rate = Callable[[float, float, float], float]


def _still(s: float, v: float, z: float) -> float:
    return 0.0


@dataclass(frozen=True)
class Form:
    """A law: its constants' ranges, and the law for constants drawn from them.

    `text` : the law as an engineer would write it; `make` : constants → force, and rate of the state z(s, v, z);
    `across` : whether it needs the other side of the axle.
    """

    text: str
    make: Callable[[Mapping[str, float]], tuple[Force, Rate]]
    constants: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    across: bool = False


def plain(
    text: str, law: Callable[[float, float, Mapping[str, float]], float], **constants: tuple[float, float]
) -> Form:
    """A law of the wheel's own travel and rate at the instant."""

    def make(c: Mapping[str, float]) -> tuple[Force, Rate]:
        return (lambda s, v, S, V, z: law(s, v, c)), _still

    return Form(text, make, constants)


def between(
    text: str, law: Callable[[float, float, float, float, Mapping[str, float]], float], **constants: tuple[float, float]
) -> Form:
    """A law between the two wheels of an axle."""

    def make(c: Mapping[str, float]) -> tuple[Force, Rate]:
        return (lambda s, v, S, V, z: law(s, v, S, V, c)), _still

    return Form(text, make, constants, across=True)


def lasting(
    text: str, law: Callable[[float, float, float, Mapping[str, float]], float],
    rate: Callable[[float, float, float, Mapping[str, float]], float], **constants: tuple[float, float],
) -> Form:  # fmt: skip
    """A law with a state of its own."""

    def make(c: Mapping[str, float]) -> tuple[Force, Rate]:
        return (lambda s, v, S, V, z: law(s, v, z, c)), (lambda s, v, z: rate(s, v, z, c))

    return Form(text, make, constants)


def sign(x: float) -> float:
    """Sign of a number."""
    return math.copysign(1.0, x) if x else 0.0


def dahl(s: float, v: float, z: float, c: Mapping[str, float]) -> float:
    """Rate of the state of Dahl's friction."""
    return (v - abs(v) * z) / c["length"]


GAP, REACH, LOW, HIGH = (0.004, 0.018), (0.008, 0.03), (0.02, 0.08), (0.08, 0.3)
LENGTH, TIME = (0.0015, 0.006), (0.008, 0.05)

DEVELOPMENT: tuple[Form, ...] = (
    plain("|s| v", lambda s, v, c: abs(s) * v),
    plain("s² tanh(v/v0)", lambda s, v, c: s * s * math.tanh(v / c["v0"]), v0=LOW),
    plain("v min(1, |s|/L)", lambda s, v, c: v * min(1.0, abs(s) / c["L"]), L=REACH),
    plain("v max(0, s − g)", lambda s, v, c: v * max(0.0, s - c["g"]), g=GAP),
    plain("s |s|^0.5", lambda s, v, c: s * abs(s) ** 0.5),
    plain("max(0, v − v0)²", lambda s, v, c: max(0.0, v - c["v0"]) ** 2, v0=LOW),
    lasting("v lagging by T", lambda s, v, z, c: z, lambda s, v, z, c: (v - z) / c["T"], T=TIME),
    lasting("|s| friction that turns round over a length", lambda s, v, z, c: abs(s) * z, dahl, length=LENGTH),
    between("(s − S)³", lambda s, v, S, V, c: (s - S) ** 3),
    plain("v exp(−(s/L)²)", lambda s, v, c: v * math.exp(-((s / c["L"]) ** 2)), L=REACH),
    plain("tanh(s/L)", lambda s, v, c: math.tanh(s / c["L"]), L=REACH),
    plain("max(0, s) tanh(v/v0)", lambda s, v, c: max(0.0, s) * math.tanh(v / c["v0"]), v0=LOW),
    plain("max(0, v)²", lambda s, v, c: max(0.0, v) ** 2),
    plain("s |v|", lambda s, v, c: s * abs(v)),
    plain("max(0, s − g)^1.5 − max(0, −s − g)^1.5",
          lambda s, v, c: max(0.0, s - c["g"]) ** 1.5 - max(0.0, -s - c["g"]) ** 1.5, g=GAP),
    plain("sign(v) √|v|", lambda s, v, c: v / math.sqrt(abs(v) + 1e-3)),
    lasting("s |s| lagging by T", lambda s, v, z, c: z, lambda s, v, z, c: (s * abs(s) - z) / c["T"], T=(0.05, 0.3)),
    plain("v cos(2π s/L)", lambda s, v, c: v * math.cos(2.0 * math.pi * s / c["L"]), L=(0.03, 0.08)),
    lasting("friction that turns round over a length, and s³", lambda s, v, z, c: z + (s / 0.02) ** 3, dahl,
            length=LENGTH),
    between("(v − V) |v − V|", lambda s, v, S, V, c: (v - V) * abs(v - V)),
)  # fmt: skip

TEST: tuple[Form, ...] = (
    plain("|s| v |v|", lambda s, v, c: abs(s) * v * abs(v)),
    plain("tanh(v/v0) (1 + (s/L)²)", lambda s, v, c: math.tanh(v / c["v0"]) * (1.0 + (s / c["L"]) ** 2), v0=LOW,
          L=REACH),
    plain("|s| v/(1 + |v|/v0)", lambda s, v, c: abs(s) * v / (1.0 + abs(v) / c["v0"]), v0=HIGH),
    plain("v max(0, −s − g)", lambda s, v, c: v * max(0.0, -s - c["g"]), g=GAP),
    plain("sign(s) max(0, |s| − g)²", lambda s, v, c: sign(s) * max(0.0, abs(s) - c["g"]) ** 2, g=GAP),
    plain("atan(s/L)", lambda s, v, c: math.atan(s / c["L"]), L=REACH),
    plain("v s²/(s² + L²)", lambda s, v, c: v * s * s / (s * s + c["L"] ** 2), L=REACH),
    plain("sin(2π s/L)", lambda s, v, c: math.sin(2.0 * math.pi * s / c["L"]), L=(0.06, 0.15)),
    plain("max(0, v − v1) − 2 max(0, −v − v2)",
          lambda s, v, c: max(0.0, v - c["v1"]) - 2.0 * max(0.0, -v - c["v2"]), v1=LOW, v2=HIGH),
    plain("−max(0, −v)^1.4", lambda s, v, c: -(max(0.0, -v) ** 1.4)),
    lasting("v |v| lagging by T", lambda s, v, z, c: z, lambda s, v, z, c: (v * abs(v) - z) / c["T"], T=TIME),
    lasting("(1 + |s|/L) friction that turns round over a length", lambda s, v, z, c: (1.0 + abs(s) / c["L"]) * z, dahl,
            length=LENGTH, L=REACH),
    lasting("max(0, s + g) friction that turns round over a length", lambda s, v, z, c: max(0.0, s + c["g"]) * z, dahl,
            length=LENGTH, g=GAP),
    between("(s − S) |s − S|", lambda s, v, S, V, c: (s - S) * abs(s - S)),
    between("tanh((s − S)/L)", lambda s, v, S, V, c: math.tanh((s - S) / c["L"]), L=REACH),
    between("bar with play", lambda s, v, S, V, c: sign(s - S) * max(0.0, abs(s - S) - c["g"]), g=GAP),
    between("|s − S| v", lambda s, v, S, V, c: abs(s - S) * v),
    between("(v − V) |s|", lambda s, v, S, V, c: (v - V) * abs(s)),
    plain("exp(s/L) − 1", lambda s, v, c: math.exp(s / c["L"]) - 1.0, L=(0.015, 0.04)),
    plain("v (1 + tanh(s/L))", lambda s, v, c: v * (1.0 + math.tanh(s / c["L"])), L=REACH),
    plain("tanh(v/v0) exp(−|s|/L)", lambda s, v, c: math.tanh(v / c["v0"]) * math.exp(-abs(s) / c["L"]), v0=LOW,
          L=REACH),
    plain("tanh(v/v0) max(0, −s − g)", lambda s, v, c: math.tanh(v / c["v0"]) * max(0.0, -s - c["g"]), v0=LOW, g=GAP),
    plain("max(0, s + g)^2.2", lambda s, v, c: max(0.0, s + c["g"]) ** 2.2, g=GAP),
    plain("−|s| max(0, −v)²", lambda s, v, c: -abs(s) * max(0.0, -v) ** 2),
    lasting("|s| v lagging by T", lambda s, v, z, c: z, lambda s, v, z, c: (abs(s) * v - z) / c["T"], T=TIME),
    lasting("max(0, s − g) lagging by T", lambda s, v, z, c: z,
            lambda s, v, z, c: (max(0.0, s - c["g"]) - z) / c["T"], g=GAP, T=(0.03, 0.2)),
    plain("tanh(v/v0) exp(−(v/v1)²)", lambda s, v, c: math.tanh(v / c["v0"]) * math.exp(-((v / c["v1"]) ** 2)), v0=LOW,
          v1=HIGH),
    plain("v max(0, s − g)²", lambda s, v, c: v * max(0.0, s - c["g"]) ** 2, g=GAP),
    plain("s² v |v|", lambda s, v, c: s * s * v * abs(v)),
    plain("s tanh(|v|/v0)", lambda s, v, c: s * math.tanh(abs(v) / c["v0"]), v0=HIGH),
)  # fmt: skip

SETS: Mapping[str, tuple[Form, ...]] = {"development": DEVELOPMENT, "test": TEST}
