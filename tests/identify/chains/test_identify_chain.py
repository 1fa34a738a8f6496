"""A robot simulated by another engine is identified back: bodies, laws of joints, couplings, forces, and intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.errors import NotIdentifiable, UsageError
from lacet.identify.chains import effects as laws
from lacet.identify.chains.effects import ExternalForce
from lacet.identify.chains.model import ChainModel, effect_columns, standard_effects
from lacet.identify.chains.ranking import ChainRanking, JointAnswer, JointCandidate, _exceeds, _Rows
from lacet.identify.chains.samples import JointSamples, Recorded
from lacet.identify.chains.scores import JointScore
from lacet.identify.chains.verdicts import ChainVerdict, verdict_of
from lacet.identify.multibody.chain import Chain
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import Filters
from lacet.services.library.chains import IdentifiedChain, identify_chain
from tests.identify.chains.robots import FRICTION, RATE, URDF, Record, motion, simulated

CHAIN = Chain.from_urdf(URDF)
NOISE = (2e-5, 0.05)
CUTOFF = 8.0
SLOW = 1.5
"""Cut-off of slow motion [Hz], at which a sample of the equations stands for several of the record."""


def truth(found: IdentifiedChain, more: dict[str, float] | None = None) -> np.ndarray:
    """True values of the base parameters of a fit."""
    known = dict(CHAIN.given) | {f"{k}{j + 1}": v for k, values in FRICTION.items() for j, v in enumerate(values)}
    known |= more or {}
    every = np.array([known.get(name, 0.0) for name in found.fitted.base.names])
    return found.fitted.base.grouping() @ every


def identified(record: Record, tau: np.ndarray | None = None, **how: object) -> IdentifiedChain:
    """A fit, up to `CUTOFF` where nothing else is said."""
    return identify_chain(CHAIN, record.q, record.tau if tau is None else tau, rate=RATE, **{"cutoff": CUTOFF, **how})  # type: ignore[arg-type]


def off(found: IdentifiedChain, expected: np.ndarray) -> float:
    """Largest error of a base parameter in units of its σ."""
    return float(np.max(np.abs(found.fitted.x - expected) / np.sqrt(np.diag(found.fitted.covariance))))


RECORD = simulated(1, NOISE)
PLAIN = identified(RECORD)


def test_parameters_are_found_within_their_intervals():
    """Four σ at most, of 25 base parameters; joint parameters to a per cent or two."""
    assert off(PLAIN, truth(PLAIN)) < 4.0
    assert not PLAIN.fitted.unseen
    assert PLAIN.value("FV1") == pytest.approx(3.0, rel=0.02)
    low, high = PLAIN.interval("fs2")
    assert low < 1.5 < high
    assert high - low < 0.2


def test_equations_are_newton_eulers():
    """Columns × parameters are the chain's inverse dynamics, law by law."""
    effects = [*standard_effects(CHAIN), laws.LoadFriction(2), laws.JointSpring(3), laws.StribeckFriction(1, speed=0.2),
               laws.AsymmetricViscous(1), laws.ViscousFriction({2: 1.0, 3: -2.0})]  # fmt: skip
    model = ChainModel.of(CHAIN, effects)
    rng = np.random.default_rng(3)
    X = rng.normal(size=len(model.names))
    recorded = Recorded.read(CHAIN, RECORD.q, RECORD.tau, rate=RATE, t=None)
    samples = recorded.samples(recorded.filters(CUTOFF, None))
    W = model.columns(samples, X)
    named = dict(zip(model.names, X, strict=True))
    bodies = {name: named[name] for name in CHAIN.parameter_names}
    load = CHAIN.inverse_dynamics(samples.q, samples.qd, samples.qdd, bodies)
    expected = CHAIN.inverse_dynamics(
        samples.q, samples.qd, samples.qdd,
        bodies | {f"{k}{j}": named[f"{k}{j}"] for k in ("IA", "FV", "FS") for j in (1, 2, 3)},
    )  # fmt: skip
    expected += [named["OFF1"], named["OFF2"], named["OFF3"]]
    expected[:, 1] += named["FL2"] * np.abs(load[:, 1]) * np.sign(samples.qd[:, 1])
    expected[:, 2] += named["K3"] * samples.q[:, 2]
    rate = samples.qd[:, 0]
    expected[:, 0] += named["FB1"] * np.sign(rate) * np.exp(-((rate / 0.2) ** 2)) + named["FVA1"] * np.abs(rate)
    expected += named["FV2_3n"] * np.outer(samples.qd[:, 1] - 2.0 * samples.qd[:, 2], [0.0, 1.0, -2.0])
    np.testing.assert_allclose(W @ X, expected, atol=1e-10)
    np.testing.assert_allclose(model.torques(samples, X), expected, atol=1e-10)


