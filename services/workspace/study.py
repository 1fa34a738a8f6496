"""Study: a folder of text files with the sequence of models of one car and their errors, fit for version control.

::

    study.json          the runs used and held out, the filters, the present version
    rig.toml            copies, so that the folder is complete
    vehicle.toml
    effects/            the user's own effects, one Python file each
    versions/001.json   a model, its fit, its errors on every run; one file a version, never changed afterwards
    diagnoses/001.json  the diagnosis of that version
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.regression.model import Model
from lacet.identify.signals.filters import Filters
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS
from lacet.services.workspace.effect_files import own_classes

FORMAT = "lacet-study 1"
_FILE = "study.json"
WRITING = threading.Lock()
"""Held while this process writes a study: whoever interrupts a thread does it outside."""


Runs = tuple[tuple[str, ...], tuple[str, ...]]
"""Paths of the runs used, and of those held out."""


@dataclass(frozen=True)
class Version:
    """One model of a study, with its fit and scores.

    `number` counts from 1; `effects` are the effects beyond the base model, as key → shape constants, in the order
    they were added; `note` describes the change; `result` holds fit and scores (``docs/json.md``); `parent` is the
    version it was made from, 0 for the first; `runs` the paths of the runs used and of those held out, None in files of
    lacet versions that did not store them (see `Study.runs_of`).

    Examples
    --------
    >>> lacet.Version(1, {"anti_roll_bar.front": {}}, "added anti_roll_bar.front").parent
    0
    """

    number: int
    effects: Mapping[str, Mapping[str, float]]
    note: str
    result: Mapping[str, Any] = field(default_factory=dict[str, Any])
    parent: int = 0
    runs: Runs | None = None


@dataclass(frozen=True)
class Study:
    """A folder with the runs, rig, vehicle and model versions of one car.

    `used` and `held` are paths of runs, `filters` the filter settings, `draws` the number of noise-floor simulations,
    `current` the number of the version that commands use. `before` : runs of the versions without runs of their own,
    once others were chosen.

    Examples
    --------
    >>> study = lacet.Study.create(Path("study"), [Path("tests/data/car/sine.parquet")], [], runs.rig, runs.vehicle)
    >>> lacet.Study.open("study").versions()
    []
    """

    folder: Path
    used: tuple[str, ...]
    held: tuple[str, ...]
    filters: Filters
    draws: int
    current: int = 0
    before: Runs | None = None

    @classmethod
    def create(
        cls,
        folder: Path,
        used: Sequence[Path],
        held: Sequence[Path],
        rig: Rig,
        vehicle: Vehicle,
        filters: Filters | None = None,
        draws: int = DEFAULT_DRAWS,
    ) -> Study:
        """A new study folder. Raises UsageError when there is one already, or a run is both used and held out."""
        if (folder / _FILE).exists():
            raise UsageError(f"{folder} is a study already: choose another folder, or go on: lacet study {folder}")
        _refuse_both(used, held)
        try:
            for part in ("versions", "diagnoses", "effects"):
                (folder / part).mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            raise UsageError(f"{folder}: no folder can be made there: {cause.strerror}") from None
        _write_text(folder / "rig.toml", rig.text)  # whole: a page may read an earlier one there meanwhile
        _write_text(folder / "vehicle.toml", vehicle.text)
        study = cls(
            folder, tuple(_relative(p, folder) for p in used), tuple(_relative(p, folder) for p in held),
            filters or Filters(), draws,
        )  # fmt: skip
        study._save()
        return study

    @classmethod
    def open(cls, folder: str | Path) -> Study:
        """The study of a folder. Raises UsageError when it is none, or its file cannot be read."""
        path = Path(folder) / _FILE
        if not path.is_file():
            if Path(folder).is_file():
                raise UsageError(f"{folder} is a file; a study is a folder; make one: lacet study new DIR --use RUN…")
            raise UsageError(f"{folder} is no study (no {_FILE} in it); make one: lacet study new {folder} --use RUN…")
        try:
            data: Any = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(data, dict):
                raise ValueError("not an object")
            data = cast(dict[str, Any], data)
            if data.get("format") != FORMAT:
                raise ValueError(f'format is {data.get("format")!r}, expected "{FORMAT}"')
            return cls(
                Path(folder), tuple(data["used"]), tuple(data["held"]), Filters(**data["filters"]), int(data["draws"]),
                int(data["current"]), _runs(data.get("before")),
            )  # fmt: skip
        except (ValueError, KeyError, TypeError) as cause:
            raise _broken(path, cause) from None

    @property
    def rig(self) -> Rig:
        """The study's rig."""
        return Rig.load(self.folder / "rig.toml", kept=True)

    @property
    def vehicle(self) -> Vehicle:
        """The study's vehicle."""
        return Vehicle.load(self.folder / "vehicle.toml")

    def paths(self, held: bool = False) -> list[Path]:
        """Paths of the runs used, or of those held out."""
        return [self.folder / name for name in (self.held if held else self.used)]

    def effects(self, reference: str) -> dict[str, Effect]:
        """The catalogue with the study's own effects, and effects that differ between the runs used."""
        runs = [Path(name).stem for name in self.used]
        return catalogue(self.vehicle, reference, own_classes(self.folder / "effects"), runs)

    def model(self, version: Version, reference: str) -> Model:
        """The model of a version: the base model and the effects added."""
        known = self.effects(reference)
        added = [replace(find_effect(key, known), shape=dict(shape)) for key, shape in version.effects.items()]
        return Model.of([*base_model(self.vehicle, reference), *added])

    def versions(self) -> list[Version]:
        """All versions, in order."""
        files = sorted((self.folder / "versions").glob("[0-9]*.json"))
        return [_version(file) for file in files]

    def version(self, number: int | None = None) -> Version:
        """A version by number, by default the current one. Raises UsageError when there is none."""
        number = self.current if number is None else number
        file = self.folder / "versions" / f"{number:03d}.json"
        if not file.is_file():
            raise UsageError(f"{self.folder} has no version {number} (it has {len(self.versions())})")
        return _version(file)

    def runs_of(self, version: Version) -> Runs:
        """The runs that a version used and those held out."""
        return version.runs or self.before or (self.used, self.held)

    def at(self, version: Version) -> Study:
        """The same study with the runs of a version; nothing is written."""
        used, held = self.runs_of(version)
        return replace(self, used=used, held=held)

    def with_runs(self, used: Sequence[Path], held: Sequence[Path]) -> Study:
        """The same study with other runs, which are stored once a version is recorded with them.

        Raises UsageError when no run is used, or one is both used and held out.
        """
        if not used:
            raise UsageError("name at least one run to identify with")
        _refuse_both(used, held)
        chosen = [tuple(_relative(p, self.folder) for p in paths) for paths in (used, held)]
        return replace(self, used=chosen[0], held=chosen[1], before=self.before or (self.used, self.held))

    def record(self, effects: Mapping[str, Mapping[str, float]], note: str, result: Mapping[str, Any]) -> Study:
        """Write a new version and make it the current one; earlier versions are never changed.

        Raises UsageError when another writer has recorded a version meanwhile, which this one is not based on.
        """
        with self._only_writer():
            now = Study.open(self.folder).current
            if now != self.current:
                raise UsageError(
                    f"another lacet went from version {self.current} to {now} of {self.folder} meanwhile: start again"
                )
            number = max((v.number for v in self.versions()), default=0) + 1
            body = {
                "format": FORMAT, "version": number, "parent": self.current, "effects": effects, "note": note,
                "used": list(self.used), "held": list(self.held), "result": result,
            }  # fmt: skip
            _write(self.folder / "versions" / f"{number:03d}.json", body)
            study = replace(self, current=number)
            study._save()
        return study

    def go_to(self, number: int) -> Study:
        """Make another version the current one, with its runs. Raises UsageError when there is none of that number."""
        runs = self.runs_of(self.version(number))
        with self._only_writer():
            study = replace(self, current=number, used=runs[0], held=runs[1])
            study._save()
        return study

    def with_draws(self, draws: int) -> Study:
        """The same study with another number of noise-floor simulations; nothing is written."""
        return replace(self, draws=draws)

    def record_diagnosis(self, result: Mapping[str, Any]) -> None:
        """Store the diagnosis of the current version."""
        _write(self.folder / "diagnoses" / f"{self.current:03d}.json", {"format": FORMAT, **result})

    def diagnosis(self, number: int | None = None) -> Mapping[str, Any] | None:
        """The last diagnosis of a version, by default the current one, or None.

        Raises UsageError when its file cannot be read.
        """
        file = self.folder / "diagnoses" / f"{self.current if number is None else number:03d}.json"
        if not file.is_file():
            return None
        try:
            found: Any = json.loads(file.read_text(encoding="utf-8"))
            if not isinstance(found, dict):
                raise ValueError("not an object")
        except ValueError as cause:
            raise UsageError(
                f"{file} cannot be read: {cause}; remove it and look again for what is missing (lacet diagnose)"
            ) from None
        return cast(dict[str, Any], found)

    @contextmanager
    def _only_writer(self) -> Generator[None]:
        """Lock against a second writer. Raises UsageError when there is one."""
        lock = self.folder / ".writing"
        with WRITING:
            try:
                lock.touch(exist_ok=False)
            except FileExistsError:
                raise UsageError(f"another lacet is writing to {self.folder}; if not, remove {lock}") from None
            try:
                yield
            finally:
                lock.unlink(missing_ok=True)

    def _save(self) -> None:
        filters = {k: getattr(self.filters, k) for k in ("rate", "pre_cutoff", "fit_cutoff", "order", "edge")}
        _write(
            self.folder / _FILE,
            {
                "format": FORMAT, "used": list(self.used), "held": list(self.held), "filters": filters,
                "draws": self.draws, "current": self.current,
                **({"before": {"used": list(self.before[0]), "held": list(self.before[1])}} if self.before else {}),
            },
        )  # fmt: skip


