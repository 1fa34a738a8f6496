"""Lateral forces that lift the body: errors of the bench table's half-track slope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from daq.vehicle import Vehicle
from identify.effect import AXLES, Effect, Parameter
from identify.motion import Motion
from identify.vectors import Array


class Jacking(Effect):
    """The wheel centres of an axle move outward by p s more than the bench table says.

    The lateral force then does work on the travel that the suspension row lacks, F_out p, and acts at a wheel centre
    that is p s farther out, which the lasers do not see: moments about x and z. The inertia of the axle itself, a tenth
    of the force, is neglected. A contact force at the radius R below the wheel centre has the moment R F about x, so
    that a camber slope error of p/R looks the same in the suspension rows.
    """

    name = "jacking"
    about = "lateral force transferred to the suspension (error of the table's half-track slope)"
    signature = "suspension rows of an axle follow the lateral force, outward on both sides"
    shown_by = "cornering: fast steering, lift-off in a turn"
    source = "Milliken and Milliken (1995), Race Car Vehicle Dynamics, chapter 17; Reimpell et al. (2001), section 3.4"
    rows = ("suspension", "chassis.mx", "chassis.mz")
    looks_like = ("camber_change",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Both axles."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the slope of the half track p: m outward per m of compression."""
        return (self.named("p", "-", -0.5, 0.5),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−F_out in the suspensions, −Δr × F in the chassis."""
        out: dict[str, Array] = {}
        moment = np.zeros((2, motion.t.size))
        for c in self.corners():
            corner, side = motion.corners[c], 1.0 if c.endswith("l") else -1.0
            out[f"suspension.{c}"] = -side * corner.force[1][None]
            moment += side * corner.travel * np.stack([-corner.force[2], corner.force[0]])
        return out | {"chassis.mx": moment[:1], "chassis.mz": moment[1:]}
