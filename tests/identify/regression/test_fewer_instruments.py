"""Rigs with fewer instruments on the reference car: what each identifies, and the truth within its intervals.

The tables are the reference car's own, without the channels that a rig has not, or with those it has instead. The car
follows laws of its own: what is assumed of it is off by what it happens to be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import CHASSIS_ROWS, ROWS, SPIN_ROWS, SUSPENSION_ROWS, TYRE_ROWS, Row, lacking
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import derivative, zero_phase
from lacet.identify.validation.parameter_estimates import estimates
from lacet.identify.validation.row_sources import assumed_channels, row_sources
from lacet.services.render.identifiability import unidentified
from lacet.services.render.row_needs import needs_text, to_add
from lacet.services.render.tables import WIDTH
from tests.identify import cars

STATED = """
[assumed]
motion_ratio = { value = 0.8, tolerance = 0.008, unit = "-", source = "drawing" }
pushrod_ratio = { value = 0.8, tolerance = 0.008, unit = "-", source = "drawing" }
outboard_mass = { value = 22, tolerance = 3, unit = "kg", source = "wheel on the scales" }
unsprung_mass.front = { value = 54, tolerance = 3, unit = "kg", source = "drawing" }
unsprung_mass.rear = { value = 46, tolerance = 3, unit = "kg", source = "drawing" }
"""
_, RIG = cars.reference_car()
VEHICLE = Vehicle.parse(cars.reference_car()[0].text + STATED)
HUB = RIG.wheel_reference
INERTIAL = ("imu.accel", "imu.rate")
FZ = (Row.parse("chassis.fz"),)
EXTRA = ("anti_roll_bar.front", "anti_roll_bar.rear")
Made = Mapping[str, Signal]


@dataclass(frozen=True)
class Instruments:
    """A rig: the channels of the tables that it has, those made from them, and the rows it must give."""

    keep: Callable[[str], bool]
    rows: tuple[Row, ...]
    make: Callable[[Run], Made] = lambda _: {}


def no_wheels(name: str) -> bool:
    return not name.startswith("wheel.")


def of(run: Run, pattern: str, source: str, change: Callable[[np.ndarray], np.ndarray]) -> Made:
    """A channel at each corner from another of the same time base, without the latency of that."""
    out: dict[str, Signal] = {}
    for c in CORNERS:
        signal, latency = run.signals[source.format(c=c)], RIG.latency(source.format(c=c))
        out[pattern.format(c=c)] = replace(signal, t=signal.t - latency, values=change(signal.values))
    return out


def gauged(run: Run) -> Made:
    """Pushrod forces: what the springs and dampers take of the wheel load, the inboard unsprung mass' inertia aside."""
    out: dict[str, Signal] = {}
    for c, mass in zip(CORNERS, (32.0, 32.0, 24.0, 24.0), strict=True):
        load, hub, accel = (run.signals[name] for name in (f"wheel.{c}.force", f"laser.{c}.hub", "imu.accel"))
        t = load.t - RIG.latency(f"wheel.{c}.force")
        rate = 1.0 / float(np.median(np.diff(t)))
        travel = -derivative(derivative(zero_phase(hub.values.T, 25.0, rate, 6), rate), rate)[0]
        at_hub = np.interp(t, hub.t - RIG.latency(f"laser.{c}.hub"), travel)
        body = vertical(run, c)
        body = np.interp(t, accel.t - RIG.latency("imu.accel"), body)
        out[f"pushrod.{c}.force"] = replace(
            load, t=t, values=(load.values[:, 2] - mass * (body + at_hub))[:, None] / 0.8
        )
    return out


def vertical(run: Run, corner: str) -> np.ndarray:
    """The body's vertical specific force at a wheel centre [m/s²]."""
    accel, rate = run.signals["imu.accel"].values.T, run.signals["imu.rate"].values.T
    sampled = 1.0 / float(np.median(np.diff(run.signals["imu.rate"].t)))
    turning = derivative(zero_phase(rate, 25.0, sampled, 6), sampled)
    arm = np.asarray(VEHICLE.corners[corner].position) - np.asarray(RIG.sensors[1].position[""])
    return accel[2] + turning[0] * arm[1] - turning[1] * arm[0]


