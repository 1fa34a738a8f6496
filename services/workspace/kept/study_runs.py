"""Runs of a study: those used and those held out, read when they are first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.progress import silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.workspace.kept.run_records import is_short, restored_runs, runs_record
from lacet.services.workspace.kept.study_cache import StudyCache
from lacet.services.workspace.loading import Loaded, check_reference, load
from lacet.services.workspace.study import Study, Version


class StudyRuns:
    """The runs of a study, read once; `progress` receives the steps of this and of all that is made of them."""

    def __init__(self, study: Study, progress: Progress = silent):
        self.study, self.progress = study, progress
        self._loaded: Loaded | None = None
        self._held: tuple[PreparedRun, ...] | None = None

    @property
    def loaded(self) -> Loaded:
        """The runs used, with rig and vehicle, and what is to be said about all runs read."""
        if self._loaded is None:
            self.progress(ServiceStep(ServiceStage.READING_RUNS, total=len(self.study.used), subject="used"))
            self._loaded = self._kept("used")
        return self._loaded

    def _kept(self, kind: str) -> Loaded:
        """The runs used or held out: as they are kept in the study, or read, and kept unless they are long."""
        cache, held = StudyCache(self.study), kind != "used"
        key = cache.recordings_key(held)
        kept = cache.store.load("runs", key)
        if kept is not None:
            folder = self.study.folder
            return restored_runs(kept, Rig.load(folder / "rig.toml"), Vehicle.load(folder / "vehicle.toml"))
        loaded = self._read(self.study.paths(held), kind)
        if is_short(loaded):
            cache.store.save("runs", key, runs_record(loaded))
        return loaded

    def _read(self, paths: Sequence[Path], kind: str) -> Loaded:
        folder = self.study.folder
        return load(
            paths, folder / "rig.toml", folder / "vehicle.toml", self.study.filters,
            lambda step: self.progress(replace(step, subject=kind)),
        )  # fmt: skip

    @property
    def held(self) -> tuple[PreparedRun, ...]:
        """The runs held out."""
        if self._held is None:
            self._held = ()
            if self.study.held:
                self.progress(ServiceStep(ServiceStage.READING_RUNS, total=len(self.study.held), subject="held out"))
                loaded = self._kept("held out")
                check_reference(self.loaded.reference, loaded.reference)
                warnings = tuple(dict.fromkeys((*self.loaded.warnings, *loaded.warnings)))
                self._loaded = replace(self.loaded, warnings=warnings, notes=(*self.loaded.notes, *loaded.notes))
                self._held = loaded.prepared
        return self._held

    def prepared(self, held: bool) -> tuple[PreparedRun, ...]:
        """The runs used, or those held out, prepared for fitting."""
        return self.held if held else self.loaded.prepared

    @property
    def present(self) -> tuple[bool, bool]:
        """Whether the runs used, and those held out, have been read."""
        return self._loaded is not None, self._held is not None or not self.study.held

    def reference(self, version: Version) -> str:
        """Wheel reference of the runs: as a version's result has it, or from the runs themselves."""
        return str(version.result.get("wheel_reference") or self.loaded.reference)
