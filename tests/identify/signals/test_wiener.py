"""Conditional distribution of a channel's rate given its noisy record, against simulated motion."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import Filters, derivative, zero_phase
from lacet.identify.signals.wiener import WienerSmoother, motion_beyond

FILTERS = Filters()
SIGMA = 3e-4
SECONDS = 160.0
INSIDE = slice(200, -200)


def filtered(x: Array) -> Array:
    """A series after the pre-filter."""
    assert FILTERS.pre_cutoff is not None
    return zero_phase(x, FILTERS.pre_cutoff, FILTERS.rate, FILTERS.order)


def noise(seed: int) -> Array:
    """Pre-filtered white noise of the channel."""
    return filtered(SIGMA * np.random.default_rng([1, seed]).standard_normal(round(SECONDS * FILTERS.rate)))


def motion(kind: str) -> Array:
    """A travel: of a body's and a wheel's mode on a road that is even or has lively seconds, or a slow sine."""
    n = round(SECONDS * FILTERS.rate)
    t, rng = np.arange(n) / FILTERS.rate, np.random.default_rng(7)
    if kind == "sine":
        return 0.012 * np.sin(np.pi * t)
    f = np.fft.rfftfreq(n, 1.0 / FILTERS.rate)
    body, wheel = (1.0 / np.abs(1.0 - (f / at) ** 2 + 1j * d * f / at) for at, d in ((1.4, 0.5), (11.0, 0.3)))
    shape = np.where(f > 0.2, (body + 0.25 * wheel) / np.maximum(f, 0.2), 0.0)
    travel = np.fft.irfft(shape * np.exp(2j * np.pi * rng.random(f.size)), n)
    travel *= 0.02 / np.std(derivative(travel, FILTERS.rate))
    return filtered(
        travel if kind == "even" else travel * (0.2 + 2.0 * np.clip(np.sin(2.0 * np.pi * t / 20.0), 0.0, 1.0))
    )


@pytest.mark.parametrize("kind", ["sine", "even", "lively"])
def test_mean_and_sigma_are_those_of_the_true_rate(kind: str) -> None:
    """The true rate differs from its conditional mean as much as is said, far less than from the measured rate, and
    the difference has nothing in common with the mean; errors drawn have the same size."""
    travel = motion(kind)
    truth = derivative(travel, FILTERS.rate)
    rate = derivative(travel + noise(0), FILTERS.rate)
    found = WienerSmoother.of(rate, SIGMA, FILTERS)
    assert found is not None
    mean = found.mean(rate)
    wrong = (mean - truth)[INSIDE]
    claimed = float(np.sqrt(np.mean(found.rate_sigma[INSIDE] ** 2)))
    assert np.std(wrong) == pytest.approx(claimed, rel=0.15)
    # The correlation is known to one part in the root of some hundred independent seconds.
    assert abs(np.mean(wrong * mean[INSIDE])) < 0.15 * np.std(wrong) * np.std(mean[INSIDE])
    assert np.std(wrong) < (0.1 if kind == "sine" else 0.8) * np.std((rate - truth)[INSIDE])
    drawn = found.error(*(derivative(noise(seed), FILTERS.rate) for seed in (1, 2)))[INSIDE]
    assert np.std(drawn) == pytest.approx(claimed, rel=0.15)
    value = (found.mean(travel + noise(0)) - travel)[INSIDE]
    assert np.std(value) == pytest.approx(float(np.sqrt(np.mean(found.sigma[INSIDE] ** 2))), rel=0.25)


@pytest.mark.parametrize("beyond", [0.0, 0.005**2, 0.04**2])
def test_errors_drawn_have_the_size_that_is_said_with_motion_that_the_pre_filter_stopped(beyond: float) -> None:
    """All along a run of quiet and lively seconds; independent of what is drawn for the motion that it passed."""
    rate = derivative(motion("lively") + noise(0), FILTERS.rate)
    found = WienerSmoother.of(rate, SIGMA, FILTERS, beyond)
    assert found is not None
    draws = [derivative(noise(seed), FILTERS.rate) for seed in range(1, 13)]
    slow = np.array([found.error(a, b) for a, b in zip(draws[::2], draws[1::2], strict=True)])
    fast = np.array([found.faster(b) for b in draws[1::2]])
    size = np.sqrt(np.mean((slow - fast) ** 2, axis=0)).reshape(-1, 500)[2:-2]
    claimed = found.rate_sigma.reshape(-1, 500)[2:-2]
    np.testing.assert_allclose(
        np.sqrt(np.mean(size**2, axis=1)), np.sqrt(np.mean(claimed**2, axis=1)), rtol=0.35
    )  # fmt: skip
    assert np.sqrt(np.mean(size**2)) == pytest.approx(np.sqrt(np.mean(claimed**2)), rel=0.1)
    assert abs(np.mean(slow * fast)) <= 0.1 * np.std(slow) * np.std(fast)


def test_no_noise_has_no_draw_of_faster_motion() -> None:
    found = WienerSmoother.of(derivative(motion("even"), FILTERS.rate), SIGMA, FILTERS, 0.01)
    assert found is not None
    np.testing.assert_array_equal(found.faster(np.zeros(found.intensity.size)), 0.0)


def test_quiet_seconds_have_less_doubt_than_lively_ones() -> None:
    """Where nothing moves, noise is known to be noise."""
    travel = motion("lively") * np.where(np.arange(round(SECONDS * FILTERS.rate)) % 2500 < 1000, 1.0, 0.0)
    found = WienerSmoother.of(derivative(filtered(travel) + noise(0), FILTERS.rate), SIGMA, FILTERS)
    assert found is not None
    at = np.arange(found.intensity.size) % 2500
    assert np.mean(found.rate_sigma[(at > 1300) & (at < 2200)]) < 0.5 * np.mean(
        found.rate_sigma[(at > 200) & (at < 800)]
    )


def test_a_constant_and_a_part_pass_unchanged() -> None:
    """A zero of the sensor is in the mean as it is in the record; a part has the gains of the whole."""
    rate = derivative(motion("even") + noise(0), FILTERS.rate)
    found = WienerSmoother.of(rate, SIGMA, FILTERS)
    assert found is not None
    np.testing.assert_allclose(found.mean(np.full(rate.size, 0.3)), 0.3, rtol=1e-12)
    part = slice(4000, 9000)
    inside = slice(500, -500)
    np.testing.assert_allclose(found.at(part).mean(rate[part])[inside], found.mean(rate)[part][inside], atol=2e-5)


def test_without_noise_the_record_is_the_motion() -> None:
    """All that moves is believed, but for what is above 24 Hz; without a pre-filter there is no smoother at all."""
    rate = derivative(motion("even"), FILTERS.rate)
    found = WienerSmoother.of(rate, 0.0, FILTERS)
    assert found is not None
    np.testing.assert_allclose(found.mean(rate)[INSIDE], rate[INSIDE], atol=5e-4)
    assert np.all(found.rate_sigma == 0.0)
    assert WienerSmoother.of(rate, SIGMA, Filters(pre_cutoff=None)) is None


def test_motion_above_the_pre_filter_is_measured_in_the_raw_samples() -> None:
    """A rate of 10 mm/s at 30 Hz is found beside the noise; without it a few millimetres a second at most."""
    t = np.arange(round(60.0 * 250.0)) / 250.0
    beyond: list[list[float]] = []
    for seed in range(6):
        rng = np.random.default_rng([2, seed])
        white = [SIGMA * rng.standard_normal(t.size) for _ in range(4)]
        shaken = [one + 0.010 * np.sqrt(2.0) / (60.0 * np.pi) * np.sin(60.0 * np.pi * t) for one in white]
        beyond.append([motion_beyond([(one, 250.0) for one in many], FILTERS) for many in (white, shaken)])
    still, moving = np.array(beyond).T
    assert np.sqrt(np.mean(moving)) == pytest.approx(0.010, rel=0.1)
    assert np.mean(still) < 0.1 * np.mean(moving)
    assert motion_beyond([(np.zeros(100), 80.0)], FILTERS) == 0.0
