"""A ranking on a campaign: what the tasks give is what the same tests get from runs in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import pytest

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.regression.sums.tree import merged
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.columns.cross_products import CrossProducts, Extent, SumsOfRuns
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.laws.grammar import pool
from lacet.identify.selection.partial_regression import GainsTask
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.campaign import tasks
from lacet.services.campaign.ranking import CampaignRanking
from lacet.services.campaign.ranking_tasks import (
    Draws,
    FitAt,
    LacksAt,
    PlainEffect,
    PlainWeighting,
    ProductsAt,
    RunSurvey,
    SamplesAt,
    SurveyAt,
    of_the_first,
)
from lacet.services.campaign.run_reference import RunReference, Settings
from lacet.services.campaign.tasks import Broken, EquationsAt, State, Survey
from lacet.services.library.runs import load_runs
from lacet.services.one_thread import one_thread
from tests.support.short_runs import CAR, write_short_runs

T = TypeVar("T")
SETTINGS = Settings(
    rig=(CAR / "rig.toml").read_text(encoding="utf-8"), vehicle=(CAR / "vehicle.toml").read_text(encoding="utf-8"),
    wheel_reference="hub",
)  # fmt: skip
CANDIDATES = ("anti_roll_bar.front", "spring_cubic.rear", "bump_stop.front", "sensor_gain.hub.fl")
DRAWS = 39


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two short runs."""
    return write_short_runs(tmp_path_factory.mktemp("runs"), 2, 8.0)


@pytest.fixture(scope="module")
def references(places: Sequence[Path]) -> list[RunReference]:
    """The same, as tasks are given them."""
    found = [tasks.survey(RunReference(str(place), place.stem), SETTINGS) for place in places]
    assert all(isinstance(one, Survey) for one in found)
    return [one.reference for one in found if isinstance(one, Survey)]


@pytest.fixture(scope="module")
def whole(places: Sequence[Path]) -> Fit:
    """The fit of both in this process."""
    with one_thread():
        runs = load_runs(*map(str, places), rig=str(CAR / "rig.toml"), vehicle=str(CAR / "vehicle.toml"))
        return fit(SETTINGS.model(), runs.prepared)


@pytest.fixture(scope="module")
def plain(whole: Fit) -> FitAt:
    """Its values, as tasks are given them."""
    equations = whole.equations
    where = EquationsAt(whole.base.independent, whole.assembly.at, equations.known, tuple(whole.rows), whole.removed)
    return FitAt.of(whole, where)


def over_runs(references: Sequence[RunReference], state: State, how: Callable[[Sequence[T]], T]) -> T:
    """The sums of the runs, merged as the workers' are."""

    def each(reference: RunReference) -> Any:
        found = tasks.reduce(reference, SETTINGS, state)
        assert not isinstance(found, Broken), found.runs
        return found

    return merged((each(reference) for reference in references), how)


@pytest.fixture(scope="module")
def local(whole: Fit) -> CrossProducts:
    """Products of some candidates in this process."""
    known = SETTINGS.known_effects()
    shapes = [one for key in CANDIDATES for one in known[key].shapes()]
    layout = Layout.of(len(whole.place), whole.sheet_entries, shapes)
    return CrossProducts.of(whole, floor_of(whole, DRAWS).without_draws(), layout, 1.5)


def near(one: Array, other: Array) -> None:
    """Equal to 1e-9 of the product of two columns' lengths: zeros that explain nearly all of a column cost digits."""
    scale = np.sqrt(np.maximum(np.diag(other), 1e-300)) if one.ndim == 2 else np.ones(1)
    size = np.outer(scale, scale) if one.ndim == 2 else np.max(np.abs(other), initial=1e-300)
    np.testing.assert_allclose(one / size, other / size, rtol=0.0, atol=1e-9)


def test_tasks_give_the_products_of_one_process(
    whole: Fit, plain: FitAt, local: CrossProducts, references: list[RunReference]
) -> None:
    """Of all samples, by row, and with each run's zeros eliminated; folds are counted in each run by itself."""
    sigma = floor_of(whole, DRAWS).sigma
    state = ProductsAt(plain, Draws(0, 0), PlainWeighting.of(local.weighting), dict(sigma), {}, 0, Extent.ALL)
    found = over_runs(references, state, SumsOfRuns.merged)
    near(found.total, local.total)
    for row, products in local.over_runs.rows.items():
        np.testing.assert_array_equal(found.acting[row], local.over_runs.acting[row])
        near(found.rows[row].columns, products.columns)
    assert len(found.zero_gains) == 2


def test_a_task_for_samples_gives_what_it_gives_here(
    whole: Fit, plain: FitAt, local: CrossProducts, references: list[RunReference]
) -> None:
    """Gains block by block, for coefficients of any kind."""
    sigma, w = floor_of(whole, DRAWS).sigma, local.layout.width
    rng = np.random.default_rng(3)
    used = np.sqrt(np.maximum(np.diag(local.total), 1e-300))[:, None]
    task = GainsTask(rng.standard_normal((w, 4)) / used, rng.standard_normal((w, 3)) / used)
    found = over_runs(
        references, SamplesAt(plain, Draws(0, 0), PlainWeighting.of(local.weighting), dict(sigma), task), task.merged
    )
    expected = local.samples.sum(task)
    near(found.blocks[:, 0], expected.blocks[:, 0])
    assert found.whole == pytest.approx(expected.whole, rel=1e-10)
    assert found.counts == expected.counts
    for row, taken in expected.taken.items():
        np.testing.assert_allclose(found.taken[row], taken, rtol=1e-9)


