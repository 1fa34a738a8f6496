"""Forces of a linkage's elements at a state of its MuJoCo model: springs, dampers, bushings and, on rubber, rods.

Rod or spring, L its length: pushes its ends apart with preload + k·(L0 - L) - c·dL/dt, L0 the design length.
Damper in series with its mount, x the mount's stretch (a state): tension c·(dL/dt - dx/dt) = k_m·x + c_m·dx/dt.
Bushing, d the displacement of b's point in a's axes: force on b = -(preload + k·d + c·dd/dt), direction by direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.simulate.hidden import SuspensionLaw
from lacet.simulate.linkage.parts import Damper, Linkage, Rod, Spring
from lacet.simulate.linkage.state import Points, cross

Array = NDArray[np.float64]


class Elements:
    """The elements of a linkage in a MuJoCo model.

    `rigid` : rods and held directions of bushings are the business of `loops`, mounts do not give; `preload` : by
    element name, the force in the design position [N], of bushings (3,) in the axes of their part a; `laws` : further
    forces along springs and dampers, by their names, of their compression from the design position and its rate.
    """

    def __init__(
        self, lib: Any, model: Any, data: Any, linkage: Linkage, rigid: bool, preload: Mapping[str, Array],
        laws: Mapping[str, Sequence[SuspensionLaw]] | None = None,
    ):  # fmt: skip
        self.model, self.data, self.rigid = model, data, rigid

        def site(name: str) -> int:
            return int(lib.mj_name2id(model, lib.mjtObj.mjOBJ_SITE, name))

        def joint(name: str) -> int:
            return int(lib.mj_name2id(model, lib.mjtObj.mjOBJ_JOINT, name))

        lines: list[Rod | Spring] = [*(() if rigid else linkage.rods), *linkage.springs]
        pushing: list[Rod | Spring | Damper] = [*lines, *linkage.dampers]
        self.names = [line.name for line in pushing]
        self.bushing_names = [b.name for b in linkage.bushings]
        self._count = len(lines)
        self._a = np.array([site(f"{line.name}.a") for line in pushing], dtype=np.int64)
        self._b = np.array([site(f"{line.name}.b") for line in pushing], dtype=np.int64)
        self._k = np.array([line.stiffness for line in lines])
        self._c = np.array([line.damping if isinstance(line, Rod) else 0.0 for line in lines])
        self._length = np.array([np.linalg.norm(np.subtract(line.b.at, line.a.at)) for line in lines])
        self._preload = np.array([float(preload.get(line.name, 0.0)) for line in lines])
        self._laws = [
            (self.names.index(line.name), float(np.linalg.norm(np.subtract(line.b.at, line.a.at))), law)
            for line in (*linkage.springs, *linkage.dampers)
            for law in (laws or {}).get(line.name, ())
        ]
        self._damping = np.array([damper.damping for damper in linkage.dampers])
        self._mount = np.array([damper.mount_stiffness for damper in linkage.dampers])
        self._mount_damping = np.array([damper.mount_damping for damper in linkage.dampers])
        self.states = 0 if rigid else len(linkage.dampers)
        """Number of states: the mounts' stretch [m]."""
        self._ba = np.array([site(f"{b.name}.a") for b in linkage.bushings], dtype=np.int64)
        self._bb = np.array([site(f"{b.name}.b") for b in linkage.bushings], dtype=np.int64)
        free = np.array([[not rigid or not held for held in b.held] for b in linkage.bushings], float).reshape(-1, 3)
        tied = {name: tie.component for tie in linkage.ties for name in tie.bushings}
        for row, bushing in enumerate(linkage.bushings):
            if rigid and bushing.name in tied:
                free[row, tied[bushing.name]] = 0.0
        self._bk = free * np.array([b.stiffness for b in linkage.bushings]).reshape(-1, 3)
        self._bc = free * np.array([b.damping for b in linkage.bushings]).reshape(-1, 3)
        zero = np.zeros(3)
        self._bp = free * np.array([preload.get(b.name, zero) for b in linkage.bushings]).reshape(-1, 3)
        self._torsions = [
            (
                int(model.jnt_dofadr[joint(t.first)]),
                -1 if t.second is None else int(model.jnt_dofadr[joint(t.second)]),
                t.stiffness,
                t.damping,
            )
            for t in linkage.torsions
        ]
        self._rubbers = [
            (int(model.jnt_qposadr[joint(r.joint)]), int(model.jnt_dofadr[joint(r.joint)]), r.stiffness, r.damping)
            for r in linkage.rubbers
        ]
        bodies = model.site_bodyid.astype(np.int64)
        self._bodies = np.concatenate([bodies[self._a], bodies[self._b], bodies[self._ba], bodies[self._bb]])
        self._line_points = Points(model, data, np.concatenate([bodies[self._a], bodies[self._b]]))
        self._bushing_points = Points(model, data, np.concatenate([bodies[self._ba], bodies[self._bb]]))
        self._onto = np.zeros((model.nbody, len(self._bodies)))
        self._onto[self._bodies, np.arange(len(self._bodies))] = 1.0

    def lengths(self) -> tuple[Array, Array, Array]:
        """Length [m], unit vector from a to b, and rate of the length [m/s] of springs (after the rods) and dampers."""
        p = self.data.site_xpos
        a, b = p[self._a], p[self._b]
        d = b - a
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        u = d / length[:, None]
        v = self._line_points.velocity(np.concatenate([a, b]))
        n = len(a)
        return length, u, np.einsum("ij,ij->i", u, v[n:] - v[:n])

    def displacements(self) -> tuple[Array, Array, Array, Array]:
        """Of bushings: axes R of part a (n, 3, 3), displacement and rate (n, 3) in them, points b (n, 3)."""
        p = self.data.site_xpos
        a, b = p[self._ba], p[self._bb]
        R = self.data.xmat[self.model.site_bodyid[self._ba]].reshape(-1, 3, 3)
        v = self._bushing_points.velocity(np.concatenate([b, b]))
        n = len(a)
        return R, np.einsum("nij,ni->nj", R, b - a), np.einsum("nij,ni->nj", R, v[n:] - v[:n]), b

    def apply(self, states: Array) -> Array:
        """Add all forces to the model's applied ones, and return the rates of the mounts' stretch."""
        data = self.data
        length, u, rate = self.lengths()
        n, m = len(length), self._count
        push = np.empty(n)
        push[:m] = self._preload + self._k * (self._length - length[:m]) - self._c * rate[:m]
        if self.rigid:
            rates = np.zeros(0)
            push[m:] = -self._damping * rate[m:]
        else:
            rates = (self._damping * rate[m:] - self._mount * states) / (self._damping + self._mount_damping)
            push[m:] = -self._damping * (rate[m:] - rates)
        for at, design, law in self._laws:
            push[at] += law(design - float(length[at]), -float(rate[at]))
        on_b = push[:, None] * u
        points = data.site_xpos
        R, d, dd, at = self.displacements()
        rubber = -np.einsum("nij,nj->ni", R, self._bp + self._bk * d + self._bc * dd)
        force = np.concatenate([-on_b, on_b, -rubber, rubber])
        where = np.concatenate([points[self._a], points[self._b], at, at])
        moment = cross(where - data.xipos[self._bodies], force)
        data.xfrc_applied[:, :3] += self._onto @ force
        data.xfrc_applied[:, 3:] += self._onto @ moment
        for first, second, k, c in self._torsions:
            angle, speed = data.qpos[self._q(first)], data.qvel[first]
            if second >= 0:
                angle, speed = angle - data.qpos[self._q(second)], speed - data.qvel[second]
            torque = -k * angle - c * speed
            data.qfrc_applied[first] += torque
            if second >= 0:
                data.qfrc_applied[second] -= torque
        for q, dof, k, c in self._rubbers:
            data.qfrc_applied[dof : dof + 3] -= k * rotation_vector(data.qpos[q : q + 4]) + c * data.qvel[dof : dof + 3]
        return rates

    def _q(self, dof: int) -> int:
        return int(self.model.jnt_qposadr[self.model.dof_jntid[dof]])

    def pushes(self) -> dict[str, float]:
        """Force [N] with which each spring, and on rubber each rod, pushes its ends apart, without damping."""
        length = self.lengths()[0][: self._count]
        push = self._preload + self._k * (self._length - length)
        return dict(zip(self.names[: self._count], push.tolist(), strict=True))

    def energy(self) -> float:
        """Potential energy [J] of all elements against the design position (mounts at rest)."""
        stretch = self.lengths()[0][: self._count] - self._length
        d = self.displacements()[1]
        out = float(np.sum(0.5 * self._k * stretch**2 - self._preload * stretch))
        out += float(np.sum(0.5 * self._bk * d**2 + self._bp * d))
        for first, second, k, _ in self._torsions:
            angle = self.data.qpos[self._q(first)] - (self.data.qpos[self._q(second)] if second >= 0 else 0.0)
            out += 0.5 * k * float(angle) ** 2
        for q, _, k, _ in self._rubbers:
            out += 0.5 * k * float(np.sum(rotation_vector(self.data.qpos[q : q + 4]) ** 2))
        return out


def rotation_vector(quaternion: Array) -> Array:
    """(3,) rotation vector [rad] of a unit quaternion, scalar first."""
    part = quaternion[1:]
    size = float(np.sqrt(part @ part))
    if size < 1e-12:
        return 2.0 * part * np.sign(quaternion[0])
    angle = 2.0 * np.arctan2(size, abs(float(quaternion[0])))
    return part * (angle / size * np.sign(quaternion[0]))
