"""Each row's definition on a car in another engine, whose carriers hang on inclined swing arms (`swing_car`).

With the true parameters every row closes to 1e-4 N or N·m, in both references, at any state, load and torque. Each
definition is then got wrong on purpose, and the row it belongs to opens by what is stated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.vectors import Array, dot, turn
from lacet.identify.regression.sensitivity import Sensitivity, residual
from lacet.identify.signals.reconstruct import Signals
from tests.identify import cars

pytest.importorskip("mujoco")
from tests.support import swing_car as swing

LEVEL, BANKED = (0.0, 0.0, 1.0), (0.05, 0.25, 1.0)
"""Normals of the road: level, and banked by 14° with 3° of grade."""
REFERENCES = pytest.mark.parametrize("reference", ["contact", "hub"])
CLOSED = 1e-4
"""Largest |Y − W θ| of a row that is right [N, N·m]."""
TORQUES = ("shaft", "brake")

Special = tuple[str, str, float]
"""Letters of the driven corners, of those with inboard brakes, and a camber that all wheels lean outwards by [rad]."""
PLAIN: Special = ("r", "", 0.0)
INBOARD: Special = ("r", "r", 0.0)
LEANING: Special = ("r", "", 0.20)


@cache
def vehicle(special: Special) -> Vehicle:
    """The car's vehicle file, with the bench tables that follow from its arms."""
    return Vehicle.parse(swing.vehicle_text(swing.default_car(*special)))


@cache
def instants(reference: str, special: Special, road: tuple[float, ...], drive: float, brake: float) -> swing.Moments:
    """Random instants of the car on a road; 1 σ of the torques [N·m]."""
    engine = swing.SwingEngine(swing.default_car(*special), np.array(road))
    return swing.moments(engine, reference, 3, 12, drive, brake)


def motion_of(
    reference: str, measured: tuple[str, ...] = (), brakes: str = "off", special: Special = PLAIN,
    road: tuple[float, ...] = LEVEL, drive: float = 800.0, brake: float = 0.0,
) -> Motion:  # fmt: skip
    """The motion of those instants; of the torque channels only those of the families `measured`."""
    found = instants(reference, special, road, drive, brake)
    parts = {name: name.partition(".")[0] for name in found.value}
    value = {name: found.value[name] for name, part in parts.items() if part not in TORQUES or part in measured}
    rig = Rig.parse(swing.rig_text(reference))
    return build_motion(cars.recording(Signals(value, found.rate, found.accel), vehicle(special), rig, brakes=brakes))


def left_over(motion: Motion, special: Special = PLAIN) -> dict[str, float]:
    """Largest |Y − W θ| of each row with the true parameters [N, N·m]."""
    effects, true = (
        base_model(vehicle(special), motion.reference),
        swing.truth(swing.default_car(*special), motion.reference),
    )
    theta = np.array([true[p.name] for effect in effects for p in effect.parameters])
    return {row: float(np.max(np.abs(r))) for row, r in residual(motion, effects, theta).items()}


def wrong(motion: Motion, change: Callable[[CornerMotion], Mapping[str, Array]], special: Special = PLAIN):
    """What is left over when something of every corner is changed."""
    corners = {c: replace(corner, **change(corner)) for c, corner in motion.corners.items()}
    return left_over(replace(motion, corners=corners), special)


def opened(found: Mapping[str, float], row: str, least: float) -> None:
    """A row has opened at a corner at the rear, where arms are short, by at least this."""
    assert max(found[f"{row}.rl"], found[f"{row}.rr"]) > least, found


# ---- everything right


@REFERENCES
@pytest.mark.parametrize("road", [LEVEL, BANKED])
@pytest.mark.parametrize("special", [PLAIN, INBOARD, LEANING])
def test_every_row_closes(reference: str, road: tuple[float, ...], special: Special) -> None:
    """All 18 rows, with drive torque and braking, all torques measured."""
    motion = motion_of(reference, TORQUES, "used", special, road, brake=1500.0)
    found = left_over(motion, special)
    assert len(found) == 18, motion.left_out
    assert max(found.values()) < CLOSED, found


