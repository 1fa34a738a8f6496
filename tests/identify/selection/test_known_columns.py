"""Cross products with columns that others have already, against those in which every column is computed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.effects.user_files import checked_columns
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.selection.columns.cross_products import CrossProducts, Extent
from lacet.identify.selection.columns.known_columns import KnownColumns
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import floor_of
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
CANDIDATES = [KNOWN[key] for key in ("anti_roll_bar.front", "bump_stop.front", "sensor_drift.wheel.fl.force.z")]
BETWEEN = replace(KNOWN["bump_stop.front"], shape={"gap": 0.0123, "n": 1.4})


@pytest.fixture(scope="module", params=["whole runs", "in pieces"])
def space(request: pytest.FixtureRequest) -> Iterator[ScoreTests]:
    """Some candidates on two short runs; or on the same in pieces of 4 s, as long runs are."""
    runs = [PreparedRun.of(cars.piece(name, 2.0, 13.0), VEHICLE, RIG) for name in ("sine", "rough")]
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "in pieces":
            patch.setattr("lacet.identify.regression.prepared_run.PIECE", 4.0)
        fitted = fit(Model.of(e for e in KNOWN.values() if e.base), runs, FitOptions(draws=2))
        yield ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, 19)), CANDIDATES, 0)


@pytest.mark.parametrize("extent", Extent)
@pytest.mark.parametrize("stiffening", [1.0, 1.7])
def test_the_sums_are_those_of_columns_computed_anew(space: ScoreTests, extent: Extent, stiffening: float):
    """Candidates as they are, another with constants of its own, and priors of another stiffness."""
    fitted, floor, before = space.linearisation.runs.refittable, space.floor, space.sums
    assert fitted is not None
    chosen = [CANDIDATES[0], *CANDIDATES[1].shapes()[1:3], CANDIDATES[2], BETWEEN]
    layout = Layout.of(before.layout.model, before.layout.sheet, chosen)
    drifts = {CANDIDATES[2].key: 3.0}
    of = partial(CrossProducts.of, fitted, floor, layout, stiffening, drifts, 4, extent)
    anew, found = of(), of(known=before)
    assert_equal(found.total, anew.total)
    for name in ("train", "test", "null_sheet"):
        assert_equal(getattr(found.over_runs, name), getattr(anew.over_runs, name))
    for row, null in anew.over_runs.null.items():
        assert_equal(found.over_runs.null[row], null)
        assert list(found.over_runs.acting[row]) == list(anew.over_runs.acting[row])
    assert found.over_runs.rows.keys() == anew.over_runs.rows.keys()
    for row, products in anew.over_runs.rows.items():
        assert_equal(found.over_runs.rows[row].columns, products.columns)
    column = np.eye(layout.width)[:, -3:]
    for mine, theirs in zip(*(one.samples.runs for one in (found, anew)), strict=True):
        for (block, series), (_, same) in zip(mine.series(column), theirs.series(column), strict=True):
            assert_equal(series, same, str(block.row))


def test_only_further_columns_are_computed(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """Neither the fit's pieces nor a column of an effect that is there already."""
    made: list[str] = []

    def columns(effect: PhysicalEffect, motion: Motion) -> object:
        made.append(effect.key)
        return checked_columns(effect, motion)

    monkeypatch.setattr("lacet.identify.regression.prepared_run.checked_columns", columns)
    monkeypatch.setattr("lacet.identify.regression.assembly.Assembly.pieces_of", forbidden)
    space.beside([CANDIDATES[0], replace(BETWEEN, shape={"gap": 0.0131, "n": 1.2})], Extent.TOTAL)
    assert {key.partition(".")[0] for key in made} == {"bump_stop"}


def forbidden(*_: object) -> None:
    """What must not be asked for."""
    raise AssertionError("the fit's pieces are made again")


def test_a_fault_without_columns_has_all_computed(space: ScoreTests):
    """Its response needs the sensitivities, which the samples do not have."""
    layout = Layout.of(space.layout.model, space.layout.sheet, [KNOWN["sensor_gain.hub.fl"]])
    before = space.sums.weighting, space.sums.samples
    assert KnownColumns.of(replace(layout, trials=()), *before) is not None
    assert KnownColumns.of(layout, *before) is None
    assert KnownColumns.of(replace(layout, sheet=layout.sheet[1:], trials=()), *before) is None


def assert_equal(found: Array, wanted: Array, what: str = "") -> None:
    """Equal but for rounding."""
    assert found.shape == wanted.shape
    size = float(np.max(np.abs(wanted), initial=0.0))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-11 * size, err_msg=what)