RIGS = {
    "hubs": Instruments(lambda n: n.endswith(".force") or n in INERTIAL, CHASSIS_ROWS),
    "cells": Instruments(
        no_wheels,
        (*FZ, *SUSPENSION_ROWS, *TYRE_ROWS),
        lambda run: of(run, "hub.{c}.load", "wheel.{c}.force", lambda a: a[:, 2:]),
    ),
    "potentiometers": Instruments(
        lambda n: not n.endswith(".hub"),
        (*CHASSIS_ROWS, *SUSPENSION_ROWS, *TYRE_ROWS),
        lambda run: of(run, "damper.{c}.travel", "laser.{c}.hub", lambda a: 0.8 * (0.3 - a)),
    ),
    "no attitude": Instruments(
        lambda n: n not in ("imu.attitude", "laser.rl.ground", "laser.rr.ground"),
        (*CHASSIS_ROWS, *SUSPENSION_ROWS, *TYRE_ROWS[:2]),
    ),
    "one laser": Instruments(
        lambda n: not n.endswith(".hub") or n == "laser.fl.hub",
        (*CHASSIS_ROWS, SUSPENSION_ROWS[0], TYRE_ROWS[0]),
    ),
    "pushrods": Instruments(
        no_wheels,
        (*FZ, *SUSPENSION_ROWS, *TYRE_ROWS),
        gauged,
    ),
}


def fitted(rig: str) -> Fit:
    """The base model and both bars, fitted to ten seconds of a smooth and of a rough road."""
    runs: list[PreparedRun] = []
    for name in ("sine", "rough"):
        whole = cars.piece(name, 5.0, 15.0)
        signals = {n: s for n, s in whole.signals.items() if RIGS[rig].keep(n)} | RIGS[rig].make(whole)
        runs.append(PreparedRun.of(replace(whole, signals=signals), VEHICLE, RIG))
    known = catalogue(VEHICLE, HUB)
    return fit(Model.of([*base_model(VEHICLE, HUB), *(known[key] for key in EXTRA)]), runs, FitOptions(draws=2))


@pytest.mark.parametrize("rig", RIGS)
def test_a_rig_gives_its_rows_and_the_truth_is_in_its_intervals(rig: str, truth: dict[str, Any]) -> None:
    """Nine of ten values of the car at least, and all within twice their intervals; mass to half a percent."""
    found = fitted(rig)
    assert set(found.rows) >= set(RIGS[rig].rows)
    right = expected(truth)
    off: dict[str, float] = {}
    for e in estimates(found, None, found.runs):
        if e.identifiable and e.name in right and e.group in ("", e.name):
            off[e.name] = abs(e.value - right[e.name]) / e.half_sheet
    whole = whole_vehicle(replace(found, covariance=found.covariance + found.covariance_sheet), VEHICLE)
    if whole is not None and {*CHASSIS_ROWS} <= set(found.rows):
        for k, name in enumerate(NAMES[:4]):
            if whole.determined[k]:
                off[name] = abs(float(whole.values[k]) - right[name]) / float(whole.interval[k])
        assert "mass" in off
        assert whole.values[0] == pytest.approx(right["mass"], rel=0.005)
    assert off, "the rig identifies nothing"
    assert max(off.values()) < 2.0, off
    assert np.mean([size < 1.0 for size in off.values()]) >= 0.8, off


def expected(truth: dict[str, Any]) -> dict[str, float]:
    """True values by name, inboard of the dynamometers."""
    design, axle = truth["inboard_at_design"], {"f": "front", "r": "rear"}
    out = {"mass": design["mass_kg"], **dict(zip(("cog.x", "cog.y", "cog.z"), design["cog_m"], strict=True))}
    for c in CORNERS:
        out[f"spring.{c}.k"] = truth["suspension"][axle[c[0]]]["k_N_m"]
        out[f"damper.{c}.c"] = truth["suspension"][axle[c[0]]]["c_Ns_m"]
        out[f"tyre_stiffness.{c}.kt"] = truth["tyre_vertical_stiffness_N_m"]
    for name, k in truth["anti_roll_bar_N_per_m_of_travel_difference"].items():
        out[f"anti_roll_bar.{name}.k"] = k
    return out


