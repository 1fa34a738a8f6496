"""Loading of runs from files, with their rig and vehicle; doubtful channels are left out and reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import LacetError, NotIdentifiable, RigError, RunError, UsageError, VehicleError
from lacet.daq.formats.open_run import open_log
from lacet.daq.formats.run_files import first_files
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.run_limits import RunLimits
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import needs
from lacet.identify.multibody.chain import GRAVITY, Chain
from lacet.identify.progress import silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.for_equations import for_equations
from lacet.identify.signals.noise_level import NoiseLevel, as_measured, measured_noise, quietest
from lacet.identify.signals.sources import Kind
from lacet.identify.validation.channels.recorded_faults import recorded_faults
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.identify.validation.channels.unusable_values import without_unusable
from lacet.identify.validation.clocks import differing_clocks
from lacet.identify.validation.exchanged_wheels import exchanged_wires
from lacet.identify.validation.plausibility import doubtful_channels
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render import channels, plausibility, sensor_report
from lacet.services.render.row_needs import no_rows
from lacet.services.render.rows import run_notes


@dataclass(frozen=True)
class Loaded:
    """Prepared runs with their vehicle and rig, and warnings for the user, one line each.

    `runs` : the runs as read, without the channels left out, where `load` was asked to keep them; `sheet` : sentences
    on noise that the rig's sensor sheet states too large or too small, so that the measured one is used; `notes` : on
    how the runs were read, none of them on a fault.
    """

    vehicle: Vehicle
    rig: Rig
    prepared: tuple[PreparedRun, ...]
    warnings: tuple[str, ...]
    runs: tuple[Run, ...] = ()
    sheet: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def said(self) -> tuple[str, ...]:
        """All that a user reads of the runs, worst first."""
        return (*self.warnings, *self.sheet, *self.notes)

    @property
    def reference(self) -> str:
        """Wheel reference of the runs: ``contact`` or ``hub``."""
        return self.prepared[0].recording.reference


@dataclass(frozen=True)
class ReadyRun:
    """A run prepared for fitting, without the channels that are left out.

    `run` : as read, None where it is not kept; `sound` : whether units, signs and values raised no doubt; `noise` :
    measured noise of its channels; `notes` : on how it was read, none of them on a fault.
    """

    run: Run | None
    prepared: PreparedRun
    sound: bool
    noise: tuple[NoiseLevel, ...]
    notes: tuple[str, ...] = ()

    def with_noise(self, levels: Sequence[NoiseLevel]) -> ReadyRun:
        """The run whose equations use measured noise in place of the sheet's, as far as it `corrects` that."""
        recording = self.prepared.recording
        used = as_measured(recording.rig, levels)
        if used is recording.rig:
            return self
        return replace(self, prepared=PreparedRun(replace(recording, rig=used).smoothed()))


@dataclass(frozen=True)
class CheckedRun:
    """A run prepared for its equations, and what is doubtful in its channels, one sentence each.

    `run` : with the channels of its equations only, samples that are no measurement flagged; `unusable` : of those
    samples; `single` : of other faults of single channels; `compared` : of channels that contradict others.
    """

    run: Run
    prepared: PreparedRun
    unusable: tuple[str, ...]
    single: tuple[str, ...]
    compared: tuple[str, ...]

    @property
    def recorded(self) -> tuple[str, ...]:
        """Those of single channels, by their values."""
        return (*self.unusable, *self.single)

    @property
    def doubts(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.recorded, *self.compared)


def find_rig(run: Run, given: str | Path | None) -> Rig:
    """The rig given, else the one in the run's log, else the one it names."""
    if given is not None:
        return Rig.load(given)
    if run.rig_text:
        return Rig.parse(run.rig_text, f"rig in {run.name}")
    if not run.rig:
        raise UsageError(f"{run.name} does not say which rig recorded it: give --rig FILE")
    try:
        return Rig.load(run.rig)
    except RigError as error:
        raise UsageError(
            f"{run.name} names the rig '{run.rig}', which was not found: give --rig FILE\n{error}"
        ) from None


def check_reference(used: str, held: str) -> None:
    """Raise UsageError when runs held out have their wheel loads at another point than the runs used."""
    if held != used:
        raise UsageError(f"the runs held out have {held} wheel loads, those used {used}")


