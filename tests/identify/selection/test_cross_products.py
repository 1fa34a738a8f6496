"""The ranking's sums against dense weighted least squares with every zero and tolerance as a column of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, Parameter
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.candidate import Answer
from lacet.identify.selection.columns.cross_products import Extent, SumsOfRuns
from lacet.identify.selection.columns.layout import Layout, Trial
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import RegressorNoise, regressor_labels
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.relinearisation import relinearise
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.render.verdicts import says
from tests.identify import cars
from tests.identify.selection.dense_ranking import Dense
from tests.identify.selection.held import remainder_of

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
DRAWS = 19
TRIED = (
    "anti_roll_bar.front", "coulomb.rear", "bump_stop.front", "tyre_damping.front", "aero_drag", "sensor_gain.hub.fl",
    "sensor_gain.force.rr", "sensor_latency.laser", "sensor_misalignment.imu.pitch", "sensor_drift.wheel.fl.force.z",
)  # fmt: skip
CANDIDATES = [KNOWN[key] for key in TRIED]


@pytest.fixture(scope="module")
def drives() -> list[PreparedRun]:
    """Two short runs of different length."""
    runs = (cars.piece("sine", 4.0, 11.0), cars.piece("rough", 0.0, 9.0))
    return [PreparedRun.of(run, VEHICLE, RIG) for run in runs]


@pytest.fixture(scope="module")
def fitted(drives: list[PreparedRun]) -> Fit:
    """The base model on them."""
    return fit(Model.of(e for e in KNOWN.values() if e.base), drives, FitOptions(draws=2))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    """Their noise floor."""
    return floor_of(fitted, DRAWS)


def silent(fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect]) -> ScoreTests:
    """The ranking without the correction for noise in the columns."""

    def none(fitted: Fit, layout: Layout, sigma: Mapping[Row, float], *_: object) -> RegressorNoise:
        return RegressorNoise(regressor_labels(fitted, layout), (), dict(sigma))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RegressorNoise, "of", none)
        return ScoreTests.of(relinearise(Linearisation.of(fitted, floor)), candidates, 0)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    """Some candidates of every kind on it."""
    return silent(fitted, floor, CANDIDATES)


@pytest.fixture(scope="module")
def dense(space: ScoreTests) -> Dense:
    """The same, sample by sample."""
    return Dense(space.fitted, space.floor, space)


def trials(space: ScoreTests) -> list[Trial]:
    """One trial of each candidate that is left over from the model."""
    found = {t.effect.key: t for t in space.layout.trials if np.all(space.regression.remaining_energy(t.place) > 1e-8)}
    return list(found.values())


def test_candidates_are_of_every_kind(space: ScoreTests):
    assert space.linearisation.latencies  # on runs read again
    kinds = {t.effect.name for t in trials(space)}
    assert {"anti_roll_bar", "coulomb", "sensor_gain", "sensor_latency", "sensor_misalignment"} <= kinds


def test_drop_and_values_are_those_of_refitting(space: ScoreTests, dense: Dense):
    """With the candidate's columns free beside all others: also for a fault whose tolerance the model has already."""
    right = dense.base[2]
    before = dense.solve(right)[0]
    for trial in trials(space):
        C = dense.column(trial.effect)
        after, x, _ = dense.solve(right, C)
        drop, _ = space.regression.scores(trial.place, space.null)
        values, _ = space.regression.values(trial.place)
        assert drop == pytest.approx(before - after, rel=1e-6, abs=1e-6), trial.effect.key
        # A fault's own tolerance column takes none of it once the fault is free.
        np.testing.assert_allclose(values, x[-C.shape[1] :], rtol=1e-5, err_msg=trial.effect.key)


