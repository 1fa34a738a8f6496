"""What the ranking takes for chance, noise and structure: on a car that is exactly its model, with simulated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
from exact_car import KNOWN, MODEL, RIG, SECONDS, VEHICLE, driven, exact, exact_with, fit_of

from identify.candidate import Candidate
from identify.column_noise import NOISE_PAIRS, ColumnNoise
from identify.diagnose import Diagnosis, diagnose, structured
from identify.drive import Drive
from identify.effect import Effect
from identify.fit import Fit, fit
from identify.floor import NoiseFloor, floor_of
from identify.freed import Freed
from identify.lack_of_fit import Left
from identify.one_line import read_line
from identify.one_line_effect import effect_class
from identify.partialling import Partialled, at_gain
from identify.ties import same_losses, with_ties
from identify.trial_sums import columns_of
from identify.trials import TrialSpace
from identify.unlisted import left_by
from identify.vectors import Array
from identify.verdicts import SIGNIFICANCE, judged

CANDIDATES = [
    KNOWN[key]
    for key in (
        "coulomb.front", "spring_quadratic.front", "spring_cubic.front", "damper_stroke.front",
        "damper_asymmetry.front", "damper_hysteresis.front", "damper_digressive.front", "anti_roll_bar.front",
        "tyre_damping.rear", "sensor_gain.hub.fl",
    )
]  # fmt: skip
DRAWS = 39
LAW = "travel**2*tanh(rate/v0), v0 = 0.03 m/s"
HIDDEN = effect_class(read_line(f"hidden = suspension: p * {LAW}")).variants(VEHICLE, "hub")[0]
SIZE = 60000.0
"""Of the hidden law [N/m²]: some 30 N RMS where 6 N are noise."""


@pytest.fixture(scope="module")
def fitted() -> Fit:
    """The model on a run that lacks nothing."""
    return fit_of(driven(exact(), 0))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    """The floor of that motion."""
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> TrialSpace:
    """Candidates on it."""
    return TrialSpace(fitted, floor, CANDIDATES, 0)


@pytest.fixture(scope="module")
def found(space: TrialSpace) -> list[Candidate]:
    """What is said of each before chance is looked at."""
    return [c for c in space.try_all() if c.tested]


@pytest.fixture(scope="module")
def unlisted() -> Fit:
    """The model on a run of a car with a law that is in no catalogue."""
    return fit_of(driven(exact_with(HIDDEN, SIZE), 1))


@pytest.fixture(scope="module")
def hidden(unlisted: Fit, floor: NoiseFloor) -> Diagnosis:
    """Its diagnosis."""
    return diagnose(unlisted, floor, CANDIDATES)


# -- chance -----------------------------------------------------------------------------------------------------------


def test_the_best_of_every_simulated_run_has_a_rank_of_its_own(space: TrialSpace, found: list[Candidate]):
    """Put in the place of the measured run, D simulated ones have least p of 2/(D + 1), 3/(D + 1) … 1: uniform."""
    least = []
    for draw in range(DRAWS):
        drops = [replace(c, drop=float(space.tried[c.key].null[draw])) for c in found]
        least.append(min(c.p for c in space.family_wise(drops)))
    np.testing.assert_allclose(np.sort(least), np.arange(2, DRAWS + 2) / (DRAWS + 1))


def test_p_falls_with_the_drop_and_is_never_zero(space: TrialSpace, found: list[Candidate]):
    levels = [0.0, *np.geomspace(0.01, 1e6, 30)]
    p = np.array([[c.p for c in space.family_wise([replace(c, drop=level) for c in found])] for level in levels])
    assert np.all(np.diff(p, axis=0) <= 0.0)
    assert np.all(p[0] == 1.0)
    assert np.all(p[-1] == pytest.approx(1.0 / (DRAWS + 1)))


def test_nothing_is_missing_from_a_car_that_is_its_model(fitted: Fit, floor: NoiseFloor, space: TrialSpace):
    found = diagnose(fitted, floor, CANDIDATES, noise=space.noise)
    assert found.verdict == "nothing missing", found.says
    assert all(ratio < 1.3 for ratio in found.louder.values()), found.louder
    assert not found.formulas
    assert not structured(left_by(space, []))


def test_noise_twice_as_loud_as_the_sheet_is_no_effect(fitted: Fit, floor: NoiseFloor, space: TrialSpace):
    loud = fit_of(driven(exact(), 2, loud=2.0), fitted)
    found = diagnose(loud, floor, CANDIDATES, noise=space.noise)
    assert found.verdict == "nothing missing", found.says
    assert np.mean(list(found.louder.values())) == pytest.approx(2.0, abs=0.15)
    assert all(1.5 < ratio < 2.5 for ratio in found.louder.values()), found.louder
    assert set(found.failing) == set(floor.sigma)
    assert min(c.p for c in found.candidates) > SIGNIFICANCE
    noisy = TrialSpace(loud, floor, CANDIDATES, 0, space.noise)
    assert not structured(left_by(noisy, []))
    noisy.try_all()
    growth = [np.mean(noisy.tried[c.key].null) / np.mean(space.tried[c.key].null) for c in space.try_all() if c.tested]
    assert 3.0 < np.median(growth) < 5.0  # simulated runs are as loud
    assert "noisier than their sheet" in found.says


def test_a_hidden_sine_force_is_structure(fitted: Fit, floor: NoiseFloor, space: TrialSpace):
    record = driven(exact(), 3).recording
    values = dict(record.signals.value)
    force = values["wheel.fl.force"].copy()
    force[2] += 60.0 * np.sin(2 * np.pi * 1.7 * record.t)
    values["wheel.fl.force"] = force
    spoilt = fit_of(Drive(record.with_signals(replace(record.signals, value=values))), fitted)
    left = left_by(TrialSpace(spoilt, floor, CANDIDATES, 0, space.noise), [])
    assert "suspension.fl" in left.above
    assert structured(left)
    assert left.chance(left.above) == 1.0 / (1 + DRAWS)


def test_rows_together_are_compared_with_the_same_rows_of_simulated_runs(space: TrialSpace):
    """A simulated run has its own rank; and weak excesses add up, as those of simulated runs do not."""
    left = left_by(space, [])
    rows = list(left.ratios)
    together = np.sum(list(left.null.values()), axis=0)
    for rank, draw in enumerate(np.argsort(-together), start=1):
        own = replace(left, squares={row: float(left.null[row][draw]) for row in rows})
        assert own.chance(rows) == pytest.approx((1 + rank) / (1 + DRAWS))
    assert left.excess(rows) == pytest.approx(sum(left.excess([row]) for row in rows))
    spread = {row: float(np.std(left.null[row])) for row in rows}
    weak = replace(left, squares={row: 1.2 * spread[row] for row in rows})
    alone = np.median([weak.chance([row]) for row in rows])
    assert alone > 0.05
    assert weak.chance(rows) < 0.5 * alone


@pytest.mark.parametrize(("total_gain", "verdict"), [(1.0, "missing"), (0.1, "unlisted cause")])
def test_what_explains_little_of_what_fails_is_not_named(
    unlisted: Fit, floor: NoiseFloor, total_gain: float, verdict: str, monkeypatch: pytest.MonkeyPatch
):
    """The law is in the catalogue and explains all together; named is what explains a fair part by itself."""
    measured = TrialSpace.try_all

    def weaker(space: TrialSpace) -> list[Candidate]:
        return [replace(c, total_gain=total_gain * c.total_gain) for c in measured(space)]

    monkeypatch.setattr(TrialSpace, "try_all", weaker)
    assert diagnose(unlisted, floor, [HIDDEN, *CANDIDATES[:2]]).verdict == verdict


@pytest.mark.parametrize(("rest", "verdict"), [(0.1, "missing"), (0.4, "unlisted cause")])
def test_a_rest_above_chance_calls_for_another_cause(
    unlisted: Fit, floor: NoiseFloor, rest: float, verdict: str, monkeypatch: pytest.MonkeyPatch
):
    """Six tenths explained are enough where chance leaves the others, and not where it does not."""
    measured = left_by

    def leaving(space: TrialSpace, added: Sequence[Effect]) -> Left:
        found = measured(space, added)
        before = measured(space, []).squares
        return replace(found, squares={row: rest * a for row, a in before.items()}) if added else found

    monkeypatch.setattr("identify.diagnose.left_by", leaving)
    assert diagnose(unlisted, floor, [HIDDEN, *CANDIDATES[:2]]).verdict == verdict


@pytest.mark.parametrize(("correlation", "tied"), [(0.99, True), (0.9, False)])
def test_one_law_with_two_names_is_a_tie_whatever_its_losses(correlation: float, tied: bool):
    losses = np.random.default_rng(4).uniform(5.0, 9.0, 12)
    a, b = (Candidate(key, {}, "missing", block_gain=gain) for key, gain in (("a", losses), ("b", 0.9 * losses)))
    assert not same_losses(a.block_gain, b.block_gain)
    told = with_ties([a, b], SimpleNamespace(correlation=lambda *_: correlation))
    assert [bool(c.ties) for c in told] == [tied, tied]


def test_losses_that_differ_in_most_blocks_are_no_tie():
    rng = np.random.default_rng(4)
    one = rng.uniform(5.0, 9.0, 12)
    assert same_losses(one, one)
    assert same_losses(one, one + np.where(np.arange(12) % 2, 0.5, -0.5))
    assert same_losses(one, np.append(one[:-5], one[-5:] - 2.0))  # five blocks say nothing
    assert not same_losses(one, one - rng.uniform(0.5, 1.0, 12))
    assert not same_losses(one - rng.uniform(0.5, 1.0, 12), one)


# -- noise in the columns ---------------------------------------------------------------------------------------------


def test_without_noise_nothing_is_shifted(fitted: Fit, floor: NoiseFloor, space: TrialSpace):
    """A hundredth of the noise shifts sums by its square."""
    rig = replace(RIG, sensors=tuple(replace(s, noise={k: 0.01 * v for k, v in s.noise.items()}) for s in RIG.sensors))
    quiet = fit(MODEL, [Drive(replace(fitted.drives[0].recording, rig=rig))], unbias=False)
    calm = ColumnNoise.of(quiet, TrialSpace(quiet, floor, CANDIDATES, 0, space.noise).sums, floor.sigma)
    assert calm.labels == space.noise.labels
    for row, total in space.noise.totals.items():
        assert total.shape == 2 * (space.layout.width,)
        small, large = (np.diag(a)[:-1] for a in (calm.totals[row], total))
        assert np.any(large > 0.0)
        assert np.all(np.abs(small) <= 1e-2 * np.abs(large) + 1e-9), row


def test_noise_is_what_the_same_draws_do_sample_by_sample(space: TrialSpace, fitted: Fit, floor: NoiseFloor):
    """Products of each candidate with the residual, everything else taken out, with the draws and without them."""
    sums, layout = space.sums, space.layout
    places = [t.place.start for t in layout.trials]
    combined = np.zeros((layout.width, len(places) + 1))
    combined[places, range(len(places))] = 1.0
    combined[layout.right, -1] = 1.0
    combined = space.partialled.coefficients(combined)
    taken = sums.following[0] @ combined
    combined[: layout.model] = sums.turn @ combined[: layout.model]
    (piece,) = fitted.assembly.pieces_of(0)
    zeros = {row: block[:, : len(taken)] * fitted.zeros[0][1] / sums.temper for row, block in piece.blocks.items()}

    def products(noisy: Drive | None) -> dict[str, Array]:
        out = {}
        for row, (columns, active) in columns_of(fitted, layout, piece, floor.sigma, noisy):
            columns[:, -1] -= columns[:, : layout.model] @ fitted.solution
            series = columns @ combined[active] - zeros[row] / floor.sigma[row] @ taken
            out[row] = series[:, :-1].T @ series[:, -1]
        return out

    before = products(None)
    found = {row: np.zeros(len(places)) for row in before}
    for draw in range(NOISE_PAIRS):
        for sign in (1, -1):
            for row, after in products(piece.drive.noisy(draw, sign, [2003, 0, draw], loads=True)).items():
                found[row] += (after - before[row]) / (2 * NOISE_PAIRS)
    size = np.sqrt(np.diag(space.partialled.whole)[places])
    turn = scipy.linalg.block_diag(sums.turn, np.eye(layout.width - layout.model))
    for row, total in space.noise.totals.items():
        left = at_gain(turn.T @ total @ turn, space.partialled.taken, space.partialled.gain)
        np.testing.assert_allclose(left[places, -1] / size, found[row] / size, rtol=1e-4, atol=1e-5, err_msg=row)


def test_the_corrected_score_of_a_noisy_sensor_is_nearer_nothing(fitted: Fit, floor: NoiseFloor):
    """The scale of a laser whose noise is three times the sheet's: over eight runs that lack nothing."""
    tried = [KNOWN["sensor_gain.hub.fl"]]
    raw, corrected, noise = [], [], None
    free, sound_free = [], []
    for seed in range(8):
        space = TrialSpace(fit_of(driven(exact(), 20 + seed, 2.0), fitted), floor, tried, 0, noise)
        noise, place = space.noise, space.layout.trials[0].place.start
        without = Partialled(space.sums, space.partialled.taken, space.partialled.prior)
        size = np.sqrt(space.partialled.whole[place, place])
        raw.append(without.left[place, space.layout.right] / np.sqrt(without.left[place, place]))
        corrected.append(space.partialled.left[place, space.layout.right] / size)
        whole = slice(place, place + 1)
        assert space.partialled.scores(whole, space.null)[0] == pytest.approx(corrected[-1] ** 2)
        freed = space.freed[place]
        plain = Freed(without, place, freed.own)
        sound_free.append(freed.value * freed.energy / np.sqrt(freed.energy + freed.noise))
        free.append(plain.value * np.sqrt(plain.energy))
        assert freed.drop < freed.value**2 * freed.energy  # what the correction may be wrong by is not counted
        sound = space.partialled.left[place, place]
        assert space.partialled.values(whole)[0][0] == pytest.approx(corrected[-1] * size / sound)
    spread = np.std(raw) / np.sqrt(len(raw))
    assert np.mean(raw) > 3.0 * spread
    assert abs(np.mean(corrected)) < 0.5 * np.mean(raw)
    assert abs(np.mean(corrected)) < 3.0 * spread
    # The same where its own tolerance excuses none of it.
    assert np.mean(free) > 3.0 * np.std(free) / np.sqrt(len(free))
    assert abs(np.mean(sound_free)) < 0.5 * np.mean(free)


