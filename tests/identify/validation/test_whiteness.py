"""Residuals against the floor's own colour: false alarms, and colours that are there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from lacet.identify.multibody.vectors import Array
from lacet.identify.validation.whiteness import Colour, whiteness

SPACING = 0.08
N = 360
PLACE = np.concatenate([np.arange(10, 150), np.arange(180, 400)])  # a hole of 2.4 s


def floor(rng: np.random.Generator, count: int) -> Array:
    """Draws of a coloured floor that swells along the run, with a hole."""
    series = lfilter([1.0, 0.6], [1.0, -0.5], rng.standard_normal((count, 450)), axis=1)[:, 50:]
    return (series * (1.0 + 0.5 * np.sin(np.arange(400) / 60.0)))[:, PLACE - 10]


def test_noise_is_called_noise_at_the_stated_rate() -> None:
    """Of 400 fresh draws of the floor about 1 % are called coloured, and Ljung–Box's p is uniform."""
    rng = np.random.default_rng(1)
    words, p, q = [], [], []
    for _ in range(20):
        draws = floor(rng, 20)
        for fresh in floor(rng, 20):
            found = whiteness(fresh, draws, PLACE, SPACING)
            assert found is not None
            words.append(found.colour)
            p.append(found.p)
            q.append(found.ljung_box)
    assert sum(word is not Colour.LIKE_NOISE for word in words) <= 12
    for values in (p, q):
        assert np.mean(np.array(values) < 0.05) == pytest.approx(0.05, abs=0.04)
        assert np.mean(values) == pytest.approx(0.5, abs=0.09)


@pytest.mark.parametrize("frequency", [0.3, 1.2, 4.0])
def test_a_tone_is_found_at_its_frequency(frequency: float) -> None:
    """A tone of two thirds of the floor's variance is coloured, at its frequency."""
    rng = np.random.default_rng(2)
    draws = floor(rng, 20)
    tone = 1.15 * np.std(draws) * np.sin(2 * np.pi * frequency * SPACING * PLACE)
    found = whiteness(floor(rng, 1)[0] + tone, draws, PLACE, SPACING)
    assert found is not None
    assert found.colour is Colour.COLOURED
    assert found.peak == pytest.approx(frequency, rel=0.15, abs=0.1)


def test_the_floors_shape_at_another_level_is_louder_not_coloured() -> None:
    """Twice the floor: louder; its autocorrelation stays inside the band."""
    rng = np.random.default_rng(3)
    draws = floor(rng, 40)
    words = [whiteness(2.0 * fresh, draws, PLACE, SPACING).colour for fresh in floor(rng, 10)]  # type: ignore[union-attr]
    assert words.count(Colour.LOUDER) >= 9, words
    assert whiteness(0.5 * floor(rng, 1)[0], draws, PLACE, SPACING).colour is Colour.LIKE_NOISE  # type: ignore[union-attr]


def test_scale_and_mean_do_not_matter_and_short_rows_say_so() -> None:
    """The verdict has no unit; fewer than 32 samples tell nothing."""
    rng = np.random.default_rng(4)
    draws, fresh = floor(rng, 20), floor(rng, 1)[0]
    one, other = whiteness(fresh, draws, PLACE, SPACING), whiteness(1e3 * fresh + 7.0, 1e3 * draws, PLACE, SPACING)
    assert one is not None
    assert other is not None
    assert other.p == pytest.approx(one.p)
    assert other.ljung_box == pytest.approx(one.ljung_box)
    np.testing.assert_allclose(other.spectrum, 1e6 * one.spectrum)
    assert whiteness(fresh[:31], draws[:, :31], PLACE[:31], SPACING) is None


def test_power_density_integrates_to_the_variance() -> None:
    """Parseval: the spectrum over its bands sums to the residual's variance."""
    rng = np.random.default_rng(5)
    place = np.arange(4096)
    series = rng.standard_normal(4096)
    found = whiteness(series, rng.standard_normal((10, 4096)), place, SPACING)
    assert found is not None
    assert np.mean(found.floor) * 0.5 / SPACING == pytest.approx(1.0, rel=0.1)
    assert found.acf[0] == 1.0
