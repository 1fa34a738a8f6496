"""A law run by run: against dense least squares, and whether what changes from run to run is called a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.selection.candidate import Answer, Reason
from lacet.identify.selection.chow_test import ParameterConstancy, _compared, chow_test, chow_test_in_model
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, MODEL, driven, exact_with
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.held import blocks_of, runs_of

CUBIC = KNOWN["spring_cubic.front"]
TRIED = [CUBIC, *(KNOWN[key] for key in ("anti_roll_bar.front", "coulomb.rear", "sensor_gain.force.rr"))]


def run(number: int, size: float) -> PreparedRun:
    """A run of the exact car with a cubic spring of that size."""
    drive = driven(exact_with(CUBIC, size), number)
    return PreparedRun(replace(drive.recording, run=f"run {number}"))


def fit_of_runs(*sizes: float) -> Fit:
    """The model without the spring on a run for each size."""
    return fit(MODEL, [run(number, size) for number, size in enumerate(sizes, 1)])


def without_products(
    noise: RegressorNoise, sums: CrossProducts, ratios: object, sigma: object, layout: Layout | None = None
) -> Array:  # fmt: skip
    """Products of columns without noise, in place of `RegressorNoise.products`."""
    del noise, ratios, sigma
    return np.zeros(((layout or sums.layout).width,) * 2)


@pytest.fixture(scope="module")
def same() -> ScoreTests:
    """Two runs of one car."""
    fitted = fit_of_runs(4e6, 4e6)
    return ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), TRIED, 0)


@pytest.fixture(scope="module")
def not_constant() -> Diagnosis:
    """Of two runs in which the spring is another."""
    fitted = fit_of_runs(2e6, 6e5)
    return diagnose(fitted, floor_of(fitted, DRAWS), TRIED)


@pytest.mark.parametrize("key", ["spring_cubic.front", "sensor_gain.force.rr"])
def test_it_is_dense_least_squares_with_columns_of_each_runs_own(
    same: ScoreTests, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All samples stacked, zeros of each run and what is known beforehand among the unknowns."""
    monkeypatch.setattr(RegressorNoise, "products", without_products)
    candidates = {c.key: c for c in same.family_wise(same.try_all())}
    other = candidates["anti_roll_bar.front"]
    said = chow_test(same, candidates[key], [other])
    assert said
    tried, w = same.best_tests[key], same.layout.width
    own = tried.without_tolerance.own if tried.without_tolerance else np.zeros(0, int)
    kept = np.setdiff1d(np.arange(len(same.regression.nuisance)), own)
    bar = same.best_tests[other.key].trial.place
    shared = np.r_[same.regression.nuisance[kept], bar]
    sigma = [q.prior for q in KNOWN[other.key].parameters]
    prior = scipy.linalg.block_diag(same.regression.prior[np.ix_(kept, kept)], np.diag([s**-2.0 for s in sigma]))
    prior_side = np.r_[same.regression.prior_side[kept], np.zeros(len(sigma))]
    law, right = np.eye(w)[:, tried.trial.place.start], np.eye(w)[:, same.layout.right]
    check(said, Dense(same, np.eye(w)[:, shared], prior, prior_side, law, right))


@pytest.mark.parametrize("selected", [(), ("anti_roll_bar.front",)])
def test_a_law_in_the_model_is_tried_with_columns_of_each_runs_own(
    monkeypatch: pytest.MonkeyPatch, selected: tuple[str, ...]
) -> None:
    """The same of a law that is in the fit, whose value in a run is that of the fit and what the run adds to it.

    Effects `selected` beside the fit have common parameters, too.
    """
    monkeypatch.setattr(RegressorNoise, "products", without_products)
    fitted = fit(MODEL + CUBIC, [run(number, size) for number, size in ((1, 4e6), (2, 3e6))])
    space = ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), TRIED[1:], 0)
    beside = [trial for trial in space.layout.trials if trial.effect.key in selected]
    assert len(beside) == len(selected)
    space = ScoreTests(space.columns.given(beside), space.noise, noise_ratio=space.noise_ratio)
    (law,) = added_laws(space)
    said = chow_test_in_model(space, law)
    assert said
    model, w, (place,) = space.layout.model, space.layout.width, law.places
    columns = np.eye(w)
    columns[:model, :model] = np.linalg.inv(space.sums.turn)
    nuisance = space.regression.nuisance
    basis = columns[np.ix_(nuisance, nuisance)]
    prior = basis.T @ space.regression.prior @ basis
    kept = np.flatnonzero(nuisance != place)
    right = np.eye(w)[:, space.layout.right] + fitted.theta[fitted.place][place] * columns[:, place]
    prior_side = (basis.T @ space.regression.prior_side)[kept]
    check(said, Dense(
        space, columns[:, nuisance[kept]], prior[np.ix_(kept, kept)], prior_side, columns[:, place], right
    ))  # fmt: skip
    assert said.values["run 1"][0] > said.values["run 2"][0] + 5e5


