"""Samples that are missing, and positions that leap: what remains is fitted, the values hold, and it is said."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.errors import NotIdentifiable
from lacet.identify.chains.gaps import continuous, without_leaps
from lacet.services.library.chains import IdentifiedChain, identify_chain
from tests.identify.chains.arms import ARM, RATE, VALUES, record

CUTOFF = 1.5
"""Of the fits [Hz]: what it takes at a gap is short."""


def times(count: int) -> np.ndarray:
    """Times of the samples of a record [s]."""
    return np.arange(count) / RATE


def off(found: IdentifiedChain) -> float:
    """Largest error of a value, in halves of its interval."""
    base = found.fitted.base
    known = base.grouping() @ np.array([VALUES.get(name, 0.0) for name in base.names])
    return float(np.max(np.abs(found.fitted.x - known) / [one.half for one in found.parameters]))


def test_a_gap_is_not_fitted_and_said():
    """1.5 s of 30 s by the times of the samples; nothing is fitted within the filters' reach of it."""
    q, tau = record(5, 30.0)
    t = times(len(q))
    there = (t < 10.0) | (t >= 11.5)
    found = identify_chain(ARM, q[there], tau[there], t=t[there], cutoff=CUTOFF)
    (gap,) = found.doubts.gaps
    assert gap.start == pytest.approx(10.0, abs=0.01)
    assert gap.seconds == pytest.approx(1.5, abs=0.01)
    assert "No samples from 9.998 s to 11.5 s" in str(found)
    reach = found.filters.edge
    assert not np.any((found.fitted.t > 10.0 - reach) & (found.fitted.t < 11.5 + reach))
    assert max(one.ratio for one in found.scores) < 1.3
    assert off(found) < 2.0
    whole = identify_chain(ARM, q, tau, t=t, cutoff=CUTOFF)
    assert whole.doubts.gaps == ()
    assert len(whole.fitted.t) > len(found.fitted.t)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_dropped_samples_are_bridged(share: float):
    """By their times, one in twenty and one in five: the others stay as they were, and floors are of their noise."""
    q, tau = record(5)
    t = times(len(q))
    there = np.random.default_rng(0).random(len(q)) > share
    there[[0, -1]] = True
    found = identify_chain(ARM, q[there], tau[there], t=t[there], cutoff=CUTOFF)
    plain = identify_chain(ARM, q, tau, t=t, cutoff=CUTOFF)
    assert found._recorded.rate == pytest.approx(RATE)
    assert found.doubts.gaps == ()
    kept = found._recorded.tau[there]
    np.testing.assert_allclose(kept, tau[there], atol=1e-9)
    np.testing.assert_allclose(found.noise[1], plain.noise[1], rtol=0.15)
    assert max(one.ratio for one in found.scores) < 1.3


def test_what_gaps_leave_nothing_of_is_refused():
    q, tau = record(5)
    t = times(len(q))
    there = (t % 4.0) > 1.0
    with pytest.raises(NotIdentifiable, match="nothing of the record remains"):
        identify_chain(ARM, q[there], tau[there], t=t[there], cutoff=CUTOFF)


def test_a_sample_that_leaps_is_not_fitted():
    """One of 10,000 that is off by a radian: the same cut-off and values as without it, and where it is."""
    q, tau = record(5)
    spiked = q.copy()
    spiked[6000, 2] += 1.0
    found, plain = (identify_chain(ARM, x, tau, rate=RATE) for x in (spiked, q))
    (leap,) = found.doubts.leaps
    assert (leap.joint, leap.lasts) == (2, False)
    assert leap.start <= 12.0 <= leap.start + leap.seconds
    assert leap.size == pytest.approx(1.0, abs=0.01)
    assert f"The position of {ARM.names[2]} leaps at 12 s by up to 1 rad and back" in str(found)
    assert found.filters.fit_cutoff == plain.filters.fit_cutoff
    np.testing.assert_allclose(found.fitted.x, plain.fitted.x, atol=0.1 * min(one.half for one in plain.parameters))
    assert plain.doubts.leaps == ()


def test_samples_that_are_missing_without_times_leap_in_all_joints():
    """The time where they are is not fitted, and the values hold."""
    q, tau = record(5, 30.0)
    t = times(len(q))
    there = (t < 10.0) | (t >= 11.5)
    found = identify_chain(ARM, q[there], tau[there], rate=RATE, cutoff=CUTOFF)
    assert {leap.joint for leap in found.doubts.leaps if leap.lasts} == {0, 1, 2, 3}
    assert "samples are missing (give their times, t=…)" in str(found)
    assert off(found) < 2.0


def test_an_angle_that_is_wrapped_is_said_to_be():
    q, tau = record(5, 20.0)
    wrapped = q.copy()
    wrapped[len(q) // 2 :, 1] += 2.0 * np.pi
    said = str(identify_chain(ARM, wrapped, tau, rate=RATE, cutoff=CUTOFF))
    assert f"The position of {ARM.names[1]} leaps" in said
    assert "a whole turn: its angle is wrapped" in said


def test_motion_and_coarse_encoders_do_not_leap():
    """Fast and slow motion, noise, a coarse encoder and one that flickers; a lost count does, and motion goes on."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.01)[:, None]
    fast = np.sin(2 * np.pi * 8.0 * t) * (t > 15.0)
    slow = 0.3 * np.sin(0.4 * t)
    flicker = 1e-3 * (rng.random(t.shape) < 0.02)
    q = np.concatenate(
        [fast, slow + 1e-3 * rng.standard_normal(t.shape), np.round(slow / 5e-3) * 5e-3, flicker], axis=1
    )
    assert without_leaps(q, 100.0)[1] == ()
    lost = slow + 0.5 * (t > 10.0)
    kept, leaps = without_leaps(lost, 100.0)
    np.testing.assert_array_equal(kept, lost)
    (leap,) = leaps
    assert leap.lasts
    assert np.max(np.abs(np.diff(continuous(lost, 100.0, leaps), axis=0))) < 2e-3 * 5
