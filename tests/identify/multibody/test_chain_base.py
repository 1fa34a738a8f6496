"""Base parameters of chains: their count at every scale, and the relations in symbols against those in numbers."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.expressions.expression import Expression
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.chain_base_parameters import ChainBaseParameters, base_parameters
from tests.support.places import HOME

FOLDER = HOME / "tests" / "data" / "symoro"
QUARTERS = (0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi)


def random_rows(rng: np.random.Generator, n: int, size: float = 1.0, angles: Any = QUARTERS) -> list[dict[str, Any]]:
    """A random tree, a third of its joints prismatic, a third of its lengths 0."""

    def length() -> float:
        return float(size * rng.uniform(-1, 1)) if rng.random() > 0.35 else 0.0

    return [
        {
            "j": j, "ant": int(rng.integers(max(0, j - 3), j)), "sigma": int(rng.random() < 0.3),
            "gamma": rng.choice(angles), "b": length(), "alpha": rng.choice(angles), "d": length(),
            "theta": rng.choice(angles), "r": length(),
        }
        for j in range(1, n + 1)
    ]  # fmt: skip


def worst(base: ChainBaseParameters) -> float:
    """Largest difference between the relations in symbols, evaluated, and in numbers."""
    values = base.symbol_values
    found = np.array([[Expression.parse(t).value(values) if t else 0.0 for t in row] for row in base.formulas])
    return float(np.max(np.abs(found - base.relations) / np.maximum(1.0, np.abs(base.relations)), initial=0.0))


@pytest.mark.parametrize("robot", ["RX90", "Stanford", "CarLite"])
def test_symoro_groupings_follow(robot: str) -> None:
    """SYMORO's cells, which name the same columns, have our coefficients; the counts are SYMORO's."""
    data = json.loads((FOLDER / f"{robot}.json").read_text(encoding="utf-8"))
    chain = Chain.from_table(data["mdh"])
    inertial = [name for name in data["param_names"] if name not in data["friction_names"]]
    base = base_parameters(chain, parameters=inertial)
    assert base.rank == len(base) == data["n_base_inertial"]
    assert base_parameters(chain, parameters=data["param_names"]).rank == data["n_base_total"]
    assert base.gap > 1e10
    assert worst(base) < 1e-9
    own = {base.names[int(i)]: base.grouping()[k] for k, i in enumerate(base.independent)}
    column = {name: i for i, name in enumerate(base.names)}
    shared = 0
    for cell in data["base_cells"]:
        stored = np.zeros(len(base.names))
        for name, value in cell["coeffs"].items():
            stored[column[name]] = value
        # SYMORO moves cells to virtual bodies, so only their span is the same for all: each is a sum of ours.
        place = [i for i in base.independent if stored[i]]
        np.testing.assert_allclose(sum(stored[i] * own[base.names[int(i)]] for i in place), stored, atol=1e-9)
        shared += cell["cell"] in own
    assert shared >= len(data["base_cells"]) // 2


def test_rx90_in_symbols() -> None:
    """The textbook's relations (Khalil and Dombre 2002, table 9.2), with symbols in the table."""
    data = json.loads((FOLDER / "RX90.json").read_text(encoding="utf-8"))
    rows = [dict(row) for row in data["mdh"]]
    rows[2]["d"], rows[3]["r"] = "D3", "RL4"
    for values in ({}, {"D3": 0.45, "RL4": 0.45}):
        base = base_parameters(Chain.from_table(rows, values=values), friction=True)
        lines = [base.relation(i) for i in range(base.rank)]
        assert "XX2 - YY2 - D3**2*M3 - D3**2*M4 - D3**2*M5 - D3**2*M6" in lines
        assert "XZ2 - D3*MZ3" in lines
        assert "MY3 + MZ4 + RL4*M4 + RL4*M5 + RL4*M6" in lines
        assert "ZZ3 + YY4 + 2*RL4*MZ4 + RL4**2*M4 + RL4**2*M5 + RL4**2*M6" in lines
        assert base.symbols == ("D3", "RL4")
        where = lines.index("XZ2 - D3*MZ3")
        assert base.describe(where) == ("XZ2 - 0.45 MZ3" if values else "XZ2 - D3*MZ3")
        assert np.any(np.isnan(base.relations)) == (not values)
    assert "with D3 = 0.45, RL4 = 0.45" in base.table()


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 100.0]))
def test_symbols_are_the_numbers_and_the_numbers_the_torques(seed: int, size: float) -> None:
    """On a random tree of any size: formulas = relations, and the kept columns give every torque."""
    rng = np.random.default_rng(seed)
    chain = Chain.from_table(random_rows(rng, 5, size))
    base = base_parameters(chain)
    assert worst(base) < 1e-9
    q, qd, qdd = rng.uniform(-2, 2, (3, 6, chain.n))
    W, X = chain.regressor(q, qd, qdd), rng.normal(size=10 * chain.n)
    tau = W @ X
    np.testing.assert_allclose(W[:, :, base.independent] @ (base.grouping() @ X), tau, atol=1e-9 * np.max(np.abs(tau)))
    values = {**base.symbol_values, **dict(zip(base.names, X, strict=True))}
    told = [Expression.parse(base.relation(i)).value(values) for i in range(base.rank)]
    np.testing.assert_allclose(told, base.grouping() @ X, rtol=1e-9, atol=1e-9 * max(1.0, size**2))


