"""What noise does through a law: against the noise floor of the model that has it, and in the verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import noise_through_effect
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of, simulate_floor
from tests.identify.exact_car import KNOWN
from tests.identify.selection.exact_ranking import CANDIDATES, HIDDEN, SIZE, leaving
from tests.identify.selection.held import blocks_of

FRICTION = KNOWN["coulomb.front"]


@pytest.mark.parametrize(
    "effect",
    [KNOWN["tyre_damping.front"], pytest.param(replace(FRICTION, shape={"v0": 0.1}), marks=pytest.mark.slow)],
    ids=lambda e: e.key,
)
def test_it_is_what_the_floor_of_the_model_with_the_law_has_more(space: ScoreTests, effect):
    """That floor is made by derivatives at the parameters; here the law itself is asked."""
    values = np.array([20000.0 if effect.key.startswith("tyre") else 400.0])
    fitted = space.fitted
    physics, theta = (*fitted.model.physics, effect), np.concatenate([fitted.physics, values])
    before = floor_of(fitted, 199).sigma
    after = simulate_floor(fitted.runs, lambda run: fitted.runs[run].sensitive_pieces(physics, theta), 199).sigma
    said = noise_through_effect(space.fitted, space.floor.sigma, space.noise_ratio, effect, values)
    counts = dict.fromkeys(said, 0)
    for _, block in blocks_of(space.sums):
        counts[block.row] += len(block.columns)
    for row, sigma in space.floor.sigma.items():
        more = counts[row] * (after[row] ** 2 - before[row] ** 2) / sigma**2
        assert said[row] == pytest.approx(more, rel=0.35, abs=0.05 * counts[row]), row
    assert max(said.values()) > 0.3 * max(counts.values())


@pytest.mark.parametrize(("share", "verdict"), [(0.0, "unlisted cause"), (0.1, "missing")])
def test_what_noise_does_through_the_law_itself_is_no_other_cause(
    unlisted: Fit, floor: NoiseFloor, share: float, verdict: str, monkeypatch: pytest.MonkeyPatch
):
    """A fifth of the excess stays behind the right law, where the limit is 15 %."""

    before = ScoreTests.of(Linearisation.of(unlisted, floor), [HIDDEN, *CANDIDATES[:2]], 0).residual_beside([]).squares

    def through(*known: object) -> dict[str, float]:
        *_, effect, values = known
        assert isinstance(effect, Effect)
        assert effect.key == HIDDEN.key
        assert values == pytest.approx(SIZE, rel=0.2)
        return {row: share * a for row, a in before.items()}

    monkeypatch.setattr("lacet.identify.selection.score_tests.ScoreTests.residual_beside", leaving(0.2, family=0.01))
    monkeypatch.setattr("lacet.identify.selection.columns.ranked_runs.noise_through_effect", through)
    monkeypatch.setattr("lacet.identify.selection.diagnose.excess_is_coloured", lambda left: True)
    monkeypatch.setattr("lacet.identify.selection.diagnose._listed_together", lambda *_: None)
    assert diagnose(unlisted, floor, [HIDDEN, *CANDIDATES[:2]]).verdict == verdict
