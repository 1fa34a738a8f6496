"""Rows that fail by little are looked at again: latencies within tolerance, and the floor where the sheet leads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_car import KNOWN, MODEL, RIG, driven, exact, exact_with, fit_of, later
from exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE

from identify import diagnose as ranking
from identify.diagnose import diagnose
from identify.fit import Fit
from identify.floor import NoiseFloor, floor_at, floor_of
from identify.reading import STILL, Reading, read_again
from identify.trials import TrialSpace
from identify.unlisted import left_by

TRIED = [KNOWN["coulomb.rear"], KNOWN["anti_roll_bar.front"]]
AGAIN = "the noise floor at the parameters that the sensor sheet leads to"


def scaled(floor: NoiseFloor, factor: float) -> NoiseFloor:
    """Each draw so many times as large."""
    return NoiseFloor.of([{row: factor * draws for row, draws in part.items()} for part in floor.draws])


@pytest.mark.parametrize(("factor", "again"), [(1.0, False), (1.0 / 1.12, True), (1.0 / 1.6, False)])
def test_a_floor_that_is_a_little_low_is_simulated_again(
    fitted: Fit, floor: NoiseFloor, factor: float, again: bool, monkeypatch: pytest.MonkeyPatch
):
    """By as much as other parameters may do; not where nothing fails, nor where rows fail by more."""
    monkeypatch.setattr(ranking, "_read_closely", lambda space, tell: space.reading)
    told: list[str] = []
    low = scaled(floor, factor)
    noise = TrialSpace.of(Reading.of(fitted, low), TRIED, 0).noise
    found = diagnose(fitted, low, TRIED, noise=noise, tell=told.append)
    assert (AGAIN in told) == again
    assert bool(found.failing) == (factor < 1.0 and not again), found.failing
    assert found.noise is noise  # it is of this fit's zeros
    if again:
        space = TrialSpace.of(Reading.of(fitted, low), TRIED, 0, noise)
        assert left_by(space, []).above
        second = ranking._with_its_floor(space, told.append)
        own = floor_at(fitted, space.led, DRAWS)
        assert second.floor.sigma == own.sigma
        assert second.fitted is fitted


def test_the_sheet_leads_to_the_parameters_of_the_right_scale(fitted: Fit):
    """A scale five tolerances off: the fit's wheel stiffness goes with it, and where the sheet leads is nearer."""
    record, channel = exact(), "wheel.rr.force"
    record = record.with_signals(
        record.signals.changed(
            {channel: record.signals.value[channel] * (1.0 + 5.0 * RIG.tolerance(channel, "gain"))}, 250.0
        )
    )
    off, right = fit_of(driven(record, 7, 0.0), fitted), fit_of(driven(exact(), 7, 0.0), fitted)
    space = TrialSpace.of(Reading.of(off, floor_of(off, 9)), TRIED, 0)
    names = [q.name for effect in MODEL.physics for q in effect.parameters]
    assert len(space.led) == len(names)
    moved = [names.index(name) for name in ("spring.rr.k", "damper.rr.c")]
    assert np.all(np.abs(off.physics - right.physics)[moved] > 0.01 * right.physics[moved])
    assert np.all(np.abs(space.led - right.physics)[moved] < 0.5 * np.abs(off.physics - right.physics)[moved])


def test_latencies_within_tolerance_are_read_away_to_the_last(fitted: Fit):
    """A first-order column is right to a part of the noise; without noise that part is seen, and goes."""
    off = fit_of(later("sensor_latency.imu", 0.003, 5, 0.0), fitted)
    own = floor_of(off, 9)
    space = TrialSpace.of(Reading.of(off, own), TRIED, 0)
    assert not space.reading.late
    closer = ranking._read_closely(space, lambda _: None)
    assert closer.late
    spaces = [TrialSpace.of(reading, TRIED, 0, space.noise) for reading in (space.reading, closer)]
    left = [left_by(s, []).ratios for s in spaces]
    assert left[1]["chassis.fx"] < 0.3 * left[0]["chassis.fx"]
    assert ranking._read_closely(spaces[1], lambda _: None) is closer


def test_noise_of_other_zeros_is_not_used_where_runs_were_read_again(
    fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    """What noise adds cancels in what the model explains at the zeros of its own fit only."""
    low = scaled(floor, 1.0 / 1.12)
    noise = TrialSpace.of(Reading.of(fitted, low), TRIED, 0).noise
    other = fit_of(later("sensor_latency.imu", 0.003, 0), fitted)
    closer = replace(read_again(Reading.of(other, floor), straight=STILL), floor=floor)
    assert closer.fitted is not fitted
    monkeypatch.setattr(ranking, "_read_closely", lambda space, tell: closer)
    found = diagnose(fitted, low, TRIED, noise=noise)
    assert found.noise is not noise
    assert any(np.any(found.noise.totals[row] != total) for row, total in noise.totals.items())


def test_a_cause_stays_where_rows_are_looked_at_twice(fitted: Fit, floor: NoiseFloor):
    """A law of a size that lifts its rows by a part of their floor is missing before and after."""
    told: list[str] = []
    off = fit_of(driven(exact_with(HIDDEN, 0.12 * SIZE), 1), fitted)
    found = diagnose(off, floor, [HIDDEN, *CANDIDATES[:2]], tell=told.append)
    assert AGAIN in told
    assert found.best is not None, found.says
    assert found.best.key == HIDDEN.key


def test_what_the_sheet_leads_to_is_no_other_model(fitted: Fit, floor: NoiseFloor):
    """Where the sheet holds, the floor there is the floor."""
    space = TrialSpace.of(Reading.of(fitted, floor), TRIED, 0)
    there = floor_at(fitted, space.led, DRAWS).sigma
    for row, sigma in floor.sigma.items():
        assert there[row] == pytest.approx(sigma, rel=0.05), row