def test_the_survey_has_the_noise_of_the_runs(whole: Fit, plain: FitAt, references: list[RunReference]) -> None:
    """Levels from other draws of the same noise, fewer of each run than of the campaign."""
    keys = (*CANDIDATES, "sensor_latency.correvit")
    found = over_runs(references, SurveyAt(plain, Draws(DRAWS, 20), keys), RunSurvey.merged)
    level = floor_of(whole, DRAWS).sigma
    for row, sigma in found.sigma.items():
        assert sigma == pytest.approx(level[row], rel=0.15), row
    assert found.sheet == whole.sheet_entries
    known = SETTINGS.known_effects()
    expected = {key for key in keys if any(run.lacks(known[key]) for run in whole.runs)}
    assert set(found.lacks) == expected


def test_laws_of_no_catalogue_that_a_run_cannot_show_are_told_apart(
    plain: FitAt, places: Sequence[Path], references: list[RunReference], tmp_path: Path
) -> None:
    """What the first run lacks that lacks it: here a speed sensor in the second of two."""
    laws = [cls("") for cls in pool("chassis.fx")] + [cls("rear") for cls in pool("suspension")]
    state = LacksAt(plain, tuple(map(PlainEffect.of, laws)))
    assert over_runs(references, state, of_the_first) == {}
    whole = open_run(places[1])
    signals = {name: signal for name, signal in whole.signals.items() if name != "correvit.speed"}
    write_table(replace(whole, signals=signals), tmp_path / "slow.parquet")
    found = tasks.survey(RunReference(str(tmp_path / "slow.parquet"), "slow"), SETTINGS)
    assert isinstance(found, Survey)
    lacks = over_runs([references[0], found.reference], state, of_the_first)
    uses = {law.key: [use.state.channels for use in law.line.rows[0].uses.values()] for law in laws}
    of_speed = {key for key, channels in uses.items() if any("correvit" in c for some in channels for c in some)}
    assert of_speed
    assert set(lacks) == of_speed
    assert {lack.run for lack in lacks.values()} == {"slow"}


def test_workers_are_asked_once_what_a_law_of_no_catalogue_needs(plain: FitAt) -> None:
    """What the survey of the catalogue's candidates says stands beside it."""
    asked: list[tuple[str, ...]] = []
    lack = Unmeasured("slow", ("correvit.speed",))

    def reduce(state: LacksAt, how: Callable[[Sequence[Any]], Any], what: str) -> Any:
        asked.append(tuple(law.key for law in state.laws))
        return how([{key: lack for key in asked[-1] if key.startswith("law_chassis")}])

    known = SETTINGS.known_effects()
    ranking = CampaignRanking(cast(Any, None), cast(Any, None))
    survey = RunSurvey({}, {}, (), {"tyre_damping.front": lack})
    vars(ranking).update(candidates=known, survey=survey, plain=plain, reduce=reduce)
    of_speed, of_travel = pool("chassis.fx")[0](""), pool("suspension")[0]("rear")
    tried = [of_speed, of_travel, known["tyre_damping.front"], known["anti_roll_bar.front"]]
    for _ in range(2):
        assert set(ranking.unmeasured(tried)) == {of_speed.key, "tyre_damping.front"}
    assert asked == [(of_speed.key, of_travel.key)]


def test_draws_of_single_runs_are_combined_into_campaigns(plain: FitAt, references: list[RunReference]) -> None:
    """Each of the simulated campaigns takes one draw of each run, every draw equally often."""
    run = tasks.SingleRun(references[0], replace(SETTINGS))
    (drawn,) = Draws(60, 20).floor(plain.fit(run), run).draws
    row = drawn.rows[0]
    assert drawn.series[row].shape[0] == 20
    assert drawn.whole(row).shape[0] == drawn.count == 60
    assert np.bincount(drawn.choice[0]).tolist() == [3] * 20


@pytest.mark.slow
def test_a_campaign_is_ranked_with_equal_bits_on_any_number_of_workers(tmp_path: Path) -> None:
    """The bar that this car has and the model lacks is found, with the same numbers on one worker and on two."""
    pytest.importorskip("distributed")
    from lacet.services.campaign.cluster import Cluster, connected
    from lacet.services.campaign.fitting import Campaign, fit_campaign
    from lacet.services.campaign.ranking import diagnose_campaign

    runs = [str(place) for place in write_short_runs(tmp_path, 3, 12.0)]
    found = []
    for workers in (1, 2):
        with connected(None, workers) as client:
            cluster = Cluster(client)
            fitted = fit_campaign(cluster, Campaign.of(cluster, runs, SETTINGS))
            found.append(diagnose_campaign(cluster, fitted, DRAWS))
    one, other = found
    assert one.best is not None
    assert one.best.key == "anti_roll_bar.front"
    assert [(c.key, c.drop, c.p, c.gain, c.values) for c in one.candidates] == [
        (c.key, c.drop, c.p, c.gain, c.values) for c in other.candidates
    ]