def test_noise_of_many_runs_is_that_of_some_scaled_up(
    fitted: Fit, floor: NoiseFloor, space: TrialSpace, monkeypatch: pytest.MonkeyPatch
):
    """Of four runs of one motion every other is looked at: what noise adds to squares is that of all four."""
    runs = [Drive(replace(driven(exact(), seed).recording, run=f"run{seed}")) for seed in (0, 31, 32, 33)]
    four = fit(MODEL, runs, draws=2)
    own = TrialSpace(four, floor_of(four, 3), CANDIDATES, 0, space.noise).sums
    looked = list[int]()
    whole = ColumnNoise.of(four, own, floor.sigma, progress=lambda _, total: looked.append(total))
    monkeypatch.setattr("identify.column_noise._SECONDS", 1.9 * SECONDS)
    some = ColumnNoise.of(four, own, floor.sigma, progress=lambda _, total: looked.append(total))
    assert (looked[0], looked[-1]) == (4 * NOISE_PAIRS, 2 * NOISE_PAIRS)
    places = [trial.place for trial in own.layout.trials]
    for row, total in whole.totals.items():
        all_, part = (np.array([np.trace(a[p, p]) for p in places]) for a in (total, some.totals[row]))
        large = all_ > 0.01 * np.max(all_)
        np.testing.assert_allclose(part[large], all_[large], rtol=0.2, err_msg=row)