def _version(file: Path) -> Version:
    try:
        data: Any = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise ValueError("not an object")
        data = cast(dict[str, Any], data)
        number = int(data["version"])
        parent = int(data.get("parent", number - 1))
        runs = _runs(data if "used" in data else None)
        return Version(number, data["effects"], str(data["note"]), data["result"], parent, runs)
    except (ValueError, KeyError, TypeError) as cause:
        raise _broken(file, cause) from None


def _broken(file: Path, cause: Exception) -> UsageError:
    why = f"it has no {cause}" if isinstance(cause, KeyError) else str(cause)
    return UsageError(f"{file} cannot be read: {why}; lacet writes it whole, so put a good copy back")


def _runs(data: Mapping[str, Any] | None) -> Runs | None:
    return None if data is None else (tuple(data["used"]), tuple(data["held"]))


def _refuse_both(used: Sequence[Path], held: Sequence[Path]) -> None:
    both = sorted(str(p) for p in {p.resolve() for p in used} & {p.resolve() for p in held})
    if both:
        raise UsageError(f"these runs are both used and held out: {', '.join(both)}")


def _write(file: Path, body: Mapping[str, Any]) -> None:
    """Write a JSON file; the result of minutes is not lost for a folder that somebody has removed."""
    file.parent.mkdir(exist_ok=True)
    _write_text(file, json.dumps(body, indent=1, ensure_ascii=False) + "\n")


def _write_text(file: Path, text: str) -> None:
    """Write a complete file or none: whoever reads meanwhile, or after an interruption, has the last good one."""
    beside = file.with_suffix(".tmp")
    beside.write_text(text, encoding="utf-8")
    beside.replace(file)


def _relative(path: Path, folder: Path) -> str:
    """A path relative to the folder, so that folder and runs can be moved together, to another system as well.

    Absolute where there is no way from one to the other: on two drives of Windows.
    """
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()
