"""Mistakes of unit and sign that people make, in the reference car's runs; and none where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal, signal_of
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.for_equations import design_reading, for_equations
from lacet.identify.validation.clocks import ClockDifference
from lacet.identify.validation.plausibility import doubtful_channels
from lacet.services.render.plausibility import of_clocks, sentence
from lacet.services.workspace import loading
from lacet.services.workspace.loading import checked_run, load
from tests.support.tables import CAR, piece, without, written


def implausible(run: PreparedRun) -> list[str]:
    """What is said of a run."""
    return [sentence(doubt) for doubt in doubtful_channels(run)]


RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
DEGREES = 180.0 / math.pi
SEEN = (
    # channels, components, factor, run; what is said of them
    ("imu.accel", "xyz", 1 / 9.80665, "sine", "imu.accel is 1.05 m/s², where gravity alone is 9.81: is it in g?"),
    ("imu.accel", "xyz", 1000.0, "sine", "is it in mm/s²?"),
    ("imu.accel", "z", -1.0, "sine", "m/s² upwards, where gravity is +9.81: check its signs and axes"),
    ("imu.accel", "y", -1.0, "sine", "imu.accel y has the sign opposite to imu.rate z times the speed"),
    ("imu.accel", "x", -1.0, "liftoff", "the wheel forces' x have the sign opposite to imu.accel x"),
    ("imu.rate", "xyz", DEGREES, "sine", "times as fast as imu.rate z says: is the rate in °/s?"),
    ("imu.rate", "z", -1.0, "sine", "imu.attitude yaw turns against imu.rate z: one of them has the wrong sign"),
    ("imu.attitude", "xyz", DEGREES, "sine", "as imu.rate z says: is it in degrees, or the rate in rad/s"),
    ("imu.attitude", "x", -1.0, "rough", "imu.attitude roll turns against imu.rate x"),
    ("imu.attitude", "y", -1.0, "rough", "imu.attitude pitch turns against imu.rate y"),
    ("imu.[ra]*t*e", "xyz", DEGREES, "sine", "imu.accel y is 0.0174 times imu.rate z times the speed"),
    ("wheel.*.force", "xyz", 1e-3, "sine", "the wheel forces' z add up to 13.6 N, a car of 1.4 kg: are they in kN?"),
    ("wheel.*.force", "xyz", -1.0, "sine", "N: they are positive when the wheels carry the car"),
    ("wheel.rl.force", "z", -1.0, "sine", "wheel.rl.force mostly pulls at the road: z is positive when"),
    ("wheel.*.force", "y", -1.0, "sine", "the wheel forces' y have the sign opposite to imu.accel y"),
    ("laser.*", "x", 1000.0, "sine", "laser.fl.hub, laser.fr.hub, laser.rl.hub, laser.rr.hub are up to 332 m: in mm?"),
    ("laser.rr.hub", "x", 1000.0, "sine", "laser.rr.hub is up to 331 m: in mm?"),
    ("laser.*.ground", "x", 100.0, "sine", "m: in cm?"),
    ("laser.*.ground", "x", 39.37, "sine", "m: in inches?"),
    ("camera.*.steer", "x", DEGREES, "sine", "camera.fl.steer, camera.fr.steer are up to 1.6 rad: in degrees?"),
    ("camera.*.steer", "x", -1.0, "sine", "camera steer has the sign opposite to imu.rate z: both are"),
    ("correvit.speed", "xy", 3.6, "sine", "correvit.speed x is 90.3 m/s where the wheels roll at 25.6: is it in km/h?"),
    ("correvit.speed", "y", -1.0, "sine", "correvit.speed y has the sign opposite to what acceleration, yaw rate and"),
    ("wheel.*.speed", "x", 60 / math.tau, "sine", "where correvit.speed x is 25.1: is it in 1/min?"),
    ("wheel.*.speed", "x", 1 / math.tau, "sine", "where correvit.speed x is 25.1: is it in revolutions a second?"),
    ("wheel.fr.speed", "x", -1.0, "sine", "wheel.fr.speed times the tyre's radius: -25.6 m/s where"),
)  # fmt: skip


def with_outside(run: Run, mass: float) -> Run:
    """The run with loads that carry a mass [kg] more, as of rim and tyre outside a hub."""
    drive = drive_of(run)
    values: dict[str, np.ndarray] = {}
    for corner, wheel in drive.motion.corners.items():
        signal = run.signals[f"wheel.{corner}.force"]
        up = np.interp(signal.t, drive.recording.t, np.sum(wheel.centre_accel * wheel.normal, axis=0))
        values[f"wheel.{corner}.force"] = signal.values + mass * up[:, None] * np.array([0.0, 0.0, 1.0])
    return run.with_values(values)


def test_loads_of_the_hub_are_not_the_contact_s() -> None:
    """The car's own are the hub's, inside 23 kg of rim and tyre."""
    run = piece("rough", 0.0, 20.0)
    of_contact = with_outside(run, 23.0)
    (said,) = implausible(drive_of(replace(run, wheel_reference="contact")))
    assert said.startswith("all wheel loads lack a mass of 23")
    assert implausible(drive_of(replace(of_contact, wheel_reference="contact"))) == []
    assert implausible(drive_of(replace(run, wheel_reference="hub"))) == []
    (said,) = implausible(drive_of(replace(of_contact, wheel_reference="hub")))
    assert "they are the contact's" in said


def test_a_mass_that_explains_little_of_what_the_tyre_leaves_is_none() -> None:
    """Nine kilograms are more than chance, and a tyre that is no spring may seem to have them."""
    run = with_outside(piece("rough", 0.0, 20.0), 14.0)
    assert implausible(drive_of(replace(run, wheel_reference="contact"))) == []


def test_roll_and_pitch_that_are_exchanged() -> None:
    run = piece("rough", 0.0, 20.0)
    values = run.signals["imu.attitude"].values[:, [1, 0, 2]]
    (said,) = implausible(drive_of(run.with_values({"imu.attitude": values})))
    assert said.endswith("roll and pitch are exchanged")


def drive_of(run: Run) -> PreparedRun:
    return PreparedRun.of(run, VEHICLE, RIG)


def changed(run: Run, pattern: str, components: str, factor: float | Callable[[np.ndarray], np.ndarray]) -> Run:
    """The run with some components of the channels that match in another unit."""
    places = ["xyz".index(c) for c in components]
    values = {name: s.values.copy() for name, s in run.signals.items() if fnmatch(name, pattern)}
    assert values
    for table in values.values():
        table[:, places] = factor(table[:, places]) if callable(factor) else factor * table[:, places]
    return run.with_values(values)


@pytest.mark.parametrize(("pattern", "components", "factor", "name", "says"), SEEN)
def test_a_mistake_is_told_with_what_it_looks_like(
    pattern: str, components: str, factor: float, name: str, says: str
) -> None:
    found = implausible(drive_of(changed(piece(name, 0.0, 20.0), pattern, components, factor)))
    assert any(says in line for line in found), found
    assert len(found) <= 2


def exchanged(run: Run, a: str, b: str) -> Run:
    """The run with two channels' wires exchanged."""
    signals = dict(run.signals)
    signals[a], signals[b] = replace(signals[b]), replace(signals[a])
    return replace(run, signals=signals)


