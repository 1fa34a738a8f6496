"""The 406 of the paper's tables 5 to 7: four corners that differ, friction at each, on a road under steering."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.reproduction.published_tables import LINES
from lacet.simulate import Hidden, find_car, make_manoeuvre, run
from lacet.simulate.sensors import felt
from lacet.simulate.tyre import WheelTyre
from lacet.simulate.vehicle_file import vehicle_text
from tests.simulate.simulated_drives import drive

CAR = find_car("peugeot-406-measured")


def test_the_car_is_what_the_paper_estimated() -> None:
    of = {"spring": "stiffness", "damper": "damping", "tyre_stiffness": "tyre_stiffness"}
    whole = {"mass": CAR.total.mass, "Ixx": CAR.total.tensor[0][0], "Izz": CAR.total.tensor[2][2]}
    whole |= {"Ixz": CAR.total.tensor[0][2]} | {f"cog.{a}": CAR.total.com[i] for i, a in enumerate("xyz")}
    seen = 0
    for line in LINES:
        effect, _, corner = line.key.rpartition(".")[0].partition(".")
        if line.table in (6, 7) and effect in of:
            assert getattr(CAR.axle(corner), of[effect]) == line.estimated
            seen += 1
        elif line.table == 5:
            assert line.scale * whole[line.key] == pytest.approx(line.estimated)
            seen += 1
    assert seen == 19


def test_it_stands_still_at_its_design_position_and_the_vehicle_file_says_where() -> None:
    motion = run(CAR, make_manoeuvre("straight", speed=0.0, duration=0.5), settle=0.5)
    assert np.max(np.abs(motion.travel[:, 0])) < 1e-5
    assert motion.force[-1, :, 2] == pytest.approx(CAR.static_loads, abs=0.5)
    moment = np.cross(CAR.wheel_centres, np.stack([np.zeros(4), np.zeros(4), CAR.static_loads], axis=1)).sum(0)
    weight = CAR.total.mass * CAR.gravity
    assert moment[:2] == pytest.approx(weight * np.array([CAR.total.com[1], -CAR.total.com[0]]))
    corners = Vehicle.parse(vehicle_text(CAR)).corners
    assert [corners[c].position for c in CORNERS] == [pytest.approx(p, abs=1.5e-6) for p in CAR.wheel_centres]
    assert len({c.height for c in corners.values()}) == 4


def test_friction_at_one_corner_acts_at_that_corner_alone() -> None:
    plain = find_car("peugeot-406")
    motion = drive("rough", "coulomb.rl=40,v0=0.005")
    felt = motion.wheel_centre_motion[1] - motion.gravity[:, None]
    axles = [plain.axle(c) for c in CORNERS]
    k, c, m = (np.array([getattr(a, n) for a in axles]) for n in ("stiffness", "damping", "unsprung_mass"))
    s = motion.travel
    left = motion.force[..., 2] - m * felt[..., 2] - k * s[:, 0] - c * s[:, 1] - plain.offsets
    law = 40 * np.tanh(s[:, 1, 2] / 0.005)
    assert left == pytest.approx(np.stack([0 * law, 0 * law, law, 0 * law], axis=1), abs=1e-8)
    with pytest.raises(UsageError, match=r"anti_roll_bar\.front"):
        Hidden("anti_roll_bar.fl", 1.0)


def test_corners_share_their_axle_s_geometry() -> None:
    with pytest.raises(UsageError, match="corner rr"):
        replace(CAR, corners={"rr": replace(CAR.rear, track=1.6)})


def test_a_rough_road_under_steering_moves_both_sides_alike_where_a_flat_one_cannot() -> None:
    flat, rough = drive("sinus"), drive("sinus", grade="B")
    heave = [np.std(m.travel[:, 1, 0] + m.travel[:, 1, 1]) / np.std(m.travel[:, 1, 0]) for m in (flat, rough)]
    assert heave[0] < 0.2
    assert heave[1] > 0.5
    start = make_manoeuvre("spiral", grade="A").road(find_car("peugeot-406"), 1, 2.0)
    assert start.start < -500.0 < 500.0 < start.start + 0.01 * len(start.left)


def test_a_tyre_of_its_own_has_no_lateral_force_at_its_neutral_slip_and_its_own_resistance() -> None:
    own = replace(CAR.tyre, neutral_slip=0.004, rolling_resistance=0.03)
    car = replace(CAR, tyres={"fl": own}, corners={})
    at = {}
    for c in CORNERS[:2]:
        tyre = WheelTyre(car.axle(c), car.tyre_at(c), 0.0, 0.0, 0.0, 0.0)
        at[c] = tyre.contact(
            (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), 0.30, (20.0, 0.0, 0.0), (0.0, 0.0, 0.0), 66.0, 0.0, 0.004, 0.001
        )
    load = at["fr"].force[2]
    assert at["fl"].force == pytest.approx((0.0, 0.0, load), abs=1e-9)
    assert at["fr"].force[1] > 0.8 * 0.004 * car.front.cornering * load
    assert [at[c].moment[1] for c in ("fl", "fr")] == pytest.approx([-0.03 * load * 0.30, -0.012 * load * 0.30])


def test_a_released_brake_of_one_corner_drags_there_alone_and_its_line_has_no_pressure() -> None:
    dragging = replace(CAR, corners={**CAR.corners, "fl": replace(CAR.axle("fl"), brake_drag=4.0)})
    motion = run(dragging, make_manoeuvre("straight", duration=0.5), settle=0.5)
    assert motion.brake == pytest.approx(np.array([4.0, 0.0, 0.0, 0.0]) * np.ones((len(motion.t), 1)), abs=1e-6)
    along = np.mean(motion.force[:, :2, 0], axis=0)
    assert along[0] - along[1] == pytest.approx(-4.0 / CAR.heights[0], abs=1.0)
    text = 'format = "lacet-rig 1"\nname = "b"\n[[sensor]]\nname = "line"\nchannels = ["brake.pressure"]\n'
    assert felt(motion, Rig.parse(text, "brakes"))["brake.pressure"] == pytest.approx(0.0, abs=1e-3)
