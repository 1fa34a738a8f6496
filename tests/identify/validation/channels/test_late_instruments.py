"""Whole instruments, or kinds of their columns, that are late, from the car's equations; none in sound runs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import COLUMNS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.channels.column_kinds import kind_of
from lacet.identify.validation.channels.delays import instrument_delays
from lacet.identify.validation.channels.fault_columns import ANY_DELAY, FaultColumns
from lacet.identify.validation.channels.late_instruments import LateInstruments
from lacet.identify.validation.channels.single_faults import ColumnFault, Fault, column_faults
from lacet.identify.validation.plausibility import Symptom, doubtful_channels
from lacet.services.render.channels import from_equations
from tests.identify.validation.channels.spoilt_columns import series_of, with_column
from tests.support.tables import CAR, piece, without

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
OFF = 0.003
"""How far a delay may be off [s]: both anti-roll bars are missing in the model."""


@cache
def run_of(name: str) -> Run:
    return piece(name, 2.0, 16.0)


def late(name: str, start: str, by: float, channels: Collection[str] | None = None) -> PreparedRun:
    """A run whose columns that begin like this are later by a time [s]; `channels` : those it has, by default all."""
    run = run_of(name)
    for gone in [] if channels is None else run.signals.keys() - set(channels):
        run = without(run, gone)
    for column in COLUMNS:
        if column.startswith(start) and COLUMNS[column][0].name in run.signals:
            t = run.signals[COLUMNS[column][0].name].t
            run = with_column(run, column, np.interp(t - by, t, series_of(run, column)))
    return PreparedRun.of(run, VEHICLE, RIG)


@pytest.mark.parametrize(("name", "start", "instrument", "by"), [
    ("rough", "imu.", "imu", 0.04), ("sine", "imu.", "imu", 0.1), ("rough", "imu.", "imu", 0.1),
    ("rough", "laser.", "lasers", -0.09), ("sine", "laser.", "lasers", 0.04), ("liftoff", "wheel.", "wheels", 0.04),
    ("rough", "wheel.", "wheels", 0.03), ("rough", "wheel.fl.", "wheel.fl", 0.04),
    ("rough", "imu.accel.", "imu.accel", 0.04),
])  # fmt: skip
def test_a_late_instrument_is_named_with_its_delay(name: str, start: str, instrument: str, by: float) -> None:
    """A tenth of a second on a rough road is far more than a first-order estimate reaches."""
    (found,) = column_faults([late(name, start, by)])
    assert isinstance(found, LateInstruments)
    (one,) = found.instruments
    assert one.name == instrument
    assert one.delay == pytest.approx(by, abs=OFF)
    assert found.remaining < found.misfit
    line = from_equations(found)
    assert f"{instrument} is" in line
    assert f"ms {'later' if by > 0.0 else 'earlier'} than the rig says" in line


def test_runs_with_the_same_delay_share_a_line_and_its_columns_are_not_blamed() -> None:
    (found,) = column_faults([late(name, "imu.", 0.04) for name in ("sine", "rough")])
    assert list(found.runs) == ["sine", "rough"]


def test_one_late_column_is_not_its_instrument() -> None:
    (found,) = column_faults([late("rough", "imu.accel.z", 0.03)])
    assert isinstance(found, ColumnFault)
    assert (found.column, found.fault) == ("imu.accel.z", Fault.LATE)


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_late_in_sound_runs(name: str) -> None:
    """Both anti-roll bars are missing in the base model: no instrument seems late by more than a few milliseconds."""
    run = late(name, "nothing", 0.0)
    assert column_faults([run]) == []
    products = FaultColumns.of(run)
    assert products is not None
    shown = [one for one in instrument_delays(products) if one.noise < 0.1]
    assert len(shown) >= 2
    assert all(abs(one.delay) < 0.005 for one in shown)


def test_turns_and_travels_that_are_opposite_as_one_is_late_have_no_wrong_sign() -> None:
    run = late("rough", "laser.", 0.08)
    assert doubtful_channels(run) == []
    without_loads = [channel for channel in run_of("rough").signals if not channel.startswith("wheel.")]
    (doubt,) = doubtful_channels(late("rough", "laser.", 0.08, without_loads))
    assert doubt.symptom is Symptom.PITCH_RATE_SIGN


def test_a_delay_that_noise_hides_is_not_taken_for_none() -> None:
    """What the cameras' delay changes in these rows is nearly all noise: they are neither late nor as the rig says."""
    products = FaultColumns.of(late("rough", "camera.", 0.04))
    assert products is not None
    cameras = next(one for one in instrument_delays(products) if "camera.steer" in one.kinds)
    assert cameras.noise > 0.3


def test_a_delay_that_changes_nothing_has_the_spread_of_what_is_known_beforehand() -> None:
    """It is the same in every block, and not for that reason certain."""
    products = FaultColumns.of(late("rough", "nothing", 0.0))
    assert products is not None
    at = int(np.flatnonzero(products.are_delays)[products.kinds.index("camera.steer")])
    other = int(np.flatnonzero(products.are_delays)[products.kinds.index("camera.camber")])
    tables = [products.whole.copy(), products.left_out.copy()]
    for table in tables:
        for place in (at, other):
            table[..., place, :] = table[..., :, place] = 0.0
    hidden = replace(products, whole=tables[0], left_out=tables[1])
    cameras = next(one for one in instrument_delays(hidden) if "camera.steer" in one.kinds)
    assert cameras.spread > 0.9 * ANY_DELAY
    assert cameras.noise == 1.0


def test_kinds_of_columns_are_families_and_wheels() -> None:
    assert kind_of("laser.fl.hub") == kind_of("laser.rr.hub") == "laser.hub"
    assert kind_of("wheel.fl.force") == kind_of("wheel.fl.moment") == "wheel.fl"
    assert kind_of("wheel.fl.speed") == "wheel.speed"
