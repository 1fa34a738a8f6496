"""Wheel forces of the reference car with its dynamometers hidden, against what they measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.signals.reconstruct import bring_together
from lacet.identify.wheel_loads.instants import Instants
from lacet.identify.wheel_loads.known_car import NOTHING, Changes, KnownCar
from lacet.identify.wheel_loads.measured_forces import errors
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.identify.wheel_loads.outputs import EstimatedForces
from lacet.identify.wheel_loads.settings import STANDARD
from lacet.identify.wheel_loads.tyre_contact import UNKNOWNS, TyreContact
from lacet.identify.wheel_loads.without_dynamometers import LOADS, placed, rows_of
from tests.identify import cars
from tests.support.once import once

SECONDS = slice(0, 1500)
"""Twelve seconds of a run."""


def hidden(drive: PreparedRun, also: tuple[str, ...] = ()) -> PreparedRun:
    """Some seconds of a run whose dynamometers are taken off, and what `also` begins the names of."""
    record = drive.recording.at(SECONDS)
    values = {k: a for k, a in record.signals.value.items() if k not in LOADS and not k.startswith(("-", *also))}
    usable = {name: mask for name, mask in record.usable.items() if name in values}
    return PreparedRun(replace(record, signals=replace(record.signals, value=values), usable=usable))


@pytest.fixture(scope="module")
def found(fitted: Fit, drives: dict[str, PreparedRun]) -> dict[str, EstimatedForces]:
    """The forces of two runs without dynamometers; the second has no wheel speed and no camera either."""
    car = KnownCar(fitted)
    runs = {"sine": hidden(drives["sine"]), "rough": hidden(drives["rough"], ("wheel.", "camera.", "laser.fl.ground"))}
    return once("wheel_forces", lambda: {name: estimate_forces(car, run) for name, run in runs.items()})


def test_vertical_forces_are_within_two_floors(
    found: dict[str, EstimatedForces], drives: dict[str, PreparedRun]
) -> None:
    for name, forces in found.items():
        seen = errors(forces, PreparedRun(drives[name].recording.at(SECONDS)))
        for c in CORNERS:
            error = seen[f"wheel.{c}.force_estimated.z"]
            assert error.floors < 2.0, (name, c, error.floors)
            assert abs(error.offset) < 80.0, (name, c)  # of 4 kN: two zeros of a dynamometer, and gains of 0.3 %
            assert error.inside > 0.9, (name, c, error.inside)
        for axle in ("front", "rear"):
            assert seen[f"axle.{axle}.force_estimated.y"].inside > 0.9
        assert seen["car.force_estimated.x"].inside > 0.9


def test_a_file_without_wheel_speeds_rear_cameras_and_ground_lasers_is_enough(fitted: Fit) -> None:
    """What such a run lacks is derived or assumed once loads are in place, though some of it was when it was read."""
    run, (vehicle, rig) = cars.piece("rough", 5.0, 13.0), cars.reference_car()
    lacking = ("wheel.", "camera.r", "camera.fl.camber", "camera.fr.camber")
    poor = {n: s for n, s in run.signals.items() if not n.startswith(lacking) and not n.endswith(".ground")}
    read = PreparedRun.of(replace(run, signals=poor), vehicle, rig)
    assert read.recording.sources
    whole = bring_together(run, vehicle, rig, read.recording.filters, on=read.recording.t)
    seen = errors(estimate_forces(KnownCar(fitted), read), PreparedRun(whole))
    for c in CORNERS:
        error = seen[f"wheel.{c}.force_estimated.z"]
        assert error.floors < 2.5, (c, error.floors)
        assert error.inside > 0.9, (c, error.inside)


def test_bands_are_no_wider_than_two_percent_of_a_load(found: dict[str, EstimatedForces]) -> None:
    for forces in found.values():
        for c in CORNERS:
            one = forces[f"wheel.{c}.force_estimated.z"]
            assert float(np.max(one.half95)) < 0.02 * float(np.mean(one.value))
            assert float(np.mean(one.half95)) > 2.0 * one.parts["noise"]


def test_axles_are_not_told_apart_where_nothing_does(found: dict[str, EstimatedForces]) -> None:
    """The run does not say whether its brakes act, so that no row of a free wheel's spin holds."""
    for forces in found.values():
        assert forces["car.force_estimated.x"].determined.all()
        assert not forces["axle.front.force_estimated.x"].determined.any()


