"""A joint's error beside drawn noise: what is noise alone is called failing as often as it may, and no more."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from lacet.identify.chains.scores import scores_of
from lacet.services.library.chains import identify_chain
from tests.identify.chains.arms import ARM, RATE, record


def test_noise_alone_fails_in_one_record_of_twenty():
    """1,000 records of noise among 19 draws of it, four joints: p is 5 % or less in 5 % of them, within 3 σ."""
    fitted: Any = SimpleNamespace(model=SimpleNamespace(chain=ARM))
    rng = np.random.default_rng(12)
    failing = 0
    for _ in range(1000):
        noise = rng.standard_normal((20, 60, 4))
        scores = scores_of(fitted, noise[0], noise[0], noise[1:])
        failing += any(one.p <= 0.05 for one in scores)
    assert 30 <= failing <= 71


def test_every_record_has_draws_of_its_own():
    """Of one length and model: of the same draws both would have a floor that is wrong alike."""
    floors = []
    for seed in (5, 6):
        found = identify_chain(ARM, *record(seed), rate=RATE, cutoff=1.5)
        drawn = found._noise / np.nanstd(found._noise, axis=(0, 1))
        floors.append(drawn[:, :20, 0])
    assert abs(np.corrcoef(floors[0].ravel(), floors[1].ravel())[0, 1]) < 0.3
