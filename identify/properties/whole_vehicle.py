"""Mass, centre of gravity and central inertia of the whole vehicle at design ride height.

They are smooth functions of the bodies' parameters; their intervals, and whether the runs determine them, follow from
the grouping and covariance of the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.car_tree import WHEEL, car_chain
from lacet.identify.effects.base import with_places
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.rigid_body import REVOLUTION, move_parameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.validation.parameter_estimates import by_assumed_motion

NAMES = ("mass", "cog.x", "cog.y", "cog.z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
UNITS = ("kg", "m", "m", "m", *("kg·m²",) * 6)


@dataclass(frozen=True)
class WholeVehicle:
    """Mass properties of all bodies that the measured loads act on (inboard of the transducers for ``hub`` loads).

    `values` (10,) in the order of `NAMES`: mass, centre of gravity from the body origin in body axes, inertia tensor
    about the centre of gravity (elements of the tensor: products with the sign of −∫xy). `interval` (10,) half of the
    95 % interval, `interval_sheet` with the sensor sheet's gains and latencies. `determined` (10,) whether the runs'
    equations determine it at all.
    """

    values: Array
    interval: Array
    interval_sheet: Array
    determined: tuple[bool, ...]


def whole_vehicle(
    fitted: FittedModel, vehicle: Vehicle, runs: Sequence[PreparedRun] = ()
) -> WholeVehicle | None:  # fmt: skip
    """Whole-vehicle values of a fit; None when the model has no chassis.

    `runs` : those used; values that depend on motion which all of them assume are not determined.
    """
    names = list(fitted.model.names)
    if "M6" not in names:
        return None
    to_sum = summation(fitted, vehicle)
    summed = to_sum @ fitted.theta
    if not summed[9]:  # the mass is not determined, and so is no centre of gravity
        return WholeVehicle(np.zeros(10), np.zeros(10), np.zeros(10), (False,) * 10)
    values = _central(summed)
    slope = _slopes(_central, summed) @ to_sum
    # A functional is determined when grouping leaves it unchanged: it then lies in the rows' span.
    physics = len(fitted.physics)
    grouped = slope[:, :physics][:, fitted.base.independent] @ fitted.base.grouping()
    scale = np.abs(slope[:, :physics]).max(axis=1) + 1e-12
    determined = np.abs(grouped - slope[:, :physics]).max(axis=1) < 1e-5 * scale
    unmoved = by_assumed_motion(runs)
    if unmoved:
        by_them = np.abs(slope[:, [names.index(name) for name in unmoved]])
        determined &= np.all(by_them < 1e-9 * scale[:, None], axis=1)
    spread = np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slope, fitted.covariance, slope)))
    sheet = np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slope, fitted.covariance_sheet, slope)))
    # Grouping alone accepts what rests on round-off: an interval many times the value is no determination.
    size = np.array([values[0], *[_length(vehicle)] * 3, *[values[0] * _length(vehicle) ** 2] * 6])
    determined &= np.isfinite(values) & (TWO_SIDED_95 * spread < np.abs(size))
    return WholeVehicle(
        values, TWO_SIDED_95 * spread, TWO_SIDED_95 * np.hypot(spread, sheet), tuple(bool(d) for d in determined)
    )


def _length(vehicle: Vehicle) -> float:
    """Length of the car over its wheel centres [m]: an interval as wide does not locate a centre of gravity."""
    x = [corner.position[0] for corner in vehicle.corners.values()]
    return float(np.ptp(x))


def summation(fitted: FittedModel, vehicle: Vehicle) -> Array:
    """(10, p): map from the model's parameters to those of all bodies as one, about the body origin."""
    out = np.zeros((10, len(fitted.theta)))
    for effect, place in with_places(fitted.model.physics):
        if effect.name == "body":
            kind, _, corner = effect.where.partition(".")
            p = np.zeros(3)
            if kind != "chassis":
                p = np.asarray(vehicle.corners[corner].position)
            R = car_chain().to_body[WHEEL[corner] - 1] if kind == "wheel" else np.eye(3)
            selection = REVOLUTION if kind == "wheel" else np.eye(10)
            for column in range(selection.shape[1]):
                out[:, place.start + column] = move_parameters(selection[:, column], R, p)
    return out


def _central(summed: Array) -> Array:
    """Mass, centre of gravity and central inertia from the ten parameters about the origin."""
    mass = summed[9]
    cog = summed[6:9] / mass
    central = move_parameters(np.array([*summed[:6], *summed[6:9], mass]), np.eye(3), -cog)
    xx, xy, xz, yy, yz, zz = central[:6]
    return np.array([mass, *cog, xx, yy, zz, xy, xz, yz])


def _slopes(function: Callable[[Array], Array], at: Array) -> Array:
    """Jacobian of a smooth function by central differences, (outputs, inputs)."""
    columns: list[Array] = []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = 1e-4 * max(1.0, abs(at[k]))
        columns.append((function(at + step) - function(at - step)) / (2 * step[k]))
    return np.stack(columns, axis=1)
