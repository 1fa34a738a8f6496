"""Tracks and wheelbase of the vehicle file that are not the car's, from the car's equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import residual
from lacet.identify.validation.channels import wrong_places
from lacet.identify.validation.channels.late_instruments import LateInstruments
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.identify.validation.channels.vehicle_lengths import Length, length_columns, with_lengths
from lacet.identify.validation.channels.wrong_places import Misplaced, OtherLengths
from lacet.services.render.channels import from_equations
from tests.support.tables import CAR, piece

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
TRACKS = {Length.FRONT_TRACK: -0.10, Length.REAR_TRACK: -0.10}


def runs(vehicle: Vehicle, *names: str) -> list[PreparedRun]:
    return [PreparedRun.of(piece(name, 2.0, 22.0), vehicle, RIG) for name in names]


def test_a_length_is_that_of_the_vehicle_file_and_can_be_changed() -> None:
    longer = {Length.WHEELBASE: 0.2, Length.REAR_TRACK: -0.1}
    other = with_lengths(VEHICLE, longer)
    for one in Length:
        assert one.of(other) - one.of(VEHICLE) == pytest.approx(longer.get(one, 0.0))
    assert other.corners["fl"] == VEHICLE.corners["fl"]


def test_columns_of_the_lengths_are_the_change_of_the_equations() -> None:
    (run,) = runs(VEHICLE, "sine")
    effects = [effect for effect in catalogue(VEHICLE, RIG.wheel_reference).values() if effect.base]
    theta = np.full(sum(len(effect.parameters) for effect in effects), 100.0)
    columns = length_columns(run, effects, theta, [Length.WHEELBASE])
    (short,) = runs(with_lengths(VEHICLE, {Length.WHEELBASE: -0.01}), "sine")
    before, after = (residual(build_motion(one.recording), effects, theta) for one in (run, short))
    change = run.decimated({row: after[row] - before[row] for row in run.rows})
    place = list(Length).index(Length.WHEELBASE)
    for row, found in columns.items():
        size = float(np.max(np.abs(change[row])))
        assert found[place] * 0.01 == pytest.approx(change[row], abs=0.02 * size + 1e-9)


def test_tracks_that_are_not_those_of_the_car_are_named_with_what_they_are() -> None:
    (found,) = column_faults(runs(with_lengths(VEHICLE, TRACKS), "sine", "rough"))
    assert isinstance(found, OtherLengths)
    assert found.off.keys() == TRACKS.keys()
    for one, off in found.off.items():
        assert off == pytest.approx(0.10, abs=1.5 * found.half[one])
        assert found.file[one] + off == pytest.approx(one.of(VEHICLE), abs=0.05)
    said = from_equations(found)
    assert "axle.front.track is 1." in said
    assert "Measure again" in said


def test_a_wheelbase_is_named_beside_the_units_place_that_does_the_same() -> None:
    (found,) = column_faults(runs(with_lengths(VEHICLE, {Length.WHEELBASE: 0.14}), "sine", "rough"))
    assert isinstance(found, Misplaced)
    assert found.or_lengths is not None
    assert found.or_lengths.off == {Length.WHEELBASE: pytest.approx(-0.14, abs=0.02)}
    assert "or geometry.wheelbase is 2.6" in from_equations(found)


def test_tracks_are_named_beside_an_instrument_that_is_late() -> None:
    """Its delay is removed first."""
    drives = [piece(name, 2.0, 16.0) for name in ("sine", "rough")]
    late = [
        replace(
            run, signals={n: replace(s, t=s.t + 0.04) if n.startswith("imu") else s for n, s in run.signals.items()}
        )
        for run in drives
    ]
    instrument, lengths = column_faults([PreparedRun.of(run, with_lengths(VEHICLE, TRACKS), RIG) for run in late])
    assert isinstance(instrument, LateInstruments)
    assert isinstance(lengths, OtherLengths)
    assert lengths.off.keys() == TRACKS.keys()


def test_lengths_that_leave_what_they_are_for_are_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """What else the rows lack would be taken for a length to first order."""
    wrong = runs(with_lengths(VEHICLE, TRACKS), "sine", "rough")
    monkeypatch.setattr(wrong_places, "_with_lengths", lambda recording, longer: recording)
    monkeypatch.setattr(wrong_places, "_CLOSE", 10.0)
    assert not [found for found in column_faults(wrong) if isinstance(found, OtherLengths)]


def test_lengths_of_the_car_are_not_doubted() -> None:
    assert column_faults(runs(VEHICLE, "sine", "rough")) == []
