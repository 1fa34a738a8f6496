"""Sums of one law over places that runs cannot part."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.sums_of_places import sums_of_places
from tests.identify.exact_car import KNOWN

PARTED = np.diag([1.0, 1.0])
ONE = np.array([[1600.0, -1599.0], [-1599.0, 1600.0]])


@pytest.mark.parametrize(("known", "searched", "inseparable"), [(PARTED, ONE, False), (ONE, ONE, True)])
def test_places_are_parted_at_the_constants_of_the_fit(known: Array, searched: Array, inseparable: bool):
    """What is not known of constants that both places have in common moves both alike, and does not mix them."""
    laws = [KNOWN["coulomb.front"], KNOWN["coulomb.rear"]]
    names = [law.parameters[0].name for law in laws]
    fitted = SimpleNamespace(
        model=SimpleNamespace(physics=laws), theta=np.array([40.0, 45.0]), covariance=known,
        covariance_sheet=np.zeros((2, 2)), covariances_searched=(searched, np.zeros((2, 2))),
    )  # fmt: skip
    (one,) = sums_of_places(cast(Any, fitted), cast(Any, SimpleNamespace(names=names, covariance=known)))
    assert one.inseparable is inseparable
    assert one.value == 85.0
    assert one.half == pytest.approx(1.96 * np.sqrt(np.sum(searched)), rel=1e-3)
    assert one.widest == pytest.approx(1.96 * np.sqrt(np.max(np.diag(searched))), rel=1e-3)