@pytest.mark.parametrize("size", [1e-3, 100.0])
def test_the_count_does_not_depend_on_the_unit(size: float) -> None:
    """Metres, millimetres, hundreds of metres: the same base parameters, with a clear gap."""
    for seed in range(6):
        rows = random_rows(np.random.default_rng(seed), 7, angles=(0.0, 0.4, -1.2, np.pi / 2))
        scaled = [{k: size * v if k in ("b", "d", "r") else v for k, v in row.items()} for row in rows]
        one, other = base_parameters(Chain.from_table(rows)), base_parameters(Chain.from_table(scaled))
        np.testing.assert_array_equal(one.independent, other.independent)
        assert min(one.gap, other.gap) > 1e8


def test_tiny_links_among_long_ones() -> None:
    """A millimetre beside thirty metres is no rounding: the structure is that of the same table with plain lengths."""
    rows = random_rows(np.random.default_rng(2), 7)
    for row in rows:
        row["sigma"], row["ant"] = 0, row["j"] - 1
    plain, mixed = [dict(r) for r in rows], [dict(r) for r in rows]
    for k, (a, b) in enumerate(zip(plain, mixed, strict=True)):
        a["d"], b["d"] = 0.3 + 0.1 * k, (1e-3, 30.0)[k % 2]
        a["r"], b["r"] = 0.7 - 0.05 * k, (20.0, 2e-3)[k % 2]
    one, other = base_parameters(Chain.from_table(plain)), base_parameters(Chain.from_table(mixed))
    np.testing.assert_array_equal(one.independent, other.independent)


def test_sixty_joints() -> None:
    """A serial arm of sixty joints: eight parameters a joint but for the first two, and the torques come out again."""
    rng = np.random.default_rng(7)
    rows = [
        {"j": j, "ant": j - 1, "alpha": (0.0, np.pi / 2)[j > 1] * (-1) ** j, "d": 0.02 * rng.uniform(), "r": 1e-3}
        for j in range(1, 61)
    ]
    chain = Chain.from_table(rows)
    base = base_parameters(chain)
    # Khalil and Dombre (2002), section 9.4: 7 for a revolute joint, 4 fewer for the first with gravity along its axis
    # (XX, XY, XZ … have no effect but ZZ), and MZ, M, YY of every joint are grouped.
    assert base.rank == 1 + 7 * 59 == 414
    assert base.gap > 1e6
    q, qd, qdd = rng.uniform(-1, 1, (3, 2, chain.n))
    W, X = chain.regressor(q, qd, qdd), rng.normal(size=10 * chain.n)
    np.testing.assert_allclose(
        W[:, :, base.independent] @ (base.grouping() @ X), W @ X, atol=1e-8 * np.max(np.abs(W @ X))
    )


