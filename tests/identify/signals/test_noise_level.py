"""Noise measured in a run against noise that was put in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.channels import CHANNELS
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Run, Signal
from lacet.identify.signals.noise_level import NoiseVerdict, measured_noise
from lacet.services.render.sensor_report import unmeasured
from tests.identify import cars

_, RIG = cars.reference_car()


def moving(channel: str, sigma: float, seed: int, rate: float = 250.0, smooth: int = 1, seconds: float = 20.0) -> Run:
    """A run of one channel: motion up to 12 Hz, a hundred times the noise, a ramp, and noise averaged over `smooth`."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    width = CHANNELS[channel].width
    motion = sum(
        np.sin(2 * np.pi * f * t + p) for f, p in zip(rng.uniform(0.2, 12.0, 20), rng.uniform(0, 6, 20), strict=True)
    )
    noise = rng.standard_normal((t.size + smooth - 1, width))
    noise = np.stack([noise[k : k + t.size] for k in range(smooth)]).mean(axis=0) * np.sqrt(smooth)
    values = 100.0 * sigma * (motion + t)[:, None] + sigma * noise
    return Run("made", {channel: Signal(t, values, np.zeros(t.size, np.uint8))})


@settings(max_examples=20, deadline=None)
@given(
    channel=st.sampled_from(["wheel.fl.force", "laser.fr.hub", "imu.accel", "camera.rl.steer"]),
    factor=st.floats(0.2, 5.0),
    rate=st.sampled_from([100.0, 250.0, 500.0]),
    seed=st.integers(0, 99),
)
def test_white_noise_is_measured_whatever_moves(channel: str, factor: float, rate: float, seed: int) -> None:
    """Within 6 % or five of its σ, and the verdict follows the sheet."""
    sigma = factor * RIG.noise(channel)
    (level,) = measured_noise([moving(channel, sigma, seed, rate)], RIG)
    assert level.sigma == pytest.approx(sigma, rel=max(0.06, 2.55 * level.half / sigma))
    if factor < 0.7:
        assert level.verdict is NoiseVerdict.SMALLER
    elif factor > 1.4:
        assert level.verdict is NoiseVerdict.LARGER


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_intervals_hold_what_was_put_in_and_a_sheet_that_is_right_is_called_so(rate: float) -> None:
    sigma = RIG.noise("laser.fr.hub")
    levels = [measured_noise([moving("laser.fr.hub", sigma, seed, rate)], RIG)[0] for seed in range(200)]
    held = np.mean([abs((level.sigma or 0.0) - sigma) < level.half for level in levels])
    assert 0.92 < held < 0.98
    assert np.mean([level.verdict is NoiseVerdict.AS_THE_SHEET for level in levels]) > 0.96


def test_noise_smoothed_by_the_instrument_is_not_called_white() -> None:
    """A moving average over two samples has little left near half the sample rate: its halves are not independent."""
    (level,) = measured_noise([moving("laser.fl.hub", 3e-4, 1, smooth=2)], RIG)
    assert not level.white
    assert level.verdict is NoiseVerdict.NOT_WHITE


def test_what_is_sampled_too_slowly_or_too_shortly_is_said() -> None:
    """At 40 Hz motion fills the spectrum; half a second is no spectrum."""
    (slow,) = measured_noise([moving("camera.fl.steer", 3e-4, 1, rate=40.0)], RIG)
    assert slow.sigma is None
    assert "40 Hz" in unmeasured(slow)
    (short,) = measured_noise([moving("camera.fl.steer", 3e-4, 1, seconds=0.5)], RIG)
    assert unmeasured(short) == "too few usable samples"
    assert short.verdict is NoiseVerdict.UNKNOWN


def test_one_noisy_column_is_named() -> None:
    """One laser three times as noisy as the others."""
    run = open_run(cars.CAR / "sine.parquet")
    signal = run.signals["laser.rr.hub"]
    noise = 3e-4 * np.sqrt(8.0) * np.random.default_rng(1).standard_normal(signal.values.shape)
    levels = measured_noise([run.with_values({"laser.rr.hub": signal.values + noise})], RIG)
    odd = {name for level in levels for name in level.odd_ones}
    assert odd == {"laser.rr.hub"}
    by_family = {level.family: level for level in levels}
    assert by_family["wheel.force"].verdict is NoiseVerdict.AS_THE_SHEET
    assert by_family["laser.hub"].verdict is NoiseVerdict.LARGER