def test_a_long_record_in_pieces_has_the_same_equations(monkeypatch: pytest.MonkeyPatch):
    """Pieces overlap by the filter's memory."""
    recorded = Recorded.read(CHAIN, RECORD.q, RECORD.tau, rate=RATE, t=None)
    samples = recorded.samples(recorded.filters(CUTOFF, None))
    model = ChainModel.of(CHAIN)
    monkeypatch.setattr("lacet.identify.chains.model._PIECE", 10**9)
    whole = model.equations(samples)
    monkeypatch.setattr("lacet.identify.chains.model._PIECE", 700)
    for one, other in zip(model.equations(samples), whole, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.max(np.abs(other)))


def test_motors_that_turn_with_two_joints():
    """q_motor = C q and τ = Cᵀ τ_motor, encoder zeros added: the same parameters."""
    C = np.array([[30.0, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 20.0, -25.0]])
    zero = np.array([0.1, -0.2, 0.3])
    q, tau = (RECORD.q - zero) @ C.T, RECORD.tau @ np.linalg.inv(C)
    found = identify_chain(CHAIN, q, tau, rate=RATE, cutoff=CUTOFF, motors=C, zero=zero)
    np.testing.assert_allclose(found.fitted.x, PLAIN.fitted.x, rtol=1e-5, atol=1e-7)


def test_a_law_at_a_joint_is_found_with_its_size():
    """Spring, load-dependent friction, coupling and encoder offset, each added to the torques of the other engine."""
    q, qd = RECORD.q, RECORD.qd
    tau = RECORD.tau.copy()
    tau[:, 2] += 4.0 * q[:, 2]
    tau += 0.7 * np.outer(np.sign(qd[:, 1] + qd[:, 2]), [0.0, 1.0, 1.0])
    found = identified(RECORD, tau, effects=[
        *standard_effects(CHAIN), laws.JointSpring(3), laws.CoulombFriction({2: 1, 3: 1}, "m")
    ])  # fmt: skip
    assert off(found, truth(found, {"K3": 4.0, "FSm": 0.7})) < 4.0


def test_friction_that_grows_with_load():
    """The load is the bodies' own torque, found again until it stands still."""
    # The rotor of joint 2 cannot be distinguished from the body's inertia about it, and counts among the load.
    load = CHAIN.inverse_dynamics(RECORD.q, RECORD.qd, RECORD.qdd, {**CHAIN.given, "IA2": FRICTION["IA"][1]})
    tau = RECORD.tau + np.outer(0.15 * np.abs(load[:, 1]) * np.sign(RECORD.qd[:, 1]), [0.0, 1.0, 0.0])
    found = identified(RECORD, tau, effects=[*standard_effects(CHAIN), laws.LoadFriction(2)])
    low, high = found.interval("FL2")
    assert low - 0.01 < 0.15 < high + 0.01
    assert high - low < 0.05


def test_an_encoder_that_is_off():
    """The joint's zero is found from gravity and inertia, and the other parameters with it."""
    moved = Record(RECORD.q - [0.0, 0.08, 0.0], RECORD.tau, RECORD.qd, RECORD.qdd)
    blind = identified(moved)
    found = identified(moved, effects=[*standard_effects(CHAIN), laws.EncoderOffset(2)])
    assert found.value("QO2") == pytest.approx(0.08, abs=0.005)
    assert off(found, truth(found, {"QO2": 0.08})) < 4.5
    assert blind.fitted.sigma[1] > 1.2 * found.fitted.sigma[1]
    assert found.scores[1].ratio == pytest.approx(PLAIN.scores[1].ratio, rel=0.05)


