"""Rigid-body engine of the simulated car: a MuJoCo model of a car's parameters, and the forces of one step.

Tree: chassis (free) → carrier (slide along body z, front: then a hinge about the kingpin axis) → wheel (hinge about the
carrier's y). Wheel centres lie on the kingpin axes and on the spin axes. MuJoCo only computes accelerations from
forces; springs, dampers, tyres, drive, brakes, air and the integrator are this package's.

Steering is a prescribed motion: the steering hinge has a large armature (a rotor inertia between chassis and carrier,
internal to the car, without momentum of its own), so that the tyre changes the angle by a few µrad at most.
"""

from __future__ import annotations

import importlib
import logging
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.parts import from_part
from lacet.simulate.air import Air
from lacet.simulate.attached import attached_bodies
from lacet.simulate.cars import Car
from lacet.simulate.hidden import Hidden, one_of, suspension_law, total_at, total_of
from lacet.simulate.memory import MemoryLaw, OwnLaw, memory_law
from lacet.simulate.mjcf import STEER_ARMATURE, build_mjcf, slide_directions, wheel_turns
from lacet.simulate.road import SPACING, Road
from lacet.simulate.turning import Corner, coupling, turned, twisted
from lacet.simulate.tyre import WheelTyre

STEER_FREQUENCY = 60.0  # rad/s: natural frequency of the steering's response to the demand, critically damped


def engine_library() -> Any:
    """The MuJoCo module. Raises MissingPart when it is not installed."""
    with from_part("sim"):
        lib = importlib.import_module("mujoco")
    # By default MuJoCo writes a file MUJOCO_LOG.TXT in the working folder; failed runs are reported by name instead.
    lib.set_mju_user_warning(logging.getLogger(__name__).debug)
    return lib


class Instant:
    """Forces and states of one instant in body axes, written by `Engine.load` and recorded by the run."""

    def __init__(self) -> None:
        self.force = [(0.0, 0.0, 0.0)] * 4
        self.moment = [(0.0, 0.0, 0.0)] * 4
        self.suspension = [0.0] * 4
        self.deflection = [0.0] * 4
        self.distance = [0.3] * 4
        self.normal = (0.0, 0.0, 1.0)
        self.spin_axis = [(0.0, 1.0, 0.0)] * 4
        self.air_force = (0.0, 0.0, 0.0)
        self.air_moment = (0.0, 0.0, 0.0)
        self.slip_rates = [0.0] * 8
        """Rates of κ of the four wheels, of α of the four, then of the states of hidden effects."""
        self.outside = np.zeros(6)
        """Road load on further bodies: force (ground axes) [N], moment about the body origin (body axes) [N·m]."""


