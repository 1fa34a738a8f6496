"""Identities of the chain on random trees: regressor, power, Lagrange's mass matrix, propagation from inside."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lacet.identify.multibody.chain import Chain, Joint
from lacet.identify.multibody.rigid_body import move_parameters, wrench, wrench_regressor


@st.composite
def trees(draw: st.DrawFn) -> tuple[Chain, int]:
    """A random tree (branching, prismatic and revolute, offsets everywhere) under random gravity, and a seed."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    joints = [
        Joint(
            j,
            draw(st.integers(0, j - 1)),
            draw(st.integers(0, 1)),
            *rng.uniform(-3, 3, 1),
            *rng.uniform(-1, 1, 1),
            *rng.uniform(-3, 3, 1),
            *rng.uniform(-1, 1, 1),
            *rng.uniform(-3, 3, 1),
            *rng.uniform(-1, 1, 1),
        )
        for j in range(1, draw(st.integers(1, 9)) + 1)
    ]
    return Chain(joints, rng.uniform(-10, 10, 3)), int(rng.integers(2**32))


def random_states(chain: Chain, seed: int, count: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, qd, qdd (count, n) and ten random parameters a body."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-2, 2, (3, count, chain.n))
    return q, qd, qdd, rng.normal(size=10 * chain.n)


@settings(deadline=None, max_examples=60)
@given(trees())
def test_regressor_is_newton_euler(case: tuple[Chain, int]) -> None:
    """W(q, q̇, q̈) X = τ(X)."""
    chain, seed = case
    q, qd, qdd, X = random_states(chain, seed)
    tau = chain.inverse_dynamics(q, qd, qdd, X)
    np.testing.assert_allclose(chain.regressor(q, qd, qdd) @ X, tau, rtol=0, atol=1e-10 * np.max(np.abs(tau)))


@settings(deadline=None, max_examples=30)
@given(trees())
def test_propagation_from_a_body_is_that_from_the_ground(case: tuple[Chain, int]) -> None:
    """With a body's own motion given, everything it carries moves as before."""
    chain, seed = case
    q, qd, qdd, _ = random_states(chain, seed)
    q, qd, qdd = q.T, qd.T, qdd.T
    frames = chain.propagate(q, qd, qdd)
    for start in range(1, chain.n + 1):
        inside = chain.propagate(q, qd, qdd, start=start, base=frames[start - 1])
        for k, joint in enumerate(chain.joints):
            path, carried = joint, False
            while path.ant:
                carried |= path.ant == start
                path = chain.joints[path.ant - 1]
            found, whole = inside[k], frames[k]
            assert (found is not None) == carried
            if found is not None and whole is not None:
                for name in ("omega", "omega_dot", "accel"):
                    np.testing.assert_allclose(getattr(found, name), getattr(whole, name), rtol=1e-12, atol=1e-10)


@settings(deadline=None, max_examples=30)
@given(trees())
def test_frames_move_as_their_positions_do(case: tuple[Chain, int]) -> None:
    """Origins and rotations built with SciPy, differentiated along a path: the rates and accelerations propagated."""
    chain, seed = case
    rng = np.random.default_rng(seed)
    step = 1e-3
    t = step * np.arange(-4, 5)
    a, b, c = rng.uniform(-1, 1, (3, chain.n, 1))
    q = a + b * t + 0.5 * c * t**2
    origins, turns = _poses(chain, q)
    middle = 4
    frames = chain.propagate(*(x[:, [middle]] for x in (q, b + c * t, np.repeat(c, t.size, axis=1))))
    first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / step
    second = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / step**2
    for k in range(chain.n):
        R = turns[k][middle]
        frame = frames[k]
        assert frame is not None
        accel = np.tensordot(second, origins[k], 1) - chain.gravity
        np.testing.assert_allclose(frame.accel[:, 0], R.T @ accel, atol=2e-6 * (1 + np.linalg.norm(accel)))
        spin = R.T @ np.tensordot(first, turns[k], 1)
        np.testing.assert_allclose(frame.omega[:, 0], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-9)
        # R'' = R ([ω̇]× + [ω]×²)
        twice = R.T @ np.tensordot(second, turns[k], 1) - spin @ spin
        found = [twice[2, 1] - twice[1, 2], twice[0, 2] - twice[2, 0], twice[1, 0] - twice[0, 1]]
        np.testing.assert_allclose(frame.omega_dot[:, 0], 0.5 * np.array(found), atol=2e-6)


def _poses(chain: Chain, q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Origins (N, 3) and rotations (N, 3, 3) to the ground, from the definition of the table."""
    origins: list[np.ndarray] = []
    turns: list[np.ndarray] = []
    for k, joint in enumerate(chain.joints):
        n = q.shape[1]
        before = turns[joint.ant - 1] if joint.ant else np.repeat(np.eye(3)[None], n, axis=0)
        at = origins[joint.ant - 1] if joint.ant else np.zeros((n, 3))
        theta = joint.theta + (q[k] if joint.sigma == 0 else np.zeros(n))
        r = joint.r + (q[k] if joint.sigma == 1 else np.zeros(n))
        Rg = Rotation.from_rotvec([0, 0, joint.gamma]).as_matrix()
        Ra = Rotation.from_rotvec([joint.alpha, 0, 0]).as_matrix()
        offset = Rg @ np.array([0, 0, joint.b]) + Rg @ Ra @ np.array([joint.d, 0, 0])
        axis = Rg @ Ra @ np.array([0, 0, 1.0])
        origins.append(at + np.einsum("nij,nj->ni", before, offset + r[:, None] * axis))
        turns.append(before @ Rg @ Ra @ Rotation.from_rotvec(np.outer(theta, [0, 0, 1.0])).as_matrix())
    return origins, turns


@settings(deadline=None, max_examples=30)
@given(trees())
def test_mass_matrix_is_symmetric(case: tuple[Chain, int]) -> None:
    """∂τ/∂q̈ is symmetric whatever the parameters: the column of each joint read by the others."""
    chain, seed = case
    q, _, _, X = random_states(chain, seed, 1)
    weightless = Chain(chain.joints, (0.0, 0.0, 0.0))
    M = weightless.inverse_dynamics(np.repeat(q, chain.n, axis=0), np.zeros((chain.n,) * 2), np.eye(chain.n), X)
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-10 * np.max(np.abs(M)))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_wrench_of_a_body_against_its_particles(seed: int) -> None:
    """A rigid body of particles: the sums of m a and p × m a are the wrench, from any frame fixed in the body."""
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 3.0, 6), rng.normal(size=(6, 3))
    omega, omega_dot, accel = rng.normal(size=(3, 3, 1))
    a = accel.T + np.cross(omega_dot.T, points) + np.cross(omega.T, np.cross(omega.T, points))
    force, moment = masses @ a, np.sum(masses[:, None] * np.cross(points, a), axis=0)
    values = _ten(masses, points)
    found = wrench(omega, omega_dot, accel, values)
    np.testing.assert_allclose(np.concatenate(found)[:, 0], [*force, *moment], atol=1e-11)
    table = wrench_regressor(omega, omega_dot, accel)
    np.testing.assert_allclose(values @ table[:, :, 0].T, [*force, *moment], atol=1e-11)
    R, p = Rotation.random(rng=np.random.default_rng(seed)).as_matrix(), rng.normal(size=3)
    np.testing.assert_allclose(move_parameters(values, R, p), _ten(masses, points @ R.T + p), atol=1e-11)


def _ten(masses: np.ndarray, points: np.ndarray) -> np.ndarray:
    inertia = np.sum(
        masses[:, None, None]
        * (np.sum(points**2, axis=1)[:, None, None] * np.eye(3) - points[:, :, None] * points[:, None, :]),
        axis=0,
    )
    return np.array([*inertia[0], *inertia[1, 1:], inertia[2, 2], *(masses @ points), np.sum(masses)])
