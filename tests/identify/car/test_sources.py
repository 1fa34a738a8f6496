"""Channels that a rig does not measure: what stands in for them and by which law; nothing measured is replaced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.errors import VehicleError
from lacet.daq.joint_tables import JOINTS
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import CHASSIS_ROWS, SUSPENSION_ROWS, TYRE_ROWS, Row, leading
from lacet.identify.car.sources.completion import SteeringAngleUnused, completed
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity, residual
from lacet.identify.regression.tolerances import ASSUMED, sheet_responses
from lacet.identify.signals.for_equations import design_reading
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.signals.sources import Kind, Method
from lacet.services.render.rows import run_notes
from tests.identify import cars, exact_car

VEHICLE, RIG = cars.reference_car()


@cache
def measured() -> Run:
    """Ten seconds of sinus steering."""
    return cars.piece("sine", 5.0, 15.0)


def of(keep: Callable[[str], bool], vehicle: Vehicle = VEHICLE, **more: Signal) -> PreparedRun:
    """The run with these of its channels, and more."""
    signals = {name: s for name, s in measured().signals.items() if keep(name)}
    return PreparedRun.of(replace(measured(), signals={**signals, **more}), vehicle, RIG)


def hubs(name: str) -> bool:
    """Three-axis hubs and an inertial unit."""
    return name.endswith(".force") or name in ("imu.accel", "imu.rate")


def lacking(recording: Recording, *lost: str) -> Recording:
    """The recording without some channels, on the same grid."""
    parts = [
        {name: a for name, a in part.items() if name not in lost}
        for part in (recording.signals.value, recording.signals.rate, recording.signals.accel)
    ]
    return replace(recording, signals=Signals(*parts))


def with_assumed(text: str) -> Vehicle:
    """The reference car with further lines in its file."""
    return Vehicle.parse(f"{VEHICLE.text}\n{text}", "car")


def signal(values: np.ndarray) -> Signal:
    """A scalar channel on the run's time base."""
    return replace(measured().signals["laser.fl.hub"], values=values)


def test_with_every_channel_nothing_is_assumed() -> None:
    """The whole rig has no source, no law and no assumption: its numbers are what they were."""
    whole = of(lambda _: True).recording
    assert not whole.sources
    assert not whole.laws
    assert not whole.signals.assumed
    assert whole.completed is whole.signals


def test_hubs_and_an_inertial_unit_give_the_chassis_rows_alone() -> None:
    """The rest is named with what would have to be added, and only with that."""
    run = of(hubs)
    assert run.rows == CHASSIS_ROWS
    for row in SUSPENSION_ROWS:
        assert run.measured_rows.left_out[row].channels == (f"laser.{row.corner}.hub",)
    for row in TYRE_ROWS:
        assert f"laser.{row.corner}.ground" in run.measured_rows.left_out[row].channels
    methods = {name: source.method for name, source in run.recording.sources.items()}
    assert methods["wheel.fl.moment"] is Method.CONTACT
    assert methods["laser.rr.hub"] is Method.LOAD_TRAVEL
    assert methods["camera.fr.steer"] is Method.TURN
    assert methods["camera.rl.steer"] is Method.BENCH_TABLE


def test_a_steering_wheel_that_is_not_used_is_said_with_what_it_needs() -> None:
    """Once a run, however often it is completed; with a ratio it is used, and nothing is said."""
    angle = {"steering.angle": signal(15.0 * measured().signals["camera.fl.steer"].values)}
    unused = of(hubs, **angle).recording
    assert [type(note) for note in unused.notes].count(SteeringAngleUnused) == 1
    assert completed(unused).notes == unused.notes
    (said,) = (line for line in run_notes(unused.notes) if "steering.angle" in line)
    assert "steering_ratio in [assumed]" in said
    stated = "\n[assumed]\nsteering_ratio = { value = 15.0, tolerance = 0.1, unit = '-', source = 'drawing' }\n"
    used = of(hubs, with_assumed(stated), **angle).recording
    assert used.sources["camera.fl.steer"].method is Method.STEERING_WHEEL
    assert SteeringAngleUnused() not in (*used.notes, *of(hubs).recording.notes)


def test_what_a_row_is_an_equation_of_is_never_assumed() -> None:
    """A vertical load cell gives heave, suspensions and tyres; longitudinal and lateral rows need the force."""
    cells = {f"hub.{c}.load": signal(measured().signals[f"wheel.{c}.force"].values[:, 2:]) for c in CORNERS}
    run = of(lambda name: not name.startswith("wheel"), **cells)
    assert set(run.rows) == {Row.parse("chassis.fz"), *SUSPENSION_ROWS, *TYRE_ROWS}
    for row in run.rows:
        for channel, components in leading(row).items():
            source = run.recording.sources.get(channel)
            assert source is None or all(source.kinds[k] is not Kind.ASSUMED for k in components), (row, channel)


