"""Plausibility checks of a run against itself: wires that were exchanged."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from lacet.daq.channels import CORNERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.filters import decimate

_CLEAR = 0.5
"""Another assignment of wheels to corners must leave less than this part of the misfit to be believed."""
_FOLLOWS = 0.25
"""Part of a wheel's load variance that its tyre deflection may leave for the check to say anything."""


def exchanged_wheels(run: PreparedRun) -> Mapping[str, str]:
    """Wheels whose loads follow the tyre deflection of another corner, as wheel → corner; empty when all is well.

    A tyre's load follows its own deflection closely, whatever the car and the manoeuvre; where the loads of two wheels
    fit each other's deflections much better than their own, their wires were exchanged.
    """
    motion = run.motion
    corners = [c for c in CORNERS if f"tyre.{c}" in run.rows]
    if len(corners) < 2:
        return {}
    keep = motion.kept(f"tyre.{corners[0]}")
    for c in corners[1:]:
        keep = np.intersect1d(keep, motion.kept(f"tyre.{c}"))
    if keep.size < 30:
        return {}
    loads: list[Array] = list(decimate(np.stack([motion.measured(f"tyre.{c}") for c in corners]), motion.filters, keep))
    deflections = decimate(np.stack([motion.corners[c].deflection for c in corners]), motion.filters, keep)
    cost = np.ones((len(corners), len(corners)))
    for i, load in enumerate(loads):
        for j, deflection in enumerate(deflections):
            centred: Array = np.asarray(deflection - np.mean(deflection), float)
            if not np.any(centred) or not float(np.var(load)):
                continue  # a dead sensor follows nothing
            slope = float(centred @ load / (centred @ centred))
            misfit = float(np.var(load - slope * centred) / np.var(load))
            cost[i, j] = misfit if slope > 0 else 1.0
    wheels, places = linear_sum_assignment(cost)
    own, best = float(np.trace(cost)), float(cost[wheels, places].sum())
    moved = {corners[i]: corners[j] for i, j in zip(wheels, places, strict=True) if i != j}
    if (
        not moved
        or best > _CLEAR * own
        or any(cost[corners.index(w), corners.index(c)] > _FOLLOWS for w, c in moved.items())
    ):
        return {}
    return moved