class Engine:
    """MuJoCo engine of a car on a road: `load` sets generalised forces of the present state, `accelerate` solves."""

    def __init__(self, car: Car, road: Road, hidden: Sequence[Hidden], own: Sequence[OwnLaw] = ()):
        lib = self.lib = engine_library()
        self.car, self.road, self.hidden = car, road, hidden
        self.slides, self.turns = slide_directions(car, hidden), wheel_turns(car, hidden)
        one_of(hidden, "chassis_torsion")
        self.attached = attached_bodies(car, road, hidden)
        text, self.twist = build_mjcf(car, self.slides, hidden, self.attached)
        self.model = lib.MjModel.from_xml_string(text)
        self.data = lib.MjData(self.model)
        self._nv: int = self.model.nv
        self.data.qpos[2] = car.origin_height

        def address(name: str) -> int:
            index = lib.mj_name2id(self.model, lib.mjtObj.mjOBJ_JOINT, name)
            return -1 if index < 0 else int(self.model.jnt_dofadr[index])

        self.slide_dof = [address(f"slide_{c}") for c in CORNERS]
        self.turn_dof = [address(f"turn_{c}") for c in CORNERS]
        self.steer_dof = [address(f"steer_{c}") for c in CORNERS]
        self.spin_dof = [address(f"spin_{c}") for c in CORNERS]
        self.spin_q = [dof + 1 for dof in self.spin_dof]
        self.torsion_dof = address("torsion")
        self.attached_dof = [[address(joint) for joint in part.joints] for part in self.attached]
        # |u| > 1 when a hidden effect tilts the slide: MuJoCo's coordinate is the path length, travel s is along body z
        self.stretch = np.linalg.norm(self.slides, axis=1).tolist()
        self._u = [tuple(row) for row in self.slides.tolist()]
        centres = car.wheel_centres
        self._centres = [tuple(row) for row in centres.tolist()]
        plane = np.linalg.pinv(np.column_stack([centres[:, 0], centres[:, 1], np.ones(4)]))
        self._slope_x, self._slope_y = plane[0].tolist(), plane[1].tolist()
        self._axes = []
        for corner in CORNERS:
            n, k = car.design_attitude(corner)[:, 1], car.kingpin(corner)
            fixed = k * (k @ n)
            self._axes.append((fixed.tolist(), (n - fixed).tolist(), np.cross(k, n).tolist(), k.tolist()))
        self._turn = [tuple(row) for row in self.turns.tolist()]
        self._moving = self.twist is not None or bool(np.any(self.turns))
        self._corners = [Corner(*row) for row in zip(self._centres, self._u, self._axes, self._turn, strict=True)]
        self._ratios = (np.linalg.norm(self.turns, axis=1) / self.stretch).tolist()
        self._coupling = (
            coupling(self.model.nv, self.slide_dof, self.turn_dof, self._ratios) if np.any(self.turns) else None
        )
        self._tyres = [
            WheelTyre(
                car.axle(c),
                car.tyre_at(c),
                *(
                    total_at(hidden, name, c)
                    for name in ("tyre_progression", "tyre_damping", "rolling_resistance", "camber_thrust")
                ),
            )
            for c in CORNERS
        ]
        self._springs = [
            (car.axle(c).stiffness, car.axle(c).damping, offset)
            for c, offset in zip(CORNERS, car.offsets.tolist(), strict=True)
        ]
        self._laws = [[f for h in hidden if h.at(c) and (f := suspension_law(h)) is not None] for c in CORNERS]
        self._steer_give = [total_at(hidden, "steer_compliance", c) for c in CORNERS]
        self._memory: list[list[tuple[int, MemoryLaw]]] = [[] for _ in CORNERS]
        states = 8
        for i, corner in enumerate(CORNERS):
            for effect in hidden:
                if effect.at(corner) and (remembered := memory_law(effect)) is not None:
                    self._memory[i].append((states, remembered))
                    states += 1
        self._own: list[list[tuple[int, OwnLaw]]] = [[] for _ in CORNERS]
        for i, corner in enumerate(CORNERS):
            for law in own:
                if law.at(corner):
                    self._own[i].append((states, law))
                    states += 1
        self._attached_states = []
        for part in self.attached:
            self._attached_states.append(slice(states, states + part.states))
            states += part.states
        self.states = states
        """Number of states besides MuJoCo's: 8 slips, then those of hidden effects."""
        self._bars = [total_at(hidden, "anti_roll_bar", c) for c in CORNERS]
        self._interconnection = total_of(hidden, "interconnection")
        self._air = Air(hidden, car.wheelbase, car.origin_height)
        self._tracks = (road.left.tolist(), road.right.tolist())
        self.now = Instant()
        self.now.slip_rates = [0.0] * states

    @property
    def driven(self) -> list[int]:
        """Indices of the driven corners."""
        return [i for i, c in enumerate(CORNERS) if self.car.axle(c).driven]

    def load(
        self,
        q: list[float],
        v: list[float],
        slips: list[float],
        steer: float,
        shaft: Sequence[float],
        brake: Sequence[float],
        step: float,
    ) -> Instant:
        """The forces at state (q, v), written into the engine's generalised forces.

        `q`, `v` : MuJoCo's coordinates and velocities; `slips` : κ of the four wheels, then α, then the states of
        hidden effects; `steer` : demanded kingpin angle [rad]; `shaft`, `brake` : (4,) torques on the wheels [N·m];
        `step` : integration step [s].
        """
        now, out = self.now, [0.0] * self._nv
        w, x, y, z = q[3:7]
        r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
        vx, vy, vz = v[0], v[1], v[2]
        bx, by, bz = r00 * vx + r10 * vy + r20 * vz, r01 * vx + r11 * vy + r21 * vz, r02 * vx + r12 * vy + r22 * vz
        p, qq, r, v_forward, v_left = v[3], v[4], v[5], bx, by
        if self._moving:
            self._move(q)
        slide_dofs, turn_dofs, steer_dofs, spin_dofs = self.slide_dof, self.turn_dof, self.steer_dof, self.spin_dof
        stretches, slides, memory, bars, laws = self.stretch, self._u, self._memory, self._bars, self._laws
        flat, distances = self.road.flat, now.distance
        travel, rate, centre = [0.0] * 4, [0.0] * 4, [(0.0, 0.0, 0.0)] * 4
        slope_x = slope_y = 0.0
        for i in range(4):
            dof, stretch = slide_dofs[i], stretches[i]
            s = q[dof + 1] / stretch
            travel[i], rate[i] = s, v[dof] / stretch
            (cx, cy, cz), (ux, uy, uz) = self._centres[i], slides[i]
            rx, ry, rz = centre[i] = (cx + ux * s, cy + uy * s, cz + uz * s)
            world_z = q[2] + r20 * rx + r21 * ry + r22 * rz
            if flat:
                d = world_z / r22
            else:
                d, world_x = distances[i], q[0] + r00 * rx + r01 * ry + r02 * rz
                for _ in range(2):
                    d = (world_z - self._height(world_x - d * r02, i)) / r22
            distances[i] = d
            slope_x += self._slope_x[i] * (rz - d)
            slope_y += self._slope_y[i] * (rz - d)
        size = math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        e = now.normal = (-slope_x / size, -slope_y / size, 1.0 / size)
        fx = fy = fz = mx = my = mz = front_fy = front_mx = 0.0
        roll, torsion = p, self.torsion_dof
        for i in range(4):
            if i == 2 and torsion >= 0:  # the rear part rotates about x at the hinge's height, relative to the body
                assert self.twist is not None
                front_fy, front_mx = fy, mx
                roll, by = p + v[torsion], by + v[torsion] * self.twist.z
            rx, ry, rz = centre[i]
            ux, uy, uz = slides[i]
            s, sd = travel[i], rate[i]
            fixed, cosine, sine, k = self._axes[i]
            dof, tx, ty, tz = steer_dofs[i], roll, qq, r
            turn_dof = turn_dofs[i]
            if turn_dof >= 0:
                ox, oy, oz = self._turn[i]
                tx, ty, tz = tx + ox * sd, ty + oy * sd, tz + oz * sd
            if dof >= 0:
                angle, turn = q[dof + 1], v[dof]
                demand = steer if i < 2 else 0.0
                if self._steer_give[i]:
                    fx_, fy_, fz_ = now.force[i]  # of the step before: the steering's own lag is far longer
                    nx_, ny_, nz_ = now.spin_axis[i]
                    demand += self._steer_give[i] * (fx_ * nx_ + fy_ * ny_ + fz_ * nz_)
                c, sn = math.cos(angle), math.sin(angle)
                n = (
                    fixed[0] + c * cosine[0] + sn * sine[0],
                    fixed[1] + c * cosine[1] + sn * sine[1],
                    fixed[2] + c * cosine[2] + sn * sine[2],
                )
                tx, ty, tz = tx + turn * k[0], ty + turn * k[1], tz + turn * k[2]
                out[dof] = STEER_ARMATURE * STEER_FREQUENCY * (STEER_FREQUENCY * (demand - angle) - 2.0 * turn)
            else:
                n = (fixed[0] + cosine[0], fixed[1] + cosine[1], fixed[2] + cosine[2])
            speed = (
                bx + qq * rz - r * ry + ux * sd,
                by + r * rx - roll * rz + uy * sd,
                bz + roll * ry - qq * rx + uz * sd,
            )
            spin_dof = spin_dofs[i]
            got = self._tyres[i].contact(
                n, e, distances[i] * e[2], speed, (tx, ty, tz), v[spin_dof], slips[i], slips[i + 4], step
            )
            now.force[i], now.moment[i], now.deflection[i] = got.force, got.moment, got.deflection
            now.slip_rates[i], now.slip_rates[i + 4] = got.kappa_rate, got.alpha_rate
            gx, gy, gz = got.force
            hx, hy, hz = got.moment
            stiffness, damping, offset = self._springs[i]
            load = stiffness * s + damping * sd + offset
            for law in laws[i]:
                load += law(s, sd)
            if bars[i]:
                load += bars[i] * (s - travel[i ^ 1])
            if self._interconnection:
                load += self._interconnection * (s - travel[(i + 2) % 4])
            for at, law in memory[i]:
                extra, now.slip_rates[at] = law(s, sd, slips[at])
                load += extra
            for at, own in self._own[i]:
                extra, now.slip_rates[at] = own.law(s, sd, travel[i ^ 1], rate[i ^ 1], slips[at])
                load += extra
            now.suspension[i] = load
            out[slide_dofs[i]] = (gx * ux + gy * uy + gz * uz - load) / stretches[i]
            out[spin_dof] = hx * n[0] + hy * n[1] + hz * n[2] + shaft[i] - brake[i] * math.tanh(v[spin_dof])
            if turn_dof >= 0:
                t, length = shaft[i], self._ratios[i] * stretches[i]
                ox, oy, oz = self._turn[i]
                out[turn_dof] = ((hx + t * n[0]) * ox + (hy + t * n[1]) * oy + (hz + t * n[2]) * oz) / length
            if dof >= 0:
                if self._steer_give[i]:
                    now.spin_axis[i] = n
                # the half-shaft drives the wheel and reacts on the chassis: its moment acts on the steering only
                t = shaft[i]
                out[dof] += (hx + t * n[0]) * k[0] + (hy + t * n[1]) * k[1] + (hz + t * n[2]) * k[2]
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            mx, my, mz = mx + hx + ry * gz - rz * gy, my + hy + rz * gx - rx * gz, mz + hz + rx * gy - ry * gx
        if torsion >= 0:
            assert self.twist is not None
            hinge = mx - front_mx + self.twist.z * (fy - front_fy)
            out[torsion] = hinge + self.twist.torque(q[torsion + 1], v[torsion])
        if self._air.acts:
            now.air_force, now.air_moment = (ax, ay, az), (_, am, an) = self._air.load(v_forward, v_left)
            fx, fy, fz, my, mz = fx + ax, fy + ay, fz + az, my + am, mz + an
        out[0], out[1], out[2] = (
            r00 * fx + r01 * fy + r02 * fz,
            r10 * fx + r11 * fy + r12 * fz,
            r20 * fx + r21 * fy + r22 * fz,
        )
        out[3], out[4], out[5] = mx, my, mz
        self.data.qfrc_applied[:] = out
        for part, dofs, at in zip(self.attached, self.attached_dof, self._attached_states, strict=True):
            load, now.slip_rates[at] = part.load(self, dofs, slips[at])
            self.data.qfrc_applied[:] += load
        return now

    def accelerate(self) -> NDArray[np.float64]:
        """Accelerations of the present state under the loads set (a view into the engine's memory)."""
        self.lib.mj_forward(self.model, self.data)
        if self._coupling is not None:
            # carriers that rotate with travel, G·v = 0: a = a0 - M⁻¹·Gᵀ·λ with G·a = 0
            G = self._coupling
            back = np.empty_like(G)
            self.lib.mj_solveM(self.model, self.data, back, G)
            free = self.data.qacc
            self.data.qacc[:] = free - back.T @ np.linalg.solve(G @ back.T, G @ free)
        return self.data.qacc

    def close(self, state: NDArray[np.float64]) -> None:
        """Nothing: this car's tree has no loop to close."""

    def _move(self, q: list[float]) -> None:
        """Positions and axes of the wheels, where hidden effects move them."""
        for i, corner in enumerate(self._corners):
            if self.turn_dof[i] >= 0:
                corner = turned(corner, q[self.slide_dof[i] + 1] / self.stretch[i])
            if i >= 2 and self.twist is not None:
                corner = twisted(corner, q[self.torsion_dof + 1], self.twist.z)
            self._centres[i], self._u[i], self._axes[i], self._turn[i] = corner

    def _height(self, x: float, corner: int) -> float:
        z = self._tracks[corner % 2]
        at = (x - self.road.start) / SPACING
        i = math.floor(at)
        if i < 0 or i + 1 >= len(z):
            return 0.0
        return z[i] + (at - i) * (z[i + 1] - z[i])