@dataclass(frozen=True)
class Dense:
    """Least squares with all samples stacked; columns are combinations of those of `space`.

    `shared` (w, a) have common parameters with priors, `law` (w,) parameters of their own in groups of runs.
    """

    space: ScoreTests
    shared: np.ndarray
    prior: np.ndarray
    prior_side: np.ndarray
    law: np.ndarray
    right: np.ndarray

    def fall(self, groups: list[list[int]]) -> tuple[float, np.ndarray]:
        """Fall of the squares with the law's column once for each group of runs, and its parameters."""
        sums, width = self.space.sums, self.space.layout.width
        zeros = [len(run.zero_gain) for run in runs_of(sums)]
        start = np.cumsum([0, *zeros, self.shared.shape[1]])
        size = start[-1] + len(groups)
        normal, right = np.zeros((size, size)), np.zeros(size)
        for run, block in blocks_of(sums):
            wide = np.zeros((len(block.columns), width))
            wide[:, block.active] = block.columns
            rows = np.zeros((len(wide), size))
            rows[:, start[run] : start[run + 1]] = block.zeros
            rows[:, start[2] : start[3]] = wide @ self.shared
            for g, group in enumerate(groups):
                if run in group:
                    rows[:, start[3] + g] = wide @ self.law
            normal += rows.T @ rows
            right += rows.T @ (wide @ self.right)
        known = scipy.linalg.block_diag(np.eye(start[2]), self.prior, np.zeros((len(groups),) * 2))
        right[start[2] : start[3]] += self.prior_side
        scale = np.sqrt(np.diag(normal + known))
        scale[scale == 0.0] = 1.0
        found = np.linalg.lstsq((normal + known) / np.outer(scale, scale), right / scale, rcond=1e-13)[0] / scale
        return float(right @ found), found[start[3] :]


def check(said: ParameterConstancy, dense: Dense) -> None:
    """A Chow test of two runs against dense least squares."""
    nothing, _ = dense.fall([])
    common, _ = dense.fall([[0, 1]])
    each, values = dense.fall([[0], [1]])
    assert said.common == pytest.approx(common - nothing, rel=1e-3)
    assert said.further == pytest.approx(each - common, rel=1e-2, abs=1e-3)
    np.testing.assert_allclose([said.values[r][0] for r in ("run 1", "run 2")], values, rtol=1e-3)


def test_a_law_of_the_car_is_named(same: ScoreTests) -> None:
    found = diagnose(same.fitted, same.floor, TRIED, noise=same.noise)
    assert found.best, says(found)
    assert found.best.key == CUBIC.key
    said = chow_test(same, found.best)
    assert said
    assert said.p > 0.05
    assert not said.differ_by_more_than(SELECTION.inconstant_share)
    for name, values in said.values.items():
        assert values[0] == pytest.approx(4e6, abs=4.0 * said.spread[name][0])