@pytest.mark.parametrize("axes", ["body", "ground"])
def test_a_measured_force_on_a_body(axes: str):
    """Torques that hold it by the poses' differences (virtual work), not by the Jacobian."""
    rng = np.random.default_rng(5)
    t = np.arange(len(RECORD.q)) / RATE
    force = 20.0 * np.sin(np.outer(t, [1.1, 0.7, 1.9]) + rng.uniform(0, 6, 3))
    point = np.array([0.1, 0.02, -0.03])
    at = np.append(point, 1.0)
    tau, step = RECORD.tau.copy(), 1e-5
    turned = force if axes == "ground" else np.einsum("nij,nj->ni", CHAIN.pose(3, RECORD.q)[:, :3, :3], force)
    for j in range(3):
        moves = [(CHAIN.pose(3, RECORD.q + s * step * np.eye(3)[j]) @ at)[:, :3] for s in (1, -1)]
        tau[:, j] -= np.sum(turned * (moves[0] - moves[1]), axis=1) / (2 * step)
    found = identified(RECORD, tau, external=[ExternalForce(3, force, None, tuple(point), axes)])
    np.testing.assert_allclose(found.fitted.x, PLAIN.fitted.x, atol=2e-3)
    assert np.all(identified(RECORD, tau).fitted.sigma > 10.0 * found.fitted.sigma)


def test_seconds_that_are_bad_count_less():
    """A second of a knock on the torques moves a robust fit less."""
    tau = RECORD.tau.copy()
    tau[2000:2200] += 40.0 * np.sin(np.arange(200) / 9.0)[:, None]
    plain, robust = identified(RECORD, tau), identified(RECORD, tau, robust=True)
    expected = truth(PLAIN)
    errors = [
        np.linalg.norm((f.fitted.x - expected) / np.sqrt(np.diag(PLAIN.fitted.covariance))) for f in (plain, robust)
    ]
    assert errors[1] < 0.5 * errors[0]
    assert np.min(robust.fitted.weights) < 0.5


def test_errors_are_those_of_the_noise():
    """Error ÷ floor is 1 for a complete model, on what was fitted to, held out, and another record."""
    for scores in (PLAIN.scores, PLAIN.held_out, PLAIN.predict(*_sampled(simulated(2, NOISE)))):
        assert [one.joint for one in scores] == ["j1", "j2", "j3"]
        for one in scores:
            assert 0.8 < one.ratio < 1.35
    assert PLAIN.scores[0].explained > 99.5


def _sampled(record: Record) -> tuple[np.ndarray, np.ndarray]:
    return record.q, record.tau


def test_the_missing_law_is_named():
    """A motor's friction on two joints and a spring are found among all laws; then nothing is missing."""
    complete = PLAIN.rank()
    assert complete.missing == ()
    assert complete.verdict == "nothing missing"
    assert complete.failing == ()
    assert repr(complete).startswith("nothing missing that these data show")
    assert "times its noise floor" in repr(complete)
    tau = RECORD.tau.copy()
    tau += 0.5 * np.outer(RECORD.qd[:, 1] + RECORD.qd[:, 2], [0.0, 1.0, 1.0])
    tau[:, 0] += 2.0 * RECORD.q[:, 0]
    found = identified(RECORD, tau)
    ranking = found.rank()
    assert {effect.key for effect in ranking.missing} == {"viscous.2_3", "spring.1"}
    after = found.with_effects(*ranking.missing)
    assert after.rank().missing == ()
    assert after.value("K1") == pytest.approx(2.0, abs=0.1)
    assert after.value("FV2_3") == pytest.approx(0.5, abs=0.05)
    assert "missing: " in repr(ranking)
    assert "<table>" in ranking._repr_html_()


