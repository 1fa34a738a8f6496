"""What the runs used leave open: named before anyone is fooled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.validation.prediction_uncertainty import Knowledge, place_of
from lacet.identify.validation.score import compare
from lacet.identify.validation.whiteness import Colour
from lacet.services.render.identifiability import open_parameters, rows_not_judged


@pytest.fixture(scope="module")
def sine_knowledge(sine_only: Fit) -> Knowledge:
    """What sinus steering alone tells."""
    return Knowledge.of(sine_only)


def test_sinus_steering_leaves_pitch_out_and_says_so(
    sine_only: Fit, sine_knowledge: Knowledge, drives: dict[str, PreparedRun]
) -> None:
    """Figure 9 of the paper: a lift-off held out fails in pitch; YY6 and the run that shows it are named."""
    held = compare(sine_only, drives["liftoff"], draws=20, knowledge=sine_knowledge)
    pitch = held.scores["chassis.my"]
    assert pitch.ratio > 1.3
    assert pitch.colour is Colour.COLOURED
    assert not pitch.judged
    assert "YY6" in pitch.why.names
    assert "braking" in open_parameters(pitch.why)
    (line,) = [line for line in rows_not_judged(held) if "chassis.my of run liftoff cannot be judged:" in line]
    assert "YY6" in line
    for row in ("chassis.fx", "chassis.fy", "chassis.mz", "tyre.fl"):
        assert held.scores[row].judged
        assert held.scores[row].colour is Colour.LIKE_NOISE, held.scores[row]
    used = compare(sine_only, drives["sine"], draws=6)
    assert used.used
    assert not rows_not_judged(used)
    assert all(s.doubt == 0.0 for s in used.scores.values())


def test_a_failure_beyond_what_is_open_is_a_failure(
    sine_only: Fit, sine_knowledge: Knowledge, drives: dict[str, PreparedRun]
) -> None:
    """A model whose pitch inertia is wrong by far more than its doubt is judged, and fails."""
    theta = sine_only.theta.copy()
    theta[sine_only.model.names.index("YY6")] += 5000.0
    held = compare(replace(sine_only, theta=theta), drives["liftoff"], draws=6, knowledge=sine_knowledge)
    assert held.scores["chassis.my"].judged
    assert held.scores["chassis.my"].ratio > 5.0


def test_what_was_grouped_is_as_open_as_its_priors(fitted: Fit) -> None:
    """A group's value keeps the fit's interval; each member alone has its prior's width or less."""
    knowledge = Knowledge.of(fitted)
    p = len(knowledge.names)
    group = np.zeros((1, p))
    for name in ("M29", "M32"):
        group[0, knowledge.names.index(name)] = 1.0
    i = knowledge.names.index("M29")
    assert knowledge.spread(group)[0] == pytest.approx(np.sqrt(fitted.covariance[i, i]), rel=1e-6)
    alone = knowledge.spread(np.eye(p))
    prior = np.array([q.prior for q in fitted.model.parameters])
    m = knowledge.names.index("M32")
    assert 5.0 < alone[m] <= prior[m]
    assert np.all(alone < 1.5 * prior)  # its own prior, with that of its share of the group
    known = knowledge.names.index("spring.fl.k")
    assert alone[known] == pytest.approx(np.sqrt(fitted.covariance[known, known]), rel=0.05)


def test_the_responsible_parameter_is_the_one_whose_knowledge_helps() -> None:
    """Of two uncertain parameters, the one the prediction leans on; a constant it was confused with is not named."""
    covariance = np.diag([4.0, 100.0, 1.0])
    covariance[0, 2] = covariance[2, 0] = 1.9
    knowledge = Knowledge(("a", "b", "c"), ("A", "B", "C"), covariance)
    assert knowledge.responsible(np.diag([1.0, 0.0, 0.0]), 0.1) == (0,)
    assert knowledge.responsible(np.diag([1.0, 1.0, 0.0]), 0.1) == (1, 0)
    assert knowledge.responsible(np.diag([1.0, 1.0, 0.0]), 200.0) == ()
    assert open_parameters(knowledge.open_parameters((1, 0))).startswith("b and a not determined well enough")
    assert "B; A" in open_parameters(knowledge.open_parameters((1, 0)))


@pytest.mark.slow
def test_a_straight_run_does_not_pass_noise_for_yaw_inertia(
    drives: dict[str, PreparedRun], models: dict[str, Model]
) -> None:
    """A lift-off alone: ZZ6 stands on noise. Its interval is the prior's, and no steering run is judged by it."""
    straight = fit(models["bars"], [drives["liftoff"]])
    i = straight.model.names.index("ZZ6")
    # What independent residuals would say is a lie, so that this test can fail: the truth is 4079 kg·m².
    assert abs(straight.theta[i] - 4079.0) > 5 * np.sqrt(straight.covariance_iid[i, i])
    knowledge = Knowledge.of(straight)
    for covariance in (straight.covariance, knowledge.covariance):
        assert abs(straight.theta[i] - 4079.0) < 2.5 * np.sqrt(covariance[i, i])
    held = compare(straight, drives["sine"], draws=6, knowledge=knowledge)
    assert not held.scores["chassis.mz"].judged
    assert "ZZ6" in held.scores["chassis.mz"].why.names


@pytest.mark.slow
def test_three_runs_judge_the_fourth(drives: dict[str, PreparedRun], models: dict[str, Model]) -> None:
    """With pitch in the runs used, every row of the rough road can be judged, and none is far off."""
    known = fit(models["bars"], [drives[name] for name in ("sine", "sweep", "liftoff")])
    held = compare(known, drives["rough"], draws=20)
    assert place_of(known, drives["rough"]) is None
    assert not held.used
    assert all(s.judged for s in held.scores.values())
    assert max(s.doubt for s in held.scores.values()) < 0.6
