"""Runs loaded for identification, with the checks of units, signs and exchanged wheels."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.library.display import html_of
from lacet.services.workspace.loading import Loaded, default_filters, load


class LoadingWarning(UserWarning):
    """Warning about a run that was loaded: a unit, a sign, exchanged wheels, a damaged interval.

    Examples
    --------
    >>> import warnings
    >>> warnings.simplefilter("error", lacet.LoadingWarning)  # a doubt ends a script
    """


@dataclass(frozen=True, repr=False)
class Runs:
    """Prepared runs of one vehicle and rig: channels on one grid, motion, and rows of the equations.

    Returned by `lacet.load_runs`; a sequence of prepared runs, in the order of the files.

    Attributes
    ----------
    vehicle : geometry and a-priori values of the car.
    rig : sensors, their mounting and their sensor sheet.
    warnings : findings of the checks of units, signs and wheels, one line each.

    Examples
    --------
    >>> [run.name for run in runs]
    ['sine', 'liftoff']
    >>> runs.reference
    'hub'
    """

    vehicle: Vehicle
    rig: Rig
    warnings: tuple[str, ...]
    loaded: Loaded = field(repr=False)

    @property
    def prepared(self) -> tuple[PreparedRun, ...]:
        """The prepared runs."""
        return self.loaded.prepared

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.name for run in self.prepared)

    @property
    def reference(self) -> str:
        """Reference point of the wheel loads: ``contact`` or ``hub``."""
        return self.loaded.reference

    def __iter__(self) -> Iterator[PreparedRun]:
        return iter(self.prepared)

    def __len__(self) -> int:
        return len(self.prepared)

    def __repr__(self) -> str:
        lines = [f"Runs of {self.vehicle.name}, rig {self.rig.name}, {self.reference} wheel loads:"]
        lines += [f"  {run.name}: {run.recording.t[-1]:.1f} s, {len(run.rows)} rows" for run in self.prepared[:12]]
        lines += [f"  and {len(self) - 12} more"] if len(self) > 12 else []
        lines += [f"  warning: {line[:160]}" for line in self.warnings[:4]]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html_of(repr(self))


def load_runs(
    *paths: str | Path,
    rig: str | Path | None = None,
    vehicle: str | Path | None = None,
    cutoff: float | None = None,
    map: str | Path | None = None,
) -> Runs:
    """Load runs for identification, with checks of units, signs and exchanged wheels.

    Parameters
    ----------
    paths : decoded logs (.mcap), exchange tables (.parquet, .csv) or MDF files (.mf4).
    rig, vehicle : a file, or the name of one shipped; by default those recorded in the first run.
    cutoff : cut-off of the fit's filter [Hz]; by default 6 Hz.
    map : channel map of logs that other systems wrote.

    Returns
    -------
    Runs
        The prepared runs. A run that cannot be used is left out, with the reason in `Runs.warnings`.

    Raises
    ------
    UsageError
        The paths are in a list.
    LacetError
        No run can be used, a file is wrong, or the runs do not belong together.

    Warns
    -----
    LoadingWarning
        For each doubt that the checks raise.

    Examples
    --------
    >>> car = "tests/data/car"
    >>> lacet.load_runs(f"{car}/sine.parquet", rig=f"{car}/rig.toml", vehicle=f"{car}/vehicle.toml").names
    ('sine',)"""
    if any(not isinstance(path, (str, Path)) for path in paths):
        raise UsageError("the runs are given one by one, a list of them with a star: load_runs(*paths)")
    loaded = load(paths, rig, vehicle, default_filters(cutoff), channel_map=map)
    for line in loaded.warnings:
        warnings.warn(line, LoadingWarning, stacklevel=2)
    return Runs(loaded.vehicle, loaded.rig, loaded.warnings, loaded)
