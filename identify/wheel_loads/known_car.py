"""What is known of a car when its wheel loads are to be observed: a fit, its errors, and what differs since."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.tolerances import ASSUMED, SheetEntry
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.wheel_loads.settings import STANDARD, Assumptions

_SMALLEST = 1e-9
"""Part of the largest below which a direction of the parameters' covariance, each ÷ its σ, counts as rounding."""


@dataclass(frozen=True)
class Changes:
    """Differences between the car on a run and that of the study.

    Attributes
    ----------
    mass, mass_sigma : change of the mass of each wheel, as when its dynamometer comes off, and its 1 σ [kg].
    rest : interval (from, to) [s] in which the car stands: static offsets of the suspensions, zeros and all else that
        is constant are taken from it anew; None to take what is constant from the whole run, with the study's offsets.
    """

    mass: float = 0.0
    mass_sigma: float = 0.0
    rest: tuple[float, float] | None = None


NOTHING = Changes()
"""The car is that of the study."""


@dataclass(frozen=True)
class KnownCar:
    """A car as a study knows it.

    Attributes
    ----------
    fitted : the fit.
    lack : row → RMS by which the fit leaves more than noise, parameters and tolerances explain (`lack_of_fit`).
    assumed : what is assumed of the contact between tyre and road.
    knowledge : of the fit's parameters, where it is computed already.
    """

    fitted: Fit
    lack: Mapping[Row, float] = field(default_factory=dict[Row, float])
    assumed: Assumptions = STANDARD
    knowledge: Knowledge | None = None

    def parameter_errors(self, apart: Collection[SheetEntry] = ()) -> Array:
        """As the function of this name, of the fit."""
        return parameter_errors(self.fitted, self.knowledge or Knowledge.of(self.fitted), apart)

    def same_instruments(self, rig: Rig) -> dict[SheetEntry, Array]:
        """Gains, latencies and assumptions that the study has of the instruments of a run's rig as well.

        Entry of the sensor sheet → (p,) change of the physics' parameters by one tolerance of it. The error of such an
        instrument is the same in the study and in the run, where much of it cancels: a spring that came out too soft
        by a laser's gain acts on a travel that is too large by it.
        """
        own = self.fitted.runs[0].recording.rig
        return {
            entry: moved[: self.fitted.model.physics_size]
            for entry, moved in self.fitted.sheet_moves.items()
            if entry[0] == ASSUMED
            or (own.sensor_of(entry[1]) == rig.sensor_of(entry[1]) and _tolerance(own, entry) == _tolerance(rig, entry))
        }

    @property
    def outboard(self) -> dict[str, float]:
        """Corner → mass outboard of the transducer [kg]; empty with ``contact`` loads."""
        names = self.fitted.model.names
        found = {c: f"outboard_mass.{c}.m" for c in CORNERS}
        return {c: self.fitted.value(name) for c, name in found.items() if name in names}


def _tolerance(rig: Rig, entry: SheetEntry) -> float:
    what, channel, _ = entry
    return rig.tolerance(channel, what)


def parameter_errors(fitted: Fit, knowledge: Knowledge, apart: Collection[SheetEntry] = ()) -> Array:
    """(p, r) L with L Lᵀ the covariance of the physics' parameters, the sensor sheet of the study included.

    `knowledge` : that of the fit; `apart` : entries of the sheet that are counted elsewhere.
    """
    p = fitted.model.physics_size
    covariance = knowledge.covariance + fitted.covariance_sheet[:p, :p]
    for entry in apart:
        covariance = covariance - np.outer(fitted.sheet_moves[entry][:p], fitted.sheet_moves[entry][:p])
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    size, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = size > _SMALLEST * size[-1]
    return scale[:, None] * vectors[:, kept] * np.sqrt(size[kept])
