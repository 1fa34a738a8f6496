"""The chain against robots computed by SYMORO (and a PUMA 560 by SymPyBotics): torques, regressors, base parameters."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.chain_base_parameters import base_parameters
from tests.support.places import HOME

FOLDER = HOME / "tests" / "data" / "symoro"
ROBOTS = ("RX90", "Stanford", "CarLite")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> dict[str, Any]:
    """A stored robot."""
    return json.loads((FOLDER / f"{request.param}.json").read_text(encoding="utf-8"))


def states(data: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, n) q, qd, qdd of the stored states."""
    q, qd, qdd = (np.array([state[key] for state in data["states"]]) for key in ("q", "qd", "qdd"))
    return q, qd, qdd


def chain_of(data: dict[str, Any]) -> Chain:
    """The robot's chain under its own gravity."""
    return Chain.from_table(data["mdh"], (0.0, 0.0, data["geometry_values"]["G3"]))


def inertial(chain: Chain, data: dict[str, Any]) -> dict[str, float]:
    """The stored parameters that belong to rigid bodies."""
    known = set(chain.parameter_names)
    named = zip(data["param_names"], data["param_values"], strict=True)
    return {name: value for name, value in named if name in known}


def drive_torque(chain: Chain, data: dict[str, Any], qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """(N, n) what friction and rotor inertia add to the stored torques."""
    values = dict(zip(data["param_names"], data["param_values"], strict=True))
    per_joint = {kind: np.array([values.get(f"{kind}{j + 1}", 0.0) for j in range(chain.n)]) for kind in ("FV", "FS")}
    rotor = np.array([values.get(f"IA{j + 1}", 0.0) for j in range(chain.n)])
    return per_joint["FV"] * qd + per_joint["FS"] * np.sign(qd) + rotor * qdd


def test_torques_agree(robot: dict[str, Any]) -> None:
    """Newton–Euler gives the stored torques, less friction and rotors."""
    chain = chain_of(robot)
    q, qd, qdd = states(robot)
    tau = np.array([state["tau"] for state in robot["states"]]) - drive_torque(chain, robot, qd, qdd)
    mine = chain.inverse_dynamics(q, qd, qdd, inertial(chain, robot))
    np.testing.assert_allclose(mine, tau, rtol=0, atol=1e-9 * np.max(np.abs(tau)))


def test_torques_with_friction_agree(robot: dict[str, Any]) -> None:
    """Friction and rotors by name: the stored torques whole, from a mapping, from an array and from the regressor."""
    chain = chain_of(robot)
    q, qd, qdd = states(robot)
    tau = np.array([state["tau"] for state in robot["states"]])
    values = dict(zip(robot["param_names"], robot["param_values"], strict=True))
    X = np.array([values.get(name, 0.0) for name in (*chain.parameter_names, *chain.friction_names)])
    W = chain.regressor(q, qd, qdd, friction=True)
    assert W.shape == (len(q), chain.n, 13 * chain.n)
    near = {"rtol": 0, "atol": 1e-9 * np.max(np.abs(tau))}
    np.testing.assert_allclose(chain.inverse_dynamics(q, qd, qdd, values), tau, **near)
    np.testing.assert_allclose(chain.inverse_dynamics(q, qd, qdd, X), tau, **near)
    np.testing.assert_allclose(W @ X, tau, **near)
    np.testing.assert_array_equal(W[:, :, : 10 * chain.n], chain.regressor(q, qd, qdd))


def test_regressor_rows_agree(robot: dict[str, Any]) -> None:
    """Every stored entry is there, and the entries stored as zero are zero."""
    chain = chain_of(robot)
    W = chain.regressor(*states(robot))
    column = {name: i for i, name in enumerate(chain.parameter_names)}
    mine = [name for name in robot["param_names"] if name in column]
    assert robot["regressor_rows"]
    for row in robot["regressor_rows"]:
        stored = np.array([row["nonzero"].get(name, 0.0) for name in mine])
        found = W[row["state"], row["joint"] - 1, [column[name] for name in mine]]
        np.testing.assert_allclose(found, stored, rtol=0, atol=1e-9 * max(1.0, np.max(np.abs(stored))))


def test_published_groupings_lie_in_the_row_space(robot: dict[str, Any]) -> None:
    """A base parameter is identifiable: its coefficients are a combination of regressor rows."""
    chain = chain_of(robot)
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-2, 2, (3, 60 + 4 * chain.n, chain.n))
    column = {name: i for i, name in enumerate(chain.parameter_names)}
    # Rotor inertia stands in SYMORO's groupings and is a parameter of its own: its column is the joint's acceleration.
    names = [name for name in robot["param_names"] if name in column or name.startswith("IA")]
    W = chain.regressor(q, qd, qdd).reshape(-1, 10 * chain.n)
    columns = [W[:, column[n]] if n in column else _rotor(int(n[2:]), qdd) for n in names]
    basis = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    rank = int(np.sum(1e-9 * basis.S[0] < basis.S))
    assert rank == robot["n_base_inertial"]
    space = basis.Vh[:rank]
    for cell in robot["base_cells"]:
        wanted = np.array([cell["coeffs"].get(name, 0.0) for name in names])
        assert set(cell["coeffs"]) <= set(names), cell
        left = wanted - space.T @ (space @ wanted)
        assert np.linalg.norm(left) <= 1e-9 * np.linalg.norm(wanted), cell["expr"]