def bus(run: Run) -> Made:
    """Yaw rate and lateral acceleration alone, at the body's origin."""
    rate, accel = run.signals["imu.rate"], run.signals["imu.accel"]
    late = RIG.latency("imu.rate")
    arm = np.asarray(RIG.sensors[1].position[""])
    sampled = 1.0 / float(np.median(np.diff(rate.t)))
    turning = derivative(zero_phase(rate.values.T, 25.0, sampled, 6), sampled)
    lateral = accel.values[:, 1] - turning[2] * arm[0] + turning[0] * arm[2]
    return {
        "car.yaw_rate": replace(rate, t=rate.t - late, values=rate.values[:, 2:]),
        "car.lateral_accel": replace(accel, t=accel.t - late, values=lateral[:, None]),
    }


def test_what_vertical_loads_leave_out_is_said() -> None:
    """Load cells: yaw inertia needs forces, not a manoeuvre; spin rows all torques; no row of the body is named."""
    found = fitted("cells")
    every = {e.name: unidentified(e.why) for e in estimates(found, None, found.runs)}
    assert every["ZZ6"] == "chassis.mx and others left out: needs: wheel.*.force"
    assert every["MZ6"].endswith("would show it, and needs: wheel.*.force")
    sources = {one.row: one for one in row_sources(found)}
    assert not any(row.combined for row in sources)
    assumed = {row: tuple(one.assumed) for row, one in sources.items() if one.assumed}
    assert assumed_channels(found, dict.fromkeys(assumed, 0.0)) == assumed != {}
    rests = {row: 1.96 * sources[row].moved for row in assumed}
    assert assumed_channels(found, rests) == assumed
    assert not assumed_channels(found, {row: 1.01 * size for row, size in rests.items()})
    driven, free = (to_add(row, sources[row].absence) for row in SPIN_ROWS[::2])
    brake = "brake.{}.torque (or brake.pressure, a run with brakes = 'off')"
    assert driven == f"needs: wheel.fl.moment, shaft.fl.torque, {brake.format('fl')}"
    assert free == f"needs: wheel.rl.moment, {brake.format('rl')}"


def test_what_each_row_needs_is_said_without_what_can_be_assumed() -> None:
    """No wheel load for the body's rows; the car's own bus serves where all of it does."""
    text = needs_text(ROWS, "contact")
    heave, fy, fx = (text.partition(f"  {row} [")[2].partition("]\n")[2].partition("]")[0] for row in
                     ("body.heave", "chassis.fy", "chassis.fx"))  # fmt: skip
    assert "wheel." not in heave
    assert "laser.*.hub (or suspension.*.travel, damper.*.travel)" in heave
    assert "imu.rate (or car.yaw_rate)" in fy
    assert "car.yaw_rate" not in fx.partition("chassis.fy")[0]
    assert max(map(len, text.splitlines())) <= WIDTH


def test_what_a_recording_lacks_for_a_row() -> None:
    """A tyre its own ground laser, and attitude or three of them; the body's rows nothing beside wheel loads."""
    hubs = {*INERTIAL, *(f"laser.{c}.hub" for c in CORNERS)}
    cells = hubs | {f"hub.{c}.load" for c in CORNERS}
    tyre, heave = TYRE_ROWS[0], Row.parse("body.heave")
    assert lacking(tyre, "contact", cells) == ("laser.fl.ground", "imu.attitude")
    assert lacking(tyre, "contact", cells | {"car.speed"}) == ("laser.fl.ground",)
    assert lacking(tyre, "contact", cells | {f"laser.{c}.ground" for c in CORNERS[:3]}) == ()
    assert lacking(heave, "contact", {*INERTIAL}) == tuple(f"laser.{c}.hub" for c in CORNERS)
    assert lacking(heave, "contact", hubs) == lacking(heave, "contact", cells - hubs) == ()


def test_yaw_rate_and_lateral_acceleration_alone_give_two_rows(truth: dict[str, Any]) -> None:
    """Three-axis hubs and the car's own bus: the lateral and the yaw row, and the mass from them."""
    sensors = tuple(sensor for sensor in RIG.sensors if sensor.name != "imu")
    whole = cars.piece("sine", 5.0, 25.0)
    signals = {n: s for n, s in whole.signals.items() if n.endswith(".force")} | bus(whole)
    run = PreparedRun.of(replace(whole, signals=signals), VEHICLE, replace(RIG, sensors=sensors))
    assert run.rows == (Row.parse("chassis.fy"), Row.parse("chassis.mz"))
    found = fit(Model.of(base_model(VEHICLE, HUB)), [run], FitOptions(draws=2))
    whole_car = whole_vehicle(replace(found, covariance=found.covariance + found.covariance_sheet), VEHICLE, [run])
    assert whole_car is not None
    assert whole_car.determined[0]
    assert abs(whole_car.values[0] - truth["inboard_at_design"]["mass_kg"]) < whole_car.interval[0]
    # Roll is assumed: so would be the height of the centre of gravity, which acts by it.
    every = {e.name: e.why for e in estimates(found, None, [run])}
    assert "needs: imu.rate" in unidentified(every["MZ6"])
    assert whole_car.determined[1]
    assert not whole_car.determined[3]