def test_a_road_taken_as_flat_is_no_fault(tmp_path: Path) -> None:
    """They are said, but a command that follows by `&&` goes on."""
    run = piece("sine", 5.0, 12.0)
    few = {name: s for name, s in run.signals.items() if not name.endswith(".ground") or name == "laser.fl.ground"}
    file = written(replace(run, signals=few), tmp_path / "few.parquet")
    loaded = load([file], CAR / "rig.toml", CAR / "vehicle.toml")
    assert loaded.warnings == ()
    assert [note.partition(":")[0] for note in loaded.notes] == ["few"]
    assert "flat road" in loaded.notes[0]
    assert set(loaded.said) == {*loaded.sheet, *loaded.notes}


def test_hub_lasers_exchanged_are_told() -> None:
    for axle, pair in (("front", "fl fr"), ("rear", "rl rr")):
        a, b = (f"laser.{c}.hub" for c in pair.split())
        found = implausible(drive_of(exchanged(piece("sine", 0.0, 20.0), a, b)))
        assert len(found) == 1
        assert f"leans into the turn at the {axle} axle: its travels look exchanged" in found[0]


def test_a_side_acceleration_of_the_other_sign_is_told_by_potentiometers_on_the_dampers(tmp_path: Path) -> None:
    """Where neither wheel loads nor a speed tell it; by a laser's distance, which falls in bump, as by a stroke."""
    run = without(few_instruments("sine"), "correvit", "camera")
    hubs = {c: run.signals[f"laser.{c}.hub"] for c in CORNERS}
    strokes = {f"damper.{c}.travel": replace(hub, values=0.35 - hub.values) for c, hub in hubs.items()}
    run = replace(run, signals={**without(run, "laser.").signals, **strokes})
    car = with_motion_ratio(tmp_path)
    for sign in (1.0, -1.0):
        told, rig = for_equations(changed(run, "imu.accel", "y", sign), car, RIG)
        said = implausible(PreparedRun.of(told, car, rig))
        assert [("leans into the turn" in line) for line in said] == ([] if sign > 0.0 else [True, True])


