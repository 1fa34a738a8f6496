"""Wheel loads from known masses, for rows of the body in which the vertical forces of the wheels cancel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.identify.car.car_tree import AXLE, CHASSIS, WHEEL
from lacet.identify.car.sources.wheel_force import GRAVITY, WheelForceLaw, corner_motion, inboard_mass, shares
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.signals.sources import Series


@dataclass(frozen=True)
class NominalLoad(WheelForceLaw):
    """Wheel force of a car whose masses are known: a quarter of the sprung mass and what is unsprung.

    F_z = m g (1 − τ side a_y / g), τ the load transfer; F_x and F_y are in proportion to it and to the accelerations.
    In the rows of the body F_z cancels; of the horizontal forces remains what the levers of the single patches differ
    from their mean, and what the slopes of the bench tables take. `outboard` : mass outside the transducer, which hub
    loads do not carry; None for contact loads.

    What is known above the suspension is the car's `sprung` mass, or the corner's `static` load where `known`
    parameters, by name, set the scale: then the sprung mass is a parameter.
    """

    rig: Rig
    sprung: Assumption | None
    static: Assumption
    known: tuple[tuple[str, Assumption], ...]
    unsprung: Assumption
    outboard: Assumption | None
    transfer: Assumption
    lateral: Assumption
    longitudinal: Assumption

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Masses or the known parameters, load transfer, shares of the horizontal forces."""
        above = (self.sprung,) if self.sprung else (self.static, *(one for _, one in self.known))
        every = (*above, self.unsprung, self.outboard, self.transfer, self.lateral, self.longitudinal)
        return tuple(one for one in every if one is not None)

    def unsprung_mass(self, signals: Signals) -> Array:
        """(N,) what is unsprung inboard of the point that the wheel loads belong to [kg]."""
        return inboard_mass(signals, self.unsprung, self.outboard)

    def series(self, signals: Signals) -> Series:
        """The force."""
        mass = self._carried(signals) + self.unsprung_mass(signals)
        _, accel = corner_motion(self.corner, signals, self.rig, mass.size)
        moved = signals.assumed[self.transfer.name][0] * self.corner.side * accel[1] / GRAVITY
        force = shares(signals, self.lateral, self.longitudinal, mass * GRAVITY * (1.0 - moved), accel)
        return Series(force, np.zeros_like(force), np.zeros_like(force))

    def _carried(self, signals: Signals) -> Array:
        """(N,) sprung mass that the corner carries at rest [kg]."""
        if self.sprung is not None:
            return signals.assumed[self.sprung.name][0] / len(CORNERS)
        return signals.assumed[self.static.name][0] / GRAVITY


def known_parameters(recording: Recording) -> dict[str, Array]:
    """Known parameters that stand in for a known mass: name → (N,); empty where wheel loads or the mass are known."""
    assumed = recording.signals.assumed
    laws = [law for law in recording.laws if isinstance(law, NominalLoad) and law.sprung is None]
    return {name: assumed[one.name][0] for law in laws for name, one in law.known}


def given_parameters(recording: Recording) -> dict[str, str]:
    """Parameters that are none to be fitted, as no wheel load is measured: name → the assumption that gives it."""
    out: dict[str, str] = {}
    for law in recording.laws:
        if isinstance(law, NominalLoad):
            c = law.corner.name
            out |= dict.fromkeys((f"M{AXLE[c]}", f"M{WHEEL[c]}"), law.unsprung.name)
            above = law.known if law.sprung is None else ((f"M{CHASSIS}", law.sprung),)
            out |= {name: one.name for name, one in above}
    return out


def known_masses(recording: Recording) -> dict[str, Array]:
    """Masses that stand in for measured wheel loads: ``chassis`` and ``axle.{c}`` → (N,) [kg]; empty with loads."""
    out: dict[str, Array] = {}
    for law in recording.laws:
        if isinstance(law, NominalLoad):
            if law.sprung is not None:
                out["chassis"] = recording.signals.assumed[law.sprung.name][0]
            out[f"axle.{law.corner.name}"] = law.unsprung_mass(recording.signals)
    return out