# ---- torques on the wheel


@REFERENCES
def test_a_half_shaft_lifts_an_inclined_carrier(reference: str) -> None:
    """Measured, or eliminated with the spin row; without it the row opens by kilonewtons."""
    measured, eliminated = motion_of(reference, ("shaft",)), motion_of(reference)
    for motion in (measured, eliminated):
        found = left_over(motion)
        assert max(found[f"suspension.{c}"] for c in CORNERS) < CLOSED
        assert max(found[f"chassis.{k}"] for k in ("fx", "fz", "mx", "my")) < CLOSED, "torques are internal"
    assert "spin.rl" in measured.rows
    assert "spin.rl" not in eliminated.rows
    assert "shaft.rl.torque" in eliminated.left_out["spin.rl"].channels
    opened(wrong(measured, lambda c: {"torque_work": 0 * c.travel}), "suspension", 1000.0)
    opened(wrong(measured, lambda c: {"torque_work": -c.torque_work}), "suspension", 2000.0)
    # Half an elimination: the moment's part about the axis taken out, the wheel's spin inertia left in.
    half = wrong(
        eliminated,
        lambda c: {
            "wheel_dphi_ds": c.dphi_ds,
            "torque_work": -dot(c.moment, c.spin_axis) * dot(c.spin_axis, c.dphi_ds),
        },
    )
    opened(half, "suspension", 150.0)


@REFERENCES
def test_an_outboard_brake_does_nothing_to_the_travel(reference: str) -> None:
    """It reacts on the carrier. Counted like a half-shaft it opens the row; so does eliminating across it."""
    motion = motion_of(reference, TORQUES, "used", brake=1500.0)
    assert max(left_over(motion)[f"suspension.{c}"] for c in CORNERS) < CLOSED
    added = motion_of(reference, TORQUES, "used", brake=1500.0)
    found = instants(reference, PLAIN, LEVEL, 800.0, 1500.0).value
    corners = {
        c: replace(k, torque_work=k.torque_work - dot(k.spin_axis, k.dphi_ds) * found[f"brake.{c}.torque"][0])
        for c, k in added.corners.items()
    }
    opened(left_over(replace(added, corners=corners)), "suspension", 2000.0)
    opened(left_over(motion_of(reference, brake=1500.0, brakes="off")), "suspension", 2000.0)  # declared wrongly


@REFERENCES
def test_with_its_torque_measured_an_outboard_brake_is_eliminated_too(reference: str) -> None:
    """The half-shaft is not: the spin row then gives it from moment, inertia and brake."""
    motion = motion_of(reference, ("brake",), "used", brake=1500.0)
    found = left_over(motion)
    assert max(found[f"suspension.{c}"] for c in CORNERS) < CLOSED
    assert max(found[f"spin.{c}"] for c in ("fl", "fr")) < CLOSED
    assert {"spin.rl", "spin.rr"} <= set(motion.left_out)


@REFERENCES
def test_an_inboard_brake_works_through_the_half_shaft(reference: str) -> None:
    """Braking hard with nothing measured: the row stays and closes; taken for an outboard brake it opens."""
    motion = motion_of(reference, (), "used", INBOARD, brake=1500.0)
    found = left_over(motion, INBOARD)
    assert max(found[f"suspension.{c}"] for c in CORNERS) < CLOSED
    outboard = wrong(motion, lambda c: {"wheel_dphi_ds": c.dphi_ds}, INBOARD)
    opened(outboard, "suspension", 2000.0)
    measured = motion_of(reference, ("shaft",), "used", INBOARD, brake=1500.0)
    assert (
        max(left_over(measured, INBOARD)[f"{row}.{c}"] for row in ("suspension", "spin") for c in ("rl", "rr")) < CLOSED
    )


