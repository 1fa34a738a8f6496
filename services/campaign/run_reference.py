"""Reference of a run, as a task receives it, and how a worker reads the run."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from lacet.daq.errors import RunError, UsageError
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.run_files import first_files
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensor_offsets import PayloadSpread
from lacet.identify.signals.filters import Filters
from lacet.services.cache.keys import run_digest
from lacet.services.workspace.loading import find_rig, find_vehicle, prepare_run


@dataclass(frozen=True)
class RunReference:
    """Where a worker finds a run, and what it must find there.

    Attributes
    ----------
    place : path of the file as the worker sees it, or an address that fsspec reads (``s3://…``, ``https://…``).
    name : name of the run, another for each of a campaign.
    digest : of the file's content; empty where it is not known yet.
    """

    place: str
    name: str
    digest: str = ""

    @property
    def seed(self) -> int:
        """Number of the run in the seeds of its noise draws: from its content, whatever its place in a campaign."""
        return int(self.digest[:12], 16)


@dataclass(frozen=True)
class Settings:
    """What all tasks of a campaign have in common, as plain values.

    Attributes
    ----------
    rig : text of the rig file; empty: each run's own.
    vehicle : text of the vehicle file; empty: the run's own.
    filters : the filters.
    effects : keys of the effects beyond the base model.
    wheel_reference : ``contact`` or ``hub``: where the runs' wheel loads are; empty where it is not known yet.
    zeros : whether each run has its sensor zeros.
    payload : how much the runs' payloads differ, where each has its own.
    store : folder, as the workers see it, in which each run's sums are kept; empty: nowhere.
    """

    rig: str = ""
    vehicle: str = ""
    filters: Filters = field(default_factory=Filters)
    effects: tuple[str, ...] = ()
    wheel_reference: str = ""
    zeros: bool = True
    payload: PayloadSpread | None = None
    store: str = ""

    @property
    def car(self) -> Vehicle:
        """The vehicle that the runs are of."""
        return Vehicle.parse(self.vehicle)

    def known_effects(self) -> dict[str, Effect]:
        """The catalogue for this vehicle."""
        return catalogue(self.car, self.wheel_reference)

    def model(self) -> Model:
        """The base model and the effects added. Raises UsageError for an effect that there is not."""
        known = self.known_effects()
        added = (find_effect(key, known) for key in self.effects)
        return Model.of([*base_model(self.car, self.wheel_reference), *added])


class ChangedRun(RunError):
    """A run whose content is no longer that with which the campaign began."""


def references(places: Sequence[str]) -> list[RunReference]:
    """References of runs, in order; runs of one name have that of their folders before it.

    Raises UsageError when a run is given twice or two cannot be distinguished by name and folder.
    """
    if not places:
        raise UsageError("no run given")
    here = {str(path) for path in first_files(Path(place) for place in places if "://" not in place)}
    places = [place for place in places if "://" in place or str(Path(place)) in here]
    if twice := [place for place, often in Counter(places).items() if often > 1]:
        raise UsageError(f"given twice, which would count its samples twice: {', '.join(twice)}")
    paths = [Path(place.partition("://")[2] or place) for place in places]
    stems = Counter(path.stem for path in paths)
    names = [path.stem if stems[path.stem] == 1 else f"{path.parent.name}-{path.name}" for path in paths]
    often = Counter(names)
    names = [name if often[name] == 1 else f"{name} ({number + 1})" for number, name in enumerate(names)]
    return [RunReference(place, name) for place, name in zip(places, names, strict=True)]


@dataclass(frozen=True)
class ReadRun:
    """A run as a worker has read it.

    Attributes
    ----------
    reference : where it was found, with the digest of its content.
    rig, vehicle : of the run.
    prepared : ready for fitting.
    warnings : about the run, one line each.
    sound : whether no channel of it is in doubt.
    """

    reference: RunReference
    rig: Rig
    vehicle: Vehicle
    prepared: PreparedRun
    warnings: tuple[str, ...]
    sound: bool


def read_run(reference: RunReference, settings: Settings) -> ReadRun:
    """The run of a reference, prepared.

    Raises RunError when the file cannot be read, or is not the one that the reference's digest is of (`ChangedRun`);
    NotIdentifiable when no row of the equations can be formed.
    """
    with _local(reference.place) as file:
        if not file.is_file():
            raise RunError(reference.place, ["no such file on the worker"])
        digest = run_digest(file)
        if reference.digest and digest != reference.digest:
            raise ChangedRun(reference.place, ["its content has changed since the campaign began"])
        run: Run = replace(open_run(file), name=reference.name)
    warnings = [f"{run.name}: {problem}" for problem in run.problems]
    rig = Rig.parse(settings.rig) if settings.rig else find_rig(run, None)
    vehicle = settings.car if settings.vehicle else find_vehicle(run, None)
    ready = prepare_run(run, vehicle, rig, settings.filters, warnings)
    ready = ready.with_noise(ready.noise)  # of this run alone: a task sees no other
    return ReadRun(replace(reference, digest=digest), rig, vehicle, ready.prepared, tuple(warnings), ready.sound)


@contextmanager
def _local(place: str) -> Iterator[Path]:
    """The file of a run; one from elsewhere is copied here for as long as it is read."""
    if "://" not in place:
        yield Path(place)
        return
    import fsspec  # comes with Dask; only here, so that a plain installation does without

    with tempfile.TemporaryDirectory(prefix="lacet-run-") as folder:
        file = Path(folder) / Path(place).name
        try:
            fsspec.filesystem(place.partition("://")[0]).get_file(place, str(file))
        except (OSError, ValueError, ImportError) as cause:
            raise RunError(place, [f"cannot be read from there: {cause}"]) from None
        yield file
