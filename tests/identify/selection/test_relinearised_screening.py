"""Rows that fail by little are looked at again: latencies within tolerance, and the floor where the sheet leads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.progress import Progress
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection import diagnose as ranking
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import Screening, diagnose
from lacet.identify.selection.relinearisation import relinearise
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor, RunDraws, floor_at, floor_of
from lacet.services.render.progress import in_words
from lacet.services.render.verdicts import says
from tests.identify.cars import RATE
from tests.identify.exact_car import KNOWN, MODEL, RIG, driven, exact, exact_with, fit_of, later
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE
from tests.identify.selection.held import remainder_of

TRIED = [KNOWN["coulomb.rear"], KNOWN["anti_roll_bar.front"]]
AGAIN = "the noise floor at the parameters that the sensor sheet leads to"


def scaled(floor: NoiseFloor, factor: float) -> NoiseFloor:
    """Each draw so many times as large."""
    return NoiseFloor.of(
        [RunDraws.of({row: factor * draws for row, draws in part.series.items()}) for part in floor.draws]
    )


@pytest.fixture
def unlisted_at_first(monkeypatch: pytest.MonkeyPatch) -> list[ScoreTests]:
    """The first look at candidates calls what it sees unlisted; the spaces looked at."""
    seen: list[ScoreTests] = []

    def screen(space: ScoreTests, progress: Progress) -> Screening:
        seen.append(space)
        found = plain_screen(space, progress)
        return replace(found, unlisted=len(seen) == 1 and bool(found.now.above))

    plain_screen = ranking.screen
    monkeypatch.setattr(ranking, "screen", screen)
    monkeypatch.setattr(ranking, "propose", lambda *_: [])
    return seen


@pytest.mark.parametrize(
    ("factor", "again"), [(1.0, False), (1.0 / 1.12, True), pytest.param(1.0 / 1.6, True, marks=pytest.mark.slow)]
)
def test_a_floor_that_is_a_little_low_is_simulated_again(
    fitted: Fit, floor: NoiseFloor, factor: float, again: bool, unlisted_at_first: list[ScoreTests],
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    """By as much as other parameters may do, or where sensors are louder than their sheet; not where nothing fails."""
    monkeypatch.setattr(ranking, "_relinearised", lambda space, progress: space.linearisation)
    said: list[str] = []
    low = scaled(floor, factor)
    noise = ScoreTests.of(Linearisation.of(fitted, low), TRIED, 0).noise
    found = diagnose(fitted, low, TRIED, noise=noise, progress=in_words(said.append))
    assert (AGAIN in said) == again
    assert found.verdict == "nothing missing"
    assert found.noise is noise  # it is of this fit's zeros
    assert len(unlisted_at_first) == 1 + again
    if again:
        first, second = unlisted_at_first
        assert first.residual_beside([]).above
        assert second.floor.sigma == floor_at(fitted, first.tolerated_parameters, DRAWS).sigma
        assert second.fitted is fitted


@pytest.mark.parametrize(("size", "again"), [(0.12, True), (0.4, False)])
def test_a_cause_with_a_colour_is_looked_at_again_only_where_rows_fail_by_little(
    fitted: Fit, floor: NoiseFloor, size: float, again: bool, unlisted_at_first: list[ScoreTests]
):
    """What has a colour is no loud sensor, and latencies would be led far astray by it."""
    off = fit_of(driven(exact_with(HIDDEN, size * SIZE), 1), fitted)
    diagnose(off, floor, TRIED)
    first = unlisted_at_first[0].residual_beside([])
    assert first.above
    assert len(unlisted_at_first) == 1 + again
    assert again == (max(first.ratios.values()) < SELECTION.marginal_ratio)


@pytest.mark.parametrize(("bent", "fails"), [(False, True), (True, True), (True, False)])
def test_an_effect_is_looked_at_again_where_latencies_may_have_made_it(
    fitted: Fit, floor: NoiseFloor, bent: bool, fails: bool, monkeypatch: pytest.MonkeyPatch
):
    """A law that lifts its rows by a part of their floor; what first-order columns leave of latencies is far less.

    They can make an effect where no row fails: what they leave is spread over all of them.
    """
    said: list[str] = []
    latencies = recording_without_faults(
        exact_with(HIDDEN, 0.12 * SIZE), [KNOWN["sensor_latency.imu"]], np.array([-0.0015])
    )
    off = fit_of(driven(latencies, 1), fitted)
    if bent:
        monkeypatch.setattr(ranking, "SELECTION", replace(SELECTION, second_order_share=1e-6))
    if not fails:
        plain_screen = ranking.screen

        def quiet(space: ScoreTests, progress: Progress) -> Screening:
            found = plain_screen(space, progress)
            return replace(found, now=replace(found.now, p=dict.fromkeys(found.now.p, 1.0)))

        monkeypatch.setattr(ranking, "screen", quiet)
    found = diagnose(off, floor, [HIDDEN, *CANDIDATES[:2]], progress=in_words(said.append))
    assert bool(found.failing) == fails
    assert any("read again" in line for line in said) == bent
    assert found.best is not None, says(found)
    assert found.best.key == HIDDEN.key


def test_what_columns_leave_of_latencies_is_about_what_they_do(fitted: Fit):
    """Squares of what is left after the columns, for one instrument 3 ms late in a run without noise."""
    off = fit_of(later("sensor_latency.imu", 0.003, 5, 0.0), fitted)
    space = ScoreTests.of(Linearisation.of(off, floor_of(off, 9)), TRIED, 0)
    lack = space.residual_beside([])
    left = sum(float(np.sum(series**2)) for row in lack.squares for series, _ in remainder_of(lack, row).values())
    assert 0.3 * left < ranking._second_order_squares(space) < 30.0 * left


def test_the_sheet_leads_to_the_parameters_of_the_right_scale(fitted: Fit):
    """A scale five tolerances off: the fit's wheel stiffness goes with it, and where the sheet leads is nearer."""
    record, channel = exact(), "wheel.rr.force"
    record = record.with_signals(
        record.signals.changed(
            {channel: record.signals.value[channel] * (1.0 + 5.0 * RIG.tolerance(channel, "gain"))}, RATE
        )
    )
    off, right = fit_of(driven(record, 7, 0.0), fitted), fit_of(driven(exact(), 7, 0.0), fitted)
    space = ScoreTests.of(Linearisation.of(off, floor_of(off, 9)), TRIED, 0)
    names = [q.name for effect in MODEL.physics for q in effect.parameters]
    assert len(space.tolerated_parameters) == len(names)
    moved = [names.index(name) for name in ("spring.rr.k", "damper.rr.c")]
    assert np.all(np.abs(off.physics - right.physics)[moved] > 0.01 * right.physics[moved])
    assert np.all(
        np.abs(space.tolerated_parameters - right.physics)[moved] < 0.5 * np.abs(off.physics - right.physics)[moved]
    )


