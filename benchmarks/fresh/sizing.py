"""How far hidden effects stand out of the noise beside one another: √λ by the simulator's own motion.

Shares no code with the identification, so that a trial stays the same whatever is changed there. √λ of an effect is
the length of its force on the equations of the runs, over each equation's noise, after the equations' own parameters
(spring, damper and offset of each corner; tyre stiffness; mass, centre of mass and pitch inertia) and all other hidden
effects are partialled out. Noise is the sensor sheet's, carried into the equation, as if white at the rate of the
tables and without any in the parameters' columns. Of all of it, what is below `CUTOFF` counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.fresh.laws import Part
from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.simulate import Car, CarMotion, Hidden, SimulatedMotion
from lacet.simulate.hidden import suspension_law
from lacet.simulate.linkage.hidden_laws import ALONG_SPRINGS
from lacet.simulate.motion import rotate_back

Array = NDArray[np.float64]
EVERY = 4
"""Instants of a motion (1 kHz) per one of a table (250 Hz)."""
CUTOFF = 5.0
"""Frequency [Hz] up to which the equations of a car's motion are used: zero-phase Butterworth of 4th order."""
BAND = 2.0 * math.pi * CUTOFF
"""Angular frequency [rad/s] at which a derivative of noise is counted."""
MOUNT = 0.3
"""Height of a laser above its wheel centre [m], roughly."""
WITHOUT = ("liquid_load", "trailer")
"""Kinds whose force is no function of the motion of wheels and body: not sized by √λ."""


def measurable(part: Part) -> bool:
    """Whether √λ of a part is computed here."""
    return not part.hidden.of_sensor and part.hidden.effect not in WITHOUT


@dataclass(frozen=True)
class _Row:
    """An equation of a run: its noise, its parameters' columns (n, p) shared by all runs, σ of its zero in a run."""

    noise: float
    columns: Array
    zero: float


@dataclass(frozen=True)
class Suspension:
    """What the suspension equation of a corner is made of, for sizing.

    Attributes
    ----------
    stiffness, damping : of the wheel [N/m, N·s/m], which carry the travel's noise into the equation.
    spring, damper : compression of each per travel of the wheel, by which hidden laws along it act.
    others : what the equation has besides spring and damper: of travels and rates (n, 4) at a corner's place, (n, k).
    """

    stiffness: float
    damping: float
    spring: float = 1.0
    damper: float = 1.0
    others: Callable[[Array, Array, int], Array] = lambda s, rate, i: np.zeros((len(s), 0))


def suspensions(car: Car) -> dict[str, Suspension]:
    """Of a car whose wheels move straight up and down."""
    return {c: Suspension(car.axle(c).stiffness, car.axle(c).damping) for c in CORNERS}


def travels(motion: CarMotion) -> tuple[Array, Array]:
    """Travels and their rates (n, 4) at the instants of a table."""
    if isinstance(motion, SimulatedMotion):
        return motion.travel[::EVERY, 0], motion.travel[::EVERY, 1]
    travel = np.asarray(motion.travel)
    return travel[::EVERY], (np.gradient(travel, axis=0) * motion.rate)[::EVERY]


def _rows(motion: CarMotion, rig: Rig, at: Mapping[str, Suspension]) -> dict[str, _Row]:
    car, wheels = motion.car, np.array([rig.noise(f"wheel.{c}.force") for c in CORNERS])
    (travel, rates), out = travels(motion), dict[str, _Row]()
    for i, corner in enumerate(CORNERS):
        axle, hub, ground = car.axle(corner), rig.noise(f"laser.{corner}.hub"), rig.noise(f"laser.{corner}.ground")
        own = at[corner]
        spring = math.hypot(own.stiffness * hub, own.damping * BAND * hub)
        columns = np.column_stack([travel[:, i], rates[:, i], own.others(travel, rates, i)])
        out[f"suspension.{corner}"] = _Row(math.hypot(wheels[i], spring), columns, np.inf)
        # The deflection is the difference of two distances; a beam's gain is of all its length.
        beam = math.hypot(
            rig.tolerance(f"laser.{corner}.ground", "zero"),
            rig.tolerance(f"laser.{corner}.hub", "zero"),
            rig.tolerance(f"laser.{corner}.ground", "gain") * (axle.radius + MOUNT),
        )
        out[f"tyre.{corner}"] = _Row(
            math.hypot(wheels[i], axle.tyre_stiffness * math.hypot(hub, ground)),
            motion.deflection[::EVERY, i : i + 1],
            math.hypot(rig.tolerance(f"wheel.{corner}.force", "zero"), axle.tyre_stiffness * beam),
        )
    return out | _chassis_rows(motion, rig, float(np.sqrt(np.sum(wheels**2))))