@pytest.mark.parametrize(("factor", "axle", "says"), [
    (0.1, "", "the body rolls 12 times as far (imu.rate x) as the suspension travels say (front and rear)"),
    (0.1, "r", "as the suspension travels say (rear): their unit or scale"),
    (7.0, "f", "the body rolls 0.18 times as far (imu.rate x) as the suspension travels say (front)"),
    (1.5, "", ""),
])  # fmt: skip
def test_travels_of_another_scale_are_told_by_the_roll_in_turns(factor: float, axle: str, says: str) -> None:
    """By what the lasers read about their design height; on a rough road straight ahead nothing is compared."""
    for name in ("sine", "rough"):
        run = few_instruments(name)
        hubs = {c: f"laser.{c}.hub" for c in CORNERS if c.startswith(axle)}
        design = {c: design_reading(RIG, VEHICLE.corners[c]) for c in hubs}
        values = {hub: design[c] + factor * (run.signals[hub].values - design[c]) for c, hub in hubs.items()}
        said = implausible(drive_of(run.with_values(values)))
        assert [says in line for line in said] == ([True] if says and name == "sine" else [])


def test_a_rig_that_rolls_the_car_by_its_wheels_is_no_turn() -> None:
    """Without yaw the body may roll as far beside its travels as it likes."""
    run = without(few_instruments("sine"), "camera")
    run = changed(run, "imu.rate", "z", lambda rate: 1e-3 * np.sign(rate[::-1]))
    hubs = {c: f"laser.{c}.hub" for c in CORNERS}
    design = {c: design_reading(RIG, VEHICLE.corners[c]) for c in hubs}
    values = {hub: design[c] + 0.1 * (run.signals[hub].values - design[c]) for c, hub in hubs.items()}
    assert not any("rolls" in line for line in implausible(drive_of(run.with_values(values))))


def test_travels_that_do_not_follow_the_roll_are_not_judged_by_its_size() -> None:
    """Noise instead of travel is no other unit."""
    run, rng = few_instruments("sine"), np.random.default_rng(0)
    values = {
        f"laser.{c}.hub": design_reading(RIG, VEHICLE.corners[c])
        + 0.01 * rng.standard_normal(run.signals[f"laser.{c}.hub"].values.shape)
        for c in CORNERS
    }
    assert not any("rolls" in line for line in implausible(drive_of(run.with_values(values))))


def with_motion_ratio(folder: Path) -> Vehicle:
    """The car with dampers that move as the wheels do."""
    text = (CAR / "vehicle.toml").read_text(encoding="utf-8")
    ratio = '\n[assumed]\nmotion_ratio = { value = 1, tolerance = 0.01, unit = "-", source = "drawing" }\n'
    (folder / "vehicle.toml").write_text(text + ratio, encoding="utf-8")
    return Vehicle.load(folder / "vehicle.toml")


def few_instruments(name: str, seconds: float = 20.0) -> Run:
    """A run with neither wheel loads nor attitude: travels, rates and specific force of the body are left."""
    run = piece(name, 0.0, seconds)
    for gone in ("wheel.", "imu.attitude", "laser.fl.ground", "laser.fr.ground", "laser.rl.ground", "laser.rr.ground"):
        run = without(run, gone)
    return run


@pytest.mark.parametrize(("name", "axis", "says"), [
    ("sine", "x", "imu.rate x has the sign opposite to the suspension travels' difference of left and right"),
    ("rough", "x", "imu.rate x has the sign opposite to the suspension travels' difference of left and right"),
    ("rough", "y", "imu.rate y has the sign opposite to the suspension travels' difference of front and rear"),
    ("liftoff", "y", "imu.rate y has the sign opposite to the suspension travels' difference of front and rear"),
])  # fmt: skip
def test_a_rate_of_the_other_sign_is_told_by_the_travels_where_no_wheel_load_tells(
    name: str, axis: str, says: str
) -> None:
    (said,) = implausible(drive_of(changed(few_instruments(name), "imu.rate", axis, -1.0)))
    assert said.startswith(says)
    assert said.endswith("exchanged")


