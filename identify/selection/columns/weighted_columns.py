"""Weighted columns of a fitted run, row by row: of the model, the sensor sheet and all candidates, and its residual."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.common_scale import scales_all, without_common_scale
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor


@dataclass(frozen=True)
class Block:
    """Weighted samples of one row of one run, or of a piece of it.

    Attributes
    ----------
    row : the row.
    zeros : (n, z) columns of the run's sensor zeros, for 1 σ of their priors.
    columns : (n, a) the columns that act on the row, at places `active` of the layout.
    number : (n,) number of each sample's block of `block_seconds` in the run.
    draws : (d, n) simulated noise of the row; `choice` (D,) which of them are the D simulated runs'.
    """

    row: Row
    zeros: Array
    columns: Array
    active: NDArray[np.intp]
    number: NDArray[np.intp]
    draws: Array
    choice: NDArray[np.intp]


@dataclass(frozen=True)
class Weighting:
    """How the columns of a fit's runs are weighted and turned.

    Attributes
    ----------
    layout : order of the columns.
    turn : (p, p) matrix T; the model's columns times T are nearly orthonormal and stand in place of them.
    prior_stiffening : 1 σ of the sensor sheet ÷ 1 σ of the zeros' priors.
    """

    layout: Layout
    turn: Array
    prior_stiffening: float


def blocks_of(fitted: Fit, floor: NoiseFloor, weighting: Weighting, run: int) -> Iterator[Block]:
    """Weighted samples of one run of a fit, row by row; a long run piece by piece."""
    filters, layout = fitted.runs[run].recording.filters, weighting.layout
    priors = fitted.zeros[run][1] / weighting.prior_stiffening
    seen: dict[Row, int] = {}

    def of_piece(piece: Piece) -> Iterator[Block]:
        for row, (columns, active) in columns_of(fitted, layout, piece, floor.sigma):
            start = seen.get(row, 0)
            seen[row] = start + len(columns)
            time = piece.instants[row] * (filters.step / filters.rate)
            number = (time // SELECTION.block_seconds).astype(np.intp)
            zeros = piece.blocks[row][:, : len(priors)] * (priors / floor.sigma[row])
            noise, choice = floor.draws[run].piece(row, start, seen[row])
            model = columns[:, : layout.model]
            # The right side is what the fit leaves: priors then hold on to the fit, and not to a smaller scale.
            columns[:, -1] -= model @ fitted.solution
            columns[:, : layout.model] = model @ weighting.turn
            yield Block(row, zeros, columns, active, number, noise / floor.sigma[row], choice)

    # Mapped, so that a piece's motion and slopes are gone before the next piece is made.
    return chain.from_iterable(map(of_piece, fitted.assembly.pieces_of(run)))


def sensor_columns(
    fitted: Fit, layout: Layout, piece: Piece, noisy: Piece | None = None
) -> dict[Row, tuple[list[int], Array]]:
    """Columns of the sheet's entries and sensor faults on a piece, or on `noisy`: row → places (p,), (p, n) columns."""
    found: dict[Row, list[tuple[int, Array]]] = {row: [] for row in piece.blocks}
    faults = [(t.place.start, fault) for t in layout.trials if (fault := t.effect.as_fault) is not None]
    if piece.sensitivity is not None and (faults or layout.sheet):
        assembly = fitted.assembly
        sheet = assembly.noisy_sheet_responses(noisy) if noisy else assembly.own_sheet_responses(piece)
        by_place = [(place, sheet.get(entry, {})) for place, entry in enumerate(layout.sheet, start=layout.model)]
        responses = (noisy or piece).fault_responses([fault for _, fault in faults])
        by_place += [(place, response) for (place, _), response in zip(faults, responses, strict=True)]
        for place, response in by_place:
            for row, series in response.items():
                if row in found:
                    found[row].append((place, series))
    out: dict[Row, tuple[list[int], Array]] = {}
    for row, columns in found.items():
        stacked = np.array([series for _, series in columns]).reshape(len(columns), len(piece.right[row]))
        acting = np.any(stacked, axis=1)
        out[row] = [place for (place, _), acts in zip(columns, acting.tolist(), strict=True) if acts], stacked[acting]
    return out


def _scaling(layout: Layout) -> list[int]:
    """Places of the sheet's entries and sensor faults that act in proportion to what is known without wheel loads."""
    sheet = [place for place, entry in enumerate(layout.sheet, start=layout.model) if scales_all(*entry[:2])]
    faults = [trial for trial in layout.trials if trial.effect.as_fault is not None]
    return sheet + [t.place.start for t in faults if any(scales_all(*entry) for entry in t.effect.sheet_entries)]


def columns_of(
    fitted: Fit, layout: Layout, piece: Piece, sigma: Mapping[Row, float], noisy: Piece | None = None
) -> Iterator[tuple[Row, tuple[Array, NDArray[np.intp]]]]:
    """Weighted columns (n, a) of each row of a piece, the measured side last, and their places in the layout.

    `noisy` : the piece with simulated noise, from which the columns are computed instead.
    """
    p, keep, run = layout.model, fitted.base.independent, (noisy or piece).prepared
    tried = [(trial.place, one) for trial in layout.trials if (one := trial.effect.as_physics) is not None]
    run.prepare([*(fitted.model.physics if noisy else ()), *(one for _, one in tried)])
    sensors = sensor_columns(fitted, layout, piece, noisy)
    if all(row.combined for row in fitted.rows):
        known = {row: run.measured[row] if noisy else piece.right[row] for row in piece.blocks}
        sensors = without_common_scale(sensors, _scaling(layout), known, sigma)
    physics = [(place, run.columns(one)) for place, one in tried]
    for row, block in piece.blocks.items():
        model, right = block[:, block.shape[1] - p :], piece.right[row]
        if noisy:
            model, right = model.copy(), run.measured[row]
            model[:, : len(keep)] = run.matrix(fitted.model.physics, row)[:, keep]
        own = [(place, found[row]) for place, found in physics if row in found]
        places, columns = sensors[row]
        parts = [model, columns.T, *(columns.T for _, columns in own), right[:, None]]
        active = [*range(p), *places, *(i for place, _ in own for i in range(place.start, place.stop)), layout.right]
        yield row, (np.concatenate(parts, axis=1) / sigma[row], np.array(active, np.intp))
