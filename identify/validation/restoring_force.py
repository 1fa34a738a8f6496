"""Restoring-force surfaces: force of a suspension, and residual of its model, over travel and travel rate.

Springs, dampers and whatever else acts between body and wheel of one corner form a surface over travel and rate; a
force that depends on something else (a bar on the other wheel's travel) shows as scatter about it. Source: Masri and
Caughey, A nonparametric identification technique for nonlinear dynamic problems, J. Appl. Mech. 46 (1979).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.car.rows import SUSPENSION_ROWS, Row
from lacet.identify.effects.base import with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.blocks import block_numbers

LEAST_SAMPLES = 4
"""Number of samples below which a cell is left empty."""
CELLS = 11


@dataclass(frozen=True)
class Surface:
    """The restoring-force surface of one corner, on a grid of travel and travel rate.

    Attributes
    ----------
    travel, rate : (T + 1,), (R + 1,) edges of the cells [m], [m/s], compression positive.
    residual : (R, T) mean residual of the suspension row [N]; NaN where there are too few samples.
    force : (R, T) mean force of the suspension: its effects in the model and the residual [N], resisting compression.
    count : (R, T) samples; `blocks` (R, T) number of two-second blocks they are from: one alone is no evidence.
    scatter : RMS of the residual about its cell's mean [N]: the part that is no function of travel and rate.
    """

    corner: str
    travel: Array
    rate: Array
    residual: Array
    force: Array
    count: NDArray[np.intp]
    blocks: NDArray[np.intp]
    scatter: float


def restoring_surfaces(fitted: Fit, cells: int = CELLS) -> dict[str, Surface]:
    """Corner → surface, over the runs a model was fitted to, for the corners whose suspension row is measured."""
    out: dict[str, Surface] = {}
    for corner in CORNERS:
        row = Row.parse(f"suspension.{corner}")
        having = [i for i, run in enumerate(fitted.runs) if row in run.index]
        if not having:
            continue
        moving = [_moving(fitted.runs[i], row, corner) for i in having]
        travel, rate = np.concatenate(moving, axis=1)
        residual = np.concatenate([fitted.residual[i][row] for i in having])
        force = residual + np.concatenate([_modelled(fitted, fitted.runs[i], row) for i in having])
        out[corner] = surface(corner, travel, rate, residual, force, block_numbers(fitted.runs, row), cells)
    return out


def surface(
    corner: str, travel: Array, rate: Array, residual: Array, force: Array, blocks: NDArray[np.intp], cells: int = CELLS
) -> Surface:
    """The restoring-force surface of series (n,) over a grid of equal cells that covers all but the outermost 1 %."""
    edges = [_edges(series, cells) for series in (travel, rate)]
    i, j = (np.searchsorted(e, series, side="right") - 1 for e, series in zip(edges, (travel, rate), strict=True))
    inside = (i >= 0) & (i < cells) & (j >= 0) & (j < cells)
    cell, size = (j * cells + i)[inside], cells * cells
    count = np.bincount(cell, minlength=size)
    met = np.unique(np.stack([cell, blocks[inside]]), axis=1)[0]

    def mean(series: Array) -> Array:
        sums = np.bincount(cell, weights=series[inside], minlength=size)
        return np.where(count >= LEAST_SAMPLES, sums / np.maximum(count, 1), np.nan)

    means = mean(residual)
    seen = np.isfinite(means[cell])
    about = residual[inside][seen] - means[cell[seen]]
    shape = (cells, cells)
    return Surface(
        corner, edges[0], edges[1], means.reshape(shape), mean(force).reshape(shape),
        count.reshape(shape), np.bincount(met, minlength=size).reshape(shape),
        float(np.sqrt(np.mean(about**2))) if about.size else float("nan"),
    )  # fmt: skip


def _edges(series: Array, cells: int) -> Array:
    low, high = (float(x) for x in np.quantile(series, (0.005, 0.995)))
    pad = 0.5e-9 + 1e-6 * float(high - low)
    return np.asarray(np.linspace(low - pad, high + pad, cells + 1), float)


def _moving(run: PreparedRun, row: Row, corner: str) -> Array:
    return run.filtered(row, lambda motion: np.stack([motion.corners[corner].travel, motion.corners[corner].rate]))


def _modelled(fitted: Fit, run: PreparedRun, row: Row) -> Array:
    """(n,) force of the effects that act on suspension rows alone: springs, dampers, bars, not inertia."""
    out = np.zeros(len(run.index[row]))
    for effect, part in with_places(fitted.model.physics):
        rows = run.columns(effect)
        if row in rows and all(name in SUSPENSION_ROWS for name in rows):
            out = out + run.matrix((effect,), row) @ fitted.physics[part]
    return out
