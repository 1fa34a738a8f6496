"""What sizes of effects may be, as a region around the size they are taken at."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.design.discrimination import WIDE, region


def test_one_size_has_its_interval():
    assert region(np.array([[4.0]])).ravel() == pytest.approx([1.0 - 0.98, 1.0 + 0.98], abs=1e-3)


def test_two_sizes_that_are_told_apart_have_an_ellipse_of_their_spread():
    rng = np.random.default_rng(3)
    information = np.array([[9.0, 4.0], [4.0, 5.0]])
    edge = region(information)
    apart = edge - 1.0
    assert np.einsum("ni,ij,nj->n", apart, information, apart) == pytest.approx(5.991, abs=1e-2)
    drawn = rng.multivariate_normal([0.0, 0.0], np.linalg.inv(information), 40_000)
    inside = np.einsum("ni,ij,nj->n", drawn, information, drawn) <= 5.991
    assert np.mean(inside) == pytest.approx(0.95, abs=0.005)


def test_what_is_left_open_ends_somewhere():
    edge = region(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert np.max(np.linalg.norm(edge - 1.0, axis=1)) == pytest.approx(WIDE)
