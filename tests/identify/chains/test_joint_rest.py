"""Laws found beside something that is not listed: named where they explain more than what remains at their joints."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.chains.effects import EncoderOffset
from lacet.identify.chains.ranking import ChainRanking, JointAnswer, JointCandidate
from lacet.identify.chains.rest import FoundLaw, JointRest, rest_of
from lacet.identify.chains.scores import JointScore
from lacet.identify.chains.verdicts import ChainVerdict, verdict_of
from lacet.identify.multibody.chain import Chain
from lacet.services.library.chains import identify_chain
from tests.identify.chains.arms import ARM, RATE, record
from tests.identify.chains.test_named_laws import found, leaning, of

COUNT = 400
"""Equations of each of two joints."""
JOINT = np.repeat([0, 1], COUNT)
RNG = np.random.default_rng(4)
LAW, OTHER, UNKNOWN, NOISE = RNG.standard_normal((4, 2 * COUNT))
"""A law's shape at both joints, another's, that of something unlisted, and noise of 1 σ."""


def at(number: int, shape: np.ndarray) -> np.ndarray:
    """A shape at one joint alone."""
    return np.where(number == JOINT, shape, 0.0)


def remaining(residual: np.ndarray, **shapes: np.ndarray) -> JointRest:
    """What laws of these shapes leave of a residual, beside noise of 1 σ."""
    laws = {key: FoundLaw(shape[:, None], shape[:, None]) for key, shape in shapes.items()}
    return rest_of(laws, residual, JOINT, np.full(2, float(COUNT)), np.zeros(2), np.zeros(2))


def test_beside_noise_every_law_stands():
    """However little it explains."""
    rest = remaining(NOISE + at(0, 0.4 * LAW) + at(1, 3.0 * OTHER), a=at(0, LAW), b=at(1, OTHER))
    assert rest.standing == ("a", "b")
    assert not rest.unlisted.any()
    assert np.all(np.abs(rest.ratios - 1.0) < 0.05)


@pytest.mark.parametrize(("size", "standing"), [(2.0, ()), (6.0, ("a",))])
def test_at_a_joint_with_a_rest_a_law_must_explain_more_than_that(size: float, standing: tuple[str, ...]):
    """The rest has four times the noise."""
    rest = remaining(NOISE + at(0, 4.0 * UNKNOWN + size * LAW), a=at(0, LAW))
    assert rest.standing == standing
    assert rest.unlisted.tolist() == [True, False]


def test_a_rest_at_another_joint_takes_no_name_away():
    rest = remaining(NOISE + at(0, 2.0 * LAW) + at(1, 4.0 * UNKNOWN), a=at(0, LAW))
    assert rest.standing == ("a",)
    assert rest.unlisted.tolist() == [False, True]


def test_what_a_law_leaves_that_is_not_named_counts_beside_the_others():
    """4.4² of the second is more than the rest of 4², and less than that with the 3² of the first, which is no name."""
    rest = remaining(NOISE + at(0, 4.0 * UNKNOWN + 3.0 * LAW + 4.4 * OTHER), a=at(0, LAW), b=at(0, OTHER))
    assert rest.standing == ()
    alone = remaining(NOISE + at(0, 4.0 * UNKNOWN + 4.4 * OTHER), b=at(0, OTHER))
    assert alone.standing == ("b",)


def test_what_laws_may_be_inexact_by_is_no_rest():
    """A fifth of a law found, and what is allowed to those in the model."""
    assert not remaining(NOISE + at(0, 10.0 * LAW + 1.5 * UNKNOWN), a=at(0, LAW)).unlisted.any()
    assert remaining(NOISE + at(0, 10.0 * LAW + 3.0 * UNKNOWN), a=at(0, LAW)).unlisted.tolist() == [True, False]
    rest = rest_of({}, NOISE + at(0, UNKNOWN), JOINT, np.full(2, float(COUNT)), np.full(2, 2.0 * COUNT), np.zeros(2))
    assert not rest.unlisted.any()


def test_what_is_hardly_above_the_floor_or_less_than_the_user_asks_for_is_no_rest():
    """1.03 times the floor; and a rest of half the effect size."""
    floor, none = np.full(2, float(COUNT)), np.zeros(2)
    residual = np.sqrt(floor[0] / np.sum(at(0, NOISE) ** 2)) * NOISE
    assert not rest_of({}, 1.03 * residual, JOINT, floor, none, none).unlisted[0]
    assert rest_of({}, 1.1 * residual, JOINT, floor, none, none).unlisted[0]
    rest = NOISE + at(0, 2.0 * UNKNOWN)
    assert rest_of({}, rest, JOINT, floor, none, np.full(2, 2.0 * COUNT)).unlisted[0]
    assert not rest_of({}, rest, JOINT, floor, none, np.full(2, 8.0 * COUNT)).unlisted[0]


def test_of_two_laws_that_look_alike_the_one_that_explains_more_stands():
    """Beside each other each explains less than the rest."""
    like = at(0, LAW + 0.3 * OTHER)
    rest = remaining(NOISE + at(0, 4.0 * UNKNOWN + 8.0 * LAW), a=at(0, LAW), b=like)
    assert rest.standing == ("a",)


def test_without_a_name_nothing_stands_in_for_one(monkeypatch: pytest.MonkeyPatch):
    """Laws found that are no names, and those that they would explain, are undecided."""
    plain = leaning(0.06)
    answers = {one.answer for one in plain.rank().candidates}
    assert {JointAnswer.MISSING, JointAnswer.STANDS_IN} <= answers
    nothing = JointRest((), np.ones(4), np.zeros(4, bool))
    monkeypatch.setattr("lacet.identify.chains.ranking.rest_of", lambda *_: nothing)
    answers = {one.answer for one in plain.rank().candidates}
    assert JointAnswer.UNDECIDED in answers
    assert not {JointAnswer.MISSING, JointAnswer.STANDS_IN} & answers


def test_where_gravity_is_given_another_way_something_unlisted_remains():
    """The arm leans by 0.4 rad: what seems to be missing is not all, and where it is less than the rest has no name."""
    q, tau = record(3)
    leaning = Chain.from_table(
        [{"j": 1}, {"j": 2, "ant": 1, "alpha": "-pi/2"}, {"j": 3, "ant": 2, "d": 0.5},
         {"j": 4, "ant": 3, "d": 0.3, "alpha": "pi/2", "r": 0.1}], gravity=(0.0, -3.82, -9.03),
    )  # fmt: skip
    assert identify_chain(ARM, q, tau, rate=RATE).rank().verdict == "nothing missing"
    ranking = identify_chain(leaning, q, tau, rate=RATE).rank()
    assert ranking.unlisted
    assert all(ratio > 2.0 for ratio in ranking.unlisted.values())
    said = repr(ranking)
    assert "the direction of gravity" in said or "something not listed remains at" in said.lower()
    weak = [one for one in ranking.candidates if one.answer is JointAnswer.UNDECIDED]
    assert not {one.effect.key for one in weak} & {effect.key for effect in ranking.missing}
    assert not weak or "may be parts of the same cause" in said


def test_a_law_larger_than_it_can_be_is_not_named(monkeypatch: pytest.MonkeyPatch):
    """An encoder that is off by 0.02 rad, where it could be by 0.01 rad at most."""
    plain = found(5, moved=np.array([0.0, 0.02, 0.0, 0.0]))
    assert of(plain.rank(), "encoder_offset.2").answer is JointAnswer.MISSING
    monkeypatch.setattr(EncoderOffset, "largest", 0.01)
    assert of(plain.rank(), "encoder_offset.2").answer is JointAnswer.IMPLAUSIBLE


def test_where_laws_are_not_named_for_a_rest_the_cause_is_unlisted():
    """However small the errors were called before."""
    law = JointCandidate(EncoderOffset(1), 9.0, 0.001, (1.0,), JointAnswer.UNDECIDED)
    small = JointScore("a", 1.1, 1.0, 99.0, 50.0, 0.05)
    assert verdict_of(ChainRanking((law,), 20), (small,)) is ChainVerdict.SMALL
    assert verdict_of(ChainRanking((law,), 20, {"a": 9.0}), (small,)) is ChainVerdict.UNLISTED
