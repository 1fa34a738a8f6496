"""What noise in the regressors does to an estimate, and the estimate without it: Monte-Carlo corrected scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect, with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.prepared_run import NoisyColumns
from lacet.identify.regression.qr_accumulation import added, scaled_triangle

NOISE_DRAWS = 6
"""Pairs of noise draws behind the correction of bias; what their number leaves uncertain is in the intervals."""
SOUND = 0.5
"""Part of a direction's information that may be noise in its own columns: beyond it there is nothing to correct."""


@dataclass
class NoiseMoments:
    """E[δWᵀ δr] = constant − slope θ of the weighted rows, draw by draw.

    At the true θ the scores Wᵀ r have this mean instead of zero (Novick and Stefanski, 2002). One draw of noise added
    and the same draw subtracted leave just that product and the mean shift of bent laws, and the sum over the samples
    is its mean. `slopes` (D, p, p), `constants` (D, p). Each run's zeros follow the parameters: they would absorb the
    mean shift of a nonlinear law, and a static load would else be moved by 100 N in their stead.
    """

    slopes: Array
    constants: Array

    @classmethod
    def none(cls, p: int, draws: int = NOISE_DRAWS) -> NoiseMoments:
        """Nothing added yet."""
        return cls(np.zeros((draws, p, p)), np.zeros((draws, p)))

    @classmethod
    def merged(cls, parts: Sequence[NoiseMoments]) -> NoiseMoments:
        """Those of several runs together."""
        return cls(added([part.slopes for part in parts]), added([part.constants for part in parts]))

    @property
    def draws(self) -> int:
        """Number of pairs of draws."""
        return len(self.constants)

    def some(self, which: NDArray[np.intp]) -> NoiseMoments:
        """Those of some of the draws."""
        return NoiseMoments(self.slopes[which], self.constants[which])

    def add(
        self, piece: Piece, effects: Sequence[PhysicalEffect], keep: NDArray[np.int64], sigma: Mapping[Row, float],
        zeros: tuple[Array, Array],
    ) -> None:  # fmt: skip
        """Add a run, or a piece of one; `zeros` (z, p) and (z,): how its zeros follow, z = offset − gain x."""
        gain, offset = zeros
        z, b = len(offset), len(keep)
        place = (piece.seed,) if piece.number is None else (piece.seed, piece.number)
        plain = {
            row: (block[:, z:] - block[:, :z] @ gain, piece.right[row] - block[:, :z] @ offset)
            for row, block in piece.blocks.items()
        }
        placed = list(with_places(effects))
        position = np.full(placed[-1][1].stop, -1)
        position[keep] = np.arange(b)
        for draw in range(self.draws):
            pair = piece.prepared.noisy_columns(effects, [2002, *place, draw])
            for row, (W, y) in plain.items():
                weight = np.full(len(y), sigma[row] ** -2.0)
                if piece.weights is not None:
                    weight = weight * piece.weights[row] ** 2
                # (W + δ)ᵀ(W + δ) − WᵀW, where only the few columns that act on this row have a δ.
                active, shifts = _shifts(pair, placed, row, position, piece.blocks[row][:, z : z + b])
                errors = [noisy.measured[row] - piece.right[row] for noisy in pair]
                mean: Array = 0.5 * (shifts[0] + shifts[1]).T * weight
                across = mean @ W
                self.slopes[draw][active] += across
                self.slopes[draw][:, active] += across.T
                self.constants[draw][active] += mean @ y
                self.constants[draw] += W.T @ (0.5 * weight * (errors[0] + errors[1]))
                for shift, error in zip(shifts, errors, strict=True):
                    part: Array = 0.5 * shift.T * weight
                    self.slopes[draw][np.ix_(active, active)] += part @ shift
                    self.constants[draw][active] += part @ error

    def correct(self, x: Array, root: Array, priors: Array) -> tuple[Array, Array]:
        """The estimate without the bias, and the covariance that the correction leaves in it.

        Two errors remain: the finite number of draws, and directions whose columns are mostly noise: least squares
        takes such a column for a known one and finds the value near zero, with a narrow interval. They are given back
        to the prior.

        Parameters
        ----------
        x : (p,) weighted least squares.
        root : (p + 1, p + 1) R factor of the weighted equations (zeros eliminated).
        priors : (p,) 1 σ of what is known of each parameter beforehand.
        """
        p = len(x)
        slope, constant = self.slopes.mean(axis=0), self.constants.mean(axis=0)
        R, lengths = scaled_triangle(root[:, :p])
        # In coordinates where the normal matrix is the identity, the corrected equations are (I − S) x = x₀ − k.
        solved = np.asarray(scipy.linalg.solve_triangular(R[:p], np.eye(p)), float)
        inverse: Array = solved / lengths[:, None]
        x0, k = R[:p] @ (lengths * x), inverse.T @ constant
        spectrum = np.linalg.eigh(inverse.T @ (0.5 * (slope + slope.T)) @ inverse)
        part, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
        sound = part < SOUND
        growth = np.asarray(np.where(sound, 1.0 / np.where(sound, 1.0 - part, 1.0), 0.0), float)
        corrected = inverse @ (V @ np.asarray(np.where(sound, growth * (V.T @ (x0 - k)), V.T @ x0), float))
        scores = self.constants - self.slopes @ corrected
        scatter = (scores - scores.mean(axis=0)) @ (inverse @ (V * growth) @ V.T).T
        doubt = scatter.T @ scatter / (self.draws * (self.draws - 1))
        return corrected, doubt + given_back(inverse, slope, priors)


def _shifts(
    pair: Sequence[NoisyColumns],
    placed: Sequence[tuple[PhysicalEffect, slice]],
    row: Row,
    position: NDArray[np.intp],
    clean: Array,
) -> tuple[NDArray[np.intp], list[Array]]:
    """Positions (a,) of the columns of a row that noise moves, and by how much, (n, a) with it added and subtracted.

    `position` of each parameter among the columns `clean` (n, b), −1 where it has none.
    """
    (places, added), (_, taken) = (noisy.acting(placed, row) for noisy in pair)
    at = position[places]
    there = at >= 0
    shifts = [columns[:, there] - clean[:, at[there]] for columns in (added, taken)]
    moved = np.any(shifts[0] != 0.0, axis=0)
    return at[there][moved], [shift[:, moved] for shift in shifts]


def given_back(inverse: Array, noise: Array, priors: Array) -> Array:
    """(p, p) covariance that directions get back from the prior because noise makes up most of what they seem to know.

    Parameters
    ----------
    inverse : (p, p) with inverse · inverseᵀ the covariance of independent residuals.
    noise : (p, p) E[δWᵀ δW] of the weighted columns.
    priors : (p,) 1 σ.
    """
    spectrum = np.linalg.eigh(inverse.T @ (0.5 * (noise + noise.T)) @ inverse)
    part, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
    lost = inverse @ V[:, part >= SOUND]
    known = np.sum((lost / priors[:, None]) ** 2, axis=0)
    widening = np.maximum(0.0, 1.0 / np.maximum(known, 1e-12) - 1.0)
    return (lost * widening) @ lost.T