def test_a_fault_is_judged_free_of_its_tolerance(space: ScoreTests, dense: Dense, fitted: Fit):
    """Its drop is that of refitting with its own prior removed; a gain stands among the sheet's as the channel's."""
    columns, inverse, right = dense.base
    before = dense.solve(right)[0]
    tilt = next(t for t in trials(space) if t.effect.name == "sensor_misalignment")
    gain = next(t for t in trials(space) if t.effect.key == "sensor_gain.hub.fl")
    entries = dict.fromkeys(space.layout.sheet)
    first_sheet = len(inverse) - len(dense.faults) - len(entries)
    hub = first_sheet + list(entries).index(("gain", "laser.fl.hub", 0))
    for trial, place in ((tilt, len(inverse) - 1), (gain, hub)):
        free = dense.unknown(place)
        drop, _ = space.regression.scores(trial.place, space.null)
        assert np.any(columns[:, place])
        assert drop == pytest.approx(before - free.solve(right)[0], rel=1e-6), trial.effect.key


def test_a_fault_is_weighed_where_its_own_tolerance_excuses_none_of_it(space: ScoreTests, dense: Dense, fitted: Fit):
    """Size, fall, fall in cross-validation and in a simulated run: of refits without the columns that stand for it."""
    inverse = dense.base[1]
    first_sheet = len(inverse) - len(dense.faults) - len(dict.fromkeys(space.layout.sheet))
    entries = list(dict.fromkeys(space.layout.sheet))
    hub = first_sheet + entries.index(("gain", "laser.fl.hub", 0))
    clock = first_sheet + next(i for i, e in enumerate(entries) if e[0] == "latency" and e[1].startswith("laser"))
    tilt = next(t for t in trials(space) if t.effect.name == "sensor_misalignment")
    gain = next(t for t in trials(space) if t.effect.key == "sensor_gain.hub.fl")
    latencies = next(t for t in trials(space) if t.effect.name == "sensor_latency")
    null = np.sum(list(space.sums.over_runs.null.values()), axis=0)
    for trial, place in ((tilt, len(inverse) - 1), (gain, hub), (latencies, clock)):
        without_tolerance, bare = space.without_tolerance[trial.place.start], dense.without(place)
        C, right = dense.column(trial.effect), bare.base[2]
        before, _, _ = bare.solve(right)
        after, x, _ = bare.solve(right, C)
        assert without_tolerance.drop == pytest.approx(before - after, rel=1e-5), trial.effect.key
        assert without_tolerance.value == pytest.approx(x[-1], rel=1e-5)
        drawn = dense.noise(7)
        fell = bare.solve(drawn, drawn=True)[0] - bare.solve(drawn, C, drawn=True)[0]
        assert without_tolerance.null(null)[7] == pytest.approx(fell, rel=1e-5, abs=1e-5)
        assert without_tolerance.fall() == pytest.approx(bare.fall(C), rel=1e-4, abs=1e-4)


def test_falls_are_those_of_fits_to_the_other_blocks(space: ScoreTests, dense: Dense):
    """Blocked cross-validation: fitted outside each fold, with and without the candidate, and compared inside."""
    assert dense.block.max() + 1 >= SELECTION.folds
    # The second run's blocks follow on those of the first, which are not a whole number of folds.
    assert space.sums.samples.runs[1].first % SELECTION.folds != 0
    for trial in trials(space)[::2]:
        C = dense.column(trial.effect)
        assert space.regression.fall(trial.place) == pytest.approx(dense.fall(C), rel=1e-5, abs=1e-5), trial.effect.key


def test_simulated_runs_are_treated_as_the_measured_one(space: ScoreTests, dense: Dense):
    """A draw of noise in the place of the residual falls as far, candidate by candidate."""
    null = np.sum(list(space.sums.over_runs.null.values()), axis=0)
    right = dense.noise(7)
    before = dense.solve(right, drawn=True)[0]
    for trial in trials(space)[:4]:
        _, drops = space.regression.scores(trial.place, null)
        after = dense.solve(right, dense.column(trial.effect), drawn=True)[0]
        assert drops[7] == pytest.approx(before - after, rel=1e-5, abs=1e-5), trial.effect.key