@pytest.mark.parametrize(
    ("rows", "gravity", "kept"),
    [
        ([{"j": 1}], (0, 0, -9.81), ["ZZ1"]),
        ([{"j": 1, "alpha": np.pi / 2}], (0, 0, -9.81), ["ZZ1", "MX1", "MY1"]),
        ([{"j": 1, "alpha": np.pi / 2}], (0, 0, 0), ["ZZ1"]),
        ([{"j": 1, "sigma": 1}], (0, 0, -9.81), ["M1"]),
        ([{"j": 1, "sigma": 2}], (0, 0, -9.81), []),
        ([{"j": 1, "sigma": 1}, {"j": 2, "ant": 1, "sigma": 1, "alpha": 0.7}], (0, 0, -9.81), ["M1", "M2"]),
        ([{"j": 1}, {"j": 2}], (0, 0, -9.81), ["ZZ1", "ZZ2"]),
        ([{"j": 1}, {"j": 2, "ant": 1, "sigma": 2, "d": 0.3}], (0, 0, -9.81), ["ZZ1"]),
    ],
)
def test_small_chains(rows: list[dict[str, Any]], gravity: tuple[float, ...], kept: list[str]) -> None:
    """Cases that can be counted by hand."""
    base = base_parameters(Chain.from_table(rows, gravity))
    assert [base.names[int(i)] for i in base.independent] == kept


def test_a_fixed_frame_is_a_part_of_its_body() -> None:
    """Steiner's theorem in symbols: a body bolted on by a turned, shifted frame."""
    rows = [{"j": 1}, {"j": 2, "ant": 1, "sigma": 2, "d": "a", "alpha": 0.3}]
    base = base_parameters(Chain.from_table(rows, values={"a": 0.2}))
    assert worst(base) < 1e-12
    assert base.relation(0).endswith("+ 2*a*MX2 + a**2*M2")
    assert "sin(0.3)" in base.relation(0)
    values = {"a": 0.2, **dict.fromkeys(base.names, 0.0), "M2": 3.0, "YY2": 0.5}
    assert Expression.parse(base.relation(0)).value(values) == pytest.approx(3 * 0.04 + 0.5 * np.sin(0.3) ** 2)


def test_absent_parameters_and_friction() -> None:
    """A row may say what its body has not; rotors and friction are counted when asked for."""
    rows: list[dict[str, Any]] = [{"j": 1, "absent": "all"}, {"j": 2, "ant": 1, "alpha": 0.5, "absent": ["XX", "FS"]}]
    chain = Chain.from_table(rows)
    base = base_parameters(chain)
    assert not {"XX1", "M1", "XX2"} & {*base.names}
    with_friction = base_parameters(chain, friction=True)
    assert {"FV1", "FS1", "FV2"} <= {*with_friction.names}
    assert "FS2" not in with_friction.names
    for bad in ({"absent": "mass"}, {"absent": ["M", 3]}):
        with pytest.raises(ValueError, match="row 1: absent names"):
            Chain.from_table([{"j": 1, **bad}])
    with pytest.raises(ValueError, match="ZZ9; did you mean 'ZZ"):
        base_parameters(chain, parameters=["ZZ9"])


@pytest.mark.parametrize(
    ("second", "relation"),
    [
        ({"alpha": "E"}, "ZZ1 + sin(E)**2*YY2"),
        ({"gamma": "E", "alpha": "pi/2"}, "ZZ1 + YY2"),
        ({"alpha": "E", "r": "R"}, "ZZ1 + sin(E)**2*YY2 + 2*R*sin(E)**2*MZ2 + R**2*sin(E)**2*M2"),
        ({"alpha": "E", "d": "D", "r": "R"},
         "ZZ1 + sin(E)**2*YY2 + 2*R*sin(E)**2*MZ2 + (D**2 + R**2*sin(E)**2)*M2"),
    ],
)  # fmt: skip
def test_formulas_are_reduced(second: dict[str, str], relation: str) -> None:
    """cos² + sin² = 1 is used: no sum of thirds, as least squares shares a coefficient between dependent terms."""
    assert base_parameters(Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, **second}])).relation(0) == relation
