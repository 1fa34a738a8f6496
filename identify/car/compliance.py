"""Compliance along a motion: what the measured wheel loads change of the joints of a wheel, by its bench's slopes.

Points and attitudes of the wheel move; their velocities and accelerations by it are left out, as at 6 Hz they are some
newtons of the unsprung mass. The slopes by the travel stay those of the bench without a load: in equilibrium the rubber
does no work on a small further motion, so that they hold up to half the change of the compliance by the travel times
the load squared. The travel is the wheel centre's height, which the hub laser measures whatever the rubber gives.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.compliance import Compliance
from lacet.daq.vehicle import Corner
from lacet.identify.car.car_tree import carrier_axes
from lacet.identify.car.road import Road, RoadPlane
from lacet.identify.car.rows import PRESSURE, RELEASED
from lacet.identify.car.table_errors import compliance_factor, slope_errors
from lacet.identify.car.wheel_joints import WheelJoints, wheel_joints
from lacet.identify.car.wheel_load import load_in_body
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording

WheelLoads = Mapping[str, Array]
"""Loads on a wheel by name (`daq.compliance.LOADS`), (N,) each."""
APPLIED = 50.0
"""Moment of the road about the axis of a wheel without drive above which the brakes count as applied [N·m].

Released, its inertia alone needs a moment: at one wheel less than 35 N·m in 99.9 % of the samples where carriers that
pitch 2 rad/m with travel cross a road of class B at one and a half times its height. With two thirds of the braking in
front, 50 N·m at each rear wheel brake a car of 1,500 kg by 0.7 m/s²."""


def joints_under_load(
    recording: Recording, road: Road, plane: RoadPlane, moved: Collection[str]
) -> dict[str, WheelJoints]:
    """Joints of the `moved` corners by their tables, under the wheel loads where a bench has their compliance."""
    vehicle, signals, n = recording.vehicle, road.signals, road.n

    def of(c: str, given: Array | None = None) -> WheelJoints:
        corner = vehicle.corners[c]
        other = road.travel(other_corner(c)) if corner.follows_other else None
        steer = signals.scalar(f"camera.{c}.steer", n)
        return wheel_joints(corner, road.travel(c), other, steer, given, slope_errors(corner, signals))

    gives = {c: k.compliance for c, corner in vehicle.corners.items() if (k := corner.joints) and k.compliance}
    loaded = [c for c in CORNERS if c in moved or (other_corner(c) in moved and other_corner(c) in gives)]
    unloaded = {c: of(c) for c in loaded}
    loads: dict[str, WheelLoads] = {}
    braked = brakes_act(recording) if gives else np.zeros(n, bool)
    for c in loaded if gives else ():
        steer, camber = (signals.scalar(f"camera.{c}.{angle}", n)[0] for angle in ("steer", "camber"))
        axes = carrier_axes(steer, camber, unloaded[c].pitch[0] + unloaded[c].kingpin[0])
        force, moment = (
            load_in_body(signals.value, f"wheel.{c}.{what}", axes, recording, plane.normal)
            for what in ("force", "moment")
        )
        loads[c] = loads_on(vehicle.corners[c], signals.value, force, moment, axes[:, 1], braked)

    def by_loads(corner: Corner) -> Array:
        return compliance_factor(corner, signals) * change_by_loads(corner, gives[corner.name], loads)

    return {c: of(c, by_loads(vehicle.corners[c])) if c in gives else unloaded[c] for c in CORNERS if c in moved}


def brakes_act(recording: Recording) -> NDArray[np.bool_]:
    """(N,) whether the driver brakes: as the brake line's pressure says, or the wheels without drive.

    Never in a run that declares the brakes off. A wheel without drive turns freely but for its brake, and the road's
    moment about its axis is then that of its brake; the driven wheels are taken to be braked at the same times. Without
    the moment of any such wheel the brakes count as released.
    """
    values, vehicle = recording.completed.value, recording.vehicle
    if PRESSURE in values:
        return values[PRESSURE][0] > RELEASED
    free = [c for c, corner in vehicle.corners.items() if not corner.driven and corner.brakes != "inboard"]
    moments = [values[name][1] for c in free if (name := f"wheel.{c}.moment") in values]
    if recording.brakes == "off" or not moments:
        return np.zeros(recording.t.size, bool)
    return np.mean(moments, axis=0) > APPLIED


def loads_on(
    corner: Corner, values: Mapping[str, Array], force: Array, moment: Array, spin_axis: Array,
    braked: NDArray[np.bool_],
) -> WheelLoads:  # fmt: skip
    """Loads on a wheel in the terms of the bench, from its measured load in body axes (3, N), about the wheel centre.

    What the carrier has of a longitudinal force's moment is the torque of an outboard brake: measured, or, while the
    driver brakes (`brakes_act`), the moment about the wheel's axis.
    """
    torque = np.zeros(force.shape[1])
    if corner.brakes != "inboard":
        channel = f"brake.{corner.name}.torque"
        torque = values[channel][0] if channel in values else np.sum(moment * spin_axis, axis=0) * braked
    held = -torque / corner.height
    return {
        "longitudinal": held,
        "traction": force[0] - held,
        "lateral": corner.side * force[1],
        "aligning": -corner.side * moment[2],
    }


def change_by_loads(corner: Corner, compliance: Compliance, loads: Mapping[str, WheelLoads]) -> Array:
    """(5, N) changes of a corner's joints, in the signs of its tables, under the `loads` by corner."""
    own, other = (_known(compliance, loads[c]) for c in (corner.name, other_corner(corner.name)))
    return compliance.change(own, other)


def _known(compliance: Compliance, loads: WheelLoads) -> WheelLoads:
    """The loads with all of the longitudinal force as that which a bench put on, where it did not put on both."""
    known = [name for name in ("longitudinal", "traction") if name in compliance.own]
    if len(known) != 1:
        return loads
    return {**loads, known[0]: loads["longitudinal"] + loads["traction"]}
