"""Values that stand still in a moving car: found where the signal is noisy, never at rest or for a coarse signal."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.blocks import Block, Flag
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.log_run import build_run
from lacet.daq.formats.wire import StartRecord
from lacet.daq.run import Signal
from lacet.daq.stuck import NOISE_SHARE, noise_count, stuck_samples, window_length
from lacet.services.acquisition.stream_decoder import decode_frames
from lacet.services.workspace.decode import open_decoder
from tests.support.places import HOME

SECONDS = 30.0


def signal(channel: str, shape, noise: float, step: float, seed: int = 0) -> Signal:
    """A signal of a channel: `shape` of time, white noise (1 σ), rounded to steps."""
    one = CHANNELS[channel]
    t = np.arange(round(SECONDS * one.rate)) / one.rate
    rng = np.random.default_rng(seed)
    values = np.stack([shape(t) + rng.normal(0.0, noise, len(t)) for _ in range(one.width)], axis=1)
    return Signal(t, np.rint(values / step) * step, np.zeros(len(t), np.uint8))


def car(speed=lambda t: 20.0 + 0.0 * t) -> dict[str, Signal]:
    """Speeds of a Correvit and a wheel, and a wheel force that follows nothing."""
    return {
        "correvit.speed": signal("correvit.speed", speed, 0.02, 0.01, 1),
        "wheel.rl.speed": signal("wheel.rl.speed", lambda t: speed(t) / 0.3, 0.01, 0.005, 2),
        "wheel.fl.force": signal("wheel.fl.force", lambda t: 900.0 * np.sin(3.0 * t), 30.0, 1.0, 3),
    }


def hold(one: Signal, begin: float, end: float, component: int = 0) -> Signal:
    """The signal with a component that keeps its value for a time [s]."""
    values = one.values.copy()
    inside = (one.t >= begin) & (one.t < end)
    values[inside, component] = values[np.flatnonzero(inside)[0], component]
    return Signal(one.t, values, one.flags)


@pytest.mark.parametrize("channel", ["wheel.fl.force", "correvit.speed"])
@pytest.mark.parametrize("duration", [0.6, 3.0, 15.0])
def test_a_component_that_stands_still_is_found_and_only_it(channel, duration):
    signals = car()
    signals[channel] = hold(signals[channel], 10.0, 10.0 + duration, component=1)
    found = stuck_samples(signals, channel)
    t = signals[channel].t[found]
    assert t[0] == pytest.approx(10.0, abs=0.01)
    assert t[-1] == pytest.approx(10.0 + duration, abs=0.01)
    assert len(t) == pytest.approx(duration * CHANNELS[channel].rate, abs=2)
    assert not any(stuck_samples(signals, other).any() for other in signals if other != channel)


def corners(noise: float = 30.0, step: float = 1.0, speed=lambda t: 20.0 + 0.0 * t) -> dict[str, Signal]:
    """The car with dynamometers of one kind at all wheels."""
    force = {
        name: signal(name, lambda t: 900.0 * np.sin(3.0 * t), noise, step, seed)
        for seed, name in enumerate(f"wheel.{corner}.force" for corner in ("fl", "fr", "rl", "rr"))
    }
    return {**car(speed), **force}


def test_a_component_that_never_changes_is_found_by_the_noise_of_the_other_wheels():
    signals = corners()
    signals["wheel.rr.force"] = hold(signals["wheel.rr.force"], 0.0, SECONDS, component=2)
    assert stuck_samples(signals, "wheel.rr.force").all()
    assert not any(stuck_samples(signals, name).any() for name in signals if name != "wheel.rr.force")


@pytest.mark.parametrize(
    "signals",
    [
        car(),  # no other wheel has one
        corners(noise=0.0, step=4000.0),  # too coarse for noise
        corners(speed=lambda t: 0.0 * t),  # the car stands
    ],
    ids=["no twins", "coarse", "at rest"],
)
def test_one_that_never_changes_is_not_judged_without_noisy_twins_in_a_moving_car(signals):
    signals["wheel.fl.force"] = hold(signals["wheel.fl.force"], 0.0, SECONDS)
    assert not any(stuck_samples(signals, channel).any() for channel in signals)


def test_a_short_one_is_not():
    signals = car()
    signals["wheel.fl.force"] = hold(signals["wheel.fl.force"], 10.0, 10.4)
    assert not stuck_samples(signals, "wheel.fl.force").any()


def test_nothing_is_stuck_at_rest():
    """A quantised signal of a standing car is constant; it was noisy while the car moved."""
    signals = car(lambda t: np.where(t < 15.0, 20.0, 0.0))
    signals["wheel.fl.force"] = hold(signals["wheel.fl.force"], 15.2, 30.0)
    assert not any(stuck_samples(signals, channel).any() for channel in signals)


def test_nothing_is_stuck_where_no_other_instrument_shows_that_the_car_moves():
    force = hold(car()["wheel.fl.force"], 10.0, 15.0)
    assert not stuck_samples({"wheel.fl.force": force}, "wheel.fl.force").any()


@pytest.mark.parametrize(
    ("channel", "shape", "step"),
    [
        ("steering.angle", lambda t: np.where(t < 20.0, 1.5 * np.sin(4.0 * t), 0.0), np.radians(0.5)),
        ("steering.angle", lambda t: np.where(t < 20.0, 0.1 * np.sin(12.0 * t), 0.0), np.radians(1.0)),
        ("engine.throttle", lambda t: np.floor(t / 3.0) % 2.0, 1.0),
        ("brake.pressure", lambda t: np.maximum(0.0, 4e6 * np.sin(t)), 1e4),
    ],
)
def test_a_coarse_signal_may_be_constant(channel, shape, step):
    """A slalom by a coarse steering sensor, then a straight; a switch; a pressure of nothing."""
    signals = {**car(), channel: signal(channel, shape, 0.05 * step, step)}
    one = signals[channel]
    changes = np.flatnonzero(np.diff(one.values[:, 0], append=np.inf) != 0.0)
    assert (np.diff(changes) > 60).any()  # it is constant for long
    assert not stuck_samples(signals, channel).any()


def test_the_angle_of_a_turning_wheel_does_not_stand_still():
    signals = car()
    signals["wheel.rl.angle"] = signal("wheel.rl.angle", lambda t: (20.0 / 0.3 * t) % (2 * np.pi), 0.0, 1e-4)
    assert not stuck_samples(signals, "wheel.rl.angle").any()
    signals["wheel.rl.angle"] = hold(signals["wheel.rl.angle"], 10.0, 11.0)
    assert np.count_nonzero(stuck_samples(signals, "wheel.rl.angle")) == pytest.approx(500, abs=2)


def test_white_noise_turns_back_far_more_often_than_noise_is_known_by():
    rng = np.random.default_rng(0)
    length = window_length(500.0)
    for sigma in (0.4, 1.0, 5.0):
        count = noise_count(np.rint(rng.normal(0.0, sigma, (20 * length, 1))), length)
        assert count.turns.min() > 1.5 * NOISE_SHARE * length
    slow = np.rint(200.0 * np.sin(2 * np.pi * 2.0 * np.arange(2000) / 100.0))[:, None]
    assert noise_count(slow, 50).turns.max() < NOISE_SHARE * 50


def test_a_run_says_it_and_leaves_it_out():
    signals = car()
    signals["wheel.fl.force"] = hold(hold(signals["wheel.fl.force"], 10.0, 11.0, 2), 20.0, 22.0, 2)
    blocks = {c: Block(c, np.rint(s.t * 1e9).astype(np.int64), s.values, s.flags) for c, s in signals.items()}
    run = build_run("r", StartRecord("r", 0), blocks)
    (line,) = run.problems
    assert line.startswith("wheel.fl.force: its value stands still in the moving car (10.0 to 11.0 s, 20.0 to 22.0 s)")
    flags = run.signals["wheel.fl.force"].flags
    assert np.count_nonzero(flags == Flag.STUCK) == pytest.approx(1500, abs=4)
    assert np.count_nonzero(run.signals["wheel.fl.force"].usable) == len(flags) - np.count_nonzero(flags)


@pytest.mark.parametrize("name", ["rough", "braking"])
def test_no_channel_of_a_capture_is_stuck_and_each_would_be_found(name):
    reader = LogReader(HOME / "replay_logs/nothing-hidden" / f"{name}.mcap")
    blocks = decode_frames(open_decoder(reader, None, []), [reader.frames(source) for source in reader.sources()])
    run = build_run(name, reader.start, blocks)
    assert run.problems == ()
    for channel in ("wheel.fl.force", "wheel.rr.angle", "imu.accel", "laser.fl.hub", "camera.fl.steer"):
        held = {**run.signals, channel: hold(run.signals[channel], 8.0, 9.0)}
        assert stuck_samples(held, channel).any(), channel