def load_chain(
    path: str | Path, values: Mapping[str, float] | None = None, gravity: Sequence[float] | None = None
) -> Chain:
    """The chain of a SYMORO ``.par`` file, or of a URDF file (``.urdf``); arguments as in `Chain.from_par`.

    Raises ParError or UrdfError (a ValueError) with every fault of the file, FileNotFoundError when there is none.

    Examples
    --------
    >>> lengths = {"LF": 1.3, "LR": 1.4, "EF": 0.75, "ER": 0.73, "G3": -9.81}
    >>> lacet.load_chain("tests/data/symoro/CarLite.par", lengths).missing
    ()
    """
    if Path(path).suffix.lower() == ".urdf":
        return Chain.from_urdf(Path(path).read_text(encoding="utf-8-sig"), gravity or GRAVITY, name=str(path))
    return Chain.from_par(Path(path).read_text(encoding="utf-8", errors="replace"), values, gravity, str(path))


def find_vehicle(run: Run, given: str | Path | None) -> Vehicle:
    """The vehicle given, else the one in the run's log, else the one it names."""
    if given is not None:
        return Vehicle.load(given)
    if run.vehicle_text:
        return Vehicle.parse(run.vehicle_text, f"vehicle in {run.name}")
    if not run.vehicle:
        raise UsageError(f"{run.name} does not say which vehicle it is of: give --vehicle FILE")
    try:
        return Vehicle.load(run.vehicle)
    except VehicleError as error:
        raise UsageError(
            f"{run.name} names the vehicle '{run.vehicle}', which was not found: give --vehicle FILE\n{error}"
        ) from None


def load(
    paths: Sequence[str | Path],
    rig: str | Path | None = None,
    vehicle: str | Path | None = None,
    filters: Filters | None = None,
    progress: Progress = silent,
    channel_map: str | Path | None = None,
    raw: bool = False,
    limits: RunLimits | None = None,
) -> Loaded:
    """The runs of files, prepared for fitting; `progress` receives the number prepared.

    `channel_map` : map of logs that other systems wrote; lacet's own are read without it. `raw` : keep the runs as read
    as well, which are larger than what is prepared of them. `limits` : of the part of each run that is used.

    A run that cannot be used is left out with its reason, as long as another can. Runs of the same name are
    distinguished by their folders. Raises the error of the first when none can, UsageError when a run is given twice or
    runs differ in wheel reference.
    """
    if not paths:
        raise UsageError("no run given")
    paths = first_files(map(Path, paths))
    places = [Path(path).resolve() for path in paths]
    if twice := sorted({str(p) for p in places if places.count(p) > 1}):
        raise UsageError(f"given twice, which would count its samples twice: {', '.join(twice)}")
    by_map = None if channel_map is None else ChannelMap.load(channel_map)
    warnings: list[str] = []
    ready: list[ReadyRun] = []
    failed: list[LacetError] = []
    car: Vehicle | None = None
    sensors: Rig | None = None
    for done, path in enumerate(paths):
        progress(ServiceStep(ServiceStage.READING_RUN, done, len(paths)))
        try:
            run = (limits or RunLimits()).of(_named_apart(open_log(path, by_map), Path(path), places)).on_disk()
            warnings += [f"{run.name}: {problem}" for problem in run.problems]
            sensors = sensors or find_rig(run, rig)
            car = car or find_vehicle(run, vehicle)
            one = prepare_run(run, car, sensors if rig else find_rig(run, rig), filters, warnings)
            ready.append(one if raw else replace(one, run=None))
            del run, one  # before the next one is read
        except (RunError, NotIdentifiable) as error:
            failed.append(error)
            warnings.append(f"left out: {error}")
    if not ready or car is None or sensors is None:
        raise failed[0]
    sensors = ready[0].prepared.recording.rig
    ready, levels = in_common(ready)
    drives = tuple(one.prepared for one in ready)
    references = {drive.recording.reference for drive in drives}
    if len(references) > 1:
        raise UsageError("the runs have different wheel references (contact and hub): identify them apart")
    warnings += map(channels.from_equations, column_faults([one.prepared for one in ready if one.sound]))
    wrong = tuple(sensor_report.sheet_noise(levels))
    notes = tuple(note for one in ready for note in one.notes)
    kept = tuple(one.run for one in ready if one.run is not None)
    return Loaded(car, sensors, drives, tuple(warnings), kept, wrong, notes)


