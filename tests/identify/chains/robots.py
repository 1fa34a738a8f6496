"""A robot of three joints simulated by Pinocchio: known parameters, torques and noise, from the same URDF text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

RATE = 250.0
"""Samples a second [Hz]."""

URDF = """<robot name="three">
<link name="base"/>
<link name="a"><inertial><mass value="3"/><origin xyz="0.02 0.01 0.1"/>
 <inertia ixx="0.03" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial></link>
<link name="b"><inertial><mass value="2"/><origin xyz="0.2 0.02 0.01"/>
 <inertia ixx="0.01" ixy="0" ixz="0.002" iyy="0.04" iyz="0" izz="0.05"/></inertial></link>
<link name="c"><inertial><mass value="1"/><origin xyz="0.1 -0.03 0.02"/>
 <inertia ixx="0.004" ixy="0.001" ixz="0" iyy="0.02" iyz="0.001" izz="0.02"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
 <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.2" rpy="1.57079632679 0 0"/>
 <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="j3" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
 <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
</robot>"""

FRICTION = {"IA": (0.2, 0.15, 0.05), "FV": (3.0, 2.0, 1.0), "FS": (2.0, 1.5, 0.8), "OFF": (0.3, -0.2, 0.1)}
"""Rotor inertia, viscous and Coulomb friction and offset of each joint, beside the bodies."""


@dataclass(frozen=True)
class Record:
    """Positions (N, 3), torques (N, 3) and exact states of a simulated motion."""

    q: np.ndarray
    tau: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


def motion(seed: int, seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, rates and accelerations (N, 3): sums of sines up to 2 Hz, of random phases."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / RATE)[:, None]
    q, qd, qdd = (np.zeros((t.size, 3)) for _ in range(3))
    for f in (0.1, 0.23, 0.4, 0.7, 1.1, 1.6):
        w, phase = 2.0 * np.pi * f, rng.uniform(0, 2 * np.pi, 3)
        size = 0.35 / (0.4 + f)
        q += size * np.sin(w * t + phase)
        qd += size * w * np.cos(w * t + phase)
        qdd -= size * w**2 * np.sin(w * t + phase)
    return q, qd, qdd


def simulated(seed: int, noise: tuple[float, float] = (0.0, 0.0), seconds: float = 20.0) -> Record:
    """A record by Pinocchio's Newton–Euler with `FRICTION`; `noise` : σ of positions [rad] and torques [N·m]."""
    q, qd, qdd = motion(seed, seconds)
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    tau = np.array([pin.rnea(model, data, a, b, c) for a, b, c in zip(q, qd, qdd, strict=True)])
    ia, fv, fs, off = (np.array(FRICTION[name]) for name in ("IA", "FV", "FS", "OFF"))
    tau += ia * qdd + fv * qd + fs * np.sign(qd) + off
    rng = np.random.default_rng([seed, 1])
    return Record(q + noise[0] * rng.standard_normal(q.shape), tau + noise[1] * rng.standard_normal(q.shape), qd, qdd)
