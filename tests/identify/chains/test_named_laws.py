"""Laws small beside others are named where they leave nothing else: constants, an encoder's zero, a motor's gain."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.chains import effects as laws
from lacet.identify.chains.constants import half_of_constant, searched
from lacet.identify.chains.effects import BaseInclination, EncoderOffset, JointEffect, StribeckFriction
from lacet.identify.chains.model import ChainModel, standard_effects
from lacet.identify.chains.ranking import JointAnswer, JointCandidate, candidates_of
from lacet.identify.chains.samples import Recorded
from lacet.identify.multibody.chain import Chain
from lacet.services.library.chains import IdentifiedChain, RankedLaws, identify_chain
from tests.identify.chains.arms import ARM, NOISE, RATE, VALUES, exact, states

COULOMB = np.array([VALUES[f"FS{j}"] for j in range(1, 5)])
LAWS = "FV", "FS", "OFF"
"""Laws that a motor reads with its gain; a rotor that cannot be told from the body counts among the load."""
QUIET = 0.1
"""Noise ÷ that of `arms`: small forces are then far above it."""


def found(seed: int, more: np.ndarray | float = 0.0, moved: np.ndarray | float = 0.0) -> IdentifiedChain:
    """A fit up to 4 Hz of 30 s with little noise, torques added and positions moved."""
    q, tau = exact(seed, 30.0)
    rng = np.random.default_rng([seed, 8])
    q = q + 1e-6 * rng.standard_normal(q.shape)
    return identify_chain(
        ARM, q + moved, tau + more + QUIET * NOISE * rng.standard_normal(q.shape), rate=RATE, cutoff=4.0
    )


def of(ranking: RankedLaws, key: str) -> JointCandidate:
    """A candidate of a ranking."""
    return next(one for one in ranking.candidates if one.effect.key == key)


@pytest.mark.parametrize("speed", [0.05, 0.17])
def test_a_constant_between_the_grid_s_values_is_found(speed: float):
    """Stribeck friction of joint 1: its speed within twice the interval, which is narrow; then nothing is missing."""
    rate = states(1, 30.0)[1]
    more = np.outer(0.4 * COULOMB[0] * np.sign(rate[:, 0]) * np.exp(-((rate[:, 0] / speed) ** 2)), [1.0, 0, 0, 0])
    plain = found(1, more)
    ranking = plain.rank()
    assert [effect.key for effect in ranking.missing] == ["stribeck.1"]
    one = of(ranking, "stribeck.1")
    assert one.half < 0.1 * speed
    assert abs(one.effect.constant - speed) < 2.0 * one.half
    assert " ± " in repr(ranking).splitlines()[0]
    better = plain.with_effects(*ranking.missing)
    assert better.value("FB1") == pytest.approx(0.4 * COULOMB[0], rel=0.1)
    assert better.scores[0].ratio < 1.3


def test_the_interval_of_a_constant_holds_it():
    """A law of known columns in white noise, 200 draws: 90 to 99 % of the intervals."""
    rng = np.random.default_rng(6)
    rate, instant = rng.uniform(-1.0, 1.0, 400), np.arange(400)

    def columns(effect: JointEffect) -> np.ndarray:
        return effect.columns(rate, rate, rate, rate)

    held: list[bool] = []
    for _ in range(200):
        y = columns(StribeckFriction(1, speed=0.17))[:, 0] + 0.2 * rng.standard_normal(400)
        law = searched(StribeckFriction(1, speed=0.1), columns, y)
        half = half_of_constant(law, columns, y, np.ones(400), instant)
        held.append(abs(law.constant - 0.17) <= half)
    assert 0.9 <= np.mean(held) <= 0.99


def test_friction_of_another_shape_is_no_stribeck_friction():
    """Viscous friction of another exponent looks like it, and leaves more than a law is inexact by."""
    rate = states(2, 30.0)[1]
    viscous = np.array([VALUES[f"FV{j}"] for j in range(1, 5)])
    ranking = found(2, viscous * np.sign(rate) * (np.abs(rate) ** 1.15 - np.abs(rate))).rank()
    assert ranking.missing == ()
    assert ranking.verdict == "unlisted cause"
    assert "What remains resembles stribeck." in repr(ranking).splitlines()[0]


def test_an_encoder_that_is_a_little_off_is_named():
    """A third of a degree: less than what inexact friction may leave, but nothing else is left."""
    plain = found(3, moved=np.radians([0.0, 0.0, 0.3, 0.0]))
    ranking = plain.rank()
    assert [effect.key for effect in ranking.missing] == ["encoder_offset.3"]
    assert plain.with_effects(*ranking.missing).value("QO3") == pytest.approx(-np.radians(0.3), rel=0.2)


def leaning(angle: float) -> IdentifiedChain:
    """A fit of the upright arm to one that leans by an angle [rad] about y."""
    q, qd, qdd = states(4, 30.0)
    values = {name: value for name, value in VALUES.items() if not name.startswith("OFF")}
    leans = ARM.with_gravity([9.80665 * np.sin(angle), 0.0, -9.80665 * np.cos(angle)])
    rng = np.random.default_rng([4, 8])
    tau = leans.inverse_dynamics(q, qd, qdd, values) + QUIET * NOISE * rng.standard_normal(q.shape)
    return identify_chain(ARM, q + 1e-6 * rng.standard_normal(q.shape), tau, rate=RATE, cutoff=4.0)


def test_a_base_that_leans_is_named_with_the_first_moments_that_gravity_then_acts_on():
    """By 11°: joint 1 is no longer vertical, and its body's first moments are in the torques."""
    angle = 0.2
    plain = leaning(angle)
    assert "MX1" not in repr(plain)
    ranking = plain.rank()
    assert [effect.key for effect in ranking.missing] == ["inclination.x"]
    better = plain.with_effects(*ranking.missing)
    low, high = better.interval("GX")
    assert low < 9.80665 * np.tan(angle) < high
    assert high - low < 0.02 * low
    assert better.rank().verdict == "nothing missing"
    assert "m/s²" in str(better)
    low, high = better.interval("MX1")
    assert low < VALUES["MX1"] < high


