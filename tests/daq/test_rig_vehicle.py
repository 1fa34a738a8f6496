"""Rig and vehicle files: every fault at once, nearest matches, units, signs, overrides."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import RigError, VehicleError
from lacet.daq.rig import DEFAULT_TOLERANCE, Rig
from lacet.daq.units import TO_SI, canonical, to_si
from lacet.daq.vehicle import Vehicle
from tests.support.places import HOME

CAR = HOME / "tests" / "data" / "car"
RIG_TEXT = (CAR / "rig.toml").read_text(encoding="utf-8")
CAR_TEXT = (CAR / "vehicle.toml").read_text(encoding="utf-8")


def rig_faults(text: str) -> list[str]:
    """The faults of a rig text."""
    with pytest.raises(RigError) as caught:
        Rig.parse(text, "my.toml")
    assert str(caught.value).startswith("my.toml:\n")
    return caught.value.faults


def car_faults(text: str) -> list[str]:
    """The faults of a vehicle text."""
    with pytest.raises(VehicleError) as caught:
        Vehicle.parse(text, "my.toml")
    return caught.value.faults


def has(faults: list[str], *parts: str) -> bool:
    """Whether one fault holds all these parts."""
    return any(all(part in fault for part in parts) for fault in faults)


# ---- rigs


def test_the_reference_rig_says_what_its_file_says() -> None:
    """Latency, noise, tolerance, mounts and axes by channel; defaults where it is silent."""
    rig = Rig.load(CAR / "rig.toml")
    assert (rig.name, rig.wheel_reference) == ("reference-car", "hub")
    assert rig.latency("camera.fl.steer") == 0.025
    assert rig.noise("wheel.rr.moment") == 8.0
    assert rig.tolerance("imu.accel", "zero") == 0.02
    assert rig.tolerance("imu.accel", "gain") == DEFAULT_TOLERANCE["imu.accel.gain"]
    assert rig.tolerance("laser.fl.hub", "latency") == 0.002
    imu = rig.sensor_of("imu.rate")
    assert imu is not None
    assert imu.position == {"": (-1.35, 0.1, 0.31)}
    lasers = rig.sensor_of("laser.rl.ground")
    assert lasers is not None
    assert lasers.from_wheel_centre == (0.0, 0.0, 0.30)
    assert rig.text == RIG_TEXT


def test_a_channel_no_sensor_delivers_has_the_tables_noise() -> None:
    """The design noise and default tolerances of the vocabulary."""
    rig = Rig.parse('format = "lacet-rig 1"\nname = "x"\n[[sensor]]\nname = "imu"\nchannels = ["imu.*"]\n')
    assert rig.sensor_of("laser.fl.hub") is None
    assert rig.noise("laser.fl.hub") == CHANNELS["laser.fl.hub"].noise
    assert rig.latency("laser.fl.hub") == 0.0
    assert rig.tolerance("laser.fl.hub", "zero") == DEFAULT_TOLERANCE["laser.hub.zero"]


def test_the_sheet_knows_drift_cross_talk_and_mounting() -> None:
    """By channel family, or for the whole instrument; what a row does not deliver it cannot speak of."""
    head = 'format = "lacet-rig 1"\nname = "x"\n[[sensor]]\nname = "imu"\nchannels = ["imu.*"]\n'
    rig = Rig.parse(
        head + 'tolerance = { "imu.accel.drift" = 0.01, "imu.misalignment" = 0.02, "imu.position" = 0.05 }\n'
    )
    assert rig.tolerance("imu.accel", "drift") == 0.01
    assert rig.tolerance("imu.rate", "drift") == DEFAULT_TOLERANCE["imu.rate.drift"]
    for channel in ("imu.accel", "imu.rate", "imu.attitude"):
        assert (rig.tolerance(channel, "misalignment"), rig.tolerance(channel, "position")) == (0.02, 0.05)
    assert rig.tolerance("wheel.fl.force", "crosstalk") == DEFAULT_TOLERANCE["wheel.force.crosstalk"]
    assert rig.tolerance("wheel.fl.moment", "crosstalk") == 0.0
    assert rig.tolerance("wheel.rr.force", "misalignment") == DEFAULT_TOLERANCE["wheel.misalignment"]
    faults = rig_faults(
        head + 'tolerance = { "imu.accel.crosstalk" = 0.01, "imu.positon" = 1, "imu.misalignment" = -1 }\n'
    )
    assert has(faults, "imu.accel.crosstalk", "unknown key")
    assert has(faults, "imu.positon", "did you mean 'imu.position'")
    assert has(faults, "imu.misalignment", "at least 0")


def test_every_fault_of_a_rig_at_once() -> None:
    """Fourteen mistakes, fourteen lines, with the nearest right word."""
    faults = rig_faults(
        """