def test_a_law_is_near_the_channel_that_it_stands_in_for() -> None:
    """The laws' nominal constants against the channels of the simulated car: within what they claim."""
    whole = of(lambda _: True).recording
    full, less = whole.signals, completed(lacking(whole, *(n for n in whole.signals.value if not hubs(n)))).completed
    for c in CORNERS:
        camber = full.value[f"camera.{c}.camber"] - less.value[f"camera.{c}.camber"]
        assert np.max(np.abs(camber)) < 0.02, c
        steer = full.value[f"camera.{c}.steer"] - less.value[f"camera.{c}.steer"]
        assert np.std(steer) < 0.2 * max(float(np.std(full.value["camera.fl.steer"])), 0.01), c
        about_x = full.value[f"wheel.{c}.moment"][0]
        assert np.std(about_x - less.value[f"wheel.{c}.moment"][0]) < 0.1 * np.std(about_x), c
        travel = full.value[f"laser.{c}.hub"] - less.value[f"laser.{c}.hub"]
        assert np.std(travel) < 0.5 * np.std(full.value[f"laser.{c}.hub"]), c


def test_angles_by_joint_tables_follow_both_wheels_and_the_rack() -> None:
    """Camber at the rack at which the wheel has its steer; steer of a wheel that no rack turns; and their rates."""
    vehicle, rng, n, step = cars.with_joints(VEHICLE), np.random.default_rng(5), 40, 1e-5
    begun = cars.random_signals(3, n)
    travel, rack = rng.uniform(-0.04, 0.04, (4, n)), rng.uniform(-0.03, 0.03, n)
    moving, turning = rng.normal(0.0, 0.3, (4, n)), rng.normal(0.0, 0.1, n)

    def at(time: float) -> tuple[Signals, dict[str, np.ndarray]]:
        """Hub lasers and steer at travels and rack that move on, and the angles that the tables give."""
        value, angles = dict(begun.value), dict[str, np.ndarray]()
        for i, (c, corner) in enumerate(vehicle.corners.items()):
            own, other = (travel + time * moving)[[i, CORNERS.index(other_corner(c))]]
            assert corner.joints is not None
            changes = corner.joints.at(own, other, rack + time * turning if corner.joints.steered else 0.0 * rack)
            toe, camber = (changes[:, list(JOINTS).index(name)] for name in ("toe", "camber"))
            value[f"laser.{c}.hub"] = (design_reading(RIG, corner) - own)[None]
            angles[f"camera.{c}.steer"] = -corner.side * (corner.static_toe + toe)
            angles[f"camera.{c}.camber"] = -corner.side * (corner.static_camber + camber)
            if corner.joints.steered:
                value[f"camera.{c}.steer"] = angles[f"camera.{c}.steer"][None]
        return replace(begun, value=value), angles

    (before, _), (now, angles), (after, _) = (at(time) for time in (-step, 0.0, step))
    rates = {name: (after.value[name] - before.value[name]) / (2.0 * step) for name in now.value}
    lost = [name for name in angles if name not in now.value or name.endswith(".camber")]
    whole = cars.recording(replace(now, rate={**now.rate, **rates}), vehicle, RIG)
    found = completed(lacking(whole, *angles.keys() & {*lost, *(f"camera.r{h}.steer" for h in "lr")})).completed
    (_, early), (_, late) = at(-step), at(step)
    derived = [name for name in angles if name.endswith(".camber") or name.startswith("camera.r")]
    assert len(derived) == 6
    for name in derived:
        np.testing.assert_allclose(found.value[name][0], angles[name], atol=1e-9, err_msg=name)
        slope = (late[name] - early[name]) / (2.0 * step)
        np.testing.assert_allclose(found.rate[name][0], slope, atol=1e-5, err_msg=name)


def test_attitude_follows_from_rates_gravity_and_a_speed() -> None:
    """Roll and pitch to a twentieth of the roll; without a speed none is claimed."""
    whole = of(lambda _: True).recording
    full, run = whole.signals.value["imu.attitude"], completed(lacking(whole, "imu.attitude"))
    assert run.sources["imu.attitude"].kind is Kind.DERIVED
    off = np.std(run.signals.value["imu.attitude"][:2] - full[:2], axis=1)
    assert np.max(off) < 0.05 * np.std(full[0])
    without = completed(lacking(whole, "imu.attitude", "correvit.speed"))
    assert "imu.attitude" not in without.sources


