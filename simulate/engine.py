"""The rigid-body engine behind the simulated car: a MuJoCo model built from a car's numbers, and one step's forces.

Tree: chassis (free) → carrier (slide along body z, front: then a hinge about the kingpin axis) → wheel (hinge about the
carrier's y). Wheel centres lie on the kingpin axes and on the spin axes. MuJoCo only turns forces into accelerations;
springs, dampers, tyres, drive, brakes and air are ours, and so is the integrator.

Steering is a prescribed motion: the steering hinge has a large armature (a rotor inertia between chassis and carrier,
internal to the car, without momentum of its own), so that the tyre moves the angle by no more than a few µrad.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.channels import CORNERS
from daq.errors import UsageError
from simulate.cars import Car, Inertia
from simulate.hidden import Hidden, suspension_law, total_at
from simulate.road import SPACING, Road
from simulate.tyre import WheelTyre

STEER_ARMATURE = 1e4  # kg·m²
STEER_FREQUENCY = 60.0  # rad/s: how fast the steering follows the demand, critically damped


def engine_library() -> Any:
    """The MuJoCo module. Raises UsageError with the remedy when it is not installed."""
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise UsageError("the simulated car needs MuJoCo: install it with  pip install 'lacet[sim]'") from None


def _numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _inertial(body: Inertia, origin: NDArray[np.float64]) -> str:
    t = np.asarray(body.tensor)
    full = (t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
    return (
        f'<inertial pos="{_numbers(np.asarray(body.com) - origin)}" mass="{body.mass!r}" '
        f'fullinertia="{_numbers(full)}"/>'
    )


def _quaternion(R: NDArray[np.float64]) -> NDArray[np.float64]:
    w = math.sqrt(max(0.0, 1.0 + R[0, 0] + R[1, 1] + R[2, 2])) / 2.0  # small static angles: w is near 1
    return np.array([w, *((R[2, 1] - R[1, 2]), (R[0, 2] - R[2, 0]), (R[1, 0] - R[0, 1]))]) / [1, 4 * w, 4 * w, 4 * w]


def slide_directions(car: Car, hidden: Sequence[Hidden]) -> NDArray[np.float64]:
    """(4, 3) displacement of each wheel centre per unit of travel, body axes: z unless a hidden effect tilts it."""
    out = np.tile([0.0, 0.0, 1.0], (4, 1))
    for i, corner in enumerate(CORNERS):
        out[i, 0] = total_at(hidden, "anti_dive", corner)
        out[i, 1] = total_at(hidden, "jacking", corner) * (1.0 if corner[1] == "l" else -1.0)
    return out


def build_mjcf(car: Car, slides: NDArray[np.float64]) -> str:
    """The car as MJCF text."""
    corners = []
    for i, corner in enumerate(CORNERS):
        axle, R0, centre = car.axle(corner), car.design_attitude(corner), car.wheel_centres[i]
        carrier = Inertia.of(axle.carrier_mass, np.zeros(3), np.diag(axle.carrier_inertia))
        spin, side = axle.spin_inertia, axle.inboard_transverse + axle.outboard_transverse
        wheel = Inertia.of(axle.inboard_mass + axle.outboard_mass, np.zeros(3), np.diag([side, spin, side]))
        steer = (
            f'<joint name="steer_{corner}" type="hinge" axis="{_numbers(R0.T @ car.kingpin(corner))}" '
            f'armature="{STEER_ARMATURE!r}"/>'
            if axle.steered
            else ""
        )
        corners.append(
            f'<body name="carrier_{corner}" pos="{_numbers(centre)}" quat="{_numbers(_quaternion(R0))}">'
            f"{_inertial(carrier, np.zeros(3))}"
            f'<joint name="slide_{corner}" type="slide" axis="{_numbers(R0.T @ slides[i])}"/>{steer}'
            f'<body name="wheel_{corner}">{_inertial(wheel, np.zeros(3))}'
            f'<joint name="spin_{corner}" type="hinge" axis="0 1 0"/></body></body>'
        )
    return (
        '<mujoco model="car"><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="0 0 {-car.gravity!r}">'
        '<flag contact="disable" constraint="disable" sensor="disable"/></option>'
        f'<worldbody><body name="chassis"><freejoint/>{_inertial(car.chassis, np.zeros(3))}{"".join(corners)}'
        "</body></worldbody></mujoco>"
    )


class Instant:
    """Forces and states of one instant, body axes; what `Engine.load` writes and the run records."""

    def __init__(self) -> None:
        self.force = [(0.0, 0.0, 0.0)] * 4
        self.moment = [(0.0, 0.0, 0.0)] * 4
        self.suspension = [0.0] * 4
        self.deflection = [0.0] * 4
        self.distance = [0.3] * 4
        self.normal = (0.0, 0.0, 1.0)
        self.air_force = (0.0, 0.0, 0.0)
        self.air_moment = (0.0, 0.0, 0.0)
        self.slip_rates = [0.0] * 8


class Engine:
    """A car on a road in MuJoCo. `load` sets the generalised forces of the present state; `accelerate` solves."""

    def __init__(self, car: Car, road: Road, hidden: Sequence[Hidden]):
        lib = self.lib = engine_library()
        self.car, self.road, self.hidden = car, road, hidden
        self.slides = slide_directions(car, hidden)
        self.model = lib.MjModel.from_xml_string(build_mjcf(car, self.slides))
        self.data = lib.MjData(self.model)
        self.data.qpos[2] = car.origin_height

        def address(kind: str, corner: str) -> int:
            index = lib.mj_name2id(self.model, lib.mjtObj.mjOBJ_JOINT, f"{kind}_{corner}")
            return -1 if index < 0 else int(self.model.jnt_dofadr[index])

        self.slide_dof = [address("slide", c) for c in CORNERS]
        self.steer_dof = [address("steer", c) for c in CORNERS]
        self.spin_dof = [address("spin", c) for c in CORNERS]
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
        self._tyres = [
            WheelTyre(
                car.axle(c),
                car.tyre,
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
        self._bars = [total_at(hidden, "anti_roll_bar", c) for c in CORNERS]
        self._lift = [total_at(hidden, "aero_lift", c) for c in ("fl", "rl")]
        drags = [h for h in hidden if h.effect == "aero_drag"]
        self._drag = [(h.size, h.shape["height"] - car.origin_height) for h in drags]
        self._air = bool(drags) or any(self._lift)
        self._tracks = (road.left.tolist(), road.right.tolist())
        self.now = Instant()

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
        """Write all forces at state (q, v) into the engine's generalised forces and return them.

        `q`, `v` : MuJoCo's coordinates and velocities; `slips` : (8,) κ of the four wheels, then α; `steer` : demanded
        kingpin angle [rad]; `shaft`, `brake` : (4,) torques on the wheels [N·m]; `step` : integration step [s].
        """
        now, out = self.now, [0.0] * self.model.nv
        w, x, y, z = q[3:7]
        r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
        vx, vy, vz = v[0], v[1], v[2]
        bx, by, bz = r00 * vx + r10 * vy + r20 * vz, r01 * vx + r11 * vy + r21 * vz, r02 * vx + r12 * vy + r22 * vz
        p, qq, r = v[3], v[4], v[5]
        travel, rate, centre = [0.0] * 4, [0.0] * 4, [(0.0, 0.0, 0.0)] * 4
        slope_x = slope_y = 0.0
        for i in range(4):
            dof, stretch = self.slide_dof[i], self.stretch[i]
            s = q[dof + 1] / stretch
            travel[i], rate[i] = s, v[dof] / stretch
            (cx, cy, cz), (ux, uy, _) = self._centres[i], self._u[i]
            rx, ry, rz = centre[i] = (cx + ux * s, cy + uy * s, cz + s)
            world_z = q[2] + r20 * rx + r21 * ry + r22 * rz
            if self.road.flat:
                d = world_z / r22
            else:
                d, world_x = now.distance[i], q[0] + r00 * rx + r01 * ry + r02 * rz
                for _ in range(2):
                    d = (world_z - self._height(world_x - d * r02, i)) / r22
            now.distance[i] = d
            slope_x += self._slope_x[i] * (rz - d)
            slope_y += self._slope_y[i] * (rz - d)
        size = math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        e = now.normal = (-slope_x / size, -slope_y / size, 1.0 / size)
        fx = fy = fz = mx = my = mz = 0.0
        for i in range(4):
            rx, ry, rz = centre[i]
            ux, uy, _ = self._u[i]
            s, sd = travel[i], rate[i]
            fixed, cosine, sine, k = self._axes[i]
            dof, tx, ty, tz = self.steer_dof[i], p, qq, r
            if dof >= 0:
                angle, turn = q[dof + 1], v[dof]
                c, sn = math.cos(angle), math.sin(angle)
                n = (
                    fixed[0] + c * cosine[0] + sn * sine[0],
                    fixed[1] + c * cosine[1] + sn * sine[1],
                    fixed[2] + c * cosine[2] + sn * sine[2],
                )
                tx, ty, tz = tx + turn * k[0], ty + turn * k[1], tz + turn * k[2]
                out[dof] = STEER_ARMATURE * STEER_FREQUENCY * (STEER_FREQUENCY * (steer - angle) - 2.0 * turn)
            else:
                n = (fixed[0] + cosine[0], fixed[1] + cosine[1], fixed[2] + cosine[2])
            speed = (bx + qq * rz - r * ry + ux * sd, by + r * rx - p * rz + uy * sd, bz + p * ry - qq * rx + sd)
            spin_dof = self.spin_dof[i]
            got = self._tyres[i].contact(
                n, e, now.distance[i] * e[2], speed, (tx, ty, tz), v[spin_dof], slips[i], slips[i + 4], step
            )
            now.force[i], now.moment[i], now.deflection[i] = got.force, got.moment, got.deflection
            now.slip_rates[i], now.slip_rates[i + 4] = got.kappa_rate, got.alpha_rate
            gx, gy, gz = got.force
            hx, hy, hz = got.moment
            stiffness, damping, offset = self._springs[i]
            load = stiffness * s + damping * sd + offset
            for law in self._laws[i]:
                load += law(s, sd)
            if self._bars[i]:
                load += self._bars[i] * (s - travel[i ^ 1])
            now.suspension[i] = load
            out[self.slide_dof[i]] = (gx * ux + gy * uy + gz - load) / self.stretch[i]
            out[spin_dof] = hx * n[0] + hy * n[1] + hz * n[2] + shaft[i] - brake[i] * math.tanh(v[spin_dof])
            if dof >= 0:
                # the half-shaft turns the wheel and reacts on the chassis: it works on the steering, not on the car
                t = shaft[i]
                out[dof] += (hx + t * n[0]) * k[0] + (hy + t * n[1]) * k[1] + (hz + t * n[2]) * k[2]
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            mx, my, mz = mx + hx + ry * gz - rz * gy, my + hy + rz * gx - rx * gz, mz + hz + rx * gy - ry * gx
        if self._air:
            ax, az, am = self._wind(bx)
            fx, fz, my = fx + ax, fz + az, my + am
        out[0], out[1], out[2] = (
            r00 * fx + r01 * fy + r02 * fz,
            r10 * fx + r11 * fy + r12 * fz,
            r20 * fx + r21 * fy + r22 * fz,
        )
        out[3], out[4], out[5] = mx, my, mz
        self.data.qfrc_applied[:] = out
        return now

    def accelerate(self) -> NDArray[np.float64]:
        """Accelerations of the present state under the loads set (a view into the engine's memory)."""
        self.lib.mj_forward(self.model, self.data)
        return self.data.qacc

    def _height(self, x: float, corner: int) -> float:
        z = self._tracks[corner % 2]
        at = (x - self.road.start) / SPACING
        i = math.floor(at)
        if i < 0 or i + 1 >= len(z):
            return 0.0
        return z[i] + (at - i) * (z[i + 1] - z[i])

    def _wind(self, bx: float) -> tuple[float, float, float]:
        """Air on the body: force along x, along z and moment about y, body axes about the origin."""
        square, length = bx * bx, self.car.wheelbase
        force = moment = 0.0
        for size, height in self._drag:
            force -= size * bx * abs(bx)
            moment -= height * size * bx * abs(bx)
        front, rear = self._lift[0] * square, self._lift[1] * square
        moment += length * rear
        self.now.air_force, self.now.air_moment = (force, 0.0, front + rear), (0.0, moment, 0.0)
        return force, front + rear, moment