def test_each_law_found_is_tried_beside_the_others_found(same: ScoreTests, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another missing effect does in some runs is not laid to the strongest."""
    asked: list[tuple[str, set[str]]] = []

    def test(space: ScoreTests, law: AddedLaw, without: Sequence[AddedLaw]) -> None:
        beside = {one.key for one in added_laws(space)} - {one.key for one in (law, *without)}
        asked.append((law.key, beside))

    monkeypatch.setattr("lacet.identify.selection.diagnose.chow_test_in_model", test)
    found = diagnose(same.fitted, same.floor, TRIED, noise=same.noise)
    keys = {c.key for c in found.found}
    assert CUBIC.key in keys
    assert asked == [(c, keys - {c}) for c, _ in asked]
    assert {c for c, _ in asked} == keys


def test_a_law_that_changes_from_run_to_run_is_none(not_constant: Diagnosis) -> None:
    """Where the rows' own colour does not tell it already."""
    found = not_constant
    assert found.verdict == "unlisted cause", says(found)
    assert found.best is None
    assert "another law in each run" in says(found)
    assert "in run 1" in says(found)
    assert "in run 2" in says(found)
    assert "lacks something in suspension.fl, suspension.fr that is not the same in all runs" in says(found)


def test_several_laws_that_change_from_run_to_run_are_one_cause(not_constant: Diagnosis) -> None:
    """Said once, with what each would have to be; no small rest, and no part, is said of them beside."""
    found = not_constant
    (one,) = found.grounds.not_constant.values()
    keys = (CUBIC.key, "coulomb.rear")
    grounds = replace(found.grounds, not_constant=dict.fromkeys(keys, one))
    candidates = [replace(c, reason=Reason.PART_OF_REST) if c.key in keys else c for c in found.candidates]
    both = replace(found, grounds=grounds, candidates=tuple(candidates), small_rows=(Row("tyre.fl"),))
    text = says(both)
    assert text.count("not the same in all runs") == text.count("another law in each run") == 1
    assert f"{keys[0]} (" in text
    assert f"{keys[1]} (" in text
    assert "explain most, but each would" in text
    assert "explain a part" not in text
    bar = next(c for c in candidates if c.key == "anti_roll_bar.front")
    beside = replace(both, found=(replace(bar, answer=Answer.MISSING, reason=Reason.PASSES),))
    assert "not the same in all runs" in says(beside)
    assert "is small" not in says(beside)
    assert "is small: tyre.fl" in says(replace(beside, grounds=replace(grounds, not_constant={})))


@pytest.mark.parametrize(
    ("common", "apart", "further", "broken"),
    [(100.0, 0.0, 20.0, True), (100.0, 0.0, 16.5, False), (10.0, 0.0, 4.0, False), (0.0, 0.0, 20.0, True),
     (0.0, 100.0, 20.0, True), (0.0, 100.0, 16.5, False)],
)  # fmt: skip
def test_a_law_is_broken_beyond_chance_and_by_enough_to_matter(
    common: float, apart: float, further: float, broken: bool
) -> None:
    """Simulated runs give 2 on average, and 5 in one of ten."""
    null = np.array([*[5.0] * 10, *[1.5] * 60, *[5.0 / 3.0] * 30])
    said = ParameterConstancy({"a": np.zeros(1)}, np.ones((1, 1, 1, 1)), common, apart, further, null, {})
    assert said.differ_by_more_than(SELECTION.inconstant_share) == broken
    assert said.p == pytest.approx(1.0 / 101.0 if further > 5.0 else 11.0 / 101.0)


def test_a_run_that_shows_little_of_a_law_counts_by_what_it_shows():
    """One in two runs, and −2 in the third, of 1 % of the energy; the fourth, less its noise, shows nothing of it."""
    energy, values = np.array([1e4, 1e4, 200.0]), np.array([1.0, 1.0, -2.0])
    draws = np.sqrt(energy) * np.random.default_rng(0).normal(size=(199, 3))
    # Products of the law, and of a column that has nothing to do with it.
    groups = [np.diag([e, 1.0]) for e in (*energy, -1e-3)]  # the fourth: less its noise, nothing
    right = [np.array([[e * v], [0.0]]) for e, v in zip(energy, values, strict=True)]
    chance = [np.stack([draw, 0.0 * draw]) for draw in draws.T]
    said = _compared(
        ["a", "b", "c", "d"], groups, [*right, np.zeros((2, 1))], [*chance, np.zeros((2, 199))], [0, 1, 2, 3],
        np.arange(1), (np.ones(1, np.intp), np.zeros((1, 1)), np.zeros(1)),
    )  # fmt: skip
    common = float(energy @ values / sum(energy))
    off = energy * (values - common) ** 2
    by_chance = np.mean((draws / energy - draws.sum(axis=1, keepdims=True) / sum(energy)) ** 2, axis=0) * energy
    assert said.further == pytest.approx(sum(off), rel=1e-3)
    wanted = dict(zip("abcd", [*((off - by_chance) / (energy * common**2)), 0.0], strict=True))
    assert said.misfits == pytest.approx(wanted, rel=1e-3)
    assert not said.differ_by_more_than(SELECTION.inconstant_share)
    assert said.fails_in_a_run(SELECTION.selected_inexactness**2)


def test_one_car_has_a_misfit_in_a_run_as_often_as_chance_may():
    """A law of one in all three runs, with 199 other draws of the noise than those it is compared with."""
    energy = np.array([1e4, 1e4, 200.0])
    drawn = np.sqrt(energy) * np.random.default_rng(0).normal(size=(398, 3))
    chance = [np.stack([draw, 0.0 * draw]) for draw in drawn[:199].T]

    def has_misfit(noise: np.ndarray) -> bool:
        right = [np.array([[e + n], [0.0]]) for e, n in zip(energy, noise, strict=True)]
        known = (np.ones(1, np.intp), np.zeros((1, 1)), np.zeros(1))
        said = _compared(
            ["a", "b", "c"], [np.diag([e, 1.0]) for e in energy], right, chance, [0, 1, 2], np.arange(1), known
        )
        return max(said.misfits.values()) > 0.0

    often = sum(has_misfit(noise) for noise in drawn[199:])
    # 5 %, and three σ of a count.
    assert often == pytest.approx(199 * SELECTION.failing_chance, abs=3.0 * np.sqrt(199 * SELECTION.failing_chance))


def test_the_two_runs_told_are_those_farthest_apart_in_sigma_of_the_difference() -> None:
    values = {"a": np.array([0.0, 1.0]), "b": np.array([9.0, 1.5]), "c": np.array([1.0, 9.0])}
    spread = np.array([[1.0, 0.1], [9.0, 0.1], [1.0, 9.0]])
    covariance = np.diag(spread.ravel() ** 2).reshape(3, 2, 3, 2)
    said = ParameterConstancy(values, covariance, 1.0, 1.0, 1.0, np.ones(9), {})
    assert said.farthest_apart == (1, "a", "b")
    assert said.difference(1, "a", "b") == pytest.approx((0.5, np.hypot(0.1, 0.1)))
    np.testing.assert_allclose(list(said.spread.values()), spread)
    together = covariance + 1e4 * np.einsum("kl,mn->mknl", np.eye(2), np.ones((3, 3)))
    said = ParameterConstancy(values, together, 1.0, 1.0, 1.0, np.ones(9), {})
    assert said.farthest_apart == (1, "a", "b")
    assert said.difference(1, "a", "b") == pytest.approx((0.5, np.hypot(0.1, 0.1)))


def of_groups(groups: Sequence[np.ndarray], values: Sequence[float], prior: float) -> ParameterConstancy:
    """Chow test of a law, the first column, beside one that runs have in common, whose size is known to 1 ÷ √prior.

    The residual of each run is the law times its value.
    """
    chance = [np.linalg.cholesky(one + 1e-12 * np.eye(2)) for one in groups]
    rng = np.random.default_rng(0)
    draws = [root @ rng.normal(size=(2, 199)) for root in chance]
    right = [one[:, :1] * value for one, value in zip(groups, values, strict=True)]
    known = (np.ones(1, np.intp), np.full((1, 1), prior), np.zeros(1))
    return _compared("abcd"[: len(groups)], groups, right, draws, range(len(groups)), np.arange(1), known)


@pytest.mark.parametrize(("second", "broken"), [(0.115, False), (0.01, True)])
def test_what_hides_a_law_in_all_runs_does_not_make_small_differences_large(second: float, broken: bool) -> None:
    """A tolerance that acts as the law does in both runs, to a hundredth: differences are seen, the law hardly."""
    energy, alike = 1e5, 0.9999
    both = energy * np.array([[1.0, alike], [alike, 1.0]])
    said = of_groups([both, both], [0.1, second], prior=400.0)
    a, b = said.spread.values()
    assert min(a[0], b[0]) > 5.0 * said.difference(0, "a", "b")[1]
    assert said.p <= SELECTION.failing_chance
    assert said.further - np.mean(said.null) > SELECTION.inconstant_share * said.common
    assert said.differ_by_more_than(SELECTION.inconstant_share) == broken


@pytest.mark.parametrize("energy", [(1.0, 1.0, 1.0), (1.0, 0.3, 0.01)])
@pytest.mark.parametrize("alike", [0.0, 0.999])
def test_differences_as_large_as_a_law_are_those_of_a_law_that_one_run_alone_has(
    energy: Sequence[float], alike: float
) -> None:
    """The sum over the runs of what differences explain then, which is never more than the law itself does.

    Unless the runs have something in common that hides it.
    """
    groups = [1e5 * e * np.array([[1.0, alike], [alike, 1.0]]) for e in energy]
    said = of_groups(groups, [0.2] * 3, prior=1.0)
    each = [of_groups(groups, np.eye(3)[r] * 0.2, prior=1.0).further for r in range(3)]
    assert said.apart == pytest.approx(1.5 * sum(each))
    if alike:
        assert said.apart > 5.0 * said.common
    else:
        assert said.apart <= said.common * (1.0 + 1e-9)
        assert (said.apart == pytest.approx(said.common)) == (energy[1] == 1.0)


@pytest.mark.parametrize("key", [CUBIC.key, "coulomb.rear"])
def test_runs_beyond_so_much_data_are_taken_as_one(same: ScoreTests, key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise in theirs is what all have, less what is drawn for the others: nearly what is drawn for them."""
    found = {c.key: c for c in same.try_all()}
    whole = chow_test(same, found[key])
    monkeypatch.setattr("lacet.identify.selection.chow_test.SELECTION", replace(SELECTION, chow_seconds=1.0))
    part = chow_test(same, found[key])
    assert whole
    assert part
    (name,) = set(part.values) - {"the other run"}
    (other,) = set(whole.values) - {name}
    for a, b in ((name, name), (other, "the other run")):
        assert part.values[b][0] == pytest.approx(whole.values[a][0], abs=0.3 * whole.spread[a][0])
    assert part.common == pytest.approx(whole.common, rel=0.05, abs=0.2)


def test_with_the_others_as_one_all_noise_is_taken_out(same: ScoreTests, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is drawn for runs by themselves and what is left to the others is together what all runs have."""
    found = {c.key: c for c in same.try_all()}
    given: list[list[np.ndarray]] = []
    monkeypatch.setattr("lacet.identify.selection.chow_test.SELECTION", replace(SELECTION, chow_seconds=1.0))
    monkeypatch.setattr(
        "lacet.identify.selection.chow_test._compared", lambda names, groups, *rest: given.append(groups)
    )
    assert chow_test(same, found["coulomb.rear"]) is None
    inside, _ = same.beside([replace(KNOWN["coulomb.rear"], shape=found["coulomb.rear"].shape)])
    assert len(given[0]) == 2
    np.testing.assert_allclose(np.sum(given[0], axis=0), inside.sums.total - inside.column_noise, rtol=1e-7, atol=1e-6)


def test_runs_of_one_name_are_told_apart(same: ScoreTests, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {c.key: c for c in same.try_all()}
    monkeypatch.setattr(PreparedRun, "name", "sinus")
    said = chow_test(same, found[CUBIC.key])
    assert said
    assert set(said.values) == {"sinus (1)", "sinus (2)"}


def test_one_run_cannot_tell() -> None:
    fitted = fit_of_runs(4e6)
    space = ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), TRIED, 0)
    found = {c.key: c for c in space.try_all()}
    assert chow_test(space, found[CUBIC.key]) is None


def test_of_several_laws_one_differs_by_chance_more_often() -> None:
    """Bonferroni over the laws tested; of few simulated runs the least p there is counts for any number."""
    values, nothing = {"a": np.ones(1), "b": np.ones(1)}, np.zeros((2, 1, 2, 1))

    def tested(draws: int, larger: int) -> ParameterConstancy:
        null = np.where(np.arange(draws) < larger, 2.0, 0.0)
        return ParameterConstancy(values, nothing, 1.0, 1.0, 1.0, null, {"a": 1.0, "b": 0.0})

    assert tested(199, 2).p == pytest.approx(0.015)
    assert [tested(199, 2).is_rejected(laws) for laws in (1, 3, 4)] == [True, True, False]
    assert [tested(199, 2).fails_in_a_run(0.5, laws) for laws in (3, 4)] == [True, False]
    assert [tested(199, 2).differ_by_more_than(0.1, laws) for laws in (3, 4)] == [True, False]
    assert tested(39, 0).is_rejected(20)
    assert not tested(39, 1).is_rejected(20)
