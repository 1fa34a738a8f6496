"""Runs of a fit as a ranking asks for them: in this process, or each on a worker elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress
from lacet.identify.properties.known_scale import KnownScale, known_scale
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.cross_products import CrossProducts, Extent
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.columns.weighted_columns import Weighting
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.identify.validation.parameter_estimates import estimates, rows_absent
from lacet.identify.validation.row_sources import assumed_channels


class RankedRuns(Protocol):
    """A fitted model and the runs it was fitted to."""

    @property
    def fitted(self) -> FittedModel:
        """The fitted model."""
        ...

    @property
    def refittable(self) -> Fit | None:
        """The fit itself, where its runs are at hand to be fitted again with latencies or faults removed."""
        ...

    @property
    def names(self) -> Sequence[str]:
        """Names of the runs."""
        ...

    @property
    def seconds(self) -> Sequence[float]:
        """Lengths of the runs [s]."""
        ...

    @property
    def rig(self) -> Rig:
        """The rig of the first run."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The car."""
        ...

    @property
    def wheel_reference(self) -> str:
        """``contact`` or ``hub``."""
        ...

    @property
    def sheet_entries(self) -> tuple[SheetEntry, ...]:
        """Gains and latencies of the sensor sheet that the rows depend on, without those in the model as faults."""
        ...

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        ...

    def entry_name(self, entry: SheetEntry) -> str:
        """Name of an entry of the sensor sheet."""
        ...

    def row_ratios(self, floor: NoiseFloor) -> Mapping[Row, float]:
        """Row → RMS residual ÷ noise floor over all runs."""
        ...

    def row_variations(self) -> Mapping[Row, float]:
        """Row → RMS variation of what is measured in it, about its mean in each run [N or N·m]."""
        ...

    def unmeasured(self, effects: Sequence[Effect]) -> Mapping[str, Unmeasured]:
        """Key → what a run lacks, of the first such run, for effects that cannot be computed."""
        ...

    def absent(self, effect: Effect) -> Unmeasured | None:
        """Channels lacking for a row that an effect acts on, or of a sensor fault its own; None where any are there.

        None as well where the runs are not at hand.
        """
        ...

    def scale(self) -> KnownScale | None:
        """How well the scale of the fit is known; None where a run measures wheel loads, or is not at hand."""
        ...

    def assumed(self, rests: Mapping[Row, float]) -> Mapping[Row, tuple[str, ...]]:
        """Row → channels assumed whose error its rest may be (`assumed_channels`); empty where no run is at hand."""
        ...

    def products(
        self, floor: NoiseFloor, layout: Layout, prior_stiffening: float, drifts: Mapping[str, float], seed: int,
        extent: Extent = Extent.ALL, known: CrossProducts | None = None,
    ) -> CrossProducts:  # fmt: skip
        """Cross products of the columns of a layout; parameters as of `CrossProducts.of`."""
        ...

    def regressor_noise(self, weighting: Weighting, sigma: Mapping[Row, float], progress: Progress) -> RegressorNoise:
        """Noise in the columns of all runs, for rows weighted by `sigma`."""
        ...

    def regressor_noise_of(
        self, run: int, weighting: Weighting, sigma: Mapping[Row, float], pairs: int
    ) -> RegressorNoise:
        """Noise in the columns of one run, from so many pairs of draws."""
        ...