def standing(seconds: float = 10.0) -> Run:
    """The reference car standing on corner scales, its inertial unit and hub lasers on."""
    rng, t = np.random.default_rng(5), np.arange(0.0, seconds, 0.004)
    loads = {"fl": 3460.75, "fr": 3460.75, "rl": 2768.6, "rr": 2768.6}
    design = {"fl": 56.0, "fr": 56.0, "rl": 48.0, "rr": 48.0}  # mass of everything unsprung, tyre included
    still = {
        "imu.accel": [0.0, 0.0, 9.80665],
        "imu.rate": [0.0, 0.0, 0.0],
        **{f"laser.{c}.hub": [0.3] for c in CORNERS},
        **{f"scale.{c}.load": [loads[c] + 9.80665 * design[c]] for c in CORNERS},
    }
    signals: dict[str, Signal] = {}
    for name, values in still.items():
        noise = CHANNELS[name].noise * rng.standard_normal((t.size, len(values)))
        signals[name] = Signal(t, np.asarray(values) + noise, np.zeros(t.size, np.uint8))
    return Run("scales", signals, brakes="off")


def test_corner_scales_give_the_static_rows() -> None:
    """Standing on scales: vertical force and every suspension's static load, which is that of the car."""
    run = PreparedRun.of(standing(), VEHICLE, RIG)
    assert set(run.rows) >= {*FZ, *SUSPENSION_ROWS}
    total = float(np.mean(run.measured[FZ[0]]))
    outboard = sum(VEHICLE.assumption("outboard_mass", c).value for c in CORNERS)
    scales = sum(float(np.mean(standing().signals[f"scale.{c}.load"].values)) for c in CORNERS)
    assert total == pytest.approx(scales - 9.80665 * outboard, abs=5.0)


def test_a_scale_measures_along_the_vertical_while_the_body_rolls_and_the_wheel_leans() -> None:
    """On posts that roll the car by 3°: no part of the load lies in the road, whatever the camber."""
    run = standing()
    t = run.signals["imu.accel"].t
    roll, rate = 0.05 * np.sin(t), 0.05 * np.cos(t)
    zero = np.zeros_like(t)
    signals = run.signals | {
        "imu.accel": Signal(t, 9.80665 * np.stack([zero, np.sin(roll), np.cos(roll)], 1), zero.astype(np.uint8)),
        "imu.rate": Signal(t, np.stack([rate, zero, zero], 1), zero.astype(np.uint8)),
        "camera.fl.camber": Signal(t, np.full((t.size, 1), 0.04), zero.astype(np.uint8)),
        **{f"scale.{c}.load": Signal(t, np.full((t.size, 1), 4000.0), zero.astype(np.uint8)) for c in CORNERS},
    }
    prepared = PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG)
    assert prepared.recording.sources["imu.attitude"].inputs == ("imu.accel", "imu.rate")
    motion, inside = prepared.motion, slice(200, -200)
    upright = np.stack([np.zeros(motion.t.size), np.sin(0.05 * np.sin(motion.t)), np.cos(0.05 * np.sin(motion.t))])
    for c in CORNERS:
        load = 4000.0 - 9.80665 * VEHICLE.assumption("outboard_mass", c).value
        force = motion.corners[c].force[:, inside]
        # The rest is gravity at an inertial unit that swings with the body, taken for its attitude.
        assert np.max(np.linalg.norm(force - load * upright[:, inside], axis=0)) < 0.005 * load


def test_every_rig_names_known_channels() -> None:
    """The made channels are of the vocabulary."""
    whole = cars.piece("sine", 5.0, 6.0)
    assert all(name in CHANNELS for rig in RIGS.values() for name in rig.make(whole))