@pytest.mark.parametrize(("name", "wheels", "says"), [
    ("sine", "fl fr", "left and right at the front axle alone: the two travels look exchanged, or"),
    ("sine", "rl rr", "left and right at the rear axle alone: the two travels look exchanged, or"),
    ("liftoff", "fl rl", "front and rear on the left alone: the two travels look exchanged, or"),
    ("liftoff", "fr rr", "front and rear on the right alone: the two travels look exchanged, or"),
])  # fmt: skip
def test_travels_exchanged_are_told_where_no_wheel_load_tells(name: str, wheels: str, says: str) -> None:
    """In a manoeuvre, also where the specific force comes too late to show a body that leans into the turn."""
    a, b = (f"laser.{c}.hub" for c in wheels.split())
    run = changed(few_instruments(name), "imu.accel", "xy", lambda values: np.roll(values, 60, axis=0))
    (said,) = implausible(drive_of(exchanged(without(run, "correvit"), a, b)))
    assert says in said


def test_with_travels_at_one_axle_the_rate_may_be_at_fault_as_well() -> None:
    run = without(few_instruments("sine"), "laser.rl", "laser.rr", "correvit")
    run = changed(run, "imu.accel", "xy", lambda values: np.roll(values, 60, axis=0))
    assert implausible(drive_of(run)) == []
    for wrong in (changed(run, "imu.rate", "x", -1.0), exchanged(run, "laser.fl.hub", "laser.fr.hub")):
        (said,) = implausible(drive_of(wrong))
        assert said.endswith("the rate or the travels have the wrong sign, or those of left and right are exchanged")


def test_a_rig_that_lifts_the_wheels_of_one_axle_is_no_mistake() -> None:
    """The stiffer axle turns the body with it, and the other's travels go against that; no manoeuvre is driven."""
    run = few_instruments("sine")
    still = {
        "imu.accel": replace(run.signals["imu.accel"], values=0.0 * run.signals["imu.accel"].values + [0, 0, 9.81])
    }
    a, b = "laser.rl.hub", "laser.rr.hub"
    assert implausible(drive_of(exchanged(replace(run, signals={**run.signals, **still}), a, b))) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["laser.{}.hub", "suspension.{}.travel", "damper.{}.travel"])
def test_travels_of_the_other_sign_are_told_as_such(kind: str, sign: float, tmp_path: Path) -> None:
    """By a laser whose distance falls in bump, or a potentiometer at the wheel or on the damper, whose stroke rises."""
    run = few_instruments("rough")
    hubs = {c: run.signals[f"laser.{c}.hub"] for c in CORNERS}
    way = sign if kind.startswith("laser") else -sign
    measured = {kind.format(c): replace(hub, values=0.35 + way * (hub.values - 0.35)) for c, hub in hubs.items()}
    run = replace(run, signals={**without(run, "laser.").signals, **measured})
    car = with_motion_ratio(tmp_path)
    said = implausible(PreparedRun.of(run, car, RIG))
    if sign > 0.0:
        assert said == []
    else:
        assert len(said) == 1
        assert (
            "the suspension travels have the sign opposite" in said[0] or "the travels have the wrong sign" in said[0]
        )


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (17.0, ""),
        (-17.0, "steering.angle has the sign opposite to imu.rate z: both are positive to the left"),
        (17.0 * DEGREES, "steering.angle is up to"),
    ],
)
@pytest.mark.parametrize("speed", ["correvit.speed", ""])
def test_a_steering_wheel_of_the_other_sign_or_in_degrees_is_named(speed: str, factor: float, says: str) -> None:
    """With a speed and without one, in place of the cameras."""
    run = few_instruments("sine")
    steer = run.signals["camera.fl.steer"]
    run = without(run, "camera", *([] if speed else ["correvit"]))
    wheel = signal_of("steering.angle", steer.t, factor * steer.values)
    said = implausible(drive_of(replace(run, signals={**run.signals, "steering.angle": wheel})))
    assert [line for line in said if "steering" in line] == said
    assert bool(said) == bool(says)
    assert all(line.startswith(says) for line in said)


