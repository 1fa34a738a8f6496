"""Short, slow records: each joint's noise by its degrees of freedom, intervals that hold, too few equations refused."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy

from lacet.daq.errors import NotIdentifiable
from lacet.identify.chains.weights import serial_quantile, solved_together, student
from lacet.identify.multibody.chain import Chain
from lacet.services.library.chains import IdentifiedChain, identify_chain
from tests.identify.chains.arms import ARM, NOISE, RATE, VALUES, record, states


def held(found: IdentifiedChain) -> np.ndarray:
    """Whether each interval holds the true value."""
    base = found.fitted.base
    known = base.grouping() @ np.array([VALUES.get(name, 0.0) for name in base.names])
    true = {base.names[int(k)]: value for k, value in zip(base.independent, known, strict=True)}
    return np.array([abs(one.value - true[one.name]) <= one.half for one in found.parameters])


@pytest.mark.parametrize(("cutoff", "instants"), [(None, 89), (0.9, 21)])
def test_intervals_of_a_short_record_hold(cutoff: float | None, instants: int):
    """20 s, 36 parameters, 24 seeds: 95 % of the intervals hold the truth, and none of the records fails as a whole."""
    shares: list[float] = []
    for seed in range(200, 224):
        found = identify_chain(ARM, *record(seed), rate=RATE, cutoff=cutoff)
        assert len(found.fitted.t) == instants
        shares.append(float(np.mean(held(found))))
    assert 0.925 <= np.mean(shares) <= 0.985
    assert min(shares) > 0.7


def test_variances_of_joints_are_unbiased_where_equations_are_few():
    """Three joints of 24 equations in 24 parameters, 100 draws: the mean of σ² is the true one, and none is 0.

    With n in the divisor it would be 2/3 of it in the mean, and 0 where a joint's own noise begins to weigh less.
    """
    rng = np.random.default_rng(4)
    W = rng.normal(size=(24, 3, 24))
    W[:, 2, :12] = 0.0
    used, ones, sigma = np.ones((24, 3), bool), np.ones((24, 3)), np.array([1.0, 3.0, 0.2])
    found = [solved_together(W, sigma * rng.normal(size=(24, 3)), used, ones) for _ in range(100)]
    for one in found:
        assert np.sum(one.freedom) == pytest.approx(72 - 24, abs=1e-6)
        assert np.min(one.freedom) > 1.0
    np.testing.assert_allclose(np.mean([one.sigma**2 for one in found], axis=0) / sigma**2, 1.0, atol=0.15)


def test_quantiles():
    """Student's of one joint, of equal joints together, and the normal one of many; more where HAC has few parts."""
    assert student(np.array([2.0]), np.array([5.0])) == pytest.approx(scipy.stats.t.isf(0.025, 5.0))
    assert student(np.array([1.0, 1.0]), np.array([5.0, 5.0])) == pytest.approx(scipy.stats.t.isf(0.025, 10.0))
    assert student(np.array([0.0]), np.array([5.0])) == pytest.approx(1.96, abs=1e-3)
    assert serial_quantile(10**7) == pytest.approx(1.96, abs=1e-2)
    assert serial_quantile(21) > 2.9


def test_too_few_equations_are_refused_with_what_to_do():
    """9 instants: the fit goes through a joint's equations; no warning and no NaN, but how long a record must be."""
    said = r"a record of 20 s has \d\d equations up to 0\.65 Hz for 36 values: record 74 s or more, or fit to a higher"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(NotIdentifiable, match=said):
            identify_chain(ARM, *record(3), rate=RATE, cutoff=0.65)
        found = identify_chain(ARM, *record(3, 74.0), rate=RATE, cutoff=0.65)
    assert np.min(found.fitted.freedom) > 70.0


def test_a_joint_that_stands_still_is_refused_with_what_to_do():
    """Noise alone gives it an equation or two, which no length of a record makes enough; as a fixed joint it is fitted.
    With every joint still there is nothing to fit.
    """
    rng = np.random.default_rng(4)
    moving = np.array([1.0, 1.0, 1.0, 0.0])
    q, qd, qdd = (x * moving for x in states(4, 20.0))
    values = {name: value for name, value in VALUES.items() if not name.startswith("OFF")}
    tau = ARM.inverse_dynamics(q, qd, qdd, values) + NOISE * rng.standard_normal(q.shape)
    for noise in (0.0, 1e-5):
        recorded = q + noise * rng.standard_normal(q.shape)
        with pytest.raises(NotIdentifiable, match=f"{ARM.names[3]} never moves faster .*sigma: 2 in a table"):
            identify_chain(ARM, recorded, tau, rate=RATE, cutoff=2.0)
    rows = [{"j": 1}, {"j": 2, "ant": 1, "alpha": "-pi/2"}, {"j": 3, "ant": 2, "d": 0.5}]
    fixed = Chain.from_table([*rows, {"j": 4, "ant": 3, "d": 0.3, "alpha": "pi/2", "r": 0.1, "sigma": 2}])
    found = identify_chain(fixed, q[:, :3], tau[:, :3], rate=RATE, cutoff=2.0)
    assert found.value("FV3") == pytest.approx(VALUES["FV3"], rel=0.05)
    with pytest.raises(NotIdentifiable, match="no joint moves faster"):
        identify_chain(ARM, 0.0 * q, tau, rate=RATE)


def test_few_equations_are_reported():
    """Where a joint's noise is hardly known, the first sentence has the length that is needed; dashes for no number."""
    q, tau = record(5, 18.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = identify_chain(ARM, q, tau, rate=RATE, cutoff=0.9)
        text = str(found)
    assert found.doubts.few
    assert "A record of 18 s has 68 equations up to 0.9 Hz for 36 values: record 53 s or more" in text
    assert "nan" not in text
    assert "inf" not in text
    assert all(np.isfinite(one.half) for one in found.parameters)
    assert not identify_chain(ARM, q, tau, rate=RATE).doubts.few