def test_what_is_left_is_the_residual_of_the_fit_with_all_tolerances(space: ScoreTests, dense: Dense):
    """Sample by sample, of the measured run and of a simulated one; the ratios follow from both."""
    left = space.residual_beside([])
    measured, drawn = dense.solve(dense.base[2])[2], dense.solve(dense.noise(3), drawn=True)[2]
    start = 0
    for run, row in dense.parts():
        residual, draws = remainder_of(left, row)[run]
        n = residual.size
        np.testing.assert_allclose(residual, measured[start : start + n], atol=2e-6)
        np.testing.assert_allclose(draws[3], drawn[start : start + n], atol=2e-6)
        start += n
    for row, ratio in left.ratios.items():
        series = remainder_of(left, row).values()
        null = sum(np.mean(np.sum(draws**2, axis=1)) for _, draws in series)
        squares = sum(np.sum(residual**2) for residual, _ in series)
        assert ratio == pytest.approx(np.sqrt(squares / null), rel=1e-10)
        assert left.squares[row] == pytest.approx(squares - null, abs=1e-10 * squares)


def test_block_by_block_a_candidate_takes_off_what_it_takes_off_in_all(space: ScoreTests, dense: Dense):
    """Falls by block, the effective number of blocks, and likeness, from the dense residuals of columns and rows."""
    found = {c.key: c for c in space.try_all()}
    right = dense.base[2]
    left = dense.solve(right)[2]
    columns: dict[str, Array] = {}
    for key in ("anti_roll_bar.front", "coulomb.rear", "sensor_gain.hub.fl"):
        c, trial = found[key], space.best_tests[key].trial
        column = dense.solve(dense.column(trial.effect)[:, 0], drawn=True)[2]
        columns[key] = column
        moved = c.values[0] * column
        blocks = [dense.block == n for n in range(int(dense.block.max()) + 1)]
        fall = np.array([np.sum(2.0 * moved[b] * left[b] - moved[b] ** 2) for b in blocks])
        if c.tested:
            np.testing.assert_allclose(c.block_gain, fall, rtol=1e-4, atol=1e-4 * np.max(np.abs(fall)))
        energy = np.array([np.sum(column[b] ** 2) for b in blocks])
        assert c.coverage == pytest.approx(energy.sum() ** 2 / np.sum(energy**2), rel=1e-4)
    bar = found["anti_roll_bar.front"]
    assert bar.tested
    assert bar.answer is Answer.UNDECIDED
    assert bar.reason is None
    # The priors of zeros and tolerances take a share, small beside what the bar does.
    assert np.sum(bar.block_gain) == pytest.approx(bar.drop, rel=0.05)
    assert space.correlation("anti_roll_bar.front", "anti_roll_bar.front") == pytest.approx(1.0)
    A, P = dense.base[0], dense.prior
    wide = [np.concatenate([dense.column(space.best_tests[k].trial.effect)[:, 0], np.zeros(len(P))]) for k in columns]
    big = np.concatenate([A, P])
    lengths = np.linalg.norm(big, axis=0)
    Q = np.linalg.svd(big[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    basis = Q[0][:, Q[1] > 1e-12 * Q[1][0]]
    free = [w - basis @ (basis.T @ w) for w in wide]
    keys = list(columns)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        likeness = abs(free[i] @ free[j]) / np.linalg.norm(free[i]) / np.linalg.norm(free[j])
        assert space.correlation(keys[i], keys[j]) == pytest.approx(likeness, abs=1e-5)


class InMillimetres(type(KNOWN["anti_roll_bar.front"])):
    """The bar with its stiffness in N/mm."""

    name = "bar_in_millimetres"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A thousandth of the plausible stiffness."""
        return tuple(replace(q, low=1e-3 * q.low, high=1e-3 * q.high) for q in super().parameters)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """A thousand times the column."""
        return {row: 1000.0 * c for row, c in super().columns(motion).items()}


def test_a_unit_changes_the_value_and_nothing_else(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    bar = InMillimetres("front")
    own = silent(fitted, floor, [bar, *CANDIDATES[1:]])
    one, other = space.layout.trials[0].place, own.layout.trials[0].place
    for a, b in (
        (space.regression.scores(one, space.null)[0], own.regression.scores(other, own.null)[0]),
        (space.regression.fall(one), own.regression.fall(other)),
        (space.regression.values(one)[0][0], 1000.0 * own.regression.values(other)[0][0]),
        (space.regression.values(one)[1][0], 1000.0 * own.regression.values(other)[1][0]),
    ):
        assert b == pytest.approx(a, rel=1e-8)
    np.testing.assert_allclose(
        space.regression.scores(one, space.null)[1], own.regression.scores(other, own.null)[1], rtol=1e-6
    )


def test_intervals_are_those_of_the_normal_matrix(space: ScoreTests, dense: Dense):
    """1 σ of a candidate that the model does not hold already, from all columns' normal matrix with priors."""
    A, P = dense.base[0], dense.prior
    trial = next(t for t in trials(space) if t.effect.key == "anti_roll_bar.front")
    C = dense.column(trial.effect)
    big = np.concatenate([np.column_stack([A, C]), np.column_stack([P, np.zeros((len(P), 1))])])
    lengths = np.linalg.norm(big, axis=0)
    used = lengths > 0.0
    N = (big[:, used] / lengths[used]).T @ (big[:, used] / lengths[used])
    spread = float(np.sqrt(np.linalg.pinv(N)[-1, -1])) / lengths[-1]
    assert space.regression.values(trial.place)[1][0] == pytest.approx(spread, rel=1e-4)


def test_a_run_in_pieces_is_ranked_as_the_whole(monkeypatch: pytest.MonkeyPatch):
    """Pieces differ by filter transients and their own slopes, beside the same simulated noise."""
    run = cars.piece("rough", 0.0, 9.0)
    model = Model.of(e for e in KNOWN.values() if e.base)
    at_once = fit(model, [PreparedRun.of(run, VEHICLE, RIG)], FitOptions(unbias=False))
    noise = floor_of(at_once, DRAWS)
    whole = silent(at_once, noise, CANDIDATES)
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 5.0)
    drive = PreparedRun.of(run, VEHICLE, RIG)
    assert len(list(drive.pieces())) == 2
    parts = silent(fit(model, [drive], FitOptions(unbias=False)), noise, CANDIDATES)
    assert [t.effect for t in parts.layout.trials] == [t.effect for t in whole.layout.trials]
    for a, b in zip(trials(whole), trials(parts), strict=True):
        for measure in ("drop", "fall"):
            one, other = (size(s, t.place, measure) for s, t in ((whole, a), (parts, b)))
            assert other == pytest.approx(one, rel=0.02, abs=1.0), (a.effect.key, measure)
    one, other = (s.residual_beside([]) for s in (whole, parts))
    for row in one.squares:
        (residual, draws), (its, drawn) = remainder_of(one, row)[0], remainder_of(other, row)[0]
        assert np.std(drawn - draws) < 0.05 * np.std(draws), row
        assert np.std(its - residual) < 0.05 * np.std(residual), row
    order = [
        [c.key for c in sorted(s.try_all(), key=lambda c: -c.drop) if c.tested and c.drop > 20.0]
        for s in (whole, parts)
    ]
    assert order[0] == order[1]


def size(space: ScoreTests, place: slice, what: str) -> float:
    """Fall on all data, or in cross-validation."""
    return space.regression.fall(place) if what == "fall" else space.regression.scores(place, space.null)[0]


def test_noise_in_the_columns_is_kept_exactly(fitted: Fit, floor: NoiseFloor):
    """There and back through plain arrays; used again it gives the same diagnosis bit for bit; for others, nothing."""
    candidates = [*CANDIDATES[:6], KNOWN["anti_roll_bar.rear"]]  # nothing is unlisted beside both bars
    first = diagnose(fitted, floor, candidates)
    back = RegressorNoise.from_arrays(first.noise.arrays())
    assert back.labels == first.noise.labels
    assert len(back.runs) == len(first.noise.runs) == 2
    for kept, drawn in zip(back.runs, first.noise.runs, strict=True):
        assert (kept.run, kept.rows.keys()) == (drawn.run, drawn.rows.keys())
        for name in ("priors", "values"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(drawn, name))
        for row, one in drawn.rows.items():
            for name in ("places", "products", "across"):
                np.testing.assert_array_equal(getattr(kept.rows[row], name), getattr(one, name))
                assert np.any(getattr(one, name))
    again = diagnose(fitted, floor, candidates, noise=back)
    assert again.noise is back
    assert (says(again), again.candidates[0].drop, again.noise_ratio) == (
        says(first),
        first.candidates[0].drop,
        first.noise_ratio,
    )
    for a, b in zip(again.candidates, first.candidates, strict=True):
        assert (a.key, a.p, a.drop, a.gain, a.values, a.interval) == (b.key, b.p, b.drop, b.gain, b.values, b.interval)
    fewer = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES[:4], 0, back)
    assert fewer.noise is not back
    assert max(int(np.max(one.places)) for run in fewer.noise.runs for one in run.rows.values()) == fewer.layout.right