def test_wheels_that_are_steered_by_a_wrong_steering_wheel_are_not_named_beside_it() -> None:
    """With a ratio their angles are derived from it: the channel of the file is named."""
    stated = "\n[assumed]\nsteering_ratio = { value = 15.0, tolerance = 0.1, unit = '-', source = 'drawing' }\n"
    vehicle = Vehicle.parse((CAR / "vehicle.toml").read_text(encoding="utf-8") + stated)
    run = piece("sine", 0.0, 20.0)
    steer = run.signals["camera.fl.steer"]
    wheel = signal_of("steering.angle", steer.t, -15.0 * steer.values)
    run = without(run, "camera")
    prepared = PreparedRun.of(replace(run, signals={**run.signals, "steering.angle": wheel}), vehicle, RIG)
    assert "camera.fl.steer" in prepared.recording.sources
    assert [line.partition(" ")[0] for line in implausible(prepared)] == ["steering.angle"]


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_said_of_sound_runs_with_few_instruments(name: str) -> None:
    assert implausible(drive_of(few_instruments(name))) == []


def test_a_car_that_stands_does_not_say_which_way_it_turns() -> None:
    """Noise alone, of any length, has no sign."""
    rng = np.random.default_rng(1)
    run = changed(few_instruments("rough"), "imu.rate", "xyz", lambda values: 1e-3 * rng.standard_normal(values.shape))
    still = changed(run, "laser.*.hub", "x", lambda values: 0.3 + 1e-4 * rng.standard_normal(values.shape))
    assert implausible(drive_of(still)) == []


@pytest.mark.parametrize("seed", range(12))
def test_noise_of_a_few_seconds_has_no_sign(seed: int) -> None:
    rng = np.random.default_rng(seed)
    run = few_instruments("rough", 4.0)
    run = changed(run, "imu.rate", "xyz", lambda values: 1e-3 * rng.standard_normal(values.shape))
    assert (
        implausible(drive_of(changed(run, "laser.*.hub", "x", lambda v: 0.3 + 1e-4 * rng.standard_normal(v.shape))))
        == []
    )


def test_a_weak_correlation_of_the_other_sign_is_no_mistake_however_long_the_run() -> None:
    """Links that raise the body in a turn make one; a rate reversed has one several times as large."""
    rng, short = np.random.default_rng(5), few_instruments("rough")
    rate = short.signals["imu.rate"]
    loud = 4.0 * np.std(rate.values[:, 1]) * rng.standard_normal((8, len(rate.t)))
    signals: dict[str, Signal] = {}
    for name, one in short.signals.items():
        t = np.concatenate([one.t + k * (one.t[-1] - one.t[0] + np.median(np.diff(one.t))) for k in range(8)])
        values = np.tile(one.values, (8, 1))
        if name == "imu.rate":
            values[:, 1] = smoothed(loud.ravel()) - values[:, 1]
        signals[name] = replace(one, t=t, values=values, flags=np.tile(one.flags, 8))
    assert implausible(drive_of(replace(short, signals=signals))) == []
    signals["imu.rate"] = replace(signals["imu.rate"], values=-np.tile(rate.values, (8, 1)))
    assert implausible(drive_of(replace(short, signals=signals))) != []


def smoothed(noise: np.ndarray) -> np.ndarray:
    """Noise as slow as the turns that are compared."""
    return np.convolve(noise, np.ones(50) / np.sqrt(50), "same")