format = "lacet-rig 2"
nmae = "x"
wheel_reference = "hubb"
[bus.can0]
kind = "cann"
bitrate = -5
bitrat = 1
[[sensor]]
name = "a"
driver = "igel"
bus = "can1"
channels = ["wheel.fl.forze"]
axes = "carier"
latency = -0.1
clock = "devise"
[[sensor]]
name = "b"
driver = "sagem"
channels = ["imu.*"]
position = [1, 2]
noise = { "imu.acel" = 0.1 }
tolerance = { "imu.accel.zero" = "much" }
[[sensor]]
name = "b"
channels = ["imu.rate", "laser.*.hub"]
position = { fl = [0, 0, 0], fx = [0, 0, 0] }
"""
    )
    for parts in (
        ("format", "lacet-rig 1", "lacet-rig 2"),
        ("nmae", "did you mean 'name'"),
        ("name", "is missing"),
        ("wheel_reference", "contact, hub", "did you mean 'hub'"),
        ("bus.can0.kind", "did you mean 'can'"),
        ("bus.can0.bitrate", "positive whole number", "-5"),
        ("bus.can0.bitrat:", "did you mean 'bitrate'"),
        ("sensor a.bus", "[bus.can1]", "did you mean 'can0'"),
        ("sensor a.channels", "wheel.fl.forze", "did you mean 'wheel.fl.force'"),
        ("sensor a.axes", "did you mean 'carrier'"),
        ("sensor a.latency", "at least 0"),
        ("sensor a.clock", "did you mean 'device'"),
        ("sensor b", "driver and bus go together"),
        ("sensor b.position", "3 numbers"),
        ("sensor b.noise.imu.acel", "did you mean 'imu.accel'"),
        ("sensor b.tolerance.imu.accel.zero", "finite number", "much"),
        ("sensor b", "imu.rate is already delivered by b"),
        ("sensor b", "stands twice"),
        ("sensor b.position.fx", "unknown key"),
        ("sensor b.position", "corner rr is missing"),
    ):
        assert has(faults, *parts), (parts, faults)


HEAD = 'format = "lacet-rig 1"\nname = "x"\n'
HUB, GROUND = (f'[[sensor]]\nname = "{what}"\nchannels = ["laser.*.{what}"]\n' for what in ("hub", "ground"))
MOUNTS = "position = { fl = [0, 1, 0.3], fr = [0, -1, 0.3], rl = [-3, 1, 0.3], rr = [-3, -1, 0.3] }\n"
ROW = '[[sensor]]\nname = "a"\nchannels = ["imu.rate"]\n'


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("format = ", ("not valid TOML",)),
        (HEAD, ("at least one [[sensor]]",)),
        (HEAD + "bus = 3\n" + ROW, ("bus", "must be a table")),
        (HEAD + ROW + 'axes = "heading"', ("sensor a.axes", "imu.rate cannot be in heading axes", "sensor or body")),
        (
            HEAD + ROW.replace("imu.rate", "wheel.*.force") + 'axes = "heading"',
            ("sensor a.axes", "wheel.force cannot be in heading axes", "carrier or tydex_c or body or sensor"),
        ),
        (HEAD + ROW + 'axes = "body"\norientation = [0, 0, 1.57]', ("sensor a.orientation", 'axes = "sensor" alone')),
        (HEAD + HUB + "orientation = [0, 0.1, 0]", ("sensor hub.orientation", "wheel loads, imu.* and correvit.speed")),
        (HEAD + HUB + "position = [0, 1, 0.3]", ("sensor hub.position", "one each corner", "fl = ")),
        (
            HEAD + HUB + MOUNTS + GROUND + MOUNTS.replace("[-3, 1, 0.3]", "[-3, 1, 0.4]"),
            ("sensor ground.position", "at rl is not that of hub", "one mount"),
        ),
        (HEAD + '[[sensor]]\nname = "a"\nchannels = 5', ("sensor a.channels", "must be a list")),
        (HEAD + '[[sensor]]\nname = 5\nchannels = ["imu.rate"]', ("sensor #1.name", "text")),
        (HEAD + 'sensor = ["a"]', ("sensor #1", "[[sensor]]", "'a'")),
        (HEAD + "[bus]\ncan0 = 4\n" + ROW, ("bus.can0", "table")),
        (HEAD + ROW + "latency = nan", ("latency", "finite")),
        (HEAD + ROW + "orientation = [0, true, 0]", ("orientation", "3 numbers")),
    ],
)
def test_odd_rigs(text: str, parts: tuple[str, ...]) -> None:
    """Wrong types anywhere are faults, never tracebacks."""
    assert has(rig_faults(text), *parts)


def test_a_row_has_the_axes_of_its_first_channel_that_may_have_others() -> None:
    """Of a wheel's speed no axes are known, so that the inertial unit beside it says them."""
    row = '[[sensor]]\nname = "bus"\nchannels = ["wheel.fl.speed", "imu.rate"]\n'
    assert Rig.parse(HEAD + row).sensors[0].axes == "sensor"
    both = row.replace("speed", "force")
    assert has(rig_faults(HEAD + both), "sensor bus.axes", "imu.rate cannot be in carrier axes", "without channels in")