@REFERENCES
def test_spin_rows_hold_the_net_torque_and_the_spin_in_space(reference: str) -> None:
    """A brake's sign, or the speed on the carrier taken for that in space, opens the row."""
    motion = motion_of(reference, TORQUES, "used", brake=1500.0)
    assert max(left_over(motion)[f"spin.{c}"] for c in CORNERS) < CLOSED
    opened(wrong(motion, lambda c: {"torque": -c.torque}), "spin", 2000.0)
    turning = [dot(k.spin_axis, k.dphi_ds) * k.accel for k in motion.corners.values()]
    assert max(np.max(np.abs(x)) for x in turning) > 5.0, "the carriers hardly turn: the test would not see it"


# ---- geometry


@REFERENCES
def test_slopes_belong_to_every_row_and_to_each_corner(reference: str) -> None:
    """Jacking and anti-squat, the carrier's pitch in the loads, and the other side's table."""
    motion = motion_of(reference, ("shaft",))
    vertical = np.array([[0.0], [0.0], [1.0]])
    opened(wrong(motion, lambda c: {"dp_ds": vertical + 0 * c.dp_ds}), "suspension", 300.0)
    opened(wrong(motion, lambda c: {"wheel_dphi_ds": 0 * c.dphi_ds}), "suspension", 300.0)

    def level(c: CornerMotion) -> dict[str, Array]:
        out = {}
        for name in ("force", "moment"):
            carrier = turn(1, -c.pitch, turn(0, -c.camber, turn(2, -c.steer, getattr(c, name))))
            out[name] = turn(2, c.steer, turn(0, c.camber, carrier))
        return out

    assert wrong(motion, level)["chassis.fx"] > 200.0
    left = {c: replace(k, table=vehicle(PLAIN).corners[c[0] + "l"].table) for c, k in vehicle(PLAIN).corners.items()}
    found = instants(reference, PLAIN, LEVEL, 800.0, 0.0)
    alike = replace(vehicle(PLAIN), corners=left)
    record = cars.recording(Signals(found.value, found.rate, found.accel), alike, Rig.parse(swing.rig_text(reference)))
    assert left_over(build_motion(record))["suspension.rr"] > 30.0


@REFERENCES
@pytest.mark.parametrize("special", [PLAIN, LEANING])
def test_deflection_is_along_the_banked_roads_normal(reference: str, special: Special) -> None:
    """The plain difference of the lasers misses 900 N on a banked road, 4.7 kN with large camber."""
    motion = motion_of(reference, ("shaft",), special=special, road=BANKED)
    assert max(left_over(motion, special)[f"tyre.{c}"] for c in CORNERS) < CLOSED
    found = instants(reference, special, BANKED, 800.0, 0.0).value
    naive = {c: swing.RADIUS - (found[f"laser.{c}.ground"] - found[f"laser.{c}.hub"])[0] for c in CORNERS}
    corners = {c: replace(k, deflection=naive[c]) for c, k in motion.corners.items()}
    opened(left_over(replace(motion, corners=corners), special), "tyre", 500.0)
    # As if the wheel stood upright on the road.
    upright = wrong(motion, lambda c: {"deflection": swing.RADIUS - c.height}, special)
    opened(upright, "tyre", 500.0)
    along_z = wrong(motion, lambda c: {"normal": np.array([[0.0], [0.0], [1.0]]) + 0 * c.normal}, special)
    opened(along_z, "tyre", 100.0)


def test_the_outboard_mass_belongs_to_the_tyre_row_of_hub_loads() -> None:
    """Without its weight and acceleration the row opens by its size; of contact loads it has no part."""
    motion = motion_of("hub", road=BANKED)
    opened(wrong(motion, lambda c: {"centre_accel": 0 * c.centre_accel}), "tyre", 150.0)
    contact = motion_of("contact", road=BANKED)
    np.testing.assert_allclose(
        [left_over(contact)[f"tyre.{c}"] for c in CORNERS],
        [wrong(contact, lambda c: {"centre_accel": 0 * c.centre_accel})[f"tyre.{c}"] for c in CORNERS],
    )


