"""Rates, masses and ratios of a second car at the design position, computed from its mechanism.

Nothing here is a formula for a rate: the equilibria of the mechanism are differentiated, on a fixed chassis, with the
rack held. s_i : travel of wheel centre i along body z [m], compression positive; corners fl, fr, rl, rr.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.statics import Shape, Statics, rack_per_steer

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DesignValues:
    """Values of a mechanism at the design position.

    Attributes
    ----------
    wheel_rate : (4, 4) ∂Q_i/∂s_j [N/m], Q_i the vertical force at wheel centre i that holds the travels: the force
        conjugate to s_i. Diagonal less coupling is the rate in opposite travel.
    unsprung_mass : (4, 4) ∂²T/∂ṡ_i∂ṡ_j [kg], wheels not turning in space about their spin axes (a wheel that is free
        to roll keeps its rotation); `unsprung_mass_locked` : wheels locked to their carriers.
    motion_ratio : (4,) compression by element (springs and dampers) per travel of each wheel [-].
    roll_stiffness : front and rear axle, moment of the Q_i about body x per roll of the axle line [N·m/rad].
    path : (4, 4, 2) ∂(x, y)/∂s_j of wheel centre i [-], body axes.
    turn : (4, 4, 3) ∂φ/∂s_j of carrier i [rad/m], body axes: camber, pitch, steer for small static angles.
    rack_per_steer : rack travel per steer of the front wheels [m/rad].
    """

    wheel_rate: Array
    unsprung_mass: Array
    unsprung_mass_locked: Array
    motion_ratio: dict[str, Array]
    roll_stiffness: tuple[float, float]
    path: Array
    turn: Array
    rack_per_steer: float


def design_values(mechanism: Mechanism) -> DesignValues:
    """The values of a mechanism at its design position."""
    statics = Statics(mechanism)
    return values_at(statics, statics.solve(np.zeros(4)))


def values_at(statics: Statics, shape: Shape) -> DesignValues:
    """The same at another equilibrium with all travels held."""
    mechanism = statics.mechanism
    motion, rate = statics.tangent(shape)
    lib, model, data = mechanism.lib, mechanism.model, mechanism.data
    data.qpos[:], data.qvel[:] = shape.q, 0.0
    mechanism.refresh()
    path, turn = np.empty((4, 4, 2)), np.empty((4, 4, 3))
    free = motion.copy()
    axes = mechanism.data.xmat[mechanism.carriers].reshape(-1, 3, 3) @ mechanism.design_attitudes
    for i in range(4):
        along, about = np.empty((3, model.nv)), np.empty((3, model.nv))
        lib.mj_jac(model, data, along, about, data.xpos[mechanism.wheels[i]], mechanism.carriers[i])
        path[i], turn[i] = (along @ motion)[:2].T, (about @ motion).T
        free[mechanism.spin_dof[i]] = -axes[i, :, 1] @ (about @ motion)
    ratio = dict(zip(mechanism.elements.names, compressions(mechanism, motion), strict=True))
    halves = [0.5 * mechanism.car.axle(c).track for c in ("fl", "rl")]
    opposite = np.array([1.0, -1.0])
    roll = [h**2 * opposite @ rate[i : i + 2, i : i + 2] @ opposite for i, h in zip((0, 2), halves, strict=True)]
    return DesignValues(
        wheel_rate=rate,
        unsprung_mass=kinetic_matrix(mechanism, free),
        unsprung_mass_locked=kinetic_matrix(mechanism, motion),
        motion_ratio={name: row for name, row in ratio.items() if name.startswith(("spring", "damper"))},
        roll_stiffness=(float(roll[0]), float(roll[1])),
        path=path,
        turn=turn,
        rack_per_steer=rack_per_steer(mechanism),
    )


def compressions(mechanism: Mechanism, motion: Array) -> Array:
    """(elements, 4) rate of compression of rods (on rubber), springs and dampers per unit of the motions (nv, 4)."""
    data = mechanism.data
    out = []
    for column in motion.T:
        data.qvel[:] = column
        mechanism.refresh()
        out.append(-mechanism.elements.lengths()[2])
    data.qvel[:] = 0.0
    mechanism.refresh()
    return np.array(out).T


def kinetic_matrix(mechanism: Mechanism, motion: Array) -> Array:
    """(4, 4) ∂²T/∂ṡ_i∂ṡ_j [kg] of motions (nv, 4) per unit of the ṡ, by the kinetic energies of their sums."""

    def energy(speed: Array) -> float:
        mechanism.data.qvel[:] = speed
        mechanism.refresh()
        return mechanism.kinetic()

    own = [energy(motion[:, i]) for i in range(4)]
    out = np.diag(2.0 * np.array(own))
    for i in range(4):
        for j in range(i):
            out[i, j] = out[j, i] = energy(motion[:, i] + motion[:, j]) - own[i] - own[j]
    mechanism.data.qvel[:] = 0.0
    mechanism.refresh()
    return out


def design_truth(car: SecondCar) -> dict[str, Any]:
    """`DesignValues` of a car, JSON-able."""
    values = asdict(design_values(Mechanism(car)))
    plain = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}
    plain["motion_ratio"] = {name: row.tolist() for name, row in values["motion_ratio"].items()}
    return plain