def test_a_gap_of_one_laser_does_not_reach_the_instants_beside_it(
    found: dict[str, EstimatedForces], fitted: Fit, drives: dict[str, PreparedRun]
) -> None:
    """While it lasts neither chassis rows nor two rows of that wheel hold, and the other wheels' rows still do."""
    run = hidden(drives["sine"])
    mask = np.ones(run.recording.t.size, bool)
    mask[625:875] = False  # the two seconds that a gap of half a second takes with its edges
    record = replace(run.recording, usable={**run.recording.usable, "laser.fl.hub": mask})
    forces, whole = estimate_forces(KnownCar(fitted), PreparedRun(record)), found["sine"]
    gap = record.t[625], record.t[874]
    assert set(whole.t) - set(forces.t) == {t for t in whole.t if gap[0] <= t <= gap[1]} != set()
    beside = np.isin(whole.t, forces.t)
    for c in CORNERS:
        one, other = forces[f"wheel.{c}.force_estimated.z"], whole[f"wheel.{c}.force_estimated.z"]
        assert np.abs(one.value - other.value[beside]).max() < 0.1 * other.half95.mean(), c


def test_what_is_assumed_holds_however_often_the_loads_are_solved_for(
    fitted: Fit, drives: dict[str, PreparedRun]
) -> None:
    """No row has the difference of the axles' longitudinal forces: it stays where it is assumed, turn by turn."""
    record = drives["sine"].recording.at(slice(0, 500))
    run = PreparedRun(placed(record, {}))
    rows = tuple(row for row in rows_of(run.recording, fitted.sigma) if row.kind != "spin")
    instants = Instants(KnownCar(fitted), run, rows, NOTHING, np.random.default_rng(1))
    contact = TyreContact(run.motion, record.vehicle.corners, STANDARD, instants.car.outboard)
    gains = instants.solver(contact, np.array([fitted.sigma[row] ** 2 for row in rows]))
    once = instants.improved(contact, np.zeros((len(UNKNOWNS), record.t.size)), gains)
    twice = instants.improved(contact, once, gains)
    assert np.abs(contact.difference.off(once)).max() > 1.0
    np.testing.assert_allclose(twice, once, rtol=1e-4, atol=0.5)


def test_a_mass_that_came_off_is_in_the_band(
    found: dict[str, EstimatedForces], fitted: Fit, drives: dict[str, PreparedRun]
) -> None:
    """A change of mass that is not known exactly widens the band; its constants are told with the others."""
    lighter = estimate_forces(KnownCar(fitted), hidden(drives["sine"]), Changes(mass=-6.0, mass_sigma=2.0))
    name = "wheel.fl.force_estimated.z"
    assert np.mean(lighter[name].half95) > np.mean(found["sine"][name].half95)
    masses = [one for one in lighter.constants if one.kind == "mass"]
    offsets = estimate_forces(KnownCar(fitted), hidden(drives["sine"]), Changes(rest=(2.0, 6.0)))
    anew = [one for one in offsets.constants if one.kind == "offsets"]
    assert len(anew) == 4
    assert np.mean(offsets[name].half95) > np.mean(found["sine"][name].half95)
    cross_weight = np.array([one.value for one in anew]) @ [1.0, -1.0, -1.0, 1.0] / 2.0
    assert abs(cross_weight) > 0.9 * np.linalg.norm([one.value for one in anew])  # the rest is fixed by ΣF and moments
    assert [one.mean for one in masses] == [-6.0] * 4
    assert all(0.0 < one.sigma_after <= one.sigma for one in masses)
