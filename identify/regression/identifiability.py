"""Identifiability: parameters that the equations do not determine, and the motion that is too small for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lacet.daq.errors import UsageError
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, PhysicalEffect, SuspensionForce
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.multibody.base_parameters import BaseParameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun

CONDITION = 1e6
"""Condition number above which a problem counts as singular, parameters in units of their plausible size [ratio]."""
_SHARE = 0.05


@dataclass(frozen=True)
class SmallTravel:
    """Too little suspension motion at `corners`: largest standard deviations of `travel` [m] and `rate` [m/s] there."""

    corners: tuple[str, ...]
    travel: float
    rate: float


@dataclass(frozen=True)
class SmallChange:
    """Too small an influence of parameters on the rows.

    Attributes
    ----------
    row : row that changes most with one of them at its largest plausible value; None where no row changes.
    size : standard deviation of that change [N or N·m].
    single : whether it is one parameter only.
    """

    row: Row | None
    size: float
    single: bool


@dataclass(frozen=True)
class Undetermined:
    """Parameters that the equations do not determine; `why` : the motion or influence that is too small."""

    names: tuple[str, ...]
    why: SmallTravel | SmallChange | None = None


@dataclass(frozen=True)
class Combination:
    """Combination of parameters that the equations do not determine: each parameter with its share of it [%]."""

    shares: tuple[tuple[str, float], ...]
    why: SmallTravel | SmallChange | None = None


@dataclass(frozen=True)
class Merged:
    """Parameter that these runs do not separate from others, `holders`, although its effect is a different one."""

    name: str
    holders: tuple[str, ...]
    why: SmallTravel | SmallChange | None = None


@dataclass(frozen=True)
class NotFinite:
    """Infinite or undefined entries of the equations in one row of one run.

    Attributes
    ----------
    run, row : where they are.
    effect : key of the effect whose column they are in; None for the measured side.
    first : time of the first [s].
    count : samples with such an entry, of the `samples` that the row has.
    """

    run: str
    row: Row
    effect: str | None
    first: float
    count: int
    samples: int


def weak_directions(
    root: Array, priors: Array, condition: float = CONDITION, least: float = 0.0
) -> tuple[tuple[tuple[int, float], ...], ...]:
    """Combinations of parameters that equations do not determine, each as pairs (index, coefficient).

    Parameters
    ----------
    root : (n, q) weighted equations, or their R factor; a further column, the right side, is ignored.
    priors : (q,) plausible size of each parameter: the unit of the coefficients.
    condition : a direction is undetermined when its singular value is this many times smaller than the largest.
    least : or when its singular value, in units of 1 / plausible size, is below this.

    The largest coefficient of a direction is scaled to ±1; parameters with less than 5 % of the sum of squares are
    left out.
    """
    table = np.asarray(root, float)[:, : len(priors)] * priors
    _, values, Vt = scipy.linalg.svd(np.concatenate([table, np.zeros((max(0, len(priors) - len(table)), len(priors)))]))
    singular = np.asarray(values, float)
    open_ones = (singular <= singular[0] / condition) | (singular < least) if singular[0] > 0.0 else singular >= 0.0
    null = np.asarray(Vt, float)[open_ones].T
    if not null.size:
        return ()
    # Singular vectors of like values mix at will: in the basis of pivots each combination stands by itself.
    pivots = np.asarray(scipy.linalg.qr(null.T, pivoting=True, mode="r")[1])[: null.shape[1]]
    basis: Array = null @ np.linalg.inv(null[pivots])
    out: list[tuple[tuple[int, float], ...]] = []
    for column in basis.T:
        share = column**2 / np.sum(column**2)
        members = [int(i) for i in np.argsort(-share, kind="stable") if share[i] >= _SHARE]
        strongest = float(np.abs(column[members[0]]))
        out.append(tuple((i, float(column[i]) / strongest) for i in members))
    return tuple(out)


def explain_singular(
    root: Array, names: Sequence[str], priors: Sequence[float] | Array, condition: float = CONDITION, least: float = 0.0
) -> list[Undetermined | Combination]:
    """Parameters and combinations that equations do not determine (`weak_directions`), with each parameter's share.

    Raises UsageError when `root` has entries that are not finite, naming the parameters they belong to.
    """
    size = np.asarray(priors, float)
    table = np.asarray(root, float)[:, : len(names)]
    bad = [names[int(k)] for k in np.flatnonzero(~np.all(np.isfinite(table), axis=0))]
    if bad:
        listed = " and ".join(filter(None, (", ".join(bad[:-1]), bad[-1])))
        raise UsageError(f"the equations are not finite in the columns of {listed}")
    return [_open_direction(direction, names) for direction in weak_directions(table, size, condition, least)]


def explain_weak(
    root: Array, names: Sequence[str], model: Model, runs: Sequence[PreparedRun], least: float = 2.0
) -> list[Undetermined | Combination]:
    """Parameters and combinations that a fit's equations do not determine, with the motion that is too small for them.

    `root` is the weighted triangle with the plausible ranges as priors (`Information.root`), `names` its unknowns;
    sensor zeros are eliminated. A direction is undetermined when its σ is above half its plausible size.
    """
    known = {q.name: q.prior for q in model.parameters}
    chosen = [k for k, name in enumerate(names) if name in known]
    others = [k for k, name in enumerate(names) if name not in known]
    turned = np.asarray(scipy.linalg.qr(root[:, [*others, *chosen]], mode="r")[0], float)[len(others) :, len(others) :]
    picked = [names[k] for k in chosen]
    priors = np.array([known[name] for name in picked])
    owners = _owners(model)
    single: dict[str, list[str]] = {}
    out: list[Undetermined | Combination] = []
    for direction in weak_directions(turned, priors, CONDITION, least):
        members = [picked[i] for i, _ in direction]
        if len(members) == 1:
            single.setdefault(owners[members[0]].key, []).append(members[0])
        else:
            out.append(replace(_open_direction(direction, picked), why=_weakness(members, model, runs)))
    for members in single.values():
        ordered = sorted(members, key=picked.index)
        out.append(Undetermined(tuple(ordered), _weakness(ordered, model, runs)))
    return out


def explain_grouping(base: BaseParameters, model: Model, runs: Sequence[PreparedRun]) -> list[Merged]:
    """Parameters that these runs do not separate from others although their effects differ, and the reason.

    Groups of rigid bodies follow from the structure of the car (a wheel's mass moves with its axle's) and are left out.
    """
    owners = _owners(model)
    out: list[Merged] = []
    for column, k in enumerate(base.dependent):
        name = base.names[int(k)]
        holders = [base.names[int(i)] for i in base.independent[base.relations[:, column] != 0.0]]
        if all(isinstance(owners[n], RigidBody) for n in (name, *holders)):
            continue
        out.append(Merged(name, tuple(holders), _weakness([name, *holders], model, runs)))
    return out


def not_finite(effects: Sequence[PhysicalEffect], runs: Sequence[PreparedRun]) -> list[NotFinite]:
    """Infinite or undefined entries of the equations: for each run and row the measured side, then the effects."""
    out: list[NotFinite] = []
    for run in runs:
        for row in run.rows:
            t = run.recording.t[run.index[row]]
            bad = np.flatnonzero(~np.isfinite(run.measured[row]))
            if bad.size:
                out.append(NotFinite(run.name, row, None, float(t[bad[0]]), bad.size, t.size))
            for effect in effects:
                table = run.columns(effect).get(row)
                bad = np.flatnonzero(~np.all(np.isfinite(table), axis=0)) if table is not None else bad[:0]
                if bad.size:
                    out.append(NotFinite(run.name, row, effect.key, float(t[bad[0]]), bad.size, t.size))
    return out


def refuse_not_finite(effects: Sequence[PhysicalEffect], runs: Sequence[PreparedRun]) -> None:
    """Raise UsageError with every place of `not_finite`, if there is one."""
    if found := not_finite(effects, runs):
        raise UsageError(
            "the equations have values that are not finite:\n"
            + "\n".join(
                f"  - {one.run}, {one.row}: {one.effect or 'the measured side'} is not finite at t = {one.first:.2f} s "
                f"({one.count} of {one.samples} samples)"
                for one in found[:20]
            )
            + ("\n  - …" if len(found) > 20 else "")
            + "\nMend the effect's columns() (a division, a root or a logarithm?), or leave it out"
        )


def _open_direction(direction: Sequence[tuple[int, float]], names: Sequence[str]) -> Undetermined | Combination:
    if len(direction) == 1:
        return Undetermined((names[direction[0][0]],))
    total = sum(c**2 for _, c in direction)
    return Combination(tuple((names[i], 100 * c**2 / total) for i, c in direction))


def _owners(model: Model) -> dict[str, Effect]:
    return {q.name: effect for effect in (*model.physics, *model.faults) for q in effect.parameters}


def _weakness(members: Sequence[str], model: Model, runs: Sequence[PreparedRun]) -> SmallTravel | SmallChange | None:
    """Why these parameters are not determined: travel for suspension laws, else their largest influence on a row."""
    owners = _owners(model)
    laws = [one for name in members if isinstance(one := owners[name], SuspensionForce)]
    if laws:
        corners = sorted({c for one in laws for c in one.corners()} & {c for d in runs for c in d.kept_motion.corners})
        travel, rate = (_spread(runs, corners, what) for what in ("travel", "rate"))
        return SmallTravel(tuple(corners), travel, rate)
    physics = [owners[name].as_physics for name in members]
    size = 0.0
    row: Row | None = None
    for name, effect in zip(members, physics, strict=True):
        if effect is None:
            return None
        place = [q.name for q in effect.parameters].index(name)
        for run in runs:
            for key, table in run.columns(effect).items():
                change = effect.parameters[place].largest * float(np.std(table[place]))
                if change > size:
                    size, row = change, key
    return SmallChange(row, size, len(members) == 1)


def _spread(runs: Sequence[PreparedRun], corners: Sequence[str], what: str) -> float:
    """Largest standard deviation of a corner's travel or its rate, over corners and runs."""
    outlines = [run.overview().outline for run in runs]
    return max(float(np.std(getattr(outline.corners[c], what))) for outline in outlines for c in corners)
