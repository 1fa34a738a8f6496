"""Sums over runs: the tree, and a fit whose runs are summed one by one."""

from __future__ import annotations

import math
import weakref
from dataclasses import replace
from functools import reduce
from operator import add, iadd

import numpy as np
import pytest

from lacet.identify.regression.qr_accumulation import Equations, RunEquations, triangle
from lacet.identify.regression.sums.tree import WIDTH, groups, merged, summed

RNG = np.random.default_rng(5)


def by_levels(parts: list[str]) -> str:
    """The same tree with all parts there at once."""
    while len(parts) > 1:
        parts = ["(" + "".join(parts[i] for i in group) + ")" if len(group) > 1 else parts[group[0]]
                 for group in groups(len(parts))]  # fmt: skip
    return parts[0]


@pytest.mark.parametrize("count", [1, 2, WIDTH - 1, WIDTH, WIDTH + 1, WIDTH**2 - 1, WIDTH**2, WIDTH**2 + 1, 700])
def test_the_tree_depends_on_the_number_of_parts_alone(count: int) -> None:
    """Parts that come one by one are merged as those that are there at once, in order."""
    names = [f"{i}," for i in range(count)]
    one_by_one = merged(iter(names), lambda parts: "(" + "".join(parts) + ")")
    assert one_by_one == by_levels(names)
    assert one_by_one.replace("(", "").replace(")", "") == "".join(names)


@pytest.mark.parametrize("count", [1, 2, WIDTH - 1, WIDTH, WIDTH + 1, WIDTH**2 + WIDTH + 3, 700])
def test_parts_added_one_after_the_other_have_the_same_bits(count: int) -> None:
    """Added into the arrays of the first; while a part is made none of those before is held."""
    parts = [RNG.standard_normal((3, 2)) * 10.0 ** RNG.integers(-8, 8) for _ in range(count)]
    held = list[weakref.ref[np.ndarray]]()

    def made(part: np.ndarray) -> np.ndarray:
        alive = sum(one() is not None for one in held)
        assert alive <= 1 + math.log(max(len(held), 1), WIDTH) + 1e-9
        out = part.copy()
        held.append(weakref.ref(out))
        return out

    whole = merged(parts, lambda group: reduce(add, group))
    np.testing.assert_array_equal(summed(map(made, parts), iadd), whole)
    assert summed(((i,) for i in range(count)), add) == tuple(range(count))  # in their order


def test_nothing_cannot_be_merged() -> None:
    """No part, no sum."""
    with pytest.raises(ValueError, match="nothing"):
        merged([], lambda parts: parts[0])
    with pytest.raises(ValueError, match="nothing"):
        summed([], add)


def equations(n: int, zeros: int, p: int) -> RunEquations:
    """Equations of a run with two rows."""
    run = RunEquations(tuple(f"z{i}" for i in range(zeros)), np.full(zeros, 0.5))
    for row in ("a", "b"):
        run.add(row, RNG.standard_normal((n, zeros + p)), RNG.standard_normal(n))
    return run


def test_runs_without_zeros_merge_into_one() -> None:
    """Merged equations have the solution and the weights of those of all runs."""
    runs = [equations(40, 0, 3) for _ in range(11)]
    known = np.eye(3) * 0.1
    start, least = {"a": 1.0, "b": 2.0}, {"a": 1e-9, "b": 1e-9}
    x, sigma = Equations(runs, known, ("a", "b")).iterate(start, least)
    whole = merged(runs, RunEquations.merged)
    assert whole.counts == {"a": 440, "b": 440}
    y, weights = Equations([whole], known, ("a", "b")).iterate(start, least)
    np.testing.assert_allclose(y, x, rtol=1e-12)
    assert weights == pytest.approx(dict(sigma), rel=1e-12)


def test_zeros_are_eliminated_run_by_run() -> None:
    """The merged factor has the normal matrix of the equations with every run's zeros as unknowns."""
    runs, known, sigma = [equations(30, 2, 3) for _ in range(9)], np.eye(3) * 0.1, {"a": 0.7, "b": 1.3}
    found = Equations(runs, known, ("a", "b"))
    wide: list[np.ndarray] = [np.column_stack([np.zeros((3, 18)), known, np.zeros(3)])]
    for i, run in enumerate(runs):
        block = np.zeros((2, 22))
        block[:, 2 * i : 2 * i + 2] = np.diag(1.0 / run.priors)
        wide.append(block)
        for row, R in run.triangles.items():
            lines = np.zeros((len(R), 22))
            lines[:, 2 * i : 2 * i + 2], lines[:, 18:] = R[:, :2] / sigma[row], R[:, 2:] / sigma[row]
            wide.append(lines)
    R = triangle(np.concatenate(wide))[18:, 18:]
    root = found.root(sigma)
    np.testing.assert_allclose(root.T @ root, R.T @ R, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.reduced_normal(sigma), R.T @ R, rtol=1e-10, atol=1e-10)
    x = found.solve(sigma)
    quick, exact = found.squares(x, sigma, quick=True), found.squares(x, sigma, quick=False)
    assert quick == pytest.approx(exact, rel=1e-10)
    assert reduce(lambda a, b: a + b, exact.values()) > 0.0


def test_a_singular_run_does_not_stop_the_quick_solution() -> None:
    """A normal matrix that cannot be solved is NaN, and the factor is used instead."""
    run = equations(30, 2, 3)
    dead = replace(run, priors=np.full(2, np.inf), triangles={row: R * 0.0 for row, R in run.triangles.items()})
    assert np.all(np.isnan(dead.reduced_normal({"a": 1.0, "b": 1.0})[1]))