def test_a_cable_at_an_upright_joint_is_no_base_that_leans():
    """Its torque goes with the position's cube, or its sine: the first moments that an inclination would need are free,
    and the other joints show none. What remains is said to be at that joint.
    """
    q = exact(4, 30.0)[0][:, 0]
    for cable in (2.0 * q**3, 5.0 * np.sin(q)):
        ranking = found(4, np.outer(cable, [1.0, 0.0, 0.0, 0.0])).rank()
        assert not [effect.key for effect in ranking.missing if isinstance(effect, BaseInclination)]
        assert {*ranking.unlisted, *(one.joint for one in ranking.failing)} == {ARM.names[0]}


def test_what_is_explained_is_a_part_of_the_measured_torque():
    """Whatever is known otherwise of the positions, here an encoder's zero."""
    plain = found(5, moved=np.array([0.0, 0.02, 0.0, 0.0]))
    better = plain.with_effects(EncoderOffset(2))
    assert np.max(np.abs(better.fitted.y - better.fitted.measured)) > 0.1
    for one in (plain, better):
        for score, alone in zip(one.scores, plain.scores, strict=True):
            assert score.variation == pytest.approx(alone.variation, rel=1e-9)
            assert score.explained == pytest.approx(100.0 * (1.0 - (score.rms / alone.variation) ** 2), abs=0.5)


def test_the_column_of_an_inclination_is_the_torques_change_with_it():
    """By differences, where the base leans already."""
    model = ChainModel.of(ARM, [*standard_effects(ARM), BaseInclination(axis=0)])
    place = model.place["inclination.x"].start
    standard = np.array([VALUES.get(name, 1.5) for name in model.names])
    q, tau = exact(1, 4.0)
    recorded = Recorded.read(ARM, q, tau, rate=RATE, t=None)
    samples = recorded.samples(recorded.filters(4.0, None, len(model.base.independent)))
    step = np.zeros(len(standard))
    step[place] = 1e-4
    more, less = (model.torques(samples, standard + sign * step) for sign in (1.0, -1.0))
    column = model.columns(samples, standard)[:, :, place]
    np.testing.assert_allclose(column, (more - less) / 2e-4, atol=1e-6 * np.max(np.abs(column)))


