"""A singular or badly scaled problem in words: which parameters take part, and what hardly moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.daq.errors import UsageError
from lacet.identify.car.rows import row_unit
from lacet.identify.effects.base import Effect, PhysicalEffect, SuspensionForce
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.multibody.base_parameters import BaseParameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun

CONDITION = 1e6
"""Ratio of best to worst known direction beyond which a problem is badly scaled, parameters in plausible sizes."""
_SHARE = 0.05
_MOST = 6


def weak_directions(
    root: Array, priors: Array, condition: float = CONDITION, least: float = 0.0
) -> tuple[tuple[tuple[int, float], ...], ...]:
    """Combinations of parameters that equations leave open, each as (index, coefficient) in plausible sizes.

    Parameters
    ----------
    root : (n, q) weighted equations, or their R factor; a last column more than `priors` (right side) is not looked at.
    priors : (q,) plausible size of each parameter.
    condition : a direction is open when it is known this many times worse than the best.
    least : or when its singular value, in units of 1 / plausible size, is below this.

    A direction is written with the parameter that takes part most at 1 or −1; those with less than 5 % of the share of
    the squares are left out.
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
    basis = null @ np.linalg.inv(null[pivots])
    out: list[tuple[tuple[int, float], ...]] = []
    for column in basis.T:
        share = column**2 / np.sum(column**2)
        members = [int(i) for i in np.argsort(-share, kind="stable") if share[i] >= _SHARE]
        strongest = float(np.abs(column[members[0]]))
        out.append(tuple((i, float(column[i]) / strongest) for i in members))
    return tuple(out)


def explain_singular(
    root: Array, names: Sequence[str], priors: Sequence[float] | Array, condition: float = CONDITION, least: float = 0.0
) -> list[str]:
    """Every open direction of `weak_directions` in words, with the share of each parameter.

    Raises UsageError when `root` has entries that are not finite, naming the parameters they belong to.
    """
    size = np.asarray(priors, float)
    table = np.asarray(root, float)[:, : len(names)]
    bad = [names[int(k)] for k in np.flatnonzero(~np.all(np.isfinite(table), axis=0))]
    if bad:
        raise UsageError(f"the equations are not finite in the columns of {_listed(bad)}")
    return [_in_words(direction, names) for direction in weak_directions(table, size, condition, least)]


def explain_weak(
    root: Array, names: Sequence[str], model: Model, runs: Sequence[PreparedRun], least: float = 2.0
) -> list[str]:
    """What a fit's equations leave open, with what hardly moves in the runs.

    `root` is the weighted triangle with the plausible ranges in it (`Information.root`), `names` its unknowns. Sensor
    zeros follow freely. A direction is open when the runs leave it no better known than half its plausible size.
    """
    known = {q.name: q.prior for q in model.parameters}
    chosen = [k for k, name in enumerate(names) if name in known]
    others = [k for k, name in enumerate(names) if name not in known]
    turned = np.asarray(scipy.linalg.qr(root[:, [*others, *chosen]], mode="r")[0], float)[len(others) :, len(others) :]
    picked = [names[k] for k in chosen]
    priors = np.array([known[name] for name in picked])
    owners = _owners(model)
    single: dict[str, list[str]] = {}
    out: list[str] = []
    for direction in weak_directions(turned, priors, CONDITION, least):
        members = [picked[i] for i, _ in direction]
        if len(members) == 1:
            single.setdefault(owners[members[0]].key, []).append(members[0])
        else:
            out.append(_in_words(direction, picked) + _why(members, model, runs))
    for members in single.values():
        ordered = sorted(members, key=picked.index)
        out.append(
            f"{_listed(ordered)} {'is' if len(ordered) == 1 else 'are'} not determined" + _why(ordered, model, runs)
        )
    return out


def explain_grouping(base: BaseParameters, model: Model, runs: Sequence[PreparedRun]) -> list[str]:
    """Parameters that these runs merge into others although they act differently, with what hardly moves.

    Groups of rigid bodies among themselves are the car's build (a wheel's mass moves with its axle's) and are left out.
    """
    owners = _owners(model)
    out: list[str] = []
    for column, k in enumerate(base.dependent):
        name = base.names[int(k)]
        holders = [base.names[int(i)] for i in base.independent[base.relations[:, column] != 0.0]]
        if all(isinstance(owners[n], RigidBody) for n in (name, *holders)):
            continue
        out.append(f"{name} cannot be told from {_listed(holders)}" + _why([name, *holders], model, runs))
    return out


