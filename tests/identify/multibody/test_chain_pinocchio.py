"""A second engine: random trees built in Pinocchio from placements and joint axes, not from our recursions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.identify.multibody.chain import Chain

_MADE = {0: pin.JointModelRZ, 1: pin.JointModelPZ}


def random_tree(rng: np.random.Generator, n: int) -> tuple[list[dict[str, float]], np.ndarray, np.ndarray]:
    """Rows (fixed frames among them), gravity and ten parameters a body."""
    rows = [
        {
            "j": j, "ant": int(rng.integers(0, j)), "sigma": int(rng.choice([0, 0, 0, 1, 1, 2])),
            **{key: float(rng.uniform(-3, 3)) for key in ("gamma", "alpha", "theta")},
            **{key: float(rng.uniform(-1, 1)) for key in ("b", "d", "r")},
        }
        for j in range(1, n + 1)
    ]  # fmt: skip
    return rows, rng.uniform(-10, 10, 3), rng.normal(size=(n, 10))


def turn(axis: int, angle: float) -> pin.SE3:
    """A rotation about a coordinate axis."""
    R = pin.AngleAxis(angle, np.eye(3)[axis]).toRotationMatrix()
    return pin.SE3(R, np.zeros(3))


def shift(x: float, z: float) -> pin.SE3:
    """A translation along x and z."""
    return pin.SE3(np.eye(3), np.array([x, 0.0, z]))


class Twin:
    """The same tree in Pinocchio; a fixed frame is welded to what carries it."""

    def __init__(self, rows: list[dict[str, float]], gravity: np.ndarray, X: np.ndarray):
        model = pin.Model()
        model.gravity.linear = gravity
        self.joint: list[int] = []  # the Pinocchio joint a body moves with
        self.place: list[pin.SE3] = []  # the body's frame in it
        self.moving: list[int] = []
        parts: dict[int, list[tuple[int, pin.SE3]]] = {}
        for k, row in enumerate(rows):
            ant = int(row["ant"])
            parent, at = (self.joint[ant - 1], self.place[ant - 1]) if ant else (0, pin.SE3.Identity())
            # θ and r act along and about the same axis, so their constant parts go before the joint.
            at = at * turn(2, row["gamma"]) * shift(0, row["b"]) * turn(0, row["alpha"]) * shift(row["d"], 0)
            at = at * turn(2, row["theta"]) * shift(0, row["r"])
            if row["sigma"] == 2:
                self.joint.append(parent)
                self.place.append(at)
            else:
                self.joint.append(model.addJoint(parent, _MADE[int(row["sigma"])](), at, f"j{k + 1}"))
                self.place.append(pin.SE3.Identity())
                self.moving.append(k)
            parts.setdefault(self.joint[-1], []).append((k, self.place[-1]))
        self.model, self.data, self.X = model, model.createData(), X
        self.parts = parts

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """τ by Pinocchio's regressor, the parameters of welded bodies moved by its own actions on inertias."""
        W = pin.computeJointTorqueRegressor(self.model, self.data, q, qd, qdd)
        total = np.zeros((self.model.njoints, 10))
        for joint, bodies in self.parts.items():
            for k, place in bodies:
                total[joint] += moved(self.X[k], place)
        return W @ total[1:].ravel()


def pinocchio_order(ours: np.ndarray) -> np.ndarray:
    """Pinocchio's (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz), inertia about the frame too."""
    xx, xy, xz, yy, yz, zz, mx, my, mz, m = ours
    return np.array([m, mx, my, mz, xx, xy, yy, xz, yz, zz])


def moved(ours: np.ndarray, place: pin.SE3) -> np.ndarray:
    """Parameters in another frame, as the 6 × 6 spatial inertia carried by Pinocchio's action matrices."""
    xx, xy, xz, yy, yz, zz, mx, my, mz, m = ours
    C = np.array([[0, -mz, my], [mz, 0, -mx], [-my, mx, 0]])
    spatial = np.block([[m * np.eye(3), -C], [C, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])]])
    act = place.toDualActionMatrix()
    there = act @ spatial @ act.T
    inertia, C = there[3:, 3:], there[3:, :3]
    return pinocchio_order(
        np.array([*inertia[0], inertia[1, 1], inertia[1, 2], inertia[2, 2], C[2, 1], C[0, 2], C[1, 0], there[0, 0]])
    )


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_torques_regressor_and_jacobians_are_pinocchios(seed: int, n: int) -> None:
    """Random trees under random gravity, to 1e-10."""
    rng = np.random.default_rng(seed)
    rows, gravity, X = random_tree(rng, n)
    chain, twin = Chain.from_table(rows, gravity), Twin(rows, gravity, X)
    q, qd, qdd = rng.uniform(-2, 2, (3, 3, n))
    tau, W = chain.inverse_dynamics(q, qd, qdd, X.ravel()), chain.regressor(q, qd, qdd)
    moving = twin.moving
    fixed = [k for k in range(n) if k not in moving]
    assert not np.any(tau[:, fixed])
    for s in range(3):
        states = (q[s, moving], qd[s, moving], qdd[s, moving])
        if moving:
            theirs = twin.torque(*states)
            np.testing.assert_allclose(tau[s, moving], theirs, rtol=0, atol=1e-10 * max(1.0, np.max(np.abs(theirs))))
            np.testing.assert_allclose(
                W[s, moving] @ X.ravel(), theirs, rtol=0, atol=1e-10 * max(1.0, np.max(np.abs(theirs)))
            )
            pin.computeJointJacobians(twin.model, twin.data, states[0])
        pin.forwardKinematics(twin.model, twin.data, states[0])
        for body in range(1, n + 1):
            joint, place = twin.joint[body - 1], twin.place[body - 1]
            pose = twin.data.oMi[joint] * place if joint else place
            np.testing.assert_allclose(chain.pose(body, q)[s], pose.homogeneous, atol=1e-10)
            if joint:
                local = pin.getJointJacobian(twin.model, twin.data, joint, pin.ReferenceFrame.LOCAL)
                theirs = place.inverse().toActionMatrix() @ np.reshape(local, (6, -1))
                found = chain.jacobian(body, q)[s]
                np.testing.assert_allclose(found[:, moving], theirs, atol=1e-10)
                turned = chain.jacobian(body, q, axes="ground")[s]
                np.testing.assert_allclose(turned[:3], pose.rotation @ found[:3], atol=1e-10)
                np.testing.assert_allclose(turned[3:], pose.rotation @ found[3:], atol=1e-10)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_every_regressor_column_is_pinocchios(seed: int, n: int) -> None:
    """Column by column, on trees without fixed frames."""
    rng = np.random.default_rng(seed)
    rows, gravity, X = random_tree(rng, n)
    for row in rows:
        row["sigma"] = row["sigma"] % 2
    chain, twin = Chain.from_table(rows, gravity), Twin(rows, gravity, X)
    q, qd, qdd = rng.uniform(-2, 2, (3, n))
    ours = chain.regressor(q[None], qd[None], qdd[None])[0].reshape(n, n, 10)
    theirs = pin.computeJointTorqueRegressor(twin.model, twin.data, q, qd, qdd).reshape(n, n, 10)
    order = [9, 6, 7, 8, 0, 1, 3, 2, 4, 5]
    np.testing.assert_allclose(ours[:, :, order], theirs, atol=1e-10 * max(1.0, np.max(np.abs(theirs))))
