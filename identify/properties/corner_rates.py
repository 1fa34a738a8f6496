"""Rates, masses and static forces of the four corners for a ride and roll model, linear in a fit's parameters.

Every effect of the model counts, users' own too: its action on a suspension or tyre is the linear spring and damper
that fit its columns best over the motions of the runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import SUSPENSION_ROWS, TYRE_ROWS, Row
from lacet.identify.effects.base import PhysicalEffect, SuspensionForce, columns_by_row, with_places
from lacet.identify.multibody.rigid_body import PARAMETERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit

_STEP = {"travel": 1e-4, "rate": 1e-3, "deflection": 1e-4}
"""Half steps of the difference quotients by travel [m], its rate [m/s] and tyre deflection [m]."""


@dataclass(frozen=True)
class CornerNumbers:
    """Rates, masses and static forces of the four corners (in the order fl, fr, rl, rr), and the sprung mass.

    Attributes
    ----------
    stiffness, damping : (4,) of each corner's own springs [N/m] and dampers [N·s/m], at the wheel.
    coupled_stiffness, coupled_damping : (4, 4) force at corner i per travel (rate) of corner j by all other effects
        (anti-roll bars).
    tyre : (4,) vertical stiffness [N/m].
    unsprung : (4,) mass [kg], outboard of the transducer included.
    chassis : (10,) parameters of the sprung mass about the body origin, body axes (XX … M).
    static : (4,) suspension force at design height [N].
    """

    stiffness: Array
    damping: Array
    coupled_stiffness: Array
    coupled_damping: Array
    tyre: Array
    unsprung: Array
    chassis: Array
    static: Array

    @classmethod
    def unpack(cls, packed: Array) -> CornerNumbers:
        """The numbers of one packed vector (66,)."""
        k, c, kk, cc, kt, m, body, f0 = np.split(packed, np.cumsum(_SIZES)[:-1])
        return cls(k, c, kk.reshape(4, 4), cc.reshape(4, 4), kt, m, body, f0)


_SIZES = (4, 4, 16, 16, 4, 4, 10, 4)
BLOCKS = tuple(int(i) for i in np.repeat(np.arange(len(_SIZES)), _SIZES))
"""Index of the field that each element of the packed vector belongs to."""


def corner_numbers(fitted: Fit) -> Array:
    """(66, p): the packed numbers per unit of each parameter of the physics."""
    out = np.zeros((sum(_SIZES), fitted.model.physics_size))
    k, c, kk, cc, kt, m, body, f0 = np.split(out, np.cumsum(_SIZES)[:-1])
    for effect, part in with_places(fitted.model.physics):
        if effect.name == "body":
            _body(effect, body[:, part], m[:, part])
        elif effect.name == "outboard_mass":
            m[CORNERS.index(effect.where), part] = 1.0
        elif isinstance(effect, SuspensionForce):
            k[:, part], c[:, part], f0[:, part] = _own(fitted.runs, effect)
        else:
            for table, name, kind in (
                (kk, "travel", "suspension"),
                (cc, "rate", "suspension"),
                (kt, "deflection", "tyre"),
            ):
                slopes = _slopes(fitted.runs, effect, name, kind)
                table[:, part] = slopes.reshape(16, -1) if kind == "suspension" else np.einsum("iip->ip", slopes)
    return out


def rows_unseen(fitted: Fit) -> tuple[Row | None, ...]:
    """For each packed number the suspension or tyre row it is read from where no run has that row, else None.

    Such a number is 0 in `corner_numbers` for want of a measurement, not because the car has no spring there.
    """
    seen = {row for run in fitted.runs for row in run.index}
    corner, tyre = ([None if row in seen else row for row in rows] for rows in (SUSPENSION_ROWS, TYRE_ROWS))
    pairs = [row for row in corner for _ in CORNERS]
    return (*corner, *corner, *pairs, *pairs, *tyre, *[None] * sum(_SIZES[5:]))


def suspension_laws(
    effect: PhysicalEffect, motion: Motion, travel: Mapping[str, Array], rate: Mapping[str, Array]
) -> dict[str, Array]:
    """Corner → (p, n) suspension force per unit of an effect's parameters, at other travels and rates (n,)."""
    corners = {
        c: replace(one, travel=travel[c], rate=rate[c], conditional=None) if c in travel else one
        for c, one in motion.corners.items()
    }
    columns = columns_by_row(effect, replace(motion, corners=corners))
    return {row.place: a for row, a in columns.items() if row.kind == "suspension"}


