"""The default cut-off: the motion's whatever the positions' noise, higher in a short record, never into noise."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.chains.cutoffs import _motion, default_cutoff, enough_seconds
from lacet.identify.signals.noise_level import white_noise
from lacet.services.library.chains import identify_chain
from tests.identify.chains.arms import ARM, RATE, VALUES, record

LINES = 0.43
"""Highest frequency of the arm's motion [Hz]."""


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-4, 2e-4, 1e-3, 2e-3])
def test_noise_is_no_motion(noise: float):
    """Of 80 s with noise up to 0.002 rad: the frequency of the motion's last line, within the window's width."""
    for seed in (1, 2, 3):
        q = record(seed, 80.0, noise)[0]
        cutoff, acceleration = _motion(q, RATE, white_noise(q))
        assert 0.3 < cutoff < LINES + 2.0 / 80.0
        exact = _motion(record(seed, 80.0, 0.0)[0], RATE, np.zeros(4))[1]
        np.testing.assert_allclose(acceleration, exact, rtol=0.1)


def cutoff(q: np.ndarray, values: int) -> float:
    """The default cut-off of a fit of so many values [Hz]."""
    return default_cutoff(q, RATE, values, white_noise(q))


def test_a_short_record_is_fitted_higher_until_noise_counts():
    """20 s: as high as 36 values ask for; with louder positions lower, down to what the record must have at least."""
    found = [cutoff(record(1, 20.0, noise)[0], 36) for noise in (1e-6, 2e-4, 1e-3, 1e-2)]
    assert found[0] == pytest.approx((9.0 + 86.0 / 2.2) / 20.0)
    assert found[0] > found[1] > found[2] >= found[3] == pytest.approx(18.0 / 20.0)
    assert enough_seconds(36, found[0]) == pytest.approx(20.0)
    assert cutoff(record(1, 20.0)[0], 10) < found[0]


def test_a_joint_has_the_equations_that_were_counted_on():
    """Default cut-off: 50 beyond the values, or a few more."""
    fitted = identify_chain(ARM, *record(2), rate=RATE).fitted
    assert 50 <= len(fitted.t) - len(fitted.estimates) <= 60


@pytest.mark.parametrize("noise", [2e-4, 2e-3])
def test_values_hold_with_noisy_positions(noise: float):
    """60 s, default settings, four seeds: as many intervals hold the truth as without noise, and no law is missing."""
    inside: list[float] = []
    for seed in (81, 82, 83, 84):
        found = identify_chain(ARM, *record(seed, 60.0, noise), rate=RATE)
        assert found.filters.fit_cutoff < 1.0
        base = found.fitted.base
        known = base.grouping() @ np.array([VALUES.get(name, 0.0) for name in base.names])
        true = {base.names[int(k)]: value for k, value in zip(base.independent, known, strict=True)}
        inside += [abs(one.value - true[one.name]) <= one.half for one in found.parameters]
        assert found.fitted.wrong_signs == ()
    assert np.mean(inside) > 0.9
    assert found.rank().missing == ()
