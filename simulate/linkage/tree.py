"""MuJoCo model of a linkage on its chassis: a tree of parts, with a site at every end of an element.

What would close a loop (rods, bushings, springs, dampers) is no part of the tree: `elements` gives the forces of these,
`loops` the equations that they are in the rigid variant.
"""

from __future__ import annotations

import numpy as np

from lacet.simulate.cars import Inertia
from lacet.simulate.linkage.parts import End, Joint, Linkage, Part
from lacet.simulate.mjcf import inertial, numbers


def ends(linkage: Linkage) -> list[tuple[str, End]]:
    """Sites by name, in order: both ends of rods, springs and dampers, then of bushings."""
    lines = (*linkage.rods, *linkage.springs, *linkage.dampers)
    out = [(f"{line.name}.{letter}", end) for line in lines for letter, end in (("a", line.a), ("b", line.b))]
    for bushing in linkage.bushings:
        out += [(f"{bushing.name}.a", End(bushing.a, bushing.at)), (f"{bushing.name}.b", End(bushing.b, bushing.at))]
    return out


def _joint(joint: Joint, origin: np.ndarray) -> str:
    axis = "" if joint.kind == "ball" else f' axis="{numbers(joint.axis)}"'
    armature = f' armature="{joint.armature!r}"' if joint.armature else ""
    place = numbers(np.asarray(joint.at) - origin)
    return f'<joint name="{joint.name}" type="{joint.kind}" pos="{place}"{axis}{armature}/>'


def tree_text(linkage: Linkage, chassis: Inertia, gravity: float) -> str:
    """The linkage as MJCF text; `chassis` : inertia of the sprung body without any of its parts, `gravity` [m/s²]."""
    sites = ends(linkage)

    def inside(name: str, origin: np.ndarray) -> str:
        own = "".join(
            f'<site name="{site}" pos="{numbers(np.asarray(end.at) - origin)}"/>'
            for site, end in sites
            if end.part == name
        )
        return own + "".join(body(part, origin) for part in linkage.parts if part.parent == name)

    def body(part: Part, parent: np.ndarray) -> str:
        origin = np.asarray(part.joints[-1].at)
        joints = "".join(_joint(joint, origin) for joint in part.joints)
        return (
            f'<body name="{part.name}" pos="{numbers(origin - parent)}">{inertial(part.inertia, origin)}{joints}'
            f"{inside(part.name, origin)}</body>"
        )

    return (
        '<mujoco model="second car"><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="{numbers([0.0, 0.0, -gravity])}">'
        '<flag contact="disable" constraint="disable" sensor="disable"/></option>'
        f'<worldbody><body name="chassis"><freejoint/>{inertial(chassis, np.zeros(3))}'
        f"{inside('chassis', np.zeros(3))}</body></worldbody></mujoco>"
    )