@REFERENCES
def test_gyroscopic_moments_of_the_wheels_are_in_the_chassis_rows(reference: str) -> None:
    """Without the wheels' speeds roll moments are wrong: no chassis row is formed then."""
    found = instants(reference, PLAIN, LEVEL, 800.0, 0.0)
    silent = {**found.value, **{f"wheel.{c}.speed": 0 * found.value[f"wheel.{c}.speed"] for c in CORNERS}}
    rig = Rig.parse(swing.rig_text(reference))
    without = build_motion(cars.recording(Signals(silent, found.rate, found.accel), vehicle(PLAIN), rig))
    assert left_over(without)["chassis.mx"] > (100.0 if reference == "contact" else 10.0)
    lost = {name: x for name, x in found.value.items() if name != "wheel.fl.speed"}
    motion = build_motion(cars.recording(Signals(lost, found.rate, found.accel), vehicle(PLAIN), rig))
    gone = {"suspension.fl", "spin.fl"} | {row for row in motion.left_out if row.startswith("chassis")}
    assert set(motion.left_out) == gone
    assert len(gone) == 8


@REFERENCES
@pytest.mark.parametrize("road", [LEVEL, BANKED])
def test_the_rate_of_deflection_is_its_derivative(reference: str, road: tuple[float, ...]) -> None:
    """Every signal moved along its rate: the deflection moves by its own."""
    found = instants(reference, LEANING, road, 800.0, 0.0)
    rig, h = Rig.parse(swing.rig_text(reference)), 1e-5

    def deflections(step: float) -> dict[str, Array]:
        value = {name: x + step * found.rate.get(name, 0.0) for name, x in found.value.items()}
        motion = build_motion(cars.recording(Signals(value, found.rate, found.accel), vehicle(LEANING), rig))
        return {c: k.deflection for c, k in motion.corners.items()}

    ahead, behind = deflections(h), deflections(-h)
    for c, k in motion_of(reference, special=LEANING, road=road).corners.items():
        np.testing.assert_allclose(k.deflection_rate, (ahead[c] - behind[c]) / (2 * h), atol=1e-7)


def test_noise_and_zeros_of_torques_reach_the_rows_they_enter() -> None:
    """A torque's slope is n·∂φ/∂s in its suspension row and 1 in its spin row."""
    found = instants("hub", PLAIN, LEVEL, 800.0, 1500.0)
    record = cars.recording(
        Signals(found.value, found.rate, found.accel), vehicle(PLAIN), Rig.parse(swing.rig_text("hub")), brakes="used"
    )
    tiled = record.at(np.tile(np.arange(12), 200))
    tiled = replace(tiled, t=np.arange(2400) / record.filters.rate)
    effects = base_model(vehicle(PLAIN), "hub")
    true = swing.truth(swing.default_car(*PLAIN), "hub")
    theta = np.array([true[p.name] for effect in effects for p in effect.parameters])
    slopes = Sensitivity.of(tiled, effects, theta).slopes
    comb = np.arange(0, 2400, round(0.04 * record.filters.rate))
    corner = build_motion(tiled).corners["rl"]
    shaft, brake = slopes["shaft.rl.torque", 0, 0], slopes["brake.rl.torque", 0, 0]
    assert set(shaft) == {"suspension.rl", "spin.rl"}
    assert set(brake) == {"spin.rl"}
    np.testing.assert_allclose(shaft["spin.rl"], 1.0, atol=1e-6)
    np.testing.assert_allclose(brake["spin.rl"], -1.0, atol=1e-6)
    about_axis = dot(corner.spin_axis, corner.dphi_ds)
    np.testing.assert_allclose(np.broadcast_to(shaft["suspension.rl"], 2400)[comb], about_axis[comb], atol=1e-6)