def prepare_run(run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None, warnings: list[str]) -> ReadyRun:
    """A run without wheels that seem exchanged, and prepared for fitting; what is doubtful is added to `warnings`.

    Its equations use the noise of the rig's sheet; `ReadyRun.with_noise` puts the measured one in its place.

    Raises RunError when it is too short, NotIdentifiable when no row of the equations can be formed.
    """
    checked = checked_run(run, vehicle, rig, filters)
    run, drive = checked.run, checked.prepared
    warnings += [f"{run.name}: {said}" for said in checked.doubts]
    exchanged = None if checked.recorded else exchanged_wires(run, drive)
    if exchanged is not None:
        warnings.append(f"{run.name}: {plausibility.of_wires(exchanged)}")
        run = replace(run, signals={name: s for name, s in run.signals.items() if not exchanged.left_out(name)})
        drive = PreparedRun.of(run, vehicle, drive.recording.rig, filters)
    notes = (*drive.recording.notes, *drive.measured_rows.notes)
    warnings += [f"{run.name}: {note}" for note in run_notes(note for note in notes if note.is_fault)]
    if not drive.rows:
        raise NotIdentifiable(
            "\n  ".join(
                [
                    f"{run.name}: no row of the equations can be formed:",
                    *([plausibility.of_wires(exchanged)] if exchanged else []),
                    no_rows(drive.measured_rows.left_out),
                    *checked.unusable,
                ]
            )
        )
    sound = not (checked.doubts or exchanged)
    said = tuple(f"{run.name}: {note}" for note in run_notes(note for note in notes if not note.is_fault))
    return ReadyRun(run, drive, sound, _noise_in_rows(run, drive), said)


def checked_run(run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None) -> CheckedRun:
    """A run prepared for its equations, whether or not it has wheel loads, with its doubtful channels.

    Samples that are no measurement by their values are flagged, so that the others are used. Raises RunError when the
    run is too short.
    """
    run, rig = for_equations(run, vehicle, rig)
    run, flagged = without_unusable(run, rig)
    drive = PreparedRun.of(run, vehicle, rig, filters)
    unusable, single = (tuple(map(channels.sentence, found)) for found in (flagged, recorded_faults(run, drive)))
    overview = drive.overview()
    late, doubts = differing_clocks(overview), doubtful_channels(overview)
    # Where a unit explains it, the motion is not another's; where a clock does, signs and sizes mean nothing.
    by_clock = late and not any(doubt.guess for doubt in doubts)
    compared = map(plausibility.of_clocks, late) if by_clock else map(plausibility.sentence, doubts)
    return CheckedRun(run, drive, unusable, single, tuple(compared))


def in_common(ready: Sequence[ReadyRun]) -> tuple[list[ReadyRun], tuple[NoiseLevel, ...]]:
    """Runs with their common noise, and without assumptions on what one of them measures; and that noise."""
    ready = _assuming_only_what_none_measures(ready)
    levels = quietest([one.noise for one in ready])
    return [one.with_noise(levels) for one in ready], tuple(levels)


def _assuming_only_what_none_measures(ready: Sequence[ReadyRun]) -> list[ReadyRun]:
    """The runs, without those rows on assumptions that another of them measures."""
    measured: set[str] = set()
    for one in ready:
        recording = one.prepared.recording
        for row in one.prepared.rows:
            needed = needs(row, recording.reference, vehicle=recording.vehicle)
            kinds = {recording.sources[c].kind for c in needed if c in recording.sources}
            measured |= {row} if Kind.ASSUMED not in kinds else set()
    out: list[ReadyRun] = []
    for one in ready:
        recording = one.prepared.recording
        if recording.laws and measured:
            one = replace(one, prepared=PreparedRun(replace(recording, measured_elsewhere=frozenset(measured))))
        out.append(one)
    return out


def _noise_in_rows(run: Run, drive: PreparedRun) -> tuple[NoiseLevel, ...]:
    """Measured noise of the channels that the rows of a run need."""
    grounds = tuple(c for c in CORNERS if f"laser.{c}.ground" in drive.recording.signals.value)
    channels = {name for row in drive.rows for name in needs(row, drive.recording.reference, grounds)}
    channels |= {name for source in drive.recording.sources.values() for name in source.inputs}
    families = {CHANNELS[name].family for name in channels}
    return tuple(level for level in measured_noise([run], drive.recording.rig) if level.family in families)


def _named_apart(run: Run, path: Path, places: Sequence[Path]) -> Run:
    """The run, with its folder in its name where another run has the same name."""
    alike = sum(place.stem == path.stem for place in places) > 1
    return replace(run, name=f"{path.resolve().parent.name}-{run.name}{path.suffix}") if alike else run


def default_filters(cutoff: float | None) -> Filters:
    """Filters with another cut-off of the fit [Hz]. Raises UsageError when it is out of range."""
    if cutoff is None:
        return Filters()
    if not cutoff > 0.0:
        raise UsageError(f"--cutoff {cutoff:g}: a frequency above 0 Hz (the paper says 3 to 7)")
    try:
        return Filters(fit_cutoff=cutoff, pre_cutoff=max(20.0, 3.0 * cutoff))
    except ValueError as cause:
        raise UsageError(str(cause)) from None