def _body(effect: PhysicalEffect, chassis: Array, unsprung: Array) -> None:
    kind, _, corner = effect.where.partition(".")
    names = [q.name.rstrip("0123456789") for q in effect.parameters]
    if kind == "chassis":
        for column, name in enumerate(names):
            chassis[PARAMETERS.index(name), column] = 1.0
    else:
        unsprung[CORNERS.index(corner), names.index("M")] = 1.0


def _samples(
    runs: Sequence[PreparedRun], effect: PhysicalEffect
) -> Iterator[tuple[Motion, Mapping[Row, NDArray[np.intp]]]]:
    """Motions on which an effect's columns can be computed, each with the places of the rows' kept samples."""
    for run in runs:
        if effect.instantaneous:
            yield run.kept_motion, {row: run.kept(row) for row in run.rows}
        else:
            yield from ((piece.motion, piece.index) for piece in run.pieces())


def _own(runs: tuple[PreparedRun, ...], effect: SuspensionForce) -> tuple[Array, Array, Array]:
    """(4, p) spring and damper that fit an effect best over all samples of the runs, and its force at design height."""
    p = len(effect.parameters)
    normal, right = np.zeros((4, 3, 3)), np.zeros((4, 3, p))
    f0 = np.zeros((4, p))
    for motion, kept in _samples(runs, effect):
        columns = columns_by_row(effect, motion)
        zero = {c: np.zeros(1) for c in CORNERS}
        for c, at_rest in suspension_laws(effect, motion, zero, zero).items():
            f0[CORNERS.index(c)] = at_rest[:, 0]
        for i, row in enumerate(SUSPENSION_ROWS):
            if row in columns and row in kept:
                at, corner = kept[row], motion.corners[row.place]
                basis = np.stack([np.ones(at.size), corner.travel[at], corner.rate[at]])
                normal[i] += basis @ basis.T
                right[i] += basis @ columns[row][:, at].T
    slopes = np.linalg.pinv(normal) @ right
    return slopes[:, 1], slopes[:, 2], f0


def _slopes(runs: tuple[PreparedRun, ...], effect: PhysicalEffect, name: str, kind: str) -> Array:
    """(4, 4, p) mean slope of the force at corner i by a quantity of corner j, over all samples of the runs."""
    out = np.zeros((4, 4, len(effect.parameters)))
    counts = np.zeros(4)
    step = _STEP[name]
    for motion, kept in _samples(runs, effect):
        acted = [row for row in columns_by_row(effect, motion) if row.kind == kind and row in kept]
        if not acted:
            continue
        for row in acted:
            counts[CORNERS.index(row.place)] += kept[row].size
        for j, moved in enumerate(CORNERS):
            up, down = (columns_by_row(effect, _moved(motion, moved, name, sign * step)) for sign in (1.0, -1.0))
            for row in acted:
                difference = (up[row] - down[row])[:, kept[row]] / (2.0 * step)
                out[CORNERS.index(row.place), j] += difference.sum(axis=1)
    return out / np.maximum(counts, 1.0)[:, None, None]


def _moved(motion: Motion, corner: str, name: str, by: float) -> Motion:
    one = motion.corners[corner]
    changes: dict[str, Callable[[], CornerMotion]] = {
        "travel": lambda: replace(one, travel=one.travel + by),
        "rate": lambda: replace(one, rate=one.rate + by),
        "deflection": lambda: replace(one, deflection=one.deflection + by),
    }
    return replace(motion, corners={**motion.corners, corner: changes[name]()})