def test_a_rig_that_is_not_there_names_the_shipped_ones() -> None:
    """A path that is no file."""
    with pytest.raises(RigError, match="no such file"):
        Rig.load("nowhere/rig.toml")
    with pytest.raises(VehicleError, match="no such file"):
        Vehicle.load("nowhere/car.toml")


# ---- vehicles

TABLE = """
[axle.front.kinematics]
travel = { value = [-50, 0, 50], unit = "mm", source = "bench" }
half_track = { value = [-4, 0, 3], unit = "mm", source = "bench" }
toe = { value = [-0.2, 0.0, 0.1], unit = "deg", source = "bench" }
"""


def test_the_reference_car_says_what_its_file_says() -> None:
    """Positions from wheelbase, track and heights; angles in radians; every number with its source."""
    car = Vehicle.load(CAR / "vehicle.toml")
    assert tuple(car.corners) == CORNERS
    assert car.corners["fl"].position == (0.0, 0.75, 0.0)
    assert car.corners["rr"].position == (-2.7, -0.74, 0.0)
    assert car.corners["fr"].caster == pytest.approx(math.radians(4))
    assert car.corners["rl"].caster == 0.0
    assert [car.corners[c].driven for c in CORNERS] == [True, True, False, False]
    assert {corner.side for c, corner in car.corners.items() if c.endswith("l")} == {1}
    assert all(q.source for q in car.numbers.values())


def test_units_and_bench_tables_are_converted() -> None:
    """Millimetres and degrees to metres and radians, columns that are absent are zero, both front corners have it."""
    car = Vehicle.parse(CAR_TEXT + TABLE)
    for c in ("fl", "fr"):
        table = car.corners[c].table
        assert table is not None
        np.testing.assert_allclose(table.travel, [-0.05, 0, 0.05])
        np.testing.assert_allclose(table.half_track, [-0.004, 0, 0.003])
        np.testing.assert_allclose(table.toe, np.radians([-0.2, 0, 0.1]))
        assert not np.any(table.camber)
    assert car.corners["rl"].table is None


