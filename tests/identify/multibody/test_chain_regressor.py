"""The regressor by machine code: against torques, against Jacobians, packed, by threads, far from the ground."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.identify.car.car_tree import car_chain
from lacet.identify.multibody.chain import Chain, Joint
from lacet.identify.multibody.compiled import compiled

NEAR = 1e-10
"""Largest difference between two ways to the same entry, as a part of the largest entry (or of 1)."""


@st.composite
def cases(draw: st.DrawFn) -> tuple[Chain, np.ndarray, np.ndarray]:
    """A random tree (fixed frames, offsets everywhere), states (3, N, n) and 13 n parameters."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    joints = [
        Joint(j, draw(st.integers(0, j - 1)), draw(st.sampled_from((0, 0, 1, 1, 2))), *rng.uniform(-3, 3, 6))
        for j in range(1, draw(st.integers(1, 9)) + 1)
    ]
    chain = Chain(joints, rng.uniform(-10, 10, 3))
    states = rng.uniform(-2, 2, (3, draw(st.integers(0, 7)), chain.n))
    states[1, :, 0] *= rng.integers(0, 2)  # a joint at rest has no Coulomb friction
    return chain, states, rng.normal(size=13 * chain.n)


def assert_near(found: np.ndarray, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0, atol=NEAR * np.max(np.abs(wanted), initial=1.0))


@settings(deadline=None, max_examples=100)
@given(cases())
def test_regressor_times_parameters_is_newton_euler(case: tuple[Chain, np.ndarray, np.ndarray]) -> None:
    """W X = τ(X), with rotors and friction and without."""
    chain, states, X = case
    assert_near(chain.regressor(*states, friction=True) @ X, chain.inverse_dynamics(*states, X))
    few = X[: 10 * chain.n]
    assert_near(chain.regressor(*states) @ few, chain.inverse_dynamics(*states, few))


@settings(deadline=None, max_examples=100)
@given(cases(), st.booleans())
def test_two_ways_to_the_same_entries(case: tuple[Chain, np.ndarray, np.ndarray], friction: bool) -> None:
    """Tables in the ground's axes against Jacobians in the bodies'."""
    chain, states, _ = case
    slow = chain.structure(*(np.ascontiguousarray(x.T) for x in states), friction)
    assert_near(chain.regressor(*states, friction), slow)


@settings(deadline=None, max_examples=100)
@given(cases(), st.booleans(), st.integers(2, 4))
def test_packed_is_dense_and_threads_change_no_bit(
    case: tuple[Chain, np.ndarray, np.ndarray], friction: bool, threads: int
) -> None:
    """The same numbers in every form, in the order of rows and columns; a sample does not depend on the others."""
    chain, states, _ = case
    dense, packed = chain.regressor(*states, friction), chain.packed_regressor(*states, friction)
    np.testing.assert_array_equal(packed.dense(), dense)
    assert packed.shape == dense.shape[1:]
    places = packed.rows * packed.shape[1] + packed.columns
    assert np.all(np.diff(places) > 0)
    for joint in range(1, chain.n + 1):
        columns, values = packed.row(joint)
        np.testing.assert_array_equal(values, dense[:, joint - 1, columns])
        assert values.base is not None
    assert chain.regressor(*states, friction, threads=threads).tobytes() == dense.tobytes()
    shared = chain.packed_regressor(*states, friction, threads=threads)
    assert shared.values.tobytes() == packed.values.tobytes()
    for s in range(states.shape[1]):
        assert chain.packed_regressor(*states[:, [s]], friction).values.tobytes() == packed.values[s].tobytes()


def test_the_cars_regressor_is_packed_to_a_sixth() -> None:
    """Revolute joints feel ten parameters of each body that they carry, prismatic ones four."""
    chain = car_chain().chain
    states = np.random.default_rng(3).uniform(-1, 1, (3, 20, chain.n))
    packed = chain.packed_regressor(*states)
    felt = {0: 10, 1: 4}
    pairs = [chain.joints[j - 1].sigma for body in range(1, chain.n + 1) for j in chain.table.path(body)]
    assert packed.values.shape == (20, sum(felt[sigma] for sigma in pairs)) == (20, 2792)
    assert_near(packed.dense(), chain.structure(*(np.ascontiguousarray(x.T) for x in states)))