def test_own_groupings_lie_in_the_row_space(robot: dict[str, Any]) -> None:
    """`base_parameters` has the rank of the regressor, its groupings give the torques again, its gap is clear."""
    chain = chain_of(robot)
    base = base_parameters(chain)
    W = chain.regressor(*states(robot))
    X = np.random.default_rng(2).normal(size=10 * chain.n)
    kept = W[:, :, base.independent] @ (base.grouping() @ X)
    np.testing.assert_allclose(kept, W @ X, rtol=0, atol=1e-8 * np.max(np.abs(W @ X)))
    assert base.gap > 1e4
    absent = {chain.parameter_names[k] for k in base.absent}
    assert absent >= {name for name in robot["never_appear"] if name in chain.parameter_names}


def _rotor(j: int, qdd: np.ndarray) -> np.ndarray:
    out = np.zeros_like(qdd)
    out[:, j - 1] = qdd[:, j - 1]
    return out.ravel()


@pytest.mark.parametrize("which", ["a", "b"])
def test_puma(which: str) -> None:
    """A PUMA 560 from another generator, with its own and with random parameters; mass matrix and gravity too."""
    data = json.loads((FOLDER / "PUMA560_mdh_sympybotics.json").read_text(encoding="utf-8"))
    chain = Chain.from_table(data["mdh"], (0.0, 0.0, -9.81))
    q, qd, qdd = (np.array([data[key]]) for key in ("q", "qd", "qdd"))
    X = np.array(data[f"params_{which}"])
    still, n = np.zeros_like(q), chain.n
    tau = np.array(data[f"tau_{which}"])
    np.testing.assert_allclose(chain.inverse_dynamics(q, qd, qdd, X)[0], tau, rtol=0, atol=1e-9)
    weightless = Chain.from_table(data["mdh"], (0.0, 0.0, 0.0))
    zero = np.zeros((n, n))
    mass = weightless.inverse_dynamics(np.repeat(q, n, axis=0), zero, np.eye(n), X).T
    np.testing.assert_allclose(mass, np.array(data[f"M_{which}"]), rtol=0, atol=1e-9)
    if which == "a":
        gravity = chain.inverse_dynamics(q, still, still, X)[0]
        np.testing.assert_allclose(gravity, data["gravity_a"], rtol=0, atol=1e-9)


def test_a_table_that_is_no_tree_is_refused() -> None:
    """An antecedent that comes later, a missing row number, a sigma that is neither."""
    for bad in ([{"j": 1, "ant": 1}], [{"j": 2, "ant": 0}], [{"j": 1, "ant": 0, "sigma": 3}]):
        with pytest.raises(ValueError, match="row 1"):
            Chain.from_table(bad)