def not_finite(effects: Sequence[PhysicalEffect], runs: Sequence[PreparedRun]) -> list[str]:
    """Where equations have entries that are not finite: the measurement or effect, run, row and first instant."""
    out: list[str] = []
    for run in runs:
        for row in run.rows:
            t = run.recording.t[run.index[row]]
            bad = np.flatnonzero(~np.isfinite(run.measured[row]))
            if bad.size:
                out.append(f"{run.name}, {row}: the measured side is not finite at {_when(t, bad)}")
            for effect in effects:
                table = run.columns(effect).get(row)
                bad = np.flatnonzero(~np.all(np.isfinite(table), axis=0)) if table is not None else bad[:0]
                if bad.size:
                    out.append(f"{run.name}, {row}: {effect.key} is not finite at {_when(t, bad)}")
    return out


def refuse_not_finite(effects: Sequence[PhysicalEffect], runs: Sequence[PreparedRun]) -> None:
    """Raise UsageError with every place of `not_finite`, if there is one."""
    if found := not_finite(effects, runs):
        raise UsageError(
            "the equations have values that are not finite:\n"
            + "\n".join(f"  - {line}" for line in found[:20])
            + ("\n  - …" if len(found) > 20 else "")
            + "\nMend the effect's columns() (a division, a root or a logarithm?), or leave it out"
        )


def _when(t: Array, bad: NDArray[np.intp]) -> str:
    return f"t = {t[bad[0]]:.2f} s ({bad.size} of {t.size} samples)"


def _in_words(direction: Sequence[tuple[int, float]], names: Sequence[str]) -> str:
    total = sum(c**2 for _, c in direction)
    members = [(names[i], round(100 * c**2 / total)) for i, c in direction]
    if len(members) == 1:
        return f"{members[0][0]} is not determined"
    more = f" and {len(members) - _MOST} more" if len(members) > _MOST else ""
    return _listed([f"{name} ({share} %)" for name, share in members[:_MOST]]) + more + " cannot be told apart"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def _owners(model: Model) -> dict[str, Effect]:
    return {q.name: effect for effect in (*model.physics, *model.faults) for q in effect.parameters}


def _why(members: Sequence[str], model: Model, runs: Sequence[PreparedRun]) -> str:
    """What hardly moves, after a colon: travel for suspension laws, else how little these parameters change any row."""
    owners = _owners(model)
    laws = [one for name in members if isinstance(one := owners[name], SuspensionForce)]
    if laws:
        corners = sorted({c for one in laws for c in one.corners()} & {c for d in runs for c in d.motion.corners})
        travel, rate = (_spread(runs, corners, what) for what in ("travel", "rate"))
        return f": travel at {', '.join(corners)} moves by ± {_plain(travel)} mm, at ± {_plain(rate)} mm/s"
    physics = [owners[name].as_physics for name in members]
    size, row = 0.0, ""
    for name, effect in zip(members, physics, strict=True):
        if effect is None:
            return ""
        place = [q.name for q in effect.parameters].index(name)
        for run in runs:
            for key, table in run.columns(effect).items():
                change = effect.parameters[place].largest * float(np.std(table[place]))
                if change > size:
                    size, row = change, key
    if not row:
        return ": nothing these runs measure changes with it"
    who = "it changes" if len(members) == 1 else "one of them changes"
    return f": at its largest plausible value {who} {row} by ± {size:.2g} {row_unit(row)}, and no row more"


def _plain(metres: float) -> str:
    """Millimetres to two digits; below a tenth of a micrometre it is rounding."""
    return f"{1e3 * metres:.2g}" if metres >= 1e-7 else "0"


def _spread(runs: Sequence[PreparedRun], corners: Sequence[str], what: str) -> float:
    """Largest standard deviation of a corner's travel or its rate, over corners and runs."""
    return max(float(np.std(getattr(run.motion.corners[c], what))) for run in runs for c in corners)
