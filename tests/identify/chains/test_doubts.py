"""Reasons not to trust a fit: a torque of opposite sign, noise of the positions; and where none is, none is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.identify.chains import effects as laws
from lacet.identify.chains.doubts import Doubts, TurnedTorque, accounted_for, noise_bias, turned_torques
from lacet.identify.chains.fit import ChainEstimate
from lacet.identify.chains.ranking import ChainRanking, JointAnswer, JointCandidate
from lacet.identify.chains.scores import JointScore
from lacet.identify.chains.verdicts import ChainVerdict, verdict_of
from lacet.services.library.chains import IdentifiedChain, identify_chain
from lacet.services.render.chain_fit import ranking_head
from tests.identify.chains.arms import ARM, NOISE, RATE, VALUES, exact, record, states

LOUD = 1e-3
"""σ of positions whose noise matters above the motion's cut-off [rad]."""


def found(seed: int, tau: np.ndarray | None = None, **how: float | None) -> IdentifiedChain:
    """A fit to one of the arm's records of 20 s."""
    q, measured = record(seed)
    return identify_chain(ARM, q, measured if tau is None else tau, rate=RATE, **how)  # type: ignore[arg-type]


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
@pytest.mark.parametrize("cutoff", [None, 0.9])
def test_a_torque_of_opposite_sign_is_named(joint: int, cutoff: float | None):
    """Every joint, in 20 s, with many equations and with few; with the sign turned back none is."""
    signs = np.where(np.arange(1, 5) == joint, -1.0, 1.0)
    for seed in (31, 32):
        tau = record(seed)[1]
        (one,) = turned_torques(found(seed, tau * signs, cutoff=cutoff).fitted)
        assert one.joint == ARM.names[joint - 1]
        assert one.turned < 0.2 * one.sigma
        assert turned_torques(found(seed, tau, cutoff=cutoff).fitted) == ()


def test_a_missing_law_is_no_sign():
    """A motor that turns with two joints, a stiff spring, and friction that changes with position: ten seeds each."""
    for seed in range(40, 50):
        q, qd, qdd = states(seed, 20.0)
        tau = record(seed)[1]
        along = qd[:, 2] + qd[:, 3]
        motor = 1.2 * along + 1.5 * np.sign(along) + 0.15 * (qdd[:, 2] + qdd[:, 3])
        for more in (
            np.outer(motor, [0.0, 0.0, 1.0, 1.0]), np.outer(40.0 * (q[:, 1] - 0.3), [0.0, 1.0, 0.0, 0.0]),
            np.outer(8.0 * np.abs(np.sin(3.0 * q[:, 3])) * np.sign(qd[:, 3]), [0.0, 0.0, 0.0, 1.0]),
        ):  # fmt: skip
            assert turned_torques(found(seed, tau + more, cutoff=0.9).fitted) == ()


def test_no_law_is_named_beside_a_torque_of_opposite_sign():
    """Summary and ranking have the joint and what to do; the laws that seemed missing are in doubt."""
    one = found(31, record(31)[1] * [1.0, -1.0, 1.0, 1.0])
    said = "The torque of 2 fits with the opposite sign"
    assert said in str(one).replace(f"torque of {ARM.names[1]} ", "torque of 2 ")
    ranking = one.rank()
    assert ranking.verdict == "unsound fit"
    assert ranking.missing == ()
    assert repr(ranking).startswith("no law is named, as the fit is unsound. The torque of ")
    assert "turn its sign, or that of its position" in repr(ranking)
    right = found(31)
    assert right.doubts == Doubts()
    assert right.rank().verdict == "nothing missing"


def test_positions_in_degrees_are_said_to_be_that():
    """No law is named, whatever seems missing then; positions that are large and are radians are in no doubt."""
    q, tau = record(31)
    one = identify_chain(ARM, np.degrees(q), tau, rate=RATE)
    assert one.doubts.in_degrees == ARM.names
    assert f"The positions of {', '.join(ARM.names)} are degrees" in str(one)
    mixed = q.copy()
    mixed[:, 1] = np.degrees(q[:, 1])
    assert identify_chain(ARM, mixed, tau, rate=RATE).doubts.in_degrees == (ARM.names[1],)
    assert one.rank().verdict == "unsound fit"
    more_turns = identify_chain(ARM, q + 4.0 * np.pi, tau, rate=RATE)
    assert not more_turns.doubts.in_degrees
    assert not found(31).doubts.in_degrees