def test_noise_is_taken_out_of_every_fold_by_its_share(space: TrialSpace):
    """Parts of the sums without noise are those of all without noise; a column's own stays in what it is judged by."""
    found = space.partialled
    np.testing.assert_allclose(found.inside.sum(axis=0), found.total + _at_other_zeros(space), atol=1e-6)
    for trial in space.layout.trials:
        k = trial.place
        plain, noise = 0.0, found.noise[k, k]
        for train, test in found.folds:
            beta = np.linalg.solve(train[k, k] + 0.8 * noise, train[k, -1])
            plain += 2.0 * beta @ test[k, -1] - beta @ (test[k, k] + 0.2 * noise) @ beta
        assert found.fall(k) == pytest.approx(float(plain), rel=1e-9), trial.effect.key


def _at_other_zeros(space: TrialSpace) -> Array:
    """What the zeros found outside of each fold add to the sums inside."""
    return space.sums.test.sum(axis=0) - space.sums.total


# -- a cause that is not listed ---------------------------------------------------------------------------------------


def test_a_law_of_no_catalogue_is_unlisted_and_its_formula_comes_first(hidden: Diagnosis):
    assert hidden.verdict == "unlisted cause", hidden.says
    assert hidden.best is None
    assert hidden.formulas
    first = hidden.formulas[0]
    assert first.text.startswith("suspension.front: p * travel**2*tanh(rate/v0), v0 = 0.03")
    assert set(first.rows) == {"suspension.fl", "suspension.fr"}
    assert first.gain > 0.8
    assert first.p == pytest.approx(1.0 / (DRAWS + 1))
    assert first.text in hidden.says
    assert set(hidden.failing) >= {"suspension.fl", "suspension.fr"}


