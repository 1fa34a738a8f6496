"""Rows that fail by little are looked at again: latencies within tolerance, and the floor where the sheet leads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection import diagnose as ranking
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
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
    closer = relinearise(space.linearisation, largest_phase=SELECTION.settled_phase)
    assert closer.latencies
    spaces = [ScoreTests.of(linearisation, TRIED, 0, space.noise) for linearisation in (space.linearisation, closer)]
    left = [s.residual_beside([]).ratios for s in spaces]
    assert left[1]["chassis.fx"] < 0.3 * left[0]["chassis.fx"]
    assert relinearise(closer, largest_phase=SELECTION.settled_phase) is closer


def test_what_the_sheet_leads_to_is_no_other_model(fitted: Fit, floor: NoiseFloor):
    """Where the sheet holds, the floor there is the floor."""
    space = ScoreTests.of(Linearisation.of(fitted, floor), TRIED, 0)
    there = floor_at(fitted, space.tolerated_parameters, DRAWS).sigma
    for row, sigma in floor.sigma.items():
        assert there[row] == pytest.approx(sigma, rel=0.05), row


def test_a_rest_in_a_floor_that_is_too_low_is_looked_at_again(
    fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    """Before it is called unlisted, the floor is simulated where the sheet leads."""
    monkeypatch.setattr(ranking, "relinearised", lambda joint, seed, progress: joint)
    monkeypatch.setattr("lacet.identify.selection.rest.excess_is_coloured", lambda lack: True)
    said: list[str] = []
    low = scaled(floor, 1.0 / 1.3)
    found = diagnose(fitted, low, TRIED, progress=in_words(said.append))
    assert AGAIN in said
    assert found.verdict == "nothing missing", says(found)
    assert max(found.grounds.ratios.values()) < 1.15


@pytest.mark.parametrize("bent", [False, True])
def test_an_effect_is_looked_at_again_where_latencies_may_have_made_it(
    fitted: Fit, floor: NoiseFloor, bent: bool, monkeypatch: pytest.MonkeyPatch
):
    """What first-order columns leave of latencies is far less than a law that lifts its rows above their floor."""
    said: list[str] = []
    latencies = recording_without_faults(
        exact_with(HIDDEN, 0.12 * SIZE), [KNOWN["sensor_latency.imu"]], np.array([-0.0015])
    )
    off = fit_of(driven(latencies, 1), fitted)
    if bent:
        monkeypatch.setattr(ranking, "SELECTION", replace(SELECTION, second_order_share=1e-6))
    found = diagnose(off, floor, [HIDDEN, *CANDIDATES[:2]], progress=in_words(said.append))
    assert any("read again" in line for line in said) == bent
    assert [c.key for c in found.found] == [HIDDEN.key], says(found)