@dataclass(frozen=True)
class LocalRuns:
    """A fit whose runs are in this process."""

    fit: Fit

    @property
    def fitted(self) -> FittedModel:
        """The fit."""
        return self.fit

    @property
    def refittable(self) -> Fit | None:
        """The fit."""
        return self.fit

    @property
    def names(self) -> Sequence[str]:
        """Names of the runs."""
        return [run.name for run in self.fit.runs]

    @property
    def seconds(self) -> Sequence[float]:
        """Lengths of the runs [s]."""
        return [float(np.ptp(run.recording.t)) for run in self.fit.runs]

    @property
    def rig(self) -> Rig:
        """The rig of the first run."""
        return self.fit.runs[0].recording.rig

    @property
    def vehicle(self) -> Vehicle:
        """The car."""
        return self.fit.runs[0].recording.vehicle

    @property
    def wheel_reference(self) -> str:
        """``contact`` or ``hub``."""
        return self.fit.runs[0].recording.reference

    @property
    def sheet_entries(self) -> tuple[SheetEntry, ...]:
        """Gains and latencies of the sensor sheet that the rows depend on, without those in the model as faults."""
        return self.fit.sheet_entries

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return self.fit.omega

    def entry_name(self, entry: SheetEntry) -> str:
        """Name of an entry of the sensor sheet."""
        return self.fit.entry_name(entry)

    def row_ratios(self, floor: NoiseFloor) -> Mapping[Row, float]:
        """Row → RMS residual ÷ noise floor over all runs."""
        out: dict[Row, float] = {}
        for row in self.fit.rows:
            squares = np.concatenate([part[row] ** 2 for part in self.fit.residual if row in part])
            out[row] = float(np.sqrt(np.mean(squares))) / floor.sigma[row]
        return out

    def row_variations(self) -> Mapping[Row, float]:
        """Row → RMS variation of what is measured in it, about its mean in each run [N or N·m]."""
        out: dict[Row, float] = {}
        for row in self.fit.rows:
            each = [run.measured[row] for run in self.fit.runs if row in run.measured]
            out[row] = float(np.sqrt(np.mean(np.concatenate([(one - float(np.mean(one))) ** 2 for one in each]))))
        return out

    def unmeasured(self, effects: Sequence[Effect]) -> Mapping[str, Unmeasured]:
        """Key → what a run lacks, of the first such run, for effects that cannot be computed."""
        lacks = ((e.key, next((lack for run in self.fit.runs if (lack := run.lacks(e))), None)) for e in effects)
        return {key: lack for key, lack in lacks if lack is not None}

    def absent(self, effect: Effect) -> Unmeasured | None:
        """Channels lacking for a row that an effect acts on, or of a sensor fault its own; None where any are there.

        Also where one of its parameters acts in rows alone that no run has.
        """
        runs, fault = self.fit.runs, effect.as_fault
        if fault is not None:
            there = any(fault.changes(run.recording) for run in runs)
            return None if there else Unmeasured(runs[0].name, fault.channels())
        asked = [None, *range(len(effect.parameters))]
        found = next((one for own in asked if (one := rows_absent(runs, effect, own)) is not None), None)
        absence = None if found is None else found.absence
        return None if absence is None else Unmeasured(runs[0].name, absence.fewest)

    def scale(self) -> KnownScale | None:
        """How well the scale of the fit is known; None where a run measures wheel loads."""
        return known_scale(self.fit, estimates(self.fit, None, self.fit.runs))

    def assumed(self, rests: Mapping[Row, float]) -> Mapping[Row, tuple[str, ...]]:
        """Row → channels assumed whose error its rest may be."""
        return assumed_channels(self.fit, rests)

    def products(
        self, floor: NoiseFloor, layout: Layout, prior_stiffening: float, drifts: Mapping[str, float], seed: int,
        extent: Extent = Extent.ALL, known: CrossProducts | None = None,
    ) -> CrossProducts:  # fmt: skip
        """Cross products of the columns of a layout, from one pass over the samples."""
        return CrossProducts.of(self.fit, floor, layout, prior_stiffening, drifts, seed, extent, known)

    def regressor_noise(self, weighting: Weighting, sigma: Mapping[Row, float], progress: Progress) -> RegressorNoise:
        """Noise in the columns of all runs, for rows weighted by `sigma`."""
        return RegressorNoise.of(self.fit, weighting.layout, sigma, progress)

    def regressor_noise_of(
        self, run: int, weighting: Weighting, sigma: Mapping[Row, float], pairs: int
    ) -> RegressorNoise:
        """Noise in the columns of one run, from so many pairs of draws."""
        return RegressorNoise.of_run(self.fit, weighting.layout, sigma, run, pairs)