@pytest.mark.parametrize(("size", "verdict"), [(1.5, "unlisted cause"), (0.1, "small rest")])
def test_a_cause_that_is_in_no_law_is_not_listed(size: float, verdict: str):
    """A torque that waves with a joint's position [N·m]: the model fails there, and no law is said to be missing."""
    tau = RECORD.tau.copy()
    tau[:, 1] += size * np.sin(25.0 * RECORD.q[:, 1])
    ranking = identified(RECORD, tau).rank()
    assert ranking.missing == ()
    assert ranking.verdict == verdict
    assert [one.joint for one in ranking.failing] == ["j2"]
    said = repr(ranking)
    assert "nothing missing" not in said
    ratio = f"j2 (error {ranking.failing[0].ratio:.2g} times its noise floor)"
    told = {
        "unlisted cause": f"the model fails at {ratio}, and the cause is not among the {len(ranking.candidates)} laws "
        "tried: not listed. Plot what remains",
        "small rest": f"A small rest of unknown cause remains at {ratio}: less than 1 % of the torque's variation",
    }
    assert told[verdict] in said
    assert ("may be off by more than their intervals" in said) == (verdict == "small rest")


def test_a_verdict_follows_from_laws_and_errors():
    """In this order: laws found, too short a record, errors of noise, small errors, a cause in no list."""
    rows = {
        "noise": JointScore("a", 1.2, 1.0, 99.0, 50.0, 0.3),
        "chance of 5 %, no larger": JointScore("a", 1.04, 1.0, 99.0, 50.0, 0.05),
        "small": JointScore("a", 1.1, 1.0, 99.0, 50.0, 0.05),
        "large": JointScore("a", 1.2, 1.0, 99.0, 50.0, 0.05),
    }
    found = {name: verdict_of(ChainRanking((), 20), (one,)) for name, one in rows.items()}
    assert list(found.values()) == [
        ChainVerdict.NOTHING, ChainVerdict.NOTHING, ChainVerdict.SMALL, ChainVerdict.UNLISTED
    ]  # fmt: skip
    assert verdict_of(ChainRanking((), 20), (rows["small"], rows["large"])) is ChainVerdict.UNLISTED
    assert verdict_of(ChainRanking((), 3), (rows["large"],)) is ChainVerdict.UNTESTED
    law = JointCandidate(laws.JointSpring(1), 9.0, 0.001, (1.0,), JointAnswer.MISSING)
    assert verdict_of(ChainRanking((law,), 20), (rows["large"],)) is ChainVerdict.MISSING


def test_held_out_errors_of_a_short_record_are_those_of_noise():
    """Parameters from the rest of few equations are uncertain: noise predicted by them is the floor."""
    ratios: list[list[float]] = []
    for seed in (1, 2, 3):
        found = identified(simulated(seed, NOISE, 14.0), cutoff=SLOW)
        alone = np.sqrt(np.nanmean(found._noise**2, axis=(0, 1)))
        for one, noise in zip(found.held_out, alone, strict=True):
            ratios.append([one.ratio, one.rms / noise])
    assert 0.5 < np.median(ratios, axis=0)[0] < 1.3
    assert np.max(ratios, axis=0)[0] < 1.5
    assert np.median(ratios, axis=0)[1] > 1.6


@pytest.mark.parametrize("cutoff", [1.5, 2.0])
def test_friction_where_motion_turns_back_at_fewer_samples(cutoff: float):
    """A record sampled faster than the equations need: friction leaves no pulses where joints turn back."""
    found = identified(RECORD, cutoff=cutoff)
    assert max(one.ratio for one in found.scores) < 1.35
    assert off(found, truth(found)) < 4.5


def test_a_column_where_motion_turns_back_is_the_mean_over_the_record():
    """Of eight samples of the record for each; elsewhere, and with one for each, it is the law's at the instant."""
    law = laws.CoulombFriction(1)
    t, period = np.arange(-2.0, 3.0) * 0.01, 0.01
    rate, acceleration = 3.0 * (t - 0.0021), np.full(5, 3.0)
    states = np.zeros((3, 5, 3))
    states[1, :, 0], states[2, :, 0] = rate, acceleration
    filters = replace(Filters(), rate=1.0 / period)
    instants = (np.arange(-4, 5) * period / 8, np.array([0.5, *[1.0] * 7, 0.5]) / 8)
    for recorded, middle in ((1, -1.0), (8, float(np.sign(3.0 * (instants[0] - 0.0021)) @ instants[1]))):
        samples = JointSamples(*states, np.zeros((5, 3)), (), filters, recorded)
        found = effect_columns(CHAIN, law, states, np.zeros((5, 3)), samples)
        np.testing.assert_allclose(found[:, 0, 0], [-1.0, -1.0, middle, 1.0, 1.0])


