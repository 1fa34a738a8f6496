"""Which rows exist, which seconds they lose, and what is said about it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import reconstruct
from lacet.identify.car.measured_rows import available
from lacet.identify.car.rows import RELEASED, ROWS, Row, needs
from lacet.identify.car.torques import Torque, torque_in
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.filters import Filters
from lacet.services.render.rows import row_absence, run_notes
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
ALL = {name for row in ROWS for name in needs(row, "hub")}
SHAFT, BRAKE, PRESSURE = "shaft.rl.torque", "brake.rl.torque", "brake.pressure"


def car(driven: bool, brakes: str, pitch: float = 0.5, toe: float = 0.0) -> Vehicle:
    """The reference car with one kind of corner; slopes of the carrier's pitch and toe in rad/m."""
    s = np.linspace(-0.1, 0.1, 11)
    tables = cars.with_tables(VEHICLE).corners
    corners = {
        c: replace(k, driven=driven, brakes=brakes, table=replace(k.table, travel=s, **{
            name: slope * s for name, slope in
            (("pitch", pitch), ("toe", toe), ("camber", 0.0), ("half_track", 0.1), ("half_wheelbase", 0.0))
        }))
        for c, k in tables.items() if k.table is not None
    }  # fmt: skip
    return replace(VEHICLE, corners=corners)


ELIMINATED, RELEASED_ONLY = Torque(eliminated=True), Torque(eliminated=True, released=True)


@pytest.mark.parametrize(
    ("driven", "where", "measured", "brakes", "suspension", "spin"),
    [
        # a free wheel with an outboard brake: no half-shaft at all
        (False, "outboard", (), "off", Torque(), Torque()),
        (False, "outboard", (), "used", Torque(), "brake torque"),
        (False, "outboard", (), "unknown", Torque(), "brake torque"),
        (False, "outboard", (BRAKE,), "used", Torque(), Torque(brake=BRAKE)),
        (False, "outboard", (PRESSURE,), "used", Torque(), Torque(released=True)),
        # a free wheel whose brake sits inboard: the half-shaft holds its torque
        (False, "inboard", (), "off", ELIMINATED, Torque()),
        (False, "inboard", (), "used", ELIMINATED, "brake torque"),
        (False, "inboard", (BRAKE,), "used", ELIMINATED, Torque(brake=BRAKE)),
        (False, "inboard", (SHAFT,), "used", Torque(shaft=SHAFT), Torque(shaft=SHAFT)),
        # a driven wheel with an outboard brake
        (True, "outboard", (), "off", ELIMINATED, "drive torque"),
        (True, "outboard", (), "used", "half-shaft torque acts", "drive torque"),
        (True, "outboard", (), "unknown", "half-shaft torque acts", "drive torque"),
        (True, "outboard", (PRESSURE,), "unknown", RELEASED_ONLY, "drive torque"),
        (True, "outboard", (PRESSURE,), "off", RELEASED_ONLY, "drive torque"),
        (True, "outboard", (BRAKE,), "used", Torque(brake=BRAKE, eliminated=True), "drive torque"),
        (True, "outboard", (SHAFT,), "off", Torque(shaft=SHAFT), Torque(shaft=SHAFT)),
        (True, "outboard", (SHAFT,), "used", Torque(shaft=SHAFT), "brake torque"),
        (True, "outboard", (SHAFT, PRESSURE), "used", Torque(shaft=SHAFT), Torque(shaft=SHAFT, released=True)),
        (True, "outboard", (SHAFT, BRAKE), "used", Torque(shaft=SHAFT), Torque(shaft=SHAFT, brake=BRAKE)),
        # a driven wheel with an inboard brake: one torque, that of the half-shaft
        (True, "inboard", (), "used", ELIMINATED, "drive torque"),
        (True, "inboard", (SHAFT,), "used", Torque(shaft=SHAFT), Torque(shaft=SHAFT)),
    ],
)
def test_what_is_measured_and_declared_decides(
    driven: bool, where: str, measured: tuple[str, ...], brakes: str, suspension: Torque | str, spin: Torque | str
) -> None:
    """Suspension and spin row of one corner, or the reason why there is none."""
    rows, left_out = available({*ALL, *measured}, car(driven, where), "hub", brakes, CORNERS)
    for row, expected in (("suspension.rl", suspension), ("spin.rl", spin)):
        if isinstance(expected, Torque):
            assert rows[row] == expected
        else:
            assert expected in row_absence(left_out[row])
            assert row not in rows
    assert {*rows, *left_out} == {row for row in ROWS if not row.combined}  # those say nothing beside measured loads
    assert not {row for row in left_out if row.startswith(("chassis", "tyre"))}


def test_a_carrier_that_hardly_turns_keeps_its_row_while_braking() -> None:
    """Below 0.01 rad/m the shaft is neglected under outboard brakes; without slope it is nowhere."""
    for pitch, toe, kept in ((0.0, 0.05, True), (0.008, 0.0, True), (0.02, 0.0, False), (0.0, 0.3, False)):
        torque = torque_in(Row.parse("suspension.rl"), car(True, "outboard", pitch, toe), ALL, "used")
        assert (torque.missing is None) == kept, (pitch, toe)
        assert torque == Torque() or not kept
    assert torque_in(Row.parse("suspension.rl"), car(True, "outboard", 0.0, 0.0), ALL, "off") == Torque()


# ---- seconds