def test_a_car_far_from_where_it_began() -> None:
    """Lateral and longitudinal posture of 1000 km: levers are still those of the car."""
    chain = car_chain().chain
    states = np.random.default_rng(5).uniform(-1, 1, (3, 20, chain.n))
    near = chain.regressor(*states)
    states[0, :, :2] += 1e6
    assert_near(chain.regressor(*states), near)
    assert_near(near, chain.structure(*(np.ascontiguousarray(x.T) for x in states)))


def test_an_array_of_the_callers_is_filled_whole() -> None:
    """Whatever it held before; one that does not fit is refused."""
    chain = car_chain().chain
    states = np.random.default_rng(4).uniform(-1, 1, (3, 5, chain.n))
    wanted = chain.regressor(*states)
    out = np.full_like(wanted, np.nan)
    assert chain.regressor(*states, threads=2, out=out) is out
    np.testing.assert_array_equal(out, wanted)
    fixed = np.zeros_like(wanted)
    fixed.flags.writeable = False
    for bad in (wanted[:4], wanted.astype(np.float32), np.asfortranarray(wanted), fixed):
        with pytest.raises(ValueError, match=r"out must be a contiguous, writeable array .*\(5, 42, 420\)"):
            chain.regressor(*states, out=bad)


@pytest.mark.parametrize("method", [Chain.regressor, Chain.packed_regressor])
def test_what_is_refused(method: Callable[..., object]) -> None:
    """Both forms say the same of states, symbols and threads."""
    chain = Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, "d": 0.3}])
    good = np.zeros((3, 2))
    bad = np.array([[0.0, 0.0], [0.0, np.nan], [0.0, 0.0]])
    with pytest.raises(ValueError, match="qdd has 1 values that are not finite, the first at sample 1, joint 2"):
        method(chain, good, good, bad)
    with pytest.raises(ValueError, match=r"q must have the shape \(N, 2\), found \(2,\); one sample is q\[None\]"):
        method(chain, good[0], good, good)
    with pytest.raises(ValueError, match="qd has 2 samples, q 3"):
        method(chain, good, good[:2], good)
    with pytest.raises(ValueError, match="threads must be at least 1, found 0"):
        method(chain, good, good, good, threads=0)
    with pytest.raises(ValueError, match="L"):
        method(Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, "d": "L"}]), good, good, good)
    with pytest.raises(ValueError, match="joints are numbered 1 to 2, found 3"):
        chain.packed_regressor(good, good, good).row(3)


def test_numba_is_loaded_by_the_regressor_alone() -> None:
    """Base parameters, torques and everything that the car needs do without it."""
    asked = (
        "import sys; import lacet.identify.regression.wls; from lacet import Chain, base_parameters\n"
        "arm = Chain.from_table([{'j': 1}, {'j': 2, 'ant': 1, 'd': 0.3}])\n"
        "base_parameters(arm); arm.inverse_dynamics(*[[[0.1, 0.2]]] * 3, {'M2': 1.0})\n"
        "first = 'numba' in sys.modules; arm.regressor(*[[[0.1, 0.2]]] * 3); print(first, 'numba' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True).stdout
    assert found.split() == ["False", "True"]


def test_what_cannot_be_kept_is_compiled_all_the_same() -> None:
    """A function of no file has no folder for its code, as one in an installation without any folder to write to."""
    made: dict[str, Callable[..., None]] = {}
    exec("def double(x):\n    for i in range(x.size):\n        x[i] *= 2.0\n", made)
    x = np.array([1.0, 2.0])
    compiled(made["double"], "void(float64[::1])")(x)
    assert x.tolist() == [2.0, 4.0]