def test_times_in_milliseconds_are_said_to_be_that():
    """As is a rate in kHz; a slow log of a slow motion is in no doubt, and a rate that is no number is refused."""
    q, tau = record(31)
    one = identify_chain(ARM, q, tau, t=1e3 * np.arange(len(q)) / RATE)
    assert one.doubts.in_milliseconds
    assert "The times of the samples are milliseconds" in str(one)
    assert one.rank().verdict == "unsound fit"
    q, tau = record(31, 80.0)
    slow = identify_chain(ARM, q[::125], tau[::125], rate=4.0, cutoff=0.45, pre_cutoff=1.6)
    assert not slow.doubts.in_milliseconds
    with pytest.raises(UsageError, match="must be a number of Hz, found '500'"):
        identify_chain(ARM, q, tau, rate="500")  # type: ignore[arg-type]


def test_a_torque_that_is_clipped_is_said_to_be_that():
    """Joint 2 at half of its largest torque: no law is named; a coarse reading is not clipped."""
    _, tau = record(31)
    limit = 0.5 * float(np.max(np.abs(tau[:, 1])))
    clipped = tau.copy()
    clipped[:, 1] = np.clip(tau[:, 1], -limit, limit)
    one = found(31, clipped, cutoff=0.9)
    assert {(each.joint, abs(each.limit)) for each in one.doubts.clipped} == {(ARM.names[1], limit)}
    assert f"The torque of {ARM.names[1]} stops at " in str(one)
    assert one.rank().verdict == "unsound fit"
    assert found(31, np.round(tau / 3.0) * 3.0, cutoff=0.9).doubts.clipped == ()


@pytest.mark.parametrize("delay", [0.02, -0.03])
def test_torques_that_are_late_are_said_to_be_that(delay: float):
    """No law is named: a late torque looks like inertia and friction that are wrong everywhere."""
    _, tau = record(31)
    places = np.arange(len(tau), dtype=float)
    late = np.stack([np.interp(places - delay * RATE, places, series) for series in tau.T], axis=1)
    one = found(31, late)
    assert one.doubts.late is not None
    assert one.doubts.late.delay == pytest.approx(delay, abs=0.1 * abs(delay))
    assert f"ms {'later' if delay > 0.0 else 'earlier'} than the positions" in str(one)
    assert one.rank().verdict == "unsound fit"


def test_torques_late_by_one_sample_are_said_to_be_that():
    """Less than the effect size, and most of what remains: no small rest; laws that are missing are no such delay."""
    q, tau = exact(31, 20.0)
    rng = np.random.default_rng(31)
    tau = tau + 0.05 * NOISE * rng.standard_normal(tau.shape)
    late = identify_chain(ARM, q[1:], tau[:-1], rate=RATE).doubts.late
    assert late is not None
    assert late.delay == pytest.approx(1.0 / RATE, abs=late.half)
    assert identify_chain(ARM, q, tau, rate=RATE).doubts.late is None
    sprung = tau + np.outer(40.0 * (q[:, 1] - 0.3), [0.0, 1.0, 0.0, 0.0])
    assert identify_chain(ARM, q, sprung, rate=RATE).doubts.late is None


def test_one_joint_s_late_torque_is_not_that_of_all():
    """As of one elastic joint."""
    _, tau = record(31)
    places = np.arange(len(tau), dtype=float)
    tau = tau.copy()
    tau[:, 3] = np.interp(places - 0.03 * RATE, places, tau[:, 3])
    assert found(31, tau).doubts.late is None


def test_a_missing_law_is_no_delay():
    """A stiff spring, friction that changes with position, and one motor's inertia that the model lacks."""
    for seed in range(40, 44):
        q, qd, qdd = states(seed, 20.0)
        tau = record(seed)[1]
        for more in (
            np.outer(40.0 * (q[:, 1] - 0.3), [0.0, 1.0, 0.0, 0.0]), np.outer(0.5 * qdd[:, 2], [0.0, 0.0, 1.0, 0.0]),
            np.outer(8.0 * np.abs(np.sin(3.0 * q[:, 3])) * np.sign(qd[:, 3]), [0.0, 0.0, 0.0, 1.0]),
        ):  # fmt: skip
            assert found(seed, tau + more).doubts.late is None


