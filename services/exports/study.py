"""What can be exported of a study's version."""

from __future__ import annotations

from pathlib import Path

from lacet.identify.progress import silent
from lacet.services.exports.files import Identified
from lacet.services.progress import Progress
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study


def identified(study: Study, number: int | None = None, progress: Progress = silent) -> Identified:
    """A version of a study, by default the present one; its fit is loaded only where it is needed.

    Raises UsageError when there is no such version.
    """
    version = study.version(number)
    used, _ = study.runs_of(version)
    runs, folder = ", ".join(Path(name).stem for name in used), study.folder.resolve().name
    vehicle = study.vehicle
    return Identified(
        vehicle, version.result, lambda: Session(study.at(version), progress).values.fitted(version),
        study.diagnosis(version.number),
        f"{vehicle.name}, identified by lacet from {runs}: version {version.number} of study {folder}",
    )  # fmt: skip
