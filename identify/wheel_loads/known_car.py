"""What is known of a car when its wheel loads are to be observed: a fit, its errors, and what differs since."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.tolerances import ASSUMED, SheetEntry, entry_name
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
class Instruments:
    """What a study's runs say of its instruments' latencies, each ÷ its tolerance, the tolerances themselves left out.

    `entries` of the sensor sheet; `normal` (q, q), `right` (q,) of their least squares.
    """

    entries: tuple[SheetEntry, ...]
    normal: Array
    right: Array


@dataclass(frozen=True)
class InstrumentError:
    """An error of an instrument of a study, of a run, or of both.

    Attributes
    ----------
    name : of its entry of the sensor sheet.
    of_study, here : that entry by the study's rig and by the run's; None where the instrument is not in it.
    moved : (p,) change of the physics' parameters by one tolerance of it.
    """

    name: str
    of_study: SheetEntry | None
    here: SheetEntry | None
    moved: Array


@dataclass(frozen=True)
class KnownCar:
    """A car as a study knows it.

    Attributes
    ----------
    fitted : the fit.
    lack : row → RMS by which the fit leaves more than noise, parameters and instruments explain (`lack_of_fit`).
    assumed : what is assumed of the contact between tyre and road.
    knowledge : of the fit's parameters, where it is computed already.
    instruments : what the study's runs say of its instruments; without it, their tolerances alone are known.
    """

    fitted: Fit
    lack: Mapping[Row, float] = field(default_factory=dict[Row, float])
    assumed: Assumptions = STANDARD
    knowledge: Knowledge | None = None
    instruments: Instruments | None = None

    @property
    def parameter_errors(self) -> Array:
        """(p, r) L with L Lᵀ the covariance of the physics' parameters by noise and what the runs leave open."""
        knowledge = self.knowledge or Knowledge.of(self.fitted)
        return parameter_errors(self.fitted, knowledge, apart=self.fitted.sheet_moves)

    def instrument_errors(self, rig: Rig, entries: Iterable[SheetEntry]) -> list[InstrumentError]:
        """Errors of the study's instruments, and of the run's own by its rig and the `entries` of its sheet.

        The error of an instrument that study and run have in common is the same in both, where much of it cancels: a
        spring that came out too soft by a laser's gain acts on a travel that is too large by it. An instrument is the
        same where both rig files have the same entry of it.
        """
        fitted, own_entries = self.fitted, dict.fromkeys(entries)
        own, size = fitted.runs[0].recording.rig, fitted.model.physics_size
        out: list[InstrumentError] = []
        for entry, moved in fitted.sheet_moves.items():
            here = next((e for e in own_entries if _same(own, entry, rig, e)), None)
            if here is not None:
                del own_entries[here]
            out.append(InstrumentError(fitted.entry_name(entry), entry, here, moved[:size]))
        return [*out, *(InstrumentError(entry_name(e, rig), None, e, np.zeros(size)) for e in own_entries)]

    def said_by_study(self, entries: Sequence[SheetEntry | None]) -> tuple[Array, Array]:
        """(q, q), (q,) normal matrix and right side by which the study's runs say something of constants of a run.

        `entries` : of the study's sheet, None for a constant that is no error of its instruments.
        """
        normal, right = np.zeros((len(entries), len(entries))), np.zeros(len(entries))
        if self.instruments is not None:
            place = {entry: i for i, entry in enumerate(entries)}
            at = [place[entry] for entry in self.instruments.entries]
            normal[np.ix_(at, at)], right[at] = self.instruments.normal, self.instruments.right
        return normal, right

    @property
    def outboard(self) -> dict[str, float]:
        """Corner → mass outboard of the transducer [kg]; empty with ``contact`` loads."""
        names = self.fitted.model.names
        found = {c: f"outboard_mass.{c}.m" for c in CORNERS}
        return {c: self.fitted.value(name) for c, name in found.items() if name in names}


def _same(own: Rig, entry: SheetEntry, rig: Rig, other: SheetEntry) -> bool:
    """Whether entries of two rigs' sheets are of one instrument, as a sensor's latency is by any of its channels."""
    if entry[0] != other[0] or entry[0] == ASSUMED:
        return entry == other
    sensor = own.sensor_of(entry[1])
    if sensor != rig.sensor_of(other[1]) or (entry != other and (entry[0] != "latency" or sensor is None)):
        return False
    return own.tolerance(entry[1], entry[0]) == rig.tolerance(other[1], other[0])


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
