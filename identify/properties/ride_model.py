"""Ride, roll and load transfer of a car from its corner rates: linear models of few degrees of freedom.

Definitions, formulae and sources: ``docs/derived.md``. Left and right are averaged where a value belongs to an axle;
body axes, heights above a flat road at design ride height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.car_tree import kinematics
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY as G
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.corner_rates import CornerNumbers

_AXLES = {"front": (0, 1), "rear": (2, 3)}
Values = dict[str, tuple[float, str]]
"""Name → value and unit."""


@dataclass(frozen=True)
class Mode:
    """A mode of vibration: undamped natural frequency [Hz], damping ratio, shape over the positions."""

    frequency: float
    damping: float
    shape: Array


def ride_values(numbers: CornerNumbers, vehicle: Vehicle) -> Values:
    """All derived values; NaN where a number they depend on is zero or impossible."""
    with np.errstate(all="ignore"):
        out = {f"ride_rate.{c}": (_series(numbers.stiffness[i], numbers.tyre[i]), "N/m") for i, c in enumerate(CORNERS)}
        out |= _static(numbers, vehicle)
        out |= _axle_ride(numbers, vehicle)
        out |= _body_modes(numbers, vehicle)
        out |= _roll(numbers, vehicle)
    return out


def modes(mass: Array, damping: Array, stiffness: Array) -> list[Mode]:
    """Modes of M ẍ + C ẋ + K x = 0, (n, n) each, slowest first.

    A pair of real roots counts as one mode with a damping ratio above 1. Empty when M is singular or a number is not
    finite.
    """
    n = len(mass)
    whole = np.concatenate([mass, damping, stiffness])
    if not np.all(np.isfinite(whole)) or np.any(np.linalg.eigvalsh(0.5 * (mass + mass.T)) <= 0.0):
        return []
    lower = -np.linalg.solve(mass, np.concatenate([stiffness, damping], axis=1))
    if not np.all(np.isfinite(lower)):  # a mass so small that its inverse is not finite
        return []
    solution = np.linalg.eig(np.concatenate([np.eye(2 * n)[n:], lower]))
    roots: NDArray[np.complex128] = np.asarray(solution[0], np.complex128)
    vectors: NDArray[np.complex128] = np.asarray(solution[1], np.complex128)
    turning = np.abs(roots.imag) > 1e-9 * np.abs(roots)
    found: list[Mode] = []
    for k in np.flatnonzero(turning & (roots.imag > 0)):
        size = float(np.abs(roots[k]))
        found.append(Mode(size / (2 * np.pi), -float(roots[k].real) / size, np.abs(vectors[:n, k])))
    still = sorted(np.flatnonzero(~turning), key=lambda k: float(np.abs(roots[k])))
    for first, second in zip(still[::2], still[1::2], strict=False):
        size = float(np.sqrt(np.abs(roots[first] * roots[second])))
        sum_ = -float((roots[first] + roots[second]).real)
        ratio = float(np.divide(sum_, 2 * size))  # NaN for a body without any stiffness
        found.append(Mode(size / (2 * np.pi), ratio, np.abs(vectors[:n, first])))
    return sorted(found, key=lambda mode: mode.frequency)


def _series(a: float, b: float) -> float:
    return float(np.divide(a * b, a + b))  # NaN where there is neither


def _stiffness(n: CornerNumbers) -> Array:
    """(4, 4) stiffness of the suspensions [N/m], coupled ones included."""
    return np.diag(n.stiffness) + n.coupled_stiffness


def _damping(n: CornerNumbers) -> Array:
    return np.diag(n.damping) + n.coupled_damping


def _places(vehicle: Vehicle) -> tuple[Array, Array]:
    position = np.array([vehicle.corners[c].position for c in CORNERS])
    return position[:, 0], position[:, 1]


def _cog(n: CornerNumbers) -> Array:
    """(3,) centre of gravity of the sprung mass from the body origin [m]."""
    return n.chassis[6:9] / n.chassis[9]


def _static(n: CornerNumbers, vehicle: Vehicle) -> Values:
    """Wheel loads at rest on a flat road: design loads, brought into balance by heave, pitch and roll."""
    x, y = _places(vehicle)
    plane = np.stack([np.ones(4), x, y], axis=1)
    cog = _cog(n)
    weight: Array = G * (n.chassis[9] * np.array([1.0, cog[0], cog[1]]) + plane.T @ n.unsprung)
    design = n.static + G * n.unsprung
    total = _stiffness(n) + np.diag(n.tyre)
    if not np.all(np.isfinite(total)) or np.linalg.cond(total) > 1e12:
        load: Array = np.full(4, np.nan)
    else:
        ride = np.diag(n.tyre) @ np.linalg.solve(total, _stiffness(n))
        lacking: Array = weight - plane.T @ design
        stiffness: Array = plane.T @ ride @ plane
        sound = np.linalg.cond(stiffness) < 1e12
        load = design + ride @ plane @ np.linalg.solve(stiffness, lacking) if sound else np.full(4, np.nan)
    out: Values = {f"static_load.{c}": (float(load[i]), "N") for i, c in enumerate(CORNERS)}
    xf, xr = x[:2].mean(), x[2:].mean()
    out["static_share.front"] = (100.0 * float((weight[1] / weight[0] - xr) / (xf - xr)), "%")
    out["static_share.left"] = (100.0 * float(np.divide(load[0] + load[2], weight[0])), "%")
    out["static_share.cross"] = (100.0 * float(np.divide(load[0] + load[3], weight[0])), "%")
    return out


def _sprung_shares(n: CornerNumbers, vehicle: Vehicle) -> dict[str, float]:
    """Sprung mass carried by each axle at rest [kg]."""
    x, _ = _places(vehicle)
    xf, xr, mass = float(x[:2].mean()), float(x[2:].mean()), float(n.chassis[9])
    front = mass * (float(_cog(n)[0]) - xr) / (xf - xr)
    return {"front": front, "rear": mass - front}


def _axle_ride(n: CornerNumbers, vehicle: Vehicle) -> Values:
    """Quarter-car ride values: of each axle with half its sprung mass a corner, and of each corner for its damping."""
    out: Values = {}
    K, C, share = _stiffness(n), _damping(n), _sprung_shares(n, vehicle)
    both = np.ones(2)
    for axle, (left, right) in _AXLES.items():
        pair = np.ix_((left, right), (left, right))
        k, c = float(both @ K[pair] @ both), float(both @ C[pair] @ both)
        found = _quarter(share[axle], n.unsprung[[left, right]].sum(), k, c, n.tyre[[left, right]].sum())
        for name, unit, value in (
            ("ride_frequency", "Hz", found[0]), ("hop_frequency", "Hz", found[2]), ("hop_damping_ratio", "1", found[3]),
        ):  # fmt: skip
            out[f"{name}.{axle}"] = (value, unit)
        for i in (left, right):
            one = _quarter(0.5 * share[axle], n.unsprung[i], n.stiffness[i], n.damping[i], n.tyre[i])
            out[f"damping_ratio.{CORNERS[i]}"] = (one[1], "1")
    return out


def _quarter(sprung: float, unsprung: float, k: float, c: float, tyre: float) -> tuple[float, float, float, float]:
    """Frequency [Hz] and damping ratio of ride and of wheel hop of a quarter car."""
    coupling = np.array([[1.0, -1.0], [-1.0, 1.0]])
    found = modes(np.diag([sprung, unsprung]), c * coupling, k * coupling + np.diag([0.0, tyre]))
    if len(found) < 2:
        return float("nan"), float("nan"), float("nan"), float("nan")
    return found[0].frequency, found[0].damping, found[1].frequency, found[1].damping


def _body_modes(n: CornerNumbers, vehicle: Vehicle) -> Values:
    """Modes of heave and pitch (body and both axles) and of roll (body and both axles' roll), separate by symmetry."""
    x, y = _places(vehicle)
    mass, cog = float(n.chassis[9]), _cog(n)
    pitch_inertia = float(n.chassis[3]) - mass * float(cog[0] ** 2 + cog[2] ** 2)
    roll_inertia = float(n.chassis[0]) - mass * float(cog[1] ** 2 + cog[2] ** 2)
    # Travel of a corner: its wheel's height less the body's there. Coordinates: heave, pitch (nose down), roll.
    body = np.stack([np.ones(4), -(x - cog[0]), y - cog[1]], axis=1)
    front, rear = np.array([1.0, 1, 0, 0]), np.array([0, 0, 1.0, 1])
    zero = np.zeros(4)
    names = ("heave.frequency", "heave.damping_ratio", "pitch.frequency", "pitch.damping_ratio")
    values = [float("nan")] * 4
    pitching = _solve(
        n,
        np.stack([body[:, 0], body[:, 1], zero, zero], 1),
        np.stack([zero, zero, front, rear], 1),
        np.diag([mass, pitch_inertia, 0, 0]),
    )
    if len(pitching) == 4:
        gyration = np.sqrt(pitch_inertia / mass)
        slow = sorted(pitching[:2], key=lambda m: float(m.shape[1]) * gyration / (float(m.shape[0]) + 1e-300))
        values = [v for mode in slow for v in (mode.frequency, mode.damping)]
    turn_f, turn_r = front * y, rear * y
    rolling = _solve(
        n, np.stack([body[:, 2], zero, zero], 1), np.stack([zero, turn_f, turn_r], 1), np.diag([roll_inertia, 0, 0])
    )
    values += [rolling[0].frequency, rolling[0].damping] if len(rolling) == 3 else [float("nan")] * 2
    names += ("roll.frequency", "roll.damping_ratio")
    return {name: (value, "Hz" if "frequency" in name else "1") for name, value in zip(names, values, strict=True)}


def _solve(n: CornerNumbers, body: Array, wheels: Array, inertia: Array) -> list[Mode]:
    """Modes in coordinates that move the body at the corners by `body` and the wheels by `wheels`, (4, d) each."""
    travel = wheels - body
    mass = inertia + wheels.T @ (n.unsprung[:, None] * wheels)
    stiffness = travel.T @ _stiffness(n) @ travel + wheels.T @ (n.tyre[:, None] * wheels)
    return modes(mass, travel.T @ _damping(n) @ travel, stiffness)


def roll_centre(corner: Corner) -> float:
    """Height of an axle's roll centre above the road [m] from a corner's bench table; 0 without one.

    Half the track times the outward displacement of the contact point per unit of travel, the other wheel moved by the
    same in the opposite direction.
    """
    if corner.table is None and corner.joints is None:
        return 0.0
    slope = kinematics(corner, np.zeros(1), other=-1.0).slope[:, 0]
    # The contact point is below the wheel centre and moves with camber (about body x).
    outwards = corner.side * float(slope[0] + corner.height * slope[3])
    return abs(corner.position[1]) * outwards


def _roll(n: CornerNumbers, vehicle: Vehicle) -> Values:
    """Roll stiffness of the axles, roll per g, and load transfer per g with its three parts."""
    x, y = _places(vehicle)
    heights = np.array([vehicle.corners[c].height for c in CORNERS])
    ground = float(np.mean([vehicle.corners[c].position[2] - vehicle.corners[c].height for c in CORNERS]))
    cog, mass, share = _cog(n), float(n.chassis[9]), _sprung_shares(n, vehicle)
    stiffness, per_degree = _stiffness(n), np.pi / 180.0
    out: Values = {}
    suspension, tyre, centre, unsprung, track = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    for a, (axle, (left, right)) in enumerate(_AXLES.items()):
        ends = [left, right]
        pair, lever = np.ix_(ends, ends), y[ends] - y[ends].mean()
        springs = float(lever @ np.diag(n.stiffness[ends]) @ lever)
        suspension[a] = float(lever @ stiffness[pair] @ lever)
        bars = suspension[a] - springs
        tyre[a] = float(n.tyre[ends] @ lever**2)
        track[a] = float(np.ptp(y[ends]))
        centre[a] = float(np.mean([roll_centre(vehicle.corners[CORNERS[i]]) for i in ends]))
        unsprung[a] = float(n.unsprung[ends] @ heights[ends])
        out[f"roll_stiffness.{axle}"] = (per_degree * suspension[a], "N·m/deg")
        out[f"roll_stiffness_springs.{axle}"] = (per_degree * springs, "N·m/deg")
        out[f"roll_stiffness_bars.{axle}"] = (per_degree * bars, "N·m/deg")
    out["roll_stiffness_share.front"] = (100.0 * float(suspension[0] / suspension.sum()), "%")
    # Roll of the body and of both axles on their tyres, for 1 g sideways.
    xf, xr = x[:2].mean(), x[2:].mean()
    axis = centre[0] + (centre[1] - centre[0]) * (xf - cog[0]) / (xf - xr)
    arm = cog[2] - ground - axis
    jacked = G * np.array([share["front"], share["rear"]]) * centre
    A = np.array(
        [
            [suspension.sum() - mass * G * arm, -suspension[0], -suspension[1]],
            [-suspension[0], suspension[0] + tyre[0], 0.0],
            [-suspension[1], 0.0, suspension[1] + tyre[1]],
        ]
    )
    b = np.array([mass * G * arm, jacked[0] + G * unsprung[0], jacked[1] + G * unsprung[1]])
    sound = bool(np.all(np.isfinite(A))) and float(np.linalg.cond(A)) < 1e12
    angle = np.linalg.solve(A, b) if sound else np.full(3, np.nan)
    elastic, total = suspension * (angle[0] - angle[1:]) / track, tyre * angle[1:] / track
    out["roll_gradient"] = (float(angle[0]) / per_degree, "deg/g")
    for a, axle in enumerate(_AXLES):
        out[f"load_transfer.{axle}"] = (float(total[a]), "N/g")
        out[f"load_transfer_elastic.{axle}"] = (float(elastic[a]), "N/g")
        out[f"load_transfer_geometric.{axle}"] = (float(jacked[a] / track[a]), "N/g")
        out[f"load_transfer_unsprung.{axle}"] = (float(G * unsprung[a] / track[a]), "N/g")
    out["load_transfer_share.front"] = (100.0 * float(total[0] / total.sum()), "%")
    return out
