"""What noise adds to the residual through a law that a model does not have yet.

The noise floor is that of the model as it is. A large friction changes its sign with the noise of the travel rate: once
it is added the rows are noisier, and what it leaves must be compared with that.
"""

from __future__ import annotations

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.trials import TrialSpace

DRAWS = 2
"""Draws of noise on each run."""


def noise_through(space: TrialSpace, effect: Effect, values: Array) -> dict[str, float]:
    """Row → weighted squares, over all runs, that noise adds through an effect with parameters `values` [SI]."""
    fitted, sigma = space.fitted, space.floor.sigma
    physics, theta = fitted.model.physics, fitted.physics
    out = dict.fromkeys(sigma, 0.0)
    for piece in fitted.assembly.pieces():
        drive = piece.drive
        law = {row: values @ columns for row, columns in drive.columns(effect).items()}
        left = {row: drive.measured[row] - drive.matrix(physics, row) @ theta for row in law}
        for draw in range(DRAWS):
            noisy = drive.noisy(draw, 1, [2005, piece.run, piece.number or 0, draw], loads=True)
            for row, columns in noisy.columns(effect).items():
                plain = noisy.measured[row] - noisy.matrix(physics, row) @ theta - left[row]
                both = plain - (values @ columns - law[row])
                out[row] += (
                    space.columns.louder[row] ** 2 * float(both @ both - plain @ plain) / sigma[row] ** 2 / DRAWS
                )
            noisy.forget_motion()
        drive.forget_noisy(loads=True)
    return out
