"""What the sensor sheet takes up, and when it would have to be wrong: scales that are off, and a fault set free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lacet.identify.effects.base import Effect
from lacet.identify.properties.known_scale import KnownScale
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.joint.subset_search import search
from lacet.identify.selection.laws.formulas import propose
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import FreeEntry, ToleranceUse
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.verdicts import says
from tests.identify.cars import RATE
from tests.identify.exact_car import KNOWN, RIG, driven, exact, fit_of

TRIED = [KNOWN[key] for key in ("anti_roll_bar.front", "coulomb.rear", "tyre_damping.front", "engine_mount")]
FAULT = KNOWN["sensor_gain.force.rr"]


def with_scales(fitted: Fit, tolerances: dict[str, tuple[float, float, float]]) -> Fit:
    """The run of `fitted` measured with each corner's force scales wrong by so many of their tolerances."""
    record = exact()
    changed = {
        f"wheel.{corner}.force": record.signals.value[f"wheel.{corner}.force"]
        * (1.0 + RIG.tolerance(f"wheel.{corner}.force", "gain") * np.array(off)[:, None])
        for corner, off in tolerances.items()
    }
    return fit_of(driven(record.with_signals(record.signals.changed(changed, RATE)), 7), fitted)


@pytest.fixture(scope="module")
def one_off(fitted: Fit) -> Fit:
    """One scale of one wheel off by five tolerances."""
    return with_scales(fitted, {"rr": (0.0, 0.0, 5.0)})


@pytest.fixture(scope="module")
def many_off(fitted: Fit) -> Fit:
    """Scales of all wheels off, each its own way: no fault of the catalogue is like this."""
    up, down = (0.0, 8.0, 8.0), (0.0, -8.0, -8.0)
    return with_scales(fitted, {"fl": up, "fr": down, "rl": down, "rr": up})


def test_what_the_sheet_is_stretched_to_is_told(fitted: Fit, floor: NoiseFloor, one_off: Fit):
    """A scale five tolerances off, beside candidates that do not know of it: nothing missing, and a look is advised."""
    space = ScoreTests.of(Linearisation.of(one_off, floor), TRIED, 0)
    assert space.tolerance_use().sizes["gain of wheel.rr.force.z"] > 3.0
    found = diagnose(one_off, floor, TRIED, noise=space.noise)
    assert found.verdict == "nothing missing", says(found)
    assert "gain of wheel.rr.force.z +" in says(found)
    worst = max(found.ratios, key=lambda row: found.ratios[row])
    assert "In the runs as recorded" not in says(found)
    high = says(replace(found, ratios={**found.ratios, worst: 2.0}))
    assert f"In the runs as recorded {worst} is at 2.00, and at {found.grounds.ratios[worst]:.2f} without" in high
    right = ScoreTests.of(Linearisation.of(fitted, floor), TRIED, 0, space.noise)
    sheet = right.tolerance_use()
    assert max(map(abs, sheet.sizes.values())) < 3.0
    assert not sheet.tolerance_exceeded
    sound = says(diagnose(fitted, floor, TRIED, noise=space.noise))
    assert "off by more than" not in sound
    assert "In the runs as recorded" not in sound


