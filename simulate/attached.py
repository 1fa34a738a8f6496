"""Further bodies of the simulated car: an engine on its mounts, a sloshing liquid, a trailer.

Each is a body of the engine's tree on joints of its own, so that its effect on the car is the reaction of its own
motion. Springs and dampers act on the joints; road forces act through the contact point's Jacobian.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import UsageError
from lacet.simulate.cars import Car, Inertia
from lacet.simulate.hidden import Hidden, one_of
from lacet.simulate.mjcf import Attached, inertial, numbers
from lacet.simulate.road import Road

Array = NDArray[np.float64]

CONTACT_FRICTION = 0.9
"""Friction coefficient μ of a trailer's tyres."""
TRAILER_ROLLING = 0.015
"""Rolling resistance coefficient of a trailer's tyres."""


def _positive(effect: Hidden, *names: str) -> None:
    if effect.size < 0.0:
        raise UsageError(f"{effect.name}: its mass cannot be negative, found {effect.size:g} kg")
    for name in names:
        if not effect.shape[name] > 0.0:
            raise UsageError(f"{effect.name}: {name} must be above 0, found {effect.shape[name]:g}")


def _position(at: tuple[float, float, float], origin: tuple[float, float, float]) -> str:
    return numbers(np.subtract(at, origin))


class EngineMount:
    """Part of the chassis' mass on a vertical spring and damper, in equilibrium at design position."""

    states = 0
    joints: tuple[str, ...] = ("engine_mount",)
    taken: Inertia | None

    def __init__(self, effect: Hidden, car: Car):
        _positive(effect, "frequency")
        shape, mass = effect.shape, effect.size
        self.name, self.at = effect.name, (shape["x"], shape["y"], shape["z"])
        self.taken = Inertia.of(mass, np.asarray(self.at), np.eye(3) * 0.02 * mass)
        pace = 2.0 * math.pi * shape["frequency"]
        self._stiffness, self._damping = mass * pace * pace, 2.0 * shape["damping"] * mass * pace
        self._weight = mass * car.gravity

    def body(self, origin: tuple[float, float, float]) -> str:
        assert self.taken is not None
        return (
            f'<body name="engine" pos="{_position(self.at, origin)}">{inertial(self.taken, np.asarray(self.at))}'
            '<joint name="engine_mount" type="slide" axis="0 0 1"/></body>'
        )

    def load(self, engine: Any, dofs: Sequence[int], states: Sequence[float]) -> tuple[Array, list[float]]:
        out = np.zeros(engine.model.nv)
        z, speed = engine.data.qpos[dofs[0] + 1], engine.data.qvel[dofs[0]]
        out[dofs[0]] = self._weight - self._stiffness * z - self._damping * speed
        return out, []


class LiquidLoad:
    """A spherical pendulum, the first sloshing mode of a liquid in a tank: a point mass on two hinges."""

    states = 0
    joints: tuple[str, ...] = ("liquid_x", "liquid_y")
    taken: Inertia | None = None

    def __init__(self, effect: Hidden, car: Car):
        _positive(effect, "length")
        shape = effect.shape
        self.name, self.at, self._mass = effect.name, (shape["x"], shape["y"], shape["z"]), effect.size
        self._length = shape["length"]
        pace = math.sqrt(car.gravity / self._length)
        self._damping = 2.0 * shape["damping"] * self._mass * self._length**2 * pace

    def body(self, origin: tuple[float, float, float]) -> str:
        bob = Inertia.of(self._mass, np.array([0.0, 0.0, -self._length]), np.eye(3) * 1e-6 * self._mass)
        return (
            f'<body name="liquid" pos="{_position(self.at, origin)}">{inertial(bob, np.zeros(3))}'
            '<joint name="liquid_x" type="hinge" axis="1 0 0"/>'
            '<joint name="liquid_y" type="hinge" axis="0 1 0"/></body>'
        )

    def load(self, engine: Any, dofs: Sequence[int], states: Sequence[float]) -> tuple[Array, list[float]]:
        out = np.zeros(engine.model.nv)
        out[list(dofs)] = -self._damping * engine.data.qvel[list(dofs)]
        return out, []


