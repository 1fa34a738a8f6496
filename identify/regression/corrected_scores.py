"""Bias of an estimate from noise in the regressors, and its removal: Monte-Carlo corrected scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect, with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.prepared_run import NoisyColumns
from lacet.identify.regression.qr_accumulation import added, scaled_triangle

NOISE_DRAWS = 6
"""Pairs of noise draws for the correction of bias; the intervals include the uncertainty from their finite number."""
SOUND = 0.5
"""Largest part of a direction's information that may be noise in its columns: beyond it no correction is possible."""


@dataclass
class NoiseMoments:
    """Monte-Carlo means of the scores' bias from noise in the regressors: E[(W + δW)ᵀ δr] = constant − slope θ.

    At the true θ the weighted scores Wᵀ r have this mean instead of zero (Novick and Stefanski, 2002). It is estimated
    from pairs of simulated noise, each draw added once and subtracted once: terms of first order in the noise cancel,
    the product δWᵀ δr and the mean shift of nonlinear laws remain. Each run's zeros are functions of the parameters
    here: they absorb the mean shift of a nonlinear law, which would else move a static load by 100 N.

    Columns that are expectations given the record (`PhysicalEffect.conditional`) count in δW, and in δr with their
    linear part alone, which is taken at the measured rate: what a law differs from its expectation has the mean zero
    given anything that was measured, so that noise brings no bias through it; what it brings through the other columns
    is correlated with these columns too.

    Attributes
    ----------
    slopes : (D, p, p), one for each pair of draws.
    constants : (D, p).
    """

    slopes: Array
    constants: Array

    @classmethod
    def zero(cls, p: int, draws: int = NOISE_DRAWS) -> NoiseMoments:
        """Moments of no equations: zeros, to which `add` adds those of the runs."""
        return cls(np.zeros((draws, p, p)), np.zeros((draws, p)))

    @classmethod
    def merged(cls, parts: Sequence[NoiseMoments]) -> NoiseMoments:
        """Those of several runs together."""
        return cls(added([part.slopes for part in parts]), added([part.constants for part in parts]))

    @property
    def draws(self) -> int:
        """Number of pairs of draws."""
        return len(self.constants)

    def subset(self, pairs: NDArray[np.intp]) -> NoiseMoments:
        """Moments of the pairs of draws with these indices, which may repeat."""
        return NoiseMoments(self.slopes[pairs], self.constants[pairs])

    def add(
        self, piece: Piece, effects: Sequence[PhysicalEffect], keep: NDArray[np.int64], sigma: Mapping[Row, float],
        zeros: tuple[Array, Array],
    ) -> None:  # fmt: skip
        """Add the moments of a piece; `zeros` : gain (z, p) and offset (z,) of its zeros, z = offset − gain x."""
        gain, offset = zeros
        z, b = len(offset), len(keep)
        place = (piece.seed,) if piece.number is None else (piece.seed, piece.number)
        plain = {row: block[:, z:] - block[:, :z] @ gain for row, block in piece.blocks.items()}
        placed = list(with_places(effects))
        position = np.full(placed[-1][1].stop, -1)
        position[keep] = np.arange(b)
        for draw in range(self.draws):
            pair = piece.prepared.noisy_columns(effects, [2002, *place, draw])
            for row, W in plain.items():
                weight = np.full(len(W), sigma[row] ** -2.0)
                if piece.weights is not None:
                    weight = weight * piece.weights[row] ** 2
                # Only the few columns that act on this row have a δ.
                active, shifts, given = _shifts(pair, placed, row, position, piece.blocks[row][:, z : z + b])
                errors = [noisy.measured[row] - piece.right[row] for noisy in pair]
                weighted: Array = 0.5 * weight * W.T
                self.slopes[draw][:, active] += weighted @ (given[0] + given[1])
                self.constants[draw] += weighted @ (errors[0] + errors[1])
                for shift, own, error in zip(shifts, given, errors, strict=True):
                    part: Array = 0.5 * shift.T * weight
                    self.slopes[draw][np.ix_(active, active)] += part @ own
                    self.constants[draw][active] += part @ error

    def correct(self, x: Array, root: Array, priors: Array) -> tuple[Array, Array]:
        """The estimate corrected for the bias, (p,), and the covariance of the correction, (p, p).

        The covariance has two parts: the scatter from the finite number of draws, and the prior's variance in
        directions whose columns are mostly noise (`given_back`): least squares finds a value near zero with a narrow
        interval there, and no correction is possible.

        Parameters
        ----------
        x : (p,) weighted least-squares estimate.
        root : (p + 1, p + 1) R factor of the weighted equations, zeros eliminated.
        priors : (p,) 1 σ of each parameter's prior.
        """
        p = len(x)
        slope, constant = self.slopes.mean(axis=0), self.constants.mean(axis=0)
        R, lengths = scaled_triangle(root[:, :p])
        # In coordinates where the normal matrix is the identity, the corrected equations are (I − S) x = x₀ − k.
        solved = np.asarray(scipy.linalg.solve_triangular(R[:p], np.eye(p)), float)
        inverse: Array = solved / lengths[:, None]
        x0, k = R[:p] @ (lengths * x), inverse.T @ constant
        noise = inverse.T @ slope @ inverse
        spectrum = np.linalg.eigh(0.5 * (noise + noise.T))
        part, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
        good, lost = V[:, part < SOUND], V[:, part >= SOUND]
        # Columns that are expectations bring less noise into the residual than they have: the matrix is not symmetric.
        growth = np.asarray(np.linalg.inv(np.eye(good.shape[1]) - good.T @ noise @ good), float)
        given: Array = lost @ (lost.T @ x0)
        corrected = inverse @ (good @ (growth @ (good.T @ (x0 - k + noise @ given))) + given)
        scores = self.constants - self.slopes @ corrected
        scatter = (scores - scores.mean(axis=0)) @ (inverse @ good @ growth @ good.T).T
        doubt = scatter.T @ scatter / (self.draws * (self.draws - 1))
        return corrected, doubt + given_back(inverse, slope, priors)