def test_the_noise_of_the_positions_moves_values_as_estimated():
    """One motion, a cut-off far above it: the mean error of ten records is their estimated bias."""
    q, tau = exact(60, 20.0)
    errors, biases = [], []
    for seed in range(10):
        rng = np.random.default_rng([seed, 7])
        noisy = identify_chain(
            ARM, q + 1e-3 * rng.standard_normal(q.shape), tau + NOISE * rng.standard_normal(q.shape), rate=RATE,
            cutoff=5.0,
        )  # fmt: skip
        known = noisy.fitted.base.grouping() @ np.array([VALUES.get(name, 0.0) for name in noisy.fitted.base.names])
        half = np.array([one.half for one in noisy.parameters])
        errors.append((noisy.fitted.x - known) / half)
        if seed == 0:
            biases.append(noise_bias(noisy.fitted, noisy._recorded, noisy.filters, noisy.noise[0]) / half)
    error, bias = np.mean(errors, axis=0), np.mean(biases, axis=0)
    assert np.max(np.abs(bias)) > 0.3
    assert np.corrcoef(error, bias)[0, 1] > 0.7
    assert 0.6 < (error @ bias) / (bias @ bias) < 1.5


def test_a_cut_off_far_above_the_motion_is_in_doubt():
    """Positions of 0.001 rad up to 10 Hz: the first sentence has the noise and what to do, and no law is named."""
    q, tau = record(71, 20.0, LOUD)
    noisy = identify_chain(ARM, q, tau, rate=RATE, cutoff=10.0)
    assert len(noisy.doubts.biased) > 5
    assert "The noise of the positions moves " in str(noisy)
    assert "fit to a lower cut-off" in str(noisy)
    assert noisy.rank().missing == ()
    assert identify_chain(ARM, q, tau, rate=RATE).doubts == Doubts()


def test_laws_account_for_doubts():
    """Noise that moves other values is no doubt of a law, but where it moves its size; values that cannot be may go."""

    def one(name: str) -> ChainEstimate:
        return ChainEstimate(name, name, -1.0, 0.1, 0.2, 0.1)

    spring = [laws.JointSpring(2)]
    by = {"IA3": 0.9, "K2": 0.9}
    before = Doubts(biased=(one("IA3"), one("K2")), wrong_signs=(one("ZZ1"),), few=True, moved=by)
    assert accounted_for(before, Doubts(biased=(one("IA3"),), moved=by), spring) == Doubts(few=True)
    after = Doubts(biased=(one("K2"),), wrong_signs=(one("FV1"),), moved=by)
    assert accounted_for(before, after, spring) == before
    # By more than half its interval and a twentieth of its size: noise has not made it.
    assert accounted_for(before, replace(after, moved={"K2": 0.05}), spring) == Doubts(
        wrong_signs=before.wrong_signs, few=True
    )


def test_a_verdict_is_in_doubt():
    """By a turned torque always; by values that cannot be, unless a cause in no law may make them so; by noise and few
    equations only where laws would be named.
    """
    score = JointScore("a", 1.2, 1.0, 99.0, 50.0, 0.3)
    law = JointCandidate(laws.JointSpring(1), 9.0, 0.001, (1.0,), JointAnswer.MISSING)
    few = Doubts(few=True)
    assert verdict_of(ChainRanking((law,), 20), (score,), few) is ChainVerdict.UNSOUND
    assert verdict_of(ChainRanking((), 20), (score,), few) is ChainVerdict.NOTHING
    failing = JointScore("a", 1.2, 1.0, 99.0, 50.0, 0.05)
    wrong = Doubts(wrong_signs=(ChainEstimate("ZZ1", "ZZ1", -1.0, 0.1, 0.2, 0.1),))
    assert verdict_of(ChainRanking((), 20), (score,), wrong) is ChainVerdict.UNSOUND
    assert verdict_of(ChainRanking((law,), 20), (failing,), wrong) is ChainVerdict.UNSOUND
    assert verdict_of(ChainRanking((), 20), (failing,), wrong) is ChainVerdict.UNLISTED
    assert "ZZ1 is negative beyond the interval" in ranking_head(ChainRanking((), 20), (failing,), wrong)
    turned = Doubts(turned=(TurnedTorque("a", "a", 5.0, 0.1),))
    assert verdict_of(ChainRanking((), 20), (failing,), turned) is ChainVerdict.UNSOUND
    said = ranking_head(ChainRanking((law,), 20), (score,), few)
    assert "The equations are too few" in said
    assert "spring.1 may only stand in" in said