def test_a_corner_overrides_its_axle() -> None:
    """One corner's number replaces its axle's, and only that one."""
    car = Vehicle.parse(
        CAR_TEXT
        + '\n[corner.fr]\ntyre_radius = { value = 31, unit = "cm", source = "worn tyre" }\n'
        + 'wheel_centre_height = { value = 0.29, unit = "m", source = "worn tyre" }\n'
    )
    plain = Vehicle.parse(CAR_TEXT)
    assert car.corners["fr"].tyre_radius == pytest.approx(0.31)
    for c in ("fl", "rl", "rr"):
        assert car.corners[c].tyre_radius == plain.corners[c].tyre_radius
    # The origin lies midway between the front wheel centres: 5 mm lower than before.
    assert car.corners["fl"].position[2] == pytest.approx(0.005)
    assert car.corners["fr"].position[2] == pytest.approx(-0.005)
    assert car.corners["rl"].position[2] == pytest.approx(0.005)


def test_a_length_a_thousand_times_off_is_told() -> None:
    """Millimetres stated for metres and the other way; a kart and a lorry pass."""
    (fault,) = car_faults(CAR_TEXT.replace('value = 2.7, unit = "m"', 'value = 2.7, unit = "mm"'))
    assert has([fault], "geometry.wheelbase", "0.0027 m", "check its unit")
    faults = car_faults(CAR_TEXT.replace("track = { value = 1.48, unit", "track = { value = 1480, unit", 1))
    assert has(faults, "track", "1480 m")
    lengths = re.compile(r'(wheelbase|track|wheel_centre_height|tyre_radius) = \{ value = ([\d.]+), unit = "m"')
    for wheelbase, track, radius in ((1.05, 1.1, 0.13), (7.0, 2.1, 0.52)):
        own = {"wheelbase": wheelbase, "track": track, "tyre_radius": radius, "wheel_centre_height": 0.98 * radius}
        text = lengths.sub(lambda found, own=own: f'{found[1]} = {{ value = {own[found[1]]}, unit = "m"', CAR_TEXT)
        assert Vehicle.parse(text).wheelbase == pytest.approx(wheelbase)


def test_every_fault_of_a_vehicle_at_once() -> None:
    """Wrong key, missing number, bare number, unknown unit, wrong dimension, no source, broken table."""
    text = CAR_TEXT.replace("tyre_radius = {", "tyre_radus = {", 1)
    text = text.replace("track = { value = 1.48, unit", "track = 1.48 # {unit", 1)
    text = text.replace('value = 2.7, unit = "m"', 'value = 2.7, unit = "metrum"')
    text = text.replace('value = 4.0, unit = "deg"', 'value = 4.0, unit = "mm"')
    text = text.replace(
        'value = 10.0, unit = "deg", source = "drawing of the reference car"', 'value = 10.0, unit = "deg"'
    )
    text = text.replace('brakes = "outboard"', 'brakes = "outbord"', 1)
    text = text.replace("driven = false", 'driven = "no"')
    text += TABLE.replace("[-50, 0, 50]", "[-50, 50, 0]").replace("toe =", "tow =")
    faults = car_faults(text)
    for parts in (
        ("tyre_radus", "unknown key", "did you mean 'tyre_radius'"),
        ("tyre_radius is missing",),
        ("axle.rear.track", "needs unit and source"),
        ("wheelbase", "'metrum'", "not known"),
        ("caster", "'mm'", "in rad"),
        ("kingpin_inclination", "source is missing"),
        ("brakes", "did you mean 'outboard'"),
        ("driven", "true or false"),
        ("kinematics.tow", "did you mean 'toe'"),
        ("kinematics.travel", "strictly increasing"),
    ):
        assert has(faults, *parts), (parts, faults)
    assert len(faults) == len(set(faults)), "a fault of an axle is said once, not once a corner"


