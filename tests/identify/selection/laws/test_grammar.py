"""Laws of the grammar: each is a line that `lacet effect` takes; a sum of them is the line that it is written as."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.car.kinematics import build_motion
from lacet.identify.effects.language.compiled import OneLine, one_line_effects
from lacet.identify.effects.suspension.damper_hysteresis import DamperHysteresis
from lacet.identify.selection.laws.grammar import GRIDS, Written, constants_of, pool
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KINDS = ("suspension", "tyre", "spin", "chassis.fx")


@pytest.mark.parametrize("kind", KINDS)
def test_laws_are_different_and_have_the_constants_of_their_text(kind: str) -> None:
    laws = pool(kind)
    assert len({law.line.rows[0].text for law in laws}) == len(laws) > 10
    for law in laws:
        assert list(law.grids) == constants_of(law.line.rows[0].text)
        assert list(law.line.parameters) == ["p"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sum_of_laws_is_written_as_the_line_that_it_is(kind: str) -> None:
    """Three laws of the grammar in turn, constants off their grids: the line's columns are theirs."""
    motion = build_motion(cars.recording(cars.random_signals(3), VEHICLE, cars.in_reference(RIG, "hub")))
    laws = pool(kind)
    where = "rear" if "." not in kind else ""
    for number in range(0, len(laws), 7):
        terms = [_off_grid(law, where) for law in laws[number : number + 3]]
        written = Written.of(terms)
        assert written.terms == len(terms)
        assert written.constants == sum(len(term.shape) for term in terms)
        (line,) = one_line_effects(f"law = {written.text}", VEHICLE, "hub")
        found = line.columns(motion)
        for row, table in found.items():
            for mine, term in zip(table, terms, strict=True):
                wanted = term.columns(motion)[row][0]
                np.testing.assert_allclose(mine, wanted, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(wanted))))


def _off_grid(law: type[OneLine], where: str) -> OneLine:
    """A law at constants of three digits between two values of their grids."""
    between = {name: (values[1] + 2.0 * values[2]) / 3.0 for name, values in law.grids.items()}
    return law(where, {name: float(f"{value:.3g}") for name, value in between.items()})


def test_grids_of_single_laws_and_of_products_have_the_same_ends() -> None:
    """A constant is searched between the ends of its grid, in a product as well."""
    for single, product, _ in GRIDS.values():
        assert (single.split()[0], single.split()[-1]) == (product.split()[0], product.split()[-1])


def test_friction_that_turns_round_is_the_catalogue_s_where_this_has_it():
    """Over shorter lengths it is Coulomb friction, read from the travel, which is less noisy than its rate."""
    low, high = DamperHysteresis.bounds["length"]
    single, product, unit = GRIDS["length"]
    assert unit == "mm"
    assert all(low <= 1e-3 * float(value) <= high for value in (*single.split(), *product.split()))
