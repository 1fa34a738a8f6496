"""Units and quantities of ROS messages: a type fixes them for its fields, after REP 103 (SI, radians), for all logs."""

from __future__ import annotations

from typing import NamedTuple


class FieldMeaning(NamedTuple):
    """What a message type says of a field: units that it can have, the first as a rule, and words for its quantity."""

    units: tuple[str, ...]
    quantity: str = ""


_M, _PLAIN = FieldMeaning(("m",)), FieldMeaning(("-",))
FIELDS: dict[str, dict[str, FieldMeaning]] = {
    "geometry_msgs/Twist": {
        "linear": FieldMeaning(("m/s",), "velocity"), "angular": FieldMeaning(("rad/s",), "rate"),
    },
    "geometry_msgs/Accel": {"linear": FieldMeaning(("m/s²",), "acc"), "angular": FieldMeaning(("rad/s²",))},
    "geometry_msgs/Wrench": {"force": FieldMeaning(("N",), "force"), "torque": FieldMeaning(("N·m",), "moment")},
    "geometry_msgs/Pose": {"position": _M, "orientation": _PLAIN},
    "geometry_msgs/Transform": {"translation": _M, "rotation": _PLAIN},
    "sensor_msgs/Imu": {
        "linear_acceleration": FieldMeaning(("m/s²",), "acc"), "angular_velocity": FieldMeaning(("rad/s",), "rate"),
        "orientation": FieldMeaning(("-",), "quaternion"),
    },
    "sensor_msgs/JointState": {  # of a joint that turns, or slides
        "position": FieldMeaning(("rad", "m"), "angle"), "velocity": FieldMeaning(("rad/s", "m/s"), "velocity"),
        "effort": FieldMeaning(("N·m", "N"), "moment"),
    },
    "sensor_msgs/NavSatFix": {
        "latitude": FieldMeaning(("deg",), "gnss latitude"), "longitude": FieldMeaning(("deg",), "gnss longitude"),
        "altitude": FieldMeaning(("m",), "gnss altitude"),
    },
    "sensor_msgs/Range": {
        "range": _M, "min_range": _M, "max_range": _M, "field_of_view": FieldMeaning(("rad",)),
    },
    "sensor_msgs/FluidPressure": {"fluid_pressure": FieldMeaning(("Pa",), "pressure")},
    "ackermann_msgs/AckermannDrive": {
        "steering_angle": FieldMeaning(("rad",)), "speed": FieldMeaning(("m/s",)),
        "acceleration": FieldMeaning(("m/s²",)),
    },
}  # fmt: skip
"""Message type → field → what it is; also where the message is part of another. Source: the types' definitions."""


def fields_of(message: object) -> dict[str, FieldMeaning]:
    """What the type of a decoded message says of its fields; nothing where the type is none of the known."""
    return FIELDS.get(str(getattr(message, "_type", "")).replace("/msg/", "/"), {})
