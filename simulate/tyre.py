"""Tyre of the simulated car, one wheel at a time in plain floats (evaluated 8 000 times a simulated second).

Vertical: along the road normal e, F·e = kt·δ (+ hidden terms), δ = R0 - h/√(1 - (n·e)²), h wheel-centre height along e,
n spin axis; 0 when the wheel is in the air. Horizontal: brush model with combined slip, its slips relaxing:

    σx dκ/dt = -vsx - |vx|·κ,   σy dα/dt = -vsy - |vx|·α        (vs: slip velocity at the contact, v·l = vx)
    s = √((Cκ·κ)² + (Cα·β)²)/(μ·Fz),   F = μ·Fz·g(s)·(Cκ·κ, Cα·β)/(s·μ·Fz),   g = s - s²/3 + s³/27 (1 from s = 3)

β = α - α₀ with the tyre's neutral slip α₀, Cκ = slip·Fz, Cα = cornering·Fz·(1 - degression·(Fz/F0 - 1)). Aligning
moment -t·Fy about e with the trail t = trail·(1 - s/3)³; rolling resistance as a moment -f·Fz·R·tanh(ω) about the
lateral axis e × l.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from lacet.simulate.cars import Axle, Tyre


class Contact(NamedTuple):
    """Road on tyre, reduced to the wheel centre, body axes, and the rates of the slip states."""

    force: tuple[float, float, float]
    moment: tuple[float, float, float]
    deflection: float
    kappa_rate: float
    alpha_rate: float


class WheelTyre:
    """The tyre of one wheel, with its constants precomputed."""

    def __init__(
        self, axle: Axle, tyre: Tyre, progression: float, damping: float, resistance: float, camber_thrust: float
    ):
        self.radius, self.stiffness = axle.radius, axle.tyre_stiffness
        self.cornering, self.slip, self.friction = axle.cornering, axle.slip, tyre.friction
        self.nominal, self.degression = tyre.load_nominal, tyre.degression
        self.sigma_x, self.sigma_y, self.trail = tyre.relaxation_longitudinal, tyre.relaxation_lateral, tyre.trail
        self.neutral_slip = tyre.neutral_slip
        self.progression, self.damping = progression, damping
        self.resistance, self.camber_thrust = tyre.rolling_resistance + resistance, camber_thrust
        self._first = self._second = math.nan

    def deflection_rate(self, deflection: float, step: float) -> float:
        """dδ/dt at the newest of three successive steps, second order backwards (0 on the first two calls)."""
        a, b = self._first, self._second
        self._first, self._second = b, deflection
        return 0.0 if math.isnan(a) else (3.0 * deflection - 4.0 * b + a) / (2.0 * step)

    def contact(
        self,
        n: tuple[float, float, float],
        e: tuple[float, float, float],
        height: float,
        v: tuple[float, float, float],
        turn: tuple[float, float, float],
        spin: float,
        kappa: float,
        alpha: float,
        step: float,
    ) -> Contact:
        """Force and moment of the road on this wheel, with deflection and slip rates; all vectors in body axes.

        `n` spin axis, `e` road normal, `height` of the wheel centre along e [m], `v` velocity of the wheel centre
        [m/s], `turn` angular velocity of the carrier [rad/s], `spin` of the wheel against the carrier [rad/s],
        `kappa`, `alpha` relaxed slips, `step` integration step [s].
        """
        nx, ny, nz = n
        ex, ey, ez = e
        ne = nx * ex + ny * ey + nz * ez
        q = math.sqrt(1.0 - ne * ne)
        loaded = height / q
        delta = self.radius - loaded
        load = self.stiffness * delta
        if self.progression:
            load += self.progression * delta * delta
        if self.damping:
            load += self.damping * self.deflection_rate(delta, step)
        if delta < 0.0 or load < 0.0:
            load = 0.0
        # l forward, a to the left, both in the road plane; w from contact to wheel centre, in the wheel plane
        lx, ly, lz = (ny * ez - nz * ey) / q, (nz * ex - nx * ez) / q, (nx * ey - ny * ex) / q
        ax, ay, az = ey * lz - ez * ly, ez * lx - ex * lz, ex * ly - ey * lx
        rx, ry, rz = -loaded * (ex - ne * nx) / q, -loaded * (ey - ne * ny) / q, -loaded * (ez - ne * nz) / q
        tx, ty, tz = turn
        vx = v[0] * lx + v[1] * ly + v[2] * lz
        spin_total = spin + tx * nx + ty * ny + tz * nz
        slip_x = vx - (self.radius - delta / 3.0) * spin_total
        slip_y = (
            (v[0] + ty * rz - tz * ry) * ax + (v[1] + tz * rx - tx * rz) * ay + (v[2] + tx * ry - ty * rx) * az
        )  # of the carrier only: the contribution of the spin is along l
        rolling = abs(vx)
        kappa_rate = (-slip_x - rolling * kappa) / self.sigma_x
        alpha_rate = (-slip_y - rolling * alpha) / self.sigma_y
        long = lat = aligning = 0.0
        if load > 0.0:
            grip = self.friction * load
            sx = self.slip * load * kappa / grip
            stiffness = self.cornering * load * (1.0 - self.degression * (load / self.nominal - 1.0))
            sy = stiffness * (alpha - self.neutral_slip) / grip
            s = math.sqrt(sx * sx + sy * sy)
            part = 1.0 - s / 3.0 + s * s / 27.0 if s < 3.0 else 1.0 / s
            long, lat = grip * part * sx, grip * part * sy
            aligning = -self.trail * (1.0 - s / 3.0) ** 3 * lat if s < 3.0 else 0.0
            if self.camber_thrust:
                lat -= self.camber_thrust * load * math.asin(ne)
        drag = -self.resistance * load * loaded * math.tanh(spin_total)
        fx = long * lx + lat * ax + load * ex
        fy = long * ly + lat * ay + load * ey
        fz = long * lz + lat * az + load * ez
        moment = (
            ry * fz - rz * fy + aligning * ex + drag * ax,
            rz * fx - rx * fz + aligning * ey + drag * ay,
            rx * fy - ry * fx + aligning * ez + drag * az,
        )
        return Contact((fx, fy, fz), moment, delta, kappa_rate, alpha_rate)
