"""A wheel carrier that pitches otherwise than bench tables say: its loads and its wheel's inertia in the rows."""

from __future__ import annotations

from lacet.daq.channels import other_corner
from lacet.identify.car.motion import Course, Motion
from lacet.identify.multibody.vectors import Array, cross, dot, turned


def pitched_loads(motion: Motion, corner: str, angle: Array) -> dict[str, Array]:
    """Columns of a carrier pitched by `angle` (N,) [rad] about its wheel's axis, nose down: row → (1, N).

    A load that is measured in the carrier's axes turns with them, F by angle n × F and M by angle n × M, in all rows it
    is in. Nothing where it is measured in other axes.
    """
    if corner not in motion.pitching:
        return {}
    wheel, other = motion.corners[corner], other_corner(corner)
    force, moment = (angle * cross(wheel.spin_axis, load) for load in (wheel.force, wheel.moment))
    whole = moment + cross(wheel.centre, force)
    out = {f"chassis.f{axis}": -force[k][None] for k, axis in enumerate("xyz")}
    out |= {f"chassis.m{axis}": -whole[k][None] for k, axis in enumerate("xyz")}
    out[f"tyre.{corner}"] = -dot(force, wheel.normal)[None]
    out[f"suspension.{corner}"] = -(dot(force, wheel.dp_ds) + dot(moment, wheel.wheel_dphi_ds))[None]
    if wheel.other_dp_ds is not None and wheel.other_wheel_dphi_ds is not None:
        work = dot(force, wheel.other_dp_ds) + dot(moment, wheel.other_wheel_dphi_ds)
        out[f"suspension.{other}"] = -work[None]
    return out


def spun_wheel(motion: Motion, corner: str, angle: Course) -> dict[str, Array]:
    """Columns of the inertia 1 kg·m² of a wheel that turns by `angle` [rad] more than its speed says: row → (1, N).

    The speed is measured against the carrier; of one that pitches by the angle, the wheel turns in space by as much
    more. Its momentum about its axis n is then larger by dangle/dt n, which turns with the carrier.
    """
    wheel, other = motion.corners[corner], other_corner(corner)
    _, rate, accel = angle
    change = accel * wheel.spin_axis + rate * cross(turned(wheel.axes, wheel.axle.omega), wheel.spin_axis)
    out = {f"chassis.m{axis}": change[k][None] for k, axis in enumerate("xyz")}
    out[f"spin.{corner}"] = dot(change, wheel.spin_axis)[None]
    out[f"suspension.{corner}"] = dot(change, wheel.wheel_dphi_ds)[None]
    if wheel.other_wheel_dphi_ds is not None:
        out[f"suspension.{other}"] = dot(change, wheel.other_wheel_dphi_ds)[None]
    return out