def test_the_same_law_in_the_catalogue_is_missing(unlisted: Fit, floor: NoiseFloor):
    """As a one-line effect it is named, with its size."""
    found = diagnose(unlisted, floor, [*CANDIDATES[:3], HIDDEN])
    assert found.verdict == "missing", found.says
    assert found.best is not None
    assert found.best.key == "hidden.front"
    assert found.best.values[0] == pytest.approx(SIZE, abs=max(2.0 * found.best.interval[0], 0.05 * SIZE))
    assert not found.formulas


# -- wording ----------------------------------------------------------------------------------------------------------


def sentences(text: str) -> list[str]:
    """Parts that end with a full stop before a space, or at the end."""
    return [part for part in text.rstrip(".").split(". ") if part]


def test_every_answer_has_its_reason_with_numbers(hidden: Diagnosis, fitted: Fit, floor: NoiseFloor, space: TrialSpace):
    nothing = diagnose(fitted, floor, CANDIDATES, noise=space.noise)
    for c in (*hidden.candidates, *nothing.candidates):
        assert c.why.endswith("."), c.why
        assert len(sentences(c.why)) >= 2, c.why
        if c.tested:
            assert (" N RMS off " if c.gain > 0.0 else " takes nothing off ") in c.why, c.why
            assert "p = " in c.why, c.why
            assert c.why.startswith("Added to the model it takes "), c.why
        else:
            assert c.why.startswith("Cannot be tested: "), c.why
            assert "What shows it: " in c.why, c.why


