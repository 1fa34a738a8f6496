"""A car that no trial has had before, and the rig that is mounted on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.simulate import Car, find_car
from lacet.simulate.cars import Axle, Inertia, Tyre

SPREAD = 0.15
"""Every parameter is drawn within this fraction of the reference car's."""
SIDES = 0.03
"""Springs, dampers and tyres of one corner differ from their axle's by up to this fraction."""


def around(rng: np.random.Generator, value: float, spread: float = SPREAD) -> float:
    """A value within a fraction of another, six digits."""
    return float(f"{value * (1.0 + rng.uniform(-spread, spread)):.6g}")


def fresh_car(rng: np.random.Generator, name: str) -> Car:
    """The reference car with every parameter drawn anew."""
    like = find_car("peugeot-406")
    radius = around(rng, like.front.radius)
    front, rear = (_axle(rng, axle, radius) for axle in (like.front, like.rear))
    car = replace(
        like,
        name=name,
        wheelbase=around(rng, like.wheelbase, 0.08),
        front=front,
        rear=rear,
        total=_total(rng, like.total),
        tyre=_tyre(rng, like.tyre),
    )
    own: dict[str, Axle] = {}
    for corner in CORNERS:
        axle = car.axle(corner)
        own[corner] = replace(
            axle,
            stiffness=around(rng, axle.stiffness, SIDES),
            damping=around(rng, axle.damping, SIDES),
            tyre_stiffness=around(rng, axle.tyre_stiffness, SIDES),
        )
    return replace(car, corners=own)


def _axle(rng: np.random.Generator, like: Axle, radius: float) -> Axle:
    plain = (
        "track", "stiffness", "damping", "camber", "toe", "caster", "kingpin_inclination", "carrier_mass",
        "inboard_mass", "outboard_mass", "tyre_stiffness", "cornering", "slip",
    )  # fmt: skip
    drawn = {name: around(rng, getattr(like, name)) for name in plain}
    drawn["track"] = around(rng, like.track, 0.08)
    carrier = tuple(around(rng, moment) for moment in like.carrier_inertia)
    # A flat wheel: no body has a moment above the sum of the others.
    inboard, outboard = around(rng, 1.0), around(rng, 1.0)
    return replace(
        like,
        **drawn,
        radius=radius,
        carrier_inertia=carrier,
        inboard_spin=like.inboard_spin * inboard,
        inboard_transverse=around(rng, like.inboard_transverse * inboard, SIDES),
        outboard_spin=like.outboard_spin * outboard,
        outboard_transverse=around(rng, like.outboard_transverse * outboard, SIDES),
    )


def _total(rng: np.random.Generator, like: Inertia) -> Inertia:
    """Mass, centre of mass and tensor; second moments ∫x², ∫y², ∫z² are drawn, so that a body can have the tensor."""
    tensor = np.array(like.tensor)
    second = np.array([around(rng, 0.5 * float(np.trace(tensor)) - tensor[i, i]) for i in range(3)])
    drawn = np.diag(np.sum(second) - second)
    drawn[0, 2] = drawn[2, 0] = around(rng, tensor[0, 2])
    x, _, z = like.com
    com = np.array([around(rng, x), float(f"{rng.uniform(-0.01, 0.01):.6g}"), around(rng, z)])
    return Inertia.of(around(rng, like.mass), com, drawn)


def _tyre(rng: np.random.Generator, like: Tyre) -> Tyre:
    names = (
        "friction", "degression", "relaxation_lateral", "relaxation_longitudinal", "trail", "rolling_resistance",
        "contact_length",
    )  # fmt: skip
    return replace(like, **{name: around(rng, getattr(like, name)) for name in names})


def fresh_rig(rng: np.random.Generator, name: str) -> Rig:
    """The reference rig with its sensors mounted elsewhere; its sensor sheet is unchanged."""
    text = Rig.load("peugeot-406").text

    def exchanged(old: str, new: str) -> str:
        if text.count(old) != 1:
            raise ValueError(f"the reference rig has {text.count(old)} lines {old!r}")
        return text.replace(old, new)

    def at(*bounds: tuple[float, float]) -> str:
        return "[" + ", ".join(f"{rng.uniform(*pair):.3f}" for pair in bounds) + "]"

    text = exchanged('name = "peugeot-406"', f'name = "{name}"')
    text = exchanged("position = [-1.35, 0.10, 0.31]", f"position = {at((-1.6, -1.0), (-0.15, 0.15), (0.1, 0.35))}")
    text = exchanged("position = [-3.20, 0.0, 0.01]", f"position = {at((-3.4, -2.9), (-0.05, 0.05), (0.0, 0.05))}")
    mount = f"position_from_wheel_centre = [0.0, 0.0, {rng.uniform(0.25, 0.35):.3f}]"
    text = exchanged("position_from_wheel_centre = [0.0, 0.0, 0.30]", mount)
    return Rig.parse(text, name)