def test_a_missing_law_whose_place_others_took_is_named():
    """A spring where gravity's parameters and the offset take most of its torque, in slow motion.

    What remains of it is less than inexact friction might leave, but has the spring's shape, and the spring is large.
    """
    tau = RECORD.tau.copy()
    tau[:, 1] += 2.0 * (RECORD.q[:, 1] - 0.4)
    found = identified(RECORD, tau, cutoff=SLOW)
    assert found.scores[1].ratio > 15.0
    assert [effect.key for effect in found.rank().missing] == ["spring.2"]


def test_a_constant_torque_is_no_shape_of_a_law():
    """Only how a law's torque varies at a joint is compared with what the laws may leave."""
    joint, zeros = np.array([0, 1, 0, 1, 0, 1]), np.zeros(6, int)
    rows = _Rows(joint, zeros, zeros, 1, np.array([1.0, 1.0]), np.array([np.inf, np.inf]))
    assert not _exceeds(np.array([9.0, 0.0, 9.0, 0.0, 9.0, 0.0]), rows)
    assert _exceeds(np.array([9.0, 0.0, 9.0, 2.0, 9.0, 0.0]), rows)


def test_what_is_printed():
    """Two tables: parameters with interval, unit and grouping; errors joint by joint."""
    text = str(PLAIN)
    assert "j2" in text
    assert "held out" in text
    line = next(line for line in text.splitlines() if line.strip().startswith("FV1"))
    assert "N·m·s/rad" in line
    assert PLAIN._repr_html_().count("<table>") == 2
    grouped = next(one for one in PLAIN.parameters if one.name == "ZZ1")
    assert grouped.group.startswith("ZZ1 + ")
    assert PLAIN.value(
        grouped.group.replace(" XX", "*XX").replace("0.4 ", "0.4*").replace("0.16 ", "0.16*")
    ) == pytest.approx(grouped.value)


def test_values_that_cannot_be_are_told():
    """Torques of reversed sign; one joint's alone; a record as it should be, and one without friction, say nothing."""
    assert PLAIN.fitted.wrong_signs == ()
    assert "negative" not in str(PLAIN)
    turned = identified(RECORD, -RECORD.tau)
    assert {"ZZ1", "FV1", "FV2", "FV3", "FS1", "FS2", "FS3"} <= {one.name for one in turned.fitted.wrong_signs}
    assert "FS3 are negative beyond the interval" in str(turned)
    assert "check the signs and units of torques and positions" in turned._repr_html_()
    one = identified(RECORD, RECORD.tau * [1.0, 1.0, -1.0])
    assert {"FV3", "FS3"} <= {each.name for each in one.fitted.wrong_signs}
    assert not {"FV1", "FV2"} & {each.name for each in one.fitted.wrong_signs}
    exact = CHAIN.inverse_dynamics(RECORD.q, RECORD.qd, RECORD.qdd, CHAIN.given)
    assert identified(RECORD, exact).fitted.wrong_signs == ()


def test_a_negative_value_is_told_beyond_chance_and_effect_size(monkeypatch: pytest.MonkeyPatch):
    """1.5 σ is chance; 6 σ is none, and as little torque as the user does not ask for; 50 σ is told."""
    fitted = PLAIN.fitted
    (friction,) = (one for one in fitted.estimates if one.name == "FV1")
    place = [fitted.base.names[int(k)] for k in fitted.base.independent].index("FV1")

    def told(sigmas: float) -> list[str]:
        x = fitted.x.copy()
        x[place] = -sigmas * friction.sigma
        return [one.name for one in replace(fitted, x=x).wrong_signs]

    assert [told(sigmas) for sigmas in (1.5, 6.0, 50.0)] == [[], [], ["FV1"]]
    monkeypatch.setattr("lacet.identify.chains.fit.SELECTION", replace(SELECTION, effect_size=0.0))
    assert [told(sigmas) for sigmas in (1.5, 6.0)] == [[], ["FV1"]]