def test_unknown_parameter_is_refused() -> None:
    """A wrong name or a wrong number of values never passes silently."""
    chain = Chain.from_table([{"j": 1}])
    one = np.zeros((1, 1))
    with pytest.raises(KeyError, match="did you mean 'XX1'"):
        chain.inverse_dynamics(one, one, one, {"XX2": 1.0})
    with pytest.raises(ValueError, match="parameter M1 is not finite"):
        chain.inverse_dynamics(one, one, one, {"M1": np.nan})
    with pytest.raises(ValueError, match="10 parameters"):
        chain.inverse_dynamics(one, one, one, np.zeros(9))


def test_states_of_wrong_shape_or_value_are_refused() -> None:
    """Each says what was expected, what was found, and where."""
    chain = Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, "alpha": 1.0, "d": 0.3}])
    good = np.zeros((3, 2))
    bad = good.copy()
    bad[1, 1] = np.nan
    for states_, says in (
        ((np.zeros(2), good, good), r"q must have the shape \(N, 2\), found \(2,\); one sample is q\[None\]"),
        ((good, np.zeros((3, 3)), good), r"qd must have the shape \(N, 2\), found \(3, 3\)"),
        ((good, good, np.zeros((4, 2))), "qdd has 4 samples, q 3"),
        ((good, good, bad), "qdd has 1 values that are not finite, the first at sample 1, joint 2"),
        ((good, good + np.inf, good), "qd has 6 values that are not finite"),
        (("ab", good, good), "q must be numbers"),
    ):
        with pytest.raises(ValueError, match=says):
            chain.regressor(*states_)  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=says):
            chain.inverse_dynamics(*states_, np.zeros(20))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="bodies are numbered 1 to 2, found 3"):
        chain.pose(3, good)
    with pytest.raises(ValueError, match="axes must be 'body' or 'ground'"):
        chain.jacobian(1, good, axes="world")


def test_lists_single_precision_and_no_samples() -> None:
    """What NumPy can turn into numbers is taken; no sample gives no torque."""
    chain = Chain.from_table([{"j": 1, "alpha": 1.0}, {"j": 2, "ant": 1, "sigma": 1, "alpha": 1.0, "d": 0.3}])
    rng = np.random.default_rng(4)
    single, X = rng.uniform(-1, 1, (1, 2)).astype(np.float32), rng.normal(size=20).astype(np.float32)
    tau = chain.inverse_dynamics(single, single, single, X)
    assert tau.dtype == np.float64
    double, listed = single.astype(float), single.tolist()
    np.testing.assert_array_equal(tau, chain.inverse_dynamics(double, double, double, X.astype(float)))
    np.testing.assert_array_equal(tau, chain.inverse_dynamics(listed, listed, listed, X.tolist()))
    none = np.zeros((0, 2))
    assert chain.inverse_dynamics(none, none, none, X).shape == (0, 2)
    assert chain.regressor(none, none, none).shape == (0, 2, 20)


def test_every_fault_of_a_table_at_once() -> None:
    """Three rows, three faults."""
    rows = [{"j": 1, "d": "1 +"}, {"j": 2, "ant": 5}, {"j": 3, "sigma": 0.5}]
    with pytest.raises(ValueError, match=r"(?s)row 1: d.*row 3: sigma must be a whole.*row 2: .*ant=5"):
        Chain.from_table(rows)  # type: ignore[arg-type]
    for bad in ({"r": np.nan}, {"alpha": None}, {"d": "L", "gamma": "1/0"}):
        with pytest.raises(ValueError, match=r"row 1|joint 1"):
            Chain.from_table([{"j": 1, **bad}])
    with pytest.raises(ValueError, match="at least one joint"):
        Chain.from_table([])
    with pytest.raises(ValueError, match="gravity must be three"):
        Chain.from_table([{"j": 1}], (0.0, 9.81))