def test_a_potentiometer_gives_the_travel_by_its_motion_ratio() -> None:
    """The same suspension rows as with the hub laser; the ratio's tolerance is a gain on travel; without it no row."""
    stated = "\n[assumed]\nmotion_ratio = { value = 0.8, tolerance = 0.01, unit = '-', source = 'drawing' }\n"
    dampers = {f"damper.{c}.travel": signal(0.8 * (0.3 - measured().signals[f"laser.{c}.hub"].values)) for c in CORNERS}
    signals = {name: s for name, s in measured().signals.items() if not name.endswith(".hub")}
    shifted = {name: replace(s, t=s.t - RIG.latency("laser.fl.hub")) for name, s in dampers.items()}
    run = PreparedRun.of(replace(measured(), signals={**signals, **shifted}), with_assumed(stated), RIG)
    full = of(lambda _: True)
    assert run.rows == full.rows
    travel, true = (one.motion.corners["fl"].travel for one in (run, full))
    size = min(travel.size, true.size)
    np.testing.assert_allclose(travel[10 : size - 10], true[10 : size - 10], atol=2e-4)
    assert run.motion.corners["fl"].conditional is not None
    bare = PreparedRun.of(replace(measured(), signals={**signals, **shifted}), VEHICLE, RIG)
    assert not set(bare.rows) & {*SUSPENSION_ROWS, *TYRE_ROWS}


def test_the_response_to_an_assumption_is_the_change_of_the_residual() -> None:
    """One tolerance of each assumption, against the residual computed anew with it."""
    run = of(hubs)
    effects, theta = exact_car.MODEL.physics, exact_car.theta()
    found = sheet_responses(run, Sensitivity.of(run.recording, effects, theta))
    before = run.decimated(residual(run.motion, effects, theta))
    tried = [name for what, name, _ in found if what == ASSUMED]
    assert {name.partition(".")[0] for name in tried} >= {
        "loaded_radius", "pneumatic_trail", "camber", "toe", "static_deflection", "slip_angle", "speed",
    }  # fmt: skip
    for name in tried[::5]:
        assumption = run.recording.assumptions[name]
        step = 0.1 * assumption.tolerance
        moved = {**run.recording.signals.assumed, name: run.recording.signals.assumed[name] + step}
        record = replace(run.recording, signals=replace(run.recording.signals, assumed=moved))
        after = PreparedRun(record, index=run.index).decimated(residual(PreparedRun(record).motion, effects, theta))
        for row, response in found[ASSUMED, name, 0].items():
            change = (after[row] - before[row]) / 0.1
            assert np.std(change - response) < 0.03 * np.sqrt(np.mean(change**2)) + 0.01, (name, row)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("trail = { value = 1, tolerance = 1, unit = 'm', source = 'x' }", "unknown key"),
        ("pneumatic_trail = { value = 30, unit = 'mm', source = 'x' }", "tolerance is missing"),
        ("pneumatic_trail.middle = { value = 30, tolerance = 5, unit = 'mm', source = 'x' }", "is no place of it"),
        ("motion_ratio = { value = 0, tolerance = 5, unit = '-', source = 'x' }", "must not be 0"),
        ("camber = { value = 1, tolerance = -1, unit = 'deg', source = 'x' }", "negative"),
    ],
)
def test_a_faulty_assumption_is_refused_with_its_remedy(text: str, says: str) -> None:
    """Faults of the table stand beside those of the file."""
    with pytest.raises(VehicleError, match=says):
        with_assumed(f"[assumed]\n{text}\n")


def test_an_assumption_of_the_file_holds_at_its_place() -> None:
    """Each axle its own; units are converted; what is not given is the default."""
    car = with_assumed(
        "[assumed]\n"
        "pneumatic_trail.front = { value = 20, tolerance = 5, unit = 'mm', source = 'tyre' }\n"
        "pneumatic_trail.rear = { value = 25, tolerance = 4, unit = 'mm', source = 'tyre' }\n"
    )
    front, rear = (car.assumption("pneumatic_trail", c) for c in ("fl", "rr"))
    assert (front.value, front.tolerance, front.name, front.given) == (0.02, 0.005, "pneumatic_trail.front", True)
    assert (rear.value, rear.tolerance) == (0.025, 0.004)
    assert not car.assumption("friction", "fl").given
    assert car.assumption("loaded_radius", "fl").value == car.corners["fl"].height