def candidate(effect: Effect, **changed: object) -> Candidate:
    """A candidate that passes every bar."""
    plain = Candidate(
        effect.key, {}, rows=("suspension.fl", "suspension.fr"), gain=0.4, gain_rms=12.3, total_gain=900.0, drop=1000.0,
        p=1.0 / (DRAWS + 1), values=(40.0,), interval=(6.0,),
    )  # fmt: skip
    return replace(plain, **changed)


@pytest.mark.parametrize(
    ("changed", "answer", "says"),
    [
        ({}, "missing", ("12.3 N RMS off suspension.fl, suspension.fr", "40.0 ± 6 N", "never did as well in 39")),
        ({"p": 0.2}, "not needed", ("p = 0.2", "0.05")),
        ({"gain": 0.004}, "not needed", ("less than 1 %",)),
        ({"values": (-40.0,)}, "not needed", ("-40 ± 6 N", "plausible: 0 to 500", "which no car has")),
        ({"values": (-4.0,)}, "missing", ("-4.0 ± 6 N",)),
        ({"values": (900.0,)}, "not needed", ("900 ± 6 N",)),
    ],
)
def test_wording(changed: dict[str, object], answer: str, says: Sequence[str]):
    effect = KNOWN["coulomb.front"]
    told = judged(candidate(effect, **changed), effect, DRAWS)
    assert told.answer == answer, told.why
    assert len(sentences(told.why)) >= 2
    for part in says:
        assert part in told.why, (part, told.why)


def test_negative_friction_does_not_hide_in_the_best_set(
    space: TrialSpace, floor: NoiseFloor, fitted: Fit, monkeypatch: pytest.MonkeyPatch
):
    """A car with less friction than none: the ranking does not propose it."""
    record = driven(exact(), 4).recording
    friction = KNOWN["coulomb.front"]
    columns = friction.columns(fitted.drives[0].motion)
    values = dict(record.signals.value)
    for row, series in columns.items():
        name = f"wheel.{row.partition('.')[2]}.force"
        values[name] = values[name] - np.array([[0.0], [0.0], [1.0]]) * 120.0 * series
    spoilt = fit_of(Drive(record.with_signals(replace(record.signals, value=values))), fitted)
    monkeypatch.setattr("identify.diagnose.propose", lambda *_: [])  # the formulas are another test's
    found = diagnose(spoilt, floor, CANDIDATES, noise=space.noise)
    told = next(c for c in found.candidates if c.key == "coulomb.front")
    assert told.values[0] < -60.0
    assert told.answer == "not needed", told.why
    assert "which no car has" in told.why
    assert "coulomb.front" not in found.together
