"""Clocks of instruments that differ are told with their lag: the reference car with an instrument stamped otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.run import Run, Signal
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.clocks import _nearest, differing_clocks
from lacet.services.render.plausibility import of_clocks
from lacet.services.workspace.loading import prepare_run
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()


def stamped(run: Run, family: str, later: float) -> PreparedRun:
    """A run whose channels of a family are stamped by so much later [s]."""
    signals = {
        name: replace(one, t=one.t + later) if name.startswith(family) else one for name, one in run.signals.items()
    }
    return PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG)


@pytest.mark.parametrize("name", ["sine", "sweep", "rough", "liftoff"])
def test_nothing_is_said_of_one_clock(name: str) -> None:
    """Nor of one that is late by what a latency may be, nor of an acceleration of the other sign."""
    run = cars.piece(name, 2.0, 22.0)
    assert differing_clocks(stamped(run, "imu", 0.0)) == []
    assert differing_clocks(stamped(run, "imu", 0.06)) == []
    accel = run.signals["imu.accel"].values * [1.0, -1.0, 1.0]
    assert differing_clocks(stamped(run.with_values({"imu.accel": accel}), "imu", 0.0)) == []


@pytest.mark.parametrize(("name", "later"), [("sine", 0.4), ("sweep", 1.3), ("liftoff", 0.7), ("sweep", -0.5)])
def test_an_inertial_unit_with_a_clock_of_its_own_is_told(name: str, later: float) -> None:
    (first, *_) = differing_clocks(stamped(cars.piece(name, 2.0, 22.0), "imu", later))
    assert first.lag == pytest.approx(abs(later), abs=0.12)
    assert first.late == ("inertial unit" if later > 0.0 else first.late)
    assert (first.other == "inertial unit") == (later < 0.0)
    assert f"of the {first.late} are about {first.lag:.2f} s later than those of the {first.other}" in of_clocks(first)


def test_travels_late_alone_are_told_as_such() -> None:
    (one,) = differing_clocks(stamped(cars.piece("sweep", 2.0, 22.0), "laser", 0.6))
    assert (one.late, one.other) == ("suspension travels", "inertial unit")
    assert one.lag == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("name", ["sine", "sweep"])
@pytest.mark.parametrize("fast", [0.01, -0.02])
def test_a_clock_of_another_rate_is_told_with_its_drift(name: str, fast: float) -> None:
    """The unit's stamps grow by that share; removed as a map does, nothing is said."""
    run = cars.piece(name, 2.0, 22.0)
    signals = {
        n: replace(one, t=one.t * (1.0 + fast)) if n.startswith("imu") else one for n, one in run.signals.items()
    }
    (found, *others) = differing_clocks(PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG))
    assert found.drift == pytest.approx(abs(fast), rel=0.3)
    assert abs(found.lag) < 0.15
    assert found.jump is None
    assert (found.late == "inertial unit") == (fast > 0.0)
    assert "ms each second" in of_clocks(found)
    assert all(one.drift for one in others)


@pytest.mark.parametrize("kind", ["imu", "laser"])
def test_a_log_that_lost_seconds_is_told_from_when_on(kind: str) -> None:
    """Its stamps go on without a gap, so that all behind it are early."""
    run = cars.piece("sweep", 2.0, 22.0)
    begin = float(run.signals["imu.accel"].t[0])

    def lost(one: Signal) -> Signal:
        keep = (one.t < begin + 8.0) | (one.t >= begin + 9.3)
        t = np.where(one.t < begin + 8.0, one.t, one.t - 1.3)
        return replace(one, t=t[keep], values=one.values[keep], flags=one.flags[keep])

    signals = {n: lost(one) if n.startswith(kind) else one for n, one in run.signals.items()}
    (found, *_) = differing_clocks(PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG))
    assert found.jump is not None
    assert found.jump[0] - begin == pytest.approx(8.0, abs=0.3)
    assert found.lag == pytest.approx(0.0, abs=0.1)
    assert found.jump[1] == pytest.approx(1.3, abs=0.1)
    assert (found.other == "inertial unit") == (kind == "imu")
    assert f"from {found.jump[0]:.0f} s on" in of_clocks(found)


def test_nothing_is_said_of_channels_that_stand_still() -> None:
    run = cars.piece("sine", 2.0, 12.0)
    still = run.with_values({name: np.repeat(one.values[:1], len(one.t), 0) for name, one in run.signals.items()})
    assert differing_clocks(PreparedRun.of(still, VEHICLE, RIG)) == []


def test_of_lags_at_which_all_is_opposed_the_least_opposed_is_taken() -> None:
    """As between a stretch before a gap and what follows it."""
    assert _nearest(np.array([-0.9, -0.5, -0.8]), 0) == 1
    assert _nearest(np.array([0.1, 0.97, 0.2, 1.0, 0.3]), 0) == 1


def test_a_slow_motion_is_nearly_alike_at_many_lags() -> None:
    """One turn in twenty seconds, of which noise decides where the two are most alike."""
    run, rng = cars.piece("sine", 2.0, 22.0), np.random.default_rng(0)
    values = {}
    for name, late in {"imu.accel": 0.4, **{f"wheel.{c}.force": 0.0 for c in CORNERS}}.items():
        t = run.signals[name].t
        slow = np.sin(0.1 * np.pi * (t - late))[:, None] + 0.15 * rng.standard_normal((t.size, 3))
        values[name] = (2.0 if name == "imu.accel" else 1000.0) * slow
    assert [
        one for one in differing_clocks(stamped(run.with_values(values), "imu", 0.0)) if "forces" in one.other
    ] == []


def test_the_warning_is_there_before_the_fit() -> None:
    warnings: list[str] = []
    run = cars.piece("sweep", 2.0, 22.0)
    late = {n: replace(one, t=one.t + 0.5) if n.startswith("imu") else one for n, one in run.signals.items()}
    ready = prepare_run(replace(run, signals=late), VEHICLE, RIG, None, warnings)
    assert any("their clocks differ" in line for line in warnings)
    assert not ready.sound