@pytest.mark.parametrize(("gravity", "axes"), [((0, 0, -9.81), "xy"), ((0, -9.8, 0.4), "xz"), ((0, 0, 0), "")])
def test_a_base_leans_along_the_axes_across_gravity(gravity: tuple[float, float, float], axes: str):
    tried = candidates_of(ChainModel.of(ARM.with_gravity(gravity)))
    assert [law.key for law in tried if law.family == "inclination"] == [f"inclination.{axis}" for axis in axes]


def test_a_motor_whose_readings_are_scaled_is_named():
    """5 % at joint 3, which carries bodies that others carry too; its own friction is as its motor reads it."""
    tau = exact(4, 30.0)[1]
    plain = found(4, 0.05 * tau * [0.0, 0.0, 1.0, 0.0])
    ranking = plain.rank()
    assert [effect.key for effect in ranking.missing] == ["motor_gain.3"]
    better = plain.with_effects(*ranking.missing)
    assert better.value("GM3") == pytest.approx(0.05, abs=0.005)
    assert better.value("FS3") == pytest.approx(1.05 * COULOMB[2], rel=0.01)
    assert max(one.ratio for one in better.scores) < 1.3


def test_a_motor_that_reads_three_times_as_much_is_fitted():
    """A gear's ratio left out: the gain is beyond 1, and so far from 0 that its products with the bodies count."""
    q, tau = exact(4, 30.0)
    given = [*standard_effects(ARM), laws.MotorGain(2)]
    read = identify_chain(ARM, q, tau * [1.0, 3.0, 1.0, 1.0], rate=RATE, cutoff=4.0, effects=given)
    base, known = read.fitted.base, {**VALUES, "GM2": 2.0, **{f"{law}2": 3.0 * VALUES[f"{law}2"] for law in LAWS}}
    true = base.grouping() @ np.array([known.get(name, 0.0) for name in base.names])
    np.testing.assert_allclose(read.fitted.x, true, atol=0.02)


def test_what_the_bodies_do_not_tell_is_not_testable():
    """A slide along gravity below upright axes: neither its encoder's zero nor its motor's scale changes a torque."""
    slide = Chain.from_table(
        [{"j": 1}, {"j": 2, "ant": 1, "d": 0.3}, {"j": 3, "ant": 2, "d": 0.25, "alpha": "pi", "sigma": 1}],
        gravity=(0, 0, -9.81),
    )
    rng = np.random.default_rng(9)
    t = np.arange(0.0, 30.0, 1.0 / RATE)[:, None]
    w = 2.0 * np.pi * np.array([[0.3, 0.4, 0.5], [0.7, 0.55, 0.8]])
    q = 0.8 * np.sin(w[0] * t) + 0.4 * np.sin(w[1] * t + 1.0)
    qd = np.gradient(q, 1.0 / RATE, axis=0)
    qdd = np.gradient(qd, 1.0 / RATE, axis=0)
    values = {"ZZ1": 0.8, "M2": 5.0, "MX2": 0.6, "ZZ2": 0.1, "M3": 2.0, "ZZ3": 0.02}
    values |= {f"{law}{j}": value for law, value in (("FV", 2.0), ("FS", 1.0), ("IA", 0.2)) for j in (1, 2, 3)}
    tau = slide.inverse_dynamics(q, qd, qdd, values) + 0.02 * rng.standard_normal(q.shape)
    plain = identify_chain(slide, q, tau, rate=RATE, cutoff=4.0)
    for law in (laws.EncoderOffset(3), laws.EncoderOffset(1), laws.MotorGain(3)):
        assert of(plain.rank([law]), law.key).answer is JointAnswer.NOT_TESTABLE
        assert law.parameters[0] in plain.with_effects(law).fitted.unseen