def test_latencies_within_tolerance_are_read_away_to_the_last(fitted: Fit):
    """A first-order column is right to a part of the noise; without noise that part is seen, and goes."""
    off = fit_of(later("sensor_latency.imu", 0.003, 5, 0.0), fitted)
    own = floor_of(off, 9)
    space = ScoreTests.of(Linearisation.of(off, own), TRIED, 0)
    assert not space.linearisation.latencies
    closer = ranking._relinearised(space, lambda _: None)
    assert closer.latencies
    spaces = [ScoreTests.of(linearisation, TRIED, 0, space.noise) for linearisation in (space.linearisation, closer)]
    left = [s.residual_beside([]).ratios for s in spaces]
    assert left[1]["chassis.fx"] < 0.3 * left[0]["chassis.fx"]
    assert ranking._relinearised(spaces[1], lambda _: None) is closer


def test_noise_of_other_zeros_is_not_used_where_runs_were_read_again(
    fitted: Fit, floor: NoiseFloor, unlisted_at_first: list[ScoreTests], monkeypatch: pytest.MonkeyPatch
):
    """What noise adds cancels in what the model explains at the zeros of its own fit only."""
    low = scaled(floor, 1.0 / 1.12)
    noise = ScoreTests.of(Linearisation.of(fitted, low), TRIED, 0).noise
    other = fit_of(later("sensor_latency.imu", 0.003, 0), fitted)
    closer = replace(relinearise(Linearisation.of(other, floor), largest_phase=SELECTION.settled_phase), floor=floor)
    assert closer.fitted is not fitted
    monkeypatch.setattr(ranking, "_relinearised", lambda space, progress: closer)
    found = diagnose(fitted, low, TRIED, noise=noise)
    assert len(unlisted_at_first) == 2
    own = unlisted_at_first[1].noise
    assert any(np.any(own.totals[row] != total) for row, total in noise.totals.items())
    assert found.noise is noise  # the next ranking begins at this fit again


def test_what_the_sheet_leads_to_is_no_other_model(fitted: Fit, floor: NoiseFloor):
    """Where the sheet holds, the floor there is the floor."""
    space = ScoreTests.of(Linearisation.of(fitted, floor), TRIED, 0)
    there = floor_at(fitted, space.tolerated_parameters, DRAWS).sigma
    for row, sigma in floor.sigma.items():
        assert there[row] == pytest.approx(sigma, rel=0.05), row