@pytest.mark.filterwarnings("error")
def test_instruments_that_never_measure_together_are_not_compared() -> None:
    run = few_instruments("rough")
    signals: dict[str, Signal] = {}
    for name, one in run.signals.items():
        late = (np.arange(len(one.t)) > len(one.t) // 2)[:, None]
        values = np.where(late if name.startswith("imu") else ~late, np.nan, one.values)
        signals[name] = signal_of(name, one.t, values)
    assert implausible(drive_of(replace(run, signals=signals))) == []


@pytest.mark.parametrize("name", ["sine", "liftoff"])
def test_an_inertial_unit_turned_by_90_degrees_is_told(name: str) -> None:
    """Without a speed sensor; with one its side acceleration is against the turn, too."""
    run = without(piece(name, 0.0, 20.0), "correvit")
    accel = run.signals["imu.accel"].values
    turned = np.stack([accel[:, 1], -accel[:, 0], accel[:, 2]], axis=1)
    found = implausible(drive_of(run.with_values({"imu.accel": turned})))
    assert any("is the inertial unit turned by 90°" in line for line in found), found


@pytest.mark.parametrize("channel", ["car.speed", "gnss.speed"])
def test_wheel_speeds_are_compared_with_whichever_speed_there_is(channel: str) -> None:
    """Of the car's own bus or by satellite, where there is no optical sensor."""
    whole = piece("sine", 0.0, 20.0)
    optical = whole.signals["correvit.speed"]
    run = without(whole, "correvit")
    sound = replace(run, signals={**run.signals, channel: replace(optical, values=optical.values[:, :1])})
    assert implausible(drive_of(sound)) == []
    (said,) = implausible(drive_of(changed(sound, "wheel.*.speed", "x", 60 / math.tau)))
    assert f"where {channel} is 25.1: is it in 1/min?" in said
    (said,) = implausible(drive_of(changed(sound, channel, "x", 3.6)))
    assert said.startswith(f"{channel} is 90.3 m/s where the wheels roll at 25.6: is it in km/h?")


@pytest.mark.parametrize("channel", ["car.speed", "gnss.speed"])
def test_a_rate_in_degrees_is_told_by_whichever_speed_there_is(channel: str) -> None:
    """And so is a steering camera of the other sign."""
    run = few_instruments("sine")
    optical = run.signals["correvit.speed"]
    run = without(run, "correvit")
    run = replace(run, signals={**run.signals, channel: replace(optical, values=optical.values[:, :1])})
    assert implausible(drive_of(run)) == []
    (said,) = implausible(drive_of(changed(run, "imu.rate", "xyz", DEGREES)))
    assert "imu.rate z times the speed, which should be alike: is the rate in °/s?" in said
    (said,) = implausible(drive_of(changed(run, "camera.*.steer", "x", -1.0)))
    assert said.startswith("camera steer has the sign opposite to imu.rate z")


@pytest.mark.parametrize("name", ["sine", "rough", "liftoff", "sweep"])
def test_nothing_is_said_of_sound_runs(name: str) -> None:
    assert implausible(drive_of(open_run(CAR / f"{name}.parquet"))) == []


@pytest.mark.parametrize("gone", [
    "imu.", "imu.accel", "imu.rate", "imu.attitude", "correvit", "laser.", "laser.fl", "camera.", "camera.fl", "wheel.",
    "wheel.fl", "wheel.fl.speed", "wheel.rr.force",
])  # fmt: skip
def test_what_was_not_measured_is_no_mistake(gone: str) -> None:
    assert implausible(drive_of(without(piece(), gone))) == []


def test_a_car_that_stands_tells_nothing_of_motion() -> None:
    still = changed(piece(), "*", "x", lambda values: 0.0 * values + 0.3)
    assert implausible(drive_of(changed(still, "imu.*", "y", 0.0))) == []


def test_a_model_car_is_not_taken_for_one_in_kilonewtons() -> None:
    """A tenth the size: a tenth of the wheelbase, a thousandth of the mass."""
    corners = {
        name: replace(corner, position=tuple(0.1 * x for x in corner.position), tyre_radius=0.1 * corner.tyre_radius)
        for name, corner in VEHICLE.corners.items()
    }
    small = replace(VEHICLE, corners=corners)
    run = changed(changed(piece(), "wheel.*.force", "xyz", 1e-3), "laser.*", "x", 0.1)
    found = implausible(PreparedRun.of(changed(run, "correvit.speed", "xy", 0.1), small, RIG))
    assert not any("kN" in line for line in found), found


def test_a_user_is_told_when_runs_are_read(tmp_path: Path) -> None:
    run = written(changed(piece(), "imu.accel", "xyz", 1 / 9.80665), tmp_path / "run.parquet")
    assert any(w.endswith("is it in g?") for w in load([run], CAR / "rig.toml", CAR / "vehicle.toml").warnings)


def test_a_unit_that_explains_a_difference_is_named_and_no_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A periodic motion in °/s is alike another's at some lag, too; where no unit explains it the clock is named."""
    clock = ClockDifference("inertial unit", "wheel forces", 1.14, 0.94)
    monkeypatch.setattr(loading, "differing_clocks", lambda run: [clock])
    run = piece("sine", 0.0, 20.0)
    degrees = changed(run, "imu.rate", "xyz", DEGREES)
    said = checked_run(degrees, VEHICLE, RIG, None).compared
    assert said
    assert all("°/s" in line for line in said)
    assert checked_run(run, VEHICLE, RIG, None).compared == (of_clocks(clock),)