def test_what_cannot_be_determined_is_refused():
    """A mass alone, a name that there is not, and what is no sum."""
    with pytest.raises(NotIdentifiable, match="torques do not determine 'M3'"):
        PLAIN.combination("M3")
    with pytest.raises(KeyError, match="there is no parameter 'FW1'"):
        PLAIN.combination("FW1")
    with pytest.raises(ValueError, match="no sum of parameters"):
        PLAIN.combination("FV1*FS1")
    still = Record(RECORD.q * [1.0, 1.0, 0.0], RECORD.tau, RECORD.qd, RECORD.qdd)
    with pytest.raises(NotIdentifiable, match="j3 never moves faster"):
        identified(still, slowest=0.01)


WRONG = {
    "rate and t": ({"rate": 250.0, "t": np.arange(5000.0)}, "either the sample rate"),
    "neither": ({"rate": None}, "either the sample rate"),
    "motors": ({"motors": np.zeros((3, 3))}, "motors must be an invertible 3 × 3 matrix"),
    "zero": ({"zero": [0.0]}, "zero must be 3 positions"),
    "too fine": ({"cutoff": 200.0}, r"the pre-filter \(100 Hz\) must be at least 3 times"),
    "twice": ({"effects": [laws.JointSpring(1), laws.JointSpring(1)]}, "two effects have a parameter K1"),
    "joint": ({"effects": [laws.JointSpring(4)]}, "there is no joint 4 that moves"),
    "body": ({"external": [ExternalForce(7, np.zeros((5000, 3)))]}, "found an external force on 7"),
    "slowest": ({"slowest": [0.1, 0.1]}, "slowest must be one rate or 3 of them"),
}


@pytest.mark.parametrize("name", WRONG)
def test_arguments_that_do_not_fit_are_refused(name: str):
    """With what was expected and what was found."""
    given, message = WRONG[name]
    with pytest.raises(UsageError, match=message):
        identify_chain(CHAIN, RECORD.q, RECORD.tau, **{"rate": RATE, **given})  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"q must have the shape \(N, 3\)"):
        identify_chain(CHAIN, RECORD.q[:, :2], RECORD.tau, rate=RATE)


@pytest.mark.slow
def test_intervals_hold_the_truth_in_95_percent():
    """Over 60 seeds and all base parameters of a complete model, by another engine's torques."""
    inside: list[np.ndarray] = []
    for seed in range(60):
        found = identified(simulated(100 + seed, NOISE))
        half = np.array([one.half for one in found.parameters])
        inside.append(np.abs(found.fitted.x - truth(found)) <= half)
    share = float(np.mean(inside))
    assert 0.92 < share < 0.985


def test_a_joint_that_follows_another_has_no_column():
    """A sliding mimic joint: q and tau are the free joints', and exact torques give the parameters back."""
    text = URDF.replace('name="j3" type="revolute"', 'name="j3" type="prismatic"')
    mimic = '<axis xyz="0 1 0"/><mimic joint="j2" multiplier="0.3" offset="0.1"/>'
    chain = Chain.from_urdf(text.replace('<axis xyz="0 1 0"/>', mimic))
    known = {**chain.given, "FV2": 2.0}
    q, qd, qdd = motion(7)
    free = [x[:, :2] for x in (q, qd, qdd)]
    tau = chain.coupling.torques(chain.inverse_dynamics(*chain.coupling.states(*free), known))
    found = identify_chain(chain, free[0], tau, rate=RATE, cutoff=CUTOFF).fitted
    expected = found.base.grouping() @ np.array([known.get(name, 0.0) for name in found.base.names])
    np.testing.assert_allclose(found.x, expected, atol=1e-3)