def _chassis_rows(motion: CarMotion, rig: Rig, force: float) -> dict[str, _Row]:
    car = motion.car
    mass, lever = car.total.mass, abs(car.total.com[0])
    body = (rotate_back(motion.attitude, motion.acceleration) - motion.gravity)[::EVERY]
    pitch = motion.turn_rate[::EVERY, 1]
    accel = mass * rig.noise("imu.accel")
    zero = math.hypot(mass * rig.tolerance("imu.accel", "zero"), 2.0 * rig.tolerance("wheel.fl.force", "zero"))
    turn = car.total.tensor[1][1] * BAND * rig.noise("imu.rate")
    return {
        "fx": _Row(math.hypot(force, accel), np.stack([body[:, 0], pitch], 1), zero),
        "fz": _Row(math.hypot(force, accel), np.stack([body[:, 2], pitch], 1), zero),
        "my": _Row(
            math.hypot(math.hypot(force, accel) * lever, turn),
            np.stack([body[:, 0], body[:, 2], pitch], 1), zero * car.wheelbase,
        ),
    }  # fmt: skip


def force_of(hidden: Hidden, motion: CarMotion, at: Mapping[str, Suspension]) -> dict[str, Array]:
    """Equation → what an effect of this size adds to it along a motion."""
    out: dict[str, Array] = {}
    speed = rotate_back(motion.attitude, motion.velocity)[::EVERY, 0]
    square = hidden.size * speed * np.abs(speed)
    travel, rates = travels(motion)
    if hidden.effect == "aero_drag":
        return {"fx": -square, "my": -(hidden.shape["height"] - motion.car.origin_height) * square}
    if hidden.effect == "aero_lift":
        return {"fz": square} if hidden.where == "front" else {"fz": square, "my": motion.car.wheelbase * square}
    law = suspension_law(hidden)
    for i, corner in enumerate(CORNERS):
        s, rate, delta = travel[:, i], rates[:, i], motion.deflection[:, i]
        ratio = at[corner].spring if hidden.effect in ALONG_SPRINGS else at[corner].damper
        if hidden.effect == "interconnection":
            out[f"suspension.{corner}"] = hidden.size * (s - travel[:, (i + 2) % 4])
        elif not hidden.at(corner):
            continue
        elif hidden.effect == "anti_roll_bar":
            out[f"suspension.{corner}"] = hidden.size * (s - travel[:, i ^ 1])
        elif hidden.effect == "tyre_progression":
            out[f"tyre.{corner}"] = hidden.size * delta[::EVERY] ** 2
        elif hidden.effect == "tyre_damping":
            out[f"tyre.{corner}"] = hidden.size * (np.gradient(delta) * motion.rate)[::EVERY]
        elif law is not None:
            pairs = zip((ratio * s).tolist(), (ratio * rate).tolist(), strict=True)
            out[f"suspension.{corner}"] = ratio * np.array([law(a, b) for a, b in pairs])
    if not out:
        raise ValueError(f"{hidden.name} is no force on an equation known here")
    return out


def roots(
    parts: Sequence[Part], motions: Sequence[CarMotion], rig: Rig, at: Mapping[str, Suspension] | None = None
) -> list[float]:
    """√λ of each part, beside all others; NaN for those not `measurable`. `at` : suspensions of a car on linkages."""
    tried = [i for i, part in enumerate(parts) if measurable(part)]
    out = [math.nan] * len(parts)
    if not tried:
        return out
    if at is None:
        car = motions[0].car
        assert isinstance(car, Car)
        at = suspensions(car)
    rows = [_rows(motion, rig, at) for motion in motions]
    forces = [[force_of(parts[i].hidden, motion, at) for i in tried] for motion in motions]
    left = [_left(name, rows, forces) for name in rows[0]]
    stacked = np.concatenate(left)
    lengths = np.maximum(np.linalg.norm(stacked, axis=0), 1e-12)
    unit = stacked / lengths  # sizes of one effect and another are many powers of ten apart
    for place, i in enumerate(tried):
        others = np.delete(unit, place, axis=1)
        rest = unit[:, place] - others @ np.linalg.lstsq(others, unit[:, place])[0]
        out[i] = float(lengths[place] * np.linalg.norm(rest))
    return out


def _slow(columns: Array) -> Array:
    """What is below the cut-off."""
    return sosfiltfilt(butter(4, CUTOFF, fs=1000.0 / EVERY, output="sos"), columns, axis=0)


def _left(name: str, rows: Sequence[Mapping[str, _Row]], forces: Sequence[Sequence[Mapping[str, Array]]]) -> Array:
    """(n, parts) what an equation's own parameters and zeros leave of each part, in units of its noise."""
    blocks, targets = list[Array](), list[Array]()
    for run, (of_run, force) in enumerate(zip(rows, forces, strict=True)):
        row = of_run[name]
        n, zeros = len(row.columns), np.zeros((len(row.columns), len(rows)))
        zeros[:, run] = 1.0
        own = np.hstack([_slow(row.columns), zeros])
        target = _slow(np.stack([part.get(name, np.zeros(n)) for part in force], axis=1))
        if math.isfinite(row.zero):
            prior = np.zeros((1, own.shape[1]))
            prior[0, row.columns.shape[1] + run] = row.noise / row.zero
            own, target = np.vstack([own, prior]), np.vstack([target, np.zeros((1, target.shape[1]))])
        blocks.append(own / row.noise)
        targets.append(target / row.noise)
    own, target = np.concatenate(blocks), np.concatenate(targets)
    scale = np.linalg.norm(own, axis=0)
    q = np.linalg.qr(own[:, scale > 0] / scale[scale > 0])[0]
    return target - q @ (q.T @ target)
