"""What is assumed of the forces between tyre and road that no row of the equations gives, with its tolerance.

Each is a constant of a run with a mean and a 1 σ: it acts with the forces of the moment (a trail times a lateral force)
and enters the bands as every tolerance does.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """A quantity that is assumed: its `mean` and 1 σ, `sigma`."""

    mean: float
    sigma: float


@dataclass(frozen=True)
class Assumptions:
    """Assumed properties of the forces between tyre and road, mean and 1 σ.

    Sources: H. B. Pacejka, Tyre and Vehicle Dynamics, 2012, chapters 1 and 4 (trail, rolling resistance, side force
    against load); W. F. Milliken and D. L. Milliken, Race Car Vehicle Dynamics, 1995, chapter 2. Rolling resistance of
    new passenger tyres at 25 °C: 0.0065 to 0.0105 and more (Regulation (EU) 2020/740, classes A to E), about 0.010 on
    the mean, 0.007 to 0.017 (Transportation Research Board, Special Report 286, 2006); 0.8 % more per kelvin below (UN
    Regulation 117, annex 6). Released disc brakes: up to 69 N at the wheel bolts, 4 N·m (service manual, Mitsubishi
    Eclipse, 1997).

    Attributes
    ----------
    trail : pneumatic trail of a tyre [m].
    shift : the load's distance to the left of the wheel's plane [m].
    rolling : coefficient of rolling resistance, the same for a set of tyres; `rolling_own` : what a wheel differs by,
        5 %: pressure and temperature.
    brake_drag : torque of a released brake that is not measured [N·m]: any between 0 and 4, of each by itself.
    radius : error of the loaded radius where the ground is measured [m]; `radius_unmeasured` : where it is not.
    toe : half of the difference of lateral forces left and right of an axle that toe and camber make [N].
    proportion : the same, as a part of the axle's lateral force, beyond its division in proportion to vertical loads.
    degression : part by which the division differs from that in proportion: 1 where both wheels carry the same.
    longitudinal : half of the difference of longitudinal forces left and right, as a part of the axle's; and
        `longitudinal_force` as a force [N]: rolling resistance of unequal loads, some 10 N, and released brakes that
        drag, up to 4 N·m each.
    axles : difference between the axles' longitudinal forces beyond that of driven wheels that drive and of brakes in
        proportion to vertical loads, as a part of the car's; and `axles_force` as a force [N].
    spin_inertia : moment of inertia of rim and tyre about the axis ÷ their mass times R0², with ``hub`` loads.
    """

    trail: Tolerance = Tolerance(0.025, 0.015)
    shift: Tolerance = Tolerance(0.0, 0.005)
    rolling: Tolerance = Tolerance(0.0115, 0.0025)
    rolling_own: Tolerance = Tolerance(0.0, 0.0006)
    brake_drag: Tolerance = Tolerance(2.0, 1.15)
    radius: Tolerance = Tolerance(0.0, 0.002)
    radius_unmeasured: Tolerance = Tolerance(0.0, 0.008)
    toe: Tolerance = Tolerance(0.0, 150.0)
    proportion: Tolerance = Tolerance(0.0, 0.03)
    degression: Tolerance = Tolerance(0.15, 0.25)
    longitudinal: Tolerance = Tolerance(0.0, 0.05)
    longitudinal_force: Tolerance = Tolerance(0.0, 15.0)
    axles: Tolerance = Tolerance(0.0, 0.3)
    axles_force: Tolerance = Tolerance(0.0, 300.0)
    spin_inertia: Tolerance = Tolerance(0.65, 0.15)


STANDARD = Assumptions()
"""What is assumed of road tyres on a passenger car."""

DRAWS = 16
"""Simulated noise draws of a run behind the covariance of its rows: it is known to 1 % then."""
TURNS = 3
"""Times that the loads are solved for, each with the division left and right and the effects of the last."""
NEW_OFFSET = 500.0
"""1 σ of a static offset of a suspension that is taken anew from a rest of the run [N]."""
PASSING = 0.5
"""Part of the variance of what is assumed that differs from instant to instant; the rest is the same for a run."""