def _shifts(
    pair: Sequence[NoisyColumns],
    placed: Sequence[tuple[PhysicalEffect, slice]],
    row: Row,
    position: NDArray[np.intp],
    clean: Array,
) -> tuple[NDArray[np.intp], list[Array], list[Array]]:
    """Indices (a,) of a row's columns that contain noise, and their changes (n, a) with the draw added and subtracted.

    Then the same changes of what the columns bring into the residual, per unit of their parameters. `position` is the
    index of each parameter among the columns `clean` (n, b) without the draw, −1 for none.
    """
    places, _ = pair[0].acting(placed, row)
    at = position[places]
    there = at >= 0

    def changes(given: bool) -> list[Array]:
        return [noisy.acting(placed, row, given)[1][:, there] - clean[:, at[there]] for noisy in pair]

    shifts, own = changes(given=False), changes(given=True)
    moved = np.any(shifts[0] != 0.0, axis=0)
    return at[there][moved], [one[:, moved] for one in shifts], [one[:, moved] for one in own]


def given_back(inverse: Array, noise: Array, priors: Array) -> Array:
    """(p, p) prior covariance of the directions whose information is mostly noise in the columns.

    Parameters
    ----------
    inverse : (p, p) with inverse · inverseᵀ the covariance of independent residuals.
    noise : (p, p) E[δWᵀ δW] of the weighted columns.
    priors : (p,) 1 σ of each parameter's prior.
    """
    spectrum = np.linalg.eigh(inverse.T @ (0.5 * (noise + noise.T)) @ inverse)
    part, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
    lost = inverse @ V[:, part >= SOUND]
    known = np.sum((lost / priors[:, None]) ** 2, axis=0)
    widening = np.maximum(0.0, 1.0 / np.maximum(known, 1e-12) - 1.0)
    return (lost * widening) @ lost.T
