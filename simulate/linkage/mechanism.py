"""A second car's mechanism in MuJoCo: its tree, elements and loops, in equilibrium at the design position.

The design position is that of the sizes, on rubber as well as rigid: springs are preloaded to carry the car on a flat
road, and on rubber every rod and bushing is preloaded by the force that the rigid joint in its place would carry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.simulate.engine import engine_library
from lacet.simulate.hidden import SuspensionLaw
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.elements import Elements
from lacet.simulate.linkage.loops import Loops
from lacet.simulate.linkage.state import Points, cross
from lacet.simulate.linkage.tree import tree_text

Array = NDArray[np.float64]


class Mechanism:
    """MuJoCo model and data of a second car, with its elements and loops.

    `laws` : hidden ones along springs and dampers, by their names; at the design position they have no force. The
    chassis has the first six velocities; `rack_dof`, `spin_dof` (4,) are others'; `wheels`, `carriers` (4,) bodies.
    """

    def __init__(self, car: SecondCar, laws: Mapping[str, Sequence[SuspensionLaw]] | None = None):
        lib = self.lib = engine_library()
        self.car = car
        linkage = car.linkage
        self.model = lib.MjModel.from_xml_string(tree_text(linkage, car.chassis, car.gravity))
        self.data = lib.MjData(self.model)
        self.data.qpos[2] = car.origin_height
        model = self.model

        def body(name: str) -> int:
            return int(lib.mj_name2id(model, lib.mjtObj.mjOBJ_BODY, name))

        def dof(name: str) -> int:
            return int(model.jnt_dofadr[lib.mj_name2id(model, lib.mjtObj.mjOBJ_JOINT, name)])

        carriers = dict(linkage.carriers)
        self.chassis_body = body("chassis")
        self.wheels = np.array([body(f"wheel_{c}") for c in CORNERS], dtype=np.int64)
        self.carriers = np.array([body(carriers[c]) for c in CORNERS], dtype=np.int64)
        self.shaft_body = body("engine") if any(part.name == "engine" for part in linkage.parts) else self.chassis_body
        self.rack_dof = dof("rack")
        self.rack_q = int(model.jnt_qposadr[lib.mj_name2id(model, lib.mjtObj.mjOBJ_JOINT, "rack")])
        self.spin_dof = [dof(f"spin_{c}") for c in CORNERS]
        self.spin_q = [
            int(model.jnt_qposadr[lib.mj_name2id(model, lib.mjtObj.mjOBJ_JOINT, f"spin_{c}")]) for c in CORNERS
        ]
        self.design = self.data.qpos.copy()
        self.design_attitudes = np.stack([car.design_attitude(c) for c in CORNERS])
        self.wheel_points = Points(model, self.data, self.wheels)
        self.carrier_points = Points(model, self.data, self.carriers)
        self.loops = Loops(lib, model, self.data, linkage, car.rigid)
        self.preload = self._preload()
        self.elements = Elements(lib, model, self.data, linkage, car.rigid, self.preload, laws)

    def _preload(self) -> dict[str, Array]:
        """Forces [N] of springs, rods and bushings in the design position, by name."""
        lib, model, linkage = self.lib, self.model, self.car.linkage
        self.refresh()
        bare = Elements(lib, model, self.data, linkage, False, {})
        springs = [s.name for s in linkage.springs]
        held = Loops(lib, model, self.data, linkage, True)
        columns = [*held.jacobian()]
        for name in springs:  # the generalised force of 1 N that pushes the ends of a spring apart
            unit = Elements(lib, model, self.data, linkage, True, {name: np.array(1.0)})
            columns.append(self._force(unit) - self._force(bare))
        demand = -(self._force(bare) + self.static_wheel_force())
        rows = [i for i in range(model.nv) if i != self.rack_dof and i not in self.spin_dof]
        matrix = np.array(columns).T[rows]
        scale = np.linalg.norm(matrix, axis=0)
        found = np.linalg.lstsq(matrix / scale, demand[rows], rcond=1e-11)[0] / scale
        out = {name: np.array(found[len(held.names) + i]) for i, name in enumerate(springs)}
        ties = {tie.name: tie for tie in linkage.ties}
        for name, force in zip(held.names, found, strict=False):
            if name in ties:
                for bushing in ties[name].bushings:
                    out.setdefault(bushing, np.zeros(3))[ties[name].component] = -force
            elif name.rpartition(".")[0]:
                bushing, _, letter = name.rpartition(".")
                out.setdefault(bushing, np.zeros(3))["xyz".index(letter)] = -force
            else:
                out[name] = np.array(force)
        return out

    def refresh(self) -> None:
        """Positions, mass matrix and velocities of the data's present state."""
        self.lib.mj_fwdPosition(self.model, self.data)
        self.lib.mj_fwdVelocity(self.model, self.data)

    def clear(self) -> None:
        """Remove all applied forces."""
        self.data.xfrc_applied[:] = 0.0
        self.data.qfrc_applied[:] = 0.0

    def on_part(self, body: int, force: Array, moment: Array, at: Array) -> None:
        """Add a force [N] at a point and a moment [N·m] on a part, ground axes."""
        self.data.xfrc_applied[body, :3] += force
        self.data.xfrc_applied[body, 3:] += moment + np.cross(at - self.data.xipos[body], force)

    def applied(self) -> Array:
        """(nv,) generalised force of everything applied, gravity and centrifugal forces, at the refreshed state."""
        self.lib.mj_fwdActuation(self.model, self.data)
        self.lib.mj_fwdAcceleration(self.model, self.data)
        return self.data.qfrc_smooth.copy()

    def _force(self, elements: Elements) -> Array:
        self.clear()
        elements.apply(np.zeros(elements.states))
        out = self.applied()
        self.clear()
        return out

    def force(self) -> Array:
        """(nv,) generalised force of elements and gravity at the data's present state, mounts at rest."""
        return self._force(self.elements)

    def static_wheel_force(self) -> Array:
        """(nv,) generalised force of a flat road on the tyres in the design position, standing."""
        self.clear()
        loads, up = self.car.static_loads, np.array([0.0, 0.0, 1.0])
        for i, corner in enumerate(CORNERS):
            n = self.design_attitudes[i][:, 1]
            q = float(np.sqrt(1.0 - n[2] ** 2))
            contact = -self.car.heights[i] / q**2 * (up - n[2] * n)
            centre = self.data.xpos[self.wheels[i]]
            assert self.car.axle(corner).radius > self.car.heights[i]
            self.on_part(int(self.wheels[i]), loads[i] * up, np.zeros(3), centre + contact)
        gravity = self._gravity()
        out = self.applied() - gravity
        self.clear()
        return out

    def _gravity(self) -> Array:
        keep = self.data.xfrc_applied.copy()
        self.clear()
        out = self.applied()
        self.data.xfrc_applied[:] = keep
        return out

    def body_axes(self) -> tuple[Array, Array]:
        """Body origin (3,) [m] and R_ground_body (3, 3) at the refreshed state."""
        at = self.chassis_body
        return self.data.xpos[at].copy(), self.data.xmat[at].reshape(3, 3).copy()

    def wheel_places(self) -> tuple[Array, Array]:
        """Wheel centres (4, 3) [m] and carriers' R_body_carrier (4, 3, 3) at the refreshed state."""
        origin, R = self.body_axes()
        centres = (self.data.xpos[self.wheels] - origin) @ R
        turned = np.einsum("ji,njk->nik", R, self.data.xmat[self.carriers].reshape(-1, 3, 3))
        return centres, turned @ self.design_attitudes

    def _centres_of_mass(self) -> tuple[Array, Array]:
        """Velocities of the parts' centres of mass (n, 3), and their angular momenta about them, ground axes."""
        data = self.data
        w = data.cvel[1:, :3]
        velocity = data.cvel[1:, 3:] + cross(w, data.xipos[1:] - data.subtree_com[self.chassis_body])
        R = data.ximat[1:].reshape(-1, 3, 3)
        return velocity, np.einsum("nij,nj,nkj,nk->ni", R, self.model.body_inertia[1:], R, w, optimize=True)

    def kinetic(self) -> float:
        """Kinetic energy of all parts [J] at the refreshed state; the rack's rotor inertia is not of the car."""
        velocity, spin = self._centres_of_mass()
        return float(
            0.5 * np.sum(self.model.body_mass[1:, None] * velocity**2) + 0.5 * np.sum(self.data.cvel[1:, :3] * spin)
        )

    def potential(self) -> float:
        """Potential energy of elements and weight [J], against the design position resp. the road."""
        weight = float(self.model.body_mass @ self.data.xipos[:, 2]) * self.car.gravity
        return self.elements.energy() + weight

    def momentum(self) -> tuple[Array, Array]:
        """Momentum [N·s] and angular momentum about the ground's origin [N·m·s], ground axes."""
        velocity, spin = self._centres_of_mass()
        own = self.model.body_mass[1:, None] * velocity
        return own.sum(axis=0), (cross(self.data.xipos[1:], own) + spin).sum(axis=0)