@pytest.fixture(scope="module")
def far_off(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    """Beside all scales of one wheel that are off by thirty tolerances."""
    wrong = with_scales(fitted, {"rr": (30.0, 30.0, 30.0)})
    return ScoreTests.of(Linearisation.of(wrong, floor), [*TRIED, FAULT], 0)


def test_chance_of_a_fault_is_that_of_its_size_in_a_fit_without_tolerances(far_off: ScoreTests):
    """Against the spread of such fits in simulated runs, whose instruments err within the sheet."""
    known, right = far_off.regression, far_off.layout.right
    kept = [i for i in range(len(known.nuisance)) if i not in far_off.columns.tolerances]
    there, place = known.nuisance[kept], far_off.best_tests[FAULT.key].trial.place.start
    normal = known.total[np.ix_(there, there)] + known.prior[np.ix_(kept, kept)]
    gain = np.linalg.lstsq(normal, known.total[there], rcond=None)[0]
    energy, score = (known.total[place, at] - known.total[there, place] @ gain[:, at] for at in (place, right))
    sizes = (far_off.null[place] - gain[:, place] @ far_off.null[there]) / energy
    ratio = score / energy / np.sqrt(np.mean(sizes**2))
    assert score / energy == pytest.approx(30.0 * RIG.tolerance("wheel.rr.force", "gain"), rel=0.1)
    assert far_off.chance_of_faults.keys() == {FAULT.key}
    chance = far_off.chance_of_faults[FAULT.key]
    assert chance > 0.0
    assert chance == pytest.approx(2.0 * scipy.stats.norm.sf(abs(ratio)), rel=1e-6, abs=0.0)


@pytest.mark.parametrize(("chance", "found"), [(None, [FAULT.key]), (0.02, [])])
def test_a_search_leaves_out_a_fault_that_the_sheet_makes_as_large(
    far_off: ScoreTests, monkeypatch: pytest.MonkeyPatch, chance: float | None, found: list[str]
):
    if chance is not None:
        monkeypatch.setitem(vars(far_off), "chance_of_faults", {FAULT.key: chance})
    assert [*search(far_off, far_off.family_wise(far_off.try_all())).keys] == found


@pytest.mark.parametrize("tried", [TRIED, [*TRIED, FAULT]], ids=["no fault tried", "one fault tried"])
def test_a_sheet_that_is_wrong_in_many_places_is_no_fault_of_one(floor: NoiseFloor, many_off: Fit, tried: list[Effect]):
    found = diagnose(many_off, floor, tried)
    assert found.verdict == "unlisted cause", says(found)
    assert found.best is None
    assert "only if the sensor sheet is wrong" in says(found)
    assert "gain of wheel." in says(found)
    assert "one entry alone" not in says(found)
    assert "None" not in says(found)
    assert not any(word in says(found) for word in ("the scale", "what is assumed"))


def test_where_the_scale_is_hardly_known_the_sheet_need_not_be_wrong(
    floor: NoiseFloor, many_off: Fit, monkeypatch: pytest.MonkeyPatch
):
    weak = KnownScale(("spring_rate.front",), 0.01, related=False)
    monkeypatch.setattr("lacet.identify.selection.columns.ranked_runs.known_scale", lambda *_: weak)
    text = says(diagnose(many_off, floor, TRIED[:1]))
    assert (
        "or it is the scale, which is hardly known (these runs do not relate any spring or damper to spring_rate.fr"
        in text
    )


def test_where_no_row_fails_laws_are_sought_in_the_rows_that_tolerances_hide(
    floor: NoiseFloor, many_off: Fit, monkeypatch: pytest.MonkeyPatch
):
    asked: list[list[str]] = []
    monkeypatch.setattr("lacet.identify.selection.diagnose.propose", lambda space, rows: asked.append(list(rows)) or [])
    above = {row: ratio**2 - 1.0 for row, ratio in diagnose(many_off, floor, TRIED).ratios.items()}
    assert asked == [[row for row in above if above[row] >= 0.5 * max(above.values())]]
    assert len(asked[0]) < len(above)
    assert propose(ScoreTests.of(Linearisation.of(many_off, floor), TRIED, 0), []) == []


def test_tolerances_are_what_all_unknowns_together_make_of_them(space: ScoreTests):
    """Normal equations with all of the sheet among the unknowns."""
    known, right = space.regression, space.layout.right
    normal = known.total[np.ix_(known.nuisance, known.nuisance)] + known.prior
    solved = np.linalg.solve(normal, known.total[known.nuisance, right])
    said = space.tolerance_use()
    expected = [
        float(size) / space.columns.sigma[place]
        for place, size in zip(known.nuisance.tolist(), solved, strict=True)
        if place >= space.layout.model
    ]
    np.testing.assert_allclose(list(said.sizes.values()), expected, rtol=1e-5, atol=1e-7)
    latency_tolerances = [size for name, size in said.sizes.items() if name.startswith("latency")]
    assert latency_tolerances
    assert said.squares == pytest.approx(np.sum(np.square(expected)) - np.sum(np.square(latency_tolerances)))


def test_one_gain_far_off_is_told_as_the_entry_that_alone_would_do(fitted: Fit, floor: NoiseFloor):
    """One of a wheel's three forces reads too much: no fault of the catalogue, and one line of the sheet."""
    wrong = with_scales(fitted, {"rr": (0.0, 0.0, 15.0)})
    space = ScoreTests.of(Linearisation.of(wrong, floor), TRIED[:1], 0)
    known, said = space.regression, space.tolerance_use()
    assert said.tolerance_exceeded
    first = said.free[0]
    assert first.name == "gain of wheel.rr.force.z"
    assert abs(first.size - 15.0) < 2.0 * first.spread
    # Its values are those of all unknowns together, without the prior of this one.
    position = [*said.sizes].index(first.name) + space.layout.model
    prior = known.prior.copy()
    prior[position, position] = 0.0
    inverse = np.linalg.inv(known.total[np.ix_(known.nuisance, known.nuisance)] + prior)
    sigma = space.columns.sigma[int(known.nuisance[position])]
    solved = inverse @ known.total[known.nuisance, space.layout.right]
    assert first.size == pytest.approx(solved[position] / sigma, rel=1e-5)
    assert first.spread == pytest.approx(np.sqrt(inverse[position, position]) / sigma, rel=1e-5)
    others = [i for i, name in enumerate(said.sizes) if not name.startswith("latency") and name != first.name]
    sizes = solved[space.layout.model :] / [
        space.columns.sigma[p] for p in known.nuisance[space.layout.model :].tolist()
    ]
    assert first.squares == pytest.approx(np.sum(sizes[others] ** 2), rel=1e-5)
    assert [one.squares for one in said.free] == sorted(one.squares for one in said.free)
    text = says(diagnose(wrong, floor, TRIED[:1], noise=space.noise))
    assert "If one entry alone is wrong it is gain of wheel.rr.force.z by +" in text


def test_an_entry_beyond_what_its_fault_can_be_is_not_offered(fitted: Fit, floor: NoiseFloor):
    """A force that reads a third too much: no transducer's gain."""
    wrong, gain = with_scales(fitted, {"rr": (0.0, 0.0, 120.0)}), KNOWN["sensor_gain.force.rr"]
    rig, name = wrong.runs[0].recording.rig, "gain of wheel.rr.force.z"
    assert gain.parameters[0].largest < 100.0 * gain.sheet_bound(rig)
    assert FreeEntry(name, -10.0, 2.0, 0.0).size_at_least == pytest.approx(10.0 - 2.0 * SELECTION.interval_quantile)
    for tried, offered in (([], True), ([gain], False)):
        use = ScoreTests.of(Linearisation.of(wrong, floor), [*TRIED[:1], *tried], 0).tolerance_use()
        assert use.tolerance_exceeded
        assert (name in [one.name for one in use.free]) == offered


def test_simulated_runs_are_treated_as_the_runs_are(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """Were a simulated run the measured one, the sheet would take up its squares."""
    known, right = space.regression, space.layout.right
    normal = known.total[np.ix_(known.nuisance, known.nuisance)] + known.prior
    said = space.tolerance_use()
    for draw in (0, 5):
        gain = known.gain.copy()
        gain[:, right] = np.linalg.solve(normal, space.null[known.nuisance, draw])
        monkeypatch.setattr(known, "gain", gain)
        assert space.tolerance_use().squares == pytest.approx(said.null[draw], rel=1e-6)


def test_more_than_any_simulated_run_and_than_twice_their_mean():
    null = np.array([10.0, 20.0, 30.0])
    assert not ToleranceUse({}, 39.0, null).tolerance_exceeded
    assert ToleranceUse({}, 41.0, null).tolerance_exceeded
    assert not ToleranceUse({}, 49.0, np.array([10.0, 10.0, 50.0])).tolerance_exceeded