def test_a_wheel_may_stand_behind_its_axle() -> None:
    """Setback moves one wheel centre rearwards, and may be negative; lasers mounted from it move along."""
    row = 'setback = {{ value = {}, unit = "mm", source = "a car with another wheelbase on each side" }}\n'
    plain = Vehicle.parse(CAR_TEXT)
    car = Vehicle.parse(CAR_TEXT + "\n[corner.rl]\n" + row.format(48) + "[corner.fr]\n" + row.format(-3))
    moved = {c: car.corners[c].position[0] - plain.corners[c].position[0] for c in CORNERS}
    assert moved == pytest.approx({"fl": 0.0, "fr": 0.003, "rl": -0.048, "rr": 0.0})
    assert [k.position[1:] for k in car.corners.values()] == [k.position[1:] for k in plain.corners.values()]


def test_mounts_that_differ_by_corner_are_given_from_the_origin() -> None:
    one = "position_from_wheel_centre = [0.0, 0.0, 0.30]"
    assert one in RIG_TEXT
    faults = rig_faults(RIG_TEXT.replace(one, "position_from_wheel_centre = { fl = [0.0, 0.1, 0.3] }", 1))
    assert has(faults, "position_from_wheel_centre", "one for all wheels", "position = {")


def test_lengths_are_above_zero() -> None:
    """A negative track is a slip of the pen, not a car."""
    assert has(car_faults(CAR_TEXT.replace("value = 1.48", "value = -1.48")), "axle.rear.track", "above zero")


def test_a_table_of_unequal_lengths_is_refused() -> None:
    """With both lengths."""
    assert has(car_faults(CAR_TEXT + TABLE.replace("[-4, 0, 3]", "[-4, 0]")), "half_track", "2 values for 3 of travel")
    assert has(car_faults(CAR_TEXT + TABLE.replace("[-4, 0, 3]", '["a", 0, 3]')), "half_track", "numbers")
    assert has(car_faults(CAR_TEXT + TABLE.replace("[-0.2, 0.0, 0.1]", "[-70, 0, 70]")), "toe", "reaches 70°")
    assert has(car_faults(CAR_TEXT + TABLE.replace("[-4, 0, 3]", "-4")), "half_track", "list of numbers")


def test_a_priori_values_keep_unit_and_source() -> None:
    """For comparison only: in SI, in any unit that the project knows."""
    car = Vehicle.parse(
        CAR_TEXT + '\n[apriori]\nM6 = { value = 1200, unit = "kg", source = "scales" }\n'
        '"spring.fl.k" = { value = 24, unit = "N/mm", source = "drawing" }\n'
    )
    assert car.apriori["M6"].value == 1200
    assert (car.apriori["spring.fl.k"].value, car.apriori["spring.fl.k"].unit) == (24000.0, "N/m")
    bad = CAR_TEXT + '\n[apriori]\nM6 = { value = 1200, unit = "blorp", source = "scales" }\n'
    assert has(car_faults(bad), "M6", "blorp")


# ---- units


@given(st.sampled_from(sorted(TO_SI)), st.floats(-1e6, 1e6))
def test_every_unit_goes_to_si_and_si_stays(unit: str, value: float) -> None:
    """The SI unit of a unit is itself SI with factor one, and spelling it again changes nothing."""
    scaled, si = to_si(value, unit)
    assert to_si(scaled, si) == (scaled, si)
    assert canonical(canonical(unit)) == canonical(unit)
    assert to_si(value, f" {unit} ") == (scaled, si)


@pytest.mark.parametrize(
    ("written", "meant"),
    [("kg*m^2", "kg·m²"), ("kgm2", "kg·m²"), ("N*m", "N·m"), ("Nm", "N·m"), ("N*s/m", "N·s/m"), ("N/(m/s)", "N·s/m"),
     ("m/s2", "m/s²"), ("N / mm", "N/mm"), ("N*s^2/m^2", "N·s²/m²")],
)  # fmt: skip
def test_spellings(written: str, meant: str) -> None:
    """Plain keyboards are welcome."""
    assert canonical(written) == meant


def test_faults_of_the_whole_file_have_no_place_before_them() -> None:
    """``[geometry] is missing``, not ``: [geometry] is missing``."""
    with pytest.raises(VehicleError, match=r"- \[geometry\] is missing"):
        Vehicle.parse('format = "lacet-vehicle 1"\n', "empty.toml")