def test_fewer_sums_are_the_same_sums(fitted: Fit, floor: NoiseFloor):
    """Partial regression and simulated runs do not depend on which other sums were made."""
    space = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)
    tried = [KNOWN["anti_roll_bar.front"], KNOWN["tyre_damping.front"]]
    every, folds, drawn, total = (space.beside(tried, extent)[0] for extent in Extent)
    for fewer in (folds, drawn, total):
        np.testing.assert_allclose(fewer.reduced, every.reduced, rtol=1e-10, atol=1e-10 * np.max(np.abs(every.reduced)))
        assert not fewer.sums.over_runs.rows
    assert not len(drawn.sums.over_runs.train)
    assert not len(total.sums.over_runs.train)
    for name in ("train", "test"):
        one, other = (getattr(known.sums.over_runs, name) for known in (folds, every))
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.max(np.abs(other)))
    for row, null in every.sums.over_runs.null.items():
        for fewer in (folds, drawn):
            own = fewer.sums.over_runs.null[row]
            np.testing.assert_allclose(own, null, rtol=1e-10, atol=1e-10 * np.max(np.abs(null)))
    assert len(every.sums.over_runs.train) == SELECTION.folds


def test_sums_are_added_in_their_own_arrays_and_merged_in_others(space: ScoreTests):
    """Beside the sums of a run no third ones are made; parts that are merged elsewhere stay as they are."""
    part = space.sums.over_runs
    sums, whole = deepcopy(part), deepcopy(part)
    once = sums.added_to(part)
    assert once.total is sums.total
    row = next(iter(part.rows))
    assert once.rows[row].columns is sums.rows[row].columns
    assert once.null[row] is sums.null[row]
    assert len(once.zero_gains) == 2 * len(part.zero_gains)
    twice = SumsOfRuns.merged([part, part])
    for name in ("total", "train", "test", "null_sheet"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name))
        np.testing.assert_array_equal(getattr(twice, name), 2.0 * getattr(part, name))
        np.testing.assert_array_equal(getattr(once, name), getattr(twice, name))
    np.testing.assert_array_equal(twice.rows[row].columns, 2.0 * part.rows[row].columns)
    np.testing.assert_array_equal(part.rows[row].columns, whole.rows[row].columns)
    np.testing.assert_array_equal(twice.acting[row], part.acting[row])


def test_noise_is_computed_beside_selected_effects_too(fitted: Fit, floor: NoiseFloor):
    """A selected effect with the constants of its candidate has the same column, and the same noise in it."""
    space = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)
    anew = ScoreTests(space.given([KNOWN["coulomb.rear"].shapes()[0]]).columns, noise_ratio=space.noise_ratio)
    (mine,) = (trial.place for trial in anew.columns.selected)
    candidate = next(trial.place for trial in anew.layout.trials if trial.effect.key == "coulomb.rear")
    noise = anew.column_noise
    assert noise[mine, mine] != 0.0
    np.testing.assert_allclose(noise[mine], noise[candidate], rtol=0.0, atol=1e-9 * np.max(np.abs(noise[mine])))