class Trailer:
    """A one-axle trailer on a ball hitch, supported and guided by the tyres of two wheels.

    Each wheel: vertical N = N0 + k·(z0 - z) - c·ż (never below 0), side force μ·N·tanh(C·α/μ) along the trailer's level
    y with the relaxed slip σ·dα/dt = -v_y - |v_x|·α, rolling resistance along its level x.
    """

    states = 2
    joints: tuple[str, ...] = ("hitch_z", "hitch_y", "hitch_x")
    taken: Inertia | None = None

    def __init__(self, effect: Hidden, car: Car, road: Road):
        _positive(effect, "length", "track", "relaxation", "frequency")
        shape, mass = effect.shape, effect.size
        length, ahead = shape["length"], shape["ahead"]
        if not 0.0 <= ahead < length:
            raise UsageError(f"{effect.name}: ahead must lie between 0 and length ({length:g} m), found {ahead:g}")
        self.name, self.at, self._road = effect.name, (shape["x"], 0.0, shape["z"]), road
        com = np.array([ahead - length, 0.0, 0.2])
        tensor = mass * np.diag(
            [0.25 * shape["track"] ** 2, 0.1 * length**2, 0.1 * length**2 + 0.2 * shape["track"] ** 2]
        )
        self._inertia = Inertia.of(mass, com, tensor)
        self._wheels = [np.array([-length, side * shape["track"] / 2, 0.0]) for side in (1.0, -1.0)]
        pace = 2.0 * math.pi * shape["frequency"]
        self._height = car.origin_height + shape["z"]
        self._stiffness, self._damping = 0.5 * mass * pace**2, shape["damping"] * mass * pace
        self._static = 0.5 * mass * car.gravity * (length - ahead) / length
        self._cornering, self._relaxation = shape["cornering"], shape["relaxation"]
        self.nose = mass * car.gravity * ahead / length
        """Static weight on the hitch [N]."""

    def body(self, origin: tuple[float, float, float]) -> str:
        hinges = "".join(
            f'<joint name="{name}" type="hinge" axis="{axis}"/>'
            for name, axis in zip(self.joints, ("0 0 1", "0 1 0", "1 0 0"), strict=True)
        )
        place, inertia = _position(self.at, origin), inertial(self._inertia, np.zeros(3))
        return f'<body name="trailer" pos="{place}">{inertia}{hinges}</body>'

    def load(self, engine: Any, dofs: Sequence[int], states: Sequence[float]) -> tuple[Array, list[float]]:
        lib, model, data = engine.lib, engine.model, engine.data
        lib.mj_kinematics(model, data)
        lib.mj_comPos(model, data)
        out, rates = np.zeros(model.nv), []
        body = lib.mj_name2id(model, lib.mjtObj.mjOBJ_BODY, "trailer")
        R = data.xmat[body].reshape(3, 3)
        forward = np.array([R[0, 0], R[1, 0], 0.0])
        forward /= np.linalg.norm(forward)
        left = np.array([-forward[1], forward[0], 0.0])
        jacobian = np.empty((3, model.nv))
        for wheel, side, alpha in zip(self._wheels, "lr", states, strict=True):
            point = data.xpos[body] + R @ wheel
            lib.mj_jac(model, data, jacobian, None, point, body)
            v = jacobian @ data.qvel
            ground = self._road.height(point[:1] + np.array([-0.05, 0.0, 0.05]), side)
            climb = (ground[2] - ground[0]) / 0.1 * v[0]
            load = (
                self._static + self._stiffness * (self._height + ground[1] - point[2]) + self._damping * (climb - v[2])
            )
            load = max(0.0, load)
            along, across = forward @ v, left @ v
            grip = CONTACT_FRICTION * load
            lateral = grip * math.tanh(self._cornering * alpha / CONTACT_FRICTION)
            rolling = -TRAILER_ROLLING * load * math.tanh(along / 0.3)
            foot = point - np.array([0.0, 0.0, point[2] - ground[1]])  # the road acts at the contact point
            lib.mj_jac(model, data, jacobian, None, foot, body)
            out += jacobian.T @ (lateral * left + rolling * forward + load * np.array([0.0, 0.0, 1.0]))
            rates.append((-across - abs(along) * alpha) / self._relaxation)
        engine.now.outside = out[:6].copy()
        return out, rates


def attached_bodies(car: Car, road: Road, hidden: Sequence[Hidden]) -> list[Attached]:
    """The further bodies of a car with these hidden effects. Raises UsageError for sizes that are impossible."""
    out: list[Attached] = []
    if (effect := one_of(hidden, "engine_mount")) is not None and effect.size:
        out.append(EngineMount(effect, car))
    if (effect := one_of(hidden, "liquid_load")) is not None and effect.size:
        _positive(effect)
        out.append(LiquidLoad(effect, car))
    if (effect := one_of(hidden, "trailer")) is not None and effect.size:
        _positive(effect)
        out.append(Trailer(effect, car, road))
    return out