def braked(pressure: np.ndarray | None, seconds: float = 12.0) -> Run:
    """A run of smooth channels, with brake pressure (one value a 10 ms) where it is given."""
    rng = np.random.default_rng(1)
    curves = cars.drive_curves(rng) | {name: cars.MultiSine(rng, 3, 300.0) for name in cars.LOADS}
    signals = {}
    for name, curve in curves.items():
        t = np.arange(0.0, seconds, 1.0 / CHANNELS[name].rate)
        signals[name] = Signal(t + RIG.latency(name), curve.at(t).T, np.zeros(t.size, np.uint8))
    if pressure is not None:
        t = np.arange(0.0, seconds, 0.01)
        signals[PRESSURE] = Signal(t, pressure[:, None], np.zeros(t.size, np.uint8))
    return Run("made", signals, brakes="used")


def test_only_the_seconds_of_braking_are_left_out() -> None:
    """5 to 7 s with 40 bar: those rows lose that and the filters' edge around it, all others nothing."""
    filters, vehicle = Filters(), car(True, "outboard")
    t = np.arange(0.0, 12.0, 0.01)
    motion = reconstruct(braked(np.where((t >= 5.0) & (t < 7.0), 40e5, 0.0)), vehicle, RIG, filters)
    lost = (motion.t > 5.0 - filters.edge + 0.05) & (motion.t < 7.0 + filters.edge - 0.05)
    kept = (motion.t > filters.edge + 0.05) & (motion.t < motion.t[-1] - filters.edge - 0.05)
    kept &= (motion.t < 5.0 - filters.edge - 0.1) | (motion.t > 7.0 + filters.edge + 0.1)
    for row in motion.rows:
        mask = motion.usable[row]
        assert np.all(mask[kept])
        assert np.any(mask[lost]) != row.startswith("suspension"), row
    note = run_notes(motion.notes)[-1]
    assert not motion.notes[-1].is_fault
    rows = "suspension.fl, suspension.fr, suspension.rl, suspension.rr"
    assert re.match(rf"left out 3\.[56] s of {rows}: the brakes act \(brake\.pressure above 1 bar\)", note)
    # A free wheel's spin row likewise; its suspension row has no half-shaft and loses nothing.
    free = reconstruct(braked(np.where((t >= 5.0) & (t < 7.0), 40e5, 0.0)), car(False, "outboard"), RIG, filters)
    assert np.all(free.usable["suspension.rl"][kept | lost])
    assert not np.any(free.usable["spin.rl"][lost])
    # Declared off, but pressed: the pressure is believed.
    off = reconstruct(replace(braked(np.where(t < 6.0, 40e5, 0.0)), brakes="off"), vehicle, RIG, filters)
    assert not np.any(off.usable["suspension.rl"][off.t < 6.0])


def test_seconds_without_a_travel_are_left_out_of_the_axle_s_other_wheel_too() -> None:
    """A bar's force there follows both travels; the tyres and the other axle lose nothing."""
    run, vehicle = braked(None), car(False, "outboard")
    gap = run.signals["laser.rl.hub"]
    gap.flags[(gap.t > 5.0) & (gap.t < 7.0)] = int(Flag.MISSING)
    motion = reconstruct(run, vehicle, RIG)
    lost = (motion.t > 5.0) & (motion.t < 7.0)
    without = {row for row in motion.rows if not np.any(motion.usable[row][lost])}
    assert {"suspension.rl", "suspension.rr", "tyre.rl", "chassis.fx"} <= without
    assert all(np.all(motion.usable[row][lost]) for row in ("suspension.fl", "suspension.fr", "tyre.rr", "tyre.fl"))


def test_released_brakes_cost_nothing_and_brakes_never_released_cost_the_rows() -> None:
    """Half a bar left in the line is released; pressed throughout, the rows are named as left out."""
    t, vehicle = np.arange(0.0, 12.0, 0.01), car(True, "outboard")
    quiet = reconstruct(braked(np.full(t.size, 0.5 * RELEASED)), vehicle, RIG)
    assert not quiet.notes
    assert np.array_equal(quiet.usable["suspension.fl"], quiet.usable["chassis.fx"])
    pressed = PreparedRun.of(braked(np.full(t.size, 20e5)), vehicle, RIG)
    for c in CORNERS:
        assert f"suspension.{c}" not in pressed.rows
        assert "the brakes act" in row_absence(pressed.motion.left_out[f"suspension.{c}"])


def test_without_any_brake_signal_the_whole_run_is_left_out_by_name() -> None:
    """The reason names what would have helped."""
    motion = reconstruct(braked(None), car(True, "outboard"), RIG)
    why = row_absence(motion.left_out["suspension.rl"])
    for word in (SHAFT, BRAKE, PRESSURE, "brakes = 'off'"):
        assert word in why
    assert not motion.notes


def test_a_hole_in_a_torque_costs_the_rows_it_enters() -> None:
    """Unusable samples of the half-shaft's torque are left out of its suspension and spin row."""
    run = replace(braked(None), brakes="off")
    t = np.arange(0.0, 12.0, 0.002)
    flags = np.where((t > 5.0) & (t < 6.0), np.uint8(int(Flag.MISSING)), np.uint8(0)).astype(np.uint8)
    run = replace(run, signals={**run.signals, SHAFT: Signal(t, np.zeros((t.size, 1)), flags)})
    motion = reconstruct(run, car(True, "outboard"), RIG)
    inside = (motion.t > 5.1) & (motion.t < 5.9)
    assert {row for row in motion.rows if not np.any(motion.usable[row][inside])} == {"suspension.rl", "spin.rl"}
